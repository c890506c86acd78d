//! Parts of a PLY file that the mesh does not have, and parts that are given up when it is opened; the
//! header that keeps the rest.

use super::source::MeshSource;
use super::textures::is_of_materials;
use super::writer::OutputHeader;
use crate::names::{Name, NameTable, NameUse, OBJECT, is_name};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::losses::{Ledger, Loss, LossKind};

impl MeshSource {
    /// Comments without those that name materials, which `materials` has.
    pub fn plain_comments(&self) -> Vec<String> {
        let plain = self.comments().iter().filter(|line| !is_of_materials(line));
        plain.cloned().collect()
    }

    /// The header of an output that keeps the comments.
    pub fn kept_header(&self, schema: VertexSchema, n_vertices: u64, n_faces: u64) -> OutputHeader {
        OutputHeader {
            comments: self.plain_comments(),
            obj_infos: self.obj_infos().to_vec(),
            images_hide_colours: self.images_hide_colours(),
            n_bare: self.staged.n_bare,
            ..OutputHeader::new(schema, n_vertices, n_faces)
        }
    }

    /// Leaves names of objects and groups out, if they are given up.
    pub(super) fn give_up_names(&mut self) {
        let NameUse::GivenUp(reason) = self.options.names else { return };
        let names = NameTable::of(&self.header.comments);
        if names.is_empty() {
            return;
        }
        self.header.comments.retain(|comment| !is_name(comment));
        self.hidden = Some(OBJECT);
        if !reason.is_empty() {
            self.staged.losses.lose(names.loss(reason));
        }
    }

    /// Names of objects and groups: `object`, `group` or `object / group`.
    pub fn names(&self) -> Vec<String> {
        let (names, _) = NameTable::of(&self.header.comments).ranked();
        let shown = |name: Name| match (name.object.as_str(), name.group.as_str()) {
            (object, "") => object.to_owned(),
            ("", group) => group.to_owned(),
            (object, group) => format!("{object} / {group}"),
        };
        names.into_iter().map(shown).collect()
    }

    /// True if some vertices, white since then, had no colour where others have one.
    pub fn has_bare_vertices(&self) -> bool {
        self.staged.n_bare > 0
    }

    /// Parts of the file that the mesh does not have.
    pub fn losses(&self) -> Ledger {
        let mut losses = self.staged.losses.clone();
        let mut lose = |what: &str, name: &String| {
            let loss = Loss::new(LossKind::Attributes, what, "only single numbers are carried");
            losses.lose(loss.example(format!("'{name}'")).whole());
        };
        self.plan.dropped_lists.iter().for_each(|name| lose("lists of vertices", name));
        self.dropped_face_properties().iter().for_each(|name| lose("lists of faces", name));
        let used = [Some(self.layout.vertex_element), self.layout.face_element];
        let others = self.header.elements.iter().enumerate();
        for (_, element) in others.filter(|(i, element)| {
            !used.contains(&Some(*i)) && element.count > 0 && element.name != "range_grid"
        }) {
            let what = format!("elements '{}'", element.name);
            let loss = Loss::new(LossKind::Elements, what, "only vertices and faces are carried");
            // The place that a scan was taken from says nothing of the surface.
            let is_aside = element.name == "camera";
            losses.lose(if is_aside { loss.notice() } else { loss.count(element.count) });
        }
        losses
    }

    /// The loss of those who take colours for shares of white.
    pub fn clamped_colours(&self) -> Option<Loss> {
        let what = "components of colours of vertices";
        let loss = Loss::new(LossKind::Colors, what, "outside of black to white: clamped");
        (self.n_outside > 0).then(|| loss.count(self.n_outside))
    }
}
