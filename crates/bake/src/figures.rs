//! The report of a bake, from what each stage left.

use std::path::Path;

use lightkiln_encode::LightCode;
use lightkiln_mesh::TriangleId;
use lightkiln_report::errors::quantile;
use lightkiln_report::{
    AtlasFigures, Bytes, Class, Classes, Contributor, Errors, FullLightmap, LightBytes, RayFigures, Report,
    SCHEMA_VERSION, SceneFigures, Settings, Stage,
};
use lightkiln_scene::Profile;

use crate::authored::{OwnResolution, finer};
use crate::options::Plan;
use crate::output::Written;
use crate::rounds::{Shown, light_stride};
use crate::shade::Lit;
use crate::stored::StoredLayer;
use crate::verify::References;
use crate::{Surface, file_name};

/// All that a report is made of.
pub struct Everything<'a> {
    /// File that was read.
    pub input: &'a Path,
    /// File that was written.
    pub output: &'a Path,
    /// The light mesh.
    pub surface: &'a Surface<'a>,
    /// Where texels are finer than those of the plan.
    pub finer: Option<&'a OwnResolution<'a>>,
    /// What the user should know of the scene and its light.
    pub remarks: Vec<String>,
    /// Settings with defaults.
    pub plan: &'a Plan,
    /// Samples and the first fit.
    pub lit: &'a Lit,
    /// Fresh points that the rounds saw.
    pub seen: &'a References,
    /// What the file shows.
    pub shown: &'a Shown,
    /// What was written.
    pub written: &'a Written,
    /// Errors, and rays of all references.
    pub errors: (Errors, u64),
    /// Times.
    pub stages: Vec<Stage>,
}

/// Puts a report together.
pub fn report(all: Everything<'_>) -> Report {
    let bytes = bytes(&all);
    let (plan, (mut errors, mut verify_rays)) = (all.plan, all.errors.clone());
    if !plan.signals.is_traced() {
        (errors.rays_per_point, verify_rays) = (0, 0);
    }
    Report {
        version: SCHEMA_VERSION,
        generator: concat!("lightkiln ", env!("CARGO_PKG_VERSION")).to_owned(),
        input: file_name(all.input),
        output: file_name(all.output),
        settings: Settings {
            signal: plan.signals.to_string(),
            profile: plan.profile.name().to_owned(),
            max_error: plan.max_error,
            detail: plan.radius * 2.0,
            radius: plan.radius,
            quality: plan.quality.name().to_owned(),
            denoiser: plan.denoiser.name().to_owned(),
            ao_distance: plan.ao_distance.is_finite().then_some(plan.ao_distance),
            seed: plan.seed,
        },
        scene: scene_figures(all.surface, plan),
        classes: classes(&all),
        rays: ray_figures(&all, verify_rays),
        atlas: atlas_figures(all.shown),
        errors,
        bytes,
        warnings: (all.surface.scene.warnings.iter().chain(&all.written.file.warnings))
            .map(ToString::to_string)
            .chain(all.remarks)
            .collect(),
        stages: all.stages,
        peak_memory_bytes: None,
    }
}

/// What the file holds.
pub fn scene_figures(surface: &Surface<'_>, plan: &Plan) -> SceneFigures {
    let (mesh, parts) = (&surface.mesh, &surface.scene.parts);
    let mut nodes: Vec<_> = parts.iter().map(|p| (p.node, p.instance)).collect();
    nodes.dedup();
    SceneFigures {
        instances: nodes.len(),
        triangles: mesh.triangle_count(),
        degenerate_triangles: mesh.triangle_ids().filter(|&t| mesh.area(t) == 0.0).count(),
        gltf_vertices: parts.iter().map(|p| p.positions.len()).sum(),
        light_vertices: mesh.vertex_count(),
        sheets: lightkiln_mesh::sheets(mesh).1,
        area: mesh.total_area(),
        diagonal: f64::from(plan.diagonal),
    }
}

fn classes(all: &Everything<'_>) -> Classes {
    let (mesh, shown) = (&all.surface.mesh, all.shown);
    let total = mesh.total_area().max(f64::MIN_POSITIVE);
    let class = |belongs: &dyn Fn(TriangleId) -> bool| {
        mesh.triangle_ids().filter(|&t| belongs(t)).fold(Class::default(), |class, t| Class {
            triangles: class.triangles + 1,
            area_share: class.area_share + mesh.area(t) / total,
        })
    };
    let is_texture = |t: TriangleId| shown.is_texture[t.index()];
    let touches = |t: TriangleId| shown.codes_of(mesh, t).iter().any(|c: &LightCode| !c.is_color());
    Classes {
        texture: class(&is_texture),
        mixed: class(&|t| !is_texture(t) && touches(t)),
        color: class(&|t| !is_texture(t) && !touches(t)),
        texture_before_closing: class(&|t| all.lit.needs_texture[t.index()]),
        decision_bound: all.lit.decision_bound,
        rounds: shown.rounds,
        promoted: shown.promoted,
        promoted_for_bytes: shown.promoted_for_bytes,
    }
}

fn ray_figures(all: &Everything<'_>, verify_rays: u64) -> RayFigures {
    let (lit, traced) = (all.lit, all.plan.signals.is_traced());
    let support_samples = lit.samples.support.iter().filter(|s| **s).count();
    let count = lit.samples.points.len();
    let mut noise: Vec<f32> = (0..count).filter(|&i| lit.weights[i] > 0.0).map(|i| lit.noise(i)).collect();
    noise.sort_unstable_by(f32::total_cmp);
    RayFigures {
        poisson_samples: count - support_samples,
        support_samples,
        invalid_samples: lit
            .weights
            .iter()
            .zip(&lit.samples.areas)
            .filter(|(w, a)| **w == 0.0 && **a > 0.0)
            .count(),
        shaded_texels: all.shown.shaded_texels,
        sample_rays: if traced { lit.estimates.rays() } else { 0 },
        texel_rays: if traced { all.shown.texel_rays } else { 0 },
        verify_rays,
        sample_noise_median: quantile(&noise, 0.5),
        sample_noise_p99: quantile(&noise, 0.99),
    }
}

fn atlas_figures(shown: &Shown) -> AtlasFigures {
    let [width, height] = shown.stored.size;
    AtlasFigures {
        charts: shown.charts.len(),
        width,
        height,
        pages: shown.stored.layers.first().map_or(0, |layer| layer.pages.len() as u32),
        bits: shown.stored.layers.iter().map(StoredLayer::bits).max().unwrap_or_default(),
        texels: shown.stored.texels(),
        shown_texels: shown.atlas.shown,
        seam_before: shown.stitch.seam_before.max,
        seam_after: shown.stitch.seam_after.max,
    }
}

/// Fill and vertex ratio of a full lightmap where this bake has too few charts to measure them: docs/PROFILES.md has
/// what `--profile lightmap` measured.
const ASSUMED_FILL: f64 = 0.7;
const ASSUMED_VERTEX_RATIO: f64 = 1.1;

/// Charts that cover this share of the surface are enough to measure with. What needs texels is often small and frayed,
/// and says nothing of the rest.
const MEASURABLE_SHARE: f64 = 0.25;

fn bytes(all: &Everything<'_>) -> Bytes {
    let (surface, shown, written) = (all.surface, all.shown, all.written);
    let file = &written.file;
    let parts = &file.parts;
    let drawn: u64 = parts.iter().map(|p| (p.original_vertices + p.added_vertices) as u64).sum();
    let added_vertices = parts.iter().map(|p| p.added_vertices as u64).sum();
    let texel_bytes = shown.stored.texel_bytes();
    let stride = light_stride(all.plan.profile, shown.stored.layers.len());
    let atlas = shown.stored.texels() * texel_bytes;
    let light = LightBytes {
        attribute: drawn * stride,
        added_vertices: parts.iter().map(|p| (p.added_vertices * p.original_stride) as u64).sum(),
        atlas,
        mips: LightBytes::mips_of(atlas),
        tables: shown.stored.layers.iter().map(StoredLayer::table_bytes).sum(),
    };
    Bytes {
        light,
        total: light.total(),
        atlas_waste: (shown.stored.texels() - shown.atlas.shown) * texel_bytes,
        fallback: file.fallback_bytes,
        added_vertices,
        vertices_only: parts.iter().map(|p| p.original_vertices as u64 * stride).sum(),
        full_lightmap: full_lightmap(all, texel_bytes),
        geometry: geometry_bytes(all),
        files: file.files.iter().map(|f| f.bytes).sum(),
        largest: largest(surface, shown, written, stride, texel_bytes),
        instances_unshared: file.cloned_meshes + file.expanded_instances,
    }
}

/// Vertices and indices of the scene as read; data that instances share is counted once.
fn geometry_bytes(all: &Everything<'_>) -> u64 {
    let mut counted = std::collections::BTreeSet::new();
    let parts = all.surface.scene.parts.iter().zip(&all.written.file.parts);
    parts
        .filter(|(part, _)| counted.insert((part.mesh, part.primitives.clone())))
        .map(|(part, file)| {
            let index = if file.original_vertices > usize::from(u16::MAX) { 4 } else { 2 };
            (file.original_vertices * file.original_stride + part.triangles.len() * 3 * index) as u64
        })
        .sum()
}

/// One lightmap over everything at the same texel density, from areas and from what this bake's charts took.
fn full_lightmap(all: &Everything<'_>, texel_bytes: u64) -> FullLightmap {
    let (mesh, shown) = (&all.surface.mesh, all.shown);
    let area_texels = |triangle: TriangleId| {
        let steps = all.finer.map_or(0, |f| f.steps(triangle).min(shown.most_steps));
        mesh.area(triangle) / (f64::from(all.plan.radius) / finer(steps)).powi(2)
    };
    let charted: f64 = shown.charts.iter().flat_map(|c| &c.triangles).map(|&t| area_texels(t)).sum();
    let whole: f64 = mesh.triangle_ids().map(area_texels).sum();
    let measured = charted >= MEASURABLE_SHARE * whole;
    let (mut fill, mut vertex_ratio) = (ASSUMED_FILL, ASSUMED_VERTEX_RATIO);
    if measured {
        fill = (charted / shown.packing.page_texels() as f64).clamp(0.01, 1.0);
        let mut vertices: Vec<_> = shown.charts.iter().flat_map(|c| c.vertices.iter().copied()).collect();
        let with_splits = vertices.len() as f64;
        vertices.sort_unstable();
        vertices.dedup();
        vertex_ratio = with_splits / vertices.len() as f64;
    }
    let texels = (whole / fill).ceil() as u64;
    let parts = &all.written.file.parts;
    let vertices: u64 = parts.iter().map(|p| p.original_vertices as u64).sum();
    let stride_bytes: u64 = parts.iter().map(|p| (p.original_vertices * p.original_stride) as u64).sum();
    let atlas = texels * texel_bytes;
    FullLightmap {
        bytes: LightBytes {
            attribute: (vertices as f64 * vertex_ratio) as u64 * light_stride(Profile::Lightmap, 1),
            added_vertices: (stride_bytes as f64 * (vertex_ratio - 1.0)) as u64,
            atlas,
            mips: LightBytes::mips_of(atlas),
            tables: 0,
        },
        texels,
        fill,
        vertex_ratio,
        measured,
    }
}

/// How many contributors a report names.
const LARGEST: usize = 10;

/// The nodes whose light takes most bytes, and the part of the atlas that shows nothing.
fn largest(
    surface: &Surface<'_>,
    shown: &Shown,
    written: &Written,
    stride: u64,
    texel_bytes: u64,
) -> Vec<Contributor> {
    let mut texels = vec![0_u64; surface.scene.parts.len()];
    for chart in &shown.charts {
        let (part, _) = surface.part_of(chart.triangles[0]);
        texels[part] += u64::from(chart.size[0]) * u64::from(chart.size[1]);
    }
    let mut all: Vec<Contributor> = Vec::new();
    for ((number, part), file) in surface.scene.parts.iter().enumerate().zip(&written.file.parts) {
        let texel_bytes = texels[number] * texel_bytes * 4 / 3;
        let vertices = (file.original_vertices + file.added_vertices) as u64;
        let bytes = vertices * stride + (file.added_vertices * file.original_stride) as u64 + texel_bytes;
        let name = surface.scene.part_name(number);
        match all.last_mut() {
            Some(last) if number > 0 && surface.scene.parts[number - 1].node == part.node => {
                last.bytes += bytes;
                last.texel_bytes += texel_bytes;
            }
            _ => all.push(Contributor { name, bytes, texel_bytes }),
        }
    }
    all.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.name.cmp(&b.name)));
    all.truncate(LARGEST);
    all
}
