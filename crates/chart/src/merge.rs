//! Puts neighbouring charts of a region together again where the union holds as one chart.
//!
//! Splitting goes from coarse to fine and cannot foresee what flattening will accept; each chart saved saves
//! a border of split vertices and gutter texels.

use std::collections::BTreeMap;

use crate::patch::{CUT, Patch};

/// Which pieces share how much border, and which pairs are still worth a try.
pub(crate) struct Neighbors {
    /// Length of the common border per pair, smaller number first.
    shared: BTreeMap<(u32, u32), f64>,
    /// Length of each piece's border.
    border: Vec<f64>,
}

impl Neighbors {
    /// `label`: the piece of each triangle of the patch; `length`: of a half-edge.
    pub(crate) fn new(patch: &Patch, label: &[u32], pieces: usize, length: impl Fn(u32) -> f64) -> Self {
        let mut shared = BTreeMap::new();
        let mut border = vec![0.0; pieces];
        for half in 0..patch.twins.len() as u32 {
            let here = label[half as usize / 3];
            let twin = patch.twins[half as usize];
            let there = (twin != CUT).then(|| label[twin as usize / 3]);
            if there == Some(here) {
                continue;
            }
            let long = length(half);
            border[here as usize] += long;
            if let Some(there) = there.filter(|&there| there > here) {
                *shared.entry((here, there)).or_insert(0.0) += long;
            }
        }
        Self { shared, border }
    }

    /// Takes the pair whose common border is the largest part of the shorter border of the two.
    pub(crate) fn take_best(&mut self) -> Option<(u32, u32)> {
        let share = |&(a, b): &(u32, u32), long: f64| {
            long / self.border[a as usize].min(self.border[b as usize]).max(f64::MIN_POSITIVE)
        };
        let best = self
            .shared
            .iter()
            .map(|(pair, &long)| (share(pair, long), *pair))
            .reduce(|best, other| if other.0 > best.0 { other } else { best })?;
        self.shared.remove(&best.1);
        Some(best.1)
    }

    /// Piece `b` has become part of piece `a`. The border of the two is taken as the sum of theirs: merged
    /// pieces then come later than whole ones, which keeps charts round.
    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let of_b: Vec<((u32, u32), f64)> = self
            .shared
            .iter()
            .filter(|(pair, _)| pair.0 == b || pair.1 == b)
            .map(|(&p, &l)| (p, l))
            .collect();
        self.border[a as usize] += self.border[b as usize];
        for (pair, long) in of_b {
            self.shared.remove(&pair);
            let other = if pair.0 == b { pair.1 } else { pair.0 };
            *self.shared.entry((a.min(other), a.max(other))).or_insert(0.0) += long;
        }
    }
}
