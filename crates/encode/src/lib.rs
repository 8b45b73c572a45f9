//! One packed attribute per vertex, and the decoder that is the shader's CPU twin.
//!
//! Schaefer 2012, sections 4.3 (the blend of vertex and texture values) and 4.4 (one attribute for both).
//! A corner of a triangle carries either a value or a place in the atlas, in 4 bytes. The shaders in
//! `shaders/` turn three of them into light without a seam; [`decode()`] does the same on the CPU.
//!
//! | module | what |
//! |---|---|
//! | [`constants`] | the numbers that the shaders and this crate must agree on |
//! | [`code`] | the 4 bytes: [`LightCode`] |
//! | [`table`] | the colors of a layer in a texture, for the form that needs one |
//! | [`mixed`] | which corner shows what: the cases of section 4.3 and the ones that it leaves out |
//! | [`promote`] | color triangles that cost fewer bytes as texture triangles |
//! | [`encode`](mod@encode) | charts, packing and vertex values into [`Codes`] |
//! | [`decode`](mod@decode) | codes, barycentric coordinates and atlas into light, as a GPU does |
//! | [`coordinates`] | the same without a shader: texture coordinates, and a strip of all values |

#[cfg(test)]
mod cases;
pub mod code;
pub mod constants;
pub mod coordinates;
pub mod decode;
pub mod encode;
pub mod mixed;
pub mod promote;
#[cfg(test)]
mod shaders;
pub mod table;
#[cfg(test)]
mod testing;

pub use code::LightCode;
pub use coordinates::{Coordinates, Strip, decode_coordinates};
pub use decode::{AtlasView, Form, ShaderScale, Texels, clamp, decode, decode_scalar, unscale};
pub use encode::{Codes, EncodeReport, atlas_position, encode};
pub use promote::{PromotionPrices, promotions};
pub use table::Table;

/// What keeps light from being encoded or an atlas from being read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// An array has not one entry per triangle, vertex or chart.
    #[error("{what}: {count} entries for {expected}")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        count: usize,
        /// The length that it must have.
        expected: usize,
    },
    /// A layer has no channel, or more than a code can hold.
    #[error("{channels} channels, a layer has 1 to 3")]
    Channels {
        /// How many.
        channels: usize,
    },
    /// A table has more colors than codes can name.
    #[error("a table of {entries} colors, codes can name {limit}")]
    TableSize {
        /// How many.
        entries: usize,
        /// The most that there may be.
        limit: usize,
    },
    /// A texture triangle stands in no chart.
    #[error("texture triangle {triangle} stands in no chart")]
    Uncharted {
        /// The triangle.
        triangle: u32,
    },
    /// A triangle of a chart is no texture triangle, stands in two charts, or has other vertices than the chart says.
    #[error("chart {chart} names triangle {triangle}, which {problem}")]
    ChartTriangle {
        /// The chart's number.
        chart: usize,
        /// The triangle.
        triangle: u32,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A place in the atlas lies beyond what 16 and 15 bits can name.
    #[error(
        "chart {chart} on page {page} reaches texel ({x}, {y}) of the stacked pages, codes reach ({limit_x}, {limit_y})"
    )]
    Position {
        /// The chart's number.
        chart: usize,
        /// Its page.
        page: u32,
        /// Texels from the left.
        x: f32,
        /// Texels from the top of the first page.
        y: f32,
        /// Largest `x` that a code can hold.
        limit_x: f32,
        /// Largest `y` that a code can hold.
        limit_y: f32,
    },
    /// The value of a color-vertex, or of the atlas at a texture-vertex, is NaN or infinite.
    #[error("light vertex {vertex} has the value {value}")]
    NotFinite {
        /// The light vertex.
        vertex: u32,
        /// Its value.
        value: f32,
    },
    /// A page of an atlas does not hold width × height × channels numbers.
    #[error(
        "page {page} holds {count} numbers, {width} x {page_height} texels of {channels} channels take {expected}"
    )]
    AtlasPage {
        /// The page.
        page: usize,
        /// How many numbers it holds.
        count: usize,
        /// Texels.
        width: u32,
        /// Texels.
        page_height: u32,
        /// Numbers per texel.
        channels: u32,
        /// How many it should hold.
        expected: usize,
    },
}
