//! What lies along a line of sight, front to back.

use lightkiln_light::{Hit, Surfaces, Tracer};

use crate::Ray;

/// Surfaces that a line of sight meets before it gives up.
const MOST_LAYERS: usize = 64;

/// The surfaces along a ray that a viewer draws, front to back: all but backs of single-sided triangles, and all within
/// the span of the ray.
pub struct Sight<'a> {
    tracer: &'a Tracer<'a>,
    surfaces: &'a dyn Surfaces,
    /// The ray.
    pub ray: Ray,
    /// What it meets first, where that is known already.
    first: Option<Option<Hit>>,
    /// Where it goes on.
    start: f32,
    layers: usize,
}

impl<'a> Sight<'a> {
    /// - `first`: what the ray meets first from its origin, whatever its span, if that is known
    pub fn new(
        tracer: &'a Tracer<'a>,
        surfaces: &'a dyn Surfaces,
        ray: Ray,
        first: Option<Option<Hit>>,
    ) -> Self {
        // What is known of the way from the origin says nothing where the span begins behind it.
        let is_behind = |hit: &Option<Hit>| hit.is_some_and(|hit| hit.distance < ray.span[0]);
        let first = first.filter(|hit| !is_behind(hit));
        Self { tracer, surfaces, ray, first, start: ray.span[0], layers: 0 }
    }

    /// The first surface that covers half of what is behind it, or more.
    pub fn first_covering(mut self) -> Option<Hit> {
        let surfaces = self.surfaces;
        self.find(|hit| {
            !surfaces.flags(hit.triangle).translucent
                || surfaces.opacity(hit.triangle, hit.barycentric) >= 0.5
        })
    }
}

impl Iterator for Sight<'_> {
    type Item = Hit;

    fn next(&mut self) -> Option<Hit> {
        let Ray { origin, direction, span } = self.ray;
        while self.layers < MOST_LAYERS {
            self.layers += 1;
            let hit = match self.first.take() {
                Some(known) => known?,
                None => {
                    let mut hit =
                        self.tracer.closest(origin + direction * self.start, direction, f32::INFINITY)?;
                    hit.distance += self.start;
                    hit
                }
            };
            if hit.distance > span[1] {
                return None;
            }
            self.start = hit.distance * (1.0 + 1e-6) + 1e-7;
            if !hit.back || self.surfaces.flags(hit.triangle).double_sided {
                return Some(hit);
            }
        }
        None
    }
}
