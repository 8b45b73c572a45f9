//! Poisson-disk points on surfaces: where the light is sampled (Schaefer 2012, section 4.1, the set `P`).
//!
//! Two samples of one sheet (triangles connected through light vertices) are never nearer than the radius,
//! unless their triangles face away from each other: the two sides of a thin wall do not disturb each other.
//! Every point of the surface has a sample of its sheet within two radii. Distances are straight lines in
//! space, not along the surface.
//!
//! | module | what |
//! |---|---|
//! | [`candidates`] | stratified candidates: area-uniform ones, and one in each small piece of the surface |
//! | [`poisson`] | the greedy choice among candidates, in blocks of space that run in parallel |
//! | [`support`] | samples added for light vertices that would see none |
//! | [`denser`] | one more sample in chosen triangles |
//! | [`areas`] | the surface area that each sample stands for |
//! | [`fresh`] | area-uniform points for verification, independent of the samples |
//!
//! Deviation: the paper takes the area of a sample as constant and drops it from eq. 2. Support samples and
//! triangles smaller than the radius make that untrue, so [`Samples::areas`] keeps it.

mod areas;
mod candidates;
mod denser;
mod fresh;
mod poisson;
mod support;
#[cfg(test)]
mod tests;

use std::ops::Range;

use lightkiln_mesh::{Fans, Mesh, SurfacePoint, TriangleId, random, sheets};
use rayon::prelude::*;

pub use fresh::fresh_points;

/// Poisson samples per squared radius on a large flat surface, measured (the limit for infinitely many
/// candidates, the jamming density of random sequential adsorption, is 0.696).
pub const DENSITY: f64 = 0.612;

/// At most this many candidates are tried; more is taken for a radius in the wrong unit.
pub const MAX_CANDIDATES: u64 = 200_000_000;

/// How [`poisson_disk`] places samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleOptions {
    /// Smallest distance of two samples, in units of the mesh (half the detail to be kept, Schaefer section 5).
    pub radius: f32,
    /// Another seed gives other samples of the same quality.
    pub seed: u64,
}

/// Why a mesh cannot be sampled.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SampleError {
    /// The radius is zero, negative, infinite or NaN.
    #[error("sample radius {radius} is not a positive finite number")]
    Radius {
        /// The radius asked for.
        radius: f32,
    },
    /// The radius is so small for this surface that the samples would not fit in memory.
    #[error("sample radius {radius} needs about {candidates} candidates, more than {limit}")]
    TooMany {
        /// The radius asked for.
        radius: f32,
        /// How many candidates it needs, at least.
        candidates: u64,
        /// How many are allowed, [`MAX_CANDIDATES`].
        limit: u64,
    },
}

/// Samples of a mesh, sorted by triangle, then by number within it. All arrays have one entry per sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Where each sample lies.
    pub points: Vec<SurfacePoint>,
    /// What a sample's rays are keyed by: a hash of the seed, its triangle and its number there.
    pub keys: Vec<u64>,
    /// Surface area that a sample stands for, in squared units of the mesh. Over each sheet that has an area
    /// they sum to it, up to rounding.
    pub areas: Vec<f32>,
    /// True for a sample that is no Poisson sample but was added because a light vertex saw none.
    pub support: Vec<bool>,
    /// The radius of the Poisson samples.
    pub radius: f32,
    starts: Vec<u32>,
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no sample, which is so only for meshes without area.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The samples of one triangle.
    #[inline]
    pub fn of_triangle(&self, triangle: TriangleId) -> Range<usize> {
        self.starts[triangle.index()] as usize..self.starts[triangle.index() + 1] as usize
    }

    /// First sample of each triangle, and the number of samples at the end: T + 1 entries.
    pub fn triangle_starts(&self) -> &[u32] {
        &self.starts
    }
}

/// A sample before it is numbered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub triangle: u32,
    pub number: u32,
    pub barycentric: [f32; 2],
}

/// The number of a support sample within its triangle; candidates never reach it.
pub(crate) const SUPPORT_NUMBER: u32 = u32::MAX;

/// The radius that gives about `samples` Poisson samples.
///
/// It is the inverse of [`DENSITY`], so the count is off where triangles or sheets are smaller than the
/// radius: each sheet keeps one sample at least, and support samples come on top. A mesh without area gets 1,
/// as any radius gives it no samples; `samples` of 0 is read as 1.
pub fn radius_for(mesh: &Mesh, samples: usize) -> f32 {
    let area = mesh.total_area();
    if area > 0.0 && area.is_finite() {
        ((DENSITY * area / samples.max(1) as f64).sqrt() as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
    } else {
        1.0
    }
}

/// Places Poisson-disk samples on every triangle that has an area, and support samples so that each light
/// vertex with such a triangle has a sample in one of its triangles.
///
/// The result is the same for any number of threads. Memory: 32 bytes a candidate (about 11 per squared radius,
/// or one per triangle where triangles are smaller), of which only one group of sheets at a time, and about 50
/// bytes a triangle.
///
/// # Errors
/// [`SampleError::Radius`] and [`SampleError::TooMany`].
pub fn poisson_disk(mesh: &Mesh, options: &SampleOptions) -> Result<Samples, SampleError> {
    let radius = options.radius;
    if !(radius > 0.0 && radius.is_finite()) {
        return Err(SampleError::Radius { radius });
    }
    let sheet_of = sheets(mesh).0;
    let surface = candidates::Surface::new(mesh, &sheet_of);
    let plan = candidates::Plan::new(mesh, &sheet_of, &surface, options)?;
    let mut placed = poisson::choose(mesh, &sheet_of, &surface, &plan);
    drop((surface, plan));
    let fans = Fans::new(mesh);
    let supports = support::missing(mesh, &fans, &placed);
    placed.extend(supports);
    placed.par_sort_unstable_by_key(|p| (p.triangle, p.number));

    let mut starts = vec![0_u32; mesh.triangle_count() + 1];
    for p in &placed {
        starts[p.triangle as usize + 1] += 1;
    }
    for t in 0..mesh.triangle_count() {
        starts[t + 1] += starts[t];
    }
    let points: Vec<SurfacePoint> = placed
        .iter()
        .map(|p| SurfacePoint { triangle: TriangleId(p.triangle), barycentric: p.barycentric })
        .collect();
    let key = |p: &Placed| random::hash(options.seed, u64::from(p.triangle), u64::from(p.number), 0);
    let keys = placed.iter().map(key).collect();
    let support = placed.iter().map(|p| p.number == SUPPORT_NUMBER).collect();
    drop(placed);
    let areas = areas::areas(mesh, &fans, &points, &starts);
    Ok(Samples { points, keys, areas, support, radius, starts })
}
