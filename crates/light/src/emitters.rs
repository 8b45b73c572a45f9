//! Triangles of the mesh that shine, as one area light.
//!
//! A triangle is chosen by its area times its mean luminance, a point of it by area. The mean is that of a few places of
//! the triangle: where a texture shines between them, rays that hit it still find it.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, random};
use rayon::prelude::*;

use crate::Surfaces;
use crate::lights::luminance;

/// Where a triangle's emission is looked up.
const PLACES: [[f32; 2]; 4] = [[1.0 / 3.0, 1.0 / 3.0], [0.15, 0.15], [0.7, 0.15], [0.15, 0.7]];

/// Memory: 16 bytes an emitting triangle.
pub(crate) struct Emitters {
    /// Ascending.
    triangles: Vec<TriangleId>,
    /// Area density of a point of each, over the points of all.
    densities: Vec<f32>,
    /// Share of the power of a triangle and those before it, up to 1.
    cumulative: Vec<f64>,
    /// Area times luminance of all, candela.
    power: f32,
    /// A sphere that holds them.
    centre: Vec3,
    radius: f32,
}

impl Emitters {
    pub fn new(mesh: &Mesh, surfaces: &dyn Surfaces) -> Self {
        let found: Vec<(TriangleId, f64)> = (0..mesh.triangle_count() as u32)
            .into_par_iter()
            .filter_map(|t| {
                let t = TriangleId(t);
                let sides = if surfaces.flags(t).double_sided { 2.0 } else { 1.0 };
                let sum: f32 = PLACES.iter().map(|&at| luminance(emission(surfaces, t, at))).sum();
                let radiance = f64::from(sum) / PLACES.len() as f64 * sides;
                (radiance > 0.0 && mesh.area(t) > 0.0).then_some((t, radiance))
            })
            .collect();
        let total: f64 = found.iter().map(|&(t, radiance)| mesh.area(t) * radiance).sum();
        let mut before = 0.0;
        let mut emitters = Self {
            triangles: Vec::with_capacity(found.len()),
            densities: Vec::with_capacity(found.len()),
            cumulative: Vec::with_capacity(found.len()),
            power: total as f32,
            centre: Vec3::ZERO,
            radius: 0.0,
        };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (t, radiance) in found {
            before += mesh.area(t) * radiance;
            emitters.triangles.push(t);
            emitters.densities.push((radiance / total) as f32);
            emitters.cumulative.push(before / total);
            for corner in mesh.corners(t) {
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
        if !emitters.triangles.is_empty() {
            emitters.centre = 0.5 * (low + high);
            emitters.radius = 0.5 * (high - low).length();
        }
        emitters
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// About the illuminance that they give a point, lux; above 0 everywhere.
    pub fn importance(&self, position: Vec3) -> f32 {
        self.power / position.distance_squared(self.centre).max(self.radius * self.radius)
    }

    /// Area density with which [`Self::sample`] gives a point of a triangle.
    pub fn density(&self, triangle: TriangleId) -> f32 {
        self.triangles.binary_search(&triangle).map_or(0.0, |i| self.densities[i])
    }

    /// A point and its area density; none if nothing shines.
    ///
    /// - `key`: digits of the choice beyond those of the square: a float has too few for a million triangles
    pub fn sample(&self, [x, y]: [f32; 2], key: u64) -> Option<(SurfacePoint, f32)> {
        let x = f64::from(x) + f64::from(random::unit(key)) / 16_777_216.0;
        let i = self.cumulative.partition_point(|&c| c <= x).min(self.cumulative.len().checked_sub(1)?);
        let low = if i == 0 { 0.0 } else { self.cumulative[i - 1] };
        let across = ((x - low) / (self.cumulative[i] - low).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32;
        // The square folded onto the triangle, as strata of it stay strata.
        let barycentric = random::square_to_triangle([across, y]);
        Some((SurfacePoint { triangle: self.triangles[i], barycentric }, self.densities[i]))
    }
}

/// A surface's emission; nothing for numbers that make no sense.
pub(crate) fn emission(surfaces: &dyn Surfaces, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
    let emission = surfaces.emission(triangle, barycentric);
    if emission.is_finite() { emission.max(Vec3::ZERO) } else { Vec3::ZERO }
}
