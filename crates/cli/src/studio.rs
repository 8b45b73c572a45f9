//! One scene ready for its pictures: which mode shows what.

use std::path::Path;

use clap::ValueEnum;
use glam::{Vec3, Vec4};

use lightkiln_bake::file_light::Recipe;
use lightkiln_bake::layers::Layers;
use lightkiln_bake::options::BakeBounds;
use lightkiln_bake::rounds::{Shown, full_texture};
use lightkiln_bake::{
    BakeError, BakeOptions, Clock, FileLight, Opened, Opening, Plan, Quality, Surface, options, shade,
};
use lightkiln_encode::AtlasView;
use lightkiln_light::{Estimates, Hit, Signal, Surfaces, Tracer};
use lightkiln_mesh::{SurfacePoint, random};
use lightkiln_page::ErrorPoint;
use lightkiln_render::picture::{PLACES, covering};
use lightkiln_render::{Legend, Picture, Ray, Sight, Smoothing, Subject, render};
use lightkiln_sample::{SampleOptions, poisson_disk};

use crate::messages::{Exit, Failure};
use crate::shaded::{Exposure, Shaded};
use crate::stations::Shot;

/// The color of a point on a ray.
type Coloring<'a> = dyn Fn(&Hit, &Ray) -> Vec3 + Sync + 'a;

/// Modes of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModeName {
    /// The baked light as the shader shows it
    Light,
    /// The light traced at every pixel
    Reference,
    /// Vertices only, sampled at the vertices
    Point,
    /// Vertices only, least squares
    LeastSquares,
    /// Texture triangles red, mixed ones yellow, color triangles gray
    Classes,
    /// Ten times the difference between baked and traced light
    Error,
    /// Charts in different colors
    Charts,
    /// Materials in the baked light
    Shaded,
    /// Materials in light traced at every pixel
    ShadedReference,
    /// Plain shape
    Clay,
}

impl ModeName {
    /// Its name on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Whether it traces light.
    pub fn is_traced(self) -> bool {
        matches!(
            self,
            Self::Reference | Self::Error | Self::ShadedReference | Self::Point | Self::LeastSquares
        )
    }

    /// Whether it shows what surfaces look like.
    pub fn is_shaded(self) -> bool {
        matches!(self, Self::Shaded | Self::ShadedReference)
    }

    /// Whether it shows nothing of a file that is not baked.
    pub fn needs_bake(self) -> bool {
        matches!(self, Self::Light | Self::Classes | Self::Error | Self::Charts)
    }
}

/// What pixels hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// What a screen shows, linear, `0..=1`.
    Screen,
    /// Light, and errors of it, in the unit of the layer and whatever its size; radiance of what is shaded; of other
    /// modes what a screen shows.
    Signal,
}

/// What is looked at.
pub struct Look<'a> {
    /// The file.
    pub file: &'a Path,
    /// Which of its scenes.
    pub scene: Option<usize>,
    /// The layer that is shown.
    pub layer: usize,
    /// Rays per pixel for modes that trace light.
    pub rays: u32,
    /// What pixels hold.
    pub values: Values,
    /// How what is shaded becomes what a screen shows.
    pub exposure: Exposure,
    /// What is to be shown: it says what has to be read.
    pub modes: &'a [ModeName],
}

/// Reads a file with its light and all that is needed to trace it again, and works with that.
///
/// # Errors
/// A file that cannot be read, that is not baked but must be, a layer that it does not have; those of the work.
pub fn in_studio<T>(
    look: &Look<'_>,
    clock: &mut Clock<'_>,
    work: impl FnOnce(&mut Studio<'_>, &mut Clock<'_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let file = lightkiln_bake::file_name(look.file);
    clock.stage("read")?;
    let any = |of: &dyn Fn(ModeName) -> bool| look.modes.iter().any(|&mode| of(mode));
    let (needs_light, finish) = (any(&ModeName::needs_bake), any(&ModeName::is_shaded));
    let opened =
        Opened::read(look.file, Opening { scene: look.scene, environment: None, needs_light, finish })?;
    let surface = opened.scenery.surface(&file, &opened.options)?;
    let light = opened.recipe.as_ref().map(|_| FileLight::read(&surface, &file)).transpose()?;
    let tracer = Tracer::new(surface.casters(), &surface).map_err(BakeError::from)?;
    let (low, high) = surface.mesh.bounds();
    let usual = (high - low).length() * options::DEFAULT_DISTANCE;
    let distance = opened.recipe.as_ref().map_or(usual, Recipe::reach);
    // Which side of a sheet is seen matters to rays that look for light, and takes some of them to find out.
    if any(&ModeName::is_traced) {
        surface.turn_hidden_sheets(&tracer, distance, &opened.scenery.lighting);
    }
    let signal = opened.signals.judged_on(&opened.stage(&surface, &tracer, distance, PICTURE_SEED))?;
    light.as_ref().map(|light| light.expect(signal.as_ref())).transpose()?;
    let layers = match &light {
        Some(light) => light.layers.clone(),
        None => {
            Layers::new(signal.as_ref(), &Estimates::new(0, signal.channels()), &[], None, BakeBounds::Clamp)
        }
    };
    if look.layer >= layers.layers.len() {
        let what = format!("--layer is {}, but there are {}", look.layer, layers.layers.len());
        return Err(Failure::new(Exit::Usage, what).remedy("layers count from 0; see `lightkiln inspect`"));
    }
    let shaded = finish.then(|| {
        let lamps = &opened.scenery.lighting.lights;
        Shaded::new(&surface, &layers, light.is_some(), &opened.signals, lamps, look.exposure, look.values)
    });
    let mut studio = Studio {
        surface: &surface,
        shaded,
        tracer: &tracer,
        light: light.as_ref(),
        views: light.as_ref().map(FileLight::views).transpose()?,
        signal,
        layers: &layers,
        layer: look.layer,
        rays: look.rays,
        values: look.values,
    };
    work(&mut studio, clock)
}

/// What pictures of one scene share.
pub struct Studio<'a> {
    /// The light mesh.
    pub surface: &'a Surface<'a>,
    tracer: &'a Tracer<'a>,
    /// What the file shows, if it is baked.
    pub light: Option<&'a FileLight>,
    views: Option<Vec<AtlasView<'a>>>,
    signal: Box<dyn Signal + 'a>,
    /// What its values mean.
    pub layers: &'a Layers,
    shaded: Option<Shaded<'a>>,
    /// The layer that is shown.
    pub layer: usize,
    rays: u32,
    values: Values,
}

/// Colors of classes: texture, mixed, color.
const CLASS_COLORS: [Vec3; 3] =
    [Vec3::new(0.85, 0.12, 0.10), Vec3::new(0.95, 0.65, 0.10), Vec3::new(0.75, 0.80, 0.85)];

/// What gets no light.
const UNLIT: Vec3 = Vec3::new(0.05, 0.05, 0.06);

/// By how much an error is magnified to be seen.
const ERROR_GAIN: f32 = 10.0;

/// Too bright is red, too dark is blue, right is white.
fn color_of_error(error: f32) -> Vec3 {
    let error = ERROR_GAIN * error;
    Vec3::ONE - Vec3::new((-error).max(0.0), error.abs(), error.max(0.0)).min(Vec3::ONE)
}

/// A bar from the darkest error to the brightest that differ by their colors, with the bound.
fn error_legend(bound: Option<f32>) -> Legend {
    let largest = 1.0 / ERROR_GAIN;
    let mark = |error: f32| {
        let sign = if error > 0.0 { "+" } else { "" };
        ((error / largest + 1.0) / 2.0, format!("{sign}{} %", (error * 1000.0).round() / 10.0))
    };
    let mut marks = vec![(0.5, "0".to_owned()), mark(-largest), mark(largest)];
    let bound = bound.filter(|&bound| bound > 0.0 && bound < largest);
    marks.extend(bound.into_iter().flat_map(|bound| [mark(-bound), mark(bound)]));
    let colors = (-10..=10).map(|step| color_of_error(step as f32 / 10.0 * largest)).collect();
    Legend::Bar { colors, marks }
}

impl Studio<'_> {
    /// A picture of a mode for each shot.
    ///
    /// # Errors
    /// When vertices cannot be fitted.
    pub fn pictures(
        &self,
        mode: ModeName,
        shots: &[Shot],
        clock: &mut Clock<'_>,
    ) -> Result<Vec<Picture>, Failure> {
        clock.stage("render")?;
        let shaped = |color: Vec3, hit: &Hit, ray: &Ray| color * (0.35 + 0.65 * self.clay(hit, ray));
        Ok(match mode {
            ModeName::Clay => self.render(shots, &|hit, ray| Vec3::splat(self.clay(hit, ray))),
            ModeName::Reference => self.trace(shots, &|hit, _| self.color(&self.traced_units(hit))),
            ModeName::Light => self.render(shots, &|hit, _| self.color(&self.shown_units(hit))),
            ModeName::Error => self.trace(shots, &|hit, _| self.error_color(hit)),
            ModeName::Classes => self.render(shots, &|hit, ray| shaped(self.class_color(hit), hit, ray)),
            ModeName::Charts => self.render(shots, &|hit, ray| shaped(self.chart_color(hit), hit, ray)),
            ModeName::Shaded => self.shade(shots, self.smoothing(), &|hit| self.shown_units(hit)),
            ModeName::ShadedReference => {
                self.shade(shots, Smoothing::Everywhere, &|hit| self.traced_units(hit))
            }
            ModeName::Point => {
                let values = self.point_samples();
                self.render(shots, &|hit, _| self.interpolated(&values, hit))
            }
            ModeName::LeastSquares => {
                let radius = match self.light {
                    Some(light) => light.extension.texel_size,
                    None => lightkiln_sample::radius_for(&self.surface.mesh, 250_000),
                };
                let values = self.least_squares(radius, clock)?;
                clock.stage("render")?;
                self.render(shots, &|hit, _| self.interpolated(&values, hit))
            }
        })
    }

    /// Pictures of materials in a light.
    fn shade(
        &self,
        shots: &[Shot],
        smoothing: Smoothing,
        units: &(dyn Fn(&Hit) -> Vec<f32> + Sync),
    ) -> Vec<Picture> {
        let Some(shaded) = &self.shaded else { return Vec::new() };
        let color = |sight: Sight<'_>| shaded.color(sight, units);
        self.subject(shots, smoothing, &color)
    }

    /// Pictures of colors without noise.
    fn render(&self, shots: &[Shot], color: &Coloring<'_>) -> Vec<Picture> {
        self.smoothed(shots, self.smoothing(), color)
    }

    /// Differences of light in its unit say nothing about what is seen of them.
    fn smoothing(&self) -> Smoothing {
        if self.values == Values::Screen { Smoothing::Edges } else { Smoothing::Everywhere }
    }

    /// Pictures of traced light.
    fn trace(&self, shots: &[Shot], color: &Coloring<'_>) -> Vec<Picture> {
        self.smoothed(shots, Smoothing::Everywhere, color)
    }

    fn smoothed(&self, shots: &[Shot], smoothing: Smoothing, color: &Coloring<'_>) -> Vec<Picture> {
        let lit = self.surface.mesh.triangle_count();
        let unlit = if self.values == Values::Screen { UNLIT } else { Vec3::ZERO };
        let color = covering(|hit, ray| if hit.triangle.index() < lit { color(hit, ray) } else { unlit });
        self.subject(shots, smoothing, &color)
    }

    fn subject(
        &self,
        shots: &[Shot],
        smoothing: Smoothing,
        color: &(dyn Fn(Sight<'_>) -> Vec4 + Sync),
    ) -> Vec<Picture> {
        let subject = Subject { tracer: self.tracer, surfaces: self.surface, color };
        shots.iter().map(|shot| render(&subject, &shot.camera, shot.size, smoothing)).collect()
    }

    /// What the file shows, in unit values of all layers.
    fn shown_units(&self, hit: &Hit) -> Vec<f32> {
        let mut out = vec![0.0; self.layers.channels()];
        if let (Some(light), Some(views)) = (self.light, &self.views) {
            light.show(views, point(hit), &mut out);
        }
        out
    }

    /// The same, traced.
    fn traced_units(&self, hit: &Hit) -> Vec<f32> {
        let bits = hit.barycentric.map(|b| u64::from(b.to_bits()));
        let key = random::hash(PICTURE_SEED, u64::from(hit.triangle.0), bits[0], bits[1]);
        // A share of the rays for each of the places of a pixel.
        let batches = (self.rays / PLACES.len() as u32).div_ceil(self.signal.rays_per_batch()).max(1);
        let mut sum = vec![0.0; self.layers.channels()];
        let mut out = vec![0.0; self.signal.channels()];
        for batch in 0..batches {
            self.signal.batch(point(hit), key, batch, &mut out);
            sum.iter_mut().zip(&out).for_each(|(sum, value)| *sum += value / batches as f32);
        }
        sum.iter().enumerate().map(|(channel, &x)| self.layers.to_unit(channel, x)).collect()
    }

    /// How unit values look: the chosen layer, gray for one channel; light as a share of white.
    fn color(&self, units: &[f32]) -> Vec3 {
        let channels = self.layers.layers[self.layer].channels();
        let shown = |c: usize| match self.values {
            Values::Screen => self.layers.displayed(c, units[c]),
            Values::Signal => self.layers.from_unit(c, units[c]),
        };
        match channels.len() {
            1 => Vec3::splat(shown(channels.start)),
            count => {
                Vec3::from_array(std::array::from_fn(
                    |c| if c < count { shown(channels.start + c) } else { 0.0 },
                ))
            }
        }
    }

    /// The color of an error; as a signal, what is shown less what is traced.
    fn error_color(&self, hit: &Hit) -> Vec3 {
        let (shown, traced) = (self.shown_units(hit), self.traced_units(hit));
        if self.values == Values::Signal {
            return self.color(&shown) - self.color(&traced);
        }
        let normal = self.surface.lit_normal(point(hit));
        color_of_error(self.layers.difference(normal, &shown, &traced))
    }

    /// What the colors of a mode mean, where they need words.
    pub fn legend(&self, mode: ModeName) -> Option<Legend> {
        match mode {
            ModeName::Error => Some(error_legend(self.light.map(|light| light.extension.max_error))),
            ModeName::Classes => {
                let names = ["texture", "mixed", "color"].map(str::to_owned);
                Some(Legend::Names(CLASS_COLORS.into_iter().zip(names).collect()))
            }
            _ => None,
        }
    }

    fn interpolated(&self, values: &[f32], hit: &Hit) -> Vec3 {
        let mut out = vec![0.0; self.layers.channels()];
        shade::interpolate(self.surface, self.layers, values, point(hit), &mut out);
        self.color(&out)
    }

    /// A headlight with a little from above.
    fn clay(&self, hit: &Hit, ray: &Ray) -> f32 {
        let normal = self.surface.mesh.shading_normal(point(hit));
        0.15 + 0.6 * normal.dot(ray.direction).abs() + 0.25 * (0.5 + 0.5 * normal.y)
    }

    fn class_color(&self, hit: &Hit) -> Vec3 {
        let Some(light) = self.light else { return CLASS_COLORS[2] };
        match light.codes(hit.triangle).iter().filter(|code| !code.is_color()).count() {
            3 => CLASS_COLORS[0],
            0 => CLASS_COLORS[2],
            _ => CLASS_COLORS[1],
        }
    }

    /// A color by 32 x 32 texel cells of the atlas, which charts of their own seldom share.
    fn chart_color(&self, hit: &Hit) -> Vec3 {
        let Some(light) = self.light.filter(|l| l.is_texture(hit.triangle)) else { return CLASS_COLORS[2] };
        let mut place = [0.0_f32; 2];
        for (code, weight) in light.codes(hit.triangle).iter().zip(point(hit).weights()) {
            let position = code.position().unwrap_or_default();
            place = [place[0] + weight * position[0], place[1] + weight * position[1]];
        }
        let cell = place.map(|p| (p / 2.0) as u64);
        let checker = if (cell[0] + cell[1]) % 2 == 0 { 1.0 } else { 0.7 };
        let hash = random::hash(1, cell[0] / 16, cell[1] / 16, 0);
        let [r, g] = random::unit2(hash);
        checker * (Vec3::splat(0.25) + 0.7 * Vec3::new(r, g, 1.0 - 0.5 * (r + g)))
    }

    /// Fresh points with the error of what the file shows there; those inside other geometry are left out.
    ///
    /// # Errors
    /// When the work is stopped.
    pub fn errors(&self, count: usize, clock: &mut Clock<'_>) -> Result<Vec<ErrorPoint>, BakeError> {
        let mesh = &self.surface.mesh;
        clock.stage("light")?;
        let (points, keys) = lightkiln_sample::fresh_points(mesh, count, PICTURE_SEED);
        let mut light = Estimates::new(points.len(), self.signal.channels());
        let batches = self.rays.div_ceil(self.signal.rays_per_batch()).clamp(1, u32::from(u16::MAX)) as u16;
        let wanted = vec![batches; points.len()];
        shade::refine(&mut light, self.signal.as_ref(), &points, &keys, &wanted, clock)?;
        let traced = self.layers.light(self.surface.lit_normals(&points), &light);
        let (Some(file), Some(views)) = (self.light, &self.views) else { return Ok(Vec::new()) };
        let mut shown = vec![0.0; self.layers.channels()];
        let seen = (0..points.len()).filter(|&i| light.valid(i));
        let at = |i: usize| {
            file.show(views, points[i], &mut shown);
            ErrorPoint {
                at: mesh.position(points[i]).to_array(),
                normal: mesh.shading_normal(points[i]).to_array(),
                double_sided: self.surface.flags(points[i].triangle).double_sided,
                error: self.layers.worst(&shown, &traced, i).0,
            }
        };
        Ok(seen.map(at).collect())
    }

    fn point_samples(&self) -> Vec<f32> {
        let mesh = &self.surface.mesh;
        let vertices = (0..mesh.vertex_count() as u32).map(lightkiln_mesh::VertexId);
        let points: Vec<SurfacePoint> = vertices.clone().map(|v| self.surface.point_at(v)).collect();
        let keys: Vec<u64> = vertices.map(|v| random::hash(PICTURE_SEED, u64::from(v.0), 0, 0)).collect();
        let mut light = Estimates::new(points.len(), self.signal.channels());
        light.refine(self.signal.as_ref(), &points, &keys, &vec![16; points.len()]);
        self.layers.light(self.surface.lit_normals(&points), &light).values
    }

    /// Values of the light vertices alone, in unit values, from samples of that radius.
    ///
    /// # Errors
    /// When they cannot be fitted.
    pub fn least_squares(&self, radius: f32, clock: &mut Clock<'_>) -> Result<Vec<f32>, Failure> {
        let samples = poisson_disk(&self.surface.mesh, &SampleOptions { radius, seed: PICTURE_SEED })
            .map_err(BakeError::from)?;
        Ok(shade::light_and_fit(self.surface, self.signal.as_ref(), self.layers, samples, 8, clock)?)
    }

    /// A lightmap over everything, with texels of that width.
    ///
    /// - `values`: of the light vertices, in unit values
    ///
    /// # Errors
    /// Charts that cannot be cut or packed.
    pub fn full_texture(
        &self,
        values: &[f32],
        texel_size: f32,
        clock: &mut Clock<'_>,
    ) -> Result<Shown, BakeError> {
        let options = BakeOptions {
            detail: Some(2.0 * texel_size),
            quality: Quality::Draft,
            seed: PICTURE_SEED,
            ..BakeOptions::default()
        };
        let plan = Plan::new(&options, &self.surface.mesh)?;
        full_texture(self.surface, self.signal.as_ref(), self.layers, values, &plan, clock)
    }
}

/// Pictures have noise of their own, unlike that of any bake with a usual seed.
const PICTURE_SEED: u64 = 0x9ec7;

fn point(hit: &Hit) -> SurfacePoint {
    SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric }
}
