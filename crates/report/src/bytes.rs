//! Bytes as the GPU holds them.
//!
//! | part | how it is counted |
//! |---|---|
//! | light attribute | 4 bytes a layer for every vertex that a baked primitive draws, added ones included |
//! | added vertices | the full stride of each vertex that a chart border split, light attribute not counted twice |
//! | atlas | every texel of every page at the file's bit depth, times 4/3 for a full mip chain |
//! | tables | every entry of the colors that codes name |
//! | fallback | `COLOR_0`, 4 bytes a vertex, only where it was added; listed apart: `--fallback none` saves it |

use serde::{Deserialize, Serialize};

/// Bytes that the light of a scene costs, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct LightBytes {
    /// The light attribute of all vertices.
    pub attribute: u64,
    /// Vertices added by splits, at their full stride.
    pub added_vertices: u64,
    /// The atlas without mip levels.
    pub atlas: u64,
    /// Mip levels of the atlas.
    pub mips: u64,
    /// Tables of colors, where codes name their entries.
    #[serde(default)]
    pub tables: u64,
}

impl LightBytes {
    /// All of it.
    pub fn total(&self) -> u64 {
        self.attribute + self.added_vertices + self.atlas + self.mips + self.tables
    }

    /// Bytes of the mip levels of an atlas of that many bytes: a full chain is a third more.
    pub fn mips_of(atlas: u64) -> u64 {
        atlas.div_ceil(3)
    }
}

/// The baseline of one lightmap over everything at the same texel density. It is computed, not made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct FullLightmap {
    /// Its bytes: UV attribute, split vertices, texels and mips.
    pub bytes: LightBytes,
    /// Texels over all, from the surface area and the fill.
    pub texels: u64,
    /// Share of the atlas that shows light; measured on this bake's charts, else assumed.
    pub fill: f64,
    /// Vertices after splitting per vertex before; measured on this bake's charts, else assumed.
    pub vertex_ratio: f64,
    /// Whether `fill` and `vertex_ratio` were measured on this scene.
    pub measured: bool,
}

/// One of the largest contributors to the bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Contributor {
    /// What it is: a node or the atlas, with its name.
    pub name: String,
    /// Its bytes.
    pub bytes: u64,
    /// Of them texels.
    pub texel_bytes: u64,
}

/// Bytes as the GPU holds them, with baselines.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Bytes {
    /// What this file's light costs.
    pub light: LightBytes,
    /// Sum of `light`.
    pub total: u64,
    /// Bytes of texels in the atlas (without mips) that no lookup touches.
    pub atlas_waste: u64,
    /// The `COLOR_0` fallback.
    pub fallback: u64,
    /// Vertices added by splits.
    pub added_vertices: u64,
    /// Baseline: a light attribute at every vertex and no texture.
    pub vertices_only: u64,
    /// Baseline: one lightmap for all, computed.
    pub full_lightmap: FullLightmap,
    /// The full vertex and index data of the scene without light, for scale.
    pub geometry: u64,
    /// Bytes of the files written.
    pub files: u64,
    /// The largest contributors, largest first.
    pub largest: Vec<Contributor>,
    /// GPU instances and shared accessors that had to be written apart because each shows its own light.
    pub instances_unshared: usize,
}

/// Bytes for people: `812 B`, `4.2 kiB`, `17.3 MiB`.
pub fn bytes_text(bytes: u64) -> String {
    match bytes {
        0..=1023 => format!("{bytes} B"),
        1024..=1_048_575 => format!("{:.1} kiB", bytes as f64 / 1024.0),
        1_048_576..=1_073_741_823 => format!("{:.2} MiB", bytes as f64 / 1_048_576.0),
        _ => format!("{:.2} GiB", bytes as f64 / 1_073_741_824.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_text_chooses_the_unit() {
        assert_eq!(bytes_text(812), "812 B");
        assert_eq!(bytes_text(4300), "4.2 kiB");
        assert_eq!(bytes_text(18_140_365), "17.30 MiB");
    }

    #[test]
    fn light_bytes_total_is_the_sum() {
        let light = LightBytes {
            attribute: 4,
            added_vertices: 36,
            atlas: 48,
            mips: LightBytes::mips_of(48),
            tables: 0,
        };
        assert_eq!(light.total(), 4 + 36 + 48 + 16);
    }
}
