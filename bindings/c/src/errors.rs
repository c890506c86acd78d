//! Codes and texts of errors, and the border that no panic crosses.

use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int};
use stonecut::Result;
use stonecut::system::parallel::guarded;

/// The code of a call that did not give all that was asked for.
const SHORT: c_int = 3;

/// End of a call without an error.
#[derive(Debug)]
pub enum End {
    /// All that was asked for.
    Whole,
    /// Less, for this reason.
    Short(String),
}

/// The last call of a thread, as `stonecut_error` of the header.
#[repr(C)]
pub struct LastError {
    /// The code that it returned.
    pub code: c_int,
    /// Name of the class.
    pub name: *const c_char,
    /// The fault, its place, and what to do.
    pub message: *const c_char,
    /// A remedy beside that.
    pub remedy: *const c_char,
}

/// The same with the texts that it points to.
struct Kept {
    shown: Box<LastError>,
    texts: [CString; 3],
}

impl Kept {
    fn new(code: c_int, texts: [&str; 3]) -> Kept {
        let texts = texts.map(text);
        let [name, message, remedy] = texts.each_ref().map(|text| text.as_ptr());
        Kept { shown: Box::new(LastError { code, name, message, remedy }), texts }
    }
}

thread_local! {
    static LAST: RefCell<Kept> = RefCell::new(Kept::new(0, [""; 3]));
}

/// A text for C; a zero within becomes a space.
pub fn text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Runs `work` and keeps how it ended; a panic is an internal error.
pub fn border(work: impl FnOnce() -> Result<End>) -> c_int {
    let kept = match guarded(work) {
        Ok(End::Whole) => Kept::new(0, [""; 3]),
        Ok(End::Short(reason)) => Kept::new(SHORT, ["short", &reason, ""]),
        Err(error) => {
            let remedy = error.remedy().unwrap_or_default();
            Kept::new(error.exit_code().into(), [error.code(), &error.to_string(), &remedy])
        }
    };
    let code = kept.shown.code;
    LAST.with_borrow_mut(|last| *last = kept);
    code
}

/// End of the last call of this thread.
pub fn last() -> *const LastError {
    LAST.with_borrow(|last| {
        debug_assert_eq!(last.shown.name, last.texts[0].as_ptr());
        &raw const *last.shown
    })
}
