//! Flattening of one disk: as-rigid-as-possible parameterization, the local/global method of Liu, Zhang, Xu,
//! Gotsman and Gortler 2008 (sections 3 and 5), which Schaefer 2012 section 4.2 names.
//!
//! Complex numbers (`DVec2`, `rotate` multiplies them) stand for rotations of the plane. Lengths are texels.
//!
//! Deviation: the start is not a conformal map. Each triangle's frame is carried over from its neighbour by
//! unfolding along the tree of the longest shared edges, and one global step turns the frames into positions.
//! On a developable disk that is the isometry itself, and it takes the factor that the iteration needs anyway.
//! A disk without interior vertices needs no solve: unfolding places it exactly.
//! Deviation: the cotangents of a triangle thinner than 1 : 50 are scaled down together, and every edge
//! carries a small spring, so that slivers and zero areas cannot spoil the matrix. Rigid maps still cost nothing.

use std::collections::BinaryHeap;

use faer::sparse::Triplet;
use glam::{DVec2, DVec3};

use crate::cholesky::Factor;
use crate::patch::{CUT, Patch, next};

/// Height over longest edge below which the cotangents of a triangle are scaled down.
const THIN: f64 = 0.02;
/// Spring on each edge of a triangle, beside cotangents of about 1.
const SPRING: f64 = 1e-3;

/// The triangles of a patch, each laid flat on its own, and what the energy takes from them.
pub(crate) struct Rest {
    /// Per triangle: its corners in the plane, counter-clockwise, with their true lengths.
    pub(crate) corners: Vec<[DVec2; 3]>,
    /// Per triangle and edge: weight in the energy.
    weights: Vec<[f64; 3]>,
}

impl Rest {
    /// Lays each triangle flat. `places`: positions of the patch vertices.
    pub(crate) fn new(patch: &Patch, places: &[DVec3]) -> Self {
        let corners: Vec<[DVec2; 3]> =
            patch.corners.iter().map(|c| lay_flat(c.map(|v| places[v as usize]))).collect();
        let weights = corners.iter().map(weights).collect();
        Self { corners, weights }
    }

    /// Sum of the triangles' areas.
    pub(crate) fn area(&self) -> f64 {
        self.corners.iter().map(|x| 0.5 * doubled_area(x)).sum()
    }
}

/// Twice the signed area.
#[inline]
pub(crate) fn doubled_area(x: &[DVec2; 3]) -> f64 {
    (x[1] - x[0]).perp_dot(x[2] - x[0])
}

/// A triangle in the plane with the longest edge on the x axis, where rounding does least harm.
fn lay_flat(p: [DVec3; 3]) -> [DVec2; 3] {
    let length = [0, 1, 2].map(|e: usize| p[e].distance_squared(p[(e + 1) % 3]));
    let base = (0..3).fold(0, |best, e| if length[e] > length[best] { e } else { best });
    let along = p[(base + 1) % 3] - p[base];
    let side = p[(base + 2) % 3] - p[base];
    let l = along.length();
    let mut flat = [DVec2::ZERO; 3];
    if l > 0.0 {
        flat[(base + 1) % 3] = DVec2::new(l, 0.0);
        flat[(base + 2) % 3] = DVec2::new(along.dot(side) / l, along.cross(side).length() / l);
    }
    flat
}

fn weights(x: &[DVec2; 3]) -> [f64; 3] {
    let longest = (0..3).map(|e| x[e].distance_squared(x[(e + 1) % 3])).fold(0.0, f64::max);
    if longest <= f64::MIN_POSITIVE {
        return [1.0; 3];
    }
    let area = doubled_area(x).max(THIN * longest);
    [0, 1, 2].map(|e: usize| {
        let apex = x[(e + 2) % 3];
        (x[e] - apex).dot(x[(e + 1) % 3] - apex) / area + SPRING
    })
}

/// A frame per triangle, carried over from neighbour to neighbour, longest edges first, and positions that
/// follow the same tree. For a disk without interior vertices the positions are the isometry.
fn unfold(patch: &Patch, rest: &Rest) -> (Vec<DVec2>, Vec<DVec2>) {
    let mut frames = vec![DVec2::X; patch.len()];
    let mut uv = vec![DVec2::NAN; patch.vertices.len()];
    let mut queue: BinaryHeap<(u64, std::cmp::Reverse<u32>)> = BinaryHeap::new();
    let edge = |half: u32| {
        let x = &rest.corners[half as usize / 3];
        x[next(half) as usize % 3] - x[half as usize % 3]
    };
    let mut visit = |at: usize, frame: DVec2, queue: &mut BinaryHeap<_>| {
        let (corners, x) = (&patch.corners[at], &rest.corners[at]);
        let known = (0..3).find(|&c| !uv[corners[c] as usize].is_nan());
        let (from, origin) = known.map_or((0, DVec2::ZERO), |c| (c, uv[corners[c] as usize]));
        for c in 0..3 {
            let place = &mut uv[corners[c] as usize];
            if place.is_nan() {
                *place = origin + frame.rotate(x[c] - x[from]);
            }
        }
        for half in at as u32 * 3..at as u32 * 3 + 3 {
            if patch.twins[half as usize] != CUT {
                queue.push((edge(half).length_squared().to_bits(), std::cmp::Reverse(half)));
            }
        }
    };
    let mut done = vec![false; patch.len()];
    let start = innermost(patch);
    done[start] = true;
    visit(start, DVec2::X, &mut queue);
    while let Some((_, std::cmp::Reverse(half))) = queue.pop() {
        let twin = patch.twins[half as usize];
        let (at, to) = (half as usize / 3, twin as usize / 3);
        if std::mem::replace(&mut done[to], true) {
            continue;
        }
        // The shared edge, seen from both sides, must point the same way.
        let there = edge(twin);
        let turn = frames[at].rotate(edge(half)).rotate(DVec2::new(-there.x, there.y));
        frames[to] = turn.try_normalize().unwrap_or(frames[at]);
        visit(to, frames[to], &mut queue);
    }
    (uv, frames)
}

/// A triangle far from the border.
pub(crate) fn innermost(patch: &Patch) -> usize {
    let mut seen = vec![false; patch.len()];
    let mut order: Vec<u32> = Vec::with_capacity(patch.len());
    for (at, twins) in patch.twins.chunks_exact(3).enumerate() {
        if twins.contains(&CUT) {
            seen[at] = true;
            order.push(at as u32);
        }
    }
    let mut head = 0;
    while head < order.len() {
        let at = order[head] as usize;
        head += 1;
        for &twin in &patch.twins[at * 3..at * 3 + 3] {
            if twin != CUT && !std::mem::replace(&mut seen[twin as usize / 3], true) {
                order.push(twin / 3);
            }
        }
    }
    order.last().map_or(0, |&t| t as usize)
}

/// What flattening starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// Frames carried along the longest edges.
    Unfolded,
    /// Tutte's embedding: the border on a circle by its lengths, each other vertex in the middle of its
    /// neighbours. It never flips, up to rounding.
    Tutte,
}

/// Flattens a disk. The factor of its matrix is made on first use and kept for a second start.
pub(crate) struct Flattening<'a> {
    patch: &'a Patch,
    rest: &'a Rest,
    factor: Option<Factor>,
}

impl<'a> Flattening<'a> {
    /// Prepares nothing yet.
    pub(crate) fn new(patch: &'a Patch, rest: &'a Rest) -> Self {
        Self { patch, rest, factor: None }
    }

    /// Positions of the patch vertices in the plane; `None` if a matrix cannot be factorized or a
    /// coordinate is not finite.
    pub(crate) fn run(&mut self, start: Start, iterations: u32) -> Option<Vec<DVec2>> {
        let mut frames;
        let mut uv;
        match start {
            Start::Unfolded => {
                (uv, frames) = unfold(self.patch, self.rest);
                if self.patch.border.iter().all(|&b| b) {
                    return uv.iter().all(|p| p.is_finite()).then_some(uv);
                }
            }
            Start::Tutte => {
                uv = tutte(self.patch, self.rest)?;
                frames = vec![DVec2::X; self.patch.len()];
                self.turn(&uv, &mut frames);
            }
        }
        if self.factor.is_none() {
            self.factor = Some(self.factorize()?);
        }
        let factor = self.factor.as_ref()?;
        let mut work = factor.workspace();
        let area = self.rest.area().max(f64::MIN_POSITIVE);
        let mut before = f64::INFINITY;
        for _ in 0..iterations.max(1) {
            self.right_side(&frames, &mut work.columns);
            factor.solve(&mut work);
            let unknowns = uv.len() - 1;
            uv[0] = DVec2::ZERO;
            for v in 0..unknowns {
                uv[v + 1] = DVec2::new(work.columns[v], work.columns[unknowns + v]);
            }
            let energy = self.turn(&uv, &mut frames);
            // Stops at rounding, and where the next steps would move texels by less than a part of one.
            if energy < 1e-12 * area || before - energy < 2e-4 * energy {
                break;
            }
            before = energy;
        }
        uv.iter().all(|p| p.is_finite()).then_some(uv)
    }

    /// The matrix of the global step, with vertex 0 held.
    fn factorize(&self) -> Option<Factor> {
        let unknowns = self.patch.vertices.len() - 1;
        let mut entries = Vec::with_capacity(self.patch.len() * 9);
        for (corners, weights) in self.patch.corners.iter().zip(&self.rest.weights) {
            for e in 0..3 {
                let (a, b, w) = (corners[e], corners[(e + 1) % 3], weights[e]);
                for v in [a, b] {
                    if v > 0 {
                        entries.push(Triplet::new(v - 1, v - 1, w));
                    }
                }
                if a > 0 && b > 0 {
                    entries.push(Triplet::new(a.max(b) - 1, a.min(b) - 1, -w));
                }
            }
        }
        Factor::new(unknowns, &entries)
    }

    fn right_side(&self, frames: &[DVec2], columns: &mut [f64]) {
        columns.fill(0.0);
        let unknowns = columns.len() / 2;
        for (t, corners) in self.patch.corners.iter().enumerate() {
            let (x, weights) = (&self.rest.corners[t], &self.rest.weights[t]);
            for e in 0..3 {
                let pull = frames[t].rotate(x[e] - x[(e + 1) % 3]) * weights[e];
                for (v, sign) in [(corners[e], 1.0), (corners[(e + 1) % 3], -1.0)] {
                    if v > 0 {
                        columns[v as usize - 1] += sign * pull.x;
                        columns[unknowns + v as usize - 1] += sign * pull.y;
                    }
                }
            }
        }
    }

    /// The local step: turns each frame to where it fits best. Returns the energy that is left.
    fn turn(&self, uv: &[DVec2], frames: &mut [DVec2]) -> f64 {
        let mut energy = 0.0;
        for (t, corners) in self.patch.corners.iter().enumerate() {
            let (x, weights) = (&self.rest.corners[t], &self.rest.weights[t]);
            let edges = [0, 1, 2].map(|e: usize| {
                let n = (e + 1) % 3;
                (uv[corners[e] as usize] - uv[corners[n] as usize], x[e] - x[n], weights[e])
            });
            let fit: DVec2 = edges.iter().map(|&(u, x, w)| DVec2::new(x.dot(u), x.perp_dot(u)) * w).sum();
            frames[t] = fit.try_normalize().unwrap_or(frames[t]);
            energy +=
                edges.iter().map(|&(u, x, w)| w * (u - frames[t].rotate(x)).length_squared()).sum::<f64>();
        }
        energy
    }
}

/// Tutte's embedding (Tutte 1963) with the border on a circle of the patch's area.
fn tutte(patch: &Patch, rest: &Rest) -> Option<Vec<DVec2>> {
    let loops = patch.loops();
    let [border] = loops.as_slice() else { return None };
    let length = |half: u32| {
        let x = &rest.corners[half as usize / 3];
        x[half as usize % 3].distance(x[next(half) as usize % 3])
    };
    let total: f64 = border.iter().map(|&h| length(h)).sum();
    // A border edge without length still takes a part of the circle, or two corners would be one.
    let least = 1e-3 * total.max(f64::MIN_POSITIVE) / border.len() as f64;
    let around: f64 = border.iter().map(|&h| length(h).max(least)).sum();
    let radius = (rest.area() / std::f64::consts::PI).sqrt();
    let mut uv = vec![DVec2::ZERO; patch.vertices.len()];
    let mut angle = 0.0;
    for &half in border {
        uv[patch.tail(half) as usize] = DVec2::from_angle(angle) * radius;
        angle += std::f64::consts::TAU * length(half).max(least) / around;
    }
    let mut number = vec![u32::MAX; patch.vertices.len()];
    let mut inner = Vec::new();
    for (v, number) in number.iter_mut().enumerate() {
        if !patch.border[v] {
            *number = inner.len() as u32;
            inner.push(v);
        }
    }
    if inner.is_empty() {
        return Some(uv);
    }
    let mut entries = Vec::with_capacity(patch.len() * 4);
    let mut pulls = vec![DVec2::ZERO; inner.len()];
    // Every edge of an interior vertex is interior, so each of its half-edges leaves it once.
    for half in 0..patch.twins.len() as u32 {
        let (a, b) = (patch.tail(half), patch.head(half));
        let (na, nb) = (number[a as usize], number[b as usize]);
        if na == u32::MAX {
            continue;
        }
        entries.push(Triplet::new(na, na, 1.0));
        if nb == u32::MAX {
            pulls[na as usize] += uv[b as usize];
        } else if na > nb {
            entries.push(Triplet::new(na, nb, -1.0));
        }
    }
    let factor = Factor::new(inner.len(), &entries)?;
    let mut work = factor.workspace();
    for (i, pull) in pulls.iter().enumerate() {
        work.columns[i] = pull.x;
        work.columns[inner.len() + i] = pull.y;
    }
    factor.solve(&mut work);
    for (i, &v) in inner.iter().enumerate() {
        uv[v] = DVec2::new(work.columns[i], work.columns[inner.len() + i]);
    }
    Some(uv)
}
