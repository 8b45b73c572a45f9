//! Ambient occlusion: the share of the cosine-weighted hemisphere that is open.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, cosine_hemisphere, frame, net};
use crate::{Hit, Layer, Origin, Signal, Tracer};

/// Ambient occlusion: 1 where the hemisphere around the shading normal is open, 0 where it is closed.
///
/// Rays are cosine-weighted about the interpolated shading normal. Those below the horizon of the triangle
/// itself are left out of the count as well as of the sum, so that a smooth convex surface is 1 everywhere
/// however coarse its triangles are. A shading normal that points behind the triangle is replaced by the
/// geometric one.
///
/// Batch 0 also finds the share of directions in which the first thing seen, at any distance, is the back of
/// an opaque triangle: see [`crate::Estimates::valid`]. Backs of double-sided triangles count only where
/// nearly all that is seen are backs and nearly no light arrives: exporters mark closed parts as double-sided,
/// and a point inside such a part is in the dark; a room of single walls that face outward is not.
pub struct AmbientOcclusion<'a> {
    tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    distance: f32,
    seed: u64,
    layers: [Layer; 1],
}

impl<'a> AmbientOcclusion<'a> {
    /// - `distance`: what is farther away does not occlude, in units of the mesh; may be infinite
    /// - `seed`: another seed gives other rays
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, distance: f32, seed: u64) -> Self {
        Self { tracer, mesh, distance, seed, layers: [Layer::scalar("ambientOcclusion")] }
    }

    /// Openness in each direction, and the share of backs seen first that speaks for being inside.
    ///
    /// A first hit that is opaque decides its ray; only rays behind something translucent are traced again.
    fn probe(&self, origin: Origin, directions: &[Vec3], through: &mut [f32]) -> f32 {
        let mut hits: [Option<Hit>; BATCH] = [None; BATCH];
        let hits = &mut hits[..directions.len()];
        self.tracer.first_hits(origin, directions, f32::INFINITY, hits);
        let (mut again, mut places, mut count) = ([Vec3::ZERO; BATCH], [0; BATCH], 0);
        let (mut backs, mut single_backs) = (0, 0);
        for (ray, hit) in hits.iter().enumerate() {
            through[ray] = 1.0;
            let Some(hit) = hit else { continue };
            let flags = self.tracer.surfaces().flags(hit.triangle);
            if flags.translucent {
                (again[count], places[count]) = (directions[ray], ray);
                count += 1;
                continue;
            }
            let back = hit.back != flags.turned;
            backs += u32::from(back);
            single_backs += u32::from(back && !flags.double_sided);
            if hit.distance <= self.distance {
                through[ray] = 0.0;
            }
        }
        let mut rest = [1.0; BATCH];
        self.tracer.transmittances(origin, &again[..count], self.distance, &mut rest[..count]);
        for (&place, &value) in places.iter().zip(&rest).take(count) {
            through[place] = value;
        }
        let rays = directions.len() as f32;
        let enclosed = backs as f32 >= ENCLOSED * rays && through.iter().sum::<f32>() <= DARK * rays;
        if enclosed { 1.0 } else { single_backs as f32 / rays }
    }

    /// One batch on a given side of the surface: see [`Signal::batch`]. `back` asks for the side that the
    /// triangle's winding turns away.
    pub fn batch_on_side(
        &self,
        point: SurfacePoint,
        key: u64,
        batch: u32,
        back: bool,
        out: &mut [f32],
    ) -> f32 {
        // A point without a plane sees nothing in particular: open, and not to be trusted.
        let Some((origin, geometric)) = Origin::on_side(self.tracer, self.mesh, point, back) else {
            out[0] = 1.0;
            return 1.0;
        };
        let shading = self.mesh.shading_normal(point) * if back { -1.0 } else { 1.0 };
        let axis = if shading.dot(geometric) > 0.0 { shading } else { geometric };
        let squares = net(random::hash(self.seed, key, u64::from(batch), 0xa0));
        let mut directions = [Vec3::ZERO; BATCH];
        let mut count = above(&squares, axis, geometric, &mut directions);
        if count == 0 {
            count = above(&squares, geometric, geometric, &mut directions);
        }
        let directions = &directions[..count];
        let mut through = [0.0; BATCH];
        let through = &mut through[..count];
        let backs = if batch == 0 {
            self.probe(origin, directions, through)
        } else {
            self.tracer.transmittances(origin, directions, self.distance, through);
            0.0
        };
        out[0] = through.iter().sum::<f32>() / count as f32;
        backs
    }
}

/// All but this share of the rays meet backs, and none but this share of the light arrives, in closed parts.
const ENCLOSED: f32 = 0.97;
const DARK: f32 = 0.03;

impl Signal for AmbientOcclusion<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let back = self.tracer.surfaces().flags(point.triangle).turned;
        self.batch_on_side(point, key, batch, back, out)
    }
}

/// The directions about `axis` that lie above the plane of `geometric`; how many they are.
fn above(squares: &[[f32; 2]; BATCH], axis: Vec3, geometric: Vec3, directions: &mut [Vec3; BATCH]) -> usize {
    let [x, y] = frame(axis);
    let mut count = 0;
    for &square in squares {
        let local = cosine_hemisphere(square);
        let direction = x * local.x + y * local.y + axis * local.z;
        if direction.dot(geometric) > 0.0 {
            directions[count] = direction;
            count += 1;
        }
    }
    count
}
