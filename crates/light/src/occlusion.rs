//! Ambient occlusion: the share of the cosine-weighted hemisphere that is open.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, cosine_hemisphere, frame, net};
use crate::inside::Backs;
use crate::{Hit, Layer, Origin, Signal, Tracer};

/// How much an occluder counts by its distance `d`, up to the distance `D` of the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Falloff {
    /// Wholly up to `D`, and not at all behind it.
    #[default]
    Hard,
    /// By `(1 - d / D)^power`: no edge where occluders come into reach. An infinite `D` makes it [`Self::Hard`].
    Smooth {
        /// Above 0; 1 falls evenly, 2 keeps darkness closer to the contact.
        power: f32,
    },
}

/// A floor that is not in the file: a level plane that occludes, and under which nothing is seen.
///
/// For pictures of single products; the mesh stays as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ground {
    /// At a height, in units of the mesh; up is +y, as glTF says.
    Height(f32),
    /// Under the lowest vertex.
    Lowest,
}

/// What occludes, and by how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcclusionOptions {
    /// What is farther away does not occlude, in units of the mesh; may be infinite.
    pub distance: f32,
    /// What nearer things count.
    pub falloff: Falloff,
    /// One more occluder.
    pub ground: Option<Ground>,
}

impl Default for OcclusionOptions {
    fn default() -> Self {
        Self { distance: f32::INFINITY, falloff: Falloff::Hard, ground: None }
    }
}

/// The rays of a point and how open each of them is: what ambient occlusion and bent normals have in common.
///
/// Rays are cosine-weighted about the interpolated shading normal. Those below the horizon of the triangle
/// itself are left out, so that a smooth convex surface is open everywhere however coarse its triangles are. A
/// shading normal that points behind the triangle is replaced by the geometric one.
pub(crate) struct Openness<'a> {
    pub tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    distance: f32,
    /// The exponent of a smooth falloff.
    power: Option<f32>,
    /// The height of the ground, and how far below it rounding may put a point that stands on it.
    ground: Option<[f32; 2]>,
    seed: u64,
}

/// A batch of rays that have been traced.
pub(crate) struct Look {
    /// What the rays are spread about.
    pub axis: Vec3,
    /// All rays of the batch; those above the triangle stand first.
    pub directions: [Vec3; BATCH],
    /// How many are above the triangle; never 0.
    pub above: usize,
    /// How open each of these is, `0..=1`.
    pub through: [f32; BATCH],
    /// The share of backs seen first, see [`Signal::batch`].
    pub backs: f32,
}

impl Look {
    /// The share of the rays that are open.
    pub(crate) fn open(&self) -> f32 {
        self.through[..self.above].iter().sum::<f32>() / self.above as f32
    }
}

/// Translucent panes that a ray with a smooth falloff goes through before it is given up as dark.
const MOST_PANES: u32 = 64;

impl<'a> Openness<'a> {
    pub(crate) fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, options: OcclusionOptions, seed: u64) -> Self {
        let OcclusionOptions { distance, falloff, ground } = options;
        let power = match falloff {
            Falloff::Smooth { power } if distance.is_finite() && power > 0.0 => Some(power),
            _ => None,
        };
        let ground = ground.map(|ground| {
            let (low, high) = mesh.bounds();
            let height = match ground {
                Ground::Height(height) => height,
                Ground::Lowest => low.y,
            };
            [height, 1e-6 * low.abs().max_element().max(high.abs().max_element())]
        });
        Self { tracer, mesh, distance, power, ground, seed }
    }

    /// Whether a point's triangle is looked at from its back.
    pub(crate) fn is_turned(&self, point: SurfacePoint) -> bool {
        self.tracer.surfaces().flags(point.triangle).turned
    }

    /// Traces a batch. None for a point without a plane, which sees nothing in particular.
    pub(crate) fn look(&self, point: SurfacePoint, key: u64, batch: u32, back: bool) -> Option<Look> {
        let (origin, geometric) = Origin::on_side(self.tracer, self.mesh, point, back)?;
        let shading = self.mesh.shading_normal(point) * if back { -1.0 } else { 1.0 };
        let squares = net(random::hash(self.seed, key, u64::from(batch), 0xa0));
        let axis = if shading.dot(geometric) > 0.0 { shading } else { geometric };
        let mut look =
            Look { axis, directions: [Vec3::ZERO; BATCH], above: 0, through: [1.0; BATCH], backs: 0.0 };
        look.spread(&squares, geometric);
        if look.above == 0 {
            look.axis = geometric;
            look.spread(&squares, geometric);
        }
        let height = self.mesh.position(point).y;
        if let Some([ground, rounding]) = self.ground
            && height < ground - rounding
        {
            look.through = [0.0; BATCH];
            look.backs = 1.0;
            return Some(look);
        }
        let directions = &look.directions[..look.above];
        let through = &mut look.through[..look.above];
        if batch == 0 {
            look.backs = self.probe(origin, height, directions, through);
        } else if self.power.is_some() {
            let mut hits = [None; BATCH];
            let hits = &mut hits[..directions.len()];
            self.tracer.first_hits(origin, directions, self.distance, hits);
            for ((&direction, hit), through) in directions.iter().zip(hits).zip(through.iter_mut()) {
                *through = self.behind(direction, *hit);
            }
        } else {
            self.tracer.transmittances(origin, directions, self.distance, through);
        }
        for (&direction, through) in directions.iter().zip(through) {
            if let Some(distance) = self.to_ground(height, direction) {
                *through *= 1.0 - self.darkness(distance);
            }
        }
        Some(look)
    }

    /// How dark an opaque thing at a distance makes a ray.
    fn darkness(&self, distance: f32) -> f32 {
        match self.power {
            _ if distance > self.distance => 0.0,
            None => 1.0,
            Some(power) => (1.0 - distance / self.distance).max(0.0).powf(power),
        }
    }

    /// How far a ray goes to the ground, if it does.
    fn to_ground(&self, height: f32, direction: Vec3) -> Option<f32> {
        let [ground, _] = self.ground.filter(|_| direction.y < 0.0)?;
        Some((ground - height).min(0.0) / direction.y)
    }

    /// How open a ray with a smooth falloff is, whose first hit is known. Each pane that it goes through dims it by
    /// its opacity as much as its distance counts; the first opaque triangle ends it.
    fn behind(&self, direction: Vec3, first: Option<Hit>) -> f32 {
        let (mut through, mut travelled, mut next) = (1.0, 0.0, first);
        for _ in 0..MOST_PANES {
            let Some(hit) = next else { return through };
            travelled += hit.distance;
            let darkness = self.darkness(travelled);
            if !self.tracer.surfaces().flags(hit.triangle).translucent {
                return through * (1.0 - darkness);
            }
            let opacity = self.tracer.surfaces().opacity(hit.triangle, hit.barycentric).clamp(0.0, 1.0);
            through *= 1.0 - opacity * darkness;
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            let Some((origin, _)) = Origin::on_side(self.tracer, self.mesh, point, !hit.back) else {
                return through;
            };
            let mut hits = [None];
            self.tracer.first_hits(origin, &[direction], self.distance - travelled, &mut hits);
            next = hits[0];
        }
        0.0
    }

    /// Openness in each direction, and the share of backs seen first that speaks for being inside.
    ///
    /// A first hit that is opaque decides its ray; only rays behind something translucent are traced again.
    fn probe(&self, origin: Origin, height: f32, directions: &[Vec3], through: &mut [f32]) -> f32 {
        let mut hits: [Option<Hit>; BATCH] = [None; BATCH];
        let hits = &mut hits[..directions.len()];
        self.tracer.first_hits(origin, directions, f32::INFINITY, hits);
        let (mut again, mut places, mut count) = ([Vec3::ZERO; BATCH], [0; BATCH], 0);
        let mut backs = Backs::default();
        for (ray, hit) in hits.iter().enumerate() {
            through[ray] = 1.0;
            if let Some(hit) = hit {
                if self.to_ground(height, directions[ray]).is_none_or(|ground| hit.distance <= ground) {
                    backs.see(self.tracer, hit);
                }
                if !self.tracer.surfaces().flags(hit.triangle).translucent {
                    through[ray] = 1.0 - self.darkness(hit.distance);
                } else if self.power.is_some() {
                    through[ray] = self.behind(directions[ray], Some(*hit));
                } else {
                    (again[count], places[count]) = (directions[ray], ray);
                    count += 1;
                }
            }
        }
        let mut rest = [1.0; BATCH];
        self.tracer.transmittances(origin, &again[..count], self.distance, &mut rest[..count]);
        for (&place, &value) in places.iter().zip(&rest).take(count) {
            through[place] = value;
        }
        backs.share(directions.len(), through.iter().sum::<f32>() / directions.len() as f32)
    }
}

impl Look {
    /// The directions about the axis, those above the plane of `geometric` first.
    fn spread(&mut self, squares: &[[f32; 2]; BATCH], geometric: Vec3) {
        let [x, y] = frame(self.axis);
        let (mut above, mut below) = (0, BATCH);
        for &square in squares {
            let local = cosine_hemisphere(square);
            let direction = x * local.x + y * local.y + self.axis * local.z;
            if direction.dot(geometric) > 0.0 {
                self.directions[above] = direction;
                above += 1;
            } else {
                below -= 1;
                self.directions[below] = direction;
            }
        }
        self.above = above;
    }
}

/// Ambient occlusion: 1 where the hemisphere around the shading normal is open, 0 where it is closed.
///
/// Rays are cosine-weighted about the interpolated shading normal. Those below the horizon of the triangle
/// itself are left out of the count as well as of the sum, so that a smooth convex surface is 1 everywhere
/// however coarse its triangles are. A shading normal that points behind the triangle is replaced by the
/// geometric one.
///
/// Batch 0 also finds the share of directions in which the first thing seen, at any distance, is the back of
/// an opaque triangle: see [`crate::Estimates::valid`] and [`crate::inside`].
pub struct AmbientOcclusion<'a> {
    rays: Openness<'a>,
    layers: [Layer; 1],
}

impl<'a> AmbientOcclusion<'a> {
    /// Hard occlusion without a ground.
    ///
    /// - `distance`: what is farther away does not occlude, in units of the mesh; may be infinite
    /// - `seed`: another seed gives other rays
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, distance: f32, seed: u64) -> Self {
        Self::with_options(tracer, mesh, OcclusionOptions { distance, ..Default::default() }, seed)
    }

    /// The same with everything that can be chosen.
    pub fn with_options(
        tracer: &'a Tracer<'a>,
        mesh: &'a Mesh,
        options: OcclusionOptions,
        seed: u64,
    ) -> Self {
        Self { rays: Openness::new(tracer, mesh, options, seed), layers: [Layer::scalar("ambientOcclusion")] }
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
        // A point without a plane is open, and not to be trusted.
        let Some(look) = self.rays.look(point, key, batch, back) else {
            out[0] = 1.0;
            return 1.0;
        };
        out[0] = look.open();
        look.backs
    }
}

impl Signal for AmbientOcclusion<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        self.batch_on_side(point, key, batch, self.rays.is_turned(point), out)
    }
}
