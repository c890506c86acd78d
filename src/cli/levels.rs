//! The target of `simplify`: one, or a list of them for a chain of levels, each with a file.

use super::arguments::parse_length;
use super::log::Log;
use crate::config::{Level, Target};
use crate::error::{Error, Result};
use crate::system::units::{parse_count, parse_ratio};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Mark in OUTPUT that stands for the level.
const PLACE: &str = "{}";

/// Values joined by commas, each with the words that were typed.
#[derive(Clone, Debug)]
struct ListedValues<T>(Vec<(String, T)>);

#[derive(Clone, Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("target").required(true).multiple(true).args(["triangles", "ratio", "max_error", "grid"]))]
pub(super) struct TypedTarget {
    /// Triangles wanted, at most: 20000, 500k, 4M. Several, as 40M,4M,400k, make a chain of levels in one run: OUTPUT gets -40M,
    /// -4M and -400k before its ending, or holds {} for them.
    #[arg(long, value_name = "N", value_parser = parse_counts, allow_negative_numbers = true)]
    triangles: Option<ListedValues<u64>>,
    /// Share of the input's triangles: 1% or 0.01; or several, as 10%,1%,0.1%.
    #[arg(long, value_name = "R", value_parser = parse_ratios, conflicts_with = "triangles", allow_negative_numbers = true)]
    ratio: Option<ListedValues<f64>>,
    /// Largest distance from the input to the result and back, in input units; as few triangles as that allows, or
    /// as many as --triangles or --ratio say, if those come first.
    #[arg(long, value_name = "E", value_parser = parse_length, allow_negative_numbers = true)]
    pub(super) max_error: Option<f64>,
}

fn parse_list<T: PartialOrd>(
    text: &str,
    parse: impl Fn(&str) -> std::result::Result<T, String>,
) -> std::result::Result<ListedValues<T>, String> {
    let value = |word: &str| Ok((word.trim().to_owned(), parse(word.trim())?));
    let mut list: Vec<(String, T)> =
        text.split(',').map(value).collect::<std::result::Result<_, String>>()?;
    list.sort_by(|a, b| b.1.partial_cmp(&a.1).unwrap_or(std::cmp::Ordering::Equal));
    match list.windows(2).find(|pair| pair[0].1 == pair[1].1) {
        Some(pair) => Err(format!("{} and {} are the same level", pair[0].0, pair[1].0)),
        None => Ok(ListedValues(list)),
    }
}

/// True for one number with commas between its thousands: no level has leading zeros, and levels are typed falling.
fn is_grouped(text: &str) -> bool {
    let mut groups = text.split(',');
    let is_digits = |group: &str| group.bytes().all(|byte| byte.is_ascii_digit());
    let first = groups.next().unwrap_or_default();
    let mut next = groups.clone().peekable();
    let number = |group: &str| group.parse::<u64>().ok();
    let is_rising = next.peek().is_some_and(|second| number(second) > number(first));
    (1..=3).contains(&first.len())
        && is_digits(first)
        && next.peek().is_some()
        && groups.clone().all(|group| group.len() == 3 && is_digits(group))
        && (is_rising || groups.any(|group| group.starts_with('0')))
}

fn parse_counts(text: &str) -> std::result::Result<ListedValues<u64>, String> {
    if text.contains('%') {
        return Err(format!("a share of the triangles is --ratio {text}"));
    }
    if is_grouped(text) {
        let number = text.replace(',', "");
        return Err(format!("a comma separates levels; write one number without commas: {number}"));
    }
    parse_list(text, |word| match parse_count(word)? {
        0 => Err("a mesh of 0 triangles is none; ask for at least 1".to_owned()),
        count => Ok(count),
    })
}

fn parse_ratios(text: &str) -> std::result::Result<ListedValues<f64>, String> {
    parse_list(text, parse_ratio)
}

impl TypedTarget {
    /// True if several levels were asked for.
    pub(super) fn is_chain(&self) -> bool {
        let n_counts = self.triangles.as_ref().map_or(0, |list| list.0.len());
        n_counts.max(self.ratio.as_ref().map_or(0, |list| list.0.len())) > 1
    }

    /// Says that a ratio of 1 is all of the triangles: 1 % may have been meant.
    pub(super) fn warn_of_one(&self, log: &mut Log) {
        let words = self.ratio.iter().flat_map(|list| &list.0);
        if words.clone().any(|(word, ratio)| *ratio == 1.0 && !word.contains('%')) {
            log.say("warning: --ratio 1 is 100 %, all of the triangles; one percent is --ratio 1%");
        }
    }

    /// The levels, finest first, with the path of each; one that goes to `output` itself, unless a list was typed.
    pub(super) fn levels(&self, output: &Path, grid: Option<f64>) -> Result<Vec<Level>> {
        let named: Vec<(String, Target)> = match (&self.triangles, &self.ratio) {
            (Some(list), _) => {
                list.0.iter().map(|(word, n)| (word.clone(), Target::Triangles(*n))).collect()
            }
            (None, Some(list)) => {
                list.0.iter().map(|(word, r)| (word.clone(), Target::Ratio(*r))).collect()
            }
            (None, None) => {
                let target = grid.map(Target::CellSize).or(self.max_error.map(Target::MaxError));
                target.into_iter().map(|target| (String::new(), target)).collect()
            }
        };
        if named.is_empty() {
            return Err(Error::Usage("give --triangles, --ratio or --max-error".to_owned()));
        }
        if !self.is_chain() {
            let level = |(_, target)| Level { target, output: output.to_path_buf() };
            return Ok(named.into_iter().map(level).collect());
        }
        if self.max_error.is_some() {
            let what = "--max-error goes with one target; give one, or a run for each";
            return Err(Error::Usage(what.to_owned()));
        }
        let level = |(word, target): (String, Target)| {
            Ok(Level { target, output: path_of_level(output, &word)? })
        };
        named.into_iter().map(level).collect()
    }
}

/// `mesh.ply` becomes `mesh-40M.ply`, `{}/mesh.ply` becomes `40M/mesh.ply`.
fn path_of_level(output: &Path, word: &str) -> Result<PathBuf> {
    if output == Path::new("-") {
        let what = "a chain has a file for each level: give OUTPUT a name, not standard output";
        return Err(Error::Usage(what.to_owned()));
    }
    if let Some(text) = output.to_str().filter(|text| text.contains(PLACE)) {
        return Ok(text.replace(PLACE, word).into());
    }
    let mut name: OsString = output.file_stem().unwrap_or_default().to_owned();
    name.push("-");
    name.push(word);
    if let Some(ending) = output.extension() {
        name.push(".");
        name.push(ending);
    }
    Ok(output.with_file_name(name))
}
