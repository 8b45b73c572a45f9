//! Codes and texels to the file.

use std::io::Write;
use std::path::{Path, PathBuf};

use lightkiln_encode::{AtlasView, Codes, Table};
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_scene::{BakedLight, ExtensionInfo, LayerFiles, PartLight};
use lightkiln_texel::{ExrDepth, PngDepth, write_exr, write_png};
use rayon::prelude::*;

use crate::clock::Clock;
use crate::file_light::{Extension, LayerInfo, Recipe};
use crate::layers::{BakedLayer, Layers};
use crate::options::{BakeOptions, Plan};
use crate::rounds::Shown;
use crate::stored::StoredLayer;
use crate::{BakeError, Surface};

/// What was written.
pub struct Written {
    /// The scene file.
    pub scene: PathBuf,
    /// Every file.
    pub outputs: Vec<PathBuf>,
    /// Which scene of the file was baked.
    pub scene_number: Option<usize>,
    /// What the writer says.
    pub file: lightkiln_scene::Written,
}

/// Writes the scene with its light; all files appear by rename.
///
/// # Errors
/// [`BakeError::Scene`] and [`BakeError::Texel`].
pub fn write(
    surface: &Surface<'_>,
    layers: &Layers,
    shown: &Shown,
    plan: &Plan,
    options: &BakeOptions,
    output: &Path,
    clock: &mut Clock<'_>,
) -> Result<Written, BakeError> {
    clock.stage("write");
    let views = shown.stored.views()?;
    let parts =
        (0..surface.scene.parts.len()).map(|part| part_light(surface, layers, shown, &views, part)).collect();
    let has_atlas = !shown.charts.is_empty();
    let extension = Extension {
        version: lightkiln_scene::VERSION,
        generator: concat!("lightkiln ", env!("CARGO_PKG_VERSION")).to_owned(),
        page_size: has_atlas.then_some(shown.packing.page_size),
        subtexels: lightkiln_chart::SUBTEXELS,
        max_error: plan.max_error,
        detail: plan.radius * 2.0,
        texel_size: plan.radius,
        seed: plan.seed,
        bake: Recipe::new(plan, output.parent().unwrap_or(Path::new(""))),
        layers: Vec::new(),
    };
    let files = |(layer, stored): (&BakedLayer, &StoredLayer)| -> Result<LayerFiles, BakeError> {
        let info = serde_json::to_value(LayerInfo::new(layer)).expect("plain numbers and strings");
        Ok(LayerFiles {
            pages: if has_atlas { pages(stored, shown.stored.size)? } else { Vec::new() },
            table: stored.table.as_ref().map(table).transpose()?,
            info: info.as_object().cloned().unwrap_or_default(),
        })
    };
    let light = BakedLight {
        parts,
        layers: layers.layers.iter().zip(&shown.stored.layers).map(files).collect::<Result<_, _>>()?,
        extension: ExtensionInfo {
            root: serde_json::to_value(&extension).expect("plain numbers and strings"),
        },
        fallback: options.fallback,
        remove: if options.replace { plan.signals.replaced() } else { Vec::new() },
    };
    let file = lightkiln_scene::write(surface.scene, &light, output)?;
    let mut outputs: Vec<PathBuf> = file.files.iter().map(|f| f.path.clone()).collect();
    if options.exr && has_atlas {
        outputs.extend(write_exrs(layers, shown, output)?);
    }
    Ok(Written { scene: output.to_owned(), outputs, scene_number: options.scene, file })
}

/// The codes of a part's corners, and what each corner shows to viewers that do not know them: the first layer.
fn part_light(
    surface: &Surface<'_>,
    layers: &Layers,
    shown: &Shown,
    views: &[AtlasView<'_>],
    part: usize,
) -> PartLight {
    if !surface.is_lit(part) {
        return PartLight::default();
    }
    let mesh = &surface.mesh;
    let triangles: Vec<TriangleId> = surface.triangles_of_part(part).collect();
    let codes = |codes: &Codes| -> Vec<[[u16; 2]; 3]> {
        triangles.par_iter().map(|&t| codes.of_triangle(mesh, t).map(|code| code.0)).collect()
    };
    let plain = |light: &mut Vec<f32>, &t: &TriangleId| {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|corner| {
            let at = SurfacePoint { triangle: t, barycentric: [corner[1], corner[2]] };
            shown.show(mesh, views, at, light);
            let first = layers.layers[0].channels();
            std::array::from_fn(|c| {
                let channel = if first.len() == 1 { 0 } else { c };
                if channel < first.len() { layers.displayed(channel, light[channel]) } else { 0.0 }
            })
        })
    };
    PartLight {
        corner_fallback: triangles.par_iter().map_init(|| vec![0.0; layers.channels()], plain).collect(),
        corner_codes: shown.codes.iter().map(codes).collect(),
    }
}

/// The pages of a layer's atlas as PNG files.
fn pages(stored: &StoredLayer, size: [u32; 2]) -> Result<Vec<Vec<u8>>, BakeError> {
    let encode = |page: &Vec<f32>| {
        let mut bytes = Vec::new();
        write_png(&mut bytes, size, stored.stored_channels(), stored.depth, page)?;
        Ok(bytes)
    };
    stored.pages.iter().map(encode).collect()
}

/// A table of colors as a PNG file.
fn table(table: &Table) -> Result<Vec<u8>, BakeError> {
    let (size, texels) = table.image();
    let texels: Vec<f32> = texels.iter().map(|&t| f32::from(t) / 255.0).collect();
    let mut bytes = Vec::new();
    write_png(&mut bytes, size, table.channels(), PngDepth::Eight, &texels)?;
    Ok(bytes)
}

/// The pages of the atlas as `<stem>.lightkiln.<page>.exr` beside the output, unquantized, in the unit of the light;
/// layers after the first have their number behind the page's.
fn write_exrs(layers: &Layers, shown: &Shown, output: &Path) -> Result<Vec<PathBuf>, BakeError> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let mut outputs = Vec::new();
    for (number, layer) in layers.layers.iter().enumerate() {
        let channels = layer.channels();
        let numbers = if channels.len() == 1 { 1 } else { 3 };
        for (page, texels) in shown.atlas.pages.iter().enumerate() {
            let value = |texel: &[f32], c: usize| {
                channels.clone().nth(c).map_or(0.0, |channel| layers.from_unit(channel, texel[channel]))
            };
            let own: Vec<f32> = texels
                .chunks_exact(layers.channels())
                .flat_map(|texel| (0..numbers).map(move |c| value(texel, c)))
                .collect();
            let suffix = if number == 0 { String::new() } else { format!(".{number}") };
            let path = output.with_file_name(format!("{stem}.lightkiln.{page}{suffix}.exr"));
            let mut bytes = std::io::Cursor::new(Vec::new());
            write_exr(&mut bytes, shown.atlas.size, numbers, ExrDepth::Half, &own)?;
            write_whole(&path, bytes.get_ref())
                .map_err(|source| BakeError::Write { path: path.clone(), source })?;
            outputs.push(path);
        }
    }
    Ok(outputs)
}

/// Writes a file under another name in the same folder and renames it when it is whole; nothing is left behind
/// when that fails.
///
/// # Errors
/// What the system says.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.{}.tmp", std::process::id()));
    let written = std::fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&temporary, path));
    if written.is_err() {
        // It may not even exist; either way there is nothing more to do about it.
        let _ = std::fs::remove_file(&temporary);
    }
    written
}
