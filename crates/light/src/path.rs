//! Light that reaches a point of the surface: from lights, the sky and shining surfaces, and by way of other surfaces.
//!
//! Every surface reflects diffusely: the radiance that leaves it is albedo / pi times its irradiance, and that is
//! the mean over its hemisphere of what it sees (Kajiya 1986, eq. 1). A batch sends sixteen paths from the point, whose
//! first directions are one bundle of a scrambled net, and up to sixteen shadow rays to lights, another bundle. Wherever
//! a path meets a surface, one shadow ray goes to one light, and one ray on.
//!
//! Long paths end by Russian roulette on what they still carry (Arvo and Kirk 1990). Nothing is cut off by default: the
//! mean of batches is the truth.
//!
//! Deviation: secondary points see lights with hard shadows and soft ones alike by one sample of one light, chosen by
//! about what each would give.

use std::f32::consts::PI;

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, net};
use crate::emitters::emission;
use crate::harmonics::{COEFFICIENTS, basis, cosine_factor};
use crate::inside::{Backs, back_share};
use crate::lights::luminance;
use crate::receiver::Receiver;
use crate::sources::{Looks, ShadowRay, Sources, trace, weight as weigh};
use crate::tracer::share;
use crate::traverse::BUNDLE;
use crate::{Domain, Hit, Layer, LightError, Lighting, Origin, Signal, Tracer};

/// What [`PathTraced`] computes; each is in lux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Irradiance straight from lights, the sky and shining surfaces: layer `direct`.
    Direct,
    /// Irradiance by way of at least one other surface: layer `indirect`.
    Indirect,
    /// Both, which is what a lightmap shows: layer `irradiance`.
    Irradiance,
    /// The same as a function of the normal, in world space: layers `irradianceSh0` and on, one a coefficient of
    /// [`crate::harmonics`].
    Harmonics {
        /// 2 for four coefficients, 3 for nine; others are brought to the nearest of `1..=3`.
        bands: usize,
    },
}

/// How [`PathTraced`] works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathOptions {
    /// How many surfaces light may be reflected by on its way to the point.
    pub bounces: u32,
    /// Another seed gives other rays.
    pub seed: u64,
    /// The most that one path may bring by way of other surfaces, as luminance of the irradiance that sixteen of it
    /// would make, lux. None by default: any makes the result darker than the truth.
    pub clamp: Option<f32>,
}

impl Default for PathOptions {
    fn default() -> Self {
        Self { bounces: 32, seed: 0, clamp: None }
    }
}

/// Bounces from which on a path may end by chance.
const ROULETTE_FROM: u32 = 3;
/// Translucent surfaces that a path goes through.
const MOST_PANES: u32 = 256;
/// Bounces whose random numbers are spread over the paths of a batch.
const SPREAD: usize = 2;
/// The most that a surface reflects.
const MOST_ALBEDO: f32 = 0.95;

/// Light at points of a surface by path tracing. Every output comes from the same rays.
///
/// Batch 0 also counts the backs that are seen first, as [`crate::AmbientOcclusion`] does: see [`crate::inside`].
pub struct PathTraced<'a> {
    tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    sources: Sources<'a>,
    options: PathOptions,
    outputs: Vec<Output>,
    layers: Vec<Layer>,
    indirect: bool,
    harmonics: usize,
}

/// What has arrived at a point.
struct Sums {
    direct: Vec3,
    indirect: Vec3,
    harmonics: [Vec3; COEFFICIENTS],
    /// How many of `harmonics` are wanted.
    wanted: usize,
}

impl Sums {
    /// - `facing`: lux on a surface that faces the direction
    fn arrive(&mut self, direction: Vec3, facing: Vec3, cosine: f32, share: f32, indirect: bool) {
        *(if indirect { &mut self.indirect } else { &mut self.direct }) += facing * cosine;
        if self.wanted > 0 {
            let facing = facing / share;
            for (k, (sum, b)) in self.harmonics.iter_mut().zip(basis(direction)).take(self.wanted).enumerate()
            {
                *sum += facing * (b * cosine_factor(k));
            }
        }
    }
}

impl<'a> PathTraced<'a> {
    /// - `outputs`: what is wanted, in the order of the layers
    ///
    /// # Errors
    /// [`LightError::Light`] for a light with a number that makes no sense.
    pub fn new(
        tracer: &'a Tracer<'a>,
        mesh: &'a Mesh,
        lighting: &'a Lighting,
        outputs: &[Output],
        options: PathOptions,
    ) -> Result<Self, LightError> {
        let light = |name: String, domain| Layer { name, channels: 3, domain };
        let mut layers = Vec::new();
        let mut harmonics = 0;
        for output in outputs {
            match *output {
                Output::Direct => layers.push(light("direct".into(), Domain::Hdr)),
                Output::Indirect => layers.push(light("indirect".into(), Domain::Hdr)),
                Output::Irradiance => layers.push(light("irradiance".into(), Domain::Hdr)),
                Output::Harmonics { bands } => {
                    let count = bands.clamp(1, 3).pow(2);
                    harmonics = harmonics.max(count);
                    for k in 0..count {
                        let domain = if k == 0 { Domain::Hdr } else { Domain::SignedHdr };
                        layers.push(light(format!("irradianceSh{k}"), domain));
                    }
                }
            }
        }
        Ok(Self {
            tracer,
            mesh,
            sources: Sources::new(tracer, mesh, lighting)?,
            options,
            outputs: outputs.to_vec(),
            layers,
            indirect: options.bounces > 0 && outputs.iter().any(|o| *o != Output::Direct),
            harmonics,
        })
    }

    /// Whether any light can reach any point.
    pub fn has_light(&self) -> bool {
        !self.sources.is_empty()
    }

    /// Follows the sixteen paths of a batch.
    fn hemisphere(&self, receiver: &Receiver, looks: Looks, key: u64, sums: &mut Sums) -> Backs {
        let directions = net(stream(key, 1)).map(|square| receiver.direction(square));
        let mut hits: [Option<Hit>; BATCH] = [None; BATCH];
        self.tracer.first_hits(receiver.origin, &directions, f32::INFINITY, &mut hits);
        let mut backs = Backs::default();
        hits.iter().flatten().for_each(|hit| backs.see(self.tracer, hit));
        let bounces = if self.indirect { self.options.bounces } else { 0 };
        let spread = if bounces > 0 { SPREAD } else { 0 };
        let mut nets = [[[[0.0; 2]; BATCH]; 3]; SPREAD];
        for (depth, nets) in nets.iter_mut().enumerate().take(spread) {
            for (k, net_of) in nets.iter_mut().enumerate() {
                *net_of = net(stream(key, 0x10 + 4 * depth as u64 + k as u64));
            }
        }
        for (i, (&direction, &hit)) in directions.iter().zip(&hits).enumerate() {
            let cosine = receiver.cosine(direction);
            let density = receiver.density(direction);
            // Cosines leave nothing at the horizon, harmonics do.
            if direction.dot(receiver.geometric) <= 0.0 || density <= 0.0 {
                continue;
            }
            let numbers = Numbers { nets: &nets, path: i, key: stream(key, 0x100 + i as u64) };
            let [direct, mut indirect] = self.follow(direction, hit, looks, density, bounces, &numbers);
            if let Some(most) = self.options.clamp {
                indirect *= (most / (luminance(indirect) * PI)).min(1.0);
            }
            let scale = 1.0 / (BATCH as f32 * density);
            sums.arrive(direction, direct * scale, cosine, receiver.share, false);
            sums.arrive(direction, indirect * scale, cosine, receiver.share, true);
        }
        backs
    }

    /// The radiance from a direction, of shining things seen there and by way of surfaces.
    ///
    /// - `looks`, `density`: of the rays of the point that the path starts from
    fn follow(
        &self,
        mut direction: Vec3,
        mut hit: Option<Hit>,
        mut looks: Looks,
        mut density: f32,
        bounces: u32,
        numbers: &Numbers<'_>,
    ) -> [Vec3; 2] {
        let (tracer, mesh, surfaces) = (self.tracer, self.mesh, self.tracer.surfaces());
        let mut radiance = [Vec3::ZERO; 2];
        let mut weight = Vec3::ONE;
        let (mut depth, mut panes, mut travelled) = (0, 0, 0.0);
        loop {
            let found = &mut radiance[usize::from(depth > 0)];
            let own = looks.hemisphere * density;
            let Some(met) = hit else {
                if let Some(environment) = self.sources.environment
                    && own > 0.0
                {
                    let (shown, density) = environment.look(direction);
                    *found += weight * shown * weigh(own, looks.sky * density);
                }
                break;
            };
            travelled += met.distance;
            let point = SurfacePoint { triangle: met.triangle, barycentric: met.barycentric };
            let flags = surfaces.flags(met.triangle);
            let seen = met.back == flags.turned || flags.double_sided;
            if seen && own > 0.0 {
                let shines = emission(surfaces, met.triangle, met.barycentric);
                if shines != Vec3::ZERO {
                    let mut others = 0.0;
                    if looks.emitters > 0.0 {
                        let facing = direction.dot(mesh.geometric_normal(met.triangle)).abs().max(1e-9);
                        let area = self.sources.emitters.density(met.triangle);
                        others = looks.emitters * area * travelled * travelled / facing;
                    }
                    *found += weight * shines * weigh(own, others);
                }
            }
            let mut keeps = Vec3::ONE;
            if flags.translucent {
                let clear = share(surfaces.transmission(met.triangle, met.barycentric));
                let opacity = Vec3::splat(surfaces.opacity(met.triangle, met.barycentric));
                keeps = share(opacity).min(Vec3::ONE - clear);
                let (passes, stays) = ((weight * clear).max_element(), (weight * keeps).max_element());
                let through = passes / (passes + stays);
                if panes >= MOST_PANES || passes + stays <= 0.0 {
                    break;
                }
                panes += 1;
                if random::unit(stream(numbers.key, 0x8000 + u64::from(panes))) < through {
                    weight *= clear / through;
                    let Some((origin, _)) = Origin::on_side(tracer, mesh, point, !met.back) else { break };
                    let mut next = [None];
                    tracer.first_hits(origin, &[direction], f32::INFINITY, &mut next);
                    hit = next[0];
                    continue;
                }
                weight /= 1.0 - through;
            }
            if depth >= bounces || !seen {
                break;
            }
            let albedo = surfaces.albedo(met.triangle, met.barycentric);
            weight *= keeps * share(albedo).min(Vec3::splat(MOST_ALBEDO));
            depth += 1;
            if weight.max_element() <= 0.0 {
                break;
            }
            if depth >= ROULETTE_FROM {
                let survives = weight.max_element().min(1.0);
                if random::unit(stream(numbers.key, 0x4000 + u64::from(depth))) >= survives {
                    break;
                }
                weight /= survives;
            }
            let Some(receiver) = Receiver::new(tracer, mesh, point, met.back) else { break };
            let [next, choice, place] = numbers.of(depth);
            let key = stream(numbers.key, 0x6000 + u64::from(depth));
            let (mut ray, found) = self.sources.of_bounce(&receiver, choice[0], place, key);
            trace(tracer, &receiver, ray.as_mut_slice(), |ray| {
                radiance[1] += weight * ray.facing * (ray.cosine / PI);
            });
            looks = found;
            direction = receiver.direction(next);
            density = receiver.density(direction);
            // After the last bounce only what shines by itself is looked for.
            if density <= 0.0 || (depth >= bounces && !self.sources.surround()) {
                break;
            }
            let mut next = [None];
            tracer.first_hits(receiver.origin, &[direction], f32::INFINITY, &mut next);
            (hit, travelled) = (next[0], 0.0);
        }
        radiance
    }
}

/// Another stream of random numbers of the same key.
fn stream(key: u64, number: u64) -> u64 {
    random::finalize(key ^ number.wrapping_mul(0x9fb2_1c65_1e98_df25))
}

/// Random numbers of one path of a batch.
struct Numbers<'a> {
    /// For each bounce, three points a path: where to go on, which light, where on it.
    nets: &'a [[[[f32; 2]; BATCH]; 3]; SPREAD],
    path: usize,
    key: u64,
}

impl Numbers<'_> {
    /// - `depth`: bounces so far, from 1
    fn of(&self, depth: u32) -> [[f32; 2]; 3] {
        match self.nets.get(depth as usize - 1) {
            Some(nets) => std::array::from_fn(|k| nets[k][self.path]),
            None => std::array::from_fn(|k| random::unit2(stream(self.key, u64::from(depth) * 4 + k as u64))),
        }
    }
}

impl Signal for PathTraced<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        BATCH as u32
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let back = self.tracer.surfaces().flags(point.triangle).turned;
        let Some(receiver) = Receiver::new(self.tracer, self.mesh, point, back) else {
            // A point without a plane sees nothing in particular, and is not to be trusted.
            out.fill(0.0);
            return 1.0;
        };
        let receiver = if self.harmonics > 0 { receiver.spread() } else { receiver };
        let stream_key = random::hash(self.options.seed, key, u64::from(batch), 0x9a);
        let mut sums = Sums {
            direct: Vec3::ZERO,
            indirect: Vec3::ZERO,
            harmonics: [Vec3::ZERO; COEFFICIENTS],
            wanted: self.harmonics,
        };
        let (mut rays, mut count) = ([ShadowRay::default(); BUNDLE], 0);
        // There are at most half as many rays.
        let mut push = |ray: ShadowRay| {
            if ray.facing != Vec3::ZERO && count < BUNDLE {
                rays[count] = ray;
                count += 1;
            }
        };
        let looks = self.sources.of_point(&receiver, BATCH as f32, stream(stream_key, 2), &mut push);
        trace(self.tracer, &receiver, &mut rays[..count], |ray| {
            sums.arrive(ray.direction, ray.facing, ray.cosine, ray.share, false);
        });
        let looks_around = self.indirect || self.sources.surround();
        let backs = looks_around.then(|| self.hemisphere(&receiver, looks, stream_key, &mut sums));
        let mut values = out.chunks_exact_mut(3);
        let mut write = |value: Vec3| {
            if let Some(slot) = values.next() {
                slot.copy_from_slice(&value.to_array());
            }
        };
        for output in &self.outputs {
            match *output {
                Output::Direct => write(sums.direct),
                Output::Indirect => write(sums.indirect),
                Output::Irradiance => write(sums.direct + sums.indirect),
                Output::Harmonics { bands } => {
                    sums.harmonics[..bands.clamp(1, 3).pow(2)].iter().for_each(|&c| write(c));
                }
            }
        }
        if batch > 0 {
            return 0.0;
        }
        let light = if sums.direct + sums.indirect == Vec3::ZERO { 0.0 } else { 1.0 };
        match backs {
            Some(backs) => backs.share(BATCH, light),
            None => back_share(self.tracer, receiver.origin, receiver.geometric, key, light),
        }
    }
}

#[cfg(test)]
mod tests;
