//! A point of the surface that light arrives at.
//!
//! Light is gathered about the shading normal. Of the hemisphere around it, the part below the plane of the triangle
//! cannot be seen; it is left out of the integral *and* of its normalization, as ambient occlusion does, so that a
//! smooth surface under an even sky is lit evenly however coarse its triangles are. The part that is left projects
//! to half a disk and half an ellipse, and a disk is sheared onto it without changing the density, so no direction is
//! drawn in vain.
//!
//! Lights outside the mesh need no such care but for their shadows: near the terminator of a coarse smooth surface
//! its own triangles are in the way. There, rays start from a point lifted onto the tangent planes of the vertices
//! (Hanika 2021, "Hacking the Shadow Terminator", Ray Tracing Gems II, ch. 4).
//!
//! Deviation: only directions as low as the neighbours of the triangle may be tilted start from the lifted point, and
//! no farther up than half of the free space above the surface.

use std::f32::consts::{FRAC_1_SQRT_2, PI};

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint};

use crate::directions::{cosine_hemisphere, frame};
use crate::{Origin, Tracer};

/// A point, the side that light is wanted on, and the directions that it comes from.
pub(crate) struct Receiver {
    /// Where its rays start.
    pub origin: Origin,
    /// In world space.
    pub position: Vec3,
    /// Normal of the triangle's plane.
    pub geometric: Vec3,
    /// The shading normal; above the plane.
    pub axis: Vec3,
    /// The share of the cosine-weighted hemisphere around `axis` that lies above the plane, above 0.5.
    pub share: f32,
    /// Half of the directions are uniform over the hemisphere about `axis`, half have cosine density.
    spread: bool,
    /// With `axis` a right-handed frame; the second towards the side on which the plane is lower.
    across: [Vec3; 2],
    lift: Option<Lift>,
}

struct Lift {
    /// From the point, in world space.
    offset: Vec3,
    /// Directions whose cosine to the geometric normal is below this start from there.
    below: f32,
}

impl Receiver {
    /// None for a triangle without area.
    pub fn new(tracer: &Tracer<'_>, mesh: &Mesh, point: SurfacePoint, back: bool) -> Option<Self> {
        let (origin, geometric) = Origin::on_side(tracer, mesh, point, back)?;
        let side = if back { -1.0 } else { 1.0 };
        let shading = mesh.shading_normal(point) * side;
        let axis = if shading.dot(geometric) > 0.0 { shading } else { geometric };
        let cosine = axis.dot(geometric).min(1.0);
        let tilt = geometric - axis * cosine;
        let (across, cosine) = match tilt.try_normalize() {
            Some(second) if tilt.length_squared() > 1e-10 => ([second.cross(axis), second], cosine),
            _ => (frame(axis), 1.0),
        };
        let position = mesh.position(point);
        let lift = lift(mesh, point, position, side, geometric);
        let share = 0.5 * (1.0 + cosine);
        Some(Self { origin, position, geometric, axis, share, spread: false, across, lift })
    }

    /// The same with half of the directions uniform: coefficients of harmonics want those near the horizon too, which
    /// cosines leave out.
    pub fn spread(self) -> Self {
        Self { spread: true, ..self }
    }

    /// A direction from which light can come, with density [`Self::density`]. It may lie below the plane of the
    /// triangle if directions are spread; rounding aside, not otherwise.
    pub fn direction(&self, [x, y]: [f32; 2]) -> Vec3 {
        if !self.spread {
            self.cosine_direction([x, y])
        } else if x < 0.5 {
            self.cosine_direction([2.0 * x, y])
        } else {
            self.uniform_direction([2.0 * x - 1.0, y])
        }
    }

    fn cosine_direction(&self, square: [f32; 2]) -> Vec3 {
        let place = cosine_hemisphere(square);
        let ring = (1.0 - place.x * place.x).max(0.0).sqrt();
        let y = self.share * place.y + (1.0 - self.share) * ring;
        let z = (1.0 - place.x * place.x - y * y).max(0.0).sqrt();
        self.across[0] * place.x + self.across[1] * y + self.axis * z
    }

    fn uniform_direction(&self, square: [f32; 2]) -> Vec3 {
        let place = cosine_hemisphere(square);
        let low = place.x * place.x + place.y * place.y;
        let wide = (2.0 - low).max(0.0).sqrt();
        (self.across[0] * place.x + self.across[1] * place.y) * wide + self.axis * (1.0 - low)
    }

    /// Solid angle density of [`Self::direction`].
    pub fn density(&self, direction: Vec3) -> f32 {
        let cosine = self.cosine(direction) / PI;
        if self.spread { 0.5 * cosine + 0.25 / PI } else { cosine }
    }

    /// What the radiance of a direction counts for: its cosine over [`Self::share`]; 0 below either horizon.
    pub fn cosine(&self, direction: Vec3) -> f32 {
        if direction.dot(self.geometric) > 0.0 { direction.dot(self.axis).max(0.0) / self.share } else { 0.0 }
    }

    /// A ray in this direction starts from the lifted point.
    pub fn is_low(&self, direction: Vec3) -> bool {
        self.lift.as_ref().is_some_and(|lift| direction.dot(self.geometric) < lift.below)
    }

    /// The lifted point; the point itself where there is none.
    pub fn lifted(&self, tracer: &Tracer<'_>) -> Origin {
        let Some(lift) = &self.lift else { return self.origin };
        let length = lift.offset.length();
        let mut hit = [None];
        tracer.first_hits(self.origin, &[lift.offset / length], 2.0 * length, &mut hit);
        let free = hit[0].map_or(length, |hit| 0.5 * hit.distance.min(2.0 * length));
        Origin { position: self.origin.position + lift.offset * (tracer.scale() * free / length) }
    }
}

fn lift(mesh: &Mesh, point: SurfacePoint, position: Vec3, side: f32, geometric: Vec3) -> Option<Lift> {
    let (mut offset, mut least) = (Vec3::ZERO, 1.0_f32);
    for (vertex, weight) in mesh.triangles[point.triangle.index()].into_iter().zip(point.weights()) {
        let normal = mesh.normals[vertex.index()] * side;
        let below = -(position - mesh.positions[vertex.index()]).dot(normal);
        offset += normal * (weight * below.max(0.0));
        if normal != Vec3::ZERO {
            least = least.min(normal.dot(geometric));
        }
    }
    // Neighbours may be tilted to the other side of the vertex normal by as much.
    let sine = (1.0 - least * least).max(0.0).sqrt();
    let below = if least > FRAC_1_SQRT_2 { 2.0 * least * sine } else { 1.0 };
    // Beside a corner the offset may be so small that it has no direction.
    let lifts = below > 1e-3 && offset.length_squared().is_normal() && offset.dot(geometric) > 0.0;
    lifts.then_some(Lift { offset, below })
}
