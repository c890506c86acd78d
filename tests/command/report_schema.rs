//! The JSON of the commands against its contract: docs/report.schema.json, and docs/report.md, which says the same for people.
//!
//! The checker knows the keywords that the schema uses and fails on any other. It is stricter than a validator: a key
//! that the schema does not list is an error, so that no key goes undescribed. The crate `jsonschema` would do the same with 65
//! packages.

use crate::common::{expect, printed, run};
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::path::Path;

const NO_KEYWORDS: [&str; 4] = ["description", "title", "deprecated", "x-unit"];

struct Schema {
    root: Value,
}

impl Schema {
    fn read() -> Schema {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/report.schema.json");
        let text = std::fs::read_to_string(path).expect("the schema");
        Schema { root: serde_json::from_str(&text).expect("JSON") }
    }

    fn definitions(&self) -> &Map<String, Value> {
        self.root["$defs"].as_object().expect("definitions")
    }

    /// Lists what is wrong with `value` under the definition `name`.
    fn complaints(&self, name: &str, value: &Value) -> Vec<String> {
        let mut out = Vec::new();
        let rules = self.definitions().get(name).unwrap_or_else(|| panic!("no definition {name}"));
        self.check(rules, value, name, &mut out);
        out
    }

    fn check(&self, rules: &Value, value: &Value, at: &str, out: &mut Vec<String>) {
        let rules = rules.as_object().expect("rules");
        for (keyword, rule) in rules {
            let is_kept = match keyword.as_str() {
                known if NO_KEYWORDS.contains(&known) => true,
                "$ref" => {
                    let target = rule.as_str().and_then(|r| r.strip_prefix("#/$defs/"));
                    let target = target.and_then(|name| self.definitions().get(name));
                    self.check(target.expect("a definition"), value, at, out);
                    true
                }
                "type" => match rule {
                    Value::Array(types) => types.iter().any(|kind| is_of_type(kind, value)),
                    kind => is_of_type(kind, value),
                },
                "const" => value == rule,
                "enum" => rule.as_array().expect("a list").contains(value),
                "minimum" => value.as_f64().is_none_or(|x| x >= rule.as_f64().expect("a number")),
                "maximum" => value.as_f64().is_none_or(|x| x <= rule.as_f64().expect("a number")),
                "minItems" => n_items(value).is_none_or(|n| n >= rule.as_u64().expect("a number")),
                "maxItems" => n_items(value).is_none_or(|n| n <= rule.as_u64().expect("a number")),
                "pattern" => begins_as(rule.as_str().expect("a pattern"), value),
                "items" => {
                    for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                        self.check(rule, item, &format!("{at}[{i}]"), out);
                    }
                    true
                }
                "properties" => {
                    for (key, item) in value.as_object().into_iter().flatten() {
                        match rule.get(key) {
                            Some(rules) => self.check(rules, item, &format!("{at}.{key}"), out),
                            None => out.push(format!("{at}.{key} is not in the schema")),
                        }
                    }
                    true
                }
                "required" => {
                    for key in rule.as_array().expect("a list") {
                        if value.get(key.as_str().expect("a key")).is_none() {
                            out.push(format!("{at} has no {key}"));
                        }
                    }
                    true
                }
                other => panic!("the checker does not know the keyword {other}"),
            };
            if !is_kept {
                out.push(format!("{at} is {value}, against {keyword} {rule}"));
            }
        }
    }
}

fn is_of_type(kind: &Value, value: &Value) -> bool {
    match kind.as_str().expect("a type") {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        other => panic!("no type {other}"),
    }
}

fn n_items(value: &Value) -> Option<u64> {
    value.as_array().map(|list| list.len() as u64)
}

/// The only form of pattern in use: `^(a|b)=`.
fn begins_as(pattern: &str, value: &Value) -> bool {
    let inside = pattern.strip_prefix("^(").and_then(|rest| rest.strip_suffix(")="));
    let mut words = inside.expect("a pattern of the known form").split('|');
    let Some(text) = value.as_str() else { return true };
    words.any(|word| text.strip_prefix(word).is_some_and(|rest| rest.starts_with('=')))
}

fn read(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

fn assert_keeps(name: &str, value: &Value) {
    let complaints = Schema::read().complaints(name, value);
    assert!(complaints.is_empty(), "{name}: {complaints:#?}\n{value:#}");
}

fn folder_with(kind: &str, more: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    expect(folder.path(), &format!("synth {kind} in.ply {more} -q"), 0);
    folder
}

#[test]
fn reports_of_simplify_keep_the_schema() {
    let folder = folder_with("scans", "--triangles 12k --color");
    let out = folder.path();
    for (options, code) in [
        ("--ratio 10%", 0),
        ("--ratio 10% --cell-triangles 1k --min-component 20 --verify --fit on --keep-temp", 0),
        ("--triangles 6k --cell-triangles 1k --topology keep --placement subset", 0),
        ("--triangles 3k,1k --cell-triangles 1k", 0),
        ("--max-error 0.05 --cell-triangles 1k --error-field", 0),
        ("--max-error 0.05 --ratio 30%", 3),
        ("--max-error 1e-30", 0),
        ("--ratio 10% --optimize 1", 0),
        ("--ratio 10% --pairs", 0),
        ("--ratio 10% --progressive out.pm", 0),
        ("--ratio 5% --for print", 3),
    ] {
        let command =
            format!("simplify in.ply out.ply {options} --force --restart --report r.json");
        expect(out, &command, code);
        let report = read(&out.join("r.json"));
        assert_keeps("simplify_report", &report);
        assert_eq!(report["schema_version"], 1);
        let is_bounded = report["stop_reason"] == "within the bound";
        assert_eq!(is_bounded, options.contains("--max-error"), "{options}");
        // Scripts that were written before still find what they look for.
        let old_and_new = [
            (&report["rejects"], "link_condition", "link condition"),
            (&report["changes"], "handles_cut", "tubes cut"),
            (&report["settings"], "cell_triangles", "cell-triangles"),
            (&report["seams"], "sample_position", "place"),
        ];
        for (object, new, old) in old_and_new {
            assert_eq!(object[new], object[old], "{options}: {new}");
        }
        assert!(report["rejects"]["link_condition"].is_u64() || options.contains("max-error"));
        let names = |key: &str| -> BTreeSet<&str> {
            let stages = report["stages"].as_array().expect("stages");
            stages.iter().filter_map(|stage| stage[key].as_str()).collect()
        };
        if options.contains("--triangles 6k") {
            assert!(names("name").is_superset(&BTreeSet::from(["round", "repartition"])));
            assert!(names("part").contains("stitch") && !names("part").contains("round"));
        }
    }
    for (method, options) in [
        ("cluster", "--ratio 10% --verify"),
        ("cluster", "--grid 0.1"),
        ("decimate", "--ratio 30% --feature-angle 40"),
        ("retile", "--ratio 10% --gradation 1"),
        ("retile", "--ratio 10% --optimize 1"),
    ] {
        let command = format!(
            "simplify in.ply out.ply --method {method} {options} --force --restart --report r.json"
        );
        expect(out, &command, 0);
        let report = read(&out.join("r.json"));
        assert_keeps("simplify_report", &report);
        assert_eq!(report["method"], method);
        assert_eq!(report["settings"]["method"], method);
    }
    let job = out.join("out.ply.stonecut-job");
    assert!(!job.exists() || std::fs::remove_dir_all(&job).is_ok());
}

#[test]
fn what_textures_and_faces_add_keeps_the_schema() {
    let folder = folder_with("rooms", "--triangles 20k");
    let out = folder.path();
    let command = "simplify in.ply out.ply --ratio 30% --texture keep --cell-triangles 4k --report r.json --verify";
    expect(out, command, 0);
    let report = read(&out.join("r.json"));
    assert_keeps("simplify_report", &report);
    assert!(report["seams"]["charts_vanished"].is_u64(), "{report}");
    assert_keeps("info", &printed(out, "info --json --check in.ply"));
}

#[test]
fn reports_of_convert_keep_the_schema() {
    let folder = folder_with("scans", "--triangles 2k --color");
    let out = folder.path();
    for (output, code) in [("o.ply", 0), ("o.stl", 3)] {
        expect(out, &format!("convert in.ply {output} --report r.json"), code);
        let report = read(&out.join("r.json"));
        assert_keeps("convert_report", &report);
        assert_eq!(report["losses"].as_array().map(Vec::is_empty), Some(code == 0), "{report}");
        std::fs::remove_file(out.join("r.json")).expect("a report");
    }
}

#[test]
fn measurements_keep_the_schema() {
    let folder = folder_with("statue", "--triangles 20k --color --uv");
    let out = folder.path();
    expect(out, "simplify in.ply out.ply --ratio 20% -q --seams seams.ply --cell-triangles 2k", 0);
    for options in [
        "",
        "--near seams.ply --within 0.1",
        "--memory 64MiB --cell-triangles 2k",
        "--certify --tolerance 5%",
        "--memory 64MiB --cell-triangles 2k --certify",
        "--appearance --views 2",
    ] {
        let samples = "--samples 5k --report m.json --json";
        let answer = printed(out, &format!("measure in.ply out.ply {options} {samples}"));
        assert_keeps("measure_report", &answer);
        assert_eq!(answer, read(&out.join("m.json")));
        assert_eq!(answer["forward"]["color_delta_e"], answer["forward"]["colour_delta_e"]);
        assert!(answer["forward"]["color_delta_e"].is_number(), "{answer}");
        assert_eq!(answer["hausdorff"].is_object(), options.contains("--certify"), "{options}");
        assert_eq!(answer["appearance"].is_object(), options.contains("--app"), "{options}");
    }
}

#[test]
fn answers_about_files_and_jobs_keep_the_schema() {
    let folder = folder_with("terrain", "--triangles 20k");
    let out = folder.path();
    for options in ["", "--check", "--check --memory 48MiB", "--check --self-intersections"] {
        assert_keeps("info", &printed(out, &format!("info in.ply --json {options}")));
    }
    expect(out, "synth foam foam.ply --triangles 1k", 0);
    assert_keeps("info", &printed(out, "info foam.ply --json --check"));
    expect(out, "simplify in.ply o.ply --ratio 5% --cell-triangles 3k --until simplify -q", 0);
    let status = printed(out, "status o.ply.stonecut-job --json");
    assert_keeps("status", &status);
    let (new, old) = (&status["input_fingerprint"], &status["input_marks"]);
    assert_eq!(new["sample_checksum"], old["checksum of samples"]);
}

#[test]
fn reports_of_refine_keep_the_schema() {
    let folder = folder_with("statue", "--triangles 12k");
    let out = folder.path();
    expect(out, "simplify in.ply o.ply --ratio 5% --progressive o.pm -q", 0);
    for (options, code) in
        [("--triangles 3k", 0), ("--triangles 10", 3), ("--view 0,-8,2,0,0,1,40 --pixels 2", 0)]
    {
        let said =
            expect(out, &format!("refine o.pm r.ply {options} --force --report r.json -q"), code);
        assert_eq!(said.lines().count(), usize::from(code != 0), "{said}");
        let report = read(&out.join("r.json"));
        assert_keeps("refine_report", &report);
        assert_eq!(report["view"].is_object(), options.contains("--view"), "{report}");
    }
}

/// Events of `--progress json`: each line of standard error is an object.
fn events(out: &Path, command: &str, code: i32) -> Vec<Value> {
    let said = expect(out, &format!("{command} --progress json"), code);
    let parse = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
    let events: Vec<Value> = said.lines().map(parse).collect();
    for line in &events {
        let name = match line["event"].as_str() {
            Some(name @ ("progress" | "note")) => name.to_owned(),
            name => format!("{}_line", name.unwrap_or("no")),
        };
        assert_keeps(&name, line);
    }
    let end = events.last().expect("an event");
    assert_eq!(
        (end["event"].as_str(), end["exit_code"].as_i64()),
        (Some("end"), Some(code.into()))
    );
    events
}

#[test]
fn progress_as_json_is_nothing_but_events() {
    let folder = folder_with("terrain", "--triangles 60k");
    let out = folder.path();
    for quiet in ["", "-q"] {
        let command = format!("simplify in.ply o.ply --ratio 5% --min-component 5 --force {quiet}");
        let events = events(out, &command, 0);
        let has = |name: &str| events.iter().filter(|line| line["event"] == name).count();
        assert!(has("progress") > 0 && has("note") > 0, "{events:?}");
        assert_eq!([has("plan"), has("summary"), has("end")], [1, 1, 1]);
        let summary = events.iter().find(|line| line["event"] == "summary").expect("a summary");
        assert_keeps("simplify_report", &summary["report"]);
    }
    for (command, report) in [
        ("convert in.ply c.obj -q", "convert_report"),
        ("measure in.ply o.ply --samples 1k", "measure_report"),
        ("info in.ply", "info"),
        ("simplify in.ply m.ply --method cluster --ratio 5%", "simplify_report"),
        ("simplify in.ply o.ply --ratio 5% --cell-triangles 9k --force", "simplify_report"),
    ] {
        let events = events(out, command, 0);
        assert_keeps(report, &events.last().expect("an end")["report"]);
        let has_plan = events[0]["event"] == "plan";
        let is_read_first = command.contains("cluster") || command.starts_with("info");
        assert!(has_plan || is_read_first, "{command}");
    }
    let tiles = events(out, "tiles in.ply t --tile-triangles 4k", 0);
    assert!(tiles[0]["event"] == "plan" && tiles[tiles.len() - 1]["report"].is_object());
    for (command, exit_code, code) in [
        ("simplify in.ply o.ply --ratio 5%", 2, "usage"),
        ("simplify in.ply o.ply --no-such-option", 2, "usage"),
        ("simplify none.ply n.ply --ratio 5%", 4, "bad_input"),
        ("tiles in.ply u --memory 1MiB", 6, "no_memory"),
    ] {
        let events = events(out, command, exit_code);
        let end = events.last().expect("an end");
        assert_eq!(end["code"], code, "{command}");
        assert!(end["report"].is_null() && end["error"].is_string(), "{command}");
    }
}

#[test]
fn runs_that_end_early_write_a_report_that_says_so() {
    let folder = folder_with("terrain", "--triangles 20k");
    let out = folder.path();
    for (options, key) in [("--dry-run", "plan"), ("--until partition", "stages_done")] {
        let command = format!("simplify in.ply o.ply --ratio 5% --cell-triangles 3k {options}");
        expect(out, &format!("{command} --report r.json"), 0);
        let report = read(&out.join("r.json"));
        assert_keeps("early_report", &report);
        assert!(!Schema::read().complaints("simplify_report", &report).is_empty());
        assert!(!report[key].is_null() && report["input"]["path"] == "in.ply", "{report}");
    }
    expect(out, "simplify in.ply m.ply --method cluster --ratio 5% --dry-run --report r.json", 0);
    assert!(read(&out.join("r.json"))["plan"].is_object());
    expect(out, "tiles in.ply t --dry-run --report r.json", 0);
    assert!(read(&out.join("r.json"))["plan"].is_object());
    // Such a report is an earlier one of stonecut, which a finished run replaces.
    expect(out, "simplify in.ply o.ply --ratio 5% --cell-triangles 3k --report r.json", 0);
    assert_keeps("simplify_report", &read(&out.join("r.json")));
}

#[test]
fn status_tells_a_running_job_from_a_stopped_one() {
    let folder = folder_with("terrain", "--triangles 20k");
    let out = folder.path();
    expect(out, "simplify in.ply o.ply --ratio 5% --cell-triangles 3k --until simplify -q", 0);
    let job = out.join("o.ply.stonecut-job");
    let status = printed(out, "status o.ply.stonecut-job --json");
    assert_eq!(status, printed(out, "status o.ply --json"));
    assert_eq!(status["is_running"], false);
    assert!(status["percent"].as_f64().expect("percent") > 10.0, "{status}");
    assert!(status["faces"].is_u64() && status["process"].is_u64(), "{status}");
    assert!(status["output"].as_str().expect("a path").ends_with("o.ply"), "{status}");
    // As a run would hold it.
    let lock = std::fs::File::open(job.join("lock")).expect("a lock");
    lock.lock().expect("free");
    let status = printed(out, "status o.ply.stonecut-job --json");
    assert_eq!(status["is_running"], true);
    assert!(status["seconds_left"].is_number() && status["host"].is_string(), "{status}");
    assert_keeps("status", &status);
    let said = run(out, "status o.ply.stonecut-job");
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(
        said.contains("running ") && said.contains(" s left  ") && !said.contains("continue"),
        "{said}"
    );
    let mut follow = crate::common::stonecut();
    let follow = follow.current_dir(out).args(["status", "o.ply.stonecut-job", "--follow"]);
    let follow = follow.stdout(std::process::Stdio::piped()).spawn().expect("runs");
    std::thread::sleep(std::time::Duration::from_millis(300));
    drop(lock);
    let said = follow.wait_with_output().expect("ends");
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.ends_with("stopped; continue by running the same command again\n"), "{said}");
}

#[test]
fn a_run_that_is_done_is_not_done_again() {
    let folder = folder_with("terrain", "--triangles 2k");
    let out = folder.path();
    let again = |options: &str, code: i32| {
        let said = expect(
            out,
            &format!("simplify in.ply o.ply --ratio 10% --report r.json {options}"),
            code,
        );
        assert_eq!(
            said.contains("already done"),
            code == 0 && !options.contains("force"),
            "{said}"
        );
    };
    expect(out, "simplify in.ply o.ply --ratio 10% --report r.json", 0);
    again("", 0);
    for other in ["--fit off", "--format ascii", "--skip-bad", "--verify"] {
        again(other, 2);
    }
    again("--force", 0);
    again("", 0);
    // A map counts as the output does.
    again("--map m.npy --force", 0);
    again("--map m.npy", 0);
    std::fs::remove_file(out.join("m.npy")).expect("a map");
    again("--map m.npy", 2);
    again("--force", 0);
    let mesh = std::fs::read(out.join("o.ply")).expect("an output");
    std::fs::write(out.join("o.ply"), &mesh[..mesh.len() - 1]).expect("written");
    again("", 2);
    again("--force", 0);
    let input = std::fs::read(out.join("in.ply")).expect("an input");
    std::fs::write(out.join("in.ply"), input).expect("written");
    again("", 2);
    expect(out, "simplify in.ply o.ply --ratio 10%", 2);
    if !crate::common::keeps_notes(out) {
        return;
    }
    // Without a report the output itself has a note.
    expect(out, "simplify in.ply o.ply --ratio 10% --force", 0);
    assert!(expect(out, "simplify in.ply o.ply --ratio 10%", 0).contains("already done"));
    // Its job folder is gone, and its status known for all that.
    for place in ["o.ply", "o.ply.stonecut-job"] {
        let said = run(out, &format!("status {place}")).stdout;
        assert!(String::from_utf8_lossy(&said).contains("o.ply\nfinished"), "{place}");
        assert_eq!(printed(out, &format!("status {place} --json"))["is_over"], true);
    }
    assert!(expect(out, "status none.stonecut-job", 4).contains("there is no such job"));
    let mapped = "simplify in.ply p.ply --ratio 10% --map m.npy";
    expect(out, mapped, 0);
    assert!(expect(out, mapped, 0).contains("already done"));
    for other in ["--ratio 11%", "--ratio 10% --fit off", "--ratio 10% --report other.json"] {
        expect(out, &format!("simplify in.ply o.ply {other}"), 2);
    }
    let mesh = std::fs::read(out.join("o.ply")).expect("an output");
    std::fs::write(out.join("o.ply"), mesh).expect("written");
    expect(out, "simplify in.ply o.ply --ratio 10%", 2);
}

#[test]
fn a_ratio_of_one_is_questioned() {
    let folder = folder_with("terrain", "--triangles 200");
    let out = folder.path();
    let said = expect(out, "simplify in.ply o.ply --ratio 1", 0);
    assert!(said.contains("--ratio 1 is 100 %"), "{said}");
    assert!(said.contains("joined at once and brought to the target"), "{said}");
    let said = expect(out, "simplify in.ply p.ply --ratio 100%", 0);
    assert!(!said.contains("warning"), "{said}");
    // Slips are answered with what was meant.
    for (words, code, answer) in [
        ("simplify in.ply q.ply --triangles -5", 2, "invalid count '-5'"),
        ("simplify in.ply q.ply --triangles 5%", 2, "is --ratio 5%"),
        ("simplify in.ply q.ply --ratio 5", 2, "5 % is 5%"),
        ("simplify in.ply q.ply --max-error 1%", 2, "no share"),
        ("simplify in.ply q.ply --triangles 9999", 0, "all triangles"),
        ("simplify in.ply w.ply --triangles 99 --weight color=2", 2, "positions alone"),
        ("measure in.ply", 2, "the simplified mesh comes last"),
        ("extract none x.ply --triangles 9", 4, "the folder does not exist"),
        ("verify in.ply", 4, "it is not JSON; give what"),
        ("", 2, "Commands:"),
    ] {
        let said = expect(out, words, code);
        assert!(said.contains(answer), "{words}: {said}");
    }
}

#[test]
fn the_checker_finds_what_is_wrong() {
    let schema = Schema::read();
    let good = serde_json::json!({"limit": 30, "components": 2, "triangles": 7});
    assert!(schema.complaints("below", &good).is_empty());
    for (key, value) in
        [("limit", Value::Null), ("limit", (-1).into()), ("limit", 0.5.into()), ("Limit", 3.into())]
    {
        let mut bad = good.clone();
        bad[key] = value;
        assert_eq!(schema.complaints("below", &bad).len(), 1, "{bad}");
    }
    assert_eq!(schema.complaints("below", &serde_json::json!({"limit": 1})).len(), 2);
    let bad = serde_json::json!({"name": "a", "type": "int", "carried": "maybe"});
    assert_eq!(schema.complaints("face_property", &bad).len(), 1);
    assert!(begins_as("^(a|b)=", &"b=1".into()) && !begins_as("^(a|b)=", &"c=1".into()));
}

/// The table of docs/report.md for one definition.
fn table(rules: &Value) -> String {
    let required = |key: &String| {
        rules["required"].as_array().is_some_and(|list| list.iter().any(|known| known == key))
    };
    let mut rows = String::from("| key | type | unit | range | meaning |\n|---|---|---|---|---|\n");
    for (key, rule) in rules["properties"].as_object().expect("properties") {
        let mut kind = type_of(rule);
        if !required(key) {
            kind += ", optional";
        }
        let mark = if rule["deprecated"] == true { "**Deprecated.** " } else { "" };
        let unit = rule["x-unit"].as_str().unwrap_or_default();
        let meaning = rule["description"].as_str().expect("a description");
        let range = range_of(rule);
        rows += &format!("| `{key}` | {kind} | {unit} | {range} | {mark}{meaning} |\n");
    }
    rows
}

fn type_of(rule: &Value) -> String {
    let named = |rule: &Value| Some(format!("`{}`", rule["$ref"].as_str()?.rsplit_once('/')?.1));
    if let Some(name) = named(rule) {
        return format!("object {name}");
    }
    let types: Vec<&str> = match &rule["type"] {
        Value::Array(types) => types.iter().filter_map(Value::as_str).collect(),
        kind => kind.as_str().into_iter().collect(),
    };
    let mut words: Vec<String> = types.iter().map(|kind| (*kind).to_owned()).collect();
    if words[0] == "array" {
        let items = &rule["items"];
        words[0] = format!("array of {}", named(items).unwrap_or_else(|| type_of(items)));
    }
    words.join(" or ")
}

fn range_of(rule: &Value) -> String {
    let list = |values: &Value| -> Option<String> {
        let texts = values.as_array()?.iter().map(|value| match value {
            Value::String(text) => format!("`{text}`"),
            other => format!("`{other}`"),
        });
        Some(texts.collect::<Vec<_>>().join(", "))
    };
    match (&rule["const"], &rule["minimum"], &rule["maximum"], &rule["minItems"]) {
        (Value::Null, Value::Null, _, Value::Null) => list(&rule["enum"]).unwrap_or_default(),
        (Value::Null, Value::Null, _, n) => format!("{n} items"),
        (Value::Null, least, Value::Null, _) => format!("≥ {least}"),
        (Value::Null, least, most, _) => format!("{least} to {most}"),
        (only, ..) => only.to_string(),
    }
}

#[test]
fn the_page_for_people_says_what_the_schema_says() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/report.md");
    let page = std::fs::read_to_string(path).expect("the page");
    let rows: BTreeSet<&str> = page.lines().collect();
    for (name, rules) in Schema::read().definitions() {
        let wanted = table(rules);
        let missing: Vec<&str> = wanted.lines().filter(|row| !rows.contains(row)).collect();
        assert!(missing.is_empty(), "docs/report.md lacks, of {name}:\n{}", missing.join("\n"));
    }
}

#[test]
fn keys_are_in_snake_case_but_for_deprecated_ones() {
    let is_snake =
        |key: &str| key.bytes().all(|b| b == b'_' || b.is_ascii_lowercase() || b.is_ascii_digit());
    for (name, rules) in Schema::read().definitions() {
        for (key, rule) in rules["properties"].as_object().expect("properties") {
            assert!(is_snake(key) || rule["deprecated"] == true, "{name}.{key}");
        }
    }
}
