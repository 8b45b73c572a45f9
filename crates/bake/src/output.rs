//! Codes and texels to the file.

use std::io::Write;
use std::path::{Path, PathBuf};

use lightkiln_encode::{AtlasView, LightCode};
use lightkiln_mesh::TriangleId;
use lightkiln_scene::{BakedLight, ExtensionInfo, LayerFiles, PartLight};
use lightkiln_texel::{ExrDepth, write_exr, write_png};
use rayon::prelude::*;

use crate::clock::Clock;
use crate::file_light::{Extension, LayerInfo};
use crate::options::{BakeOptions, Plan};
use crate::rounds::Shown;
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
    shown: &Shown,
    plan: &Plan,
    options: &BakeOptions,
    output: &Path,
    clock: &mut Clock<'_>,
) -> Result<Written, BakeError> {
    clock.stage("write");
    let view = shown.stored.view()?;
    let parts = (0..surface.scene.parts.len()).map(|part| part_light(surface, shown, &view, part)).collect();
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
        layers: Vec::new(),
    };
    let info = LayerInfo {
        signal: "ambientOcclusion".to_owned(),
        channels: 1,
        curve: "linear".to_owned(),
        range: [0.0, 1.0],
        unit: "none".to_owned(),
        distance: plan.ao_distance.is_finite().then_some(plan.ao_distance),
    };
    let info = serde_json::to_value(&info).expect("plain numbers and strings");
    let layer = LayerFiles {
        pages: if has_atlas { pages(shown)? } else { Vec::new() },
        table: None,
        info: info.as_object().cloned().unwrap_or_default(),
    };
    let light = BakedLight {
        parts,
        layers: vec![layer],
        extension: ExtensionInfo {
            root: serde_json::to_value(&extension).expect("plain numbers and strings"),
        },
        fallback: options.fallback,
        remove: Vec::new(),
    };
    let file = lightkiln_scene::write(surface.scene, &light, output)?;
    let mut outputs: Vec<PathBuf> = file.files.iter().map(|f| f.path.clone()).collect();
    if options.exr && has_atlas {
        outputs.extend(write_exrs(shown, output)?);
    }
    Ok(Written { scene: output.to_owned(), outputs, scene_number: options.scene, file })
}

/// The codes of a part's corners, and what each corner shows to viewers that do not know them.
fn part_light(surface: &Surface<'_>, shown: &Shown, view: &AtlasView<'_>, part: usize) -> PartLight {
    let triangles: Vec<TriangleId> = surface.triangles_of_part(part).collect();
    let codes: Vec<[LightCode; 3]> =
        triangles.par_iter().map(|&t| shown.codes.of_triangle(&surface.mesh, t)).collect();
    let plain = |code: LightCode| match code.position() {
        Some(position) => view.lookup(position, 0),
        None => code.value().unwrap_or(0.0),
    };
    PartLight {
        corner_fallback: codes.par_iter().map(|corners| corners.map(|code| [plain(code); 3])).collect(),
        corner_codes: vec![codes.into_iter().map(|corners| corners.map(|code| code.0)).collect()],
    }
}

/// The pages of the atlas as PNG files.
fn pages(shown: &Shown) -> Result<Vec<Vec<u8>>, BakeError> {
    let encode = |page: &Vec<f32>| {
        let mut bytes = Vec::new();
        write_png(&mut bytes, shown.atlas.size, 1, shown.stored.depth, page)?;
        Ok(bytes)
    };
    shown.atlas.pages.iter().map(encode).collect()
}

/// The pages of the atlas as `<stem>.lightkiln.<page>.exr` beside the output, unquantized.
fn write_exrs(shown: &Shown, output: &Path) -> Result<Vec<PathBuf>, BakeError> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let mut outputs = Vec::new();
    for (number, page) in shown.atlas.pages.iter().enumerate() {
        let path = output.with_file_name(format!("{stem}.lightkiln.{number}.exr"));
        let mut bytes = std::io::Cursor::new(Vec::new());
        write_exr(&mut bytes, shown.atlas.size, 1, ExrDepth::Half, page)?;
        write_whole(&path, bytes.get_ref())
            .map_err(|source| BakeError::Write { path: path.clone(), source })?;
        outputs.push(path);
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
