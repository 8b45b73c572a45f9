//! The commands `compare` and `fit`: vertex values alone, as Kavan 2011 has them.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::Vec3;
use lightkiln_bake::compare::{
    CompareOptions, Comparison, Gathered, Outside, Row, Tried, Way, compare, try_all,
};
use lightkiln_bake::lighting::LightOptions;
use lightkiln_bake::moving::Moving;
use lightkiln_bake::signals::{SIGNALS, SignalChoice, Signals};
use lightkiln_bake::{BakeError, BakeOptions, Clock, Plan, Scenery, Surface};
use lightkiln_fit::{Mass, Method, Regularizer};
use lightkiln_light::{Hit, Signal, Tracer};
use lightkiln_mesh::{SurfacePoint, random};
use lightkiln_render::picture::{BACKGROUND, covering};
use lightkiln_render::{Panel, Picture, Smoothing, Subject, View, render, sheet};
use lightkiln_report::bytes_text;

use crate::arguments::{Common, QualityName};
use crate::commands::{print, use_threads};
use crate::files::write_whole;
use crate::messages::{Exit, Failure};
use crate::progress::Stages;
use crate::stations::{LONG_LENS, framing, xyz};

/// What is fitted, and to how many samples.
#[derive(Args)]
pub struct Sampling {
    /// A .gltf or .glb file
    pub file: PathBuf,
    /// What is fitted
    #[arg(long, default_value = "ao", value_name = "SIGNAL", long_help = format!("What is fitted:\n{SIGNALS}"))]
    pub signal: SignalChoice,
    /// Which samples: 60k, 250k or a million [default: normal]
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// About so many samples over the surface
    #[arg(long, value_name = "N", conflicts_with = "detail")]
    pub samples: Option<usize>,
    /// Samples half so far apart, in metres (units of the file)
    #[arg(long, value_name = "METRES")]
    pub detail: Option<f32>,
    /// Rays of a sample
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(16..=65536))]
    pub rays: u32,
    /// Occluders farther away do not count, in metres, or `inf` [default: a tenth of the scene's diagonal]
    #[arg(long, value_name = "METRES")]
    pub ao_distance: Option<f32>,
    /// What happens to values outside the signal's range
    #[arg(long, value_enum, default_value = "none")]
    pub bounds: BoundsName,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Which scene of the file [default: the file's default scene]
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    #[command(flatten)]
    pub common: Common,
}

/// Arguments of `compare`.
#[derive(Args)]
pub struct Compare {
    #[command(flatten)]
    pub sampling: Sampling,
    /// Weight of the regularizer
    #[arg(long, default_value_t = 0.1)]
    pub alpha: f32,
}

/// Arguments of `fit`.
#[derive(Args)]
pub struct Fit {
    #[command(flatten)]
    pub sampling: Sampling,
    /// Which weights of the regularizer to try: alpha=0,0.01,0.1,1
    #[arg(long, value_name = "alpha=A,B,..", default_value = "alpha=0,0.01,0.1,1")]
    pub sweep: Sweep,
    /// What smooths; several are tried one after the other
    #[arg(long, value_enum, value_delimiter = ',', default_value = "edge")]
    pub regularizer: Vec<RegularizerName>,
    /// How vertex values are found; several are tried one after the other
    #[arg(long, value_enum, value_delimiter = ',', default_value = "ours")]
    pub method: Vec<MethodName>,
    /// A folder for pictures of each way, or a .png for all of them in one row; the last is the signal itself
    #[arg(short, long, value_name = "DIR|FILE.png")]
    pub output: Option<PathBuf>,
    /// Where to look from: front, back, left, right, top, bottom, three-quarter, or AZIMUTH,ELEVATION in degrees
    #[arg(long, default_value = "three-quarter", allow_hyphen_values = true)]
    pub view: String,
    /// 2 shows half as much of the scene, and so on
    #[arg(long, default_value_t = 1.0)]
    pub zoom: f32,
    /// Look at this point instead of the middle of the scene
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = xyz)]
    pub target: Option<Vec3>,
    /// Width and height of one picture in pixels
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(16..=8192))]
    pub size: u32,
}

/// The values of `--sweep`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep(pub Vec<f32>);

impl std::str::FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let values = text.strip_prefix("alpha=").ok_or("only alpha can be swept: alpha=0,0.01,0.1,1")?;
        let read = |t: &str| match t.trim().parse::<f32>() {
            Ok(alpha) if alpha.is_finite() && alpha >= 0.0 => Ok(alpha),
            _ => Err(format!("{t:?} is no number of at least 0")),
        };
        values.split(',').map(read).collect::<Result<_, _>>().map(Self)
    }
}

/// Names of [`Regularizer`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RegularizerName {
    /// Jumps of gradients over edges; free for linear functions
    Edge,
    /// The same as printed in the paper, which is not
    EdgePrinted,
    /// Gradients
    Gradient,
    /// Gradients and their jumps
    Both,
}

impl From<RegularizerName> for Regularizer {
    fn from(name: RegularizerName) -> Self {
        match name {
            RegularizerName::Edge => Self::Edge,
            RegularizerName::EdgePrinted => Self::EdgePrinted,
            RegularizerName::Gradient => Self::Gradient,
            RegularizerName::Both => Self::Both,
        }
    }
}

/// Names of [`Outside`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BoundsName {
    /// They stay
    None,
    /// They are clamped
    Clamp,
    /// They stay, and what is interpolated between them is clamped
    ClampAfter,
    /// The least error of all values within the range
    Optimum,
}

impl From<BoundsName> for Outside {
    fn from(name: BoundsName) -> Self {
        match name {
            BoundsName::None => Self::None,
            BoundsName::Clamp => Self::Clamp,
            BoundsName::ClampAfter => Self::ClampAfter,
            BoundsName::Optimum => Self::Optimum,
        }
    }
}

/// Names of [`Method`].
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MethodName {
    /// The signal at the vertices
    Point,
    /// Weighted averages
    Average,
    /// Least squares, matrix from the samples
    Sampled,
    /// Least squares, matrix from the areas
    Analytic,
    /// Least squares that no vertex can spoil
    Ours,
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Point => Self::PointSample,
            MethodName::Average => Self::Average,
            MethodName::Sampled => Self::LeastSquares { mass: Mass::Sampled },
            MethodName::Analytic => Self::LeastSquares { mass: Mass::Analytic },
            MethodName::Ours => Self::Ours,
        }
    }
}

/// A scene that is ready to be sampled.
struct Ready<'a> {
    surface: &'a Surface<'a>,
    tracer: &'a Tracer<'a>,
    signal: &'a dyn Signal,
    plan: &'a Plan,
    batches: u16,
}

impl Sampling {
    fn with<R>(
        &self,
        clock: &mut Clock<'_>,
        work: impl FnOnce(Ready<'_>, &mut Clock<'_>) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        clock.stage("read")?;
        let signals = Signals(vec![self.signal.clone()]);
        let light = LightOptions { moving: Moving::Keep, ..LightOptions::default() };
        let scenery = Scenery::read(&self.file, self.scene, &signals, &light)?;
        let surface = scenery.surface(&lightkiln_bake::file_name(&self.file), &light)?;
        let options = BakeOptions {
            quality: self.quality.map_or_else(Default::default, Into::into),
            samples: self.samples,
            detail: self.detail,
            ao_distance: self.ao_distance,
            seed: self.seed,
            ..BakeOptions::default()
        };
        let plan = Plan::new(&options, &surface.mesh)?;
        let tracer = Tracer::new(surface.casters(), &surface).map_err(BakeError::from)?;
        surface.turn_hidden_sheets(&tracer, plan.ao_distance, &scenery.lighting);
        let signal = self.signal.on(&plan.stage(&surface, &tracer, &scenery.lighting))?;
        // Where nothing is traced, one look is enough.
        let batches =
            if self.signal.is_traced() { self.rays.div_ceil(signal.rays_per_batch()) as u16 } else { 1 };
        let ready = Ready { surface: &surface, tracer: &tracer, signal: &*signal, plan: &plan, batches };
        work(ready, clock)
    }
}

/// Runs `compare`.
///
/// # Errors
/// A file that cannot be read, options out of range.
pub fn run_compare(arguments: &Compare) -> Result<Exit, Failure> {
    let sampling = &arguments.sampling;
    use_threads(&sampling.common)?;
    if !(arguments.alpha.is_finite() && arguments.alpha >= 0.0) {
        let what = format!("--alpha is {}, but must be at least 0", arguments.alpha);
        return Err(Failure::new(Exit::Usage, what));
    }
    let stages = Stages::new(sampling.common.quiet);
    let comparison = sampling.with(&mut Clock::new(&stages), |ready, clock| {
        let Ready { surface, signal, plan, batches, .. } = ready;
        let options = CompareOptions {
            traced: sampling.signal.is_traced(),
            batches,
            alpha: arguments.alpha,
            bounds: sampling.bounds.into(),
        };
        Ok(compare(surface, signal, plan, options, clock)?)
    });
    stages.finish();
    let comparison = comparison?;
    if sampling.common.json {
        return print(&json(&comparison)?);
    }
    print(&comparison_text(&lightkiln_bake::file_name(&sampling.file), &comparison))
}

/// Runs `fit`.
///
/// # Errors
/// A file that cannot be read or written, options out of range.
pub fn run_fit(arguments: &Fit) -> Result<Exit, Failure> {
    let sampling = &arguments.sampling;
    use_threads(&sampling.common)?;
    let view = View::parse(&arguments.view)
        .ok_or_else(|| Failure::new(Exit::Usage, format!("{:?} is no view", arguments.view)))?;
    if !(arguments.zoom.is_finite() && arguments.zoom > 0.0) {
        return Err(Failure::new(Exit::Usage, format!("--zoom is {}, but must be above 0", arguments.zoom)));
    }
    let stages = Stages::new(sampling.common.quiet);
    let rows = sampling.with(&mut Clock::new(&stages), |ready, clock| {
        let Ready { surface, signal, plan, batches, .. } = ready;
        let gathered = Gathered::new(surface, signal, plan, batches, clock)?;
        let (range, outside) = (signal.range(), sampling.bounds.into());
        let tried = try_all(surface, &gathered, range, outside, &arguments.ways(), clock)?;
        if let Some(output) = &arguments.output {
            clock.stage("render")?;
            write_pictures(arguments, view, &ready, &tried, output)?;
        }
        Ok(tried.into_iter().map(|t| t.row).collect::<Vec<_>>())
    });
    stages.finish();
    let rows = rows?;
    if sampling.common.json {
        return print(&json(&rows)?);
    }
    print(&rows_text(&rows, sampling.bounds.into()))
}

impl Fit {
    /// Every combination that makes a difference.
    fn ways(&self) -> Vec<Way> {
        let mut ways = Vec::new();
        for &method in &self.method {
            let plain = Way::plain(method.into());
            if !plain.is_smoothed() {
                ways.push(plain);
                continue;
            }
            for &regularizer in &self.regularizer {
                let of = |&alpha: &f32| Way { regularizer: regularizer.into(), alpha, ..plain };
                ways.extend(self.sweep.0.iter().map(of));
            }
        }
        ways
    }
}

fn write_pictures(
    arguments: &Fit,
    view: View,
    ready: &Ready<'_>,
    tried: &[Tried],
    output: &Path,
) -> Result<(), Failure> {
    let Ready { surface, tracer, signal, batches, .. } = *ready;
    let channels = signal.channels();
    let size = [arguments.size as usize; 2];
    let lens = [LONG_LENS; 2];
    let camera = framing(&surface.mesh, arguments.target, view, lens, arguments.zoom);
    let shot = |color: &(dyn Fn(&Hit) -> Vec3 + Sync)| {
        let subject = Subject { tracer, surfaces: surface, color: &covering(|hit, _| color(hit)) };
        render(&subject, &camera, size, Smoothing::Everywhere).over(BACKGROUND)
    };
    let mut pictures: Vec<(String, Picture)> = tried
        .iter()
        .map(|t| {
            let shown = shot(&|hit| {
                let corners = surface.mesh.triangles[hit.triangle.index()];
                let weights = point(hit).weights();
                let value = |c: usize| {
                    corners.iter().zip(weights).map(|(v, w)| w * t.values[v.index() * channels + c]).sum()
                };
                color(channels, value)
            });
            (picture_name(&t.way), shown)
        })
        .collect();
    let truth = shot(&|hit| {
        let bits = hit.barycentric.map(|b| u64::from(b.to_bits()));
        let key = random::hash(PICTURE_SEED, u64::from(hit.triangle.0), bits[0], bits[1]);
        let mut sums = vec![0.0; channels];
        let mut out = vec![0.0; channels];
        let batches = u32::from(batches);
        for batch in 0..batches {
            signal.batch(point(hit), key, batch, &mut out);
            sums.iter_mut().zip(&out).for_each(|(sum, value)| *sum += value / batches as f32);
        }
        color(channels, |c| sums[c])
    });
    pictures.push(("truth".into(), truth));
    let write = |path: &Path, picture: &Picture| {
        let png = picture.to_png().map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
        write_whole(path, &png)
    };
    if output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        let panel = |(caption, picture)| Panel { picture, caption, legend: None };
        let row: Vec<Panel> = pictures.into_iter().map(panel).collect();
        return write(output, &sheet(&row, row.len()));
    }
    std::fs::create_dir_all(output).map_err(|e| Failure::writing(output, &e))?;
    pictures.iter().try_for_each(|(name, picture)| write(&output.join(format!("{name}.png")), picture))
}

fn picture_name(way: &Way) -> String {
    let name = way.name().replace(", ", "-").replace(' ', "-");
    if way.is_smoothed() { format!("{name}-{}", way.alpha) } else { name }
}

/// One or three channels as a color.
fn color(channels: usize, value: impl Fn(usize) -> f32) -> Vec3 {
    if channels == 3 { Vec3::new(value(0), value(1), value(2)) } else { Vec3::splat(value(0)) }
}

fn point(hit: &Hit) -> SurfacePoint {
    SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric }
}

/// Pictures have noise of their own.
const PICTURE_SEED: u64 = 0x9ec7;

fn json(value: &impl serde::Serialize) -> Result<String, Failure> {
    let mut text =
        serde_json::to_string_pretty(value).map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
    text.push('\n');
    Ok(text)
}

fn comparison_text(file: &str, c: &Comparison) -> String {
    let mut text = format!(
        "{file}: {} vertices, {} triangles, {} samples of {} rays, {} of them hidden\n\n",
        c.vertices, c.triangles, c.samples, c.rays_per_sample, c.hidden_samples
    );
    let _ = writeln!(
        text,
        "{:>8} {:>8} {:>8} {:>8}  {:>8} {:>8} {:>8}",
        "E point", "E avg", "E ours", "E lsqr", "rays", "solve", "memory"
    );
    let _ = writeln!(
        text,
        "{:>8.3} {:>8.3} {:>8.3} {:>8.3}  {:>6.1} s {:>6.2} s {:>8}",
        c.error_point,
        c.error_average,
        c.error_ours,
        c.error_least_squares,
        c.ray_seconds,
        c.solve_seconds,
        bytes_text(c.solve_memory_bytes as u64)
    );
    let _ = writeln!(
        text,
        "ours with alpha {}, least squares with 0; noise of the samples makes {:.4} of each E\n",
        c.alpha, c.noise
    );
    text + &rows_text(&c.rows, c.bounds)
}

fn rows_text(rows: &[Row], outside: Outside) -> String {
    let mut text = format!(
        "{:<24} {:>7} {:>9} {:>9} {:>9} {:>8} {:>7} {:>9} {:>10} {:>8} {:>9} {:>8} {:>8}\n",
        "method",
        "alpha",
        "E",
        "noise",
        "E fresh",
        "contrast",
        "jumps",
        "seconds",
        "memory",
        "outside",
        "",
        "by most",
        "by mean"
    );
    for row in rows {
        let _ = writeln!(
            text,
            "{:<24} {:>7} {:>9.4} {:>9.4} {:>9.4} {:>8.4} {:>7.4} {:>9.3} {:>10} {:>8} {:>7.2} % {:>8.4} {:>8.4}",
            row.method,
            row.alpha,
            row.error,
            row.noise,
            row.fresh,
            row.contrast,
            row.gradient_jump,
            row.seconds,
            bytes_text(row.memory_bytes as u64),
            row.outside.count,
            row.outside.share * 100.0,
            row.outside.largest,
            row.outside.mean
        );
    }
    let _ = writeln!(
        text,
        "E: 100 times the mean squared difference to the samples, noise included; E fresh: to points that no fit saw, \
         without their noise\noutside: values outside the signal's range as fitted, and how far; {}",
        match outside {
            Outside::None => "they stay",
            Outside::Clamp => "then they were clamped",
            Outside::ClampAfter => "E is that of clamping after interpolation",
            Outside::Optimum => "then the best values within the range were taken",
        }
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweep_reads_a_list_of_alphas() {
        assert_eq!("alpha=0,0.01, 1".parse(), Ok(Sweep(vec![0.0, 0.01, 1.0])));
        assert!("beta=1".parse::<Sweep>().is_err());
        assert!("alpha=1,-1".parse::<Sweep>().is_err());
        assert!("alpha=".parse::<Sweep>().is_err());
    }
}
