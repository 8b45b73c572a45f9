//! One function per command: read, compute, print, exit code.

use std::io::Write;

use lightkiln_bake::{BakeError, BakeOptions, Baked, bake};
use lightkiln_report::{Report, bytes_text, table};

use crate::arguments::{Arguments, Bake, BakeSettings, Command, Common, Inspect, Verify};
use crate::files::{check_outputs, depfile, write_whole};
use crate::messages::{Exit, Failure};
use crate::pictures;
use crate::preview::{Followers, Interrupt, Preview};
use crate::progress::Stages;
use crate::{vertices, view};

/// Runs a command.
///
/// # Errors
/// One message with place, remedy and exit code.
pub fn run(arguments: Arguments) -> Result<Exit, Failure> {
    match arguments.command {
        Command::Bake(bake) => run_bake(&bake),
        Command::Inspect(inspect) => run_inspect(&inspect),
        Command::Verify(verify) => run_verify(&verify),
        Command::Render(render) => pictures::run(&render),
        Command::View(view) => view::run(&view),
        Command::Compare(compare) => vertices::run_compare(&compare),
        Command::Fit(fit) => vertices::run_fit(&fit),
    }
}

/// Sets the number of threads of everything that follows.
pub fn use_threads(common: &Common) -> Result<(), Failure> {
    let threads = common.threads.map_or(0, usize::from);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Failure::new(Exit::Failed, format!("cannot start {threads} threads: {e}")))
}

fn run_bake(arguments: &Bake) -> Result<Exit, Failure> {
    let settings = arguments.settings()?;
    if arguments.print_config {
        let text = toml::to_string(&settings).map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
        return print(&text);
    }
    use_threads(&arguments.common)?;
    let options = settings.options();
    check_files(arguments, &options)?;
    let interrupt = Interrupt::listen();
    let preview =
        arguments.preview.map(|port| Preview::open(port, lightkiln_bake::file_name(&arguments.output)));
    let preview = preview.transpose()?;
    let stages = Stages::new(arguments.common.quiet);
    let followers = Followers { stages: &stages, interrupt: &interrupt, preview: preview.as_ref() };
    let baked = bake(&arguments.input, &arguments.output, &options, &followers);
    stages.finish();
    let baked = baked.map_err(|error| Failure::from(error).or_in(&arguments.input));
    let done = baked.and_then(|baked| {
        let (exit, report) = finish_bake(arguments, &settings, baked)?;
        let model = preview.as_ref().map(|_| view::baked_model(&arguments.output, settings.scene, &report));
        Ok((exit, model.transpose()?))
    });
    if let Some(preview) = &preview {
        match &done {
            Ok((exit, Some(model))) => {
                let message = exit.as_ref().err().map_or("", Failure::what);
                preview.show_file(model, message, &interrupt);
            }
            Ok(_) => {}
            Err(failure) => preview.show_failure(failure),
        }
    }
    done?.0
}

/// Writes and prints what belongs to a bake beside its file. The first result is how the program ends.
fn finish_bake(
    arguments: &Bake,
    settings: &BakeSettings,
    mut baked: Baked,
) -> Result<(Result<Exit, Failure>, Report), Failure> {
    baked.report.peak_memory_bytes = peak_memory_bytes();
    let report = &baked.report;

    for path in &arguments.report {
        view::write_report(path, report, &arguments.output, settings.scene)?;
        baked.outputs.push(path.clone());
    }
    if let Some(path) = &arguments.depfile {
        let mut inputs = baked.inputs.clone();
        inputs.extend(arguments.config.clone());
        write_whole(path, depfile(&baked.outputs, &inputs).as_bytes())?;
    }
    if arguments.common.json {
        print(&report.to_json())?;
    } else if !arguments.common.quiet {
        print(&table::render(report))?;
    }
    let verdict = verdict(arguments, settings, report);
    Ok((verdict, baked.report))
}

/// Whether the file is what was asked for.
fn verdict(arguments: &Bake, settings: &BakeSettings, report: &Report) -> Result<Exit, Failure> {
    if let Some(limit) = settings.max_bytes.filter(|limit| report.bytes.total > limit.0) {
        return Err(over_budget(report.bytes.total, limit.0, &report.bytes.largest));
    }
    if !report.errors.bound.kept() {
        let bound = &report.errors.bound;
        return Err(Failure::new(
            Exit::Bound,
            format!(
                "the bound of {} is exceeded at {} samples and {:.2} % of the fresh points in color triangles",
                bound.limit,
                bound.samples_beyond,
                bound.color_share_beyond() * 100.0
            ),
        )
        .place(format!("{}, which was written all the same", arguments.output.display()))
        .remedy("ask for a smaller --detail, more --samples or a higher --quality"));
    }
    Ok(Exit::Done)
}

/// Finds out before the work whether the outputs can be written and overwrite nothing that is needed.
fn check_files(arguments: &Bake, options: &BakeOptions) -> Result<(), Failure> {
    let Bake { input, output, config, report, depfile, .. } = arguments;
    let ending = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if !matches!(ending.as_deref(), Some("glb" | "gltf")) {
        return Err(Failure::new(Exit::Usage, "the output ends neither in .glb nor in .gltf")
            .place(output.display().to_string())
            .remedy("name it NAME.baked.glb"));
    }
    let (mut inputs, mut outputs) = (vec![input.as_path()], vec![output.as_path()]);
    inputs.extend(config.as_deref());
    outputs.extend(report.iter().map(std::path::PathBuf::as_path));
    outputs.extend(depfile.as_deref());
    inputs.extend(options.light.files().chain(options.signals.files()).map(std::path::PathBuf::as_path));
    check_outputs(&inputs, &outputs)
}

fn over_budget(total: u64, limit: u64, largest: &[lightkiln_report::Contributor]) -> Failure {
    let names: Vec<String> =
        largest.iter().take(3).map(|c| format!("{} {}", c.name, bytes_text(c.bytes))).collect();
    Failure::new(
        Exit::Budget,
        format!(
            "the light takes {} on the GPU, {} more than allowed",
            bytes_text(total),
            bytes_text(total - limit)
        ),
    )
    .place(format!("largest: {}", names.join(", ")))
    .remedy("raise --max-error or --detail, or the budget")
}

fn run_inspect(arguments: &Inspect) -> Result<Exit, Failure> {
    let inspection = lightkiln_bake::inspect::inspect(&arguments.file)
        .map_err(|error| Failure::from(error).or_in(&arguments.file))?;
    if arguments.json {
        print(&inspection.to_json())?;
    } else {
        print(&inspection.to_text())?;
    }
    match (arguments.max_bytes, inspection.light_bytes()) {
        (Some(limit), Some(total)) if total > limit.0 => {
            Err(over_budget(total, limit.0, &inspection.largest))
        }
        _ => Ok(Exit::Done),
    }
}

fn run_verify(arguments: &Verify) -> Result<Exit, Failure> {
    use_threads(&arguments.common)?;
    let stages = Stages::new(arguments.common.quiet);
    let options = lightkiln_bake::verify::VerifyOptions {
        points: arguments.points as usize,
        rays: arguments.rays,
        seed: arguments.seed,
        scene: arguments.scene,
        environment: arguments.environment.clone(),
    };
    let verified = lightkiln_bake::verify::verify_file(&arguments.file, &options, &stages);
    stages.finish();
    let errors = verified.map_err(|error| Failure::from(error).or_in(&arguments.file))?;
    if arguments.common.json {
        let mut text =
            serde_json::to_string_pretty(&errors).map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
        text.push('\n');
        print(&text)?;
    } else if !arguments.common.quiet {
        print(&table::errors_table(&errors))?;
    }
    if errors.bound.kept() {
        return Ok(Exit::Done);
    }
    Err(Failure::new(
        Exit::Bound,
        format!(
            "the bound of {} is exceeded at {:.2} % of the fresh points in color triangles",
            errors.bound.limit,
            errors.bound.color_share_beyond() * 100.0
        ),
    )
    .place(arguments.file.display().to_string())
    .remedy("bake again with a smaller --detail, more --samples or a higher --quality"))
}

/// Prints a result. A reader that went away is no failure.
pub fn print(text: &str) -> Result<Exit, Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Ok(()) => Ok(Exit::Done),
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(Exit::Done),
        Err(error) => Err(Failure::new(Exit::Files, format!("cannot print: {error}"))
            .remedy("check where the output is redirected to")),
    }
}

/// The largest resident memory of this process so far, where the system tells.
fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

impl From<BakeError> for Failure {
    fn from(error: BakeError) -> Self {
        let exit = match &error {
            BakeError::Option { .. }
            | BakeError::Profile { .. }
            | BakeError::AreaLight { .. }
            | BakeError::AllLeftOut { .. } => Exit::Usage,
            BakeError::Cancelled => Exit::Cancelled,
            BakeError::Write { .. } => Exit::Files,
            BakeError::NoDenoiser { .. } => Exit::Unsupported,
            BakeError::Scene(scene) => match scene.kind() {
                lightkiln_scene::ErrorKind::Files => Exit::Files,
                lightkiln_scene::ErrorKind::Request => Exit::Usage,
                lightkiln_scene::ErrorKind::Unsupported => Exit::Unsupported,
                lightkiln_scene::ErrorKind::Invalid => Exit::Input,
            },
            BakeError::NothingToBake { .. }
            | BakeError::NotBaked { .. }
            | BakeError::NoSignal { .. }
            | BakeError::Light(_)
            | BakeError::Environment { .. }
            | BakeError::Mesh(_)
            | BakeError::Image(_) => Exit::Input,
            _ => Exit::Failed,
        };
        let place = match &error {
            BakeError::Scene(scene) => Some(scene.place().to_string()).filter(|p| !p.is_empty()),
            BakeError::NoDenoiser { .. } | BakeError::DenoiserFailed { .. } => {
                Some("--denoiser oidn".to_owned())
            }
            _ => None,
        };
        if matches!(error, BakeError::Cancelled) {
            return Self::new(exit, error.to_string());
        }
        let remedy = error.remedy().unwrap_or_else(|| {
            let advice = match &error {
                BakeError::Option { .. } => "see `lightkiln bake --help`",
                BakeError::Write { .. } => "check that the folder is writable and has room",
                BakeError::Mesh(_) => "repair or split the scene and export it again",
                BakeError::Image(_) => "the atlas is damaged: bake the file again",
                _ => "this is a fault of lightkiln: please report it with the file",
            };
            advice.to_owned()
        });
        let failure = Self::new(exit, error.to_string()).remedy(remedy);
        match place {
            Some(place) => failure.place(place),
            None => failure,
        }
    }
}
