//! What a bake is asked to do, and the plan that follows from it once the scene is known.

use lightkiln_light::{Lighting, Tracer};
use lightkiln_mesh::Mesh;
use lightkiln_scene::{Fallback, Profile};

use crate::BakeError;
use crate::denoiser::Denoiser;
use crate::lighting::LightOptions;
use crate::signals::{Signals, Stage};
use crate::surface::Surface;

/// How much work a bake may do. The bound is the same in all three; what changes is the detail that is looked
/// at, and how often noise leaves a decision open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// Seconds: for a first look.
    Draft,
    /// The default.
    #[default]
    Normal,
    /// For delivery.
    Final,
}

impl Quality {
    /// The name that the command line and the report use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Normal => "normal",
            Self::Final => "final",
        }
    }

    fn effort(self) -> Effort {
        match self {
            Self::Draft => Effort {
                samples: 75_000,
                denser_rounds: 2,
                sample_batches: [2, 8],
                texel_batches: [2, 6],
                texel_noise: 0.02,
                rounds: 24,
                reference_batches: 16,
                check_points: 6_000,
            },
            Self::Normal => Effort {
                samples: 250_000,
                denser_rounds: 3,
                sample_batches: [4, 32],
                texel_batches: [4, 24],
                texel_noise: 0.01,
                rounds: 24,
                reference_batches: 64,
                check_points: 12_000,
            },
            Self::Final => Effort {
                samples: 1_000_000,
                denser_rounds: 4,
                sample_batches: [8, 128],
                texel_batches: [8, 96],
                texel_noise: 0.005,
                rounds: 24,
                reference_batches: 128,
                check_points: 40_000,
            },
        }
    }
}

/// The numbers behind a [`Quality`]. Batches are of 16 rays (`Signal::rays_per_batch`).
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// About this many Poisson samples over the whole surface.
    pub samples: usize,
    /// How often triangles that know too little of their light get one more sample.
    pub denser_rounds: usize,
    /// Batches that every sample gets, and the most that an open decision may spend on one.
    pub sample_batches: [u16; 2],
    /// Batches that every texel gets, and the most that a noisy one may.
    pub texel_batches: [u16; 2],
    /// Standard error that a texel should reach.
    pub texel_noise: f32,
    /// The most rounds of charting, encoding and checking.
    pub rounds: usize,
    /// Batches of a reference.
    pub reference_batches: u16,
    /// The most fresh points that are traced while rounds go on, and again for the report.
    pub check_points: usize,
}

/// What keeps values of layers with a range (occlusion, shadows, textures) within it. Light is always clamped at its
/// vertices, for nothing lies beyond its range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeBounds {
    /// Vertex values are clamped.
    #[default]
    Clamp,
    /// Vertex values may lie beyond the range, and what is interpolated is clamped, by viewers too (Kavan 2011,
    /// section 3.3, names this as well as the optimum).
    ClampAfter,
    /// Vertex values are those of the least error within the range.
    Optimum,
}

/// Options of a bake; the defaults suit a file that nobody has seen before.
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// What is baked, a layer or more each.
    pub signals: Signals,
    /// Which light there is and what it meets.
    pub light: LightOptions,
    /// How the light stands in the file.
    pub profile: Profile,
    /// Colors of vertices as entries of a table instead of packed into the codes.
    pub table: bool,
    /// What keeps values within their range.
    pub bounds: BakeBounds,
    /// The textures of the file that the light takes the place of leave it.
    pub replace: bool,
    /// Largest absolute error as a share of the signal's range, above 0 and below 1.
    pub max_error: f32,
    /// Smallest feature kept, in units of the file. Excludes `samples`.
    pub detail: Option<f32>,
    /// About so many samples over the whole surface. Excludes `detail`.
    pub samples: Option<usize>,
    /// Preset for everything that costs time.
    pub quality: Quality,
    /// What takes the noise out of light.
    pub denoiser: Denoiser,
    /// Occluders farther away than this do not count, in units of the file; infinity is allowed. The default
    /// is [`DEFAULT_DISTANCE`] of the scene's diagonal.
    pub ao_distance: Option<f32>,
    /// What counts as white in a layer of light, in lux; found in the scene if none.
    pub white: Option<f32>,
    /// Seed of every random number.
    pub seed: u64,
    /// What viewers see that do not know the extension.
    pub fallback: Fallback,
    /// Which scene of the file; its default scene if none.
    pub scene: Option<usize>,
    /// Also write the atlas as OpenEXR beside the output, in the unit of the light.
    pub exr: bool,
    /// Also write the atlas of each layer as KTX2 beside the output, in the unit of the light.
    pub ktx2: bool,
}

/// The default ambient-occlusion distance as a share of the diagonal of the scene's bounding box.
pub const DEFAULT_DISTANCE: f32 = 0.1;

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            signals: Signals::default(),
            light: LightOptions::default(),
            profile: Profile::default(),
            table: false,
            bounds: BakeBounds::Clamp,
            replace: false,
            max_error: 0.03,
            detail: None,
            samples: None,
            quality: Quality::Normal,
            denoiser: Denoiser::Own,
            ao_distance: None,
            white: None,
            seed: 0,
            fallback: Fallback::Color0,
            scene: None,
            exr: false,
            ktx2: false,
        }
    }
}

/// The options with every default filled in for one scene.
#[derive(Clone, Debug)]
pub struct Plan {
    /// What is baked.
    pub signals: Signals,
    /// Which light there is and what it meets.
    pub light: LightOptions,
    /// How the light stands in the file.
    pub profile: Profile,
    /// Colors of vertices as entries of a table.
    pub table: bool,
    /// What keeps values within their range.
    pub bounds: BakeBounds,
    /// Largest absolute error.
    pub max_error: f32,
    /// Poisson radius and width of a texel, in units of the file: half the detail (Schaefer 5, Nyquist).
    pub radius: f32,
    /// Rays end here, in units of the file.
    pub ao_distance: f32,
    /// What counts as white, in the unit of the light; found in the scene if none.
    pub white: Option<f32>,
    /// Seed of every random number.
    pub seed: u64,
    /// Preset name.
    pub quality: Quality,
    /// The numbers behind it.
    pub effort: Effort,
    /// What takes the noise out of light.
    pub denoiser: Denoiser,
    /// Diagonal of the scene's bounding box.
    pub diagonal: f32,
}

/// A decision counts as certain at this many standard errors.
pub const CONFIDENCE: f32 = 3.0;

/// How far the filter of noisy light looks, in sample radii or texels.
pub const FILTER_RADIUS: f32 = 4.0;

/// Empty texels kept around a chart: one keeps the bilinear lookup and the first mip level clean. Two would
/// cost 33 to 53 % more blocks (docs/PACKING.md).
pub const GUTTER_TEXELS: u32 = 1;

impl Plan {
    /// What the signals are made of.
    pub fn stage<'a>(
        &'a self,
        surface: &'a Surface<'a>,
        tracer: &'a Tracer<'a>,
        lighting: &'a Lighting,
    ) -> Stage<'a> {
        Stage { surface, tracer, lighting, options: &self.light, distance: self.ao_distance, seed: self.seed }
    }

    /// Fills in the defaults.
    ///
    /// # Errors
    /// [`BakeError::Option`] for a value outside its range, with the range.
    pub fn new(options: &BakeOptions, mesh: &Mesh) -> Result<Self, BakeError> {
        let positive = |name: &'static str, value: f32, infinite: bool| {
            if value > 0.0 && (infinite || value.is_finite()) {
                Ok(value)
            } else {
                let range = if infinite { "above 0" } else { "above 0 and finite" };
                Err(BakeError::Option { name, value: value.to_string(), range })
            }
        };
        if !(options.max_error > 0.0 && options.max_error < 1.0) {
            return Err(BakeError::Option {
                name: "--max-error",
                value: options.max_error.to_string(),
                range: "above 0 and below 1",
            });
        }
        let (low, high) = mesh.bounds();
        let diagonal = (high - low).length();
        let effort = options.quality.effort();
        let samples = options.samples.unwrap_or(effort.samples);
        if samples == 0 {
            return Err(BakeError::Option { name: "--samples", value: "0".into(), range: "at least 1" });
        }
        let radius = match options.detail {
            Some(detail) => positive("--detail", detail, false)? / 2.0,
            None => lightkiln_sample::radius_for(mesh, samples),
        };
        let ao_distance = match options.ao_distance {
            Some(distance) => positive("--ao-distance", distance, true)?,
            None => diagonal * DEFAULT_DISTANCE,
        };
        Ok(Self {
            signals: options.signals.clone(),
            light: options.light.clone(),
            profile: options.profile,
            table: options.table,
            bounds: options.bounds,
            max_error: options.max_error,
            radius,
            ao_distance,
            white: options.white.map(|white| positive("--white", white, false)).transpose()?,
            seed: options.seed,
            quality: options.quality,
            effort,
            denoiser: options.denoiser,
            diagonal,
        })
    }
}
