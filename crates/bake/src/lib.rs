//! The pipeline: from a glTF file to the same file with light on it, and a report of what that costs.
//!
//! [`bake`] reads like the picture in ARCHITECTURE.md, a line per stage. What a stage needs beyond its own
//! crate stands here:
//!
//! | module | what |
//! |---|---|
//! | [`options`] | what is asked for, and the plan that follows |
//! | [`surface`] | parts of the scene to one light mesh |
//! | `sides` | which side of a sheet is seen |
//! | [`lighting`] | which light there is and what it meets |
//! | [`moving`] | parts that animations move |
//! | [`scenery`] | all files that light is traced in |
//! | [`layers`] | what stored values mean, and what an error is |
//! | [`harmonics`] | what an error is where light is a function of the normal |
//! | [`denoiser`], `oidn` | who takes the noise out of it |
//! | [`shade`] | light, fit, classify: rays where a decision is open |
//! | [`rounds`] | chart, texel, encode, check, until the bound holds |
//! | [`borders`] | where charts meet color triangles |
//! | [`stored`] | the images of the file, and what a viewer shows of them |
//! | `profiles` | what each profile can hold |
//! | [`output`] | codes and texels to the file |
//! | [`file_light`] | and back, as a viewer reads them |
//! | [`verify`] | errors at fresh points |
//! | [`figures`] | the report |
//! | [`clock`] | stages, progress, and the way to stop |
//! | [`snapshot`] | what there is so far, for those who watch |
//! | [`signals`] | what is baked |
//! | [`authored`] | times the occlusion textures of the file, at their own resolution |
//! | [`compare`] | vertex values alone, by every method |

pub mod authored;
pub mod borders;
pub mod clock;
pub mod compare;
pub mod denoiser;
pub mod error;
pub mod figures;
pub mod file_light;
pub mod harmonics;
pub mod inspect;
pub mod layers;
pub mod lighting;
pub mod moving;
#[cfg(feature = "oidn")]
mod oidn;
pub mod options;
pub mod output;
mod profiles;
pub mod rounds;
pub mod scenery;
pub mod shade;
mod sides;
pub mod signals;
pub mod snapshot;
pub mod stored;
pub mod surface;
pub mod verify;

use std::path::Path;

use authored::OwnResolution;
use lightkiln_light::Tracer;
use lightkiln_report::Report;
use lightkiln_sample::{SampleOptions, poisson_disk};
use lightkiln_scene::Scene;

pub use clock::{Clock, Progress, Silent};
pub use denoiser::Denoiser;
pub use error::BakeError;
pub use file_light::FileLight;
pub use lighting::LightOptions;
pub use options::{BakeOptions, Plan, Quality};
pub use scenery::{Opened, Opening, Scenery};
pub use snapshot::Snapshot;
pub use surface::Surface;

/// What a bake leaves behind beside the files.
pub struct Baked {
    /// Bytes, errors and times.
    pub report: Report,
    /// Every file that was written.
    pub outputs: Vec<std::path::PathBuf>,
    /// Every file that was read.
    pub inputs: Vec<std::path::PathBuf>,
}

/// Bakes light onto a scene and writes it: ambient occlusion, unless other signals are asked for.
///
/// The same input, options and seed give the same bytes for any number of threads.
///
/// # Errors
/// [`BakeError`], [`BakeError::Cancelled`] when `progress` says so. Nothing is written then, except with
/// [`BakeError::ReadBack`], which is found in the written file.
pub fn bake(
    input: &Path,
    output: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Baked, BakeError> {
    let mut clock = Clock::new(progress);
    options.denoiser.check()?;
    let options = &BakeOptions { light: options.light_of_profile()?, ..options.clone() };
    clock.stage("read")?;
    let scenery = Scenery::read(input, options.scene, &options.signals, &options.light)?;
    let moving = options.light.moving_parts(&scenery.scene)?;
    // From here on, as the file will say it.
    let light = LightOptions { moving: moving.left_out.into(), ..options.light.clone() };
    let options = &BakeOptions { light, ..options.clone() };
    clock.stage("weld")?;
    let surface = scenery.surface(&file_name(input), &options.light)?;
    let plan = Plan::new(options, &surface.mesh)?;
    let mut remarks = scenery.remarks(&moving);
    remarks.extend(profiles::remarks(&surface, &plan)?);
    clock.show(&Snapshot { surface: &surface, plan: &plan, light: None });
    clock.stage("light")?;
    let tracer = Tracer::new(surface.casters(), &surface)?;
    surface.turn_hidden_sheets(&tracer, plan.ao_distance, &scenery.lighting);
    let stage = plan.stage(&surface, &tracer, &scenery.lighting);
    let signal = plan.signals.judged_on(&stage)?;
    let signal = signal.as_ref();
    let own_resolution = OwnResolution::of(&plan, &stage)?;
    options.check_profile(&harmonics::baked(signal))?;
    shade::draft(&surface, signal, &plan, &clock)?;
    clock.stage("sample")?;
    let samples = poisson_disk(&surface.mesh, &SampleOptions { radius: plan.radius, seed: plan.seed })?;
    let mut lit = shade::light_fit_classify(&surface, signal, samples, &plan, &mut clock)?;
    if let Some(finer) = &own_resolution {
        finer.promote(&mut lit, plan.max_error);
    }
    let seen = verify::seen_points(&surface, signal, &lit, &plan, &mut clock)?;
    lit.tighten(&surface, &seen, &plan);
    let finer = own_resolution.as_ref();
    let shown = rounds::chart_texel_encode(&surface, signal, finer, &lit, &seen, &plan, &mut clock)?;
    remarks.extend(finer.and_then(|finer| finer.remark(&shown.charts, &plan)));
    let written = output::write(&surface, &lit.layers, &shown, &plan, options, output, &mut clock)?;
    let errors = verify::written_file(&surface, signal, &lit, &seen, &shown, &written, &plan, &mut clock)?;
    let report = figures::report(figures::Everything {
        input,
        output,
        surface: &surface,
        finer,
        remarks,
        plan: &plan,
        lit: &lit,
        seen: &seen,
        shown: &shown,
        written: &written,
        errors,
        stages: clock.finish(),
    });
    let mut inputs = scenery.scene.inputs();
    inputs.extend(scenery.occluders.iter().flat_map(Scene::inputs));
    inputs.extend(options.light.environment.iter().chain(options.signals.files()).cloned());
    Ok(Baked { report, outputs: written.outputs, inputs })
}

/// The name of a file without its folder, for messages.
pub fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}
