//! Which 4 x 4-texel blocks a chart occupies: conservative rasterization of its triangles, widened by the
//! gutter, into a bitmap of blocks (the bitmaps of Lévy et al. 2002, section 4, one bit per block).
//!
//! A block belongs to one chart alone, so 4 x 4 block compression and the mip levels 1 and 2 (a texel of
//! level 2 is one block) never mix two charts. A lookup at level k reads within 2^k texels of its point, at level 0
//! within half a texel plus half the texel it meets: the *reach*, `gutter` texels around every point of a
//! triangle, is therefore what makes lookups safe: 1 covers levels 0 and 1, 2 covers level 2.

use super::{BLOCK, PackError};
use crate::Chart;
use glam::{DVec2, Vec2};

/// A set of blocks as rows of 64-bit words; bit `x % 64` of word `x / 64` in row `y` is block (x, y).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Footprint {
    size: [u32; 2],
    words_per_row: usize,
    words: Vec<u64>,
}

impl Footprint {
    /// No block of `size` (width, height) blocks is taken.
    pub fn empty(size: [u32; 2]) -> Self {
        let words_per_row = (size[0] as usize).div_ceil(64).max(1);
        Self { size, words_per_row, words: vec![0; words_per_row * size[1] as usize] }
    }

    /// Width and height in blocks, taken or not.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The words of row `y`, lowest x first. Bits beyond the width are zero.
    pub fn row(&self, y: u32) -> &[u64] {
        let start = y as usize * self.words_per_row;
        &self.words[start..start + self.words_per_row]
    }

    /// Takes block (x, y), which must lie inside [`Footprint::size`].
    pub fn insert(&mut self, x: u32, y: u32) {
        self.words[y as usize * self.words_per_row + (x / 64) as usize] |= 1 << (x % 64);
    }

    /// Whether block (x, y) is taken; blocks outside are not.
    pub fn contains(&self, x: u32, y: u32) -> bool {
        x < self.size[0] && y < self.size[1] && self.row(y)[(x / 64) as usize] >> (x % 64) & 1 == 1
    }

    /// Whether texel (i, j) of the chart's grid lies in a block of the chart. Only such texels may be written
    /// to the atlas: the *grids* of two charts may overlap, their footprints never do.
    pub fn contains_texel(&self, i: u32, j: u32) -> bool {
        self.contains(i / BLOCK, j / BLOCK)
    }

    /// Number of blocks taken.
    pub fn count(&self) -> u32 {
        self.words.iter().map(|w| w.count_ones()).sum()
    }

    /// The least x and the least y of the blocks taken; `None` when there are none.
    pub fn lowest(&self) -> Option<[u32; 2]> {
        self.iter().reduce(|[low_x, low_y], [x, y]| [low_x.min(x), low_y.min(y)])
    }

    /// The blocks taken, by rows.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.size[1])
            .flat_map(move |y| (0..self.size[0]).filter(move |&x| self.contains(x, y)).map(move |x| [x, y]))
    }

    /// The footprint after a quarter turn counter-clockwise: block (x, y) goes to (h - 1 - y, x).
    pub fn turned(&self) -> Self {
        let mut turned = Self::empty([self.size[1], self.size[0]]);
        for [x, y] in self.iter() {
            turned.insert(self.size[1] - 1 - y, x);
        }
        turned
    }
}

/// The blocks of a chart's own grid that its triangles, widened by `gutter` texels on all sides, touch.
///
/// Every texel that a bilinear lookup inside the chart reads lies in one of them, for a gutter of 0 as well.
/// What would lie outside the grid is cut off: the grid holds the gutter (see [`Chart::size`]).
///
/// # Errors
/// [`PackError::Malformed`] when the size is no multiple of 4 texels, a corner names no chart vertex, or a
/// coordinate is not finite or outside the grid. `chart` is the number that the error carries.
pub fn footprint(chart: &Chart, number: usize, gutter: u32) -> Result<Footprint, PackError> {
    let malformed = || PackError::Malformed { chart: number as u32 };
    let [width, height] = chart.size;
    let inside =
        |p: &Vec2| p.cmpge(Vec2::ZERO).all() && p.cmple(Vec2::new(width as f32, height as f32)).all();
    if !width.is_multiple_of(BLOCK) || !height.is_multiple_of(BLOCK) || !chart.uv.iter().all(inside) {
        return Err(malformed());
    }
    let mut footprint = Footprint::empty([width / BLOCK, height / BLOCK]);
    let reach = f64::from(gutter).max(0.5);
    for corners in &chart.corners {
        let mut triangle = [DVec2::ZERO; 3];
        for (point, &corner) in triangle.iter_mut().zip(corners) {
            *point = chart.uv.get(corner as usize).ok_or_else(malformed)?.as_dvec2();
        }
        add_triangle(&mut footprint, triangle, reach);
    }
    Ok(footprint)
}

/// Takes every block whose square, widened by `reach`, has inner points in common with the triangle.
///
/// Separating axes: the two of the square (by the loop's bounds) and the three edge normals. Coordinates are
/// multiples of 1/8 texel below 2^13, so every product here is exact. Triangles may be slivers or points.
fn add_triangle(footprint: &mut Footprint, triangle: [DVec2; 3], reach: f64) {
    let block = f64::from(BLOCK);
    let low = triangle[0].min(triangle[1]).min(triangle[2]) - reach;
    let high = triangle[0].max(triangle[1]).max(triangle[2]) + reach;
    let first = (low / block).floor().max(DVec2::ZERO);
    let end = (high / block).ceil();
    let [end_x, end_y] = [(end.x as u32).min(footprint.size[0]), (end.y as u32).min(footprint.size[1])];
    let half = 0.5 * block + reach;
    // Per edge normal: the triangle's extent, widened by the square's half extent.
    let mut axes = [(DVec2::ZERO, 0.0, 0.0); 3];
    let mut axis_count = 0;
    for edge in 0..3 {
        let normal = (triangle[(edge + 1) % 3] - triangle[edge]).perp();
        if normal != DVec2::ZERO {
            let along = triangle.map(|p| p.dot(normal));
            let widened = half * (normal.x.abs() + normal.y.abs());
            let least = along[0].min(along[1]).min(along[2]) - widened;
            let most = along[0].max(along[1]).max(along[2]) + widened;
            axes[axis_count] = (normal, least, most);
            axis_count += 1;
        }
    }
    for y in first.y as u32..end_y {
        for x in first.x as u32..end_x {
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * block;
            let meets = |&(normal, least, most): &(DVec2, f64, f64)| {
                let at = center.dot(normal);
                least < at && at < most
            };
            if axes[..axis_count].iter().all(meets) {
                footprint.insert(x, y);
            }
        }
    }
}
