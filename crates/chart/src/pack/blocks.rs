//! The default packer: charts as block bitmaps, largest first, each at the lowest place where it fits.
//!
//! Lévy, Petitjean, Ray and Maillot 2002, section 4, pack charts one by one, largest first, against what is already there.
//!
//! Deviation: they keep only the upper horizon of what is placed; we test bitmaps, so that small charts also
//! fill the holes of larger ones, and strips nest. Their atlas has a given width; we try several and keep the
//! one that wastes the fewest texels.
//!
//! Speed comes from three exact shortcuts. 64 neighbouring places are tested at once against the ends of the
//! chart's runs, and only the places that survive are tested block by block. A row of the page remembers its longest
//! free run, so that rows without room are skipped. And a page never gets emptier: where a shape did not
//! fit, the next chart of the same shape need not look again, which makes thousands of equal tiny charts cheap.

use super::footprint::Footprint;
use super::{BLOCK, Limits, PackError, Packing, Placement};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// What a footprint asks of the rows of a page.
struct Shape {
    footprint: Footprint,
    /// Per row: first and last block of each run.
    run_ends: Vec<Vec<u32>>,
    /// Per row: length of the longest run.
    longest_runs: Vec<u32>,
}

impl Shape {
    fn new(footprint: Footprint) -> Self {
        let [width, height] = footprint.size();
        let mut run_ends = vec![Vec::new(); height as usize];
        let mut longest_runs = vec![0; height as usize];
        for y in 0..height {
            let mut x = 0;
            while x < width {
                let start = x;
                while footprint.contains(x, y) {
                    x += 1;
                }
                if x > start {
                    let ends = &mut run_ends[y as usize];
                    ends.push(start);
                    if x - 1 > start {
                        ends.push(x - 1);
                    }
                    longest_runs[y as usize] = longest_runs[y as usize].max(x - start);
                }
                x += 1;
            }
        }
        Self { footprint, run_ends, longest_runs }
    }
}

/// All different shapes, and for each chart the shape that it has upright and turned.
struct Shapes {
    shapes: Vec<Shape>,
    of_chart: Vec<[u32; 2]>,
    blocks: Vec<u32>,
}

impl Shapes {
    fn new(footprints: &[Footprint]) -> Self {
        let mut numbers = BTreeMap::new();
        let mut shapes = Vec::new();
        let mut number = |footprint: Footprint| {
            *numbers.entry(footprint).or_insert_with_key(|footprint| {
                shapes.push(Shape::new(footprint.clone()));
                shapes.len() as u32 - 1
            })
        };
        let of_chart = footprints.iter().map(|f| [number(f.clone()), number(f.turned())]).collect();
        Self { shapes, of_chart, blocks: footprints.iter().map(Footprint::count).collect() }
    }

    fn total_blocks(&self) -> u64 {
        self.blocks.iter().map(|&blocks| u64::from(blocks)).sum()
    }

    /// Width and height of an upright chart.
    fn size(&self, chart: usize) -> [u32; 2] {
        self.shapes[self.of_chart[chart][0] as usize].footprint.size()
    }
}

/// The blocks of one page. Rows appear as charts need them.
struct Page {
    width: u32,
    max_height: u32,
    /// Words of a row, and one more in which every bit is set.
    words_per_row: usize,
    rows: Vec<u64>,
    longest_free: Vec<u32>,
    /// Per shape: no place before this one (row by row) is free, and none ever will be.
    first_place: Vec<[u32; 2]>,
}

impl Page {
    fn new(width: u32, max_height: u32, shapes: usize) -> Self {
        Self {
            width,
            max_height,
            words_per_row: (width as usize).div_ceil(64) + 1,
            rows: Vec::new(),
            longest_free: Vec::new(),
            first_place: vec![[0, 0]; shapes],
        }
    }

    fn height(&self) -> u32 {
        self.longest_free.len() as u32
    }

    /// Bits `x..x + 64` of row `y`, set where taken or outside the page.
    #[inline]
    fn window(&self, x: u32, y: u32) -> u64 {
        let at = y as usize * self.words_per_row + (x / 64) as usize;
        match x % 64 {
            0 => self.rows[at],
            shift => self.rows[at] >> shift | self.rows[at + 1] << (64 - shift),
        }
    }

    /// Whether the shape may stand with its lowest corner at (x, y), x + width already being inside.
    fn fits(&self, shape: &Shape, x: u32, y: u32) -> bool {
        let rows = shape.footprint.size()[1].min(self.height().saturating_sub(y));
        (0..rows).all(|row| {
            let words = shape.footprint.row(row).iter().enumerate();
            words
                .into_iter()
                .all(|(i, &word)| word == 0 || word & self.window(x + 64 * i as u32, y + row) == 0)
        })
    }

    /// The lowest and then leftmost place of a shape, or `None` when the page is too narrow or full.
    fn find(&mut self, number: usize, shape: &Shape) -> Option<[u32; 2]> {
        let [width, height] = shape.footprint.size();
        if width > self.width || height > self.max_height {
            return None;
        }
        let [start_x, start_y] = self.first_place[number];
        for y in start_y..=self.max_height - height {
            let rows = height.min(self.height().saturating_sub(y));
            let has_room =
                |row: u32| shape.longest_runs[row as usize] <= self.longest_free[(y + row) as usize];
            if !(0..rows).all(has_room) {
                continue;
            }
            let end_x = self.width - width + 1;
            let mut x = if y == start_y { start_x } else { 0 };
            while x < end_x {
                let mut taken = 0;
                'rows: for row in 0..rows {
                    for &end in &shape.run_ends[row as usize] {
                        taken |= self.window(x + end, y + row);
                        if taken == u64::MAX {
                            break 'rows;
                        }
                    }
                }
                let mut free = !taken;
                while free != 0 {
                    let place = x + free.trailing_zeros();
                    if place >= end_x {
                        break;
                    }
                    if self.fits(shape, place, y) {
                        self.first_place[number] = [place, y];
                        return Some([place, y]);
                    }
                    free &= free - 1;
                }
                x += 64;
            }
        }
        self.first_place[number] = [0, self.max_height - height + 1];
        None
    }

    /// Takes the blocks of a shape.
    fn place(&mut self, shape: &Shape, [x, y]: [u32; 2]) {
        let height = shape.footprint.size()[1];
        while self.height() < y + height {
            let start = self.rows.len();
            self.rows.resize(start + self.words_per_row, 0);
            let row = &mut self.rows[start..];
            row[self.words_per_row - 1] = u64::MAX;
            if !self.width.is_multiple_of(64) {
                row[self.words_per_row - 2] = u64::MAX << (self.width % 64);
            }
            self.longest_free.push(self.width);
        }
        for row in 0..height {
            let start = (y + row) as usize * self.words_per_row;
            let target = &mut self.rows[start..start + self.words_per_row];
            for (i, &word) in shape.footprint.row(row).iter().enumerate().filter(|(_, word)| **word != 0) {
                let at = (x / 64) as usize + i;
                target[at] |= word << (x % 64);
                if !x.is_multiple_of(64) && word >> (64 - x % 64) != 0 {
                    target[at + 1] |= word >> (64 - x % 64);
                }
            }
            self.longest_free[(y + row) as usize] = longest_free_run(&target[..self.words_per_row - 1]);
        }
    }
}

/// The longest run of zero bits in a row.
fn longest_free_run(words: &[u64]) -> u32 {
    let (mut longest, mut run) = (0, 0);
    for &word in words {
        let mut rest = word;
        let mut left = 64;
        while left > 0 {
            let free = rest.trailing_zeros().min(left);
            run += free;
            longest = longest.max(run);
            left -= free;
            if left > 0 {
                rest >>= free;
                let taken = rest.trailing_ones().min(left);
                run = 0;
                left -= taken;
                rest = if taken < 64 { rest >> taken } else { 0 };
            }
        }
    }
    longest
}

/// One attempt: an order of the charts, a page size in blocks and the number of pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Attempt {
    order: Order,
    width: u32,
    max_height: u32,
    pages: u32,
}

/// What comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// The chart with the most blocks.
    Blocks,
    /// The chart whose grid has the most blocks.
    Grid,
    /// The chart with the longest side.
    Side,
}

/// What an attempt came to, in blocks.
struct Outcome {
    width: u32,
    height: u32,
    placements: Vec<Placement>,
}

fn attempt(shapes: &Shapes, attempt: Attempt) -> Option<Outcome> {
    let new_page = |_| Page::new(attempt.width, attempt.max_height, shapes.shapes.len());
    let mut pages: Vec<Page> = (0..attempt.pages).map(new_page).collect();
    let mut placements = vec![Placement { page: 0, origin: [0, 0], turned: false }; shapes.of_chart.len()];
    for chart in sorted(shapes, attempt.order) {
        let [upright, turned] = shapes.of_chart[chart as usize];
        let candidates = if upright == turned { &[upright][..] } else { &[upright, turned] };
        // The place whose upper end lies lowest, on the first page that has one; upright wins ties.
        let mut best: Option<(u32, usize, bool, u32, [u32; 2])> = None;
        for (number, page) in pages.iter_mut().enumerate() {
            for (is_turned, &shape) in candidates.iter().enumerate() {
                let found = &shapes.shapes[shape as usize];
                if let Some(place) = page.find(shape as usize, found) {
                    let top = place[1] + found.footprint.size()[1];
                    if best.is_none_or(|(best_top, ..)| top < best_top) {
                        best = Some((top, number, is_turned == 1, shape, place));
                    }
                }
            }
            if best.is_some() {
                break;
            }
        }
        let (_, page, turned, shape, place) = best?;
        pages[page].place(&shapes.shapes[shape as usize], place);
        placements[chart as usize] =
            Placement { page: page as u32, origin: place.map(|blocks| blocks * BLOCK), turned };
    }
    let height = pages.iter().map(Page::height).max().unwrap_or(0);
    Some(Outcome { width: attempt.width, height, placements })
}

/// A total order, largest first: by what `order` says, then blocks, then sides, then number.
fn sorted(shapes: &Shapes, order: Order) -> Vec<u32> {
    let mut charts: Vec<u32> = (0..shapes.of_chart.len() as u32).collect();
    charts.sort_by_key(|&chart| {
        let [width, height] = shapes.size(chart as usize);
        let blocks = shapes.blocks[chart as usize];
        let first = match order {
            Order::Blocks => blocks,
            Order::Grid => width * height,
            Order::Side => width.max(height),
        };
        (std::cmp::Reverse((first, blocks, width.max(height), width.min(height))), chart)
    });
    charts
}

/// What all attempts together may cost: about a second of one core. The cost of one attempt was measured
/// as a quarter of a nanosecond times shapes times blocks.
const WORK: u64 = 4_000_000_000;

/// Attempts for one page: widths around the side of a square that holds everything, as many as the work allows,
/// and where there are many, in all three orders.
fn one_page(shapes: &Shapes, limits: &Limits) -> Vec<Attempt> {
    let blocks = shapes.total_blocks();
    let cost = (shapes.shapes.len() as u64 * blocks).max(1);
    let count = (WORK / cost).clamp(5, 180) as u32;
    let orders = if count < 36 { &[Order::Blocks][..] } else { &[Order::Blocks, Order::Grid, Order::Side] };
    let steps = count / orders.len() as u32;
    let narrowest = (0..shapes.of_chart.len()).map(|c| shapes.size(c)).map(|[w, h]| w.min(h)).max();
    let side = (blocks as f64 / 0.85).sqrt();
    let width = |step: u32| side * (0.6 + 1.2 * f64::from(step) / f64::from(steps - 1));
    let mut widths: Vec<u32> = (0..steps)
        .map(|step| (width(step).round() as u32).clamp(narrowest.unwrap_or(1), limits.width))
        .chain([limits.width])
        .collect();
    widths.sort_unstable();
    widths.dedup();
    let attempt = |order, width| Attempt { order, width, max_height: limits.height, pages: 1 };
    orders.iter().flat_map(|&order| widths.iter().map(move |&width| attempt(order, width))).collect()
}

/// Packs by footprints; see the module's documentation.
pub(super) fn pack(footprints: &[Footprint], limits: &Limits) -> Result<Packing, PackError> {
    let shapes = Shapes::new(footprints);
    match best_of(&shapes, &one_page(&shapes, limits)) {
        Some(best) => Ok(finish(best, 1)),
        None => several_pages(&shapes, limits),
    }
}

/// The outcome with the fewest blocks; the one closer to a square wins ties, then the narrower one, then the
/// earlier attempt.
fn best_of(shapes: &Shapes, attempts: &[Attempt]) -> Option<Outcome> {
    let outcomes: Vec<_> = attempts.par_iter().map(|&a| attempt(shapes, a)).collect();
    outcomes.into_iter().flatten().min_by_key(|o| (o.width * o.height, o.width.abs_diff(o.height), o.width))
}

/// Several pages, as few as hold everything, as low as a short search finds.
fn several_pages(shapes: &Shapes, limits: &Limits) -> Result<Packing, PackError> {
    let blocks = shapes.total_blocks();
    let full_page = u64::from(limits.width) * u64::from(limits.height);
    let fewest = blocks.div_ceil(full_page.max(1)).max(2);
    for pages in fewest as u32..=limits.stack {
        let highest = limits.height.min(limits.stack / pages);
        let row = u64::from(pages) * u64::from(limits.width);
        if blocks > row * u64::from(highest) {
            break;
        }
        let attempts: Vec<Attempt> = [1.04, 1.1, 1.2, 1.35]
            .map(|slack| ((blocks / row) as f64 * slack) as u32)
            .into_iter()
            .filter(|&height| height < highest)
            .chain([highest])
            .map(|max_height| Attempt { order: Order::Blocks, width: limits.width, max_height, pages })
            .collect();
        if let Some(best) = best_of(shapes, &attempts) {
            return Ok(finish(best, pages));
        }
    }
    Err(PackError::AtlasFull {
        texels: blocks * u64::from(BLOCK * BLOCK),
        limit: u64::from(limits.width) * u64::from(limits.stack) * u64::from(BLOCK * BLOCK),
    })
}

fn finish(outcome: Outcome, pages: u32) -> Packing {
    let page_size = [outcome.width * BLOCK, outcome.height * BLOCK];
    Packing { placements: outcome.placements, page_size, pages }
}
