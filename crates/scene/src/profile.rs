//! How light stands in a file: the profiles of docs/FORMAT.md.

use crate::baked::Fallback;

/// How light stands in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Profile {
    /// Codes in an attribute of our own, 4 bytes a vertex and layer, shown by a shader.
    #[default]
    Eta,
    /// The same as pairs of floats in a set of texture coordinates, 8 bytes a vertex and layer (Schaefer 2012, 4.4).
    Texcoord,
    /// Texture coordinates of one image with charts and a strip of all values; materials show it as their occlusion.
    Stock,
    /// Texture coordinates of a full lightmap; materials show it as their occlusion or as a lightmap.
    Lightmap,
}

impl Profile {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Eta, Self::Texcoord, Self::Stock, Self::Lightmap];

    /// What the command line and the extension call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Eta => "eta",
            Self::Texcoord => "texcoord",
            Self::Stock => "stock",
            Self::Lightmap => "lightmap",
        }
    }

    /// Whether materials show the light, so that viewers need nothing of ours.
    pub fn is_plain(self) -> bool {
        matches!(self, Self::Stock | Self::Lightmap)
    }

    /// Bytes of one attribute at a vertex.
    pub fn stride(self) -> usize {
        if self == Self::Texcoord { 8 } else { 4 }
    }

    /// Attributes with light at a vertex.
    pub fn attributes(self, layers: usize) -> usize {
        if self.is_plain() { layers.min(1) } else { layers }
    }

    /// What viewers see that do not know the extension: plain profiles need no fallback.
    pub fn fallback(self, asked: Fallback) -> Fallback {
        if self.is_plain() { Fallback::None } else { asked }
    }
}

impl std::str::FromStr for Profile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|profile| profile.name() == text);
        found.ok_or_else(|| format!("{text:?} is no profile: eta, stock, texcoord or lightmap"))
    }
}
