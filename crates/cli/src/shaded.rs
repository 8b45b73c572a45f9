//! The mode `shaded`: what a viewer with the extension shows, of the layers that there are.
//!
//! docs/RENDER.md says what is computed; `lightkiln_render::shade` is the model of the materials.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};
use lightkiln_bake::Surface;
use lightkiln_bake::layers::Layers;
use lightkiln_bake::signals::{SignalChoice, Signals};
use lightkiln_light::harmonics::{COEFFICIENTS, basis};
use lightkiln_light::{Curve, Hit, Light, Surfaces};
use lightkiln_mesh::{SurfacePoint, VertexId};
use lightkiln_render::{Sight, Tone, shade};

use crate::studio::Values;

/// How light becomes what a screen shows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exposure {
    /// Doublings of brightness.
    pub stops: f32,
    /// Irradiance that makes a white surface white, in the unit of the light; that of the file if none.
    pub white: Option<f32>,
    /// The tone curve.
    pub tone: Tone,
}

/// Light that a viewer adds itself stands to that of all lamps as one to this.
const LAMPS_TO_AMBIENT: f32 = 4.0;

/// What the ambient light gives a level surface where there is nothing to compare it with: its radiance is 1 if white.
const AMBIENT: f32 = PI;

/// Surfaces without baked light beside some that have it are lit by this share of white.
const DIM: f32 = 0.25;

/// Of the light of files that are not baked: from all around, and from the eye.
const UNBAKED: [f32; 2] = [0.4, 0.6];

/// Vertices at which the light of lamps is looked at to find its brightness, at most.
const BRIGHTNESS_POINTS: usize = 4096;

/// What is left of a line of sight before it ends.
const THIN: f32 = 0.01;

/// What a channel of the file means for what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    /// Irradiance or a part of it, from here on red, green and blue.
    Irradiance,
    /// The harmonic of that number of the irradiance.
    Harmonic(usize),
    /// The share of ambient light that arrives.
    Ambient,
    /// The share of the light of a lamp that arrives.
    Shadow(usize),
    /// What an occlusion texture shows.
    Occlusion,
    /// What a lightmap of the asset shows: shares of white.
    Lightmap,
}

/// How surfaces and their light look.
pub struct Shaded<'a> {
    surface: &'a Surface<'a>,
    layers: &'a Layers,
    /// First channel and meaning.
    roles: Vec<(usize, Role)>,
    /// Lamps that the viewer adds, with shadows if the file has them.
    lamps: Vec<Light>,
    /// What the ambient light gives a level surface; 0 where all light is baked.
    ambient: f32,
    is_baked: bool,
    white: f32,
    exposure: Exposure,
    values: Values,
}

/// Light that arrives at a point, lux.
struct Arriving {
    /// That of lamps, which no occlusion texture dims.
    lamps: Vec3,
    /// All other, before an occlusion texture.
    other: Vec3,
    /// What the file has stored of the occlusion texture.
    occlusion: Option<f32>,
}

impl<'a> Shaded<'a> {
    /// - `is_baked`: whether the layers are those of a file
    /// - `lamps`: the lights of the bake
    pub fn new(
        surface: &'a Surface<'a>,
        layers: &'a Layers,
        is_baked: bool,
        signals: &Signals,
        lamps: &[Light],
        exposure: Exposure,
        values: Values,
    ) -> Self {
        let roles = if is_baked { roles(layers) } else { Vec::new() };
        let has = |wanted: &[Role]| roles.iter().any(|(_, role)| wanted.contains(role));
        let is_lit = has(&[Role::Irradiance, Role::Harmonic(0)]);
        let has_lightmap = has(&[Role::Lightmap]);
        let named = |start: &str| layers.layers.iter().any(|l| l.layer.name.starts_with(start));
        let only_indirect = named("indirect") && !named("direct") && !named("irradiance");
        let needs_lamps = is_baked && (only_indirect || !(is_lit || has_lightmap));
        let lamps = if needs_lamps { shadowed(signals, lamps, surface) } else { Vec::new() };
        let bright = brightness(surface, &lamps);
        let ambient = if is_lit || has_lightmap {
            0.0
        } else if bright > 0.0 {
            bright / LAMPS_TO_AMBIENT
        } else {
            AMBIENT
        };
        let of_light = layers.layers.iter().filter_map(|layer| match layer.scale.curve {
            Curve::Log { white } => Some(white),
            Curve::Linear => None,
        });
        let known = if is_lit {
            of_light.fold(0.0, f32::max).max(bright)
        } else if has_lightmap {
            AMBIENT
        } else {
            ambient + bright
        };
        let white = exposure.white.unwrap_or(known);
        Self { surface, layers, roles, lamps, ambient, is_baked, white, exposure, values }
    }

    /// What lies along a line of sight.
    ///
    /// - `units`: the light of a point of the light mesh, in unit values of all layers
    pub fn color(&self, sight: Sight<'_>, units: &dyn Fn(&Hit) -> Vec<f32>) -> Vec4 {
        let to_eye = -sight.ray.direction;
        let mut through = Vec3::ONE;
        let mut radiance = Vec3::ZERO;
        for hit in sight {
            let Hit { triangle, barycentric, back, .. } = hit;
            let finish = self.surface.finish(triangle, barycentric);
            if finish.covered <= 0.0 {
                continue;
            }
            let point = SurfacePoint { triangle, barycentric };
            let normal = self.surface.world().shading_normal(point);
            let normal = if back { -normal } else { normal };
            let emission = self.surface.emission(triangle, barycentric);
            radiance += through
                * if finish.unlit {
                    Vec3::from_array(finish.base_color) * (finish.covered * self.white / PI)
                } else {
                    let light = self.arriving(&hit, normal, to_eye, units);
                    let occlusion = light.occlusion.unwrap_or(finish.occlusion);
                    let light = light.lamps + light.other * occlusion;
                    let [scattered, reflected] = shade::radiance(&finish, normal, to_eye, light);
                    // Emission has its coverage in it.
                    finish.covered * (scattered * (1.0 - finish.passes) + reflected) + emission
                };
            through = if self.surface.flags(triangle).translucent {
                through * self.surface.transmission(triangle, barycentric)
            } else {
                Vec3::ZERO
            };
            if through.max_element() < THIN {
                through = Vec3::ZERO;
                break;
            }
        }
        let cover = 1.0 - through.element_sum() / 3.0;
        let color = match self.values {
            Values::Screen => self.shown(radiance),
            Values::Signal => radiance,
        };
        color.extend(cover)
    }

    /// What a screen shows of a radiance.
    fn shown(&self, radiance: Vec3) -> Vec3 {
        self.exposure.tone.map(radiance * (PI / self.white * self.exposure.stops.exp2()))
    }

    fn arriving(&self, hit: &Hit, normal: Vec3, to_eye: Vec3, units: &dyn Fn(&Hit) -> Vec<f32>) -> Arriving {
        let dome = Vec3::splat(shade::dome_irradiance(normal) / shade::dome_irradiance(Vec3::Y));
        if !self.is_baked {
            let [around, eye] = UNBAKED;
            let light = around * dome + eye * normal.dot(to_eye).abs();
            return Arriving { lamps: Vec3::ZERO, other: light * self.ambient, occlusion: None };
        }
        if hit.triangle.index() >= self.surface.mesh.triangle_count() {
            return Arriving { lamps: Vec3::ZERO, other: DIM * self.white * dome, occlusion: None };
        }
        let units = units(hit);
        let value = |channel: usize| self.layers.from_unit(channel, units[channel]);
        let rgb = |first: usize| Vec3::new(value(first), value(first + 1), value(first + 2));
        let share = |channel: usize| value(channel).clamp(0.0, 1.0);
        let harmonics = basis(normal);
        let (mut baked, mut ambient, mut occlusion) = (Vec3::ZERO, self.ambient * dome, None);
        let mut seen = vec![1.0; self.lamps.len()];
        for &(channel, role) in &self.roles {
            match role {
                Role::Irradiance => baked += rgb(channel),
                Role::Harmonic(number) => baked += rgb(channel) * harmonics[number],
                Role::Lightmap => baked += AMBIENT * rgb(channel),
                Role::Ambient => ambient *= share(channel),
                Role::Occlusion => occlusion = Some(share(channel)),
                Role::Shadow(lamp) => {
                    if let Some(seen) = seen.get_mut(lamp) {
                        *seen = share(channel);
                    }
                }
            }
        }
        let position =
            self.surface.mesh.position(SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric });
        let lamps = self.lamps.iter().zip(seen).filter(|(_, seen)| *seen > 0.0);
        let lamps = lamps.map(|(lamp, seen)| lamp.unshadowed(position, normal) * seen).sum();
        Arriving { lamps, other: baked.max(Vec3::ZERO) + ambient, occlusion }
    }
}

/// What the channels of layers mean. Light that several of them tell of is taken from the first of harmonics,
/// irradiance, direct and indirect light, and the asset's lightmap.
fn roles(layers: &Layers) -> Vec<(usize, Role)> {
    // First channels and how many, of the layers whose name begins so.
    let starting = |start: &str, least: usize| {
        let found = layers.layers.iter().filter(|layer| layer.layer.name.starts_with(start));
        let found = found.map(|layer| (layer.first, layer.layer.channels));
        found.filter(|(_, count)| *count >= least).collect::<Vec<_>>()
    };
    let first = |list: Vec<(usize, usize)>, role| list.into_iter().take(1).map(move |(at, _)| (at, role));
    let [harmonics, irradiance, direct, indirect, lightmap] =
        ["irradianceSh", "irradiance", "direct", "indirect", "lightmap"].map(|name| starting(name, 3));
    let mut out = Vec::new();
    if !harmonics.is_empty() {
        let harmonics = harmonics.into_iter().enumerate().take(COEFFICIENTS);
        out.extend(harmonics.map(|(number, (first, _))| (first, Role::Harmonic(number))));
    } else if !irradiance.is_empty() {
        out.extend(first(irradiance, Role::Irradiance));
    } else if !(direct.is_empty() && indirect.is_empty()) {
        out.extend(first(direct, Role::Irradiance).chain(first(indirect, Role::Irradiance)));
    } else {
        out.extend(first(lightmap, Role::Lightmap));
    }
    out.extend(first(starting("ambientOcclusion", 1), Role::Ambient));
    out.extend(first(starting("occlusion", 1), Role::Occlusion));
    let shadows = starting("shadow", 1).into_iter().flat_map(|(first, count)| first..first + count);
    out.extend(shadows.enumerate().map(|(lamp, channel)| (channel, Role::Shadow(lamp))));
    out
}

/// The lamps whose shadows the signals have, or all.
fn shadowed(signals: &Signals, lamps: &[Light], surface: &Surface<'_>) -> Vec<Light> {
    let (low, high) = surface.mesh.bounds();
    let middle = (low + high) / 2.0;
    let mut out = Vec::new();
    for choice in &signals.0 {
        match *choice {
            SignalChoice::Shadows => out.extend_from_slice(lamps),
            // Such a light has no brightness: as much as gives 1 lux in the middle.
            SignalChoice::Shadow { centre, radius } => {
                let intensity = Vec3::splat(centre.distance_squared(middle).max(radius * radius));
                out.push(Light::Sphere { position: centre, intensity, radius, range: f32::INFINITY });
            }
            _ => {}
        }
    }
    if out.is_empty() { lamps.to_vec() } else { out }
}

/// What lamps give 95 % of the vertices at most, lux, if nothing is in the way.
fn brightness(surface: &Surface<'_>, lamps: &[Light]) -> f32 {
    let mesh = &surface.mesh;
    let step = mesh.vertex_count().div_ceil(BRIGHTNESS_POINTS).max(1);
    let light = |vertex: usize| {
        let point = surface.point_at(VertexId(vertex as u32));
        let normal = mesh.shading_normal(point);
        let all: Vec3 = lamps.iter().map(|lamp| lamp.unshadowed(mesh.position(point), normal)).sum();
        all.max_element()
    };
    let mut found: Vec<f32> = (0..mesh.vertex_count()).step_by(step).map(light).collect();
    found.sort_unstable_by(f32::total_cmp);
    found.get(found.len() * 95 / 100).copied().unwrap_or(0.0)
}
