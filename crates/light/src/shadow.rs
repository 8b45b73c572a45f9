//! Shadows: the share of a light that a point sees, with nothing said about how bright the light is.
//!
//! A small light makes hard shadows, a large one soft. The share is that of the disk's or parallelogram's area, and of the
//! angle under which suns and spheres are seen; what lies below the horizon is not seen. Where a coarse smooth surface
//! turns away from a light, the horizon is that of the shading normal, and rays start from where the smooth surface would
//! be (see `receiver`), so that the terminator shows no triangles.

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, cosine_hemisphere, frame, net};
use crate::inside::back_share;
use crate::receiver::Receiver;
use crate::{Layer, Light, LightError, Signal, Tracer};

/// A disk that shines to both sides.
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
pub struct Shadow<'a>(Shadows<'a>);

impl<'a> Shadow<'a> {
    /// - `seed`: another seed gives other rays
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, disk: Disk, seed: u64) -> Self {
        let axis = disk.axis.as_dvec3().try_normalize().map_or(Vec3::Y, |axis| axis.as_vec3());
        let across = frame(axis).map(|a| a * disk.radius);
        Self(Shadows::of_sources(tracer, mesh, vec![Source::Disk { centre: disk.centre, across }], seed))
    }
}

impl Signal for Shadow<'_> {
    fn layers(&self) -> &[Layer] {
        self.0.layers()
    }

    fn rays_per_batch(&self) -> u32 {
        self.0.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        self.0.batch(point, key, batch, out)
    }
}

/// The shadows of several lights, one channel each: 1 where the whole light is seen, 0 where none of it is.
///
/// Where a spot light does not shine, outside its outer angle, nothing of it is seen; within, its falloff does not count,
/// nor does that of any light. What lies behind a disk or parallelogram does not see it.
///
/// One light is one layer of one channel. More lights are layers of three channels, `shadow`, `shadow1` and so on;
/// channels without a light are 1.
pub struct Shadows<'a> {
    tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    sources: Vec<Source>,
    seed: u64,
    layers: Vec<Layer>,
}

#[derive(Clone, Copy, Debug)]
enum Source {
    Disk { centre: Vec3, across: [Vec3; 2] },
    Light(Light),
}

impl<'a> Shadows<'a> {
    /// - `lights`: at least one; how bright they are does not matter, but those that do not shine at all are not seen
    /// - `seed`: another seed gives other rays
    ///
    /// # Errors
    /// [`LightError::Light`] for the first light with a number that makes no sense.
    pub fn new(
        tracer: &'a Tracer<'a>,
        mesh: &'a Mesh,
        lights: &[Light],
        seed: u64,
    ) -> Result<Self, LightError> {
        if let Some((light, what)) = lights.iter().enumerate().find_map(|(i, l)| Some((i, l.fault()?))) {
            return Err(LightError::Light { light, what });
        }
        let sources = lights.iter().map(|light| Source::Light(light.normalized())).collect();
        Ok(Self::of_sources(tracer, mesh, sources, seed))
    }

    fn of_sources(tracer: &'a Tracer<'a>, mesh: &'a Mesh, sources: Vec<Source>, seed: u64) -> Self {
        let channels = if sources.len() > 1 { 3 } else { 1 };
        let layers = (0..sources.len().div_ceil(3).max(1))
            .map(|k| {
                let name = if k == 0 { "shadow".to_owned() } else { format!("shadow{k}") };
                Layer { channels, ..Layer::scalar(&name) }
            })
            .collect();
        Self { tracer, mesh, sources, seed, layers }
    }

    /// The share of a source that a batch of rays sees.
    fn seen(&self, source: &Source, receiver: &Receiver, key: u64) -> f32 {
        let hard = matches!(source, Source::Light(light) if light.is_hard());
        let samples = if hard { 1 } else { BATCH };
        // Rays from the point and, from the other end, those from the lifted point.
        let mut directions = [Vec3::ZERO; BATCH];
        let (mut plain, mut low, mut limit) = (0, BATCH, 1.0);
        for &square in &net(key)[..samples] {
            let Some(to) = source.sample(receiver.position, square) else { continue };
            // Rays to a place end there, after one length of their direction.
            if !to.is_finite() || to.dot(receiver.axis) <= 0.0 {
                continue;
            }
            if matches!(source, Source::Light(Light::Directional { .. })) {
                limit = f32::INFINITY;
            }
            if receiver.is_low(to.normalize_or_zero()) {
                low -= 1;
                directions[low] = to;
            } else {
                directions[plain] = to;
                plain += 1;
            }
        }
        let mut through = [0.0; BATCH];
        let (plain_through, rest) = through.split_at_mut(plain);
        self.tracer.transmittances(receiver.origin, &directions[..plain], limit, plain_through);
        if low < BATCH {
            let origin = receiver.lifted(self.tracer);
            self.tracer.transmittances(origin, &directions[low..], limit, &mut rest[low - plain..]);
        }
        through.iter().sum::<f32>() / samples as f32
    }
}

impl Source {
    /// From a position to a place of the source; of unit length for what is infinitely far. None where it does not
    /// shine.
    fn sample(&self, position: Vec3, square: [f32; 2]) -> Option<Vec3> {
        match *self {
            Self::Disk { centre, across: [x, y] } => {
                let place = cosine_hemisphere(square);
                Some(centre - position + x * place.x + y * place.y)
            }
            Self::Light(light) => {
                let sample = light.sample(position, square)?;
                let length = if sample.distance.is_finite() { sample.distance } else { 1.0 };
                Some(sample.direction * length)
            }
        }
    }
}

impl Signal for Shadows<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        out.fill(1.0);
        let back = self.tracer.surfaces().flags(point.triangle).turned;
        let Some(receiver) = Receiver::new(self.tracer, self.mesh, point, back) else {
            return 1.0;
        };
        let mut light = 0.0_f32;
        for (number, (source, out)) in self.sources.iter().zip(out).enumerate() {
            let key = random::hash(self.seed, key, u64::from(batch), 0x5d + ((number as u64) << 8));
            *out = self.seen(source, &receiver, key);
            light = light.max(*out);
        }
        if batch > 0 {
            return 0.0;
        }
        back_share(self.tracer, receiver.origin, receiver.geometric, key, light)
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
        let point = point_at(mesh, x);
        let mut estimates = Estimates::new(1, 1);
        estimates.refine(&Shadow::new(&tracer, mesh, disk, 0), &[point], &[9], &[batches]);
        (estimates.mean(0)[0], estimates.variance_of_mean(0, 0).sqrt())
    }

    fn point_at(mesh: &Mesh, x: f32) -> SurfacePoint {
        // (x, 0, 0) in the triangle (-10,-10), (-10,10), (10,10): halfway between second and third is (0, 10).
        [TriangleId(0), TriangleId(1)]
            .into_iter()
            .find_map(|triangle| {
                let [a, b, c] = mesh.corners(triangle);
                let (p, ab, ac) = (Vec3::X * x - a, b - a, c - a);
                let det = ab.x * ac.z - ab.z * ac.x;
                let barycentric = [(p.x * ac.z - p.z * ac.x) / det, (ab.x * p.z - ab.z * p.x) / det];
                let [u, v] = barycentric;
                (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some(SurfacePoint { triangle, barycentric })
            })
            .expect("the floor holds the point")
    }

    /// What is seen of several lights at (x, 0, 0).
    fn all_seen(mesh: &Mesh, lights: &[Light], x: f32, batches: u16) -> Vec<f32> {
        let tracer = Tracer::new(mesh, &Opaque).unwrap();
        let shadows = Shadows::new(&tracer, mesh, lights, 0).unwrap();
        let mut estimates = Estimates::new(1, shadows.channels());
        estimates.refine(&shadows, &[point_at(mesh, x)], &[9], &[batches]);
        assert!(estimates.valid(0));
        estimates.mean(0).to_vec()
    }

    #[test]
    fn shadows_of_a_straight_edge_by_lights_of_all_kinds() {
        let mesh = floor_and_edge(1.0);
        let position = Vec3::Y * 4.0;
        let (white, range) = (Vec3::ONE, f32::INFINITY);
        let down = Vec3::NEG_Y * 3.0;
        let lights = [
            Light::Directional { to_light: Vec3::Y * 2.0, illuminance: white, angular_radius: 0.05 },
            Light::Sphere { position, intensity: white, radius: 0.5, range },
            Light::Disk { position, direction: down, radius: 0.5, radiance: white },
            Light::Quad {
                corner: position - 0.5 * (Vec3::X + Vec3::Z),
                edges: [Vec3::X, Vec3::Z],
                radiance: white,
            },
            Light::Spot {
                position,
                direction: down,
                intensity: white,
                inner: 0.1,
                outer: 0.3,
                radius: 0.0,
                range,
            },
        ];
        let segment = |cut: f64| {
            let cut = cut.clamp(-1.0, 1.0);
            0.5 + (cut.asin() + cut * (1.0 - cut * cut).sqrt()) / std::f64::consts::PI
        };
        for step in [-6, -3, -1, 1, 3, 6] {
            let x = f64::from(step) * 0.01;
            let values = all_seen(&mesh, &lights, x as f32, 400);
            let expected = [
                segment(-x / 0.05_f64.tan()),
                // Seen under an angle whose sine is 1/8: a disk of radius 4 tan.
                segment(-3.0 * x / (4.0 * 0.125_f64.asin().tan())),
                segment(-3.0 * x / 0.5),
                (0.5 - 3.0 * x).clamp(0.0, 1.0),
                f64::from(u8::from(x < 0.0)),
                1.0,
            ];
            for (kind, (&value, expected)) in values.iter().zip(expected).enumerate() {
                assert!((f64::from(value) - expected).abs() < 0.012, "{kind} at {x}: {value} {expected}");
            }
        }
        // A quad whose front looks up is not seen; the spot's cone ends at 4 tan 0.3 = 1.24.
        let corner = position - 0.5 * (Vec3::X + Vec3::Z);
        let quad = Light::Quad { corner, edges: [Vec3::Z, Vec3::X], radiance: white };
        assert_eq!(all_seen(&mesh, &[quad], -1.0, 1), [0.0]);
        assert_eq!(all_seen(&mesh, &lights[4..], -1.2, 1), [1.0]);
        assert_eq!(all_seen(&mesh, &lights[4..], -1.3, 1), [0.0]);
    }

    #[test]
    fn shadows_are_layers_of_three_and_check_their_lights() {
        let mesh = floor_and_edge(1.0);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let sun = Light::sun(0.0, 1.0, Vec3::ONE);
        for (count, expected) in [(1, vec![1]), (2, vec![3]), (3, vec![3]), (7, vec![3, 3, 3])] {
            let shadows = Shadows::new(&tracer, &mesh, &vec![sun; count], 0).unwrap();
            assert_eq!(shadows.layers().iter().map(|l| l.channels).collect::<Vec<_>>(), expected);
        }
        let names: Vec<_> = Shadows::new(&tracer, &mesh, &[sun; 4], 0).unwrap().layers().to_vec();
        assert_eq!((names[0].name.as_str(), names[1].name.as_str()), ("shadow", "shadow1"));
        let bad = Light::Directional { to_light: Vec3::ZERO, illuminance: Vec3::ONE, angular_radius: 0.0 };
        let found = Shadows::new(&tracer, &mesh, &[sun, bad], 0).err();
        assert_eq!(found, Some(LightError::Light { light: 1, what: "direction" }));
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
