//! Packing: places charts in the pages of the atlas (Schaefer 2012, section 4.2, last step).
//!
//! | module | what |
//! |---|---|
//! | [`footprint`](mod@footprint) | the 4 x 4-texel blocks that a chart occupies |
//! | `blocks` | the default packer: block bitmaps, lowest place first (after Lévy et al. 2002) |
//! | `uvunwrap`, `xatlas` | packers of others, each behind the cargo feature of its name |
//! | `rigid` | holds those two to our promises |
//! | `check` | no two charts share a block, everything inside the page |
//!
//! All packers place charts rigidly: by a translation of whole blocks, and perhaps a quarter turn. A chart's
//! texels therefore stay what they were in its own grid, and its coordinates stay on the grid of the codes.

mod blocks;
mod check;
mod footprint;
#[cfg(any(feature = "uvunwrap", feature = "xatlas"))]
mod rigid;
#[cfg(test)]
mod tests;
#[cfg(feature = "uvunwrap")]
mod uvunwrap;
#[cfg(feature = "xatlas")]
mod xatlas;

use crate::Chart;
use glam::Vec2;

pub use check::{block_fill, check};
pub use footprint::{Footprint, footprint};

/// Texels along a side of a block: what block compression codes at once.
pub const BLOCK: u32 = 4;

/// Widest page in texels.
pub const MAX_PAGE: u32 = 4096;

/// Texel rows that the code of an atlas position can name, all pages stacked: 12 bits and 3 bits of subtexels.
pub const MAX_STACK: u32 = 4095;

/// How charts are packed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackOptions {
    /// Texels kept around every chart: those of the charts, at least 1.
    pub gutter: u32,
    /// Texels per side of the largest page, at most [`MAX_PAGE`].
    pub max_page: u32,
    /// Which packer.
    pub packer: Packer,
}

impl Default for PackOptions {
    fn default() -> Self {
        Self { gutter: 1, max_page: MAX_PAGE, packer: Packer::Blocks }
    }
}

/// The packers. All keep the same promises; docs/PACKING.md compares them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packer {
    /// Our own, on bitmaps of blocks.
    #[default]
    Blocks,
    /// uvunwrap's, which nests shapes but does not turn them here. One page only.
    #[cfg(feature = "uvunwrap")]
    Uvunwrap,
    /// xatlas's exhaustive search, without turns. One page only.
    #[cfg(feature = "xatlas")]
    Xatlas,
}

impl Packer {
    /// All packers that this build has.
    pub const ALL: &[Self] = &[
        Self::Blocks,
        #[cfg(feature = "uvunwrap")]
        Self::Uvunwrap,
        #[cfg(feature = "xatlas")]
        Self::Xatlas,
    ];
}

/// Where a chart lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// The page.
    pub page: u32,
    /// The lowest corner of the chart's grid on the page, after the turn: texels, multiples of 4.
    pub origin: [u32; 2],
    /// A quarter turn counter-clockwise: (x, y) goes to (h - y, x), (w, h) being the chart's size before it.
    pub turned: bool,
}

/// Where all charts lie.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Packing {
    /// One per chart.
    pub placements: Vec<Placement>,
    /// Width and height of every page in texels, multiples of 4; zero without charts.
    pub page_size: [u32; 2],
    /// Number of pages, all of one size.
    pub pages: u32,
}

impl Packing {
    /// Texels of all pages: what the atlas costs.
    pub fn page_texels(&self) -> u64 {
        u64::from(self.pages) * u64::from(self.page_size[0]) * u64::from(self.page_size[1])
    }
}

/// What keeps charts from being packed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PackError {
    /// A chart has a size that is no multiple of 4, a corner without vertex, or a coordinate outside its grid.
    #[error("chart {chart} is malformed: its size, corners or coordinates do not fit its grid")]
    Malformed {
        /// The chart's number.
        chart: u32,
    },
    /// A chart is larger than a page.
    #[error("chart {chart} of {} x {} texels does not fit a page of {} x {}", size[0], size[1], page[0], page[1])]
    ChartTooLarge {
        /// The chart's number.
        chart: u32,
        /// Its size in texels.
        size: [u32; 2],
        /// The largest page in texels.
        page: [u32; 2],
    },
    /// The charts need more texels than an atlas may have.
    #[error(
        "the charts need {texels} texels, an atlas has at most {limit}; a detail {:.1} times as coarse would fit",
        detail_factor(*texels, *limit)
    )]
    AtlasFull {
        /// Texels of all blocks that charts occupy.
        texels: u64,
        /// Texels of the largest atlas.
        limit: u64,
    },
    /// A packing breaks the block rule or leaves the page.
    #[error("chart {chart} is placed outside its page or on blocks of another chart")]
    Overlap {
        /// The later of the two charts.
        chart: u32,
    },
    /// A packer that makes one page made one that is too wide or too high.
    #[error("a page of {} x {} texels was made, the largest is {} x {}", size[0], size[1], page[0], page[1])]
    PageTooLarge {
        /// Its size in texels.
        size: [u32; 2],
        /// The largest page in texels.
        page: [u32; 2],
    },
    /// A packer gave no result, or moved a chart in a way that is no translation.
    #[error("packer {packer:?} did not keep the charts as they are")]
    Refused {
        /// The packer.
        packer: Packer,
    },
    /// A packing has not one placement per chart.
    #[error("{placements} placements for {charts} charts")]
    Count {
        /// Placements.
        placements: usize,
        /// Charts.
        charts: usize,
    },
}

/// Texels shrink with the square of the detail; a fifth of the pages stays empty.
fn detail_factor(texels: u64, limit: u64) -> f64 {
    (texels as f64 / (0.8 * limit as f64)).sqrt().max(1.1)
}

/// What an atlas may be, in blocks.
struct Limits {
    width: u32,
    height: u32,
    stack: u32,
}

fn limits(options: &PackOptions) -> Limits {
    let side = options.max_page.min(MAX_PAGE) / BLOCK;
    let stack = MAX_STACK / BLOCK;
    Limits { width: side, height: side.min(stack), stack }
}

/// Places charts so that no 4 x 4-texel block holds parts of two of them, gutter included.
///
/// The page is as small as was found, need be neither square nor a power of two, and has at most `max_page` texels
/// a side; several equal pages are made when one is full. Empty input gives no pages. Deterministic: any number of
/// threads gives the same packing.
///
/// # Errors
/// [`PackError::Malformed`], [`PackError::ChartTooLarge`] or [`PackError::AtlasFull`].
pub fn pack(charts: &[Chart], options: &PackOptions) -> Result<Packing, PackError> {
    let footprints = footprints(charts, options.gutter)?;
    if charts.is_empty() {
        return Ok(Packing::default());
    }
    let limits = limits(options);
    for (chart, footprint) in footprints.iter().enumerate() {
        let [width, height] = footprint.size();
        let fits = |w, h| w <= limits.width && h <= limits.height;
        if !fits(width, height) && !fits(height, width) {
            return Err(PackError::ChartTooLarge {
                chart: chart as u32,
                size: [width * BLOCK, height * BLOCK],
                page: [limits.width * BLOCK, limits.height * BLOCK],
            });
        }
    }
    match options.packer {
        Packer::Blocks => blocks::pack(&footprints, &limits),
        #[cfg(feature = "uvunwrap")]
        Packer::Uvunwrap => uvunwrap::pack(&footprints, options),
        #[cfg(feature = "xatlas")]
        Packer::Xatlas => xatlas::pack(&footprints, options),
    }
}

/// The footprints of all charts, in their order.
fn footprints(charts: &[Chart], gutter: u32) -> Result<Vec<Footprint>, PackError> {
    charts.iter().enumerate().map(|(number, chart)| footprint(chart, number, gutter)).collect()
}

/// A chart coordinate in texels of its page: the turn, then the origin.
///
/// `uv` and `chart_size` are in texels of the chart's own grid.
pub fn placed_uv(uv: Vec2, chart_size: [u32; 2], placement: Placement) -> [f32; 2] {
    let [x, y] = placement.origin.map(|texels| texels as f32);
    if placement.turned { [x + chart_size[1] as f32 - uv.y, y + uv.x] } else { [x + uv.x, y + uv.y] }
}

/// A texel of the chart's grid as a texel of its page: [`placed_uv`] for texel centres.
pub fn placed_texel([i, j]: [u32; 2], chart_size: [u32; 2], placement: Placement) -> [u32; 2] {
    let [x, y] = placement.origin;
    if placement.turned { [x + chart_size[1] - 1 - j, y + i] } else { [x + i, y + j] }
}

/// The area of all chart triangles in texels.
pub fn chart_texels(charts: &[Chart]) -> f64 {
    charts.iter().map(triangle_texels).sum()
}

fn triangle_texels(chart: &Chart) -> f64 {
    let area = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|vertex| chart.uv[vertex as usize].as_dvec2());
        0.5 * (b - a).perp_dot(c - a).abs()
    };
    chart.corners.iter().map(area).sum()
}

/// The share of the atlas that lies inside chart triangles, 0..=1; 1 without pages.
pub fn fill_rate(charts: &[Chart], packing: &Packing) -> f64 {
    match packing.page_texels() {
        0 => 1.0,
        texels => chart_texels(charts) / texels as f64,
    }
}
