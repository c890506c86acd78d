//! Names of types and parameters, counted: a name means one thing, and parameters have names.

use super::{room, sources, without_tests};
use std::collections::{BTreeMap, BTreeSet};

/// Names of types that may still stand in several rooms (99 do). May only fall; the aim is ten, each with a reason.
const SHARED_NAMES: usize = 99;

/// Parameters that may still be tuples of more than two (one is). May only fall.
const LONG_TUPLES: usize = 2;

/// Names of the types that a file defines.
fn types(text: &str) -> Vec<&str> {
    let name = |line: &'_ str| -> Option<usize> {
        let rest = line.trim_start();
        let rest = rest.strip_prefix("pub").map_or(rest, |rest| match rest.strip_prefix('(') {
            Some(scoped) => scoped.split_once(')').map_or(rest, |(_, rest)| rest),
            None => rest,
        });
        let rest = rest.trim_start();
        let kinds = ["struct ", "enum ", "trait ", "union "];
        let rest = kinds.iter().find_map(|kind| rest.strip_prefix(kind))?;
        Some(line.len() - rest.len())
    };
    let word =
        |rest: &'_ str| rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
    let found = text.lines().filter_map(|line| name(line).map(|at| &line[at..]));
    found.map(|rest| &rest[..word(rest)]).collect()
}

/// Lengths of the tuples that functions of a file take as parameters.
fn tuples(text: &str) -> Vec<usize> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices("fn ") {
        let Some(open) = text[at..].find('(').map(|open| at + open) else { continue };
        let parameters = inside(&text[open..]);
        for mark in [": (", ": &(", ": &mut ("] {
            for (at, _) in parameters.match_indices(mark) {
                found.push(parts(inside(&parameters[at + mark.len() - 1..])));
            }
        }
    }
    found
}

/// The text between a bracket and its partner.
fn inside(text: &str) -> &str {
    let mut depth = 0;
    for (at, c) in text.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return &text[1..at.max(1)];
        }
    }
    ""
}

/// Parts between commas, outside of brackets.
fn parts(text: &str) -> usize {
    let (mut depth, mut n, mut before) = (0, 0, ' ');
    for c in text.trim_end().trim_end_matches(',').chars() {
        match c {
            '(' | '[' | '{' | '<' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            '>' if before != '-' => depth -= 1,
            ',' if depth == 0 => n += 1,
            _ => {}
        }
        before = c;
    }
    n + 1
}

#[test]
fn names_of_types_stand_in_one_room() {
    let mut rooms: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, text) in sources().iter().filter(|(file, _)| !file.ends_with("tests.rs")) {
        for name in types(without_tests(text)) {
            let room = room(file).unwrap_or_default().to_owned();
            rooms.entry(name.to_owned()).or_default().insert(room);
        }
    }
    let shared: Vec<_> = rooms.iter().filter(|(_, rooms)| rooms.len() > 1).collect();
    assert!(shared.len() <= SHARED_NAMES, "{} names: {shared:?}", shared.len());
}

#[test]
fn parameters_are_no_long_tuples() {
    let long = |text: &str| tuples(without_tests(text)).into_iter().filter(|&n| n > 2).count();
    let sources = sources();
    let files: Vec<_> = sources.iter().filter(|(_, text)| long(text) > 0).map(|f| &f.0).collect();
    assert!(files.len() <= LONG_TUPLES, "{files:?}");
}

#[test]
fn types_and_tuples_are_found() {
    assert_eq!(
        types("pub(super) struct A<T> {\nenum B;\n    pub trait C: D {\nlet x = 1;"),
        ["A", "B", "C"]
    );
    assert_eq!(
        tuples("fn f(a: (u8, Vec<(u8, u8)>, [u8; 3]), b: &(u8, u8)) -> (u8, u8, u8) {"),
        [3, 2]
    );
}
