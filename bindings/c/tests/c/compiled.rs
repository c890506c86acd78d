//! Checks by compilers: layouts of the header, the example without a warning, and what it prints.

use super::*;
use std::mem::offset_of;
use std::process::Command;
use stonecut_c::errors::LastError;
use stonecut_c::given::Progress;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const STRICT: [&str; 6] = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror"];

/// The compiler, if there is one.
fn compiler(name: &'static str) -> Option<&'static str> {
    let is_here = Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    if !is_here {
        skipped(&format!("what needs {name}, which is not here"));
    }
    is_here.then_some(name)
}

fn expect(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{text}{errors}", output.status);
    text
}

/// Folder of the shared library: where Cargo has put it for this test.
fn libraries() -> std::path::PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_path_buf()
}

#[test]
fn the_header_and_the_library_agree() {
    let Some(cc) = compiler("cc") else { return };
    let mut asserts = String::new();
    macro_rules! layout {
        ($kind:ty, $name:literal, $($member:ident $(as $other:literal)?),+) => {
            asserts += &format!("_Static_assert(sizeof({}) == {}, \"size\");\n", $name, size_of::<$kind>());
            $(
                let member = [$($other,)? stringify!($member)][0];
                let at = offset_of!($kind, $member);
                asserts += &format!("_Static_assert(offsetof({}, {member}) == {at}, \"{member}\");\n", $name);
            )+
        };
    }
    layout!(Attribute, "stonecut_attribute", name, values, stride, scalar as "type", width);
    layout!(
        Mesh,
        "stonecut_mesh",
        size,
        n_vertices,
        positions,
        position_stride,
        position_type,
        reserved,
        n_triangles,
        triangles,
        labels,
        n_attributes,
        attributes,
        source
    );
    layout!(
        RawOptions,
        "stonecut_options",
        size,
        triangles,
        ratio,
        memory_bytes,
        threads,
        samples,
        words,
        n_words,
        progress,
        user
    );
    layout!(
        Progress,
        "stonecut_progress",
        stage,
        number,
        stages,
        fraction,
        seconds,
        seconds_left,
        memory_bytes
    );
    layout!(LastError, "stonecut_error", code, name, message, remedy);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("layout.c");
    std::fs::write(&file, format!("#include <stonecut.h>\n{asserts}")).unwrap();
    let include = format!("-I{ROOT}/include");
    expect(Command::new(cc).args(["-std=c11", "-fsyntax-only", &include]).args(STRICT).arg(&file));
    // The functions of the header are those of the library.
    let names = |text: &str, before: &str| {
        let mut names: Vec<String> = text
            .lines()
            .filter(|line| {
                line.contains(before) && line.contains("stonecut_") && line.contains('(')
            })
            .filter(|line| !line.starts_with([' ', '/', 't', '#']))
            .filter_map(|line| Some(line.split('(').next()?.rsplit([' ', '*']).next()?.to_owned()))
            .collect();
        names.sort();
        names
    };
    let header = std::fs::read_to_string(format!("{ROOT}/include/stonecut.h")).unwrap();
    let source = std::fs::read_to_string(format!("{ROOT}/src/lib.rs")).unwrap();
    let declared = names(&header, "");
    assert_eq!(declared, names(&source, "extern \"C\" fn"));
    assert_eq!(declared.len(), 10, "{declared:?}");
    let version = unsafe { CStr::from_ptr(stonecut_version()) };
    assert_eq!(version.to_str(), Ok(env!("CARGO_PKG_VERSION")));
}

#[test]
fn the_example_compiles_without_a_warning_in_c_and_cxx_and_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (given, small) = (path("a.ply"), path("b.ply"));
    assert_eq!(run(&format!("synth statue {given} --triangles 4000"), null()).0, 0);
    let libraries = libraries();
    let mut answers = Vec::new();
    for (name, standard) in [("cc", "-std=c99"), ("c++", "-std=c++11")] {
        let Some(compiler) = compiler(name) else { continue };
        let program = folder.path().join(name);
        let language = if name == "cc" { "c" } else { "c++" };
        let mut command = Command::new(compiler);
        command.args([
            standard,
            "-x",
            language,
            &format!("{ROOT}/examples/simplify.c"),
            "-x",
            "none",
        ]);
        command.args(STRICT).arg(format!("-I{ROOT}/include")).arg("-L").arg(&libraries);
        expect(command.args(["-lstonecut_c", "-lm", "-o"]).arg(&program));
        let mut command = Command::new(&program);
        command.env("LD_LIBRARY_PATH", &libraries).args([&given, &small]);
        answers.push(expect(&mut command));
    }
    for answer in &answers {
        assert!(answer.contains("1788 of 89400 triangles"), "{answer}");
        assert!(answer.contains("b.ply has 4"), "{answer}");
        assert_eq!(answer, &answers[0]);
    }
}
