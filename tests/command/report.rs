//! The report page, opened in a real browser where there is one.

use crate::common::json;
use std::path::Path;
use std::process::Command;

fn stonecut(arguments: &[&str]) {
    assert_cmd::Command::cargo_bin("stonecut").unwrap().args(arguments).assert().success();
}

/// How the error comes into the report.
enum Measured {
    ByTheRun,
    Apart,
}

/// Makes a mesh, its simplification, reports and the page; returns the page's path.
fn page(folder: &Path, how: Measured) -> String {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (input, output) = (path("in.ply"), path("out.ply"));
    let (run, measured, page) = (path("run.json"), path("measured.json"), path("page.html"));
    stonecut(&["synth", "statue", &input, "--triangles", "40k"]);
    let simplify = ["simplify", &input, &output, "--ratio", "10%", "--cell-triangles", "8k", "-q"];
    let simplify = [&simplify[..], &["--report", &run]].concat();
    match how {
        Measured::ByTheRun => {
            stonecut(&[&simplify[..], &["--verify"]].concat());
            stonecut(&["report", &run, "-o", &page, "-q"]);
        }
        Measured::Apart => {
            stonecut(&simplify);
            stonecut(&[
                "measure",
                &input,
                &output,
                "--samples",
                "20k",
                "--report",
                &measured,
                "-q",
            ]);
            stonecut(&["report", &run, "--measured", &measured, "-o", &page, "-q"]);
        }
    }
    page
}

#[test]
fn the_page_is_whole_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(page(folder.path(), Measured::ByTheRun)).unwrap();
    for part in [
        "Asked and done",
        "faults in the input",
        "topology, original",
        "Measured error",
        "Original to simplified, distance in input units</title>",
        "Simplified to original, distance in input units</title>",
        "Seconds by stage",
        "aria-label=\"Peak memory up to the end of each stage\"",
        "<span>verify</span>",
        "Refused collapses",
        "<h3>Seams</h3>",
        "The whole",
        "With edges",
        "Close up, at the worst place",
        "Close up, at a seam of the first round",
        "id=\"viewer\"",
    ] {
        assert!(text.contains(part), "no {part}");
    }
    // The picture and the line that matters come first.
    let at = |part: &str| text.find(part).unwrap_or_else(|| panic!("no {part}"));
    assert!(at("The whole") < at("class=\"line\"") && at("class=\"line\"") < at("Asked and done"));
    let run = json(folder.path(), "run.json");
    let count = format!("triangles became <b>{}</b>", run["output"]["triangles"]);
    assert!(text.replace('\u{2009}', "").contains(&count), "{count}");
    // Four views of both meshes.
    assert_eq!(text.matches("data:image/png;base64,").count(), 8);
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
        crate::common::skipped("no Chromium on this machine");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let page = page(folder.path(), Measured::Apart);
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
