//! The shadow of one light: the share of a disk that a point sees.
//!
//! A small disk makes hard shadows, a large one soft. Points of the disk are those of a scrambled net, mapped by
//! Shirley and Chiu 1997, so the share is that of its area.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, cosine_hemisphere, frame, net};
use crate::{Layer, Origin, Signal, Tracer};

/// A disk that shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    /// Its middle.
    pub centre: Vec3,
    /// The direction of its axis, of any length; where it is zero, the disk lies level.
    pub axis: Vec3,
    /// Its radius, in units of the mesh; 0 for a point.
    pub radius: f32,
}

/// 1 where the whole of a [`Disk`] is seen, 0 where none of it is.
///
/// What lies behind the plane of a point's triangle is not seen. Every point is valid, also inside other geometry.
pub struct Shadow<'a> {
    tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    disk: Disk,
    across: [Vec3; 2],
    seed: u64,
    layers: [Layer; 1],
}

impl<'a> Shadow<'a> {
    /// - `seed`: another seed gives other rays
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, disk: Disk, seed: u64) -> Self {
        let axis = disk.axis.as_dvec3().try_normalize().map_or(Vec3::Y, |axis| axis.as_vec3());
        let across = frame(axis).map(|a| a * disk.radius);
        Self { tracer, mesh, disk, across, seed, layers: [Layer::scalar("shadow")] }
    }
}

impl Signal for Shadow<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let back = self.tracer.surfaces().flags(point.triangle).turned;
        out[0] = 0.0;
        let Some((origin, normal)) = Origin::on_side(self.tracer, self.mesh, point, back) else { return 0.0 };
        let to_centre = self.disk.centre - self.mesh.position(point);
        let [x, y] = self.across;
        let mut directions = [Vec3::ZERO; BATCH];
        let mut count = 0;
        for square in net(random::hash(self.seed, key, u64::from(batch), 0x5d)) {
            let place = cosine_hemisphere(square);
            let direction = to_centre + x * place.x + y * place.y;
            if direction.dot(normal) > 0.0 {
                directions[count] = direction;
                count += 1;
            }
        }
        // A ray ends at the light: one length of its direction.
        let mut through = [0.0; BATCH];
        self.tracer.transmittances(origin, &directions[..count], 1.0, &mut through[..count]);
        out[0] = through[..count].iter().sum::<f32>() / BATCH as f32;
        0.0
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::{TriangleId, VertexId};

    use super::*;
    use crate::{Estimates, Opaque};

    /// A floor of 20 x 20 around the origin and a half plane above it, at height `h`, whose edge is x = 0.
    fn floor_and_edge(h: f32) -> Mesh {
        let floor = [(-10.0, -10.0), (-10.0, 10.0), (10.0, 10.0), (10.0, -10.0)];
        let roof = [(0.0, -1000.0), (0.0, 1000.0), (1000.0, 1000.0), (1000.0, -1000.0)];
        let positions: Vec<Vec3> = floor
            .iter()
            .map(|&(x, z)| Vec3::new(x, 0.0, z))
            .chain(roof.iter().map(|&(x, z)| Vec3::new(x, h, z)))
            .collect();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]].map(|t: [u32; 3]| t.map(VertexId));
        Mesh::new(positions, vec![Vec3::Y; 8], triangles.to_vec()).unwrap()
    }

    /// The value at (x, 0, 0) for a light at height 4 over the edge.
    fn seen(mesh: &Mesh, disk: Disk, x: f32, batches: u16) -> (f32, f32) {
        let tracer = Tracer::new(mesh, &Opaque).unwrap();
        // (x, 0, 0) in the triangle (-10,-10), (-10,10), (10,10): halfway between second and third is (0, 10).
        let point = [TriangleId(0), TriangleId(1)]
            .into_iter()
            .find_map(|triangle| {
                let [a, b, c] = mesh.corners(triangle);
                let (p, ab, ac) = (Vec3::X * x - a, b - a, c - a);
                let det = ab.x * ac.z - ab.z * ac.x;
                let barycentric = [(p.x * ac.z - p.z * ac.x) / det, (ab.x * p.z - ab.z * p.x) / det];
                let [u, v] = barycentric;
                (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some(SurfacePoint { triangle, barycentric })
            })
            .expect("the floor holds the point");
        let mut estimates = Estimates::new(1, 1);
        estimates.refine(&Shadow::new(&tracer, mesh, disk, 0), &[point], &[9], &[batches]);
        (estimates.mean(0)[0], estimates.variance_of_mean(0, 0).sqrt())
    }

    #[test]
    fn shadow_of_a_straight_edge_has_the_penumbra_of_a_disk() {
        let (height, edge, radius) = (4.0_f32, 1.0_f32, 0.5_f32);
        let mesh = floor_and_edge(edge);
        let disk = Disk { centre: Vec3::Y * height, axis: Vec3::Y, radius };
        for step in -8..=8 {
            let x = step as f32 * 0.025;
            // Seen from x, the edge cuts the disk along x + (0 - x) * height / edge; what lies on the open side, to
            // negative x, is seen: a segment of the circle.
            let cut = f64::from((x - x * height / edge) / radius).clamp(-1.0, 1.0);
            let share = 0.5 + (cut.asin() + cut * (1.0 - cut * cut).sqrt()) / std::f64::consts::PI;
            let (value, sigma) = seen(&mesh, disk, x, 256);
            let error = (f64::from(value) - share).abs();
            assert!(error < 0.004_f64.max(4.0 * f64::from(sigma)), "{x}: {value} for {share}");
        }
    }

    #[test]
    fn shadow_of_a_point_is_hard() {
        let mesh = floor_and_edge(1.0);
        let disk = Disk { centre: Vec3::Y * 4.0, axis: Vec3::ZERO, radius: 0.0 };
        assert_eq!(seen(&mesh, disk, -0.01, 1).0, 1.0);
        assert_eq!(seen(&mesh, disk, 0.01, 1).0, 0.0);
    }

    #[test]
    fn shadow_from_below_the_floor_is_dark() {
        let mesh = floor_and_edge(1.0);
        let disk = Disk { centre: Vec3::NEG_Y, axis: Vec3::Y, radius: 0.2 };
        assert_eq!(seen(&mesh, disk, -1.0, 2).0, 0.0);
    }
}
