//! Treatments of an input's images, by the words of `--textures`.

/// Treatment of images, as `--textures` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureMode {
    /// Beside the output, unless they lie in its folder or below already.
    Copy,
    /// Named in their places.
    Link,
    /// In the output; GLB only.
    Embed,
    /// Nowhere; coordinates and materials stay.
    None,
    /// New ones in a GLB, as KTX2 of UASTC.
    Ktx2,
    /// The same of ETC1S.
    Etc1s,
}

impl TextureMode {
    /// True if new images become KTX2.
    pub fn is_ktx2(self) -> bool {
        matches!(self, TextureMode::Ktx2 | TextureMode::Etc1s)
    }

    /// The word of the option.
    pub fn name(self) -> &'static str {
        match self {
            TextureMode::Copy => "copy",
            TextureMode::Link => "link",
            TextureMode::Embed => "embed",
            TextureMode::None => "none",
            TextureMode::Ktx2 => "ktx2",
            TextureMode::Etc1s => "etc1s",
        }
    }
}

impl std::str::FromStr for TextureMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        use TextureMode::{Copy, Embed, Etc1s, Ktx2, Link};
        let all = [Copy, Link, Embed, TextureMode::None, Ktx2, Etc1s];
        let found = all.into_iter().find(|mode| mode.name() == text);
        found.ok_or_else(|| format!("'{text}' is none of copy, link, embed, none, ktx2, etc1s"))
    }
}
