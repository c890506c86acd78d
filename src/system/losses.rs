//! The ledger of losses: what an input had and the output has not, for every format and command.
//!
//! Code that reads, changes or writes a mesh and has no place for a part of it adds a `Loss`: with `Progress::lose` where a
//! `Progress` is at hand, else to the `Ledger` that the reader (`Materials::lose`), the plan of images or the writer hands on.
//! The command line prints each entry as a line, every report lists them as `losses`, and an entry of severity `Whole` ends a
//! command with exit code 3. Does not print.

use serde::{Deserialize, Serialize};

/// Entries of a ledger at most; the last one counts what is beyond them, as in a file of 200,000 odd names.
const MAX_ENTRIES: usize = 100;

/// Characters of a text of an entry at most; names come out of files.
const MAX_CHARACTERS: usize = 300;

/// Kinds of things that an input may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LossKind {
    /// Faces or vertices.
    Geometry,
    /// Points, lines, curves, morph targets: what is not a surface.
    Elements,
    /// Normals.
    Normals,
    /// Colours of vertices, faces or materials.
    Colors,
    /// Texture coordinates.
    TextureCoordinates,
    /// Images.
    Images,
    /// Looks of materials besides colour and images.
    Materials,
    /// Numbers with every vertex or face.
    Attributes,
    /// Names of objects, groups, nodes, materials.
    Names,
    /// Digits of coordinates or values.
    Precision,
}

/// Weight of a loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Recomputed, rounded, as asked, or of no effect on the surface and its looks.
    Notice,
    /// A part of a kind is lost.
    Partial,
    /// All of a kind that the input had is lost, without an option that asks for it: exit code 3.
    Whole,
}

/// An entry of the ledger.
///
/// ```
/// # use stonecut_system::losses::{Loss, LossKind};
/// let loss = Loss::new(LossKind::Colors, "colours", "outside of 0 to 1: clamped")
///     .count(12)
///     .example("line 7")
///     .remedy("scale them first");
/// assert_eq!(
///     loss.to_string(),
///     "colours of line 7: outside of 0 to 1: clamped, and 11 more; scale them first"
/// );
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Loss {
    /// The kind, for programs.
    pub kind: LossKind,
    /// The same in words, as exactly as is known.
    pub what: String,
    /// Number of things that are lost; 1 where they are not counted.
    pub count: u64,
    /// The first of them; empty where one is like the other.
    pub example: String,
    /// Reason of the loss.
    pub reason: String,
    /// Advice that avoids the loss; empty where there is none.
    pub remedy: String,
    /// Weight of the loss.
    pub severity: Severity,
}

impl Loss {
    /// A loss of a part (`Severity::Partial`) of one thing.
    pub fn new(kind: LossKind, what: impl AsRef<str>, reason: impl AsRef<str>) -> Loss {
        Loss {
            kind,
            what: shown(what.as_ref()),
            count: 1,
            example: String::new(),
            reason: shown(reason.as_ref()),
            remedy: String::new(),
            severity: Severity::Partial,
        }
    }

    /// A remark, a whole line, on something that was taken for something else or found to be odd.
    pub fn remark(line: impl AsRef<str>) -> Loss {
        Loss::new(LossKind::Geometry, line, "").notice()
    }

    /// The same of `n` things.
    #[must_use]
    pub fn count(self, n: u64) -> Loss {
        Loss { count: n, ..self }
    }

    /// The same with the first thing that is lost.
    #[must_use]
    pub fn example(self, example: impl AsRef<str>) -> Loss {
        Loss { example: shown(example.as_ref()), ..self }
    }

    /// The same with advice.
    #[must_use]
    pub fn remedy(self, remedy: impl AsRef<str>) -> Loss {
        Loss { remedy: shown(remedy.as_ref()), ..self }
    }

    /// The same with another weight.
    #[must_use]
    pub fn severity(self, severity: Severity) -> Loss {
        Loss { severity, ..self }
    }

    /// The same as a notice.
    #[must_use]
    pub fn notice(self) -> Loss {
        self.severity(Severity::Notice)
    }

    /// The same as a loss of a whole kind.
    #[must_use]
    pub fn whole(self) -> Loss {
        self.severity(Severity::Whole)
    }

    /// Puts another name in the place of a folder's.
    pub fn rename(&mut self, from: &str, to: &str) {
        for text in [&mut self.what, &mut self.example, &mut self.reason] {
            *text = text.replace(from, to);
        }
    }

    /// Returns whether two entries are of the same things for the same reason.
    fn is_like(&self, other: &Loss) -> bool {
        (self.kind, &self.what, &self.reason) == (other.kind, &other.what, &other.reason)
    }
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        const VERBS: [&str; 5] = ["is ", "has ", "takes ", "cannot ", "names "];
        f.write_str(&self.what)?;
        match (self.count, self.example.as_str()) {
            (0 | 1, "") => {}
            // A remark says itself how many.
            (_, "") if self.reason.is_empty() => {}
            (n, "") => write!(f, ", {n} of them")?,
            (_, example) if self.kind == LossKind::Images && self.what == "image" => {
                write!(f, " {example}")?;
            }
            (_, example) if example.starts_with('\'') => write!(f, " {example}")?,
            (_, example) => write!(f, " of {example}")?,
        }
        match self.reason.as_str() {
            "" => {}
            reason if VERBS.iter().any(|verb| reason.starts_with(verb)) => write!(f, " {reason}")?,
            reason => write!(f, ": {reason}")?,
        }
        if self.count > 1 && !self.example.is_empty() {
            write!(f, ", and {} more", self.count - 1)?;
        }
        if !self.remedy.is_empty() {
            write!(f, "; {}", self.remedy)?;
        }
        Ok(())
    }
}

/// The text without control characters, cut where it is very long.
fn shown(text: &str) -> String {
    let plain = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let mut out: String = text.chars().take(MAX_CHARACTERS).map(plain).collect();
    if text.chars().nth(MAX_CHARACTERS).is_some() {
        out.push_str("...");
    }
    out
}

/// All losses of a run, in the order in which they were found; those of the same things for the same reason are one entry.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Ledger {
    entries: Vec<Loss>,
}

impl Ledger {
    /// Adds a loss; counts of the same things for the same reason add up.
    pub fn lose(&mut self, loss: Loss) {
        self.enter(loss, |known, new| known + new);
    }

    /// Makes losses of a kind that the output was not wanted for notices.
    pub fn excuse(&mut self, kind: LossKind) {
        let of_kind = self.entries.iter_mut().filter(|loss| loss.kind == kind);
        of_kind.for_each(|loss| loss.severity = Severity::Notice);
    }

    /// Puts another name in the place of a folder's.
    pub fn rename(&mut self, from: &str, to: &str) {
        self.entries.iter_mut().for_each(|loss| loss.rename(from, to));
    }

    /// True if a loss of the same things for the same reason is known.
    pub fn knows(&self, loss: &Loss) -> bool {
        self.entries.iter().any(|known| known.is_like(loss))
    }

    /// Takes in what another look at the same input has found: what is known already does not count again.
    pub fn merge(&mut self, other: &Ledger) {
        other.entries.iter().for_each(|loss| self.enter(loss.clone(), u64::max));
    }

    fn enter(&mut self, loss: Loss, sum: impl Fn(u64, u64) -> u64) {
        if let Some(known) = self.entries.iter_mut().find(|known| known.is_like(&loss)) {
            known.count = sum(known.count, loss.count);
            known.severity = known.severity.max(loss.severity);
            return;
        }
        if self.entries.len() < MAX_ENTRIES {
            return self.entries.push(loss);
        }
        let rest = Loss::new(loss.kind, "more of other kinds", "not listed one by one");
        let mut rest = Loss { severity: loss.severity, ..rest };
        if let Some(last) = self.entries.pop_if(|last| last.what == rest.what) {
            rest.count += last.count;
            rest.severity = rest.severity.max(last.severity);
        }
        self.entries.push(rest);
    }

    /// All entries.
    pub fn entries(&self) -> &[Loss] {
        &self.entries
    }

    /// True if nothing is lost.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// True if all of a kind that the input had is lost.
    pub fn has_whole(&self) -> bool {
        self.entries.iter().any(|loss| loss.severity == Severity::Whole)
    }

    /// The entries as lines for people.
    pub fn lines(&self) -> Vec<String> {
        self.entries.iter().map(Loss::to_string).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn like_losses_are_one_entry_and_another_look_does_not_count_again() {
        let image = |name: &str| Loss::new(LossKind::Images, "image", "is not there").example(name);
        let mut ledger = Ledger::default();
        ledger.lose(image("a.png"));
        ledger.lose(image("b.png").whole());
        ledger
            .lose(Loss::new(LossKind::Normals, "normals of corners (vn)", "not carried").notice());
        assert_eq!(ledger.entries().len(), 2);
        assert_eq!((ledger.entries()[0].count, ledger.has_whole()), (2, true));
        assert_eq!(ledger.lines()[0], "image a.png is not there, and 1 more");
        let before = ledger.clone();
        ledger.merge(&before);
        assert_eq!(ledger, before);
    }

    #[test]
    fn entries_are_bounded_and_plain() {
        let mut ledger = Ledger::default();
        for i in 0..200_000 {
            let reason = format!("odd {i}");
            ledger.lose(Loss::new(LossKind::Attributes, "a\u{1b}[31m\nb", reason));
        }
        assert_eq!(ledger.entries().len(), MAX_ENTRIES + 1);
        assert_eq!(ledger.entries()[MAX_ENTRIES].count, 200_000 - MAX_ENTRIES as u64);
        assert_eq!(ledger.entries()[0].what, "a\u{fffd}[31m\u{fffd}b");
        let long = Loss::new(LossKind::Names, "x".repeat(100_000), "");
        assert_eq!(long.what.len(), MAX_CHARACTERS + 3);
    }
}
