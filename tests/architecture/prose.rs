//! Holds the mechanical rules for prose: doc comments of src/, the README and the pages of docs/.
//!
//! docs/results/ and CHANGELOG.md are not looked at. Only a reader can tell whether a text is good.

use std::path::{Path, PathBuf};

/// Words that no doc comment begins with: the subject or the verb comes first.
const FIRST_WORDS: [&str; 10] =
    ["What", "Which", "Whether", "How", "Where", "By", "Why", "Who", "That", "So"];

/// Phrases that do not occur, with what is written instead.
const PHRASES: [(&str, &str); 12] = [
    ("anew", "again"),
    ("concerned", "affected"),
    ("gives way", "the cause"),
    ("has a say", "counts"),
    ("have a say", "count"),
    ("have no say", "are ignored"),
    ("nobody", "the passive voice"),
    ("of its own", "its own X"),
    ("of their own", "their own X"),
    ("so many", "a number, or 'this many'"),
    ("so much", "a number"),
    ("to be had", "known, at hand"),
];

/// Words after "is no" and "are no" that make a comparison of it.
const COMPARISONS: [&str; 8] =
    ["longer", "more", "farther", "further", "larger", "less", "nearer", "better"];

/// Most words of a sentence of a doc comment; lists after a colon are not sentences.
const MOST_WORDS: usize = 60;

/// A paragraph of a doc comment, with the number of its first line.
struct Paragraph {
    line: usize,
    text: String,
    /// True for the first one of an item.
    is_first: bool,
}

/// Returns the paragraphs of the doc comments of a file; code, tables and drawings are left out.
fn paragraphs(source: &str) -> Vec<Paragraph> {
    let mut out: Vec<Paragraph> = Vec::new();
    let (mut was_doc, mut is_open, mut is_code) = (false, false, false);
    for (i, line) in source.lines().enumerate() {
        let line = line.trim_start();
        let doc = line.strip_prefix("///").or_else(|| line.strip_prefix("//!"));
        let Some(text) = doc.filter(|text| !text.starts_with('/')) else {
            (was_doc, is_open, is_code) = (false, false, false);
            continue;
        };
        let text = text.strip_prefix(' ').unwrap_or(text);
        is_code ^= text.starts_with("```");
        let is_prose = !is_code && !text.starts_with(['|', ' ', '`', '#']) && !text.is_empty();
        let is_item = text.starts_with("- ") || text.starts_with("* ");
        match out.last_mut().filter(|_| is_open && is_prose && !is_item) {
            Some(open) => {
                open.text.push(' ');
                open.text.push_str(text);
            }
            None if is_prose => {
                out.push(Paragraph { line: i + 1, text: text.to_owned(), is_first: !was_doc });
            }
            None => {}
        }
        (was_doc, is_open) = (true, is_prose);
    }
    out
}

/// Splits at full stops before a capital letter.
fn sentences(text: &str) -> Vec<&str> {
    let ends = text.match_indices(". ").map(|(at, _)| at + 1);
    let is_end = |at: &usize| text[*at..].trim_start().starts_with(|c: char| c.is_uppercase());
    let mut out = Vec::new();
    let mut from = 0;
    for at in ends.filter(is_end) {
        out.push(&text[from..at]);
        from = at;
    }
    out.push(&text[from..]);
    out
}

/// Finds a phrase as whole words, whatever the case.
fn has_phrase(text: &str, phrase: &str) -> bool {
    let text = text.to_lowercase();
    let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    text.match_indices(phrase).any(|(at, _)| {
        !is_word(text[..at].chars().next_back())
            && !is_word(text[at + phrase.len()..].chars().next())
    })
}

/// Finds "is no X" where "is not a X" is meant; "there is no X" and comparisons are English.
fn says_is_no(text: &str) -> bool {
    let words: Vec<String> =
        text.split_whitespace().map(|word| word.to_lowercase().replace(['"', '('], "")).collect();
    words.windows(3).enumerate().any(|(i, three)| {
        let is_it = (three[0] == "is" || three[0] == "are") && three[1] == "no";
        let next = three[2].trim_end_matches(|c: char| !c.is_alphanumeric());
        is_it && (i == 0 || words[i - 1] != "there") && !COMPARISONS.contains(&next)
    })
}

/// The phrases of a text that do not occur in this project, with the remedy.
fn riddles(text: &str) -> Vec<String> {
    let known = PHRASES.iter().filter(|(phrase, _)| has_phrase(text, phrase));
    let mut out: Vec<String> =
        known.map(|(phrase, instead)| format!("'{phrase}': write {instead}")).collect();
    if says_is_no(text) {
        out.push("'is no': write 'is not a'".to_owned());
    }
    out
}

/// Everything that breaks a rule in a file of src/, as FILE:LINE and the rule.
pub fn faults_of_source(name: &str, source: &str) -> Vec<String> {
    let mut out = Vec::new();
    for paragraph in paragraphs(source) {
        let place = format!("src/{name}:{}", paragraph.line);
        let first = paragraph.text.split([' ', ',', ':']).next().unwrap_or_default();
        if paragraph.is_first && FIRST_WORDS.contains(&first) {
            out.push(format!("{place}: begins with '{first}'"));
        }
        for sentence in sentences(&paragraph.text) {
            let is_list = sentence.contains(':');
            if !is_list && sentence.matches(';').count() > 1 {
                out.push(format!("{place}: more than one semicolon in a sentence"));
            }
            if !is_list && sentence.split_whitespace().count() > MOST_WORDS {
                out.push(format!("{place}: a sentence of more than {MOST_WORDS} words"));
            }
        }
    }
    for (i, line) in source.lines().enumerate() {
        out.extend(riddles(line).into_iter().map(|fault| format!("src/{name}:{}: {fault}", i + 1)));
    }
    out
}

/// The pages that the rules hold for.
pub fn pages(root: &Path) -> Vec<PathBuf> {
    let mut out = vec![root.join("README.md")];
    for folder in ["docs", "docs/design"] {
        let entries = std::fs::read_dir(root.join(folder)).expect("the folder");
        let paths = entries.flatten().map(|entry| entry.path());
        out.extend(paths.filter(|path| path.extension().is_some_and(|ext| ext == "md")));
    }
    out.sort();
    out
}

/// Everything that breaks a rule in a page.
pub fn faults_of_page(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).expect("a page");
    let lines = text.lines().enumerate();
    lines
        .flat_map(|(i, line)| {
            riddles(line).into_iter().map(move |f| format!("{}:{}: {f}", path.display(), i + 1))
        })
        .collect()
}

#[test]
fn each_rule_finds_what_breaks_it() {
    for (source, n) in [
        ("/// What it is.\nfn f() {}", 1),
        ("/// A thing.\n///\n/// Where it is, does not matter.", 0),
        ("/// A cell; with two; semicolons.", 1),
        ("/// A list: one; two; three.", 0),
        ("// It is no cell.", 1),
        ("// There is no cell, and it is no longer one.", 0),
        ("/// A folder of its own.", 1),
        ("fn unconcerned() {}", 0),
        ("/// Nobody.", 1),
    ] {
        assert_eq!(faults_of_source("a.rs", source).len(), n, "{source}");
    }
    let long = format!("/// A{}.", " word".repeat(MOST_WORDS));
    assert_eq!(faults_of_source("a.rs", &long).len(), 1);
}
