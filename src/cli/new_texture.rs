//! `--bake-size` and `--bake-pages` of `simplify`.

use crate::config::{BakeSettings, PAGE_SIZES};
use crate::io::TextureMode;

/// The pages of a new texture.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TypedPages {
    /// With a new texture: side of its pages in texels, 64 to 16384 [default: 4096].
    #[arg(long, value_name = "N", value_parser = parse_page_size)]
    pub(super) bake_size: Option<u32>,
    /// With a new texture: pages at most; texels become larger where they do not fit [default: as many as texels of
    /// the input's size take].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) bake_pages: Option<u32>,
}

fn parse_page_size(text: &str) -> std::result::Result<u32, String> {
    let side = text.parse().ok().filter(|side| PAGE_SIZES.contains(side));
    side.ok_or_else(|| {
        format!("a side in texels from {} to {}", PAGE_SIZES.start(), PAGE_SIZES.end())
    })
}

impl TypedPages {
    /// The options that were given.
    fn all_given(&self) -> impl Iterator<Item = &'static str> {
        [("--bake-size", self.bake_size.is_some()), ("--bake-pages", self.bake_pages.is_some())]
            .into_iter()
            .filter(|(_, is_given)| *is_given)
            .map(|(option, _)| option)
    }

    /// The first option that was given.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.all_given().next()
    }

    /// A line for each option that has no effect where `--texture auto` makes no new texture; `may_follow` if one is made
    /// where the input's charts leave too many triangles, `obstacle` if none can be made.
    pub(super) fn notes(
        &self,
        ktx2: Option<TextureMode>,
        may_follow: bool,
        obstacle: Option<&str>,
    ) -> Vec<String> {
        let why = match (may_follow, obstacle) {
            (true, _) => {
                " unless the input's charts leave too many triangles; --texture bake makes one"
            }
            (false, None) => "; --texture bake makes one",
            (false, Some(what)) => &format!(": {what}"),
        };
        let note = |option: String| format!("{option} has no effect: no new texture is made{why}");
        let ktx2 = ktx2.map(|mode| format!("--textures {}", mode.name()));
        self.all_given().map(str::to_owned).chain(ktx2).map(note).collect()
    }

    /// The settings of a new texture, with or without normal maps.
    pub(super) fn settings(&self, normals: bool) -> BakeSettings {
        let default = BakeSettings::default();
        BakeSettings {
            page_size: self.bake_size.unwrap_or(default.page_size),
            most_pages: self.bake_pages.or(default.most_pages),
            normals,
        }
    }
}
