//! Overlapping blocks as a preconditioner, for large sheets on which the diagonal alone does not converge and a
//! factor would take too much time or memory.
//!
//! Unknowns are bisected by their coordinates into blocks of a few thousand, each grown by one ring of the
//! matrix and factored on its own, in parallel (additive Schwarz; Smith, Bjørstad and Gropp 1996). Slivers couple
//! strongly but locally, so that nearly all of them lie within a block. Blocks are also small enough that no
//! entry of a factor decays into the denormal range.

use glam::Vec3;
use rayon::prelude::*;

use crate::FitError;
use crate::assembly::Rows;
use crate::pcg::Preconditioner;
use crate::solve::Sparse;
use crate::system::Sheet;

/// Unknowns of a block before it is grown.
const BLOCK: usize = 3000;

pub(crate) struct Schwarz {
    blocks: Vec<(Vec<u32>, Sparse)>,
}

impl Schwarz {
    pub fn new(rows: &Rows, sheet: &Sheet, places: &dyn Fn(usize) -> Vec3) -> Result<Self, FitError> {
        let unknowns = sheet.unknowns();
        let mut order: Vec<(Vec3, u32)> =
            unknowns.clone().map(|u| (places(u), (u - unknowns.start) as u32)).collect();
        let mut pieces = Vec::new();
        bisect(&mut order, &mut pieces);
        let blocks = pieces
            .into_par_iter()
            .map(|piece| {
                let mut grown = piece.clone();
                for &u in &piece {
                    grown.extend(
                        rows.row(unknowns.start + u as usize).0.iter().map(|&c| c - unknowns.start as u32),
                    );
                }
                grown.sort_unstable();
                grown.dedup();
                let factor = Sparse::of_subset(rows, unknowns.start, &grown)?;
                Ok((grown, factor))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { blocks })
    }

    /// Stored entries of all factors.
    pub fn entries(&self) -> usize {
        self.blocks.iter().map(|b| b.1.entries()).sum()
    }
}

impl Preconditioner for Schwarz {
    fn apply(&self, r: &[f64], z: &mut [f64], width: usize) {
        z.fill(0.0);
        // In batches, so that the solutions of all blocks are never there at once; added in order.
        for batch in self.blocks.chunks(64) {
            let found: Vec<Vec<f64>> = batch
                .par_iter()
                .map(|(members, factor)| {
                    let mut part: Vec<f64> = members
                        .iter()
                        .flat_map(|&u| &r[u as usize * width..(u as usize + 1) * width])
                        .copied()
                        .collect();
                    factor.solve(&mut part, width);
                    part
                })
                .collect();
            for ((members, _), part) in batch.iter().zip(found) {
                for (&u, part) in members.iter().zip(part.chunks_exact(width)) {
                    for (z, p) in z[u as usize * width..].iter_mut().zip(part) {
                        *z += p;
                    }
                }
            }
        }
    }
}

/// Halves along the longest side of the bounds until blocks are small.
fn bisect(order: &mut [(Vec3, u32)], pieces: &mut Vec<Vec<u32>>) {
    if order.len() <= BLOCK {
        pieces.push(order.iter().map(|o| o.1).collect());
        return;
    }
    let (low, high) =
        order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), o| (l.min(o.0), h.max(o.0)));
    let axis = (high - low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (left, right) = order.split_at_mut(middle);
    bisect(left, pieces);
    bisect(right, pieces);
}
