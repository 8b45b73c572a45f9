//! What of a scene a first look shows: all of it, but for what went astray.
//!
//! Files from elsewhere carry leftovers far from everything else, a helper at the origin of a site plan or a bolt that
//! lost its car, and a picture that shows all of it shows nothing. Little and far is not enough to leave something out: a
//! flagpole has little surface and makes its house small. What is left out has less than a hundredth of the surface and,
//! along an axis, more empty space before it than all but such outer hundredths measures across.

use std::array::from_fn;

use glam::Vec3;

/// The share of the surface that may be left out at an end of an axis.
const LITTLE: f64 = 0.01;

/// Slices of an axis in which emptiness is looked for.
const SLICES: usize = 256;

/// How often it is looked for: what is near shows once what is very far is gone.
const MOST_ROUNDS: usize = 16;

/// Corners of the box to look at: of that around all triangles, unless some went astray; zeros around none.
///
/// - `count`: of triangles
/// - `corners`: of a triangle
pub fn frame(count: usize, corners: impl Fn(usize) -> [Vec3; 3]) -> [Vec3; 2] {
    let bounds = |[low, high]: [Vec3; 2]| {
        let is_within = |p: &Vec3| p.cmpge(low).all() && p.cmple(high).all();
        let within = (0..count).map(&corners).filter(|corners| corners.iter().all(is_within)).flatten();
        within.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    };
    let mut frame = bounds([Vec3::NEG_INFINITY, Vec3::INFINITY]);
    for _ in 0..MOST_ROUNDS {
        let next = bounds(without_strays(frame, (0..count).map(&corners)));
        if next == frame || !next[0].is_finite() {
            break;
        }
        frame = next;
    }
    if frame[0].is_finite() { frame } else { [Vec3::ZERO; 2] }
}

/// An axis in slices.
struct Slices {
    from: f32,
    length: f32,
    /// How many more triangles are in a slice than in the one before.
    change: [i64; SLICES + 1],
    /// Area of the triangles that begin in a slice, and of those that end there.
    area: [[f64; SLICES]; 2],
}

impl Slices {
    fn new(from: f32, to: f32) -> Self {
        Self { from, length: to - from, change: [0; SLICES + 1], area: [[0.0; SLICES]; 2] }
    }

    fn at(&self, x: f32) -> usize {
        // Where the axis has no length, all is in the first one.
        ((x - self.from) / self.length * SLICES as f32).clamp(0.0, SLICES as f32 - 1.0) as usize
    }

    fn add(&mut self, low: f32, high: f32, area: f64) {
        let (first, last) = (self.at(low), self.at(high));
        self.change[first] += 1;
        self.change[last + 1] -= 1;
        self.area[0][first] += area;
        self.area[1][last] += area;
    }

    /// The first and the last slice of all but a little at both ends.
    fn core(&self) -> [usize; 2] {
        let [begins, ends] = &self.area;
        let little = LITTLE * begins.iter().sum::<f64>();
        let mut sum = [0.0; 2];
        let mut is_enough = |side: usize, area: f64| {
            sum[side] += area;
            sum[side] >= little
        };
        let before = begins.iter().position(|&area| is_enough(0, area));
        let after = ends.iter().rev().position(|&area| is_enough(1, area));
        [before.unwrap_or(0), SLICES - 1 - after.unwrap_or(0)]
    }

    /// How long the core is.
    fn across(&self) -> f32 {
        let [first, last] = self.core();
        (last + 1 - first) as f32 * self.length / SLICES as f32
    }

    /// On both sides a place in the first empty space outside of the core that is longer than that, if there is one.
    fn cuts(&self, longest: f32) -> [Option<f32>; 2] {
        let mut inside = 0;
        let is_empty = self.change.map(|change| {
            inside += change;
            inside == 0
        });
        let slice = self.length / SLICES as f32;
        let mut runs = [0; 2];
        let mut is_long_empty = |side: usize, at: usize| {
            runs[side] = if is_empty[at] { runs[side] + 1 } else { 0 };
            runs[side] as f32 * slice > longest
        };
        let [first, last] = self.core();
        let before = (0..first).rev().find(|&at| is_long_empty(0, at));
        let after = (last + 1..SLICES).find(|&at| is_long_empty(1, at));
        [before, after].map(|at| at.map(|at| self.from + (at as f32 + 0.5) * slice))
    }
}

/// A box that leaves out what went astray in another.
fn without_strays([low, high]: [Vec3; 2], triangles: impl Iterator<Item = [Vec3; 3]>) -> [Vec3; 2] {
    let mut axes: [Slices; 3] = from_fn(|axis| Slices::new(low[axis], high[axis]));
    for [a, b, c] in triangles {
        let (from, to) = (a.min(b).min(c), a.max(b).max(c));
        if from.cmpge(low).all() && to.cmple(high).all() {
            let area = f64::from((b - a).cross(c - a).length());
            axes.iter_mut().enumerate().for_each(|(axis, slices)| slices.add(from[axis], to[axis], area));
        }
    }
    let longest = Vec3::from(axes.each_ref().map(Slices::across)).length();
    let cuts = axes.map(|slices| slices.cuts(longest));
    let end = |side: usize, whole: Vec3| Vec3::from(from_fn(|axis| cuts[axis][side].unwrap_or(whole[axis])));
    [end(0, low), end(1, high)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a sheet of `size` by `size` squares of 1 in the plane y = 0 from a corner.
    fn sheet(size: usize, at: Vec3, positions: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
        for (x, z) in (0..size).flat_map(|x| (0..size).map(move |z| (x, z))) {
            let first = positions.len() as u32;
            let corner = |a: usize, b: usize| at + Vec3::new((x + a) as f32, 0.0, (z + b) as f32);
            positions.extend([corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }

    fn scene(more: &[(usize, Vec3)]) -> [Vec3; 2] {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        sheet(20, Vec3::ZERO, &mut positions, &mut triangles);
        for &(size, at) in more {
            sheet(size, at, &mut positions, &mut triangles);
        }
        frame(triangles.len(), |t| triangles[t].map(|v| positions[v as usize]))
    }

    const WHOLE: [Vec3; 2] = [Vec3::ZERO, Vec3::new(20.0, 0.0, 20.0)];

    #[test]
    fn frame_leaves_out_what_went_astray_on_any_side() {
        assert_eq!(scene(&[]), WHOLE);
        for far in [60.0, -60.0, 5000.0, -5000.0] {
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                assert_eq!(scene(&[(1, far * axis)]), WHOLE, "{far} along {axis}");
            }
        }
        let both = [-1.0, 1.0].map(|side| (1, 900.0 * side * Vec3::X));
        assert_eq!(scene(&both), WHOLE);
        assert_eq!(scene(&[(1, 900.0 * Vec3::X), (1, 900.0 * Vec3::Y), (1, 900.0 * Vec3::Z)]), WHOLE);
        assert_eq!(
            scene(&[(1, Vec3::splat(1e6)), (1, Vec3::new(-90.0, 3.0, 0.0)), (1, 300.0 * Vec3::Y)]),
            WHOLE
        );
    }

    #[test]
    fn frame_keeps_what_is_near_or_large_or_joined() {
        // As far as the rest is long.
        assert_eq!(scene(&[(1, 40.0 * Vec3::X)])[1].x, 41.0);
        // A pavilion far away: a tenth of the surface.
        assert_eq!(scene(&[(7, 200.0 * Vec3::X)])[1].x, 207.0);
        // A pole.
        let pole: Vec<(usize, Vec3)> = (0..60).map(|k| (1, (20.0 + 4.0 * k as f32) * Vec3::X)).collect();
        assert_eq!(scene(&pole)[1].x, 257.0);
    }

    #[test]
    fn frame_of_little_is_sound() {
        assert_eq!(frame(0, |_| [Vec3::ZERO; 3]), [Vec3::ZERO; 2]);
        assert_eq!(frame(1, |_| [Vec3::ONE; 3]), [Vec3::ONE; 2]);
        // Two that have no area.
        let line = [[Vec3::ZERO, Vec3::ZERO, Vec3::X], [9.0 * Vec3::X; 3]];
        assert_eq!(frame(2, |t| line[t]), [Vec3::ZERO, 9.0 * Vec3::X]);
    }
}
