//! The command `render`: which picture shows what.

use std::path::Path;

use glam::Vec3;

use lightkiln_bake::file_light::Recipe;
use lightkiln_bake::layers::Layers;
use lightkiln_bake::options::BakeBounds;
use lightkiln_bake::{BakeError, Clock, FileLight, Opened, Surface, options, shade};
use lightkiln_encode::AtlasView;
use lightkiln_light::{Estimates, Hit, Signal, Surfaces, Tracer};
use lightkiln_mesh::{SurfacePoint, random};
use lightkiln_page::ErrorPoint;
use lightkiln_render::{Camera, Picture, View, render};
use lightkiln_sample::{SampleOptions, poisson_disk};

use crate::arguments::{ModeName, Render};
use crate::commands::use_threads;
use crate::files::write_whole;
use crate::messages::{Exit, Failure};
use crate::progress::Stages;

/// Renders the modes that were asked for side by side.
///
/// # Errors
/// A file that cannot be read or written, a view that is none, a mode that needs a baked file.
pub fn run(arguments: &Render) -> Result<Exit, Failure> {
    use_threads(&arguments.common)?;
    let view = View::parse(&arguments.view).ok_or_else(|| {
        Failure::new(Exit::Usage, format!("{:?} is no view", arguments.view)).remedy(
            "use front, back, left, right, top, bottom, three-quarter, or AZIMUTH,ELEVATION in degrees",
        )
    })?;
    if !(arguments.zoom.is_finite() && arguments.zoom > 0.0) {
        return Err(Failure::new(Exit::Usage, format!("--zoom is {}, but must be above 0", arguments.zoom)));
    }
    let target = match arguments.target.as_deref() {
        None => None,
        Some([x, y, z]) => Some(Vec3::new(*x, *y, *z)),
        Some(other) => {
            let what = format!("--target has {} numbers, but must have 3", other.len());
            return Err(Failure::new(Exit::Usage, what).remedy("write it as X,Y,Z"));
        }
    };
    let needs_bake = [ModeName::Light, ModeName::Classes, ModeName::Error, ModeName::Charts];
    let look = Look {
        file: &arguments.file,
        scene: arguments.scene,
        layer: arguments.layer,
        view,
        target,
        zoom: arguments.zoom,
        size: arguments.size as usize,
        rays: arguments.rays,
        needs_light: arguments.mode.iter().any(|m| needs_bake.contains(m)),
    };
    let stages = Stages::new(arguments.common.quiet);
    let mut clock = Clock::new(&stages);
    let pictures = in_studio(&look, &mut clock, |studio, clock| studio.pictures(&arguments.mode, clock));
    stages.finish();
    let row = Picture::row(&pictures?).map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
    let png = row.to_png().map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
    write_whole(&arguments.output, &png)?;
    Ok(Exit::Done)
}

/// What is looked at, and from where.
pub struct Look<'a> {
    /// The file.
    pub file: &'a Path,
    /// Which of its scenes.
    pub scene: Option<usize>,
    /// The layer that is shown.
    pub layer: usize,
    /// Where from.
    pub view: View,
    /// What is in the middle, if not the scene.
    pub target: Option<Vec3>,
    /// See [`Camera::framing`].
    pub zoom: f32,
    /// Width and height in pixels.
    pub size: usize,
    /// Rays per pixel for modes that trace light.
    pub rays: u32,
    /// Whether the file has to be baked.
    pub needs_light: bool,
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
    clock.stage("read");
    let opened = Opened::read(look.file, look.scene, None, look.needs_light)?;
    let surface = opened.scenery.surface(&file, &opened.options)?;
    let light = opened.recipe.as_ref().map(|_| FileLight::read(&surface, &file)).transpose()?;
    let tracer = Tracer::new(surface.casters(), &surface).map_err(BakeError::from)?;
    let (low, high) = surface.mesh.bounds();
    let usual = (high - low).length() * options::DEFAULT_DISTANCE;
    let distance = opened.recipe.as_ref().map_or(usual, Recipe::reach);
    surface.turn_hidden_sheets(&tracer, distance);
    let signal = opened.signals.on(&opened.stage(&surface, &tracer, distance, PICTURE_SEED))?;
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
    let mut studio = Studio {
        surface: &surface,
        tracer: &tracer,
        light: light.as_ref(),
        views: light.as_ref().map(FileLight::views).transpose()?,
        signal,
        layers,
        layer: look.layer,
        camera: Camera::framing(&surface.mesh.positions, look.target, look.view, look.zoom),
        size: look.size,
        rays: look.rays,
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
    pub layers: Layers,
    /// The layer that is shown.
    pub layer: usize,
    camera: Camera,
    /// Width and height in pixels.
    pub size: usize,
    /// Rays per pixel for modes that trace light.
    pub rays: u32,
}

/// Colors of classes: texture, mixed, color.
const CLASS_COLORS: [Vec3; 3] =
    [Vec3::new(0.85, 0.12, 0.10), Vec3::new(0.95, 0.65, 0.10), Vec3::new(0.75, 0.80, 0.85)];

/// What gets no light.
const UNLIT: Vec3 = Vec3::new(0.05, 0.05, 0.06);

/// By how much an error is magnified to be seen.
const ERROR_GAIN: f32 = 10.0;

impl Studio<'_> {
    /// A picture for each mode.
    ///
    /// # Errors
    /// When vertices cannot be fitted.
    pub fn pictures(&self, modes: &[ModeName], clock: &mut Clock<'_>) -> Result<Vec<Picture>, Failure> {
        let one = |&mode: &ModeName| {
            clock.stage("render");
            self.picture(mode, clock)
        };
        modes.iter().map(one).collect()
    }

    fn picture(&self, mode: ModeName, clock: &mut Clock<'_>) -> Result<Picture, Failure> {
        let mesh = &self.surface.mesh;
        Ok(match mode {
            ModeName::Clay => self.render(&|hit| Vec3::splat(self.clay(hit))),
            ModeName::Reference => self.render(&|hit| self.traced(hit)),
            ModeName::Light => self.render(&|hit| self.shown(hit)),
            ModeName::Error => self.render(&|hit| {
                let error = ERROR_GAIN * self.error(hit);
                // Too bright is red, too dark is blue, right is white.
                Vec3::ONE - Vec3::new((-error).max(0.0), error.abs(), error.max(0.0)).min(Vec3::ONE)
            }),
            ModeName::Classes => self.render(&|hit| self.class_color(hit) * (0.35 + 0.65 * self.clay(hit))),
            ModeName::Charts => self.render(&|hit| self.chart_color(hit) * (0.35 + 0.65 * self.clay(hit))),
            ModeName::Point => {
                let values = self.point_samples();
                self.render(&|hit| self.interpolated(&values, hit))
            }
            ModeName::LeastSquares => {
                let radius = match self.light {
                    Some(light) => light.extension.texel_size,
                    None => lightkiln_sample::radius_for(mesh, 250_000),
                };
                let values = self.least_squares(radius, clock)?;
                self.render(&|hit| self.interpolated(&values, hit))
            }
        })
    }

    fn render(&self, color: &(dyn Fn(&Hit) -> Vec3 + Sync)) -> Picture {
        let lit = self.surface.mesh.triangle_count();
        let shown = |hit: &Hit| if hit.triangle.index() < lit { color(hit) } else { UNLIT };
        render(self.tracer, self.surface, &self.camera, self.size, &shown)
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
        // A quarter of the rays for each of the four places of a pixel.
        let batches = (self.rays / 4).div_ceil(self.signal.rays_per_batch()).max(1);
        let mut sum = vec![0.0; self.layers.channels()];
        let mut out = sum.clone();
        for batch in 0..batches {
            self.signal.batch(point(hit), key, batch, &mut out);
            sum.iter_mut().zip(&out).for_each(|(sum, value)| *sum += value / batches as f32);
        }
        sum.iter().enumerate().map(|(channel, &x)| self.layers.to_unit(channel, x)).collect()
    }

    /// How unit values look: the chosen layer, gray for one channel; light as a share of white.
    fn color(&self, units: &[f32]) -> Vec3 {
        let channels = self.layers.layers[self.layer].channels();
        let shown = |c: usize| self.layers.displayed(c, units[c]);
        match channels.len() {
            1 => Vec3::splat(shown(channels.start)),
            count => {
                Vec3::from_array(std::array::from_fn(
                    |c| if c < count { shown(channels.start + c) } else { 0.0 },
                ))
            }
        }
    }

    fn shown(&self, hit: &Hit) -> Vec3 {
        self.color(&self.shown_units(hit))
    }

    fn traced(&self, hit: &Hit) -> Vec3 {
        self.color(&self.traced_units(hit))
    }

    fn error(&self, hit: &Hit) -> f32 {
        let traced = self.traced_units(hit);
        self.layers.worst(&self.shown_units(hit), &traced, &vec![0.0; traced.len()]).0
    }

    fn interpolated(&self, values: &[f32], hit: &Hit) -> Vec3 {
        let mut out = vec![0.0; self.layers.channels()];
        shade::interpolate(self.surface, &self.layers, values, point(hit), &mut out);
        self.color(&out)
    }

    /// A headlight with a little from above.
    fn clay(&self, hit: &Hit) -> f32 {
        let normal = self.surface.mesh.shading_normal(point(hit));
        let (_, forward) = self.camera.ray(0.0, 0.0);
        0.15 + 0.6 * normal.dot(forward).abs() + 0.25 * (0.5 + 0.5 * normal.y)
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
    pub fn errors(&self, count: usize, clock: &mut Clock<'_>) -> Vec<ErrorPoint> {
        let mesh = &self.surface.mesh;
        clock.stage("light");
        let (points, keys) = lightkiln_sample::fresh_points(mesh, count, PICTURE_SEED);
        let mut light = Estimates::new(points.len(), self.signal.channels());
        let batches = self.rays.div_ceil(self.signal.rays_per_batch()).clamp(1, u32::from(u16::MAX)) as u16;
        let wanted = vec![batches; points.len()];
        shade::refine(&mut light, self.signal.as_ref(), &points, &keys, &wanted, clock);
        let traced = self.layers.light(&light);
        let (Some(file), Some(views)) = (self.light, &self.views) else { return Vec::new() };
        let mut shown = vec![0.0; self.layers.channels()];
        let seen = (0..points.len()).filter(|&i| light.valid(i));
        seen.map(|i| {
            file.show(views, points[i], &mut shown);
            ErrorPoint {
                at: mesh.position(points[i]).to_array(),
                normal: mesh.shading_normal(points[i]).to_array(),
                double_sided: self.surface.flags(points[i].triangle).double_sided,
                error: self.layers.worst(&shown, traced.value(i), traced.sigma(i)).0,
            }
        })
        .collect()
    }

    fn point_samples(&self) -> Vec<f32> {
        let mesh = &self.surface.mesh;
        let vertices = (0..mesh.vertex_count() as u32).map(lightkiln_mesh::VertexId);
        let points: Vec<SurfacePoint> = vertices.clone().map(|v| self.surface.point_at(v)).collect();
        let keys: Vec<u64> = vertices.map(|v| random::hash(PICTURE_SEED, u64::from(v.0), 0, 0)).collect();
        let mut light = Estimates::new(points.len(), self.signal.channels());
        light.refine(self.signal.as_ref(), &points, &keys, &vec![16; points.len()]);
        self.layers.light(&light).values
    }

    /// Values of the light vertices alone, in unit values, from samples of that radius.
    ///
    /// # Errors
    /// When they cannot be fitted.
    pub fn least_squares(&self, radius: f32, clock: &mut Clock<'_>) -> Result<Vec<f32>, Failure> {
        let samples = poisson_disk(&self.surface.mesh, &SampleOptions { radius, seed: PICTURE_SEED })
            .map_err(BakeError::from)?;
        Ok(shade::light_and_fit(self.surface, self.signal.as_ref(), &self.layers, samples, 8, clock)?)
    }
}

/// Pictures have noise of their own, unlike that of any bake with a usual seed.
const PICTURE_SEED: u64 = 0x9ec7;

fn point(hit: &Hit) -> SurfacePoint {
    SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric }
}
