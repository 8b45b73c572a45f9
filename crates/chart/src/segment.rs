//! Segmentation of a patch into almost developable pieces, in the manner of D-Charts (Julius, Kraevoy and
//! Sheffer 2005), which Schaefer 2012 section 4.2 names.
//!
//! A piece is described by a cone: an axis and the cosine between the axis and the piece's normals. A plane
//! is the cone of angle zero, a cylinder the one of a right angle. Pieces grow from seeds like Dijkstra's
//! algorithm; cones and seeds are fitted anew to what has grown (Lloyd), and seeds are added where a piece
//! is far from any cone.
//!
//! Deviation: the cost of a triangle is not the product of fit, compactness and straightness at its own
//! place, but the length of the way there, each step multiplied by how badly it fits. The cost is then
//! monotone and pieces are connected and compact by construction, whatever the triangle sizes. Straightness
//! is left to a pass that shortens the borders.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DMat3, DVec3};

use crate::patch::{CUT, Patch};

/// Fitting error that costs nothing extra: a normal about 20 degrees off a plane.
const FREE_ERROR: f64 = 0.004;
/// Mean fitting error above which a piece is no cone: a hemisphere has 0.083.
pub(crate) const DEVELOPABLE: f64 = 0.1;
const LLOYD_STEPS: usize = 6;
const MOST_PIECES: usize = 256;

/// What segmentation looks at, per triangle.
pub(crate) struct Shape {
    centers: Vec<DVec3>,
    /// Unit, or zero for a triangle without area.
    normals: Vec<DVec3>,
    areas: Vec<f64>,
}

/// All directions at one angle from an axis.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: DVec3,
    cosine: f64,
    /// Area-weighted mean of the squared deviation.
    error: f64,
}

impl Shape {
    /// `places`: positions of the patch vertices in texels.
    pub(crate) fn new(patch: &Patch, places: &[DVec3]) -> Self {
        let corners = || patch.corners.iter().map(|c| c.map(|v| places[v as usize]));
        let vectors: Vec<DVec3> = corners().map(|[a, b, c]| (b - a).cross(c - a)).collect();
        Self {
            centers: corners().map(|[a, b, c]| (a + b + c) / 3.0).collect(),
            normals: vectors.iter().map(|v| v.normalize_or_zero()).collect(),
            areas: vectors.iter().map(|v| 0.5 * v.length()).collect(),
        }
    }

    /// How far the normals are from any cone: 0 for a developable cone or plane, 1/3 for a whole sphere.
    pub(crate) fn error(&self) -> f64 {
        self.fit(0..self.areas.len()).error
    }

    fn fit(&self, members: impl Iterator<Item = usize>) -> Cone {
        let (mut area, mut sum, mut outer) = (0.0, DVec3::ZERO, DMat3::ZERO);
        for t in members {
            let (a, n) = (self.areas[t], self.normals[t]);
            area += a;
            sum += n * a;
            outer += DMat3::from_cols(n * n.x, n * n.y, n * n.z) * a;
        }
        if area <= 0.0 {
            return Cone { axis: DVec3::Z, cosine: 1.0, error: 0.0 };
        }
        let mean = sum / area;
        let covariance = outer * (1.0 / area) - DMat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
        let (axis, error) = least_eigenvector(covariance);
        // A flat piece fits every cone through its normal; the plane is the one that stays flat.
        let flat = mean.normalize_or_zero();
        let spread = flat.dot(covariance * flat);
        if flat != DVec3::ZERO && spread <= error + 1e-4 {
            return Cone { axis: flat, cosine: mean.length(), error: spread.max(0.0) };
        }
        Cone { axis, cosine: axis.dot(mean), error: error.max(0.0) }
    }

    fn deviation(&self, cone: &Cone, t: usize) -> f64 {
        // A triangle without area has no say, and no normal.
        if self.areas[t] <= 0.0 || self.normals[t] == DVec3::ZERO {
            return 0.0;
        }
        (cone.axis.dot(self.normals[t]) - cone.cosine).powi(2)
    }
}

/// The eigenvector of the smallest eigenvalue of a symmetric matrix, by Jacobi rotations.
fn least_eigenvector(matrix: DMat3) -> (DVec3, f64) {
    let mut a = matrix.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q].abs() < 1e-300 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let (rp, rq) = (a[p], a[q]);
            a[p] = [0, 1, 2].map(|k: usize| c * rp[k] - s * rq[k]);
            a[q] = [0, 1, 2].map(|k: usize| s * rp[k] + c * rq[k]);
            for row in &mut v {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
        }
    }
    let least = (0..3).fold(0, |best, i| if a[i][i] < a[best][best] { i } else { best });
    (DVec3::new(v[0][least], v[1][least], v[2][least]), a[least][least])
}

/// Labels for all triangles, at least two different ones if the patch has two triangles. With `by_distance`
/// the normals are ignored and the pieces are only compact.
pub(crate) fn segment(patch: &Patch, shape: &Shape, by_distance: bool) -> Vec<u32> {
    let all = 0..patch.len();
    let whole = shape.fit(all.clone());
    let mut seeds = vec![nearest(shape, all.clone(), centroid(shape, all)) as u32];
    let mut cones = vec![whole];
    let mut grown = grow(patch, shape, &seeds, &cones, by_distance);
    for round in 0..10 {
        let pieces = seeds.len();
        let members = members(&grown.label, pieces);
        // The first round always splits: that is what the caller came for.
        let wanting: Vec<usize> = (0..pieces)
            .filter(|&c| round == 0 || !by_distance && cones[c].error > DEVELOPABLE)
            .filter(|&c| members[c].len() > 1)
            .collect();
        for &c in wanting.iter().take(MOST_PIECES - pieces) {
            // The triangle that was hardest to reach.
            let farthest =
                members[c].iter().copied().filter(|&t| t != seeds[c]).max_by(|&a, &b| {
                    grown.cost[a as usize].total_cmp(&grown.cost[b as usize]).then(b.cmp(&a))
                });
            if let Some(t) = farthest {
                seeds.push(t);
                cones.push(around(patch, shape, t as usize));
            }
        }
        if seeds.len() == pieces {
            break;
        }
        for _ in 0..LLOYD_STEPS {
            let next = grow(patch, shape, &seeds, &cones, by_distance);
            let settled = next.label == grown.label;
            grown = next;
            for (c, set) in self::members(&grown.label, seeds.len()).iter().enumerate() {
                let set = || set.iter().map(|&t| t as usize);
                cones[c] = shape.fit(set());
                if !settled {
                    seeds[c] = nearest(shape, set(), centroid(shape, set())) as u32;
                }
            }
            if settled {
                break;
            }
        }
        grown = grow(patch, shape, &seeds, &cones, by_distance);
    }
    shorten_borders(patch, shape, &seeds, &cones, &mut grown.label);
    grown.label
}

fn members(label: &[u32], pieces: usize) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); pieces];
    for (t, &c) in label.iter().enumerate() {
        members[c as usize].push(t as u32);
    }
    members
}

fn centroid(shape: &Shape, members: impl Iterator<Item = usize>) -> DVec3 {
    let (mut sum, mut total) = (DVec3::ZERO, 0.0);
    for t in members {
        // A little more than the area, so that a piece without any has a middle too.
        let weight = shape.areas[t] + 1e-12;
        sum += shape.centers[t] * weight;
        total += weight;
    }
    sum / total.max(f64::MIN_POSITIVE)
}

fn nearest(shape: &Shape, members: impl Iterator<Item = usize>, place: DVec3) -> usize {
    let far = |t: usize| shape.centers[t].distance_squared(place);
    members.reduce(|best, t| if far(t) < far(best) { t } else { best }).unwrap_or(0)
}

/// The plane of a triangle and its neighbours.
fn around(patch: &Patch, shape: &Shape, t: usize) -> Cone {
    let ring = patch.twins[t * 3..t * 3 + 3].iter().filter(|&&h| h != CUT).map(|&h| h as usize / 3);
    let sum: DVec3 = std::iter::once(t).chain(ring).map(|t| shape.normals[t] * shape.areas[t]).sum();
    Cone { axis: sum.try_normalize().unwrap_or(DVec3::Z), cosine: 1.0, error: 0.0 }
}

struct Grown {
    label: Vec<u32>,
    cost: Vec<f64>,
}

fn grow(patch: &Patch, shape: &Shape, seeds: &[u32], cones: &[Cone], by_distance: bool) -> Grown {
    let mut label = vec![0; patch.len()];
    let mut cost = vec![f64::INFINITY; patch.len()];
    let mut done = vec![false; patch.len()];
    let mut queue: BinaryHeap<Reverse<(u64, u32, u32)>> = BinaryHeap::new();
    for (c, &seed) in seeds.iter().enumerate() {
        cost[seed as usize] = 0.0;
        queue.push(Reverse((0, seed, c as u32)));
    }
    while let Some(Reverse((bits, t, c))) = queue.pop() {
        let at = t as usize;
        if std::mem::replace(&mut done[at], true) {
            continue;
        }
        label[at] = c;
        for &twin in &patch.twins[at * 3..at * 3 + 3] {
            if twin == CUT || done[twin as usize / 3] {
                continue;
            }
            let to = twin as usize / 3;
            let error = if by_distance { 0.0 } else { shape.deviation(&cones[c as usize], to) };
            let step = shape.centers[at].distance(shape.centers[to]) * (FREE_ERROR + error);
            let far = f64::from_bits(bits) + step;
            if far < cost[to] {
                cost[to] = far;
                queue.push(Reverse((far.to_bits(), to as u32, c)));
            }
        }
    }
    Grown { label, cost }
}

/// Gives triangles to the neighbouring piece with which they share the longer border, where that makes the
/// border shorter and the triangle fits about as well. Seeds stay.
fn shorten_borders(patch: &Patch, shape: &Shape, seeds: &[u32], cones: &[Cone], label: &mut [u32]) {
    let mut fixed = vec![false; patch.len()];
    for &seed in seeds {
        fixed[seed as usize] = true;
    }
    for _ in 0..4 {
        let mut moved = false;
        for t in (0..patch.len()).filter(|&t| !fixed[t]) {
            let sides = [0, 1, 2].map(|e: usize| {
                let twin = patch.twins[t * 3 + e];
                (twin != CUT).then(|| label[twin as usize / 3])
            });
            let same = |c: u32| sides.iter().filter(|&&s| s == Some(c)).count();
            let own = same(label[t]);
            let Some(best) = sides.into_iter().flatten().filter(|&c| same(c) > own.max(1)).min() else {
                continue;
            };
            let worse =
                shape.deviation(&cones[best as usize], t) - shape.deviation(&cones[label[t] as usize], t);
            if best != label[t] && worse < 0.05 {
                label[t] = best;
                moved = true;
            }
        }
        if !moved {
            break;
        }
    }
}
