//! Shapes: each a function of a [`Detail`], so that one scene comes in any size.
//!
//! Curved shapes take their normals from the function that they follow, not from their triangles. Panels, boxes,
//! tubes with ends and lathes that begin and end on their axis are closed: edges pair up by position.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{DQuat, DVec3, Vec3};

use crate::model::{Assembly, Surface};

/// How finely shapes are cut.
#[derive(Clone, Copy, Debug)]
pub struct Detail {
    /// Edges per metre.
    pub per_metre: f64,
    /// Only triangles are counted; surfaces stay empty.
    pub only_count: bool,
}

impl Detail {
    /// Edges along a length, at least `least`, or some fewer where detail is low.
    pub fn steps(&self, length: f64, least: usize) -> usize {
        let low = (self.per_metre / 40.0).clamp(0.4, 1.0);
        let least = ((least as f64 * low).ceil() as usize).max(least.min(4));
        ((length * self.per_metre).round() as usize).max(least)
    }
}

/// Builds a scene with about `triangles` triangles, by searching the detail that gives them.
pub fn with_triangles(triangles: usize, build: impl Fn(&Detail) -> Assembly) -> Assembly {
    let (mut low, mut high) = (1.0_f64, 20_000.0_f64);
    for _ in 0..40 {
        let per_metre = (low * high).sqrt();
        if build(&Detail { per_metre, only_count: true }).triangle_count() > triangles {
            high = per_metre;
        } else {
            low = per_metre;
        }
    }
    build(&Detail { per_metre: low, only_count: false })
}

/// A grid of quads, each cut in two. `vertex` gives position and normal at `(u, v)` in the unit square, `u` to the
/// right and `v` up when seen from the front. `wrap` joins the last column to the first.
fn grid(
    detail: &Detail,
    [nu, nv]: [usize; 2],
    wrap: bool,
    vertex: impl Fn(f64, f64) -> (DVec3, DVec3),
) -> Surface {
    let mut surface = Surface { count: 2 * nu * nv, ..Surface::default() };
    if detail.only_count {
        return surface;
    }
    let columns = if wrap { nu } else { nu + 1 };
    for j in 0..=nv {
        for i in 0..columns {
            let (p, n) = vertex(i as f64 / nu as f64, j as f64 / nv as f64);
            surface.positions.push(p.as_vec3());
            surface.normals.push(n.as_vec3().normalize());
        }
    }
    for j in [0, nv] {
        collapse(&mut surface, j * columns, columns);
    }
    let at = |i: usize, j: usize| (j * columns + i % columns) as u32;
    for j in 0..nv {
        for i in 0..nu {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            surface.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    without_degenerate(surface)
}

/// A row of vertices at one place, a pole, gets one normal.
fn collapse(surface: &mut Surface, first: usize, count: usize) {
    let row = first..first + count;
    let place = surface.positions[first];
    if surface.positions[row.clone()].iter().all(|p| p.distance(place) < 1e-7) {
        let sum: Vec3 = surface.normals[row.clone()].iter().sum();
        surface.positions[row.clone()].fill(place);
        surface.normals[row].fill(sum.normalize());
    }
}

fn without_degenerate(mut surface: Surface) -> Surface {
    let p = &surface.positions;
    surface.triangles.retain(|t| {
        let [a, b, c] = t.map(|v| p[v as usize].as_dvec3());
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        (b - a).cross(c - a).length() > 1e-6 * longest
    });
    surface.count = surface.triangles.len();
    surface
}

/// The normal of `f` where `u` and `v` run like x and y seen from the front; at a pole that of a place near it.
fn normal_of(f: &dyn Fn(f64, f64) -> DVec3, u: f64, v: f64) -> DVec3 {
    let step = 1e-4;
    let (mut u, mut v) = (u, v);
    for _ in 0..4 {
        let (u0, u1) = ((u - step).max(0.0), (u + step).min(1.0));
        let (v0, v1) = ((v - step).max(0.0), (v + step).min(1.0));
        let du = (f(u1, v) - f(u0, v)) / (u1 - u0);
        let dv = (f(u, v1) - f(u, v0)) / (v1 - v0);
        let n = du.cross(dv);
        if n.length() > 1e-7 * (du.length_squared() + dv.length_squared()) && n.length() > 1e-14 {
            return n.normalize();
        }
        u += (0.5 - u) * 2e-3;
        v += (0.5 - v) * 2e-3;
    }
    DVec3::Z
}

/// Edges along both parameters of a surface.
fn steps_of(detail: &Detail, least: [usize; 2], f: &dyn Fn(f64, f64) -> DVec3) -> [usize; 2] {
    let length = |g: &dyn Fn(f64) -> DVec3| -> f64 {
        (0..16).map(|i| g(f64::from(i) / 16.0).distance(g(f64::from(i + 1) / 16.0))).sum()
    };
    let along = |g: &dyn Fn(f64, f64) -> DVec3| -> f64 {
        [0.05, 0.5, 0.95].into_iter().map(|s| length(&|t| g(t, s))).fold(0.0, f64::max)
    };
    [detail.steps(along(&|t, s| f(t, s)), least[0]), detail.steps(along(&|t, s| f(s, t)), least[1])]
}

/// An open surface `f(u, v)`.
pub fn patch(detail: &Detail, least: [usize; 2], f: &dyn Fn(f64, f64) -> DVec3) -> Surface {
    grid(detail, steps_of(detail, least, f), false, |u, v| (f(u, v), normal_of(f, u, v)))
}

/// A closed sheet of the given thickness below `f(u, v)`, with round hems: a body panel, a pane of glass.
///
/// The hems stand out by half the thickness beyond the edges of `f`.
pub fn panel(detail: &Detail, least: [usize; 2], thickness: f64, f: &dyn Fn(f64, f64) -> DVec3) -> Surface {
    let [nu, nv] = steps_of(detail, least, f);
    let normal = |u: f64, v: f64| normal_of(f, u, v);
    let inner = |u: f64, v: f64| f(u, v) - thickness * normal(u, v);
    let outer = grid(detail, [nu, nv], false, |u, v| (f(u, v), normal(u, v)));
    // The same diagonals on both sides, or they would cut through each other where the grid is coarse.
    let mut back = grid(detail, [nu, nv], false, |u, v| (inner(u, v), -normal(u, v)));
    back.triangles.iter_mut().for_each(|t| t.swap(1, 2));

    // Once around, counter-clockwise: place on the edge and the way out; corners turn in steps.
    const CORNER: usize = 3;
    const HEM: usize = 4;
    let around = 2 * (nu + nv) + 4 * CORNER;
    if detail.only_count {
        let count = outer.count + back.count + 2 * around * HEM;
        return Surface { count, ..Surface::default() };
    }
    let mut edge: Vec<(DVec3, DVec3, DVec3)> = Vec::with_capacity(around);
    let sides = [
        ([0.0, 0.0], [1.0, 0.0], nu),
        ([1.0, 0.0], [1.0, 1.0], nv),
        ([1.0, 1.0], [0.0, 1.0], nu),
        ([0.0, 1.0], [0.0, 0.0], nv),
    ];
    let out = |side: usize, u: f64, v: f64, n: DVec3| {
        let (from, to, steps) = sides[side];
        // Half a step either way: the way out turns smoothly where the edge has a corner.
        let step = 0.5 / steps as f64;
        let (du, dv) = ((to[0] - from[0]) * step, (to[1] - from[1]) * step);
        let at = |k: f64| f((u + k * du).clamp(0.0, 1.0), (v + k * dv).clamp(0.0, 1.0));
        (at(1.0) - at(-1.0)).cross(n).normalize()
    };
    for (side, &(from, to, steps)) in sides.iter().enumerate() {
        let ratio = |k: usize, c: usize, n: usize| {
            // The very numbers that the grid uses, so that places are equal to the last bit.
            if from[c] == to[c] {
                from[c]
            } else if from[c] < to[c] {
                k as f64 / n as f64
            } else {
                (n - k) as f64 / n as f64
            }
        };
        for k in 0..steps {
            let (u, v) = (ratio(k, 0, steps), ratio(k, 1, steps));
            let n = normal(u, v);
            edge.push((f(u, v), n, out(side, u, v, n)));
        }
        let (u, v) = (to[0], to[1]);
        let n = normal(u, v);
        let (before, after) = (out(side, u, v, n), out((side + 1) % 4, u, v, n));
        for k in 0..CORNER {
            let turned = before.lerp(after, k as f64 / CORNER as f64);
            edge.push((f(u, v), n, turned.normalize()));
        }
    }
    let count = edge.len();
    let hem = grid(detail, [count, HEM], true, |u, v| {
        let (p, n, out) = edge[(u * count as f64).round() as usize % count];
        // Seen from outside the way around runs to the right, and up is the outer side.
        match (v * HEM as f64).round() as usize {
            0 => (p - thickness * n, -n),
            HEM => (p, n),
            k => {
                let (sin, cos) = (PI * (HEM - k) as f64 / HEM as f64).sin_cos();
                let way = cos * n + sin * out;
                (p - 0.5 * thickness * n + 0.5 * thickness * way, way)
            }
        }
    });
    outer.and(back).and(hem)
}

/// A point at `t` of a smooth curve through `points` (Catmull-Rom), `t` in `0..=1` over all of it.
pub fn curve(points: &[DVec3], t: f64) -> DVec3 {
    let last = points.len() - 1;
    let s = (t * last as f64).clamp(0.0, last as f64);
    let i = (s.floor() as usize).min(last.saturating_sub(1));
    let x = s - i as f64;
    let [b, c] = [points[i], points[(i + 1).min(last)]];
    let a = if i > 0 { points[i - 1] } else { 2.0 * b - c };
    let d = if i + 2 <= last { points[i + 2] } else { 2.0 * c - b };
    0.5 * (2.0 * b
        + (c - a) * x
        + (2.0 * a - 5.0 * b + 4.0 * c - d) * x * x
        + (3.0 * b - a - 3.0 * c + d) * x * x * x)
}

/// A value of a smooth function given by `(x, y)` pairs with ascending x, constant beyond them.
pub fn table(points: &[(f64, f64)], x: f64) -> f64 {
    let last = points.len() - 1;
    if x <= points[0].0 {
        return points[0].1;
    }
    if x >= points[last].0 {
        return points[last].1;
    }
    let i = points.windows(2).position(|w| x < w[1].0).unwrap_or(last - 1);
    let slope = |k: usize| {
        // Monotone cubic: flat at extremes, harmonic mean elsewhere (Fritsch and Butland 1984).
        if k == 0 || k == last {
            return 0.0;
        }
        let s = |k: usize| (points[k + 1].1 - points[k].1) / (points[k + 1].0 - points[k].0);
        let (a, b) = (s(k - 1), s(k));
        if a * b <= 0.0 { 0.0 } else { 2.0 * a * b / (a + b) }
    };
    let (p, q) = (points[i], points[i + 1]);
    let h = q.0 - p.0;
    let t = (x - p.0) / h;
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * p.1
        + (t3 - 2.0 * t2 + t) * h * slope(i)
        + (3.0 * t2 - 2.0 * t3) * q.1
        + (t3 - t2) * h * slope(i + 1)
}

/// A surface of revolution around z. Each span is a smooth curve of `(radius, z)`, with a crease to the next one;
/// outside is to the right of the way along it: upwards on the outside of a solid.
pub fn lathe(detail: &Detail, least: usize, spans: &[&[(f64, f64)]]) -> Surface {
    let widest = spans.iter().flat_map(|s| s.iter()).map(|p| p.0).fold(0.0, f64::max);
    let around = detail.steps(TAU * widest, least);
    let mut all = Surface::default();
    for span in spans {
        let points: Vec<DVec3> = span.iter().map(|&(r, z)| DVec3::new(r, 0.0, z)).collect();
        let f = |u: f64, v: f64| {
            let p = if v <= 0.0 {
                points[0]
            } else if v >= 1.0 {
                points[points.len() - 1]
            } else {
                curve(&points, v)
            };
            let (sin, cos) = (TAU * u).sin_cos();
            DVec3::new(p.x.max(0.0) * cos, p.x.max(0.0) * sin, p.z)
        };
        let least = if points.len() > 2 { 2 * (points.len() - 1) } else { 1 };
        let length: f64 = points.windows(2).map(|w| w[0].distance(w[1])).sum();
        let along = detail.steps(length, least);
        // Periodic: the normal may look across the seam.
        let g = |u: f64, v: f64| f(u, v);
        all.append(grid(detail, [around, along], true, |u, v| {
            let turn = DQuat::from_rotation_z(TAU * u);
            (f(u, v), turn * normal_of(&|s, v| g(s - 0.5, v), 0.5, v))
        }));
    }
    all
}

/// A tube along `path(t)`, `t` in `0..=1`. An open one has round ends; a closed one joins its end to its start.
pub fn tube(
    detail: &Detail,
    least: [usize; 2],
    radius: f64,
    closed: bool,
    path: &dyn Fn(f64) -> DVec3,
) -> Surface {
    let length: f64 =
        (0..64).map(|i| path(f64::from(i) / 64.0).distance(path(f64::from(i + 1) / 64.0))).sum();
    let along = detail.steps(length, least[0]);
    let around = detail.steps(TAU * radius, least[1]);
    const END: usize = 3;
    let rows = if closed { along } else { along + 2 * END };
    if detail.only_count {
        return Surface { count: 2 * rows * around, ..Surface::default() };
    }
    let tangent = |i: usize| {
        let (t, h) = (i as f64 / along as f64, 0.25 / along as f64);
        let wrap = |t: f64| if closed { t.rem_euclid(1.0) } else { t.clamp(0.0, 1.0) };
        (path(wrap(t + h)) - path(wrap(t - h))).normalize()
    };
    // Frames carried along without turning about the path.
    let mut side = tangent(0).any_orthonormal_vector();
    let mut frames = Vec::with_capacity(along + 1);
    for i in 0..=along {
        let t = tangent(i);
        side = side.reject_from(t).normalize();
        let centre = if closed && i == along { path(0.0) } else { path(i as f64 / along as f64) };
        frames.push((centre, t, side));
    }
    let twist = if closed {
        let (_, t, first) = frames[0];
        let last = frames[along].2;
        last.cross(first).dot(t).atan2(last.dot(first))
    } else {
        0.0
    };
    let vertex = |u: f64, v: f64| {
        let row = (v * rows as f64).round() as usize;
        let (i, end) = if closed {
            (row % along, 0.0)
        } else if row < END {
            (0, -FRAC_PI_2 * (END - row) as f64 / END as f64)
        } else if row > END + along {
            (along, FRAC_PI_2 * (row - END - along) as f64 / END as f64)
        } else {
            (row - END, 0.0)
        };
        let (centre, t, side) = frames[i];
        let angle = TAU * u + twist * i as f64 / along as f64;
        let round = side * angle.cos() + t.cross(side) * angle.sin();
        let pole = end.abs() > FRAC_PI_2 - 1e-9;
        let way = if pole { t * end.signum() } else { round * end.cos() + t * end.sin() };
        (centre + radius * way, way)
    };
    let mut surface = grid(detail, [around, rows], true, vertex);
    if closed {
        // The last ring is the first one.
        let last = (rows * around) as u32;
        surface.positions.truncate(last as usize);
        surface.normals.truncate(last as usize);
        surface.triangles.iter_mut().flatten().filter(|v| **v >= last).for_each(|v| *v -= last);
    }
    surface
}

/// A flat rectangle of `steps[0]` x `steps[1]` quads from `origin` along two edges, facing `a` x `b`.
pub fn rectangle(origin: DVec3, a: DVec3, b: DVec3, steps: [usize; 2]) -> Surface {
    let n = a.cross(b).normalize();
    let detail = Detail { per_metre: 1.0, only_count: false };
    grid(&detail, steps, false, |u, v| (origin + a * u + b * v, n))
}

/// A sheet between four corners, counter-clockwise from the front; it need not be flat.
pub fn quad([a, b, c, d]: [DVec3; 4], steps: [usize; 2]) -> Surface {
    let detail = Detail { per_metre: 1.0, only_count: false };
    let f = |u: f64, v: f64| a.lerp(b, u).lerp(d.lerp(c, u), v);
    grid(&detail, steps, false, |u, v| (f(u, v), normal_of(&f, u, v)))
}

/// A wall that stands on the x axis with its front at z = 0, with rectangular openings; closed, and its edges pair
/// up. Edges of openings run on across the whole wall as rows of vertices.
///
/// - `openings`: lower left and upper right corner, within the wall
pub fn wall(detail: &Detail, size: [f64; 2], thickness: f64, openings: &[[f64; 4]]) -> Surface {
    let cuts = |k: usize| {
        let mut cuts = vec![0.0, size[k]];
        cuts.extend(openings.iter().flat_map(|o| [o[k], o[k + 2]]));
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
        cuts
    };
    let (xs, ys) = (cuts(0), cuts(1));
    let depth = detail.steps(thickness, 1);
    let solid = |i: i64, j: i64| {
        let cell = |cuts: &[f64], k: i64| match usize::try_from(k) {
            Ok(k) if k + 1 < cuts.len() => Some(0.5 * (cuts[k] + cuts[k + 1])),
            _ => None,
        };
        let (Some(x), Some(y)) = (cell(&xs, i), cell(&ys, j)) else { return false };
        !openings.iter().any(|o| (o[0]..o[2]).contains(&x) && (o[1]..o[3]).contains(&y))
    };
    let back = DVec3::NEG_Z * thickness;
    let mut all = Surface::default();
    let mut add = |origin: DVec3, a: DVec3, b: DVec3, steps: [usize; 2]| {
        if detail.only_count {
            all.count += 2 * steps[0] * steps[1];
        } else {
            all.append(rectangle(origin, a, b, steps));
        }
    };
    for i in 0..xs.len() - 1 {
        for j in 0..ys.len() - 1 {
            let (cell_i, cell_j) = (i as i64, j as i64);
            if !solid(cell_i, cell_j) {
                continue;
            }
            let low = DVec3::new(xs[i], ys[j], 0.0);
            let (x, y) = (DVec3::X * (xs[i + 1] - xs[i]), DVec3::Y * (ys[j + 1] - ys[j]));
            let (nx, ny) = (detail.steps(x.x, 1), detail.steps(y.y, 1));
            add(low, x, y, [nx, ny]);
            add(low + back, y, x, [ny, nx]);
            for (di, dj, origin, along, steps) in [
                (-1, 0, low + y, -y, ny),
                (1, 0, low + x, y, ny),
                (0, -1, low, x, nx),
                (0, 1, low + x + y, -x, nx),
            ] {
                if !solid(cell_i + di, cell_j + dj) {
                    add(origin + back, along, -back, [steps, depth]);
                }
            }
        }
    }
    all
}

/// A box with sharp edges, `steps` quads along each edge.
pub fn cuboid(low: DVec3, high: DVec3, steps: [usize; 3]) -> Surface {
    let size = high - low;
    let mut all = Surface::default();
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let axis = |k: usize| DVec3::from_array([0, 1, 2].map(|c| if c == k { size[k] } else { 0.0 }));
        all.append(rectangle(low + axis(k), axis(i), axis(j), [steps[i], steps[j]]));
        all.append(rectangle(low, axis(j), axis(i), [steps[j], steps[i]]));
    }
    all
}

/// A box around the origin with round edges, cut into `round_steps` or fewer where detail is low.
pub fn rounded_box(detail: &Detail, half: DVec3, radius: f64, round_steps: usize) -> Surface {
    let inner = (half - radius).max(DVec3::ZERO);
    // Places along one axis on the faces of a cube; the outermost ones are exact, as two faces share them.
    let places = |k: usize| {
        let straight = detail.steps(2.0 * inner[k], 1);
        let coarse = detail.steps(2.0 * radius, 1).clamp(2.min(round_steps), round_steps);
        let round = detail.steps(FRAC_PI_4 * radius, coarse);
        let bend = |i: usize| {
            if i == round { radius } else { radius * (FRAC_PI_4 * i as f64 / round as f64).tan() }
        };
        let mut list: Vec<f64> = (1..=round).rev().map(|i| -inner[k] - bend(i)).collect();
        list.extend((0..=straight).map(|i| inner[k] * (2.0 * i as f64 / straight as f64 - 1.0)));
        list.extend((1..=round).map(|i| inner[k] + bend(i)));
        list
    };
    let places = [places(0), places(1), places(2)];
    let mut all = Surface::default();
    for k in 0..3 {
        for sign in [1.0, -1.0] {
            // Axes i, j run right and up seen from outside.
            let (i, j) = if sign > 0.0 { ((k + 1) % 3, (k + 2) % 3) } else { ((k + 2) % 3, (k + 1) % 3) };
            let (nu, nv) = (places[i].len() - 1, places[j].len() - 1);
            all.append(grid(detail, [nu, nv], false, |u, v| {
                let mut q = DVec3::ZERO;
                q[i] = places[i][(u * nu as f64).round() as usize];
                q[j] = places[j][(v * nv as f64).round() as usize];
                q[k] = sign * (inner[k] + radius);
                let core = q.clamp(-inner, inner);
                let n = (q - core).normalize();
                (core + radius * n, n)
            }));
        }
    }
    all
}

/// Bends a surface: `f` maps each position and normal to a new position. Vertices at one place become one, and
/// normals those of the bent triangles, weighted by area.
pub fn bent(surface: Surface, f: impl Fn(DVec3, DVec3) -> DVec3) -> Surface {
    let mut at: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions = Vec::new();
    let index: Vec<u32> = surface
        .positions
        .iter()
        .zip(&surface.normals)
        .map(|(p, n)| {
            *at.entry((*p + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert_with(|| {
                positions.push(f(p.as_dvec3(), n.as_dvec3()));
                positions.len() as u32 - 1
            })
        })
        .collect();
    let mut sums = vec![DVec3::ZERO; positions.len()];
    let triangles: Vec<[u32; 3]> = surface.triangles.iter().map(|t| t.map(|v| index[v as usize])).collect();
    for t in &triangles {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let n = (b - a).cross(c - a);
        t.iter().for_each(|&v| sums[v as usize] += n);
    }
    let planned = surface.count;
    let bent = Surface {
        positions: positions.iter().map(|p| p.as_vec3()).collect(),
        normals: sums.iter().map(|n| n.normalize_or(DVec3::Z).as_vec3()).collect(),
        uvs: Vec::new(),
        triangles,
        count: planned,
    };
    if bent.triangles.is_empty() { bent } else { without_degenerate(bent) }
}
