//! Everything that shines, and which of it a shadow ray goes to.
//!
//! The sky and shining surfaces are also found by the rays of a point's hemisphere. Both kinds of rays are weighed by the
//! power heuristic (Veach and Guibas 1995, §3, with the exponent 2): each by the square of the density with which its
//! kind looks in a direction, so neither kind can bring much more than the light has.
//!
//! A baked point has sixteen shadow rays a batch. As long as there are no more lights, each that can reach the point has
//! one at least; hard ones, which need no more, leave the rest to the others. Beyond, lights are chosen by about
//! what they give: one in turn for each step of the running sum, and always those that make a step alone. All lights
//! are asked what they give at every point, which is cheap beside a ray for some tens of them.

use std::f32::consts::PI;

use glam::Vec3;
use lightkiln_mesh::{Mesh, random};

use crate::directions::{BATCH, net};
use crate::emitters::{Emitters, emission};
use crate::lights::{Light, LightSample};
use crate::receiver::Receiver;
use crate::traverse::BUNDLE;
use crate::{Environment, LightError, Lighting, Origin, Tracer};

/// Which rays may find the sky and shining surfaces; all but the first are for tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Strategy {
    Both,
    Lights,
    Hemisphere,
}

/// Shadow rays of a baked point, unless there are fewer lights.
const RAYS: usize = BATCH;
/// Rays to the sky and to shining surfaces, each, where there are more lights than rays.
const RAYS_AMONG_MANY: usize = 2;

/// The part of the way to a light that is to be clear: a lamp may lie in the plane of the ceiling that it hangs from.
const CLEARANCE: f32 = 0.9999;

/// How many rays of a point look for the sky and for shining surfaces: what [`weight`] needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Looks {
    pub hemisphere: f32,
    pub sky: f32,
    pub emitters: f32,
}

/// What a ray counts for that looks in a direction with density `own`, where others do so with density `other`: times
/// the numbers of rays of each kind. `own` is above 0.
pub(crate) fn weight(own: f32, other: f32) -> f32 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

/// A ray to a light.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ShadowRay {
    pub direction: Vec3,
    /// How far it looks, in the tracer's coordinates.
    limit: f32,
    /// What it brings if nothing is in the way: lux on a surface that faces it.
    pub facing: Vec3,
    /// What that counts for at the point.
    pub cosine: f32,
    /// The part of the hemisphere that the whole is taken for: [`Receiver::share`] for what surrounds the point, 1
    /// for lights.
    pub share: f32,
    /// It starts from the lifted point.
    low: bool,
}

/// What is in the way of shadow rays of one point; `arrive` gets each that arrives, with its light tinted.
pub(crate) fn trace(
    tracer: &Tracer<'_>,
    receiver: &Receiver,
    rays: &mut [ShadowRay],
    mut arrive: impl FnMut(&ShadowRay),
) {
    // Stable, so that the order of sums does not change.
    rays.sort_by_key(|ray| ray.low);
    let (plain, low) = rays.split_at_mut(rays.partition_point(|ray| !ray.low));
    for (rays, lifted) in [(plain, false), (low, true)] {
        if rays.is_empty() {
            continue;
        }
        let origin = if lifted { receiver.lifted(tracer) } else { receiver.origin };
        for rays in rays.chunks_mut(BUNDLE) {
            let (mut directions, mut limits) = ([Vec3::ZERO; BUNDLE], [0.0; BUNDLE]);
            let mut tints = [Vec3::ZERO; BUNDLE];
            let count = rays.len();
            for (i, ray) in rays.iter().enumerate() {
                (directions[i], limits[i]) = (ray.direction, ray.limit);
            }
            tracer.tints(origin, &directions[..count], &limits[..count], &mut tints[..count]);
            for (ray, tint) in rays.iter_mut().zip(tints).filter(|(_, tint)| *tint != Vec3::ZERO) {
                ray.facing *= tint;
                arrive(ray);
            }
        }
    }
}

/// Lights, sky and emitting triangles of a scene.
pub(crate) struct Sources<'a> {
    tracer: &'a Tracer<'a>,
    mesh: &'a Mesh,
    lights: Vec<Light>,
    pub environment: Option<&'a Environment>,
    pub emitters: Emitters,
    pub strategy: Strategy,
}

impl<'a> Sources<'a> {
    /// # Errors
    /// [`LightError::Light`] for a light with a number that makes no sense.
    pub fn new(tracer: &'a Tracer<'a>, mesh: &'a Mesh, lighting: &'a Lighting) -> Result<Self, LightError> {
        Ok(Self {
            tracer,
            mesh,
            lights: lighting.checked()?,
            environment: lighting.environment.as_ref(),
            emitters: Emitters::new(mesh, tracer.surfaces()),
            strategy: Strategy::Both,
        })
    }

    pub fn is_empty(&self) -> bool {
        self.lights.is_empty() && !self.surround()
    }

    /// Rays of the hemisphere may meet something that shines.
    pub fn surround(&self) -> bool {
        self.environment.is_some() || !self.emitters.is_empty()
    }

    /// Mean luminance of the sky that shadow rays look for.
    fn sky(&self) -> f32 {
        let sampled = self.strategy != Strategy::Hemisphere;
        self.environment.filter(|_| sampled).map_or(0.0, Environment::sampled_luminance)
    }

    fn samples_emitters(&self) -> bool {
        self.strategy != Strategy::Hemisphere && !self.emitters.is_empty()
    }

    /// - `rays`: of the hemisphere
    fn hemisphere(&self, rays: f32) -> f32 {
        if self.strategy == Strategy::Lights { 0.0 } else { rays }
    }

    /// - `scale`: one over the number of such samples that are expected
    fn light_ray(&self, receiver: &Receiver, sample: LightSample, scale: f32) -> Option<ShadowRay> {
        let LightSample { direction, distance, illuminance } = sample;
        let cosine = receiver.axis.dot(direction);
        let low = receiver.is_low(direction);
        if cosine <= 0.0 || (!low && direction.dot(receiver.geometric) <= 0.0) {
            return None;
        }
        let limit = (distance * self.tracer.scale() * CLEARANCE).min(f32::MAX);
        Some(ShadowRay { direction, limit, facing: illuminance * scale, cosine, share: 1.0, low })
    }

    fn sky_ray(&self, receiver: &Receiver, looks: Looks, at: [f32; 2]) -> Option<ShadowRay> {
        let (direction, radiance, density) = self.environment?.sample(at)?;
        let cosine = receiver.cosine(direction);
        if cosine <= 0.0 {
            return None;
        }
        let own = looks.sky * density;
        let facing = radiance * (weight(own, looks.hemisphere * receiver.density(direction)) / own);
        Some(ShadowRay { direction, limit: f32::MAX, facing, cosine, share: receiver.share, low: false })
    }

    fn emitter_ray(&self, receiver: &Receiver, looks: Looks, at: [f32; 2], key: u64) -> Option<ShadowRay> {
        let (point, area_density) = self.emitters.sample(at, key)?;
        let surfaces = self.tracer.surfaces();
        let towards = receiver.position - self.mesh.position(point);
        let back = towards.dot(self.mesh.geometric_normal(point.triangle)) < 0.0;
        let flags = surfaces.flags(point.triangle);
        if back != flags.turned && !flags.double_sided {
            return None;
        }
        let (target, normal) = Origin::on_side(self.tracer, self.mesh, point, back)?;
        let way = target.position - receiver.origin.position;
        let limit = way.length();
        let direction = way / limit;
        let (cosine, facing) = (receiver.cosine(direction), -direction.dot(normal));
        if cosine.is_nan() || cosine <= 0.0 || facing <= 0.0 {
            return None;
        }
        let distance = limit / self.tracer.scale();
        let density = area_density * distance * distance / facing;
        let radiance = emission(surfaces, point.triangle, point.barycentric);
        let own = looks.emitters * density;
        let facing = radiance * (weight(own, looks.hemisphere * receiver.density(direction)) / own);
        Some(ShadowRay { direction, limit, facing, cosine, share: receiver.share, low: false })
    }

    /// Shadow rays of a baked point, and how many of them look for what `hemisphere` other rays find too.
    ///
    /// - `push`: gets each ray
    pub fn of_point(
        &self,
        receiver: &Receiver,
        hemisphere: f32,
        key: u64,
        push: &mut impl FnMut(ShadowRay),
    ) -> Looks {
        let (mut hard, mut soft, mut sum) = (0, 0, 0.0);
        for light in &self.lights {
            let value = light.importance(receiver.position, receiver.axis);
            sum += value;
            *(if light.is_hard() { &mut hard } else { &mut soft }) += usize::from(value > 0.0);
        }
        let (sky, emitters) = (self.sky() > 0.0, self.samples_emitters());
        let large = usize::from(sky) + usize::from(emitters);
        let few = hard + soft + large <= RAYS;
        let each = if few { (RAYS - hard) / (soft + large).max(1) } else { RAYS_AMONG_MANY };
        let count = |wanted: bool| if wanted { each as f32 } else { 0.0 };
        let looks =
            Looks { hemisphere: self.hemisphere(hemisphere), sky: count(sky), emitters: count(emitters) };
        if sky {
            let squares = net(random::finalize(key ^ 1));
            squares[..each].iter().filter_map(|&at| self.sky_ray(receiver, looks, at)).for_each(&mut *push);
        }
        if emitters {
            for (i, &at) in net(random::finalize(key ^ 2))[..each].iter().enumerate() {
                let key = random::hash(key, 2, i as u64, 0);
                self.emitter_ray(receiver, looks, at, key).into_iter().for_each(&mut *push);
            }
        }
        if few {
            for (i, light) in self.lights.iter().enumerate() {
                if light.importance(receiver.position, receiver.axis) > 0.0 {
                    self.rays_to(light, receiver, each, random::hash(key, 3, i as u64, 0), push);
                }
            }
        } else {
            self.rays_to_some(receiver, sum, RAYS - RAYS_AMONG_MANY * large, key, push);
        }
        looks
    }

    /// Rays to one light, spread over it; returns how many.
    fn rays_to(
        &self,
        light: &Light,
        receiver: &Receiver,
        count: usize,
        key: u64,
        push: &mut impl FnMut(ShadowRay),
    ) -> usize {
        let count = if light.is_hard() { 1 } else { count.min(BATCH) };
        let squares = if light.is_hard() { [[0.0; 2]; BATCH] } else { net(key) };
        squares[..count]
            .iter()
            .filter_map(|&square| light.sample(receiver.position, square))
            .filter_map(|sample| self.light_ray(receiver, sample, 1.0 / count as f32))
            .for_each(push);
        count
    }

    /// Rays to some of many lights.
    ///
    /// - `sum`: of what all lights give about
    fn rays_to_some(
        &self,
        receiver: &Receiver,
        sum: f32,
        rays: usize,
        key: u64,
        push: &mut impl FnMut(ShadowRay),
    ) {
        let importance = |light: &Light| light.importance(receiver.position, receiver.axis);
        let makes_a_step = |value: f32| value * rays as f32 >= sum;
        let (mut left, mut rest) = (rays, 0.0);
        let mut alone_before = self.lights.len();
        for (i, light) in self.lights.iter().enumerate() {
            let value = importance(light);
            if makes_a_step(value) && left > 1 {
                let share = ((value / sum * rays as f32) as usize).min(left - 1);
                left -= self.rays_to(light, receiver, share, random::hash(key, 3, i as u64, 0), push);
                continue;
            }
            if makes_a_step(value) {
                alone_before = alone_before.min(i);
            }
            rest += value;
        }
        if rest <= 0.0 {
            return;
        }
        // Systematic sampling: equal steps through the running sum from a random start.
        let step = rest / left as f32;
        let mut next = random::unit(random::finalize(key ^ 4)) * step;
        let (mut before, mut ray) = (0.0, 0);
        for (i, light) in self.lights.iter().enumerate() {
            let value = importance(light);
            if makes_a_step(value) && i < alone_before {
                continue;
            }
            before += value;
            while next < before {
                next += step;
                ray += 1;
                let square = random::unit2(random::hash(key, 4, ray, 0));
                let sample = light.sample(receiver.position, square);
                let ray = sample.and_then(|sample| self.light_ray(receiver, sample, step / value));
                ray.into_iter().for_each(&mut *push);
            }
        }
    }

    /// A shadow ray of a point that a path has come to, to one light; and how likely it was to look for what one
    /// other ray finds too.
    ///
    /// - `choice`: which light, `0.0..1.0`; `at`: where on it
    pub fn of_bounce(
        &self,
        receiver: &Receiver,
        choice: f32,
        at: [f32; 2],
        key: u64,
    ) -> (Option<ShadowRay>, Looks) {
        let importance = |light: &Light| light.importance(receiver.position, receiver.axis);
        let lights: f32 = self.lights.iter().map(importance).sum();
        let sky = PI * self.sky();
        let emitters =
            if self.samples_emitters() { self.emitters.importance(receiver.position) } else { 0.0 };
        let sum = lights + sky + emitters;
        let mut looks = Looks { hemisphere: self.hemisphere(1.0), sky: 0.0, emitters: 0.0 };
        if !sum.is_finite() || sum <= 0.0 {
            return (None, looks);
        }
        (looks.sky, looks.emitters) = (sky / sum, emitters / sum);
        let mut left = choice * sum;
        if left < sky {
            return (self.sky_ray(receiver, looks, at), looks);
        }
        left -= sky;
        if left < emitters {
            return (self.emitter_ray(receiver, looks, at, key), looks);
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
        let ray = chosen.and_then(|(light, value)| {
            let sample = light.sample(receiver.position, at)?;
            self.light_ray(receiver, sample, sum / value)
        });
        (ray, looks)
    }
}
