//! Bent normals: the direction in which a point is open.
//!
//! The value is the cosine-weighted mean of the open directions in world space, times 3/2:
//!
//! ```text
//! b = 3/2 * 1/pi * integral over the hemisphere of openness(w) * w * cos(w) dw
//! ```
//!
//! Open everywhere it is the shading normal, of length 1; where everything is closed it is zero, and it is never
//! longer than 1 (of all parts of the hemisphere the whole has the longest mean, 2/3). A viewer normalises it, and a
//! length of zero means that there is no direction.
//!
//! The length is kept because it makes the value linear in light: it is estimated without bias, means of texels and of
//! vertices are right, and a direction of which hardly anything is left does not ask for texels. Normalised values do
//! none of this, and jump where a surface closes.
//!
//! Rays below the horizon of the triangle count as open as the others are on average, as in
//! [`crate::AmbientOcclusion`]: so a coarse smooth surface in the open has its shading normals.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint};

use crate::directions::BATCH;
use crate::occlusion::{OcclusionOptions, Openness};
use crate::{Domain, Layer, Signal, Tracer};

/// The mean of an open hemisphere has a length of 2/3.
const LENGTH: f32 = 1.5;

/// Bent normals, alone or with ambient occlusion from the same rays.
pub struct BentNormal<'a> {
    rays: Openness<'a>,
    layers: Vec<Layer>,
}

impl<'a> BentNormal<'a> {
    /// One layer, `bentNormal`, of three channels in `-1..=1`: x, y, z in world space.
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, options: OcclusionOptions, seed: u64) -> Self {
        let domain = Domain::Bounded { low: -1.0, high: 1.0 };
        let layers = vec![Layer { name: "bentNormal".to_owned(), channels: 3, domain }];
        Self { rays: Openness::new(tracer, mesh, options, seed), layers }
    }

    /// Two layers, `ambientOcclusion` and `bentNormal`: four channels for the rays of one. The occlusion is the same,
    /// bit for bit, as that of [`crate::AmbientOcclusion`] with the same options and seed.
    pub fn with_occlusion(
        tracer: &'a Tracer<'a>,
        mesh: &'a Mesh,
        options: OcclusionOptions,
        seed: u64,
    ) -> Self {
        let mut both = Self::new(tracer, mesh, options, seed);
        both.layers.insert(0, Layer::scalar("ambientOcclusion"));
        both
    }
}

impl Signal for BentNormal<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let (occlusion, bent) = out.split_at_mut(out.len() - 3);
        let Some(look) = self.rays.look(point, key, batch, self.rays.is_turned(point)) else {
            occlusion.fill(1.0);
            bent.fill(0.0);
            return 1.0;
        };
        let open = look.open();
        let (above, below) = look.directions.split_at(look.above);
        let seen: Vec3 = above.iter().zip(look.through).map(|(&w, open)| w * open).sum();
        let unseen: Vec3 = below.iter().map(|&w| w * open).sum();
        occlusion.fill(open);
        bent.copy_from_slice(&((seen + unseen) * (LENGTH / BATCH as f32)).to_array());
        look.backs
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::{TriangleId, VertexId};

    use super::*;
    use crate::{AmbientOcclusion, Estimates, Opaque};

    /// A small floor at the origin and a wall at x = 1, endless in z, `height` high.
    fn floor_and_wall(height: f32) -> Mesh {
        let floor = [(-0.01, -0.01), (-0.01, 0.01), (0.01, 0.01), (0.01, -0.01)];
        let wall = [(0.0, -200.0), (0.0, 200.0), (height, 200.0), (height, -200.0)];
        let positions: Vec<Vec3> = floor
            .iter()
            .map(|&(x, z)| Vec3::new(x, 0.0, z))
            .chain(wall.iter().map(|&(y, z)| Vec3::new(1.0, y, z)))
            .collect();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]].map(|t: [u32; 3]| t.map(VertexId));
        Mesh::new(positions, vec![Vec3::Y; 8], triangles.to_vec()).unwrap()
    }

    fn value(mesh: &Mesh, both: bool, batches: u16) -> Estimates {
        let tracer = Tracer::new(mesh, &Opaque).unwrap();
        let options = OcclusionOptions::default();
        let signal = if both {
            BentNormal::with_occlusion(&tracer, mesh, options, 3)
        } else {
            BentNormal::new(&tracer, mesh, options, 3)
        };
        let mut estimates = Estimates::new(1, signal.channels());
        let middle = SurfacePoint { triangle: TriangleId(0), barycentric: [0.0, 0.5] };
        estimates.refine(&signal, &[middle], &[5], &[batches]);
        estimates
    }

    #[test]
    fn bent_normal_beside_a_wall_is_the_closed_form() {
        // An endless wall covers, in every plane across it, the directions nearer than `phi` to it, where
        // tan(phi) = height. With w = (sqrt(1-z^2) (cos a, sin a), z) and dw = da dz, the open part of 1/pi times the
        // integral of w times its cosine is 1/pi * 4/3 * integral from phi to pi of (cos a, sin a) sin a da.
        for height in [0.2_f64, 1.0, 7.0] {
            let phi = height.atan();
            let pi = std::f64::consts::PI;
            let x = -0.5 * phi.sin().powi(2);
            let y = 0.5 * (pi - phi) + 0.25 * (2.0 * phi).sin();
            let expected = [x, y].map(|v| v * 1.5 * 4.0 / 3.0 / pi);
            let estimates = value(&floor_and_wall(height as f32), false, 4000);
            let bent = estimates.mean(0);
            assert!((f64::from(bent[0]) - expected[0]).abs() < 3e-3, "{bent:?} {expected:?}");
            assert!((f64::from(bent[1]) - expected[1]).abs() < 3e-3, "{bent:?} {expected:?}");
            assert!(bent[2].abs() < 3e-3, "{bent:?}");
        }
    }

    #[test]
    fn bent_normal_with_occlusion_has_the_occlusion_of_the_same_rays() {
        let mesh = floor_and_wall(1.0);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let alone = AmbientOcclusion::new(&tracer, &mesh, f32::INFINITY, 3);
        let bent = BentNormal::new(&tracer, &mesh, OcclusionOptions::default(), 3);
        let both = BentNormal::with_occlusion(&tracer, &mesh, OcclusionOptions::default(), 3);
        assert_eq!(
            both.layers().iter().map(|l| l.name.as_str()).collect::<Vec<_>>(),
            ["ambientOcclusion", "bentNormal"]
        );
        let point = SurfacePoint { triangle: TriangleId(1), barycentric: [0.2, 0.5] };
        for batch in 0..5 {
            let (mut a, mut b, mut c) = ([0.0; 1], [0.0; 3], [0.0; 4]);
            let shares = [
                alone.batch(point, 8, batch, &mut a),
                bent.batch(point, 8, batch, &mut b),
                both.batch(point, 8, batch, &mut c),
            ];
            assert!(shares[0] == shares[1] && shares[0] == shares[2]);
            assert!(a[0] == c[0] && b == c[1..]);
        }
    }

    #[test]
    fn bent_normal_in_the_open_is_the_normal_and_closed_it_is_zero() {
        let open = value(&floor_and_wall(1e-3), true, 64);
        let open = Vec3::from_slice(&open.mean(0)[1..]);
        assert!((open - Vec3::Y).length() < 5e-3, "{open}");
        // A lid so near that it covers all.
        let mut mesh = floor_and_wall(1.0);
        for (corner, position) in mesh.positions[4..].iter_mut().enumerate() {
            let at = |bit: bool| if bit { 50.0 } else { -50.0 };
            *position = Vec3::new(at(corner == 1 || corner == 2), 1e-3, at(corner >= 2));
        }
        let closed = value(&mesh, true, 4);
        assert!(closed.mean(0).iter().all(|v| v.abs() < 1e-6), "{:?}", closed.mean(0));
    }
}
