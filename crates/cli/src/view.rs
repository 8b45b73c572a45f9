//! The command `view`, and the report as a page: what crates/page shows, gathered from files.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use clap::Args;
use lightkiln_bake::file_light::{Extension, LayerInfo};
use lightkiln_bake::stored::Encoding;
use lightkiln_bake::{BakeError, Clock, Silent};
use lightkiln_encode::LightCode;
use lightkiln_mesh::{TriangleId, VertexId};
use lightkiln_page::{ErrorPoint, Figure, FullTexture, LayerModel, Live, Model, Server, Site, report_page};
use lightkiln_render::picture::BACKGROUND;
use lightkiln_report::{ErrorSummary, Report, bytes_text};
use lightkiln_scene::{LayerRead, ReadOptions, Scene};
use lightkiln_texel::read_png;
use serde_json::{Map, Value, json};

use crate::arguments::Common;
use crate::commands::{print, use_threads};
use crate::files::write_whole;
use crate::messages::{Exit, Failure};
use crate::progress::Stages;
use crate::shaded::Exposure;
use crate::shape::{CodeSet, Shape, layer, scale, unlit};
use crate::stations::Stations;
use crate::studio::{Look, ModeName, Studio, Values, in_studio};

/// Arguments of `view`.
#[derive(Args)]
pub struct View {
    /// A baked .gltf or .glb file
    pub file: PathBuf,
    /// Port of 127.0.0.1 [default: any that is free]
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Write the page into this folder as a static site, and stop
    #[arg(long, value_name = "DIR")]
    pub export: Option<PathBuf>,
    /// The report of the bake, as JSON: its bytes and errors stand in a corner
    #[arg(long, value_name = "R.json")]
    pub report: Option<PathBuf>,
    /// Trace the light again: a map of errors at about so many points, vertices alone by least squares, and a full
    /// lightmap
    #[arg(long, value_name = "POINTS", num_args = 0..=1, default_missing_value = "100000",
          value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub trace: Option<u32>,
    /// Which scene of the file [default: the file's default scene]
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    #[command(flatten)]
    pub common: Common,
}

/// Rays at a point of the map of errors, and at a pixel of the error's picture: noise of about 0.02 and less.
const ERROR_RAYS: u32 = 512;

/// Serves the page, or writes it.
///
/// # Errors
/// A file that cannot be read, that is not baked, a port that is taken, a folder that cannot be written.
pub fn run(arguments: &View) -> Result<Exit, Failure> {
    use_threads(&arguments.common)?;
    let stages = Stages::new(arguments.common.quiet);
    let mut clock = Clock::new(&stages);
    let model = read(arguments, &mut clock);
    stages.finish();
    let model = model?;
    if let Some(folder) = &arguments.export {
        Site::for_export(&model).export(folder).map_err(|error| Failure::writing(folder, &error))?;
        return Ok(Exit::Done);
    }
    let server = serve(Live::still(Site::new(&model)).into(), arguments.port, "--port")?;
    let address = address_of(&server)?;
    print(&format!("{address}\n"))?;
    open_in_browser(&address);
    server.run().map_err(|error| not_serving(&error, arguments.port, "--port"))?;
    Ok(Exit::Done)
}

fn not_serving(error: &std::io::Error, port: u16, option: &str) -> Failure {
    Failure::new(Exit::Files, format!("cannot serve on port {port} of 127.0.0.1: {error}"))
        .remedy(format!("leave {option} away for a free one"))
}

/// A server that has its port.
///
/// - `option`: which names the port
///
/// # Errors
/// A port that is taken.
pub fn serve(live: Arc<Live>, port: u16, option: &str) -> Result<Server, Failure> {
    Server::bind(live, port).map_err(|error| not_serving(&error, port, option))
}

/// Where a server is to be found.
///
/// # Errors
/// What the system says.
pub fn address_of(server: &Server) -> Result<String, Failure> {
    let address = server.address().map_err(|error| not_serving(&error, 0, "the port"))?;
    Ok(format!("http://{address}/"))
}

/// Opens a page where somebody sits at a screen; in scripts, and where no browser is known, nothing happens.
pub fn open_in_browser(address: &str) {
    let has_screen = !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if !has_screen || !std::io::stderr().is_terminal() {
        return;
    }
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let quiet = Stdio::null;
    let mut browser = Command::new(program);
    browser.arg(address).stdin(quiet()).stdout(quiet()).stderr(quiet());
    // The address is printed as well: whoever has no such program opens it by hand.
    std::thread::spawn(move || browser.status());
}

/// Writes a report: as a page with pictures of the baked file for a name in `.html`, else as JSON.
///
/// # Errors
/// A file that cannot be written, or a baked file that cannot be read.
pub fn write_report(path: &Path, report: &Report, baked: &Path, scene: Option<usize>) -> Result<(), Failure> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if !matches!(ending.as_deref(), Some("html" | "htm")) {
        return write_whole(path, report.to_json().as_bytes());
    }
    let mut clock = Clock::new(&Silent);
    let figures = in_studio(&look(baked, scene, &FIGURE_MODES), &mut clock, figures)?;
    write_whole(path, report_page(report, &figures).as_bytes())
}

fn look<'a>(file: &'a Path, scene: Option<usize>, modes: &'a [ModeName]) -> Look<'a> {
    let (layer, rays, values, exposure) = (0, ERROR_RAYS, Values::Screen, Exposure::default());
    Look { file, scene, layer, rays, values, exposure, modes }
}

/// Width of a report's pictures in pixels.
const FIGURE: usize = 480;

/// Layers whose light a report shows.
const SHOWN_LAYERS: usize = 4;

/// What these are made of.
const FIGURE_MODES: [ModeName; 5] =
    [ModeName::Shaded, ModeName::Light, ModeName::Classes, ModeName::Charts, ModeName::Error];

/// The pictures of a report.
fn figures(studio: &mut Studio<'_>, clock: &mut Clock<'_>) -> Result<Vec<Figure>, Failure> {
    let shaded = "Materials in the light of the file, as docs/RENDER.md says.";
    let mut figures = vec![figure(studio, ModeName::Shaded, "Shaded", shaded, clock)?];
    for layer in 0..studio.layers.layers.len().min(SHOWN_LAYERS) {
        studio.layer = layer;
        let name = studio.layers.layers[layer].layer.name.clone();
        let caption = format!("{name}, as the file shows it.");
        figures.push(figure(studio, ModeName::Light, "The light", &caption, clock)?);
    }
    studio.layer = 0;
    let classes = "Red shows the atlas, gray vertex values, yellow blends from one to the other.";
    figures.push(figure(studio, ModeName::Classes, "Classes", classes, clock)?);
    let charts = "Texture triangles by their place in the atlas, in squares of 2 × 2 texels.";
    figures.push(figure(studio, ModeName::Charts, "Charts", charts, clock)?);
    let error = format!(
        "Ten times what is too bright (red) or too dark (blue), against {ERROR_RAYS} rays a pixel, whose noise is in it."
    );
    figures.push(figure(studio, ModeName::Error, "Error", &error, clock)?);
    Ok(figures)
}

fn figure(
    studio: &Studio<'_>,
    mode: ModeName,
    title: &str,
    caption: &str,
    clock: &mut Clock<'_>,
) -> Result<Figure, Failure> {
    // The whole scene from the usual side. Each pixel of an error takes many rays.
    let size = if mode == ModeName::Error { FIGURE / 2 } else { FIGURE };
    let stations = Stations::usual(size);
    let shots = stations.shots(studio.surface.scene, None, &studio.surface.mesh)?;
    let picture = studio.pictures(mode, &shots, clock)?.swap_remove(0).over(BACKGROUND);
    let png = picture.to_png().map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
    Ok(Figure { title: title.to_owned(), caption: caption.to_owned(), png })
}

/// Everything that the page shows.
fn read(arguments: &View, clock: &mut Clock<'_>) -> Result<Model, Failure> {
    clock.stage("read")?;
    let options = ReadOptions { scene: arguments.scene, ..ReadOptions::default() };
    let scene = Scene::read(&arguments.file, &options).map_err(BakeError::from)?;
    let mut gathered = gather(&scene, &lightkiln_bake::file_name(&arguments.file))?;
    let report = arguments.report.as_deref().map(read_report).transpose()?;
    let mut lines = match &report {
        Some(report) => report_lines(report),
        None => file_lines(&arguments.file)?,
    };
    if let Some(points) = arguments.trace {
        let look = look(&arguments.file, arguments.scene, &[ModeName::Error]);
        in_studio(&look, clock, |studio, clock| trace(studio, points as usize, &mut gathered, clock))?;
        if report.is_none() {
            lines.extend(traced_lines(&gathered.rest.errors));
        }
    }
    gathered.rest.figures = figures_of(lines);
    Ok(gathered.model())
}

fn read_report(path: &Path) -> Result<Report, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::reading(path, &error))?;
    serde_json::from_str(&text).map_err(|error| {
        Failure::new(Exit::Input, format!("this is no report of a bake: {error}"))
            .place(path.display().to_string())
            .remedy("name the file of lightkiln bake --report R.json")
    })
}

/// What the page shows of a baked file, before it is one model.
struct Gathered {
    shape: Shape,
    /// Without codes.
    layers: Vec<LayerModel>,
    /// One set of codes a layer, as the file has them.
    codes: Vec<CodeSet>,
    /// Of vertices alone, and of texels everywhere: one a layer each, once they are traced.
    traced: Vec<CodeSet>,
    fallback: Vec<Vec<[[f32; 3]; 3]>>,
    /// What is traced or read beside the light, in a model of nothing else.
    rest: Model,
}

impl Gathered {
    fn model(mut self) -> Model {
        let count = self.layers.len();
        self.codes.append(&mut self.traced);
        let (model, codes) = self.shape.lit(&self.codes, &self.fallback);
        for (number, codes) in codes.into_iter().enumerate() {
            let layer = &mut self.layers[number % count];
            match (number / count, &mut layer.full) {
                (0, _) => layer.codes = codes,
                (1, _) => layer.vertex_codes = codes,
                (_, Some(full)) => full.codes = codes,
                (_, None) => {}
            }
        }
        let Model { page_size, full_size, texel_size, max_error, errors, area_per_error, figures, .. } =
            self.rest;
        let layers = self.layers;
        Model {
            layers,
            page_size,
            full_size,
            texel_size,
            max_error,
            errors,
            area_per_error,
            figures,
            ..model
        }
    }
}

fn gather(scene: &Scene, file: &str) -> Result<Gathered, Failure> {
    let lightmap = scene.read_lightmap().map_err(BakeError::from)?;
    let Some(lightmap) = lightmap else { return Err(BakeError::NotBaked { file: file.to_owned() }.into()) };
    let extension: Extension = serde_json::from_value(lightmap.extension.clone())
        .map_err(|e| BakeError::ReadBack { what: format!("the extension of {file}: {e}") })?;
    let layers: Vec<LayerModel> = lightmap.layers.iter().map(read_layer).collect::<Result<_, _>>()?;
    let coordinates = extension.coordinates();
    let code = |value| coordinates.map_or(LightCode(value), |c| c.code(value));
    let part = |read: &LayerRead, number: usize| -> Result<Vec<[LightCode; 3]>, BakeError> {
        let light = extension.corners(read, number).ok_or_else(|| BakeError::ReadBack {
            what: format!("part {number} of {file} has coordinates that stand for no light"),
        })?;
        Ok(light.iter().map(|corners| corners.map(code)).collect())
    };
    let codes_of = |(read, layer): (&LayerRead, &LayerModel)| -> Result<CodeSet, BakeError> {
        let parts = (0..scene.parts.len()).map(|number| part(read, number)).collect::<Result<_, _>>()?;
        Ok(CodeSet { parts, unlit: unlit(layer) })
    };
    Ok(Gathered {
        shape: Shape::new(scene, file)?,
        codes: lightmap.layers.iter().zip(&layers).map(codes_of).collect::<Result<_, _>>()?,
        traced: Vec::new(),
        fallback: scene.read_fallback().map_err(BakeError::from)?,
        rest: Model {
            page_size: extension.page_size.unwrap_or_default(),
            texel_size: extension.texel_size,
            max_error: extension.max_error,
            ..Model::default()
        },
        layers,
    })
}

/// A layer with its images, still without codes.
fn read_layer(read: &LayerRead) -> Result<LayerModel, Failure> {
    let info: LayerInfo = serde_json::from_value(Value::Object(read.info.clone()))
        .map_err(|e| BakeError::ReadBack { what: format!("a layer: {e}") })?;
    let encoding = info
        .encoding(scale(&info))
        .ok_or_else(|| BakeError::ReadBack { what: format!("the layer {} has no encoding", info.signal) })?;
    let pages: Vec<_> = read
        .pages
        .iter()
        .map(|page| read_png(&page.png))
        .collect::<Result<_, _>>()
        .map_err(BakeError::from)?;
    // The page's shader knows unit values alone; light in sRGB has finer steps in the dark than 8 bits of these.
    let bits = if encoding == Encoding::Unit { pages.first().map_or(8, |page| page.bits) } else { 16 };
    let unit = |number: f32| encoding.unit(encoding.from_image(number));
    let table = read.table.as_ref().map(|table| read_png(&table.png)).transpose().map_err(BakeError::from)?;
    Ok(LayerModel {
        bits,
        pages: pages.into_iter().map(|page| page.values.into_iter().map(unit).collect()).collect(),
        table: table.map(|table| table.values),
        ..layer(info)
    })
}

/// Vertices alone and texels everywhere never take more samples or texels than about this.
const MOST_SAMPLES: usize = 250_000;

/// Adds what takes rays: errors at points, vertex values alone, and a lightmap over everything.
fn trace(
    studio: &Studio<'_>,
    points: usize,
    gathered: &mut Gathered,
    clock: &mut Clock<'_>,
) -> Result<(), Failure> {
    let (surface, layers) = (studio.surface, &studio.layers.layers);
    let mesh = &surface.mesh;
    let rest = &mut gathered.rest;
    rest.errors = studio.errors(points, clock)?;
    let area: f64 = mesh.triangle_ids().map(|t| mesh.area(t)).sum();
    rest.area_per_error = (area / points.max(1) as f64) as f32;
    let radius = rest.texel_size.max(lightkiln_sample::radius_for(mesh, MOST_SAMPLES));
    let values = studio.least_squares(radius, clock)?;
    let full = studio.full_texture(&values, radius, clock)?;
    rest.full_size = full.stored.size;
    let channels = studio.layers.channels();
    for (own, baked) in gathered.layers.iter().zip(layers) {
        let of_vertex = |v: VertexId| LightCode::color_of(&values[v.index() * channels..][baked.channels()]);
        let codes = |t: TriangleId| mesh.triangles[t.index()].map(of_vertex);
        gathered.traced.push(CodeSet::of(surface, unlit(own), codes));
    }
    for (number, own) in gathered.layers.iter_mut().enumerate() {
        let codes = |t: TriangleId| full.codes[number].of_triangle(mesh, t);
        gathered.traced.push(CodeSet::of(surface, unlit(own), codes));
        let pages = full.stored.layers[number].pages.clone();
        own.full = Some(FullTexture { pages, ..FullTexture::default() });
    }
    Ok(())
}

/// The page of a file that a bake has just written, with the figures of its report.
///
/// # Errors
/// A file that cannot be read.
pub fn baked_model(file: &Path, scene: Option<usize>, report: &Report) -> Result<Model, Failure> {
    let options = ReadOptions { scene, ..ReadOptions::default() };
    let scene = Scene::read(file, &options).map_err(BakeError::from)?;
    let mut gathered = gather(&scene, &lightkiln_bake::file_name(file))?;
    gathered.rest.figures = figures_of(report_lines(report));
    Ok(gathered.model())
}

/// What the corner shows: a label and a value a line.
type Lines = Vec<[String; 2]>;

fn figures_of(lines: Lines) -> Map<String, Value> {
    Map::from_iter([("lines".to_owned(), json!(lines))])
}

/// Errors at traced points, whose noise is in them.
fn traced_lines(errors: &[ErrorPoint]) -> Lines {
    let summary = ErrorSummary::new(errors.iter().map(|point| (point.error, 0.0)));
    let of = |label: &str, value: f32| [label.to_owned(), format!("{value:.4}")];
    vec![of("RMSE, traced", summary.rmse), of("99 % below", summary.p99), of("largest error", summary.max)]
}

/// Bytes and errors of a report.
fn report_lines(report: &Report) -> Lines {
    let (bytes, errors) = (&report.bytes, &report.errors);
    let mut lines = vec![
        ["light on the GPU".to_owned(), bytes_text(bytes.total)],
        ["of it texels".to_owned(), bytes_text(bytes.light.atlas + bytes.light.mips)],
        ["one full lightmap".to_owned(), bytes_text(bytes.full_lightmap.bytes.total())],
        ["RMSE".to_owned(), format!("{:.4}", errors.hybrid.rmse)],
        ["99 % below".to_owned(), format!("{:.4}", errors.hybrid.p99)],
        ["largest error".to_owned(), format!("{:.4}", errors.hybrid.max)],
    ];
    if let Some(vertices) = &errors.least_squares {
        lines.push(["RMSE of vertices alone".to_owned(), format!("{:.4}", vertices.rmse)]);
    }
    lines
}

/// What the file alone tells.
fn file_lines(file: &Path) -> Result<Lines, Failure> {
    let inspection = lightkiln_bake::inspect::inspect(file)?;
    let mut lines = Vec::new();
    if let Some(light) = &inspection.light {
        lines.push(["light on the GPU".to_owned(), bytes_text(light.total())]);
        lines.push(["of it texels".to_owned(), bytes_text(light.atlas + light.mips)]);
    }
    lines.push(["the file".to_owned(), bytes_text(inspection.file_bytes)]);
    Ok(lines)
}
