//! The command `view`, and the report as a page: what crates/page shows, gathered from files.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::Vec3;
use lightkiln_bake::file_light::{Extension, LayerInfo};
use lightkiln_bake::stored::Encoding;
use lightkiln_bake::{BakeError, Clock, Silent};
use lightkiln_encode::LightCode;
use lightkiln_light::Scale;
use lightkiln_page::{Figure, LayerModel, Model, Server, Site, report_page};
use lightkiln_render::picture::BACKGROUND;
use lightkiln_report::{Report, bytes_text};
use lightkiln_scene::{LayerRead, ReadOptions, Scene};
use lightkiln_texel::read_png;
use serde_json::{Map, Value, json};

use crate::arguments::Common;
use crate::commands::{print, use_threads};
use crate::files::write_whole;
use crate::messages::{Exit, Failure};
use crate::progress::Stages;
use crate::shaded::Exposure;
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
    /// Trace the light again: a map of errors at about so many points, and vertices alone by least squares
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
    let site = Site::new(&model?);
    if let Some(folder) = &arguments.export {
        site.export(folder).map_err(|error| Failure::writing(folder, &error))?;
        return Ok(Exit::Done);
    }
    let serving = |error: std::io::Error| {
        Failure::new(Exit::Files, format!("cannot serve on port {} of 127.0.0.1: {error}", arguments.port))
            .remedy("leave --port away for a free one")
    };
    let server = Server::bind(site, arguments.port).map_err(serving)?;
    let address = server.address().map_err(serving)?;
    print(&format!("http://{address}/\n"))?;
    server.run().map_err(serving)?;
    Ok(Exit::Done)
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
    clock.stage("read");
    let options = ReadOptions { scene: arguments.scene, surfaces: true, ..ReadOptions::default() };
    let scene = Scene::read(&arguments.file, &options).map_err(BakeError::from)?;
    let mut gathered = gather(&scene, &lightkiln_bake::file_name(&arguments.file))?;
    let report = arguments.report.as_deref().map(read_report).transpose()?;
    gathered.model.figures = match &report {
        Some(report) => report_figures(report),
        None => file_figures(&arguments.file)?,
    };
    if let Some(points) = arguments.trace {
        let look = look(&arguments.file, arguments.scene, &[ModeName::Error]);
        in_studio(&look, clock, |studio, clock| trace(studio, points as usize, &mut gathered, clock))?;
    }
    Ok(gathered.model)
}

fn read_report(path: &Path) -> Result<Report, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::reading(path, &error))?;
    serde_json::from_str(&text).map_err(|error| {
        Failure::new(Exit::Input, format!("this is no report of a bake: {error}"))
            .place(path.display().to_string())
            .remedy("name the file of lightkiln bake --report R.json")
    })
}

/// A model, and where its vertices come from.
struct Gathered {
    model: Model,
    /// First vertex of each part.
    firsts: Vec<u32>,
}

/// Coverage below which a triangle counts as glass, which the page looks through.
const THIN: f32 = 0.25;

/// Places at which a corner's color and coverage are looked up: weights of this and the other two corners.
const NEAR: [[f32; 3]; 4] = [[0.8, 0.1, 0.1], [0.6, 0.2, 0.2], [0.6, 0.35, 0.05], [0.6, 0.05, 0.35]];

fn gather(scene: &Scene, file: &str) -> Result<Gathered, Failure> {
    let lightmap = scene.read_lightmap().map_err(BakeError::from)?;
    let Some(lightmap) = lightmap else { return Err(BakeError::NotBaked { file: file.to_owned() }.into()) };
    let extension: Extension = serde_json::from_value(lightmap.extension.clone())
        .map_err(|e| BakeError::ReadBack { what: format!("the extension of {file}: {e}") })?;
    let coordinates = extension.coordinates();
    let fallback = scene.read_fallback().map_err(BakeError::from)?;
    let has_fallback = fallback.iter().any(|part| !part.is_empty());
    let mut model = Model {
        name: file.to_owned(),
        page_size: extension.page_size.unwrap_or_default(),
        texel_size: extension.texel_size,
        max_error: extension.max_error,
        layers: lightmap.layers.iter().map(layer).collect::<Result<_, _>>()?,
        ..Model::default()
    };
    let mut firsts = Vec::new();
    for (number, part) in scene.parts.iter().enumerate() {
        let first = model.positions.len() as u32;
        firsts.push(first);
        model.part_names.push(scene.part_name(number));
        model.positions.extend(part.positions.iter().map(|p| p.to_array()));
        model.normals.extend(part.normals.iter().map(|n| n.to_array()));
        model.parts.resize(model.positions.len(), number as u32);
        let count = part.positions.len();
        let mut colors = vec![(Vec3::ZERO, 0.0_f32); count];
        for (triangle, corners) in part.triangles.iter().enumerate() {
            let mut coverage = 0.0;
            for (corner, &vertex) in corners.iter().enumerate() {
                for near in NEAR {
                    // Weights of the triangle's second and third corner.
                    let weights = [1, 2].map(|k| near[(k + 3 - corner) % 3]);
                    let color = Vec3::from(scene.triangle_albedo(number, triangle, weights));
                    let (sum, points) = &mut colors[vertex as usize];
                    (*sum, *points) = (*sum + color, *points + 1.0);
                    coverage += scene.triangle_opacity(number, triangle, weights) / (3 * NEAR.len()) as f32;
                }
            }
            let flags = scene.triangle_flags(number, triangle);
            if coverage >= THIN || !flags.translucent {
                let list = if flags.double_sided { &mut model.double_sided } else { &mut model.single_sided };
                list.push(corners.map(|v| v + first));
            }
        }
        model.base_colors.extend(colors.iter().map(|(sum, points)| (*sum / points.max(1.0)).to_array()));
        for (layer, read) in model.layers.iter_mut().zip(&lightmap.layers) {
            // Parts without light are as bright as white.
            let white = if layer.white > 0.0 { (1.0 - layer.scale[0]) / layer.scale[1] } else { 1.0 };
            layer.codes.resize(layer.codes.len() + count, LightCode::color_of(&vec![white; layer.channels]));
            let own = &mut layer.codes[first as usize..];
            let light = extension.corners(read, number).ok_or_else(|| BakeError::ReadBack {
                what: format!("part {number} of {file} has coordinates that stand for no light"),
            })?;
            for (corners, codes) in part.triangles.iter().zip(light.iter()) {
                corners.iter().zip(codes).for_each(|(&v, &value)| {
                    own[v as usize] = coordinates.map_or(LightCode(value), |c| c.code(value));
                });
            }
        }
        if has_fallback {
            model.fallback.resize(model.positions.len(), [1.0; 3]);
            for (corners, values) in part.triangles.iter().zip(&fallback[number]) {
                corners.iter().zip(values).for_each(|(&v, &x)| model.fallback[(v + first) as usize] = x);
            }
        }
    }
    Ok(Gathered { model, firsts })
}

/// A layer with its images, still without codes.
fn layer(read: &LayerRead) -> Result<LayerModel, Failure> {
    let info: LayerInfo = serde_json::from_value(Value::Object(read.info.clone()))
        .map_err(|e| BakeError::ReadBack { what: format!("a layer: {e}") })?;
    let [low, high] = info.range;
    let white = if info.curve == "log" { info.white.unwrap_or(1.0) } else { 0.0 };
    let scale = if white > 0.0 { Scale::log(white, low, high) } else { Scale::linear(low, high) };
    let encoding = info
        .encoding(scale)
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
        channels: info.channels,
        range: info.range,
        white,
        scale: [scale.perceived(low), scale.perceived(high) - scale.perceived(low), white],
        clamp: info.clamp,
        bits,
        pages: pages.into_iter().map(|page| page.values.into_iter().map(unit).collect()).collect(),
        table: table.map(|table| table.values),
        signal: info.signal,
        curve: info.curve,
        unit: info.unit,
        ..LayerModel::default()
    })
}

/// Vertices alone never take more samples than about this.
const VERTEX_SAMPLES: usize = 250_000;

/// Adds what takes rays: errors at points, and vertex values alone.
fn trace(
    studio: &Studio<'_>,
    points: usize,
    gathered: &mut Gathered,
    clock: &mut Clock<'_>,
) -> Result<(), Failure> {
    let mesh = &studio.surface.mesh;
    let model = &mut gathered.model;
    model.errors = studio.errors(points, clock);
    let area: f64 = mesh.triangle_ids().map(|t| mesh.area(t)).sum();
    model.area_per_error = (area / points.max(1) as f64) as f32;
    let radius = model.texel_size.max(lightkiln_sample::radius_for(mesh, VERTEX_SAMPLES));
    let values = studio.least_squares(radius, clock)?;
    let channels = studio.layers.channels();
    for (layer, baked) in model.layers.iter_mut().zip(&studio.layers.layers) {
        layer.vertex_codes = layer.codes.clone();
        for (number, part) in studio.surface.scene.parts.iter().enumerate() {
            let ids = studio.surface.triangles_of_part(number);
            for (id, corners) in ids.zip(&part.triangles) {
                for (light, own) in mesh.triangles[id.index()].iter().zip(corners) {
                    let at = light.index() * channels;
                    let value = LightCode::color_of(&values[at..at + channels][baked.channels()]);
                    layer.vertex_codes[(gathered.firsts[number] + own) as usize] = value;
                }
            }
        }
    }
    Ok(())
}

/// Bytes and errors of a report, as lines of two words each.
fn report_figures(report: &Report) -> Map<String, Value> {
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
    Map::from_iter([("lines".to_owned(), json!(lines))])
}

/// What the file alone tells.
fn file_figures(file: &Path) -> Result<Map<String, Value>, Failure> {
    let inspection = lightkiln_bake::inspect::inspect(file)?;
    let mut lines = Vec::new();
    if let Some(light) = &inspection.light {
        lines.push(["light on the GPU".to_owned(), bytes_text(light.total())]);
        lines.push(["of it texels".to_owned(), bytes_text(light.atlas + light.mips)]);
    }
    lines.push(["the file".to_owned(), bytes_text(inspection.file_bytes)]);
    Ok(Map::from_iter([("lines".to_owned(), json!(lines))]))
}
