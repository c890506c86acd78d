//! Faults of the caller, panics, stopping, threads.

use super::*;
use std::sync::atomic::{AtomicU32, Ordering};
use stonecut_c::errors::border;
use stonecut_c::given::Progress;

fn refused(mesh: &Mesh, options: &RawOptions) -> (c_int, String) {
    let (code, result) = simplify(mesh, options);
    assert!(result.0.is_null());
    (code, message())
}

#[test]
fn what_is_wrong_is_named_as_the_caller_wrote_it() {
    let plate = Plate::new(4);
    let good = plate.mesh();
    let wanted = RawOptions { triangles: 8, ..options() };
    let (mut far, mut broken) = (plate.triangles.clone(), plate.positions.clone());
    far[3][1] = 25;
    broken[7][2] = f32::NAN;
    let cases: Vec<(Mesh, c_int, &str)> = vec![
        (Mesh { positions: null(), ..good }, 2, "usage: mesh->positions is null"),
        (Mesh { triangles: null(), ..good }, 2, "usage: mesh->triangles is null"),
        (Mesh { size: 8, ..good }, 2, "usage: mesh->size is 8, not"),
        (Mesh { position_type: 2, ..good }, 2, "usage: mesh->position_type is 2"),
        (Mesh { position_stride: 8, ..good }, 2, "usage: mesh->positions: a stride of 8 bytes"),
        (Mesh { reserved: 1, ..good }, 2, "usage: mesh->reserved is not 0"),
        (Mesh { n_vertices: usize::MAX / 2, ..good }, 2, "usage: mesh->positions: "),
        (Mesh { n_triangles: usize::MAX / 2, ..good }, 2, "usage: mesh->triangles: "),
        (Mesh { n_attributes: 2, ..good }, 2, "usage: mesh->attributes is null"),
        (Mesh { n_triangles: 0, ..good }, 4, "bad_input: faces: there are none"),
        (
            Mesh { triangles: far.as_ptr().cast(), ..good },
            4,
            "bad_input: mesh->triangles: row 3: index 25 is not one of the 25 points",
        ),
        (
            Mesh { positions: broken.as_ptr().cast(), ..good },
            4,
            "bad_input: mesh->positions: row 7: z is NaN",
        ),
    ];
    for (mesh, code, words) in &cases {
        let found = refused(mesh, &wanted);
        assert!(found.0 == *code && found.1.starts_with(words), "{found:?} for {words}");
    }
    let words = [null()];
    for (wrong, words) in [
        (options(), "usage: "),
        (RawOptions { ratio: f64::NAN, ..options() }, "usage: "),
        (RawOptions { triangles: 8, ratio: 0.5, ..options() }, "usage: "),
        (
            RawOptions { words: words.as_ptr(), n_words: 1, ..wanted },
            "usage: options->words[0] is null",
        ),
        (RawOptions { size: 12, ..wanted }, "usage: options->size is 12"),
        (RawOptions { n_words: usize::MAX, ..wanted }, "usage: options->words: "),
    ] {
        let found = refused(&good, &wrong);
        assert!(found.0 == 2 && found.1.starts_with(words), "{found:?} for {words}");
    }
    let attribute = |name: *const c_char, scalar, width| Attribute {
        name,
        values: plate.positions.as_ptr().cast(),
        stride: 0,
        scalar,
        width,
    };
    for (wrong, words) in [
        (attribute(null(), F32, 1), "usage: mesh->attributes[0].name is null"),
        (attribute(c"heat".as_ptr(), 11, 1), "usage: mesh->attributes[0].type is 11"),
        (attribute(c"heat".as_ptr(), F32, 0), "usage: mesh->attributes[0].width is 0"),
        (attribute(c"normal".as_ptr(), F32, 2), "usage: mesh->attributes[0]: 2 of F32"),
        (attribute(c"color".as_ptr(), F32, 70_000), "usage: mesh->attributes[0].width is 70000"),
    ] {
        let mesh = Mesh { n_attributes: 1, attributes: &raw const wrong, ..good };
        let found = refused(&mesh, &wanted);
        assert!(found.0 == 2 && found.1.starts_with(words), "{found:?} for {words}");
    }
    unsafe {
        assert_eq!(stonecut_simplify(&raw const good, &raw const wanted, null_mut()), 2);
        assert_eq!(message(), "usage: result is null");
        let mut result = null_mut();
        assert_eq!(stonecut_simplify(null(), &raw const wanted, &raw mut result), 2);
        assert_eq!(message(), "usage: mesh is null");
        assert_eq!(stonecut_run(null(), 3, null(), &raw mut result), 2);
        assert_eq!(message(), "usage: words is null");
        assert_eq!(stonecut_result_number(null(), c"/x".as_ptr(), null_mut()), 2);
        assert!(stonecut_result_mesh(null()).is_null() && stonecut_result_report(null()).is_null());
        stonecut_result_free(null_mut());
        stonecut_init(null_mut(), 8);
    }
    assert_eq!(run("demo", null()).0, 2);
    assert_eq!(run("simplify /nowhere/a.ply b.ply --ratio=0.1", null()).0, 4);
    assert!(message().contains("/nowhere/a.ply"), "{}", message());
}

/// A program that was compiled with a newer header: more members, which an older library may ignore only if they are not used.
#[test]
fn a_newer_structure_is_taken_if_its_new_members_are_zero() {
    #[repr(C)]
    struct Newer {
        options: RawOptions,
        more: u64,
    }
    let plate = Plate::new(4);
    let size = size_of::<Newer>();
    let mut newer = Newer { options: RawOptions { size, triangles: 8, ..options() }, more: 0 };
    let call = |newer: &Newer| {
        let mut result = null_mut();
        let given: *const Newer = newer;
        let code = unsafe { stonecut_simplify(&plate.mesh(), given.cast(), &raw mut result) };
        drop(Owned(result));
        code
    };
    assert_eq!(call(&newer), 0, "{}", message());
    newer.more = 1;
    assert_eq!(call(&newer), 2);
    assert!(message().contains("older than the header"), "{}", message());
}

#[test]
fn a_panic_is_a_code() {
    assert_eq!(border(|| panic!("a fault of the test")), 9);
    assert!(
        message().starts_with("internal: internal fault: a fault of the test"),
        "{}",
        message()
    );
    assert_eq!(unsafe { &*stonecut_last_error() }.code, 9);
    let plate = Plate::new(4);
    assert_eq!(simplify(&plate.mesh(), &RawOptions { triangles: 8, ..options() }).0, 0);
    assert_eq!((unsafe { &*stonecut_last_error() }.code, message()), (0, ": ".to_owned()));
}

#[test]
fn less_than_was_asked_for_is_a_result_with_a_reason() {
    // Triangles that lie apart cannot become two.
    let plate = Plate::new(12);
    let words = [c"--topology=keep".as_ptr()];
    let triangles: Vec<[u32; 3]> = plate.triangles.iter().step_by(3).copied().collect();
    let loose = Plate { positions: plate.positions, triangles };
    let wanted = RawOptions { triangles: 2, words: words.as_ptr(), n_words: 1, ..options() };
    let (code, result) = simplify(&loose.mesh(), &wanted);
    assert_eq!(code, 3, "{}", message());
    assert!(
        message().starts_with("short: ") && message().contains("triangles are left"),
        "{}",
        message()
    );
    assert!(result.mesh().n_triangles > 2);
    assert_eq!(result.number("/target_met"), 0.0);
}

unsafe extern "C" fn stop_at_once(progress: *const Progress, user: *mut c_void) -> c_int {
    let (progress, calls) = unsafe { (&*progress, &*user.cast::<AtomicU32>()) };
    assert!(progress.fraction <= 1.0 && !progress.stage.is_null());
    calls.fetch_add(1, Ordering::Relaxed);
    7
}

#[test]
fn a_function_that_wants_to_stop_is_called_once_and_obeyed() {
    let plate = Plate::new(700);
    let calls = AtomicU32::new(0);
    let user = (&raw const calls).cast_mut().cast();
    let wanted = RawOptions { ratio: 0.01, progress: Some(stop_at_once), user, ..options() };
    assert_eq!(refused(&plate.mesh(), &wanted).0, 130);
    assert!(message().starts_with("interrupted: "), "{}", message());
    assert_eq!(calls.load(Ordering::Relaxed), 1);
}

#[test]
fn threads_do_not_disturb_each_other() {
    let plate = Plate::new(60);
    let wanted = RawOptions { ratio: 0.1, threads: 1, ..options() };
    let (code, alone) = simplify(&plate.mesh(), &wanted);
    assert_eq!(code, 0);
    let (positions, triangles) = (alone.singles(), alone.triangles());
    std::thread::scope(|scope| {
        for i in 0..4usize {
            let (plate, positions, triangles) = (&plate, &positions, &triangles);
            scope.spawn(move || {
                for turn in 0..4 {
                    if (i + turn) % 2 == 0 {
                        let wrong = Mesh { position_type: 20 + i as u32, ..plate.mesh() };
                        let (code, words) =
                            refused(&wrong, &RawOptions { ratio: 0.1, ..options() });
                        let mine = format!("position_type is {}", 20 + i);
                        assert!(code == 2 && words.contains(&mine), "{words}");
                    }
                    let threads = 1 + i;
                    let wanted = RawOptions { ratio: 0.1, threads, ..options() };
                    let (code, result) = simplify(&plate.mesh(), &wanted);
                    assert_eq!((code, message().as_str()), (0, ": "));
                    assert!(result.singles() == *positions && result.triangles() == *triangles);
                }
            });
        }
    });
}
