//! The greedy choice: candidates in order of priority, each taken unless a sample already taken is in its way.
//!
//! Space is cut into blocks of 8 x 8 x 8 cells, a cell one radius wide. Blocks are taken in eight phases by the
//! parity of their coordinates: blocks of one phase are eight radii apart and cannot see each other, so they run
//! in parallel and the result does not depend on threads (after the phase groups of Wei 2008, "Parallel Poisson
//! disk sampling"). Within a block candidates go by a hash, pieces after area candidates.

use std::ops::Range;

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId};
use rayon::prelude::*;

use crate::Placed;
use crate::candidates::{Candidate, FIRST_PIECE, Plan, Stream, Surface};

/// Cells along a block's edge, and with the border of one cell that its neighbours share.
const BLOCK: i64 = 8;
const PADDED: usize = BLOCK as usize + 2;
const MASK: u64 = (1 << 21) - 1;
const NONE: u32 = u32::MAX;

/// Packs block coordinates into one word. They wrap at 2^21 blocks: blocks that far apart may share a word, which
/// costs time but nothing else, as distances are those of the positions.
pub(crate) fn block_of(cell: [i64; 3]) -> u64 {
    pack(cell.map(|c| c.div_euclid(BLOCK)))
}

fn pack(block: [i64; 3]) -> u64 {
    (block[0] as u64 & MASK) | (block[1] as u64 & MASK) << 21 | (block[2] as u64 & MASK) << 42
}

fn unpack(block: u64) -> [i64; 3] {
    [0, 21, 42].map(|shift| (block >> shift & MASK) as i64)
}

/// A sample taken, with what the test against it needs.
#[derive(Clone, Copy, Debug)]
struct Taken {
    position: Vec3,
    normal: Vec3,
    /// Its cell within its block, `0..8` each.
    cell: [u8; 3],
    placed: Placed,
}

/// The candidates of one block and sheet.
struct Block {
    key: u64,
    candidates: Range<usize>,
    /// The blocks of the same sheet.
    sheet: Range<usize>,
}

/// Chooses the Poisson samples of a mesh; sorted by nothing in particular, but always the same.
pub(crate) fn choose(mesh: &Mesh, sheet_of: &[u32], surface: &Surface, plan: &Plan) -> Vec<Placed> {
    let mut all = Vec::new();
    for group in plan.groups.iter().cloned() {
        let mut candidates = plan.candidates(mesh, sheet_of, surface, group);
        candidates.par_sort_unstable_by_key(|c| (c.sheet, c.block, c.triangle, c.number));
        let blocks = blocks(&candidates);
        let mut taken: Vec<Vec<Taken>> = Vec::new();
        taken.resize_with(blocks.len(), Vec::new);
        for phase in 0..8 {
            let parity = |key: u64| (key & 1) | (key >> 20 & 2) | (key >> 40 & 4);
            let ids: Vec<usize> = (0..blocks.len()).filter(|&b| parity(blocks[b].key) == phase).collect();
            let grown: Vec<Vec<Taken>> = ids
                .par_iter()
                .map_init(Scratch::default, |scratch, &b| {
                    scratch.grow(mesh, plan, &blocks, b, &candidates, &taken)
                })
                .collect();
            for (b, list) in ids.into_iter().zip(grown) {
                taken[b] = list;
            }
        }
        all.extend(taken.iter().flatten().map(|t| t.placed));
    }
    all
}

fn blocks(candidates: &[Candidate]) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut start = 0;
    for sheet in candidates.chunk_by(|a, b| a.sheet == b.sheet) {
        let first = blocks.len();
        for run in sheet.chunk_by(|a, b| a.block == b.block) {
            blocks.push(Block { key: run[0].block, candidates: start..start + run.len(), sheet: 0..0 });
            start += run.len();
        }
        let last = blocks.len();
        blocks[first..].iter_mut().for_each(|b| b.sheet = first..last);
    }
    blocks
}

/// A block's grid of samples: per cell a chain through `samples`. Kept between blocks to be cheap.
struct Scratch {
    heads: Vec<u32>,
    next: Vec<u32>,
    samples: Vec<Taken>,
    used: Vec<usize>,
    order: Vec<(u64, u32)>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self {
            heads: vec![NONE; PADDED * PADDED * PADDED],
            next: Vec::new(),
            samples: Vec::new(),
            used: Vec::new(),
            order: Vec::new(),
        }
    }
}

impl Scratch {
    fn grow(
        &mut self,
        mesh: &Mesh,
        plan: &Plan,
        blocks: &[Block],
        b: usize,
        candidates: &[Candidate],
        taken: &[Vec<Taken>],
    ) -> Vec<Taken> {
        self.gather(blocks, b, taken);
        let own = self.samples.len();
        let candidates = &candidates[blocks[b].candidates.clone()];
        self.order.clear();
        self.order.extend(candidates.iter().enumerate().map(|(i, c)| {
            let hash = Stream::Priority.hash(plan.seed, u64::from(c.triangle), u64::from(c.number));
            (hash >> 1 | u64::from(c.number >= FIRST_PIECE) << 63, i as u32)
        }));
        self.order.sort_unstable();
        let limit = plan.radius * plan.radius;
        for at in 0..self.order.len() {
            let c = candidates[self.order[at].1 as usize];
            let triangle = TriangleId(c.triangle);
            let position = mesh.position(SurfacePoint { triangle, barycentric: c.barycentric });
            let cell = plan.cell(position).map(|x| x.rem_euclid(BLOCK) as u8);
            let normal = mesh.geometric_normal(triangle);
            if self.is_free(cell, position, normal, limit) {
                let placed = Placed { triangle: c.triangle, number: c.number, barycentric: c.barycentric };
                self.insert(cell.map(|x| usize::from(x) + 1), Taken { position, normal, cell, placed });
            }
        }
        let result = self.samples[own..].to_vec();
        for &index in &self.used {
            self.heads[index] = NONE;
        }
        self.used.clear();
        self.samples.clear();
        self.next.clear();
        result
    }

    /// Fills the border with what the neighbouring blocks have taken in earlier phases.
    fn gather(&mut self, blocks: &[Block], b: usize, taken: &[Vec<Taken>]) {
        let sheet = &blocks[b].sheet;
        if sheet.len() == 1 {
            return;
        }
        let here = unpack(blocks[b].key);
        for z in -1..=1 {
            for y in -1..=1 {
                for x in -1..=1 {
                    let offset = [x, y, z];
                    let key = pack([here[0] + x, here[1] + y, here[2] + z]);
                    let Ok(found) = blocks[sheet.clone()].binary_search_by_key(&key, |o| o.key) else {
                        continue;
                    };
                    for &sample in &taken[sheet.start + found] {
                        let padded = [0, 1, 2].map(|k| i64::from(sample.cell[k]) + offset[k] * BLOCK + 1);
                        if padded.iter().all(|&c| (0..PADDED as i64).contains(&c)) {
                            self.insert(padded.map(|c| c as usize), sample);
                        }
                    }
                }
            }
        }
    }

    fn insert(&mut self, padded: [usize; 3], sample: Taken) {
        let index = (padded[2] * PADDED + padded[1]) * PADDED + padded[0];
        self.next.push(self.heads[index]);
        self.heads[index] = self.samples.len() as u32;
        self.used.push(index);
        self.samples.push(sample);
    }

    fn is_free(&self, cell: [u8; 3], position: Vec3, normal: Vec3, limit: f32) -> bool {
        let [x, y, z] = cell.map(usize::from);
        for k in z..z + 3 {
            for j in y..y + 3 {
                let row = (k * PADDED + j) * PADDED + x;
                for &head in &self.heads[row..row + 3] {
                    let mut at = head;
                    while at != NONE {
                        let other = &self.samples[at as usize];
                        if other.position.distance_squared(position) < limit && other.normal.dot(normal) > 0.0
                        {
                            return false;
                        }
                        at = self.next[at as usize];
                    }
                }
            }
        }
        true
    }
}
