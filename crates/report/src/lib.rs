//! Bytes and errors: the figures that a bake, `inspect` and `verify` print, as plain structs, as JSON with a
//! schema and a version, and as a table for a terminal.
//!
//! Nothing here measures: each stage knows its own bytes and errors, this crate sums, names and shows them.
//!
//! | module | what |
//! |---|---|
//! | [`errors`] | distribution of the absolute error at points |
//! | [`bytes`] | bytes as the GPU holds them, and the two baselines |
//! | [`table`] | the report as text |

pub mod bytes;
pub mod errors;
pub mod table;

use serde::{Deserialize, Serialize};

pub use bytes::{Bytes, Contributor, FullLightmap, LightBytes, bytes_text};
pub use errors::ErrorSummary;

/// Version of the JSON form; it changes when a field changes its meaning or goes away.
pub const SCHEMA_VERSION: u32 = 1;

/// What a bake did, what it costs, and what it is worth. See `docs/report.schema.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Report {
    /// [`SCHEMA_VERSION`].
    pub version: u32,
    /// Program and version.
    pub generator: String,
    /// File name that was read.
    pub input: String,
    /// File name that was written.
    pub output: String,
    /// What was asked for, with every default filled in.
    pub settings: Settings,
    /// What the file holds.
    pub scene: SceneFigures,
    /// Triangles and area by class.
    pub classes: Classes,
    /// Samples and rays.
    pub rays: RayFigures,
    /// Charts and atlas.
    pub atlas: AtlasFigures,
    /// Errors at fresh points that no fit and no decision has seen.
    pub errors: Errors,
    /// Bytes as the GPU holds them.
    pub bytes: Bytes,
    /// Wall-clock seconds per stage, in order.
    pub stages: Vec<Stage>,
    /// Largest resident memory of the process so far, where the system tells.
    pub peak_memory_bytes: Option<u64>,
    /// What the user should know, most frequent first.
    pub warnings: Vec<String>,
}

/// What was asked for, with every default filled in.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Settings {
    /// Name of the signal.
    pub signal: String,
    /// How the light stands in the file: `eta`, `stock`, `texcoord` or `lightmap`.
    #[serde(default = "eta")]
    pub profile: String,
    /// Largest absolute error allowed, as a share of the signal's range.
    pub max_error: f32,
    /// Smallest feature kept, in units of the file.
    pub detail: f32,
    /// Poisson radius and width of a texel: half the detail.
    pub radius: f32,
    /// Preset: `draft`, `normal` or `final`.
    pub quality: String,
    /// What took the noise out of light in lux: `own`, `oidn` or `none`.
    #[serde(default = "own")]
    pub denoiser: String,
    /// Rays end here, in units of the file; none = unbounded.
    pub ao_distance: Option<f32>,
    /// Seed of every random number.
    pub seed: u64,
}

/// Reports of before there was a choice.
fn eta() -> String {
    "eta".to_owned()
}

/// Reports of before there was a choice.
fn own() -> String {
    "own".to_owned()
}

/// What the file holds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SceneFigures {
    /// Nodes that draw triangles (GPU instances counted one by one).
    pub instances: usize,
    /// Triangles drawn.
    pub triangles: usize,
    /// Of them without area.
    pub degenerate_triangles: usize,
    /// glTF vertices drawn.
    pub gltf_vertices: usize,
    /// Light vertices after welding.
    pub light_vertices: usize,
    /// Pieces connected through light vertices.
    pub sheets: usize,
    /// Surface area in square units of the file.
    pub area: f64,
    /// Diagonal of the bounding box in units of the file.
    pub diagonal: f64,
}

/// Triangles and area of one class.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Class {
    /// How many triangles.
    pub triangles: usize,
    /// Their share of the surface area, `0..=1`.
    pub area_share: f64,
}

/// Triangles and area by class.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Classes {
    /// Texture triangles.
    pub texture: Class,
    /// Color triangles with a texture-vertex: blended.
    pub mixed: Class,
    /// Color triangles with three color-vertices.
    pub color: Class,
    /// Texture triangles before closing: where the bound asked for them.
    pub texture_before_closing: Class,
    /// The error beyond which a triangle was given texels: the bound, or less where fresh points asked for it.
    pub decision_bound: f32,
    /// Rounds of charting, encoding and checking.
    pub rounds: usize,
    /// Color triangles promoted because the decoded light broke the bound.
    pub promoted: usize,
    /// Triangles promoted because texels are cheaper than split vertices.
    pub promoted_for_bytes: usize,
}

/// Samples and rays.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct RayFigures {
    /// Poisson samples.
    pub poisson_samples: usize,
    /// Samples added for light vertices that saw none.
    pub support_samples: usize,
    /// Samples inside other geometry, which no fit uses.
    pub invalid_samples: usize,
    /// Texels shaded.
    pub shaded_texels: usize,
    /// Rays for samples.
    pub sample_rays: u64,
    /// Rays for texels.
    pub texel_rays: u64,
    /// Rays for references.
    pub verify_rays: u64,
    /// Median standard error of a sample's value.
    pub sample_noise_median: f32,
    /// 99 % of the samples have at most this standard error.
    pub sample_noise_p99: f32,
}

/// Charts and atlas.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct AtlasFigures {
    /// Charts.
    pub charts: usize,
    /// Width of a page in texels.
    pub width: u32,
    /// Height of a page in texels.
    pub height: u32,
    /// Pages.
    pub pages: u32,
    /// Bits of a texel.
    pub bits: u32,
    /// Texels of all pages.
    pub texels: u64,
    /// Texels that a lookup inside a chart can touch.
    pub shown_texels: u64,
    /// Largest disagreement across a seam before stitching.
    pub seam_before: f32,
    /// Largest disagreement across a seam after stitching.
    pub seam_after: f32,
}

/// Errors at fresh points, each the absolute difference to a converged reference.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Errors {
    /// Fresh points, and rays of each reference.
    pub points: usize,
    /// Rays of each reference; 0 where light is looked up in an image.
    pub rays_per_point: u32,
    /// Fresh points inside other geometry, which are left out.
    pub hidden_points: usize,
    /// The light sampled at the vertices.
    pub point_sampling: Option<ErrorSummary>,
    /// Least-squares vertex values alone.
    pub least_squares: Option<ErrorSummary>,
    /// What the written file shows.
    pub hybrid: ErrorSummary,
    /// The same, in color triangles only (mixed ones included).
    pub color: ErrorSummary,
    /// The same, in texture triangles only.
    pub texture: ErrorSummary,
    /// What the written file shows, layer by layer.
    pub layers: Vec<LayerError>,
    /// What the bound says of all this.
    pub bound: BoundCheck,
    /// The nodes with most fresh points in texture triangles beyond the bound, most first: there texels are too
    /// coarse for the light.
    pub coarse: Vec<Coarse>,
}

/// The error of one layer.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct LayerError {
    /// The layer's signal.
    pub signal: String,
    /// What the written file shows of it.
    pub hybrid: ErrorSummary,
}

/// A node whose texels are too coarse for its light.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Coarse {
    /// The node.
    pub name: String,
    /// Fresh points in its texture triangles beyond the bound.
    pub points: usize,
}

/// Does the promise hold?
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct BoundCheck {
    /// The bound.
    pub limit: f32,
    /// An error counts as beyond the bound when it exceeds it by this many standard errors of the noise.
    pub confidence: f32,
    /// Samples in color triangles that the written file shows wrong beyond bound and noise.
    pub samples_beyond: usize,
    /// Samples in color triangles that were checked.
    pub samples_checked: usize,
    /// Fresh points in color triangles beyond bound and noise.
    pub color_points_beyond: usize,
    /// Fresh points in color triangles.
    pub color_points: usize,
    /// Fresh points in texture triangles beyond bound and noise: there the texels are too coarse.
    pub texture_points_beyond: usize,
    /// Fresh points in texture triangles.
    pub texture_points: usize,
}

/// Share of fresh points in color triangles that may lie beyond bound and noise before a bake counts as
/// broken: features smaller than the detail that was asked for fall between the samples.
pub const TOLERATED_SHARE: f64 = 0.01;

impl BoundCheck {
    /// Share of the fresh points in color triangles beyond bound and noise.
    pub fn color_share_beyond(&self) -> f64 {
        if self.color_points == 0 { 0.0 } else { self.color_points_beyond as f64 / self.color_points as f64 }
    }

    /// Whether the bound holds: no sample in a color triangle is beyond it, and of the fresh points there at
    /// most [`TOLERATED_SHARE`], but one in any case: a single point out of a few says nothing of shares.
    pub fn kept(&self) -> bool {
        let tolerated = (TOLERATED_SHARE * self.color_points as f64).max(1.0);
        self.samples_beyond == 0 && self.color_points_beyond as f64 <= tolerated
    }
}

/// Seconds of one stage.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Stage {
    /// The stage's name, as DESIGN has it.
    pub name: String,
    /// Wall-clock seconds.
    pub seconds: f64,
}

impl Report {
    /// The report as JSON, indented, with a final newline.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a report holds only numbers and strings");
        text.push('\n');
        text
    }
}
