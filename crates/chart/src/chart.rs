//! What a chart is: a topological disk of texture triangles with a position in the plane for each vertex.

use glam::Vec2;
use lightkiln_mesh::{TriangleId, VertexId};

use crate::place::size_for;

/// Chart coordinates are multiples of `1 / SUBTEXELS` texel: the grid of the packed attribute.
pub const SUBTEXELS: u32 = 8;

/// A chart: an index into the list that `charts` returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct ChartId(pub u32);

impl ChartId {
    /// The index as an array index.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// Connected texture triangles that share one map to the plane.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Ascending.
    pub triangles: Vec<TriangleId>,
    /// The light vertex behind each chart vertex. A light vertex appears more than once where a cut of the
    /// chart runs through it.
    pub vertices: Vec<VertexId>,
    /// Per entry of `triangles`: chart vertices, in the corner order of the mesh triangle.
    pub corners: Vec<[u32; 3]>,
    /// Per chart vertex, in texels of the chart's own grid: texel (i, j) has its centre at (i + 0.5, j + 0.5).
    /// Multiples of `1 / SUBTEXELS`; gutter included, so no coordinate lies below it.
    pub uv: Vec<Vec2>,
    /// Texels, multiples of 4, gutter included on all four sides.
    pub size: [u32; 2],
}

impl Chart {
    /// The same chart in a grid of its own with texels of another width, and where it lies there: a point `p` of this one
    /// lies at `p * factor + shift`, vertices within half a step of `1 / SUBTEXELS`.
    ///
    /// - `factor`: texels of the new grid along one of this
    pub fn scaled(&self, factor: f32, gutter: u32) -> (Self, Vec2) {
        let low = self.uv.iter().fold(Vec2::INFINITY, |low, &p| low.min(p));
        let shift = Vec2::splat(gutter as f32 + 0.5) - low * factor;
        let steps = SUBTEXELS as f32;
        let uv: Vec<Vec2> = self.uv.iter().map(|&p| ((p * factor + shift) * steps).round() / steps).collect();
        let high = uv.iter().fold(Vec2::ZERO, |high, &p| high.max(p));
        let size = [high.x, high.y].map(|high| size_for(f64::from(high) - f64::from(gutter), gutter));
        (Self { uv, size, ..self.clone() }, shift)
    }
}

/// What keeps charts from being made or packed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChartError {
    /// The texel size is zero, negative, NaN or infinite.
    #[error("texel size {texel_size} is not a positive length")]
    TexelSize {
        /// World units per texel.
        texel_size: f32,
    },
    /// The largest size leaves no room between the gutters, or texel coordinates would not fit their type.
    #[error("charts of at most {max_size} texels with a gutter of {gutter} cannot hold a triangle")]
    MaxSize {
        /// Texels per side.
        max_size: u32,
        /// Texels.
        gutter: u32,
    },
    /// A region names a triangle that the mesh does not have.
    #[error("region {region} names triangle {triangle} of {triangles}")]
    Triangle {
        /// The region.
        region: usize,
        /// The triangle that it names.
        triangle: u32,
        /// How many triangles there are.
        triangles: usize,
    },
    /// A triangle stands in two regions, or twice in one.
    #[error("triangle {triangle} of region {region} stands in a region already")]
    Duplicate {
        /// The region in which it is met again.
        region: usize,
        /// The triangle.
        triangle: u32,
    },
}
