//! Manual pages and completions: one page for each command, with all of its options; scripts that shells accept.

use crate::common::{expect, stonecut};
use std::io::Write;
use std::process::Command;

/// Names of the commands, from the list in the help text.
fn commands() -> Vec<String> {
    let help = stonecut().arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let list = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<String> =
        names.filter_map(|line| line.split_whitespace().next().map(str::to_owned)).collect();
    names.into_iter().filter(|name| name != "help").collect()
}

/// Long options of a command, from its help text.
fn options(command: &str) -> Vec<String> {
    let help = stonecut().args([command, "--help"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let is_name = |c: char| c.is_ascii_lowercase() || c == '-';
    let at_start = |line: &str| line.trim_start().starts_with('-');
    let of_line = |line: &str| {
        let rest = line.split("--").nth(1)?;
        Some(rest.split(|c| !is_name(c)).next().unwrap_or_default().to_owned())
    };
    help.lines().filter(|line| at_start(line)).filter_map(of_line).collect()
}

#[test]
fn every_command_has_a_page_with_all_of_its_options() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "man pages", 0);
    let page = |name: &str| {
        let path = folder.path().join("pages").join(format!("{name}.1"));
        std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    let commands = commands();
    assert!(commands.len() >= 11, "{commands:?}");
    assert!(page("stonecut").contains(".TH stonecut 1"));
    let mut n_options = 0;
    for command in &commands {
        let text = page(&format!("stonecut-{command}")).replace("\\-", "-");
        let about = text.split(&format!("\nstonecut-{command} - ")).nth(1);
        assert!(
            about.is_some_and(|about| !about.starts_with('\n')),
            "{command} does not say what it does"
        );
        // A name and its help, each on a line.
        let lines: Vec<&str> = text.lines().collect();
        for row in lines.windows(3).filter(|row| row[0] == ".TP") {
            assert!(
                row[2].len() > 8 && !row[2].starts_with('.'),
                "{command}: {} has no help",
                row[1]
            );
        }
        for option in options(command) {
            assert!(text.contains(&format!("--{option}")), "stonecut-{command}.1: --{option}");
            n_options += 1;
        }
    }
    assert!(n_options > 60, "{n_options} options");
    // A second time: pages are replaced.
    expect(folder.path(), "man pages", 0);
}

/// Completes `simpl`, an option and its values in bash; the file is `$0`.
const BASH: &str = r#"
    source "$0"
    try() {
        COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
        _stonecut stonecut "${@: -1}" "${@: -2:1}"
        printf '%s\n' "${COMPREPLY[@]}"
    }
    try stonecut simpl
    try stonecut simplify --topol
    try stonecut simplify --topology ''
"#;

/// The same in fish.
const FISH: &str = "
    source $argv[1]
    complete -C 'stonecut simpl'
    complete -C 'stonecut simplify --topol'
    complete -C 'stonecut simplify --topology '
";

/// zsh completes only at a terminal: there the function must load and be the one for `stonecut`.
const ZSH: &str = "
    autoload -Uz compinit && compinit -D -u && source $0 && print $+functions[_stonecut] $_comps[stonecut]
";

/// Shells that are tried: arguments with which one loads completions from a file named last, and a part of its answer.
const TRIED: [(&str, [&str; 3], &[&str]); 3] = [
    ("bash", ["--norc", "-c", BASH], &["simplify", "--topology", "keep", "error"]),
    ("fish", ["--no-config", "-c", FISH], &["simplify", "--topology", "keep", "error"]),
    ("zsh", ["-f", "-c", ZSH], &["1 _stonecut"]),
];

#[test]
fn shells_accept_the_completions() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let made = stonecut().args(["completions", shell]).output().unwrap();
        assert_eq!(made.status.code(), Some(0), "{shell}");
        let text = String::from_utf8(made.stdout).unwrap();
        for name in commands() {
            assert!(text.contains(&name), "{shell} does not complete {name}");
        }
        assert!(text.contains("cell-triangles"), "{shell}");
        let path = folder.path().join(format!("{shell}.completions"));
        std::fs::write(&path, text).unwrap();
        let Some((_, load, wanted)) = TRIED.iter().find(|(name, ..)| *name == shell) else {
            continue;
        };
        let run = |arguments: &[&str]| {
            let mut command = Command::new(shell);
            command.args(arguments).arg(&path).env("HOME", folder.path()).output()
        };
        let Ok(parsed) = run(&["-n"]) else {
            // Not by `println`, whose words a test that passes does not show.
            let words = format!("left out: completions of {shell} ({shell} is not installed)\n");
            std::io::stderr().write_all(words.as_bytes()).unwrap();
            continue;
        };
        assert!(parsed.status.success(), "{shell}: {parsed:?}");
        let done = run(load).unwrap();
        let found = String::from_utf8(done.stdout.clone()).unwrap();
        for wanted in *wanted {
            assert!(found.contains(wanted), "{shell} does not offer {wanted}: {done:?}");
        }
    }
    let unknown = stonecut().args(["completions", "tcsh"]).output().unwrap();
    assert_eq!(unknown.status.code(), Some(2));
}
