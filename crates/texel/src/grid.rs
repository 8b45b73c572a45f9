//! The grid of a chart: which texels a lookup reads, and which texels a triangle can make it read.
//!
//! Texel `(i, j)` has its centre at `(i + 0.5, j + 0.5)`. A bilinear lookup reads the texels whose centres lie
//! less than one texel away in both axes, so a triangle needs every texel whose open square of side 2 it meets.

use glam::{DVec2, Vec2};
use lightkiln_chart::SUBTEXELS;

/// The four texels that a bilinear lookup reads, and their weights; exactly as a GPU does with clamped edges.
///
/// Weights are at least 0 and sum to 1 up to rounding. A texel may be named more than once at the edge of the
/// grid. `size` must not be zero in either axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Row-major texel numbers.
    pub texels: [u32; 4],
    /// Their weights.
    pub weights: [f32; 4],
}

impl Footprint {
    /// The footprint of a lookup at `uv`, in texels. NaN reads the first texel.
    #[inline]
    pub fn new(size: [u32; 2], uv: Vec2) -> Self {
        let axis = |x: f32, count: u32| {
            let x = x - 0.5;
            let low = x.floor();
            let clamp = |i: f32| i.clamp(0.0, (count - 1) as f32) as u32;
            (clamp(low), clamp(low + 1.0), x - low)
        };
        let (i0, i1, u) = axis(uv.x, size[0]);
        let (j0, j1, v) = axis(uv.y, size[1]);
        let (low, high) = (j0 * size[0], j1 * size[0]);
        Self {
            texels: [low + i0, low + i1, high + i0, high + i1],
            weights: [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v],
        }
    }

    /// The looked-up value of one channel. `values` holds `texels x channels`.
    #[inline]
    pub fn read(&self, values: &[f32], channels: usize, channel: usize) -> f32 {
        let at = |k: usize| self.weights[k] * values[self.texels[k] as usize * channels + channel];
        (at(0) + at(1)) + (at(2) + at(3))
    }
}

/// Bilinear lookup of all channels at `uv` (in texels), as a GPU does it.
///
/// `values` holds `size[0] x size[1] x channels`, row-major from v = 0; `out` holds `channels`.
#[inline]
pub fn lookup(size: [u32; 2], channels: usize, values: &[f32], uv: Vec2, out: &mut [f32]) {
    let footprint = Footprint::new(size, uv);
    for (channel, out) in out.iter_mut().enumerate().take(channels) {
        *out = footprint.read(values, channels, channel);
    }
}

/// Chart coordinates on their exact grid of `1 / SUBTEXELS` texel.
pub(crate) fn snapped(uv: Vec2) -> [i64; 2] {
    let snap = |x: f32| (x * SUBTEXELS as f32).round() as i64;
    [snap(uv.x), snap(uv.y)]
}

const STEP: i64 = SUBTEXELS as i64;

fn cross(o: [i64; 2], a: [i64; 2], b: [i64; 2]) -> i64 {
    (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
}

/// Whether a point lies in a closed triangle of either orientation. A triangle without area holds no point.
pub(crate) fn holds(triangle: &[[i64; 2]; 3], point: [i64; 2]) -> bool {
    let [a, b, c] = *triangle;
    let sides = [cross(a, b, point), cross(b, c, point), cross(c, a, point)];
    let area = cross(a, b, c);
    (area > 0 && sides.iter().all(|&s| s >= 0)) || (area < 0 && sides.iter().all(|&s| s <= 0))
}

/// Whether a closed triangle (or segment, or point) meets the open square of side 2 texels around a centre:
/// no axis separates them. Exact, in integers.
fn meets_square(triangle: &[[i64; 2]; 3], centre: [i64; 2]) -> bool {
    let relative = triangle.map(|p| [p[0] - centre[0], p[1] - centre[1]]);
    let separated = |axis: [i64; 2]| {
        // The open square reaches over the open interval (-reach, reach) of the axis.
        let reach = STEP * (axis[0].abs() + axis[1].abs());
        let along = relative.map(|p| p[0] * axis[0] + p[1] * axis[1]);
        let (low, high) = (along.iter().min().copied(), along.iter().max().copied());
        low.is_some_and(|low| low >= reach) || high.is_some_and(|high| high <= -reach)
    };
    if separated([1, 0]) || separated([0, 1]) {
        return false;
    }
    (0..3).all(|e| {
        let (a, b) = (triangle[e], triangle[(e + 1) % 3]);
        let normal = [b[1] - a[1], a[0] - b[0]];
        normal == [0, 0] || !separated(normal)
    })
}

/// Visits every texel that a lookup at some point of the triangle reads, row by row: `(i, j, centre)` with the
/// centre on the grid of `snapped`.
pub(crate) fn touched(size: [u32; 2], triangle: &[[i64; 2]; 3], mut visit: impl FnMut(u32, u32, [i64; 2])) {
    let centre = |k: i64| k * STEP + STEP / 2;
    // Smallest and largest k with |centre(k) - x| < STEP.
    let first = |x: i64| (x - STEP / 2 - STEP).div_euclid(STEP) + 1;
    let last = |x: i64| -((STEP / 2 - STEP - x).div_euclid(STEP) + 1);
    let [ys, xs] = [triangle.map(|p| p[1]), triangle.map(|p| p[0])];
    let low = |v: [i64; 3]| v[0].min(v[1]).min(v[2]);
    let high = |v: [i64; 3]| v[0].max(v[1]).max(v[2]);
    for j in first(low(ys)).max(0)..=last(high(ys)).min(i64::from(size[1]) - 1) {
        // The part of the triangle within the row's strip bounds the columns; the exact test decides.
        let (bottom, top) = ((centre(j) - STEP) as f64, (centre(j) + STEP) as f64);
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for e in 0..3 {
            let [a, b] = [triangle[e], triangle[(e + 1) % 3]].map(|p| DVec2::new(p[0] as f64, p[1] as f64));
            let (a, b) = if a.y <= b.y { (a, b) } else { (b, a) };
            if b.y < bottom || a.y > top {
                continue;
            }
            let at = |y: f64| if b.y > a.y { a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)) } else { a.x };
            let (p, q) = (if a.y < bottom { at(bottom) } else { a.x }, if b.y > top { at(top) } else { b.x });
            left = left.min(p.min(q));
            right = right.max(p.max(q));
        }
        if left > right {
            continue;
        }
        let (left, right) = (left.floor().max(low(xs) as f64), right.ceil().min(high(xs) as f64));
        for i in first(left as i64).max(0)..=last(right as i64).min(i64::from(size[0]) - 1) {
            let centre = [centre(i), centre(j)];
            if meets_square(triangle, centre) {
                visit(i as u32, j as u32, centre);
            }
        }
    }
}

/// The parameter in `0..=1` and the point of a segment nearest to `p`.
pub(crate) fn nearest_on_segment(a: DVec2, b: DVec2, p: DVec2) -> (f64, DVec2) {
    let along = b - a;
    let length = along.length_squared();
    let t = if length > 0.0 { ((p - a).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
    // The ends exactly, so that a corner is the same point from both its edges.
    (t, if t >= 1.0 { b } else { a + along * t })
}

/// Barycentric weights of the three corners at `p`, or `None` where the triangle has no area.
pub(crate) fn barycentric(triangle: &[DVec2; 3], p: DVec2) -> Option<[f64; 3]> {
    let [a, b, c] = *triangle;
    let area = (b - a).perp_dot(c - a);
    let v = (p - a).perp_dot(c - a) / area;
    let w = (b - a).perp_dot(p - a) / area;
    (area != 0.0 && v.is_finite() && w.is_finite()).then_some([1.0 - v - w, v, w])
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightkiln_mesh::random;

    #[test]
    fn lookup_at_centre_is_the_texel() {
        let values: Vec<f32> = (0..12).map(|x| x as f32).collect();
        let mut out = [0.0];
        lookup([4, 3], 1, &values, Vec2::new(2.5, 1.5), &mut out);
        assert_eq!(out, [6.0]);
        lookup([4, 3], 1, &values, Vec2::new(3.0, 2.0), &mut out);
        assert_eq!(out, [(6.0 + 7.0 + 10.0 + 11.0) / 4.0]);
        lookup([4, 3], 1, &values, Vec2::new(-9.0, 99.0), &mut out);
        assert_eq!(out, [8.0]);
        lookup([4, 3], 1, &values, Vec2::NAN, &mut out);
    }

    /// Every texel that a random point of a random triangle reads with weight is touched; and every touched
    /// texel is read by some point.
    #[test]
    fn touched_is_what_lookups_read() {
        let size = [16, 12];
        for case in 0..200 {
            let at = |k: u64| random::hash(case, k, 0, 0);
            let mut corners = [0, 1, 2].map(|k| {
                [(at(2 * k) % (16 * 8 - 16) + 8) as i64, (at(2 * k + 1) % (12 * 8 - 16) + 8) as i64]
            });
            match case % 5 {
                0 => corners[2] = corners[1],
                1 => corners = [corners[0]; 3],
                2 => corners[1] = [corners[0][0] + 3, corners[0][1] + 1],
                _ => {}
            }
            let mut seen = [false; 16 * 12];
            touched(size, &corners, |i, j, _| seen[(j * 16 + i) as usize] = true);
            let mut read = [false; 16 * 12];
            let points = corners.map(|p| Vec2::new(p[0] as f32 / 8.0, p[1] as f32 / 8.0));
            let n = 220;
            for x in 0..=n {
                for y in 0..=n - x {
                    let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
                    let footprint =
                        Footprint::new(size, points[0] * (1.0 - u - v) + points[1] * u + points[2] * v);
                    for k in 0..4 {
                        if footprint.weights[k] > 1e-5 {
                            let texel = footprint.texels[k] as usize;
                            assert!(seen[texel], "case {case}: texel {texel} is read but not touched");
                        }
                        if footprint.weights[k] > 0.0 {
                            read[footprint.texels[k] as usize] = true;
                        }
                    }
                }
            }
            // A corner of the square may be met in less than the sampled distance.
            let missed = (0..16 * 12).filter(|&t| seen[t] && !read[t]).count();
            assert!(missed <= 3, "case {case}: {missed} texels are touched but not read");
        }
    }
}
