//! Is a flattening good enough for a chart? Flips, stretch and overlap, and the repair of single flips.
//!
//! All lengths are texels. A triangle far smaller than a texel may do what it likes as long as its
//! neighbourhood does not: what counts is the area that goes wrong.

use glam::DVec2;

use crate::arap::{Rest, doubled_area};
use crate::overlap;
use crate::patch::{CUT, Patch};

/// Height of a flipped triangle below which no texel shows it.
const HARMLESS_HEIGHT: f64 = 0.05;
/// Area of flipped or overstretched small triangles that one chart may hold, in square texels.
const HARMLESS_AREA: f64 = 0.5;
/// Share of a chart's area that may be overstretched where single triangles are too small to see.
const HARMLESS_SHARE: f64 = 0.01;

/// Why a flattening cannot be a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Triangles turned over.
    Flipped,
    /// Triangles stretched or shrunk too far.
    Stretched,
    /// Two places of the chart share texels.
    Overlaps,
}

/// The singular values of the map from a flat triangle to its image, larger first; `None` without area.
pub(crate) fn singular_values(x: &[DVec2; 3], u: &[DVec2; 3]) -> Option<[f64; 2]> {
    let area = doubled_area(x);
    let longest = longest_squared(x);
    if area <= 1e-9 * longest || longest <= 0.0 {
        return None;
    }
    let (x1, x2) = (x[1] - x[0], x[2] - x[0]);
    let (u1, u2) = (u[1] - u[0], u[2] - u[0]);
    // Columns of the Jacobian: images of the axes.
    let dx = (u1 * x2.y - u2 * x1.y) / area;
    let dy = (u2 * x1.x - u1 * x2.x) / area;
    let (e, f) = ((dx.x + dy.y) / 2.0, (dx.x - dy.y) / 2.0);
    let (g, h) = ((dx.y + dy.x) / 2.0, (dx.y - dy.x) / 2.0);
    let (q, r) = (e.hypot(h), f.hypot(g));
    Some([q + r, (q - r).abs()])
}

fn longest_squared(x: &[DVec2; 3]) -> f64 {
    (0..3).map(|e| x[e].distance_squared(x[(e + 1) % 3])).fold(0.0, f64::max)
}

pub(crate) fn image(patch: &Patch, uv: &[DVec2], t: usize) -> [DVec2; 3] {
    patch.corners[t].map(|v| uv[v as usize])
}

fn extent(uv: &[DVec2]) -> f64 {
    let low = uv.iter().fold(DVec2::INFINITY, |a, &b| a.min(b));
    let high = uv.iter().fold(DVec2::NEG_INFINITY, |a, &b| a.max(b));
    (high - low).max_element()
}

/// Moves the vertices of flipped triangles to where their other triangles want them, or between their
/// neighbours, as long as that turns fewer triangles over. Returns how many flips went away.
pub(crate) fn repair_flips(patch: &Patch, rest: &Rest, uv: &mut [DVec2]) -> usize {
    let noise = 1e-9 * extent(uv);
    let flipped = |uv: &[DVec2], t: usize| {
        let u = image(patch, uv, t);
        let area = doubled_area(&u);
        area < 0.0 && -area > noise * longest_squared(&u).sqrt()
    };
    let list = |uv: &[DVec2]| (0..patch.len()).filter(|&t| flipped(uv, t)).collect::<Vec<_>>();
    let first = list(uv);
    // A flattening that failed as a whole is not mended triangle by triangle.
    if first.is_empty() || first.len() > 16 + patch.len() / 20 {
        return 0;
    }
    let fans = fans(patch);
    let mut bad = first.clone();
    for _ in 0..8 {
        for &t in &bad {
            for v in patch.corners[t] {
                let fan = &fans.1[fans.0[v as usize] as usize..fans.0[v as usize + 1] as usize];
                let count = |uv: &[DVec2]| fan.iter().filter(|&&t| flipped(uv, t as usize)).count();
                let before = count(uv);
                if before == 0 {
                    continue;
                }
                let old = uv[v as usize];
                let mut best = (before, old);
                for candidate in candidates(patch, rest, uv, fan, v) {
                    uv[v as usize] = candidate;
                    let after = count(uv);
                    if candidate.is_finite() && after < best.0 {
                        best = (after, candidate);
                    }
                }
                uv[v as usize] = best.1;
            }
        }
        bad = list(uv);
        if bad.is_empty() {
            break;
        }
    }
    first.len().saturating_sub(bad.len())
}

/// Where a vertex might go: unfolded over the opposite edges, or in the middle of its ring.
fn candidates(patch: &Patch, rest: &Rest, uv: &[DVec2], fan: &[u32], v: u32) -> [DVec2; 2] {
    let (mut unfolded, mut middle, mut total) = (DVec2::ZERO, DVec2::ZERO, 0.0);
    for &t in fan {
        let (corners, x) = (patch.corners[t as usize], &rest.corners[t as usize]);
        let Some(c) = corners.iter().position(|&w| w == v) else { continue };
        let (p, q) = ((c + 1) % 3, (c + 2) % 3);
        let (up, uq) = (uv[corners[p] as usize], uv[corners[q] as usize]);
        let along = x[q] - x[p];
        let turn = (uq - up).rotate(DVec2::new(along.x, -along.y)).normalize_or(DVec2::X);
        let weight = longest_squared(x).sqrt();
        // From the middle of the edge, as the edge itself may have been stretched.
        unfolded += ((up + uq) / 2.0 + turn.rotate(x[c] - (x[p] + x[q]) / 2.0)) * weight;
        middle += (up + uq) / 2.0;
        total += weight;
    }
    [unfolded / total.max(f64::MIN_POSITIVE), middle / fan.len().max(1) as f64]
}

/// The triangles around each vertex, in compressed rows.
fn fans(patch: &Patch) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; patch.vertices.len() + 1];
    for &v in patch.corners.iter().flatten() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..patch.vertices.len() {
        starts[v + 1] += starts[v];
    }
    let mut fill = starts.clone();
    let mut triangles = vec![0; patch.len() * 3];
    for (t, corners) in patch.corners.iter().enumerate() {
        for &v in corners {
            triangles[fill[v as usize] as usize] = t as u32;
            fill[v as usize] += 1;
        }
    }
    (starts, triangles)
}

/// Checks a flattening: first flips, then stretch (singular values within `1 / stretch ..= stretch`), then
/// overlap.
pub(crate) fn judge(patch: &Patch, rest: &Rest, uv: &[DVec2], stretch: f64) -> Result<(), Fault> {
    let size = extent(uv);
    let height = HARMLESS_HEIGHT.min(HARMLESS_HEIGHT * size);
    let area = rest.area();
    let (mut flipped, mut stretched) = (0.0, 0.0);
    for (t, x) in rest.corners.iter().enumerate() {
        let u = image(patch, uv, t);
        let doubled = doubled_area(&u);
        if doubled < 0.0 {
            if -doubled > height * longest_squared(&u).sqrt() {
                return Err(Fault::Flipped);
            }
            flipped -= doubled / 2.0;
        }
        let rest_height = doubled_area(x) / longest_squared(x).sqrt().max(f64::MIN_POSITIVE);
        if let Some([large, small]) = singular_values(x, &u)
            && (large > stretch || small * stretch < 1.0)
        {
            if rest_height > 0.5 {
                return Err(Fault::Stretched);
            }
            stretched += doubled_area(x) / 2.0;
        }
        for e in 0..3 {
            let (flat, image) = (x[e].distance(x[(e + 1) % 3]), u[e].distance(u[(e + 1) % 3]));
            if image > stretch * flat + 0.5 || image < flat / stretch - 0.5 {
                return Err(Fault::Stretched);
            }
        }
    }
    if flipped > HARMLESS_AREA.min(HARMLESS_SHARE * area) {
        return Err(Fault::Flipped);
    }
    if stretched > HARMLESS_AREA.max(HARMLESS_SHARE * area) {
        return Err(Fault::Stretched);
    }
    if overlaps(patch, uv, area) { Err(Fault::Overlaps) } else { Ok(()) }
}

fn overlaps(patch: &Patch, uv: &[DVec2], area: f64) -> bool {
    let border: Vec<Vec<DVec2>> = patch
        .loops()
        .iter()
        .map(|curve| curve.iter().map(|&h| uv[patch.tail(h) as usize]).collect())
        .collect();
    if !border.iter().any(|curve| overlap::crosses_itself(curve)) {
        return false;
    }
    overlap::covers_twice((0..patch.len()).map(|t| image(patch, uv, t)), lattice_spacing(patch, uv, area))
}

/// Fine enough to see a thin strip cross itself.
fn lattice_spacing(patch: &Patch, uv: &[DVec2], area: f64) -> f64 {
    let length: f64 = (0..patch.twins.len() as u32)
        .filter(|&h| patch.twins[h as usize] == CUT)
        .map(|h| uv[patch.tail(h) as usize].distance(uv[patch.head(h) as usize]))
        .sum();
    let width = 2.0 * area / length.max(f64::MIN_POSITIVE);
    (width / 4.0).min(0.2)
}

/// Labels for an overlapping flattening: 0 for triangles around `start` that do not overlap, 1 for the rest.
/// `None` if that parts nothing.
pub(crate) fn part_overlap(patch: &Patch, rest: &Rest, uv: &[DVec2], start: usize) -> Option<Vec<u32>> {
    let images: Vec<[DVec2; 3]> = (0..patch.len()).map(|t| image(patch, uv, t)).collect();
    let kept = overlap::peel(&images, &patch.twins, start, lattice_spacing(patch, uv, rest.area()));
    let parts = kept.contains(&true) && kept.contains(&false);
    parts.then(|| kept.into_iter().map(|kept| u32::from(!kept)).collect())
}
