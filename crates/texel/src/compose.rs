//! Composition: charts are placed in the pages of the atlas and every other texel is filled (Schaefer 2012,
//! section 4.2: dilation).
//!
//! A page is cut in blocks of 4 x 4 texels, and each block shows one chart only: so block compression never
//! mixes charts, and neither do mip levels 1 and 2, whose texels are averages within a block. First each chart
//! fills its own grid from its own texels; then it gets the blocks that hold its texels, and those around that
//! are nearer to it than to any other chart; only what no chart reaches is filled from the whole page.

use crate::TexelError;
use crate::fill::push_pull;
use crate::lift::ChartTexels;
use lightkiln_chart::Chart;
use lightkiln_chart::pack::{BLOCK, Packing, placed_texel};
use rayon::prelude::*;

/// The texture that holds all charts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// Width and height of every page in texels.
    pub size: [u32; 2],
    /// Values per texel.
    pub channels: usize,
    /// Per page: texels x channels, row-major from v = 0.
    pub pages: Vec<Vec<f32>>,
    /// Per page and 4 x 4 block, row-major: the chart that it shows, [`Atlas::FREE`] where none does.
    pub owners: Vec<Vec<u32>>,
    /// Texels of all pages.
    pub texels: u64,
    /// Texels that a lookup inside a chart can read.
    pub shown: u64,
    /// Texels that none reads, in blocks that hold such texels: the price of borders.
    pub gutter: u64,
}

impl Atlas {
    /// The owner of a block that shows no chart.
    pub const FREE: u32 = u32::MAX;

    /// Texels in blocks that hold no texel of a chart; other charts could have used them.
    pub fn waste(&self) -> u64 {
        self.texels - self.shown - self.gutter
    }

    /// Uncompressed size at a number of bytes per channel.
    pub fn bytes(&self, bytes_per_channel: u64) -> u64 {
        self.texels * self.channels as u64 * bytes_per_channel
    }

    /// One mip level down: averages of 2 x 2 texels, as a mip chain has them. Sizes round up.
    pub fn mip(&self, page: usize, level: u32) -> ([u32; 2], Vec<f32>) {
        let (mut size, mut values) = (self.size, self.pages[page].clone());
        for _ in 0..level {
            let half = size.map(|s| s.div_ceil(2));
            let at = |i: u32, j: u32, c: usize| {
                let texel = j.min(size[1] - 1) as usize * size[0] as usize + i.min(size[0] - 1) as usize;
                values[texel * self.channels + c]
            };
            let mut next = Vec::with_capacity((half[0] * half[1]) as usize * self.channels);
            for j in 0..half[1] {
                for i in 0..half[0] {
                    for c in 0..self.channels {
                        let (x, y) = (2 * i, 2 * j);
                        next.push(
                            0.25 * (at(x, y, c) + at(x + 1, y, c) + at(x, y + 1, c) + at(x + 1, y + 1, c)),
                        );
                    }
                }
            }
            (size, values) = (half, next);
        }
        (size, values)
    }
}

/// Places, turns and dilates.
///
/// - `values`: per chart, texels x `channels`, after [`crate::stitch()`]
/// - returns: pages without a NaN, whatever the values of texels that are not shown
///
/// # Errors
/// [`TexelError`] where lengths do not fit, a chart leaves its page, or two charts show texels in one block.
pub fn compose(
    charts: &[Chart],
    texels: &[ChartTexels],
    values: &[Vec<f32>],
    channels: usize,
    packing: &Packing,
) -> Result<Atlas, TexelError> {
    check(charts, texels, values, channels, packing)?;
    let size = packing.page_size;
    let blocks = size.map(|s| s.div_ceil(BLOCK));
    let page_texels = size[0] as usize * size[1] as usize;
    let page_count = packing.pages as usize;
    let owners = owners(texels, packing, blocks)?;
    let mut pages = vec![vec![0.0_f32; page_texels * channels]; page_count];
    let (mut shown, mut own_blocks) = (0, 0);
    // Some charts at a time: their filled grids need not all exist at once.
    for first in (0..charts.len()).step_by(256) {
        let range = first..charts.len().min(first + 256);
        let filled: Vec<(u64, u64, Vec<f32>)> = range
            .clone()
            .into_par_iter()
            .map(|c| {
                let mut own = values[c].clone();
                let covered: Vec<bool> = (0..texels[c].len()).map(|t| texels[c].lift[t].is_some()).collect();
                own.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
                push_pull(texels[c].size, channels, &mut own, &covered);
                let [width, height] = texels[c].size.map(|s| s.div_ceil(BLOCK));
                let held = distances(&texels[c], [width, height]).iter().filter(|&&d| d == 0).count();
                (texels[c].shown() as u64, held as u64, own)
            })
            .collect();
        for (c, (chart_shown, held, own)) in range.zip(&filled) {
            shown += chart_shown;
            own_blocks += held;
            let placement = packing.placements[c];
            let chart_size = texels[c].size;
            for j in 0..chart_size[1] {
                for i in 0..chart_size[0] {
                    let [x, y] = placed_texel([i, j], chart_size, placement);
                    if x >= size[0] || y >= size[1] {
                        continue; // gutter beyond the page; checked not to be shown
                    }
                    let block = (y / BLOCK * blocks[0] + x / BLOCK) as usize;
                    if owners[placement.page as usize][block] == c as u32 {
                        let from = (j * chart_size[0] + i) as usize * channels;
                        let to = (y as usize * size[0] as usize + x as usize) * channels;
                        pages[placement.page as usize][to..to + channels]
                            .copy_from_slice(&own[from..from + channels]);
                    }
                }
            }
        }
    }
    for (page, owners) in pages.iter_mut().zip(&owners) {
        let covered: Vec<bool> = (0..page_texels)
            .map(|t| {
                let (x, y) = (t as u32 % size[0], t as u32 / size[0]);
                owners[(y / BLOCK * blocks[0] + x / BLOCK) as usize] != Atlas::FREE
            })
            .collect();
        push_pull(size, channels, page, &covered);
    }
    let gutter = own_blocks * u64::from(BLOCK * BLOCK) - shown;
    Ok(Atlas { size, channels, pages, owners, texels: page_texels as u64 * page_count as u64, shown, gutter })
}

fn check(
    charts: &[Chart],
    texels: &[ChartTexels],
    values: &[Vec<f32>],
    channels: usize,
    packing: &Packing,
) -> Result<(), TexelError> {
    let fits = |what, chart, found, expected| {
        if found == expected { Ok(()) } else { Err(TexelError::Length { what, chart, found, expected }) }
    };
    if channels == 0 {
        return Err(TexelError::Channels { channels });
    }
    fits("texels", charts.len(), texels.len(), charts.len())?;
    fits("values", charts.len(), values.len(), charts.len())?;
    fits("placements", charts.len(), packing.placements.len(), charts.len())?;
    for (c, chart) in charts.iter().enumerate() {
        let count = chart.size[0] as usize * chart.size[1] as usize;
        let placement = packing.placements[c];
        let aligned = chart.size.iter().chain(&placement.origin).all(|s| s % BLOCK == 0);
        fits("texels", c, texels[c].len(), count)?;
        fits("values", c, values[c].len(), count * channels)?;
        if !aligned || chart.size != texels[c].size || placement.page >= packing.pages {
            return Err(TexelError::Placement { chart: c });
        }
    }
    Ok(())
}

/// Per block of the chart's grid: how many blocks away the nearest block with a shown texel is, diagonals
/// counting one; `u32::MAX` where the chart shows nothing.
fn distances(texels: &ChartTexels, [width, height]: [u32; 2]) -> Vec<u32> {
    let mut distance = vec![u32::MAX; (width * height) as usize];
    for (texel, _) in texels.lift.iter().enumerate().filter(|(_, lift)| lift.is_some()) {
        let (i, j) = (texel as u32 % texels.size[0], texel as u32 / texels.size[0]);
        distance[(j / BLOCK * width + i / BLOCK) as usize] = 0;
    }
    // Chessboard distance in two sweeps.
    let mut relax = |x: u32, y: u32, neighbours: &[(i64, i64)]| {
        for (dx, dy) in neighbours {
            let (nx, ny) = (i64::from(x) + dx, i64::from(y) + dy);
            if nx >= 0 && ny >= 0 && nx < i64::from(width) && ny < i64::from(height) {
                let near = distance[(ny * i64::from(width) + nx) as usize].saturating_add(1);
                let own = &mut distance[(y * width + x) as usize];
                *own = (*own).min(near);
            }
        }
    };
    for y in 0..height {
        for x in 0..width {
            relax(x, y, &[(-1, 0), (-1, -1), (0, -1), (1, -1)]);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            relax(x, y, &[(1, 0), (1, 1), (0, 1), (-1, 1)]);
        }
    }
    distance
}

/// Gives each block of each page to the nearest chart whose grid reaches it; the first one of equals.
fn owners(texels: &[ChartTexels], packing: &Packing, blocks: [u32; 2]) -> Result<Vec<Vec<u32>>, TexelError> {
    let count = blocks[0] as usize * blocks[1] as usize;
    let mut best = vec![vec![(u32::MAX, Atlas::FREE); count]; packing.pages as usize];
    for (c, (texels, &placement)) in texels.iter().zip(&packing.placements).enumerate() {
        let [width, height] = texels.size.map(|s| s.div_ceil(BLOCK));
        let origin = placement.origin.map(|o| o / BLOCK);
        for (k, &distance) in distances(texels, [width, height]).iter().enumerate() {
            // Blocks turn as texels do.
            let placed = lightkiln_chart::pack::Placement { origin, ..placement };
            let [x, y] = placed_texel([k as u32 % width, k as u32 / width], [width, height], placed);
            if x >= blocks[0] || y >= blocks[1] {
                if distance == 0 {
                    return Err(TexelError::Placement { chart: c });
                }
                continue;
            }
            let owner = &mut best[placement.page as usize][(y * blocks[0] + x) as usize];
            if distance == 0 && owner.0 == 0 {
                return Err(TexelError::SharedBlock { charts: [owner.1 as usize, c] });
            }
            if distance < owner.0 {
                *owner = (distance, c as u32);
            }
        }
    }
    Ok(best.into_iter().map(|page| page.into_iter().map(|(_, owner)| owner).collect()).collect())
}
