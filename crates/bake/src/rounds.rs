//! Close, chart, texel, encode, check, and round again: until no color triangle breaks the bound.
//!
//! The vertices keep the values that the triangles were judged by, and the atlas is held to these values where it
//! meets them ([`crate::borders`]). Each round decodes every sample as the shader would; where a border comes out
//! wrong its vertices are detached from the atlas, and what is wrong still becomes texture. Regions that did not
//! change keep their charts and the light of their texels, so a round costs little more than packing.
//!
//! Fitting the vertices again, to the samples of color triangles alone or with the atlas's values held, lowers the
//! mean error a little, but moves single errors over the bound in triangles that had kept it: on a helmet of 95k
//! triangles that doubled the textured area, ring by ring.

use std::collections::BTreeMap;

use lightkiln_chart::pack::{BLOCK, MAX_STACK, PackError, PackOptions, Packing, pack};
use lightkiln_chart::{Chart, ChartOptions, charts};
use lightkiln_classify::{close, fill_notches, regions};
use lightkiln_encode::{
    AtlasView, Codes, EncodeReport, LightCode, PromotionPrices, atlas_position, encode, promotions,
};
use lightkiln_light::{Estimates, Signal};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId};
use lightkiln_sample::Samples;
use lightkiln_scene::Profile;
use lightkiln_texel::{Atlas, ChartTexels, StitchOptions, StitchReport, compose, lift, stitch};

use crate::authored::{self, OwnResolution};
use crate::borders::{Borders, PLACES_WEIGHT};
use crate::clock::Clock;
use crate::layers::{Layers, UnitLight};
use crate::options::{FILTER_RADIUS, GUTTER_TEXELS, Plan};
use crate::shade::{Lit, refine};
use crate::snapshot::{Snapshot, SnapshotLight};
use crate::stored::{Stored, expected_texel_bytes};
use crate::verify::References;
use crate::{BakeError, Surface};

/// Steps of closing (Schaefer 4.2: "we apply this operation twice").
const CLOSING_STEPS: usize = 2;

/// Rounds in which borders are detached; later ones promote whatever is wrong.
const PATIENT_ROUNDS: usize = 6;

/// What the file will show.
pub struct Shown {
    /// Texture triangles.
    pub is_texture: Vec<bool>,
    /// Charts, and where they lie.
    pub charts: Vec<Chart>,
    /// Where each chart lies.
    pub packing: Packing,
    /// The texels of all charts, dilated.
    pub atlas: Atlas,
    /// The same as the file stores them.
    pub stored: Stored,
    /// The attribute of each layer.
    pub codes: Vec<Codes>,
    /// What encoding had to do.
    pub encode: EncodeReport,
    /// What stitching did.
    pub stitch: StitchReport,
    /// Texels that were shaded.
    pub shaded_texels: usize,
    /// Rays that they took.
    pub texel_rays: u64,
    /// Rounds.
    pub rounds: usize,
    /// Color triangles that the check promoted.
    pub promoted: usize,
    /// Color triangles promoted because texels are cheaper.
    pub promoted_for_bytes: usize,
    /// Steps that no texels are finer by than those of the bake ([`OwnResolution`]).
    pub most_steps: u8,
}

impl Shown {
    /// What a GPU shows at a point, in unit values; `views` are of [`Stored::views`].
    pub fn show(&self, mesh: &Mesh, views: &[AtlasView<'_>], point: SurfacePoint, out: &mut [f32]) {
        let codes = |layer: usize| self.codes[layer].of_triangle(mesh, point.triangle);
        self.stored.show(views, codes, point.barycentric, out);
    }

    /// The codes of a triangle's corners; in which of them are colors and which places all layers are alike.
    pub fn codes_of(&self, mesh: &Mesh, triangle: TriangleId) -> [LightCode; 3] {
        self.codes[0].of_triangle(mesh, triangle)
    }
}

/// The charts of one region with the light of their texels, kept from round to round.
#[derive(Default)]
struct Region {
    /// Steps by which its texels are finer than those of the bake.
    steps: u8,
    charts: Vec<Chart>,
    texels: Vec<ChartTexels>,
    light: Vec<TexelLight>,
}

/// Makes what the file will show, round by round, until every sample of the color triangles is shown within
/// the bound or the rounds are spent.
///
/// `seen` are fresh points that may promote triangles too: they lie where no sample does. `finer` is there where textures
/// have finer texels than the bake.
///
/// # Errors
/// Those of the stages.
pub fn chart_texel_encode(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    finer: Option<&OwnResolution<'_>>,
    lit: &Lit,
    seen: &References,
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<Shown, BakeError> {
    clock.stage("close")?;
    let prices = prices(surface, &lit.layers, plan);
    let mut is_texture = lit.needs_texture.clone();
    if plan.profile == Profile::Lightmap {
        is_texture.fill(true);
    }
    close(&surface.adjacency, &mut is_texture, CLOSING_STEPS);
    // Without our shader no triangle can blend, so that every border splits its vertices.
    let blends = !plan.profile.is_plain();
    let mut detached = vec![!blends; surface.mesh.vertex_count()];
    let most_steps = finer.map_or(0, OwnResolution::most_steps);
    let mut kept = Kept { regions: BTreeMap::new(), most_steps };
    let (mut promoted, mut promoted_for_bytes) = (0, 0);
    for round in 1.. {
        clock.stage("close")?;
        fill_notches(&surface.adjacency, &mut is_texture);
        if blends {
            for triangle in promotions(&surface.mesh, &surface.adjacency, &is_texture, &prices) {
                is_texture[triangle.index()] = true;
                promoted_for_bytes += 1;
            }
        }
        let mut shown = show(surface, signal, finer, lit, &is_texture, &detached, plan, &mut kept, clock)?;
        let light = SnapshotLight { layers: &lit.layers, values: &lit.values, shown: Some(&shown) };
        clock.show(&Snapshot { surface, plan, light: Some(light) });
        clock.stage("check")?;
        let wrong = wrong_triangles(surface, lit, seen, &is_texture, &shown, plan)?;
        if wrong.is_empty() || round == plan.effort.rounds {
            shown.is_texture = is_texture;
            (shown.rounds, shown.promoted, shown.promoted_for_bytes) = (round, promoted, promoted_for_bytes);
            return Ok(shown);
        }
        for triangle in wrong {
            // Where the atlas is too coarse for a border that vertices follow well, vertices show it alone. What
            // is wrong without any texture is no matter of borders.
            let is_mixed = shown.codes_of(&surface.mesh, triangle).iter().any(|code| !code.is_color());
            if is_mixed && round < PATIENT_ROUNDS {
                surface.mesh.triangles[triangle.index()].iter().for_each(|v| detached[v.index()] = true);
            } else {
                is_texture[triangle.index()] = true;
                promoted += 1;
            }
        }
    }
    unreachable!("the last round returns")
}

/// What a file would show that has texels everywhere: the lightmap that a bake is compared with.
///
/// - `values`: unit values of the light vertices, for triangles without an area
///
/// # Errors
/// Those of the stages.
pub fn full_texture(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    layers: &Layers,
    values: &[f32],
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<Shown, BakeError> {
    let mesh = &surface.mesh;
    let is_texture: Vec<bool> = mesh.triangle_ids().map(|t| mesh.area(t) > 0.0).collect();
    let lit = Lit {
        samples: Samples::default(),
        estimates: Estimates::new(0, layers.channels()),
        layers: layers.clone(),
        light: UnitLight::default(),
        weights: Vec::new(),
        values: values.to_vec(),
        needs_texture: is_texture.clone(),
        decision_bound: plan.max_error,
    };
    let detached = vec![false; mesh.vertex_count()];
    show(surface, signal, None, &lit, &is_texture, &detached, plan, &mut Kept::default(), clock)
}

/// What texels and split vertices cost, before anything is packed.
fn prices(surface: &Surface<'_>, layers: &Layers, plan: &Plan) -> PromotionPrices {
    let vertices: usize = surface.scene.parts.iter().map(|p| p.positions.len()).sum();
    let bytes: usize = (0..surface.scene.parts.len())
        .map(|p| surface.scene.parts[p].positions.len() * surface.scene.vertex_stride(p))
        .sum();
    PromotionPrices {
        vertex_bytes: bytes as f64 / vertices.max(1) as f64
            + light_stride(plan.profile, layers.layers.len()) as f64,
        texel_size: plan.radius,
        texel_bytes: expected_texel_bytes(layers, plan.max_error, plan.profile) as f64,
        mips: 4.0 / 3.0,
        fill: EXPECTED_FILL,
        gutter: GUTTER_TEXELS,
    }
}

/// Bytes of the attributes with light at a vertex.
pub fn light_stride(profile: Profile, layers: usize) -> u64 {
    (profile.attributes(layers) * profile.stride()) as u64
}

/// Texels a side of the largest chart whose texels are finer than those of the bake: as many as a page has rows. A texture on
/// two triangles needs them as large as it is.
const LARGEST_FINE_CHART: u32 = MAX_STACK / BLOCK * BLOCK;

/// Share of the atlas that charts and their gutters fill; docs/PACKING.md has the measurements.
const EXPECTED_FILL: f64 = 0.8;

/// How far an entry of a table may be from the colors that it stands for, as a share of the bound.
const TABLE_SHARE: f32 = 0.2;

/// What rounds leave for the next.
#[derive(Default)]
struct Kept {
    regions: BTreeMap<Vec<TriangleId>, Region>,
    /// Steps that texels are finer by than those of the bake at most.
    most_steps: u8,
}

impl Kept {
    /// Makes the finest texels coarser, by at least one step, so that what needed too many may fit.
    fn coarsen(&mut self, texels: u64, limit: u64) {
        let steps =
            (1..self.most_steps).find(|&s| texels as f64 <= limit as f64 * authored::finer(s).powi(2));
        self.cut(self.most_steps - steps.unwrap_or(self.most_steps));
    }

    /// Cuts the steps; charts of before have the wrong texels.
    fn cut(&mut self, most_steps: u8) {
        if most_steps < self.most_steps {
            self.most_steps = most_steps;
            self.regions.clear();
        }
    }
}

/// One round: charts, texels, codes.
#[allow(clippy::too_many_arguments)] // a line of the pipeline: each argument is one stage's product
fn show(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    finer: Option<&OwnResolution<'_>>,
    lit: &Lit,
    is_texture: &[bool],
    detached: &[bool],
    plan: &Plan,
    kept: &mut Kept,
    clock: &mut Clock<'_>,
) -> Result<Shown, BakeError> {
    let (mesh, channels) = (&surface.mesh, lit.layers.channels());
    let (regions, packing) = chart_regions(surface, finer, is_texture, plan, kept, clock)?;
    light_regions(surface, signal, finer, &lit.layers, plan, kept, clock)?;
    let mut shown_charts = ShownCharts::default();
    for region in &regions {
        shown_charts.add(&kept.regions[region]);
    }
    let ShownCharts { charts, texels, mut values, valid, variances, shaded, rays } = shown_charts;
    let (adjacency, fans) = (&surface.adjacency, &surface.fans);
    let holds = Borders { mesh, adjacency, fans, is_texture }.holds(&charts, &lit.values, channels);
    let options = StitchOptions {
        holds: &holds,
        valid: Some(&valid),
        variances: Some(&variances),
        vertex_weight: PLACES_WEIGHT,
        range: [0.0, 1.0],
        ..StitchOptions::default()
    };
    let stitched = stitch(mesh, &charts, &texels, &mut values, channels, &options)?;
    let atlas = compose(&charts, &texels, &values, channels, &packing)?;
    let mut stored = Stored::new(&atlas, &lit.layers, plan.max_error, plan.profile);

    clock.stage("encode")?;
    let (mut codes, mut encoded) = (Vec::new(), EncodeReport::default());
    for (layer, view) in lit.layers.layers.iter().zip(stored.views()?) {
        let own: Vec<f32> =
            lit.values.chunks_exact(channels).flat_map(|v| &v[layer.channels()]).copied().collect();
        let readback = |chart: usize, vertex: usize, out: &mut [f32]| {
            view.read(atlas_position(&charts, &packing, chart, vertex), out);
        };
        let (of_layer, report) = encode(
            mesh,
            &surface.adjacency,
            is_texture,
            &charts,
            &packing,
            &own,
            layer.layer.channels,
            &readback,
            Some(detached),
        )?;
        codes.push(of_layer);
        encoded = report;
    }
    if plan.table {
        for ((codes, layer), stored) in codes.iter_mut().zip(&lit.layers.layers).zip(&mut stored.layers) {
            let bound = plan.max_error * TABLE_SHARE * layer.error_unit();
            let (indices, table) = codes.to_table(layer.layer.channels, bound)?;
            (*codes, stored.table) = (indices, Some(table));
        }
    }
    Ok(Shown {
        is_texture: Vec::new(),
        charts,
        packing,
        atlas,
        stored,
        codes,
        encode: encoded,
        stitch: stitched,
        shaded_texels: shaded,
        texel_rays: rays,
        rounds: 0,
        promoted: 0,
        promoted_for_bytes: 0,
        most_steps: kept.most_steps,
    })
}

/// Charts the regions that no earlier round had, and packs all of them; with coarser texels where finer ones than those of the
/// bake do not fit.
fn chart_regions(
    surface: &Surface<'_>,
    finer: Option<&OwnResolution<'_>>,
    is_texture: &[bool],
    plan: &Plan,
    kept: &mut Kept,
    clock: &mut Clock<'_>,
) -> Result<(Vec<Vec<TriangleId>>, Packing), BakeError> {
    loop {
        if let Some(finer) = finer {
            kept.cut(finer.affordable_steps(is_texture, kept.most_steps, plan.radius));
        }
        let of_steps = match finer {
            Some(finer) => finer.regions(is_texture, kept.most_steps),
            None => regions(&surface.adjacency, is_texture).into_iter().map(|r| (0, r)).collect(),
        };
        clock.stage("chart")?;
        let new: Vec<_> = of_steps.iter().filter(|(_, r)| !kept.regions.contains_key(r)).collect();
        for group in new.chunk_by(|(a, _), (b, _)| a == b) {
            let (steps, regions): (Vec<u8>, Vec<Vec<TriangleId>>) =
                group.iter().map(|r| (*r).clone()).unzip();
            add_charts(surface, steps[0], regions, plan, kept)?;
        }
        clock.stage("pack")?;
        let regions: Vec<Vec<TriangleId>> = of_steps.into_iter().map(|(_, region)| region).collect();
        let charts: Vec<Chart> =
            regions.iter().flat_map(|r| kept.regions[r].charts.iter().cloned()).collect();
        match pack(&charts, &PackOptions { gutter: GUTTER_TEXELS, ..PackOptions::default() }) {
            Err(PackError::AtlasFull { texels, limit }) if kept.most_steps > 0 => kept.coarsen(texels, limit),
            packing => return Ok((regions, packing?)),
        }
    }
}

/// Charts regions with texels that are finer by some steps.
fn add_charts(
    surface: &Surface<'_>,
    steps: u8,
    new: Vec<Vec<TriangleId>>,
    plan: &Plan,
    kept: &mut Kept,
) -> Result<(), BakeError> {
    let mut options = ChartOptions { gutter: GUTTER_TEXELS, ..ChartOptions::new(plan.radius) };
    if steps > 0 {
        options.texel_size = (f64::from(plan.radius) / authored::finer(steps)) as f32;
        options.max_size = LARGEST_FINE_CHART;
    }
    let (new_charts, _) = charts(&surface.mesh, &surface.adjacency, &new, &options)?;
    let mut region_of: Vec<(TriangleId, usize)> =
        new.iter().enumerate().flat_map(|(r, region)| region.iter().map(move |&t| (t, r))).collect();
    region_of.sort_unstable();
    let mut made: Vec<Region> = new.iter().map(|_| Region { steps, ..Region::default() }).collect();
    for chart in new_charts {
        let at = region_of.binary_search_by_key(&chart.triangles[0], |(t, _)| *t);
        made[region_of[at.expect("a chart's triangles come from a region")].1].charts.push(chart);
    }
    kept.regions.extend(new.into_iter().zip(made));
    Ok(())
}

/// Lights the charts of regions that have no light yet.
fn light_regions(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    finer: Option<&OwnResolution<'_>>,
    layers: &Layers,
    plan: &Plan,
    kept: &mut Kept,
    clock: &mut Clock<'_>,
) -> Result<(), BakeError> {
    clock.stage("texel")?;
    let mut dark: Vec<&mut Region> = kept.regions.values_mut().filter(|r| r.light.is_empty()).collect();
    // In the order of their triangles, whatever region they are of.
    let mut new: Vec<(u8, TriangleId, usize, Chart)> = Vec::new();
    for (number, region) in dark.iter().enumerate() {
        new.extend(region.charts.iter().map(|c| (region.steps, c.triangles[0], number, c.clone())));
    }
    new.sort_unstable_by_key(|&(steps, first, ..)| (steps, first));
    for group in new.chunk_by_mut(|a, b| a.0 == b.0) {
        let steps = group[0].0;
        let (numbers, charts): (Vec<usize>, Vec<Chart>) =
            group.iter_mut().map(|(_, _, number, chart)| (*number, std::mem::take(chart))).unzip();
        let (texels, light) = match finer.filter(|_| steps > 0) {
            Some(finer) => {
                let ours = |texels: &[ChartTexels]| {
                    shade_texels(surface, finer.signal.as_ref(), layers, texels, plan, clock)
                };
                finer.texels(&charts, steps, layers, plan, ours)?
            }
            None => {
                let texels = lift(&surface.mesh, &surface.adjacency, &charts, plan.seed);
                let mut light = shade_texels(surface, signal, layers, &texels, plan, clock)?;
                light.iter_mut().zip(&texels).for_each(|(light, texels)| light.keep_hidden(texels));
                (texels, light)
            }
        };
        for (number, (texels, light)) in numbers.into_iter().zip(texels.into_iter().zip(light)) {
            dark[number].texels.push(texels);
            dark[number].light.push(light);
        }
    }
    Ok(())
}

/// The light of a chart's texels in unit values, by texel; those without a lift have none.
pub struct TexelLight {
    /// Texels x channels.
    pub values: Vec<f32>,
    /// Of the noisiest channel, as an error.
    pub variances: Vec<f32>,
    /// Not inside other geometry.
    pub valid: Vec<bool>,
    /// Points that rays were traced at.
    pub shaded: usize,
    /// Rays.
    pub rays: u64,
}

impl TexelLight {
    /// Of texels that show nothing yet.
    pub fn dark(texels: usize, channels: usize) -> Self {
        let (values, variances) = (vec![0.0; texels * channels], vec![0.0; texels]);
        Self { values, variances, valid: vec![false; texels], shaded: 0, rays: 0 }
    }

    /// A chart that lies inside other geometry as a whole keeps the light that it has.
    pub fn keep_hidden(&mut self, texels: &ChartTexels) {
        if !self.valid.contains(&true) {
            self.valid = texels.lift.iter().map(Option::is_some).collect();
        }
    }
}

/// Shades every lifted texel until its noise is low enough or its rays are spent.
fn shade_texels(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    layers: &Layers,
    texels: &[ChartTexels],
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<Vec<TexelLight>, BakeError> {
    let lifted = |t: &ChartTexels| -> Vec<(SurfacePoint, u64)> {
        t.lift.iter().zip(&t.keys).filter_map(|(lift, &key)| lift.map(|point| (point, key))).collect()
    };
    let (points, keys): (Vec<SurfacePoint>, Vec<u64>) = texels.iter().flat_map(lifted).unzip();
    let [first, most] = plan.effort.texel_batches;
    let mut light = plan.denoiser.estimates_of_texels(layers, points.len(), signal.channels());
    refine(&mut light, signal, &points, &keys, &vec![first; points.len()], clock)?;
    let goal = plan.effort.texel_noise.min(plan.max_error / 3.0).powi(2);
    let wanted: Vec<u16> = (0..points.len())
        .map(|i| {
            let needed = f32::from(first) * layers.noise_of(&light, i).powi(2) / goal;
            (needed.ceil() as u16).clamp(first, most)
        })
        .collect();
    refine(&mut light, signal, &points, &keys, &wanted, clock)?;

    if layers.are_filtered() {
        clock.stage("filter")?;
    }
    let radius = FILTER_RADIUS * plan.radius;
    let unit = plan.denoiser.texels(surface, layers, texels, &points, &light, radius)?;
    let channels = layers.channels();
    let mut next = 0..points.len();
    Ok(texels
        .iter()
        .map(|t| {
            let count = t.len();
            let mut own = TexelLight::dark(count, channels);
            for texel in (0..count).filter(|&texel| t.lift[texel].is_some()) {
                let i = next.next().expect("one point per lifted texel");
                own.values[texel * channels..][..channels].copy_from_slice(unit.value(i));
                own.variances[texel] = unit.noise(i).powi(2);
                own.valid[texel] = light.valid(i);
                own.shaded += 1;
                own.rays += u64::from(light.batches(i)) * u64::from(signal.rays_per_batch());
            }
            own
        })
        .collect())
}

/// The charts of a round, region after region.
#[derive(Default)]
struct ShownCharts {
    charts: Vec<Chart>,
    texels: Vec<ChartTexels>,
    values: Vec<Vec<f32>>,
    valid: Vec<Vec<bool>>,
    variances: Vec<Vec<f32>>,
    shaded: usize,
    rays: u64,
}

impl ShownCharts {
    fn add(&mut self, region: &Region) {
        self.charts.extend_from_slice(&region.charts);
        self.texels.extend_from_slice(&region.texels);
        for light in &region.light {
            self.values.push(light.values.clone());
            self.valid.push(light.valid.clone());
            self.variances.push(light.variances.clone());
            self.shaded += light.shaded;
            self.rays += light.rays;
        }
    }
}

/// Decodes all samples and seen points of color triangles and lists the triangles that break the bound.
fn wrong_triangles(
    surface: &Surface<'_>,
    lit: &Lit,
    seen: &References,
    is_texture: &[bool],
    shown: &Shown,
    plan: &Plan,
) -> Result<Vec<TriangleId>, BakeError> {
    let views = shown.stored.views()?;
    let show = |p: SurfacePoint, out: &mut [f32]| shown.show(&surface.mesh, &views, p, out);
    let color = |p: SurfacePoint| !is_texture[p.triangle.index()];
    let checked: Vec<usize> = (0..lit.samples.points.len())
        .filter(|&i| lit.weights[i] > 0.0 && color(lit.samples.points[i]))
        .collect();
    let of_samples = lit.beyond(&checked, &show, plan.max_error);
    let mut triangles: Vec<TriangleId> = of_samples.iter().map(|&i| lit.samples.points[i].triangle).collect();
    triangles.extend(seen.beyond(&show, &color, plan.max_error));
    triangles.sort_unstable();
    triangles.dedup();
    Ok(triangles)
}
