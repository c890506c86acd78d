//! The report page, opened in a real browser where there is one.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::path::Path;
use std::process::Command;

fn stonecut(arguments: &[&str]) {
    assert_cmd::Command::cargo_bin("stonecut").unwrap().args(arguments).assert().success();
}

/// Makes a mesh, its simplification, both reports and the page; returns the page's path.
fn page(folder: &Path) -> String {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (input, output) = (path("in.ply"), path("out.ply"));
    let (run, measured, page) = (path("run.json"), path("measured.json"), path("page.html"));
    stonecut(&["synth", "statue", &input, "--triangles", "20k"]);
    stonecut(&["simplify", &input, &output, "--ratio", "10%", "--report", &run, "-q"]);
    stonecut(&["measure", &input, &output, "--samples", "20k", "--report", &measured, "-q"]);
    stonecut(&["report", &run, "--measured", &measured, "-o", &page, "-q"]);
    page
}

#[test]
fn the_page_is_whole_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(page(folder.path())).unwrap();
    for part in ["Measured error", "Seconds by stage", "data:image/png;base64,", "id=\"viewer\""] {
        assert!(text.contains(part), "no {part}");
    }
    // Nothing is fetched: no script, style, picture or frame from elsewhere.
    for call in ["src=\"http", "href=\"http", "<link rel=\"stylesheet", "@import"] {
        assert!(!text.contains(call), "the page loads {call}");
    }
    let left = std::fs::read_dir(folder.path()).unwrap().flatten();
    let glb = left.filter(|e| e.path().extension().is_some_and(|ext| ext == "glb")).count();
    assert_eq!(glb, 0, "the temporary GLB stays behind");
}

#[test]
fn the_page_opens_in_a_browser_without_complaint() {
    let browsers = ["chromium", "chromium-browser", "google-chrome"];
    let found = browsers.iter().find(|b| Command::new(b).arg("--version").output().is_ok());
    let Some(browser) = found else {
        eprintln!("skipped: no Chromium on this machine");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let page = page(folder.path());
    let profile = format!("--user-data-dir={}", folder.path().join("profile").display());
    let out = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", &profile])
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"])
        .args(["--window-size=1200,900", "--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("file://{page}"))
        .output()
        .unwrap();
    let (dom, log) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    let console: Vec<&str> = log.lines().filter(|line| line.contains(":CONSOLE")).collect();
    assert!(console.is_empty(), "the console says: {console:#?}");
    assert!(dom.contains("data-viewer=\"ready\""), "the viewer did not start: {log}");
    let drawn = dom.split("data-drawn=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    assert!(drawn.parse::<f64>().unwrap() > 3.0, "the canvas is blank: {drawn} % drawn");
}
