//! Does a flat chart lie over itself? A disk without flips is injective when its border curve is simple, so
//! the border is searched for crossings first; only where there are some are the triangles counted per point
//! of a fine lattice, which tells a touch (the two sides of a cut that closes again) from an overlap.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec2;

use crate::patch::CUT;

/// Whether the closed curve through `points` crosses itself. Touching counts or not, as rounding has it.
pub(crate) fn crosses_itself(points: &[DVec2]) -> bool {
    let count = points.len();
    if count < 4 {
        return false;
    }
    let segment = |i: usize| (points[i], points[(i + 1) % count]);
    // Boxes of runs of 1, 2, 4, ... segments: consecutive segments lie together, so the curve is its own tree.
    let leaves: Vec<(DVec2, DVec2)> = (0..count).map(segment).map(|(a, b)| (a.min(b), a.max(b))).collect();
    let mut levels = vec![leaves];
    while levels[levels.len() - 1].len() > 1 {
        let below = &levels[levels.len() - 1];
        let join = |pair: &[(DVec2, DVec2)]| {
            pair.iter().skip(1).fold(pair[0], |(low, high), b| (low.min(b.0), high.max(b.1)))
        };
        levels.push(below.chunks(2).map(join).collect());
    }
    let mut stack = Vec::new();
    for i in 0..count {
        let (a, b) = segment(i);
        let (low, high) = levels[0][i];
        stack.push((levels.len() - 1, 0));
        while let Some((level, at)) = stack.pop() {
            // Each pair once: only segments after this one.
            if ((at + 1) << level) <= i + 1 {
                continue;
            }
            let (l, h) = levels[level][at];
            if l.x > high.x || l.y > high.y || h.x < low.x || h.y < low.y {
                continue;
            }
            if level > 0 {
                stack.extend(
                    [2 * at, 2 * at + 1]
                        .into_iter()
                        .filter(|&c| c < levels[level - 1].len())
                        .map(|c| (level - 1, c)),
                );
            } else if at > i + 1 && !(i == 0 && at == count - 1) {
                let (c, d) = segment(at);
                if properly_cross(a, b, c, d) {
                    return true;
                }
            }
        }
    }
    false
}

fn properly_cross(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    let (ac, ad) = (side(a, b, c), side(a, b, d));
    let (ca, cb) = (side(c, d, a), side(c, d, b));
    ((ac > 0.0 && ad < 0.0) || (ac < 0.0 && ad > 0.0)) && ((ca > 0.0 && cb < 0.0) || (ca < 0.0 && cb > 0.0))
}

/// The largest lattice that [`covers_twice`] visits; beyond it the lattice is made coarser.
const MOST_POINTS: f64 = 64e6;
/// The largest rectangle, in lattice points, that is kept as bits.
const MOST_BITS: f64 = 268e6;

/// Whether somewhere a 2 x 2 block of lattice points, `spacing` apart, lies in two triangles at once: that is,
/// whether the map overlaps by more than about `spacing`. Flipped triangles are skipped.
pub(crate) fn covers_twice(triangles: impl Iterator<Item = [DVec2; 3]> + Clone, spacing: f64) -> bool {
    let Some(lattice) = Lattice::new(triangles.clone(), spacing, MOST_POINTS) else { return false };
    let mut found = false;
    lattice.covered_twice(triangles, |_, _| {
        found = true;
        false
    });
    found
}

/// Where an overlapping map could be taken apart: grows over the triangles from `start` and leaves out what
/// would lie over a triangle that is in already. `twins` as in a patch. True: in.
pub(crate) fn peel(triangles: &[[DVec2; 3]], twins: &[u32], start: usize, spacing: f64) -> Vec<bool> {
    let mut kept = vec![false; triangles.len()];
    let Some(lattice) = Lattice::new(triangles.iter().copied(), spacing, MOST_POINTS / 16.0) else {
        return kept;
    };
    // Only points of true overlaps count, not the rims of parts that touch.
    let mut contested: Vec<(i32, i32)> = Vec::new();
    lattice.covered_twice(triangles.iter().copied(), |row, column| {
        contested.extend([(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)]);
        true
    });
    contested.sort_unstable();
    contested.dedup();
    let mut taken = vec![false; contested.len()];
    let points = |t: usize| {
        let mut inside = Vec::new();
        rasterize(lattice.place(&triangles[t]), |row, from, to| {
            let first = contested.partition_point(|&p| p < (row, from));
            inside.extend((first..contested.len()).take_while(|&i| contested[i] < (row, to)));
        });
        inside
    };
    let center = |t: usize| triangles[t].iter().sum::<DVec2>() / 3.0;
    let mut seen = vec![false; triangles.len()];
    let mut queue = BinaryHeap::from([Reverse((0_u64, start as u32))]);
    while let Some(Reverse((far, t))) = queue.pop() {
        let t = t as usize;
        if std::mem::replace(&mut seen[t], true) {
            continue;
        }
        let inside = points(t);
        if inside.iter().any(|&i| taken[i]) {
            continue;
        }
        inside.into_iter().for_each(|i| taken[i] = true);
        kept[t] = true;
        for &twin in twins[t * 3..t * 3 + 3].iter().filter(|&&twin| twin != CUT) {
            let to = twin as usize / 3;
            if !seen[to] {
                let far = f64::from_bits(far) + center(t).distance(center(to));
                queue.push(Reverse((far.to_bits(), to as u32)));
            }
        }
    }
    kept
}

/// Points at integer coordinates after scaling and moving.
struct Lattice {
    spacing: f64,
    offset: DVec2,
    /// Rows and columns that hold everything.
    extent: DVec2,
    /// Points that triangles cover, about.
    covered: f64,
}

impl Lattice {
    fn new(triangles: impl Iterator<Item = [DVec2; 3]>, spacing: f64, most: f64) -> Option<Self> {
        let (mut low, mut high, mut area) = (DVec2::INFINITY, DVec2::NEG_INFINITY, 0.0);
        for x in triangles {
            area += 0.5 * doubled_area(&x).abs();
            low = x.iter().fold(low, |a, &b| a.min(b));
            high = x.iter().fold(high, |a, &b| a.max(b));
        }
        let spacing = spacing.max((area / most).sqrt());
        // Off the grid that charts are snapped to, so that borders do not run along lattice lines.
        let offset = DVec2::new(0.381_966, 0.276_393) - low / spacing;
        let extent = (high - low) / spacing + 2.0;
        let sound = spacing > 0.0 && extent.max_element() < f64::from(i32::MAX) && offset.is_finite();
        sound.then_some(Self { spacing, offset, extent, covered: area / (spacing * spacing) })
    }

    fn place(&self, x: &[DVec2; 3]) -> [DVec2; 3] {
        x.map(|p| p / self.spacing + self.offset)
    }

    /// Names the first corner (row, column) of each 2 x 2 block of points that lie in two triangles, until
    /// `found` returns false.
    fn covered_twice(
        &self,
        triangles: impl Iterator<Item = [DVec2; 3]>,
        found: impl FnMut(i32, i32) -> bool,
    ) {
        let ahead = triangles.filter(|x| doubled_area(x) > 0.0).map(|x| self.place(&x));
        let points = self.extent.x * self.extent.y;
        // Long thin charts cover little of their rectangle: there the points themselves are fewer than bits.
        if points <= MOST_BITS && points <= 256.0 * (self.covered + 64.0) {
            Bits::new(self.extent).covered_twice(ahead, found);
        } else {
            points_twice(ahead, found);
        }
    }
}

/// Twice the signed area.
fn doubled_area(x: &[DVec2; 3]) -> f64 {
    (x[1] - x[0]).perp_dot(x[2] - x[0])
}

/// Two bits per lattice point: covered, and covered again.
struct Bits {
    words: usize,
    once: Vec<u64>,
    twice: Vec<u64>,
}

impl Bits {
    fn new(extent: DVec2) -> Self {
        let (words, rows) = (extent.x as usize / 64 + 1, extent.y as usize + 1);
        Self { words, once: vec![0; words * rows], twice: vec![0; words * rows] }
    }

    fn covered_twice(
        mut self,
        triangles: impl Iterator<Item = [DVec2; 3]>,
        mut found: impl FnMut(i32, i32) -> bool,
    ) {
        for x in triangles {
            rasterize(x, |row, from, to| {
                let (from, to) = (from as usize, to as usize);
                for word in from / 64..to.div_ceil(64) {
                    let (first, last) = (from.saturating_sub(word * 64), (to - word * 64).min(64));
                    let mask = (u64::MAX << first) & (u64::MAX >> (64 - last));
                    let at = row as usize * self.words + word;
                    self.twice[at] |= self.once[at] & mask;
                    self.once[at] |= mask;
                }
            });
        }
        for row in 0..self.twice.len() / self.words - 1 {
            let [here, above] = [row, row + 1].map(|r| &self.twice[r * self.words..(r + 1) * self.words]);
            // Both rows; then both columns, with the first bit of the next word as the last one's neighbour.
            let both = |word: usize| here.get(word).map_or(0, |bits| bits & above[word]);
            for word in 0..self.words {
                let mut blocks = both(word) & (both(word) >> 1 | both(word + 1) << 63);
                while blocks != 0 {
                    let column = word * 64 + blocks.trailing_zeros() as usize;
                    if !found(row as i32, column as i32) {
                        return;
                    }
                    blocks &= blocks - 1;
                }
            }
        }
    }
}

/// The same by sorting points.
fn points_twice(triangles: impl Iterator<Item = [DVec2; 3]>, mut found: impl FnMut(i32, i32) -> bool) {
    let mut hits: Vec<(i32, i32)> = Vec::new();
    for x in triangles {
        rasterize(x, |row, from, to| hits.extend((from..to).map(|column| (row, column))));
    }
    hits.sort_unstable();
    let mut twice: Vec<(i32, i32)> = hits.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    twice.dedup();
    let also = |x: i32, y: i32| twice.binary_search(&(x, y)).is_ok();
    for &(x, y) in &twice {
        if also(x + 1, y) && also(x, y + 1) && also(x + 1, y + 1) && !found(x, y) {
            return;
        }
    }
}

/// Names the runs of integer points in a triangle: row, first column, column after the last. Points on an
/// edge that two triangles share are in exactly one.
fn rasterize(x: [DVec2; 3], mut run: impl FnMut(i32, i32, i32)) {
    let low = x[0].y.min(x[1].y).min(x[2].y).ceil() as i32;
    let high = x[0].y.max(x[1].y).max(x[2].y).ceil() as i32;
    for row in low..high {
        let y = f64::from(row);
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for e in 0..3 {
            // The same end first from both sides of an edge, so that both find the same point.
            let (p, q) = (x[e], x[(e + 1) % 3]);
            let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
            if p.y < y && q.y >= y || p.y <= y && q.y > y {
                let at = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                ends = [ends[0].min(at), ends[1].max(at)];
            }
        }
        let (from, to) = (ends[0].ceil(), ends[1].ceil());
        if from < to {
            run(row, from as i32, to as i32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn p(x: f64, y: f64) -> DVec2 {
        DVec2::new(x, y)
    }

    #[test]
    fn crossing_bow_tie_is_found_and_square_is_not() {
        assert!(crosses_itself(&[p(0.0, 0.0), p(1.0, 1.0), p(1.0, 0.0), p(0.0, 1.0)]));
        assert!(!crosses_itself(&[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]));
    }

    #[test]
    fn overlap_touching_triangles_are_none() {
        let square = [[p(0.0, 0.0), p(9.0, 0.0), p(9.0, 9.0)], [p(0.0, 0.0), p(9.0, 9.0), p(0.0, 9.0)]];
        assert!(!covers_twice(square.into_iter(), 0.01));
        let shifted = [square[0], square[1].map(|q| q + p(0.5, -0.5))];
        assert!(covers_twice(shifted.into_iter(), 0.2));
        assert!(!covers_twice(shifted.into_iter(), 0.9));
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 64,
            failure_persistence: None,
            rng_seed: proptest::test_runner::RngSeed::Fixed(2),
            ..ProptestConfig::default()
        })]

        #[test]
        fn overlap_bits_and_points_agree(soup in prop::collection::vec((0.0..70.0, 0.0..70.0), 6..15)) {
            let at = |i: usize| p(soup[i].0, soup[i].1);
            let triangles = || (0..soup.len() / 3).map(|i| [at(3 * i), at(3 * i + 1), at(3 * i + 2)]);
            let ahead = || triangles().filter(|x| doubled_area(x) > 0.0);
            let (mut bits, mut points) = (Vec::new(), Vec::new());
            Bits::new(p(72.0, 72.0)).covered_twice(ahead(), |x, y| { bits.push((x, y)); true });
            points_twice(ahead(), |x, y| { points.push((x, y)); true });
            prop_assert_eq!(bits, points);
        }

        #[test]
        fn crossing_is_what_all_pairs_say(soup in prop::collection::vec((0.0..1.0, 0.0..1.0), 3..12)) {
            let curve: Vec<DVec2> = soup.iter().map(|&(x, y)| p(x, y)).collect();
            let n = curve.len();
            let side = |i: usize| (curve[i], curve[(i + 1) % n]);
            let cross = (0..n).any(|i| (i + 1..n).any(|j| {
                let ((a, b), (c, d)) = (side(i), side(j));
                properly_cross(a, b, c, d)
            }));
            prop_assert_eq!(crosses_itself(&curve), cross);
        }
    }
}
