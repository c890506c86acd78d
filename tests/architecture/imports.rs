//! Finds which file of a crate uses which other, and which crates, by parsing every file.
//!
//! Names are followed through grouped imports, `super::`, imported modules and re-exports to the file that
//! defines them. A bare re-export (`pub use`) is a declaration, not a use. Tests within a file do not count.

use std::collections::{BTreeMap, BTreeSet};
use syn::visit::{self, Visit};

type Names = Vec<String>;

/// A module: a file, or an inline `mod` within one.
#[derive(Default)]
struct Module {
    file: String,
    /// Local name of each import, with its path as written.
    imports: BTreeMap<String, Names>,
    /// Paths that are used: by private imports and by code.
    used: Vec<Names>,
}

/// Imports of files.
#[derive(Default)]
pub struct Imports {
    /// Other files of the crate, for each file.
    pub files: BTreeMap<String, BTreeSet<String>>,
    /// Other crates, for each file.
    pub crates: BTreeMap<String, BTreeSet<String>>,
}

/// Parses all files, given with their paths below `src/`, and resolves what they use.
pub fn imports(sources: &[(String, String)]) -> Imports {
    let mut modules: BTreeMap<Names, Module> = BTreeMap::new();
    for (name, text) in sources.iter().filter(|(name, _)| name != "main.rs") {
        let parsed = syn::parse_file(text).unwrap_or_else(|e| panic!("src/{name}: {e}"));
        let mut reader =
            Reader { file: name.clone(), at: module_path(name), modules: &mut modules };
        reader.enter();
        reader.visit_file(&parsed);
    }
    let mut out = Imports::default();
    for (at, module) in &modules {
        let files = out.files.entry(module.file.clone()).or_default();
        let crates = out.crates.entry(module.file.clone()).or_default();
        for path in &module.used {
            match absolute(&modules, at, path, 0) {
                Some(path) => {
                    if let Some(file) = file_of(&modules, &path, 0).filter(|f| *f != module.file) {
                        files.insert(file);
                    }
                }
                None => {
                    crates.insert(path[0].clone());
                }
            }
        }
    }
    out
}

/// `a/b.rs` and `a/b/mod.rs` are the module a::b; `lib.rs` is the root.
fn module_path(file: &str) -> Names {
    let mut path: Names =
        file.trim_end_matches(".rs").split('/').map(std::borrow::ToOwned::to_owned).collect();
    if path.last().is_some_and(|last| last == "mod" || last == "lib") {
        path.pop();
    }
    path
}

/// Follows re-exports no deeper than this: a name that is imported from itself has no end.
const DEEP: usize = 16;

/// The path from the root of the crate; `None` if it leads out of the crate.
fn absolute(
    modules: &BTreeMap<Names, Module>,
    at: &Names,
    path: &[String],
    depth: usize,
) -> Option<Names> {
    let (first, rest) = path.split_first()?;
    let mut base = at.clone();
    match first.as_str() {
        "crate" => Some(rest.to_vec()),
        "self" => Some([base, rest.to_vec()].concat()),
        "super" => {
            base.pop();
            match rest.first().is_some_and(|next| next == "super") {
                true => absolute(modules, &base, rest, depth),
                false => Some([base, rest.to_vec()].concat()),
            }
        }
        name => {
            let child = [at.clone(), vec![name.to_owned()]].concat();
            if modules.contains_key(&child) {
                return Some([child, rest.to_vec()].concat());
            }
            let target = modules.get(at)?.imports.get(name)?;
            // `use serde_json;` names itself.
            if target.first() == Some(first) || depth > DEEP {
                return None;
            }
            let target = absolute(modules, at, target, depth + 1)?;
            Some([target, rest.to_vec()].concat())
        }
    }
}

/// The file that defines what an absolute path names.
fn file_of(modules: &BTreeMap<Names, Module>, path: &[String], depth: usize) -> Option<String> {
    let mut at = Names::new();
    for (i, name) in path.iter().enumerate() {
        let child = [at.clone(), vec![name.clone()]].concat();
        if modules.contains_key(&child) {
            at = child;
            continue;
        }
        if let Some(target) = modules.get(&at).and_then(|module| module.imports.get(name))
            && depth < DEEP
        {
            let target = absolute(modules, &at, target, depth)?;
            return file_of(modules, &[target, path[i + 1..].to_vec()].concat(), depth + 1);
        }
        break;
    }
    modules.get(&at).map(|module| module.file.clone())
}

/// Reads the items of a file into the module that is open.
struct Reader<'a> {
    file: String,
    at: Names,
    modules: &'a mut BTreeMap<Names, Module>,
}

impl Reader<'_> {
    fn enter(&mut self) {
        let module = Module { file: self.file.clone(), ..Module::default() };
        self.modules.insert(self.at.clone(), module);
    }

    fn module(&mut self) -> &mut Module {
        self.modules.entry(self.at.clone()).or_default()
    }

    /// Takes in a tree of imports below `path`.
    fn import(&mut self, path: &Names, tree: &syn::UseTree, is_public: bool) {
        let longer = |name: &syn::Ident| [path.clone(), vec![name.to_string()]].concat();
        let (name, path) = match tree {
            syn::UseTree::Path(inner) => {
                return self.import(&longer(&inner.ident), &inner.tree, is_public);
            }
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.import(path, tree, is_public));
                return;
            }
            syn::UseTree::Glob(_) => (None, path.clone()),
            syn::UseTree::Name(leaf) if leaf.ident == "self" => {
                (path.last().cloned(), path.clone())
            }
            syn::UseTree::Name(leaf) => (Some(leaf.ident.to_string()), longer(&leaf.ident)),
            syn::UseTree::Rename(leaf) => (Some(leaf.rename.to_string()), longer(&leaf.ident)),
        };
        if !is_public {
            self.module().used.push(path.clone());
        }
        if let Some(name) = name {
            self.module().imports.insert(name, path);
        }
    }

    /// Paths of a macro's arguments, read as words: `a :: b`.
    fn words(&mut self, tokens: &str) {
        let tokens = tokens.replace(" :: ", "::").replace(":: ", "::").replace(" ::", "::");
        let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
        for word in tokens.split(|c| !is_part(c)) {
            let names: Names = word.split("::").map(std::borrow::ToOwned::to_owned).collect();
            if names.len() > 1 && names.iter().all(|name| !name.is_empty() && !name.contains(':')) {
                self.module().used.push(names);
            }
        }
    }
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute
                .meta
                .require_list()
                .is_ok_and(|list| list.tokens.to_string().starts_with("test"))
    })
}

impl<'ast> Visit<'ast> for Reader<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if item.content.is_none() || is_for_tests(&item.attrs) {
            return;
        }
        self.at.push(item.ident.to_string());
        self.enter();
        visit::visit_item_mod(self, item);
        self.at.pop();
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let is_public = !matches!(item.vis, syn::Visibility::Inherited);
        if !is_for_tests(&item.attrs) {
            self.import(&Names::new(), &item.tree, is_public);
        }
    }

    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Names = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        let is_local = names.len() == 1 && !self.module().imports.contains_key(&names[0]);
        if !is_local {
            self.module().used.push(names);
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        self.words(&item.tokens.to_string());
        visit::visit_macro(self, item);
    }
}
