//! Text on its way to a terminal: what names out of files could do to it is undone here, and nowhere else.
//!
//! A name may hold escape sequences that repaint a screen, newlines that pass for other lines, marks that turn the
//! order of reading, or a hundred thousand letters. Every line that a person reads passes through `shown`. JSON does not:
//! it has its own escapes.

use std::borrow::Cow;
use std::io::Write;

/// A word longer than this loses its middle. No path is longer than 4096 bytes, few are longer than this.
const MOST_WORD: usize = 1024;

/// A line longer than this loses its middle; what to do stands at its end.
const MOST_LINE: usize = 6000;

/// Letters of a long line that stay at its beginning and at its end.
const LINE_ENDS: [usize; 2] = [4000, 1000];

/// Letters of a long word likewise.
const WORD_ENDS: [usize; 2] = [100, 100];

/// One line as a terminal may have it: control characters escaped, endless words and lines without their middle.
pub fn shown(line: &str) -> Cow<'_, str> {
    if line.len() <= MOST_WORD && !line.chars().any(is_unsafe) {
        return Cow::Borrowed(line);
    }
    let mut out = String::with_capacity(line.len().min(MOST_LINE));
    for (i, word) in line.split(' ').enumerate() {
        if i > 0 {
            out.push(' ');
        }
        put(&shortened(word, MOST_WORD, WORD_ENDS), &mut out);
    }
    match shortened(&out, MOST_LINE, LINE_ENDS) {
        Cow::Borrowed(_) => Cow::Owned(out),
        Cow::Owned(short) => Cow::Owned(short),
    }
}

/// Appends text with its unsafe characters escaped.
fn put(text: &str, out: &mut String) {
    for c in text.chars() {
        if is_unsafe(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
}

/// Control characters, separators of lines, and marks that turn the order of reading.
fn is_unsafe(c: char) -> bool {
    let turns =
        matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns || matches!(c, '\u{2028}' | '\u{2029}')
}

/// The text without its middle if it has more than `most` characters.
fn shortened(text: &str, most: usize, [begin, end]: [usize; 2]) -> Cow<'_, str> {
    // Bytes are at least as many as characters.
    let n = if text.len() <= most { 0 } else { text.chars().count() };
    if n <= most {
        return Cow::Borrowed(text);
    }
    let head: String = text.chars().take(begin).collect();
    let tail: String = text.chars().skip(n - end).collect();
    Cow::Owned(format!("{head}...({} characters)...{tail}", n - begin - end))
}

/// Rows of a table, a name and a value each.
pub fn table<'a>(rows: impl IntoIterator<Item = (&'a str, String)>) -> String {
    let row = |(name, value): (&str, String)| format!("{name:<22}{}\n", shown(&value));
    rows.into_iter().map(row).collect()
}

/// Writes what a formatting macro has put together: a line that ends or not, or an object of JSON as it is.
pub fn write_shown(out: &mut dyn Write, arguments: std::fmt::Arguments) -> std::io::Result<()> {
    let text = arguments.to_string();
    let (line, end) = match text.strip_suffix('\n') {
        Some(line) => (line, "\n"),
        None => (text.as_str(), ""),
    };
    let is_json =
        line.starts_with('{') && serde_json::from_str::<serde::de::IgnoredAny>(line).is_ok();
    let line = if is_json { Cow::Borrowed(line) } else { shown(line) };
    // In one piece, so that lines of several threads do not mix.
    out.write_all(format!("{line}{end}").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_a_cursor_is_escaped_and_all_else_stays() {
        for (text, wanted) in [
            ("scan é 3 %.ply: 12 triangles", "scan é 3 %.ply: 12 triangles"),
            ("a\u{1b}[2Jb", "a\\u{1b}[2Jb"),
            ("a\nb\r\tc\u{7f}", "a\\nb\\r\\tc\\u{7f}"),
            ("\u{9b}31m", "\\u{9b}31m"),
            ("x\u{202e}gnp.exe", "x\\u{202e}gnp.exe"),
        ] {
            assert_eq!(shown(text), wanted);
        }
    }

    #[test]
    fn long_words_and_lines_lose_their_middle() {
        let long = format!("it requires {}, which is not read", "é".repeat(100_000));
        let short = shown(&long);
        assert!(short.len() < 1000 && short.starts_with("it requires éé"), "{short}");
        assert!(
            short.ends_with("éé, which is not read") && short.contains("characters)..."),
            "{short}"
        );
        let words = "word ".repeat(50_000) + "the remedy";
        let short = shown(&words);
        assert!(short.len() < 2 * MOST_LINE && short.ends_with("the remedy"), "{}", short.len());
        let path = format!("/{}", "d/".repeat(500));
        assert_eq!(shown(&path), path);
        // Longer only once it is escaped.
        assert!(shown(&"\u{1b}".repeat(1000)).len() < 8000);
    }

    #[test]
    fn objects_of_json_are_not_touched() {
        let json = format!("{{\"note\":\"{}\"}}", "x".repeat(20_000));
        let mut out = Vec::new();
        write_shown(&mut out, format_args!("{json}\n")).unwrap();
        assert_eq!(out, (json + "\n").as_bytes());
        let mut out = Vec::new();
        write_shown(&mut out, format_args!("{{\u{1b}[2J\n\n")).unwrap();
        assert_eq!(out, b"{\\u{1b}[2J\\n\n");
    }
}
