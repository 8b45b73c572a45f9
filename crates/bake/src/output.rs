//! Codes and texels to the file.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lightkiln_encode::{AtlasView, Codes, Form, LightCode, Table};
use lightkiln_light::Domain;
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_scene::{BakedLight, ExtensionInfo, LayerFiles, MaterialTexture, Pairs, PartLight, Profile};
use lightkiln_texel::image::intensity;
use lightkiln_texel::image_exr::LARGEST_HALF;
use lightkiln_texel::{ExrDepth, ExrLayer, Ktx2Format, PngDepth, write_exr_layers, write_ktx2, write_png};
use rayon::prelude::*;

use crate::clock::Clock;
use crate::file_light::{Extension, LayerInfo, Recipe, StripInfo};
use crate::layers::{BakedLayer, Layers};
use crate::lighting::AuthoredOcclusion;
use crate::options::{BakeOptions, Plan};
use crate::rounds::Shown;
use crate::stored::{Encoding, Stored, StoredLayer};
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
    clock.stage("write")?;
    clock.commit();
    let views = shown.stored.views()?;
    let parts = (0..surface.scene.parts.len())
        .map(|p| part_light(surface, layers, shown, &views, plan.profile, p))
        .collect();
    let stored = &shown.stored;
    let has_charts = !shown.charts.is_empty();
    let extension = Extension {
        version: lightkiln_scene::VERSION,
        generator: concat!("lightkiln ", env!("CARGO_PKG_VERSION")).to_owned(),
        profile: plan.profile.name().to_owned(),
        strip: stored.coordinates.and_then(|c| c.strip).map(StripInfo::new),
        page_size: (stored.texels() > 0).then_some(stored.size),
        subtexels: stored.coordinates.is_none().then_some(lightkiln_chart::SUBTEXELS),
        max_error: plan.max_error,
        detail: plan.radius * 2.0,
        texel_size: plan.radius,
        seed: plan.seed,
        bake: Recipe::new(plan, output.parent().unwrap_or(Path::new(""))),
        layers: Vec::new(),
    };
    let files = |(layer, stored): (&BakedLayer, &StoredLayer)| -> Result<LayerFiles, BakeError> {
        let info = LayerInfo::new(layer, stored.encoding);
        let info = serde_json::to_value(info).expect("plain numbers and strings");
        Ok(LayerFiles {
            pages: pages(stored, shown.stored.size)?,
            table: stored.table.as_ref().map(table).transpose()?,
            info: info.as_object().cloned().unwrap_or_default(),
            texture: plan.profile.is_plain().then_some(match stored.encoding {
                Encoding::Unit => MaterialTexture::Occlusion,
                Encoding::Srgb { intensity, .. } => MaterialTexture::Lightmap { intensity },
            }),
        })
    };
    let light = BakedLight {
        parts,
        layers: layers.layers.iter().zip(&shown.stored.layers).map(files).collect::<Result<_, _>>()?,
        extension: ExtensionInfo {
            root: serde_json::to_value(&extension).expect("plain numbers and strings"),
        },
        profile: plan.profile,
        pairs: Some(pairs(&shown.stored)),
        keep_occlusion: plan.light.authored_occlusion == Some(AuthoredOcclusion::Keep),
        fallback: plan.profile.fallback(options.fallback),
        remove: if options.replace { plan.signals.replaced() } else { Vec::new() },
    };
    let file = lightkiln_scene::write(surface.scene, &light, output)?;
    let mut outputs: Vec<PathBuf> = file.files.iter().map(|f| f.path.clone()).collect();
    if options.exr && has_charts {
        outputs.extend(write_exrs(layers, shown, output)?);
    }
    if options.ktx2 && has_charts {
        outputs.extend(write_ktx2s(layers, shown, output)?);
    }
    Ok(Written { scene: output.to_owned(), outputs, scene_number: options.scene, file })
}

/// The codes of a part's corners, and what each corner shows to viewers that do not know them: the first layer.
fn part_light(
    surface: &Surface<'_>,
    layers: &Layers,
    shown: &Shown,
    views: &[AtlasView<'_>],
    profile: Profile,
    part: usize,
) -> PartLight {
    if !surface.is_lit(part) {
        return PartLight::default();
    }
    let mesh = &surface.mesh;
    let triangles: Vec<TriangleId> = surface.triangles_of_part(part).collect();
    let coordinates = shown.stored.coordinates;
    let corner = |code: LightCode| coordinates.map_or(code.0, |c| c.of(code));
    let codes = |codes: &Codes| -> Vec<[[u16; 2]; 3]> {
        triangles.par_iter().map(|&t| codes.of_triangle(mesh, t).map(corner)).collect()
    };
    let attributes = profile.attributes(shown.codes.len());
    let corner_codes = shown.codes[..attributes].iter().map(codes).collect();
    if profile.is_plain() {
        return PartLight { corner_codes, corner_fallback: Vec::new() };
    }
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
        corner_codes,
    }
}

/// The pair of floats that stands for a code of a layer.
fn pairs(stored: &Stored) -> Pairs {
    let [width, height] = stored.size.map(|side| side.max(1));
    let pages = stored.layers.first().map_or(0, |layer| layer.pages.len());
    let stack = [width, height * pages.max(1) as u32];
    // The table itself plays no part: its codes are numbers of entries.
    let forms: Vec<(usize, Option<Table>)> =
        stored.layers.iter().map(|layer| (layer.channels, layer.table.clone())).collect();
    Pairs(Arc::new(move |layer, code| {
        let (channels, table) = &forms[layer];
        let form = table.as_ref().map_or_else(|| Form::packed(*channels), Form::Table);
        LightCode(code).interop(stack, &form)
    }))
}

/// The pages of a layer's atlas as PNG files.
fn pages(stored: &StoredLayer, size: [u32; 2]) -> Result<Vec<Vec<u8>>, BakeError> {
    let encode = |page: usize| {
        let mut bytes = Vec::new();
        write_png(&mut bytes, size, stored.stored_channels(), stored.depth, &stored.image(page))?;
        Ok(bytes)
    };
    (0..stored.pages.len()).map(encode).collect()
}

/// A table of colors as a PNG file.
fn table(table: &Table) -> Result<Vec<u8>, BakeError> {
    let (size, texels) = table.image();
    let texels: Vec<f32> = texels.iter().map(|&t| f32::from(t) / 255.0).collect();
    let mut bytes = Vec::new();
    write_png(&mut bytes, size, table.channels(), PngDepth::Eight, &texels)?;
    Ok(bytes)
}

/// A page of one layer in the unit of its light, with 1 or 3 numbers a texel.
fn in_own_unit(layers: &Layers, layer: &BakedLayer, page: &[f32]) -> Vec<f32> {
    let channels = layer.channels();
    let stored = if channels.len() == 1 { 1 } else { 3 };
    let texel = |texel: &[f32]| -> Vec<f32> {
        let own = channels.clone().map(|channel| layers.from_unit(channel, texel[channel]));
        own.chain(std::iter::repeat_n(0.0, stored - channels.len())).collect()
    };
    page.chunks_exact(layers.channels()).flat_map(texel).collect()
}

/// The pages of the atlas as `<stem>.lightkiln.<page>.exr` beside the output: all layers, unquantized, in the unit of
/// their light.
fn write_exrs(layers: &Layers, shown: &Shown, output: &Path) -> Result<Vec<PathBuf>, BakeError> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let mut outputs = Vec::new();
    for (number, page) in shown.atlas.pages.iter().enumerate() {
        let values: Vec<Vec<f32>> = layers.layers.iter().map(|l| in_own_unit(layers, l, page)).collect();
        let fits = values.iter().flatten().all(|v| v.abs() <= LARGEST_HALF);
        let alone = layers.layers.len() == 1;
        let parts: Vec<ExrLayer<'_>> = layers
            .layers
            .iter()
            .zip(&values)
            .map(|(layer, values)| ExrLayer {
                name: if alone { "" } else { &layer.layer.name },
                channels: if layer.layer.channels == 1 { 1 } else { 3 },
                values,
            })
            .collect();
        let depth = if fits { ExrDepth::Half } else { ExrDepth::Single };
        let mut bytes = std::io::Cursor::new(Vec::new());
        write_exr_layers(&mut bytes, shown.atlas.size, depth, &parts)?;
        let path = output.with_file_name(format!("{stem}.lightkiln.{number}.exr"));
        write_whole(&path, bytes.get_ref())
            .map_err(|source| BakeError::Write { path: path.clone(), source })?;
        outputs.push(path);
    }
    Ok(outputs)
}

/// The atlas of each layer as `<stem>.lightkiln.ktx2`, `<stem>.lightkiln_1.ktx2` and so on beside the output, a texture
/// array where there are several pages: shared exponents for light, halves for the rest. What exceeds the format is
/// divided by a power of two, which the name tells: `<stem>.lightkiln.x4.ktx2`.
fn write_ktx2s(layers: &Layers, shown: &Shown, output: &Path) -> Result<Vec<PathBuf>, BakeError> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let mut outputs = Vec::new();
    for (number, layer) in layers.layers.iter().enumerate() {
        let mut pages: Vec<Vec<f32>> =
            shown.atlas.pages.iter().map(|page| in_own_unit(layers, layer, page)).collect();
        let (format, channels) = match layer.layer.domain {
            _ if layer.layer.channels == 1 => (Ktx2Format::R16f, 1),
            Domain::Hdr => (Ktx2Format::Rgb9e5, 3),
            _ => (Ktx2Format::Rgba16f, 3),
        };
        let divisor = pages.iter().map(|page| intensity(page, format.range()[1])).fold(1.0, f32::max);
        pages.iter_mut().flatten().for_each(|v| *v = (*v / divisor).max(format.range()[0]));
        let of_layer = if number == 0 { String::new() } else { format!("_{number}") };
        let divided = if divisor > 1.0 { format!(".x{divisor}") } else { String::new() };
        let path = output.with_file_name(format!("{stem}.lightkiln{of_layer}{divided}.ktx2"));
        let slices: Vec<&[f32]> = pages.iter().map(Vec::as_slice).collect();
        let mut bytes = Vec::new();
        write_ktx2(&mut bytes, shown.atlas.size, channels, format, &slices)?;
        write_whole(&path, &bytes).map_err(|source| BakeError::Write { path: path.clone(), source })?;
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
