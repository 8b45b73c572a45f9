//! Texels: lifting, baking support, stitching, dilation, image formats. Schaefer 2012, section 4.2.
//!
//! | module | what |
//! |---|---|
//! | [`grid`] | which texels a lookup reads, and which a triangle needs |
//! | [`mod@lift`] | the surface point whose light a texel shows |
//! | `prepare` | invalid texels are filled, those beyond the end of the surface extrapolated |
//! | [`observe`] | texels fitted to more values than their own |
//! | `seams` | where the map to the atlas breaks |
//! | [`mod@stitch`] | least squares: both sides of every seam read the same |
//! | [`fill`] | push-pull |
//! | [`mod@compose`] | charts into pages |
//! | [`image`], [`image_exr`], [`ktx2`] | PNG, EXR, KTX2 |
//! | [`rgb9e5`] | light in 32 bits |
//!
//! Values of a chart are a flat array, texels x channels, in the chart's own grid; nothing here knows what a
//! channel means. Only the image modules know file formats, and they take writers and bytes.

pub mod compose;
pub mod fill;
pub mod grid;
pub mod image;
pub mod image_exr;
pub mod ktx2;
pub mod lift;
mod normal;
pub mod observe;
mod prepare;
pub mod rgb9e5;
mod seams;
pub mod stitch;

pub use compose::{Atlas, compose};
pub use grid::{Footprint, lookup};
pub use image::{Image, ImageError, PngDepth, read_png, write_png};
pub use image_exr::{ExrDepth, ExrLayer, read_exr, write_exr, write_exr_layers};
pub use ktx2::{Ktx2Format, read_ktx2, write_ktx2};
pub use lift::{ChartTexels, Outside, lift};
pub use observe::Observations;
pub use stitch::{Hold, Mismatch, StitchOptions, StitchReport, stitch, vertex_readback};

use lightkiln_chart::Chart;
use lightkiln_mesh::Mesh;

/// Input that does not fit together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TexelError {
    /// An array has the wrong length.
    #[error("{found} {what} where chart {chart} has {expected}")]
    Length {
        /// What the array holds.
        what: &'static str,
        /// The chart, or the number of charts where the array has one entry per chart.
        chart: usize,
        /// Its length.
        found: usize,
        /// What its length should be.
        expected: usize,
    },
    /// Values need at least one channel.
    #[error("{channels} channels")]
    Channels {
        /// Values per texel.
        channels: usize,
    },
    /// A chart does not fit the mesh or its own grid.
    #[error("chart {chart}: {fault}")]
    Chart {
        /// The chart.
        chart: usize,
        /// What is wrong with it.
        fault: ChartFault,
    },
    /// A hold names an unknown chart, or has a wrong number of values, or one that is not finite.
    #[error("hold {hold} does not fit its chart")]
    Hold {
        /// The hold.
        hold: usize,
    },
    /// Observations are not finite, or their starts do not ascend.
    #[error("observations are not finite or out of order")]
    Observations,
    /// A chart is not aligned to 4 texels, has another size than its texels, or leaves its page.
    #[error("chart {chart} does not fit where it is placed")]
    Placement {
        /// The chart.
        chart: usize,
    },
    /// Two charts show texels in one block of 4 x 4.
    #[error("charts {} and {} share a block of 4 x 4 texels", charts[0], charts[1])]
    SharedBlock {
        /// The two charts.
        charts: [usize; 2],
    },
}

/// What is wrong with a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ChartFault {
    /// Triangles, corners, vertices and uv are not as many as they should be.
    #[error("its arrays do not fit each other")]
    Arrays,
    /// It names a triangle or vertex that does not exist.
    #[error("it names a triangle or vertex that does not exist")]
    Index,
    /// A uv is not finite or lies outside the grid.
    #[error("its coordinates leave its grid")]
    Coordinates,
}

/// Everything that the crate relies on when it indexes with a chart's numbers.
pub(crate) fn check_chart(mesh: &Mesh, chart: &Chart) -> Result<(), ChartFault> {
    if chart.corners.len() != chart.triangles.len() || chart.uv.len() != chart.vertices.len() {
        return Err(ChartFault::Arrays);
    }
    let known = chart.triangles.iter().all(|t| t.index() < mesh.triangle_count())
        && chart.vertices.iter().all(|v| v.index() < mesh.vertex_count())
        && chart.corners.iter().flatten().all(|&c| (c as usize) < chart.uv.len());
    if !known {
        return Err(ChartFault::Index);
    }
    let [width, height] = chart.size.map(|s| s as f32);
    let inside = |uv: &glam::Vec2| (0.0..=width).contains(&uv.x) && (0.0..=height).contains(&uv.y);
    let grid = chart.triangles.is_empty() || chart.size.iter().all(|s| (1..=1 << 16).contains(s));
    if grid && chart.uv.iter().all(inside) { Ok(()) } else { Err(ChartFault::Coordinates) }
}
