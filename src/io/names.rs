//! Names of objects and groups: what the number that each face has stands for.
//!
//! OBJ has objects and groups (`o`, `g`), glTF has nodes and meshes: an object is a node, a group a mesh. In a PLY file the
//! number is a property of faces, and comments say what it stands for. A mesh has the same property and the same comments on
//! its way from a reader to a writer, so names travel as every other label of faces does. Where all faces have one name there
//! is only the comment.

use super::encodings;
use super::sidecars::crs_of;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;
use stonecut_mesh::placing::offset_of;
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Loss, LossKind, Severity};
use stonecut_system::units::{memory_word, show_bytes};

/// The property of faces that holds the number of their name.
pub const OBJECT: &str = "objectnumber";

/// The number of a face without a name.
pub(super) const NO_NAME: i32 = -1;

/// Begins a comment: `ObjectName 7 o chair`, and `ObjectName 7 g seat` for the group.
const WORD: &str = "ObjectName ";

/// Names beyond this many are not carried, none of them.
const MAX_NAMES: usize = 65_535;

/// The same for bytes: the header of a PLY file holds all names.
const MAX_BYTES: usize = 4 << 20;

/// Copies of each name that a run holds at most: of header, comments and text of the output.
const N_COPIES: usize = 8;

/// Bytes of a name besides its text.
const NAME_BYTES: usize = 100;

/// The words for names in the ledger.
const WHAT: &str = "names of objects and groups";

/// Fate of the names of objects and groups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NameUse {
    /// Of no interest: OBJ and glTF files are read without them.
    #[default]
    Ignored,
    /// Carried as labels of faces.
    Carried,
    /// Given up, for a reason that goes into the ledger unless it is empty.
    GivenUp(&'static str),
}

/// Name of a part of a mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Name {
    /// Object of OBJ, or node of glTF; empty if there is none.
    pub(super) object: String,
    /// Group or groups of OBJ, or mesh of glTF; empty if there is none.
    pub(super) group: String,
}

impl Name {
    /// A name without control characters and blanks around it.
    pub(super) fn new(object: &str, group: &str) -> Name {
        let plain = |text: &str| text.replace(char::is_control, " ").trim().to_owned();
        Name { object: plain(object), group: plain(group) }
    }

    fn is_empty(&self) -> bool {
        self.object.is_empty() && self.group.is_empty()
    }
}

/// Gathers names in the order of their first faces.
#[derive(Default)]
pub(super) struct NameList {
    names: Vec<Rc<Name>>,
    numbers: HashMap<Rc<Name>, i32>,
    n_bytes: usize,
    has_nameless: bool,
    has_too_many: bool,
    /// True once names are given up.
    is_closed: bool,
}

impl NameList {
    /// The number of the name of a face.
    pub(super) fn number(&mut self, name: &Name) -> i32 {
        if self.is_closed || name.is_empty() {
            self.has_nameless = true;
            return NO_NAME;
        }
        if let Some(&number) = self.numbers.get(name) {
            return number;
        }
        let n_bytes = self.n_bytes + escaped(&name.object).len() + escaped(&name.group).len();
        if self.names.len() == MAX_NAMES || n_bytes > MAX_BYTES {
            self.has_too_many = true;
            return NO_NAME;
        }
        let (number, name) = (self.names.len() as i32, Rc::new(name.clone()));
        self.n_bytes = n_bytes;
        self.names.push(name.clone());
        self.numbers.insert(name, number);
        number
    }

    /// Decides, once all faces are known, whether names are carried; gives the loss if there is one.
    ///
    /// Fails where they are and do not fit into `parse_bytes`, which is half of the memory of the command.
    pub(super) fn settle(
        &mut self,
        path: &Path,
        (wanted, parse_bytes): (NameUse, u64),
    ) -> Result<Option<Loss>> {
        let n = self.names.len() as u64;
        let loss = Loss::new(LossKind::Names, WHAT, "").count(n);
        let (is_carried, loss) = match wanted {
            NameUse::Carried if self.has_too_many => {
                let reason = format!(
                    "not carried, being more than {MAX_NAMES} or longer than {} together",
                    show_bytes(MAX_BYTES as u64)
                );
                (false, Some(Loss { reason, severity: Severity::Partial, ..loss }))
            }
            NameUse::Carried => (true, None),
            // A single name says little.
            NameUse::GivenUp(reason) if self.has_several() && !reason.is_empty() => {
                let reason = reason.to_owned();
                (false, Some(Loss { reason, severity: Severity::Notice, ..loss }))
            }
            NameUse::GivenUp(_) | NameUse::Ignored => (false, None),
        };
        let needed = (N_COPIES * (self.n_bytes + NAME_BYTES * self.names.len())) as u64;
        if is_carried && needed > parse_bytes {
            return Err(Error::NoMemory(format!(
                "{}: its {n} {WHAT} take {} of memory, more than the {} at hand; give --memory {}, or leave them out with \
                 --drop-names",
                path.display(),
                show_bytes(needed),
                show_bytes(parse_bytes),
                memory_word(2 * needed)
            )));
        }
        if !is_carried {
            *self = NameList { is_closed: true, ..NameList::default() };
        }
        Ok(loss)
    }

    fn has_several(&self) -> bool {
        self.names.len() + usize::from(self.has_nameless) > 1
    }

    /// Returns whether faces get the number of their name: there are several.
    pub(super) fn has_numbers(&self) -> bool {
        !self.is_closed && self.has_several() && !self.names.is_empty()
    }

    /// The comments that say what each number stands for.
    pub(super) fn comments(&self) -> impl Iterator<Item = String> {
        self.names.iter().enumerate().flat_map(|(number, name)| {
            let parts = [("o", &name.object), ("g", &name.group)].map(|(kind, text)| {
                (!text.is_empty()).then(|| format!("{WORD}{number} {kind} {}", escaped(text)))
            });
            parts.into_iter().flatten()
        })
    }
}

/// Names by number, as comments have them.
#[derive(Clone, Debug, Default)]
pub(super) struct NameTable {
    list: Vec<Name>,
}

impl NameTable {
    /// The names that comments give; empty if there are none.
    pub(super) fn of(comments: &[String]) -> NameTable {
        let mut list: Vec<Name> = Vec::new();
        for (number, kind, text) in comments.iter().filter_map(|comment| parts(comment)) {
            if number >= list.len() {
                list.resize_with(number + 1, Name::default);
            }
            match kind {
                "o" => list[number].object = text,
                _ => list[number].group = text,
            }
        }
        NameTable { list }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    /// The loss of all these names.
    pub(super) fn loss(&self, reason: &str) -> Loss {
        Loss::new(LossKind::Names, WHAT, reason).count(self.list.len() as u64).notice()
    }

    /// Names in the order of writing, and for each number the place in that order, counted from 1; 0 stands for no name.
    ///
    /// Names without an object come first, then objects by their first number, each with its part without a group first.
    pub(super) fn ranked(mut self) -> (Vec<Name>, Vec<u32>) {
        let mut first: HashMap<&str, usize> = HashMap::new();
        for (number, name) in self.list.iter().enumerate().filter(|(_, n)| !n.object.is_empty()) {
            first.entry(&name.object).or_insert(number + 1);
        }
        let mut order: Vec<usize> = (0..self.len()).filter(|&i| !self.list[i].is_empty()).collect();
        order.sort_by_key(|&i| {
            let name = &self.list[i];
            let object = first.get(name.object.as_str()).copied().unwrap_or(0);
            (object, !name.group.is_empty(), i)
        });
        let mut ranks = vec![0; self.len()];
        order.iter().zip(1..).for_each(|(&number, rank)| ranks[number] = rank);
        let names = order.into_iter().map(|number| std::mem::take(&mut self.list[number]));
        (names.collect(), ranks)
    }
}

/// Returns whether a comment gives a name.
pub(super) fn is_name(comment: &str) -> bool {
    parts(comment).is_some()
}

/// The loss of the comments of a mesh, if it has any.
pub fn lost_comments(comments: &[String], infos: &[String], reason: &str) -> Option<Loss> {
    // Tiles and STL have the system of a map, too.
    let is_lost = |line: &&str| crs_of(line).is_none();
    let n = own_comments(comments, infos).into_iter().filter(is_lost).count() as u64;
    (n > 0).then(|| Loss::new(LossKind::Names, "comments", reason).count(n).notice())
}

/// Comments for people: neither names, nor an offset, nor the lines of earlier runs of this program.
pub(super) fn own_comments<'a>(comments: &'a [String], infos: &'a [String]) -> Vec<&'a str> {
    let is_own = |line: &&String| {
        !is_name(line)
            && !line.starts_with("stonecut ")
            && !line.is_empty()
            && offset_of(line).is_none()
    };
    comments.iter().chain(infos).filter(is_own).map(String::as_str).collect()
}

/// A name in ASCII, since the header of a PLY file is: other letters as addresses have them (`%C3%A9`), and signs that would be
/// taken for those.
pub(super) fn escaped(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for (at, &byte) in name.as_bytes().iter().enumerate() {
        let digits = name.as_bytes().get(at + 1..at + 3);
        let is_number = digits.is_some_and(|two| two.iter().all(u8::is_ascii_hexdigit));
        match byte {
            b'%' if is_number => out.push_str("%25"),
            _ if byte.is_ascii() => out.push(char::from(byte)),
            _ => out.push_str(&format!("%{byte:02X}")),
        }
    }
    out
}

/// The name that was escaped; as it is where it was not.
pub(super) fn unescaped(text: &str) -> String {
    String::from_utf8(encodings::unescaped(text)).unwrap_or_else(|_| text.to_owned())
}

/// Number, kind and text of such a comment.
fn parts(comment: &str) -> Option<(usize, &str, String)> {
    let (number, rest) = comment.strip_prefix(WORD)?.split_once(' ')?;
    let (kind, text) = rest.split_once(' ')?;
    let number: usize = number.parse().ok()?;
    (number < MAX_NAMES && ["o", "g"].contains(&kind))
        .then(|| (number, kind, unescaped(text.trim())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_into_comments_and_back_in_the_order_of_objects() {
        let mut list = NameList::default();
        let given = [("a", "x"), ("b", ""), ("", "lone g"), ("a", ""), ("a", "y"), ("b", "")];
        let numbers = given.map(|(object, group)| list.number(&Name::new(object, group)));
        assert_eq!(numbers, [0, 1, 2, 3, 4, 1]);
        assert!(list.has_numbers());
        let comments: Vec<String> = list.comments().collect();
        assert_eq!(comments[..2], ["ObjectName 0 o a", "ObjectName 0 g x"]);
        let (names, ranks) = NameTable::of(&comments).ranked();
        let texts = names.iter().map(|name| format!("{}/{}", name.object, name.group));
        assert_eq!(texts.collect::<Vec<_>>(), ["/lone g", "a/", "a/x", "a/y", "b/"]);
        assert_eq!(ranks, [3, 5, 1, 2, 4]);
    }

    #[test]
    fn names_in_comments_are_ascii() {
        for name in ["stra\u{df}e 1", "\u{6728}", "100% wool", "50%25", "%C3", "%%20"] {
            let mut list = NameList::default();
            list.number(&Name::new(name, ""));
            let comments: Vec<String> = list.comments().collect();
            assert!(comments[0].is_ascii(), "{comments:?}");
            assert_eq!(NameTable::of(&comments).ranked().0[0].object, name);
        }
    }

    #[test]
    fn what_only_looks_like_a_name_is_a_comment() {
        for comment in
            ["ObjectName", "ObjectName 1 x a", "ObjectName -1 o a", "ObjectName 65535 o a"]
        {
            assert!(!is_name(comment), "{comment}");
        }
    }
}
