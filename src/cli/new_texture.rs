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
    /// where the input's charts leave too many triangles.
    pub(super) fn notes(&self, ktx2: Option<TextureMode>, may_follow: bool) -> Vec<String> {
        let unless = match may_follow {
            true => " unless the input's charts leave too many triangles",
            false => "",
        };
        let note = |option: String| {
            format!(
                "{option} has no effect: no new texture is made{unless}; --texture bake makes one"
            )
        };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::simplify::Args;
    use crate::error::Error;
    use clap::Parser;

    #[derive(Parser)]
    struct Typed {
        #[command(flatten)]
        args: Args,
    }

    /// The refusal of `options`; empty if there is none.
    fn refusal(options: &str) -> String {
        let words = "simplify in.obj out.glb --ratio 5%".split(' ').chain(options.split(' '));
        match Typed::parse_from(words).args.config() {
            Ok(_) => String::new(),
            Err(Error::Usage(what)) => what,
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn pages_are_refused_where_no_new_texture_is_made() {
        for page in ["--bake-size 512", "--bake-pages 2"] {
            for other in [
                "--texture keep",
                "--texture none",
                "--drop-texture",
                "--progressive out.pm",
                "--method cluster",
                "--method decimate",
                "--method retile",
            ] {
                let said = refusal(&format!("{page} {other}"));
                let option = page.split(' ').next().unwrap();
                assert!(said.starts_with(option), "{page} {other}: {said}");
            }
            for other in ["--texture auto", "--texture bake", "--bake-normals"] {
                assert_eq!(refusal(&format!("{page} {other}")), "");
            }
        }
        // The default size is an option like any other.
        assert!(!refusal("--bake-size 4096 --texture keep").is_empty());
        // Other methods give the texture up.
        for method in ["cluster", "decimate", "retile"] {
            let said = refusal(&format!("--method {method} --texture keep"));
            assert!(said.starts_with("--texture keep"), "{said}");
            assert_eq!(refusal(&format!("--method {method} --texture none")), "");
        }
    }

    #[test]
    fn pages_without_effect_are_named() {
        let pages = TypedPages { bake_size: Some(512), bake_pages: Some(1) };
        let notes = pages.notes(Some(TextureMode::Ktx2), true);
        assert_eq!(notes.len(), 3);
        assert!(notes[0].starts_with("--bake-size") && notes[1].starts_with("--bake-pages"));
        assert!(notes[2].starts_with("--textures ktx2 has no effect"));
        assert!(notes.iter().all(|note| note.contains("too many triangles")), "{notes:?}");
        assert!(TypedPages { bake_size: None, bake_pages: None }.notes(None, false).is_empty());
        assert_eq!(pages.settings(true).page_size, 512);
    }
}
