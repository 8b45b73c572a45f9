//! Where the rays of a surface point start.
//!
//! Wächter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection": a start on the surface
//! is moved along the geometric normal by the error of its coordinates, never by a share of the scene.
//!
//! Deviation: they step the integer form of the coordinates. Here the step is a length, a few units in the
//! last place of the largest number that went into the point and into the test of its neighbours: its own
//! coordinates and the corners of its triangle, all in normalized coordinates. The point is also drawn away
//! from the edges of its triangle by the same length (to the middle, if the triangle is narrower than that):
//! a start exactly on a concave edge lies in the plane of the neighbour, and would look through it.

use glam::{DVec3, Vec3};
use lightkiln_mesh::{Mesh, SurfacePoint};

use crate::Tracer;

/// Step in units in the last place (2^-24 of the magnitude): 1 for the rounded start, 3 for the difference
/// and dot product of the plane test, twice over for safety, and again for edges (`EDGE_ERROR`).
const STEP: f64 = 16.0 / 16_777_216.0;

/// Where rays start, in the tracer's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    pub(crate) position: Vec3,
}

impl Origin {
    /// The start of the rays of a surface point, on the front of its triangle, and the triangle's unit normal
    /// there; none for a triangle without area.
    pub fn on_surface(tracer: &Tracer<'_>, mesh: &Mesh, point: SurfacePoint) -> Option<(Self, Vec3)> {
        Self::on_side(tracer, mesh, point, false)
    }

    /// The same on the front or on the `back` of the triangle; the normal points to that side.
    pub fn on_side(
        tracer: &Tracer<'_>,
        mesh: &Mesh,
        point: SurfacePoint,
        back: bool,
    ) -> Option<(Self, Vec3)> {
        let corners = mesh.corners(point.triangle).map(|p| tracer.normalize(p).as_dvec3());
        let [a, b, c] = corners;
        let cross = (b - a).cross(c - a);
        let twice_area = cross.length();
        let normal = if back { -cross.normalize_or_zero() } else { cross.normalize_or_zero() };
        if normal == DVec3::ZERO {
            return None;
        }
        let magnitude = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let step = STEP * magnitude;
        let [u, v] = point.barycentric.map(f64::from);
        let mut weights = [1.0 - u - v, u, v];
        // A corner's weight times its height is the distance from the opposite edge.
        let opposite = [b.distance(c), c.distance(a), a.distance(b)];
        let mut sum = 0.0;
        for (weight, edge) in weights.iter_mut().zip(opposite) {
            *weight = weight.max((step * edge / twice_area).min(1.0 / 3.0));
            sum += *weight;
        }
        let position = (a * weights[0] + b * weights[1] + c * weights[2]) / sum;
        Some((Self { position: (position + normal * step).as_vec3() }, normal.as_vec3()))
    }
}
