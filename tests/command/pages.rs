//! Manual pages and completions: one page for each command, with all of its options; scripts that shells accept.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use crate::common::{expect, stonecut};
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
        for option in options(command) {
            assert!(text.contains(&format!("--{option}")), "stonecut-{command}.1: --{option}");
            n_options += 1;
        }
    }
    assert!(n_options > 60, "{n_options} options");
    // A second time: pages are replaced.
    expect(folder.path(), "man pages", 0);
}

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
        let path = folder.path().join(shell);
        std::fs::write(&path, text).unwrap();
        // Shells that are not installed are left out.
        let parse = match shell {
            "bash" | "zsh" | "fish" => Command::new(shell).arg("-n").arg(&path).status(),
            _ => continue,
        };
        match parse {
            Ok(status) => assert!(status.success(), "{shell}"),
            Err(_) => println!("left out: {shell} is not installed"),
        }
    }
    let unknown = stonecut().args(["completions", "tcsh"]).output().unwrap();
    assert_eq!(unknown.status.code(), Some(2));
}
