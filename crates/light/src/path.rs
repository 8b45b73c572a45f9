//! Light that reaches a point of the surface: from lights, the sky and shining surfaces, and by way of other surfaces.
//!
//! Every surface reflects diffusely: the radiance that leaves it is albedo / pi times its irradiance, and that is
//! the mean over its hemisphere of what it sees (Kajiya 1986, eq. 1). A batch sends sixteen paths from the point, whose
//! first directions are one bundle of a scrambled net, and up to sixteen shadow rays to lights, another bundle. Wherever
//! a path meets a surface, one shadow ray goes to one light, and one ray on.
//!
//! The sky and shining surfaces are found by both kinds of rays, which are weighed by the balance heuristic (Veach and
//! Guibas 1995, §3): what a direction shows counts once over the sum of the densities with which all rays look there.
//! Long paths end by Russian roulette on what they still carry (Arvo and Kirk 1990). Nothing is cut off by default: the
//! mean of batches is the truth.
//!
//! Deviation: secondary points see lights with hard shadows and soft ones alike by one sample of one light, chosen by
//! about what each would give.

use std::f32::consts::PI;

use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, random};

use crate::directions::{BATCH, net};
use crate::emitters::{Emitters, emission};
use crate::harmonics::{COEFFICIENTS, basis, cosine_factor};
use crate::inside::{Backs, back_share};
use crate::lights::{Light, LightSample, luminance};
use crate::receiver::Receiver;
use crate::traverse::BUNDLE;
use crate::{Domain, Environment, Hit, Layer, LightError, Lighting, Origin, Signal, Tracer};

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

/// Which rays may find the sky and shining surfaces; all but the first are for tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Strategy {
    Both,
    Lights,
    Hemisphere,
}

/// Bounces from which on a path may end by chance.
const ROULETTE_FROM: u32 = 3;
/// Shadow rays of a batch, unless there are fewer lights.
const LIGHT_RAYS: usize = 16;
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
    lights: Vec<Light>,
    environment: Option<&'a Environment>,
    emitters: Emitters,
    options: PathOptions,
    outputs: Vec<Output>,
    layers: Vec<Layer>,
    pub(crate) strategy: Strategy,
    indirect: bool,
    harmonics: usize,
}

/// How many rays look for the sky and for shining surfaces: what the balance heuristic needs.
#[derive(Clone, Copy)]
struct Looks {
    hemisphere: f32,
    sky: f32,
    emitters: f32,
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

/// Shadow rays from one point.
struct ShadowRays {
    count: usize,
    directions: [Vec3; BUNDLE],
    limits: [f32; BUNDLE],
    /// What each brings if nothing is in the way: lux on a surface that faces it.
    facing: [Vec3; BUNDLE],
    /// What that counts for at the point, and what the share of the hemisphere is taken for.
    cosines: [[f32; 2]; BUNDLE],
}

impl ShadowRays {
    fn new() -> Self {
        Self {
            count: 0,
            directions: [Vec3::ZERO; BUNDLE],
            limits: [0.0; BUNDLE],
            facing: [Vec3::ZERO; BUNDLE],
            cosines: [[0.0; 2]; BUNDLE],
        }
    }

    /// A ray too many is left out; there are never so many.
    fn push(&mut self, (direction, limit): (Vec3, f32), facing: Vec3, cosines: [f32; 2]) {
        if self.count < BUNDLE && facing != Vec3::ZERO {
            self.directions[self.count] = direction;
            self.limits[self.count] = limit;
            self.facing[self.count] = facing;
            self.cosines[self.count] = cosines;
            self.count += 1;
        }
    }

    fn trace(&self, tracer: &Tracer<'_>, origin: Origin, mut arrive: impl FnMut(Vec3, Vec3, [f32; 2])) {
        if self.count == 0 {
            return;
        }
        let mut tints = [Vec3::ZERO; BUNDLE];
        let count = self.count;
        tracer.tints(origin, &self.directions[..count], &self.limits[..count], &mut tints[..count]);
        for (ray, &tint) in tints[..count].iter().enumerate() {
            if tint != Vec3::ZERO {
                arrive(self.directions[ray], self.facing[ray] * tint, self.cosines[ray]);
            }
        }
    }
}

/// Shadow rays of a point: from the point itself, and from where it is lifted to.
struct Shadows {
    plain: ShadowRays,
    lifted: ShadowRays,
}

impl Shadows {
    fn new() -> Self {
        Self { plain: ShadowRays::new(), lifted: ShadowRays::new() }
    }

    /// - `arrive`: direction, lux on a surface facing it, cosine and share
    fn trace(&self, tracer: &Tracer<'_>, receiver: &Receiver, mut arrive: impl FnMut(Vec3, Vec3, [f32; 2])) {
        self.plain.trace(tracer, receiver.origin, &mut arrive);
        if self.lifted.count > 0 {
            self.lifted.trace(tracer, receiver.lifted(tracer), &mut arrive);
        }
    }
}

/// From one start to another: direction, distance in the tracer's coordinates.
fn between(from: Origin, to: Origin) -> Option<(Vec3, f32)> {
    let way = to.position - from.position;
    let length = way.length();
    (length > 0.0).then(|| (way / length, length))
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
            lights: lighting.checked()?,
            environment: lighting.environment.as_ref(),
            emitters: Emitters::new(mesh, tracer.surfaces()),
            options,
            outputs: outputs.to_vec(),
            layers,
            strategy: Strategy::Both,
            indirect: options.bounces > 0 && outputs.iter().any(|o| *o != Output::Direct),
            harmonics,
        })
    }

    /// Whether any light can reach any point.
    pub fn has_light(&self) -> bool {
        !self.lights.is_empty() || self.environment.is_some() || !self.emitters.is_empty()
    }

    fn samples_sky(&self) -> Option<&'a Environment> {
        let sampled = self.strategy != Strategy::Hemisphere;
        self.environment.filter(|e| sampled && e.sampled_luminance() > 0.0)
    }

    fn samples_emitters(&self) -> bool {
        self.strategy != Strategy::Hemisphere && !self.emitters.is_empty()
    }

    /// Density with which the hemisphere rays of the baked point look in a direction.
    ///
    /// Harmonics want directions near the horizon too, which cosines leave out: half of the rays are uniform.
    fn first_density(&self, receiver: &Receiver, direction: Vec3) -> f32 {
        let cosine = receiver.cosine(direction) / PI;
        if self.harmonics > 0 { 0.5 * cosine + 0.25 / PI } else { cosine }
    }

    fn first_direction(&self, receiver: &Receiver, [x, y]: [f32; 2]) -> Vec3 {
        if self.harmonics == 0 {
            receiver.direction([x, y])
        } else if x < 0.5 {
            receiver.direction([2.0 * x, y])
        } else {
            receiver.uniform_direction([2.0 * x - 1.0, y])
        }
    }

    /// A sample of a light; `scale` is one over the number of samples expected.
    fn push_light(&self, shadows: &mut Shadows, receiver: &Receiver, sample: LightSample, scale: f32) {
        let LightSample { direction, distance, illuminance } = sample;
        let cosine = receiver.axis.dot(direction);
        let low = receiver.is_low(direction);
        if cosine <= 0.0 || (!low && direction.dot(receiver.geometric) <= 0.0) {
            return;
        }
        let limit = (distance * self.tracer.scale()).min(f32::MAX);
        let rays = if low { &mut shadows.lifted } else { &mut shadows.plain };
        rays.push((direction, limit), illuminance * scale, [cosine, 1.0]);
    }

    fn push_sky(&self, shadows: &mut Shadows, receiver: &Receiver, looks: Looks, first: bool, at: [f32; 2]) {
        let Some((direction, radiance, density)) = self.environment.and_then(|e| e.sample(at)) else {
            return;
        };
        let cosine = receiver.cosine(direction);
        if cosine > 0.0 {
            let own = self.density(receiver, direction, first);
            let facing = radiance / (looks.sky * density + looks.hemisphere * own);
            shadows.plain.push((direction, f32::MAX), facing, [cosine, receiver.share]);
        }
    }

    fn push_emitter(
        &self,
        shadows: &mut Shadows,
        receiver: &Receiver,
        looks: Looks,
        first: bool,
        at: [f32; 2],
        key: u64,
    ) {
        let Some((point, density)) = self.emitters.sample(at, key) else { return };
        let surfaces = self.tracer.surfaces();
        let towards = receiver.position - self.mesh.position(point);
        let back = towards.dot(self.mesh.geometric_normal(point.triangle)) < 0.0;
        let flags = surfaces.flags(point.triangle);
        if back != flags.turned && !flags.double_sided {
            return;
        }
        let Some((target, normal)) = Origin::on_side(self.tracer, self.mesh, point, back) else { return };
        let Some((direction, limit)) = between(receiver.origin, target) else { return };
        let (cosine, facing) = (receiver.cosine(direction), -direction.dot(normal));
        if cosine > 0.0 && facing > 0.0 {
            let distance = limit / self.tracer.scale();
            let density = density * distance * distance / facing;
            let own = self.density(receiver, direction, first);
            let radiance = emission(surfaces, point.triangle, point.barycentric);
            let facing = radiance / (looks.emitters * density + looks.hemisphere * own);
            shadows.plain.push((direction, limit), facing, [cosine, receiver.share]);
        }
    }

    fn density(&self, receiver: &Receiver, direction: Vec3, first: bool) -> f32 {
        if first { self.first_density(receiver, direction) } else { receiver.cosine(direction) / PI }
    }

    /// Shadow rays of the baked point, and how many of them look for what the hemisphere rays find too.
    fn light_point(&self, receiver: &Receiver, key: u64, shadows: &mut Shadows) -> Looks {
        let importance = |light: &Light| light.importance(receiver.position, receiver.axis);
        let (mut hard, mut soft, mut sum) = (0, 0, 0.0);
        for light in &self.lights {
            let value = importance(light);
            sum += value;
            *(if light.is_hard() { &mut hard } else { &mut soft }) += usize::from(value > 0.0);
        }
        let (sky, emitters) = (self.samples_sky().is_some(), self.samples_emitters());
        let large = usize::from(sky) + usize::from(emitters);
        let few = hard + soft + large <= LIGHT_RAYS;
        // Few lights: one ray for each hard one, what is left shared out evenly.
        let each = if few { (LIGHT_RAYS - hard) / (soft + large).max(1) } else { 2 };
        let looks = Looks {
            hemisphere: if self.strategy == Strategy::Lights { 0.0 } else { BATCH as f32 },
            sky: if sky { each as f32 } else { 0.0 },
            emitters: if emitters { each as f32 } else { 0.0 },
        };
        if sky {
            for &at in &net(stream(key, 2))[..each] {
                self.push_sky(shadows, receiver, looks, true, at);
            }
        }
        if emitters {
            for (i, &at) in net(stream(key, 3))[..each].iter().enumerate() {
                self.push_emitter(shadows, receiver, looks, true, at, stream(key, 0x300 + i as u64));
            }
        }
        if few {
            for (i, light) in self.lights.iter().enumerate().filter(|(_, light)| importance(light) > 0.0) {
                self.push_samples(shadows, receiver, light, if light.is_hard() { 1 } else { each }, key, i);
            }
        } else {
            self.push_some(shadows, receiver, sum, LIGHT_RAYS - 2 * large, key);
        }
        looks
    }

    fn push_samples(
        &self,
        shadows: &mut Shadows,
        receiver: &Receiver,
        light: &Light,
        count: usize,
        key: u64,
        number: usize,
    ) {
        let squares =
            if light.is_hard() { [[0.0; 2]; BATCH] } else { net(stream(key, 0x1_0000 + number as u64)) };
        for &square in &squares[..count.min(BATCH)] {
            if let Some(sample) = light.sample(receiver.position, square) {
                self.push_light(shadows, receiver, sample, 1.0 / count as f32);
            }
        }
    }

    /// Rays to some of many lights: one at least to those that give more than a ray's share, and the others in turn.
    ///
    /// - `sum`: of what all lights give about
    fn push_some(&self, shadows: &mut Shadows, receiver: &Receiver, sum: f32, rays: usize, key: u64) {
        let importance = |light: &Light| light.importance(receiver.position, receiver.axis);
        let large = |light: &Light| importance(light) * rays as f32 >= sum;
        let (mut left, mut rest) = (rays, 0.0);
        for (i, light) in self.lights.iter().enumerate() {
            let value = importance(light);
            if !large(light) {
                rest += value;
            } else if left > 1 {
                let share = (value / sum * rays as f32) as usize;
                let count = if light.is_hard() { 1 } else { share.clamp(1, left - 1) };
                left -= count;
                self.push_samples(shadows, receiver, light, count, key, i);
            }
        }
        if rest <= 0.0 {
            return;
        }
        // Systematic sampling: equal steps through the running sum from a random start.
        let step = rest / left as f32;
        let mut next = random::unit(stream(key, 4)) * step;
        let (mut before, mut ray) = (0.0, 0x2000);
        for light in self.lights.iter().filter(|light| !large(light)) {
            let value = importance(light);
            before += value;
            while next < before {
                next += step;
                ray += 1;
                let square = random::unit2(stream(key, ray));
                if let Some(sample) = light.sample(receiver.position, square) {
                    self.push_light(shadows, receiver, sample, step / value);
                }
            }
        }
    }

    /// A shadow ray of a secondary point to one light, and how likely it was to look for what other rays find too.
    fn light_secondary(
        &self,
        receiver: &Receiver,
        choice: f32,
        at: [f32; 2],
        key: u64,
        shadows: &mut Shadows,
    ) -> Looks {
        let importance = |light: &Light| light.importance(receiver.position, receiver.axis);
        let lights: f32 = self.lights.iter().map(importance).sum();
        let sky = self.samples_sky().map_or(0.0, |e| PI * e.sampled_luminance());
        let emitters = if self.samples_emitters() {
            let e = &self.emitters;
            e.power / receiver.position.distance_squared(e.centre).max(e.radius * e.radius)
        } else {
            0.0
        };
        let sum = lights + sky + emitters;
        let hemisphere = if self.strategy == Strategy::Lights { 0.0 } else { 1.0 };
        if !(sum > 0.0 && sum.is_finite()) {
            return Looks { hemisphere, sky: 0.0, emitters: 0.0 };
        }
        let looks = Looks { hemisphere, sky: sky / sum, emitters: emitters / sum };
        let mut left = choice * sum;
        if left < sky {
            self.push_sky(shadows, receiver, looks, false, at);
            return looks;
        }
        left -= sky;
        if left < emitters {
            self.push_emitter(shadows, receiver, looks, false, at, key);
            return looks;
        }
        left -= emitters;
        let mut chosen = None;
        for light in &self.lights {
            let value = importance(light);
            if value > 0.0 {
                chosen = Some((light, value));
                if left < value {
                    break;
                }
                left -= value;
            }
        }
        if let Some((light, value)) = chosen
            && let Some(sample) = light.sample(receiver.position, at)
        {
            self.push_light(shadows, receiver, sample, sum / value);
        }
        looks
    }

    /// Follows the sixteen paths of a batch.
    fn hemisphere(&self, receiver: &Receiver, looks: Looks, key: u64, sums: &mut Sums) -> Backs {
        let directions = net(stream(key, 1)).map(|square| self.first_direction(receiver, square));
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
            let density = self.first_density(receiver, direction);
            // Cosines leave nothing at the horizon, harmonics do.
            if direction.dot(receiver.geometric) <= 0.0 || density <= 0.0 {
                continue;
            }
            let numbers = Numbers { nets: &nets, path: i, key: stream(key, 0x100 + i as u64) };
            let [direct, mut indirect] =
                self.follow(receiver, direction, hit, Looks { ..looks }, density, bounces, &numbers);
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
    /// - `looks`, `density`: of the rays of the point where the path starts
    #[expect(clippy::too_many_arguments, reason = "the state of a path")]
    fn follow(
        &self,
        start: &Receiver,
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
        let _ = start;
        loop {
            let found = &mut radiance[usize::from(depth > 0)];
            let own = looks.hemisphere * density;
            let Some(met) = hit else {
                if let Some(environment) = self.environment
                    && own > 0.0
                {
                    let others =
                        if looks.sky > 0.0 { looks.sky * environment.density(direction) } else { 0.0 };
                    *found += weight * environment.radiance(direction) * (own / (own + others));
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
                        let area = self.emitters.density(met.triangle);
                        others = looks.emitters * area * travelled * travelled / facing;
                    }
                    *found += weight * shines * (own / (own + others));
                }
            }
            let mut keeps = Vec3::ONE;
            if flags.translucent {
                let clear = surfaces.transmission(met.triangle, met.barycentric).clamp(Vec3::ZERO, Vec3::ONE);
                let opacity = surfaces.opacity(met.triangle, met.barycentric).clamp(0.0, 1.0);
                keeps = Vec3::splat(opacity).min(Vec3::ONE - clear);
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
            weight *= keeps * albedo.clamp(Vec3::ZERO, Vec3::splat(MOST_ALBEDO));
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
            let mut shadows = Shadows::new();
            let key = stream(numbers.key, 0x6000 + u64::from(depth));
            looks = self.light_secondary(&receiver, choice[0], place, key, &mut shadows);
            shadows.trace(tracer, &receiver, |_, facing, [cosine, _]| {
                radiance[1] += weight * facing * (cosine / PI);
            });
            direction = receiver.direction(next);
            density = receiver.cosine(direction) / PI;
            if density <= 0.0 {
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
        let stream_key = random::hash(self.options.seed, key, u64::from(batch), 0x9a);
        let mut sums = Sums {
            direct: Vec3::ZERO,
            indirect: Vec3::ZERO,
            harmonics: [Vec3::ZERO; COEFFICIENTS],
            wanted: self.harmonics,
        };
        let mut shadows = Shadows::new();
        let looks = self.light_point(&receiver, stream_key, &mut shadows);
        shadows.trace(self.tracer, &receiver, |direction, facing, [cosine, share]| {
            sums.arrive(direction, facing, cosine, share, false);
        });
        let looks_around = self.indirect || self.environment.is_some() || !self.emitters.is_empty();
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
