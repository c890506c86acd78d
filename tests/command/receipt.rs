//! Receipts: the same bytes whatever the threads, verified by other means, and every change of a file or of the receipt found and
//! named.

use crate::common::{expect, json, run, scratch};
use serde_json::{Value, json};
use sha2::Digest;
use std::path::Path;

/// Runs `verify` and insists on its exit code; gives back what it says.
fn verify(at: &Path, arguments: &str, code: i32) -> String {
    let output = run(at, &format!("verify {arguments} --progress none"));
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(output.status.code(), Some(code), "verify {arguments}: {said}");
    said
}

/// The same by a program of another profile or processor, `STONECUT_OTHER`, whose words may begin with an emulator: receipts that the
/// program of this build wrote hold there, and a second run there gives the same bytes (`.ci/other-builds`).
fn verify_elsewhere(at: &Path, receipt: &str, again: &str) {
    let Ok(other) = std::env::var("STONECUT_OTHER") else {
        return;
    };
    let mut words = other
        .split_whitespace()
        .chain(["verify", receipt, "--progress", "none"])
        .chain(again.split_whitespace());
    let output = std::process::Command::new(words.next().unwrap())
        .args(words)
        .current_dir(at)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{other} verify {receipt}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// A scan, a textured one with its library and image, one in three files, and a glTF with a buffer.
fn inputs(at: &Path) {
    expect(at, "synth statue in.ply --triangles 3000 -q", 0);
    expect(at, "synth rooms tex.obj --triangles 2000 -q", 0);
    expect(at, "synth terrain parts --triangles 3000 --tiles 3 -q", 0);
    let n = 16u16;
    let place = |i: u16| [f32::from(i % n), f32::from(i / n), f32::from(i % 5) * 0.1];
    let mut buffer: Vec<u8> = (0..n * n).flat_map(place).flat_map(f32::to_le_bytes).collect();
    let squares = (0..n * (n - 1)).filter(|i| i % n < n - 1);
    let corners = squares.flat_map(|i| [i, i + 1, i + n + 1, i, i + n + 1, i + n]);
    let corners: Vec<u8> = corners.flat_map(u16::to_le_bytes).collect();
    let (n_places, n_corners) = (buffer.len(), corners.len());
    buffer.extend(corners);
    let gltf = json!({
        "asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
        "buffers": [{"uri": "buf.bin", "byteLength": buffer.len()}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": n_places},
                        {"buffer": 0, "byteOffset": n_places, "byteLength": n_corners}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": n * n, "type": "VEC3",
                       "min": [0, 0, 0], "max": [15, 15, 0.4]},
                      {"bufferView": 1, "componentType": 5123, "count": n_corners / 2, "type": "SCALAR"}],
    });
    std::fs::write(at.join("buf.gltf"), gltf.to_string()).unwrap();
    std::fs::write(at.join("buf.bin"), buffer).unwrap();
    std::fs::create_dir(at.join("out")).unwrap();
}

fn sha256(bytes: &[u8]) -> String {
    sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A receipt that was edited, with its checksum made right again.
fn forge(at: &Path, edit: impl FnOnce(&mut Value)) {
    let mut receipt = json(at, "out/R.json");
    edit(&mut receipt);
    receipt.as_object_mut().unwrap().remove("sha256");
    receipt["sha256"] = sha256(receipt.to_string().as_bytes()).into();
    std::fs::write(at.join("out/F.json"), receipt.to_string()).unwrap();
}

#[test]
fn receipts_are_the_same_bytes_on_other_threads_and_hold() {
    let at = &scratch();
    inputs(at);
    for (number, (words, code, again)) in [
        ("in.ply out/a.ply --ratio 20% --cell-triangles 1000", 0, "--again"),
        ("in.ply out/b.stl --triangles 500 --translate 1,2,3", 0, "--again"),
        ("in.ply out/c.glb --ratio 20% --up z --scale 0.001", 0, "--again"),
        ("in.ply out/d-{}.obj --ratio 30%,10%", 0, "--again"),
        ("in.ply out/e.ply --max-error 4 --recentre", 0, "--again"),
        ("in.ply out/f.ply --ratio 30% --method cluster --force", 0, "--again"),
        ("in.ply out/g.ply --ratio 30% --progressive out/g.pm --force", 0, "--again"),
        ("tex.obj out/h.obj --ratio 50% --texture keep", 0, ""),
        ("tex.obj out/i.glb --ratio 20% --texture bake --bake-size 256", 0, "--again"),
        ("tex.obj out/j.stl --ratio 50%", 3, "--again"),
        ("parts out/k.ply --ratio 50% --skip-bad", 0, "--again"),
        ("buf.gltf out/l.ply --ratio 50%", 0, "--again"),
    ]
    .into_iter()
    .enumerate()
    {
        let simplify = |threads: u32, more: &str| {
            let receipt = format!("out/{number}.json");
            let words =
                format!("simplify {words} --receipt {receipt} --threads {threads} -q {more}");
            expect(at, &words, code);
            std::fs::read(at.join(receipt)).unwrap()
        };
        let first = simplify(1, "");
        let more = if words.contains("--force") { "--restart" } else { "--force" };
        assert!(first == simplify(3, &format!("{more} --memory 400MiB")), "{words}");
        let said = verify(at, &format!("out/{number}.json {again} --threads 2"), 0);
        assert!(said.contains("verified: ") && said.contains("proven again"), "{words}: {said}");
        verify_elsewhere(at, &format!("out/{number}.json"), again);
    }
    // As `sha256sum` has it, named from the folder of the receipt.
    let bytes = std::fs::read(at.join("in.ply")).unwrap();
    let wanted = json!({"bytes": bytes.len(), "sha256": sha256(&bytes)});
    assert_eq!(json(at, "out/0.json")["input"]["files"]["../in.ply"], wanted);
    expect(at, "simplify parts out/m.ply --ratio 50% --receipt parts/R.json -q", 0);
    assert_eq!(json(at, "parts/R.json")["input"]["given"], json!(["."]));
    assert_eq!(json(at, "out/11.json")["input"]["beside"].as_object().unwrap().len(), 1);
    assert!(json(at, "out/10.json")["input"]["files"].as_object().unwrap().len() >= 3);
    // Another folder of the same files is as good, and a file more is named.
    let moved = at.join("moved");
    std::fs::create_dir(&moved).unwrap();
    for name in ["out", "in.ply", "parts"] {
        std::fs::rename(at.join(name), moved.join(name)).unwrap();
    }
    verify(&moved, "out/0.json", 0);
    verify(&moved, "out/10.json", 0);
    std::fs::copy(moved.join("parts/tile_000.ply"), moved.join("parts/new.ply")).unwrap();
    let said = verify(&moved, "out/10.json", 4);
    assert!(said.contains("new.ply"), "{said}");
}

#[test]
fn one_bit_in_any_file_is_found_and_named() {
    let at = &scratch();
    inputs(at);
    for command in ["tex.obj out/t.obj --ratio 20%", "buf.gltf out/u.ply --ratio 50%"] {
        expect(at, &format!("simplify {command} --receipt out/R.json -q --force"), 0);
        let receipt = json(at, "out/R.json");
        let lists = [
            &receipt["input"]["files"],
            &receipt["input"]["beside"],
            &receipt["outputs"][0]["files"],
        ];
        let names: Vec<&String> =
            lists.iter().flat_map(|list| list.as_object().unwrap().keys()).collect();
        assert!(names.len() >= if command.starts_with("tex") { 6 } else { 3 }, "{names:?}");
        for name in names {
            let path = at.join("out").join(name);
            let bytes = std::fs::read(&path).unwrap();
            let mut flipped = bytes.clone();
            flipped[bytes.len() / 2] ^= 4;
            std::fs::write(&path, &flipped).unwrap();
            let said = verify(at, "out/R.json", 4);
            assert!(said.contains(&format!("{name}: sha256: ")), "{name}: {said}");
            assert_eq!(said.matches("mismatch: ").count(), 1, "{said}");
            std::fs::remove_file(&path).unwrap();
            let said = verify(at, "out/R.json", 4);
            assert!(
                said.contains(&format!("{name}: sha256: ")) && said.contains("missing"),
                "{said}"
            );
            std::fs::write(&path, bytes).unwrap();
        }
        verify(at, "out/R.json", 0);
        let bytes = std::fs::read(at.join("out/R.json")).unwrap();
        for (number, place) in (0..bytes.len()).step_by(61).enumerate() {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1 << (number % 8);
            std::fs::write(at.join("out/F.json"), flipped).unwrap();
            let said = verify(at, "out/F.json", 4);
            assert!(said.contains("receipt"), "byte {place}: {said}");
        }
    }
}

#[test]
fn trees_of_tiles_are_verified_file_by_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::create_dir(at.join("out")).unwrap();
    expect(at, "synth terrain in.ply --triangles 4000 -q", 0);
    expect(at, "synth rooms tex.obj --triangles 2000 -q", 0);
    for words in [
        "tex.obj out/t --tile-triangles 1000 --viewer --geo 47,8,400",
        "in.ply out/a --tile-triangles 500 --scale 2",
    ] {
        let tiles = |more: &str| {
            expect(at, &format!("tiles {words} --receipt out/R.json -q {more}"), 0);
            std::fs::read(at.join("out/R.json")).unwrap()
        };
        let first = tiles("--threads 1");
        assert!(first == tiles("--threads 3 --memory 500MiB --force"), "{words}");
        let said = verify(at, "out/R.json --again --threads 2", 0);
        assert!(said.contains("run again to the same bytes"), "{said}");
        verify_elsewhere(at, "out/R.json", "--again");
    }
    let receipt = json(at, "out/R.json");
    let errors = receipt["tree"]["errors"].as_array().unwrap();
    assert!(errors.len() > 1 && errors[0] == 0 && errors[1].as_f64() > Some(0.0), "{errors:?}");
    let files: Vec<&String> = receipt["tree"]["files"].as_object().unwrap().keys().collect();
    let tile = files.iter().find(|name| name.ends_with(".glb")).unwrap().as_str();
    for name in [tile, "a/tileset.json", "../in.ply"] {
        let path = at.join("out").join(name);
        let bytes = std::fs::read(&path).unwrap();
        let mut flipped = bytes.clone();
        flipped[bytes.len() / 2] ^= 4;
        std::fs::write(&path, &flipped).unwrap();
        let said = verify(at, "out/R.json", 4);
        assert!(said.contains(&format!("{name}: sha256: ")), "{name}: {said}");
        assert_eq!(said.matches("mismatch: ").count(), 1, "{said}");
        std::fs::write(&path, bytes).unwrap();
    }
    std::fs::create_dir(at.join("out/a/more")).unwrap();
    std::fs::write(at.join("out/a/more/x"), "x").unwrap();
    let said = verify(at, "out/R.json", 4);
    assert!(said.contains("a/more: nothing recorded"), "{said}");
    std::fs::remove_dir_all(at.join("out/a/more")).unwrap();
    let refused = |edit: &dyn Fn(&mut Value), named: &str, more: &str| {
        forge(at, edit);
        let said = verify(at, &format!("out/F.json {more}"), 4);
        assert!(said.contains(named), "{named}: {said}");
    };
    refused(&|r| r["tree"]["errors"][1] = 0.into(), "tree: errors: 1: 0 recorded", "");
    refused(&|r| r["tree"]["counts"]["tiles"] = 1.into(), "tree: counts: tiles: 1 recorded", "");
    refused(&|r| r["input"]["counts"]["triangles"] = 1.into(), "input: counts: triangles: 1", "");
    refused(&|r| r["settings"]["pixels"] = "2".into(), "settings: pixels: 2 recorded", "--again");
    refused(&|r| r["options"] = json!(["--tile-triangles=600"]), "run again: ", "--again");
    refused(&|r| r["options"] = json!(["--report=x.json"]), "options: ", "");
    for value in [json!(7), json!({}), json!([])] {
        refused(&|r| r["tree"] = value.clone(), "not a receipt", "");
    }
    verify(at, "out/R.json", 0);
    expect(at, "tiles in.ply out/b --receipt out/b/R.json", 2);
}

#[test]
fn claims_that_do_not_hold_are_named() {
    let at = &scratch();
    inputs(at);
    expect(at, "simplify tex.obj out/t.obj --ratio 20% --receipt out/R.json -q", 0);
    let refused = |edit: &dyn Fn(&mut Value), named: &str, more: &str| {
        forge(at, edit);
        let said = verify(at, &format!("out/F.json {more}"), 4);
        assert!(said.contains(named), "{named}: {said}");
    };
    refused(
        &|r| r["outputs"][0]["counts"]["triangles"] = 7.into(),
        "outputs: 0: counts: triangles: 7 recorded",
        "",
    );
    refused(
        &|r| r["input"]["counts"]["components"] = 9.into(),
        "input: counts: components: 9 recorded",
        "",
    );
    refused(
        &|r| r["coordinates"] = json!({"system": "EPSG:32632"}),
        "coordinates: system: EPSG:32632",
        "",
    );
    refused(
        &|r| {
            let distance = &mut r["outputs"][0]["distance"];
            distance["upper"] = (0.75 * distance["lower"].as_f64().unwrap()).into();
            distance["lower"] = 0.into();
        },
        "outputs: 0: distance: upper",
        "",
    );
    refused(&|r| r["outputs"][0]["distance"]["tolerance"] = 0.into(), "tolerance", "");
    let missing = json!({"bytes": 1, "sha256": "0"});
    refused(
        &|r| r["input"]["files"]["../not.ply"] = missing.clone(),
        "input: ../not.ply: bytes",
        "",
    );
    refused(
        &|r| _ = r["input"]["beside"].as_object_mut().unwrap().remove("../tex_000.png"),
        "../tex_000.png: ",
        "",
    );
    for option in ["--report=x.json", "--log-file=x.json", "-q", "x.json"] {
        refused(&|r| r["options"] = json!(["--ratio=20%", option]), "options: ", "");
    }
    assert!(!at.join("x.json").exists() && !at.join("out/x.json").exists());
    // Only another run shows these.
    refused(
        &|r| r["settings"]["fit"] = "on".into(),
        "settings: fit: on recorded, auto found",
        "--again",
    );
    refused(
        &|r| r["outcome"]["stop_reason"] = "luck".into(),
        "outcome: stop_reason: luck",
        "--again",
    );
    refused(&|r| r["options"] = json!(["--ratio=30%"]), "run again: t.obj: sha256", "--again");
    assert!(
        std::fs::read_dir(at.join("out"))
            .unwrap()
            .flatten()
            .all(|e| !e.file_name().to_string_lossy().contains("again"))
    );
    // A wider interval is true as well.
    forge(at, |r| {
        let distance = &mut r["outputs"][0]["distance"];
        distance["upper"] = (1.25 * distance["upper"].as_f64().unwrap()).into();
    });
    verify(at, "out/F.json", 0);
}

#[test]
fn what_is_not_a_receipt_is_refused() {
    let at = &scratch();
    inputs(at);
    expect(at, "simplify in.ply out/a.ply --ratio 20% --receipt out/R.json -q", 0);
    let bytes = std::fs::read(at.join("out/R.json")).unwrap();
    let refused = |text: &[u8], what: &str| {
        std::fs::write(at.join("out/F.json"), text).unwrap();
        let said = verify(at, "out/F.json", 4);
        assert!(said.contains("F.json") || said.contains("mismatch"), "{what}: {said}");
    };
    for text in
        ["", "{}", "[]", "null", "\u{0}\u{1}", "{\"about\":", "{\"about\":\"stonecut receipt\"}"]
    {
        refused(text.as_bytes(), text);
    }
    refused("[".repeat(200_000).as_bytes(), "deep");
    refused("{\"about\":".repeat(50_000).as_bytes(), "deep objects");
    refused(&[&bytes[..], b" "].concat(), "a blank behind it");
    for end in (0..bytes.len()).step_by(101) {
        refused(&bytes[..end], "cut off");
    }
    let receipt = json(at, "out/R.json");
    let values =
        [json!(null), json!(-1), json!(1e300), json!("x"), json!([[[]]]), json!({"a": {}})];
    for key in receipt.as_object().unwrap().keys().filter(|key| *key != "sha256") {
        for value in &values {
            forge(at, |r| r[key] = value.clone());
            verify(at, "out/F.json", 4);
        }
    }
    let words = ["/dev/zero", "..", "", "-", "@x"];
    for name in words {
        forge(at, |r| r["input"]["files"] = json!({name: {"bytes": 3, "sha256": "x"}}));
        verify(at, "out/F.json", 4);
        forge(at, |r| r["input"]["given"] = json!([name]));
        verify(at, "out/F.json", 4);
    }
    let huge = std::fs::File::create(at.join("out/F.json")).unwrap();
    huge.set_len(1 << 40).unwrap();
    verify(at, "out/F.json", 4);
}

#[test]
fn signatures_are_those_of_minisign() {
    let at = &scratch();
    inputs(at);
    let pair = minisign::KeyPair::generate_unencrypted_keypair().unwrap();
    let other = minisign::KeyPair::generate_unencrypted_keypair().unwrap();
    std::fs::write(at.join("key"), pair.sk.to_box(None).unwrap().into_string()).unwrap();
    std::fs::write(at.join("key.pub"), pair.pk.to_box().unwrap().into_string()).unwrap();
    let simplify = "simplify in.ply out/a.ply --ratio 20% --receipt out/R.json -q --force";
    expect(at, &format!("{simplify} --sign key"), 0);
    let signed = verify(at, "out/R.json --key key.pub", 0);
    assert!(signed.contains("signed by the key"), "{signed}");
    verify(at, &format!("out/R.json --key {}", pair.pk.to_base64()), 0);
    let said = verify(at, "out/R.json", 0);
    assert!(said.contains("--key checks"), "{said}");
    let said = verify(at, &format!("out/R.json --key {}", other.pk.to_base64()), 4);
    assert!(said.contains("mismatch: signature"), "{said}");
    let signature = std::fs::read_to_string(at.join("out/R.json.minisig")).unwrap();
    // A receipt that was edited with all care has another signature.
    forge(at, |r| r["outcome"]["stop_reason"] = "luck".into());
    verify(at, "out/F.json", 0);
    std::fs::write(at.join("out/F.json.minisig"), &signature).unwrap();
    let said = verify(at, "out/F.json --key key.pub", 4);
    assert!(said.contains("mismatch: signature"), "{said}");
    // The letters of a signature are chance: one of the second line is replaced by another.
    let inside = signature.find('\n').unwrap() + 40;
    let other = if signature[inside..].starts_with('A') { "B" } else { "A" };
    let changed = format!("{}{other}{}", &signature[..inside], &signature[inside + 1..]);
    for broken in ["", "x", &signature[..40], &changed] {
        std::fs::write(at.join("out/R.json.minisig"), broken).unwrap();
        verify(at, "out/R.json --key key.pub", 4);
    }
    std::fs::remove_file(at.join("out/R.json.minisig")).unwrap();
    let said = verify(at, "out/R.json --key key.pub", 4);
    assert!(said.contains("R.json.minisig is missing"), "{said}");
    // Before any work.
    std::fs::remove_file(at.join("out/a.ply")).unwrap();
    for key in ["in.ply", "key.pub", "missing"] {
        expect(at, &format!("{simplify} --sign {key}"), 4);
        assert!(!at.join("out/a.ply").exists(), "{key}");
    }
    expect(at, "simplify in.ply out/a.ply --ratio 20% --sign key", 2);
    std::fs::write(at.join("mine.minisig"), "mine").unwrap();
    std::fs::write(at.join("mine.json.minisig"), "mine").unwrap();
    expect(at, "simplify in.ply out/a.ply --ratio 20% --receipt mine.json --sign key", 2);
    expect(at, "simplify in.ply - --ratio 20% --receipt R.json", 2);
}
