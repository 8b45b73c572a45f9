//! Charts, packing and vertex values into codes: what each corner of each triangle carries.
//!
//! Schaefer 2012, sections 4.3 and 4.4; the cases that the paper leaves out are decided in
//! [`mixed`].

use lightkiln_chart::Chart;
use lightkiln_chart::pack::{Packing, placed_uv};
use lightkiln_mesh::{Adjacency, Mesh, TriangleId, VertexId};

use crate::mixed::{self, Case, Copies};
use crate::{EncodeError, LightCode};

/// The code of every corner of every triangle.
///
/// Most corners show what their vertex shows everywhere, so there is one code per light vertex and a sorted
/// list of the triangles that differ: those along seams between charts, and some of the color triangles that
/// touch texture-vertices. Memory: 4 bytes a vertex, 16 bytes a listed triangle.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Codes {
    defaults: Vec<LightCode>,
    triangles: Vec<TriangleId>,
    overrides: Vec<[LightCode; 3]>,
}

impl Codes {
    /// The codes of a triangle's three corners. Takes a binary search; [`Codes::iter`] does not.
    #[inline]
    pub fn of_triangle(&self, mesh: &Mesh, triangle: TriangleId) -> [LightCode; 3] {
        match self.triangles.binary_search(&triangle) {
            Ok(at) => self.overrides[at],
            Err(_) => mesh.triangles[triangle.index()].map(|v| self.defaults[v.index()]),
        }
    }

    /// The codes of all triangles, in order.
    pub fn iter(&self, mesh: &Mesh) -> impl Iterator<Item = [LightCode; 3]> {
        let mut at = 0;
        mesh.triangle_ids().map(move |t| {
            if self.triangles.get(at) == Some(&t) {
                at += 1;
                self.overrides[at - 1]
            } else {
                mesh.triangles[t.index()].map(|v| self.defaults[v.index()])
            }
        })
    }

    /// The code that a light vertex shows where no triangle says otherwise.
    pub fn of_vertex(&self, vertex: VertexId) -> LightCode {
        self.defaults[vertex.index()]
    }

    /// How many triangles differ from what their vertices show.
    pub fn override_count(&self) -> usize {
        self.triangles.len()
    }

    /// Every code that is held, in a fixed order: those of the vertices, then those of the triangles that differ.
    pub(crate) fn distinct(&self) -> impl Iterator<Item = LightCode> {
        self.defaults.iter().chain(self.overrides.iter().flatten()).copied()
    }

    /// Replaces every code that is held, in the order of [`Codes::distinct`].
    pub(crate) fn map(&self, mut replace: impl FnMut(LightCode) -> LightCode) -> Self {
        let defaults = self.defaults.iter().map(|&code| replace(code)).collect();
        let overrides = self.overrides.iter().map(|own| own.map(&mut replace)).collect();
        Self { defaults, triangles: self.triangles.clone(), overrides }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.defaults.len() * 4 + self.triangles.len() * 16
    }
}

/// What was encoded.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct EncodeReport {
    /// Texture triangles.
    pub texture_triangles: usize,
    /// Color triangles without a texture-vertex.
    pub plain: usize,
    /// Color triangles with one texture-vertex (and so without a chart edge).
    pub lone: usize,
    /// Color triangles with a chart edge and a color-vertex off it.
    pub chart_edge_two: usize,
    /// Color triangles with a chart edge and a texture-vertex off it.
    pub chart_edge_three: usize,
    /// Color triangles with two texture-vertices and no chart edge.
    pub split_two: usize,
    /// Color triangles with three texture-vertices and no chart edge.
    pub split_three: usize,
    /// Color triangles with more than one chart edge. They follow one of them and leave a seam at the others;
    /// none after `fill_notches`.
    pub several_chart_edges: usize,
    /// Texture-vertices shown as color copies because they lie off a chart edge.
    pub copies_at_chart_edges: usize,
    /// Texture-vertices shown as color copies only because a triangle without a chart edge has several.
    pub copies_elsewhere: usize,
    /// Light vertices with a texture triangle around them.
    pub texture_vertices: usize,
    /// Of them those that color triangles show by their vertex value.
    pub detached: usize,
    /// Texture-vertices with more than one place in the atlas.
    pub seam_vertices: usize,
    /// Distinct pairs of light vertex and code in use: how many vertices a file without splits of its own
    /// would have.
    pub code_pairs: usize,
    /// Color-vertices and copies of which a channel lay outside `0..=1` and was clamped.
    pub clamped: usize,
    /// Largest difference between what two places of one vertex read, over all channels; 0 after perfect stitching.
    pub readback_spread: f32,
    /// Largest distance in texels that a place was moved by, per axis, to fit the code; 0 for snapped charts.
    pub largest_rounding: f32,
}

/// Where a chart vertex lies in the stack of pages, in texels (not rounded to a code).
///
/// # Panics
/// For a chart without a placement or a vertex that the chart does not have.
pub fn atlas_position(charts: &[Chart], packing: &Packing, chart: usize, vertex: usize) -> [f32; 2] {
    let placement = packing.placements[chart];
    let [x, y] = placed_uv(charts[chart].uv[vertex], charts[chart].size, placement);
    [x, y + placement.page as f32 * packing.page_size[1] as f32]
}

/// One place of a texture-vertex, and where what the atlas reads there begins in a list of its own.
struct Place {
    vertex: VertexId,
    code: LightCode,
    readback: usize,
}

/// Gives every corner of every triangle its code, for one layer.
///
/// Which corner shows a color and which a place, and which vertices need a second code, does not depend on values: all
/// layers of a bake come out alike.
///
/// - `is_texture`: T; the texture triangles, each in exactly one chart; run `classify::fill_notches` first
/// - `vertex_values`: V × `channels`, unit values; those of texture-vertices are not read
/// - `channels`: 1 (codes of [`LightCode::color`]), 2 or 3 (of [`LightCode::color_rgb`])
/// - `readback`: writes what the finished atlas reads at a chart vertex, given the numbers of chart and chart
///   vertex (for example [`AtlasView::read`](crate::AtlasView::read) at [`atlas_position`]), to `channels` numbers; a
///   texture-vertex shown as a color takes the mean over its places
/// - `detached`: V, if any; texture-vertices that color triangles show by their vertex value all the same. The
///   light may then jump at chart edges that end there; the caller has found that a blend would be worse
/// - returns: the codes; deterministic
///
/// Memory: 4 bytes a light vertex and 16 bytes a listed triangle stay; 16 bytes a texture triangle, and 16 bytes a chart
/// vertex and 4 a channel of it, more while it runs.
///
/// # Errors
/// [`EncodeError::Length`], [`EncodeError::Uncharted`] and [`EncodeError::ChartTriangle`] for arrays and
/// charts that do not fit the mesh, [`EncodeError::Position`] for an atlas larger than codes can name,
/// [`EncodeError::NotFinite`] for a value that is shown and is none, [`EncodeError::Channels`].
#[allow(clippy::too_many_arguments)] // each is the product of another stage; a struct of them would have one user
pub fn encode(
    mesh: &Mesh,
    adjacency: &Adjacency,
    is_texture: &[bool],
    charts: &[Chart],
    packing: &Packing,
    vertex_values: &[f32],
    channels: usize,
    readback: &dyn Fn(usize, usize, &mut [f32]),
    detached: Option<&[bool]>,
) -> Result<(Codes, EncodeReport), EncodeError> {
    if !(1..=3).contains(&channels) {
        return Err(EncodeError::Channels { channels });
    }
    for (what, count, expected) in [
        ("is_texture", is_texture.len(), mesh.triangle_count()),
        ("vertex values", vertex_values.len(), mesh.vertex_count() * channels),
        ("placements", packing.placements.len(), charts.len()),
        ("detached", detached.map_or(mesh.vertex_count(), <[bool]>::len), mesh.vertex_count()),
    ] {
        if count != expected {
            return Err(EncodeError::Length { what, count, expected });
        }
    }
    let mut report = EncodeReport::default();
    let Places { textured, places, readbacks } =
        places(mesh, is_texture, charts, packing, channels, readback, &mut report)?;
    let of_textured = |t: TriangleId| -> &[LightCode; 3] {
        let at =
            textured.binary_search_by_key(&t, |(t, _)| *t).expect("every texture triangle stands in a chart");
        &textured[at].1
    };

    let mut is_place = mixed::texture_vertices(mesh, is_texture);
    for (place, &detached) in is_place.iter_mut().zip(detached.unwrap_or_default()) {
        report.detached += usize::from(*place && detached);
        *place &= !detached;
    }
    let copies = Copies::choose(mesh, adjacency, is_texture, &is_place);
    report.copies_at_chart_edges = copies.at_chart_edges;
    report.copies_elsewhere = copies.elsewhere;

    let (defaults, copy_codes) =
        defaults(vertex_values, channels, &is_place, &places, &readbacks, &copies, &mut report)?;
    let copy_of = |v: VertexId| {
        let at = copy_codes.binary_search_by_key(&v, |(v, _)| *v).expect("chosen copies have a code");
        copy_codes[at].1
    };

    let mut codes = Codes { defaults, triangles: Vec::new(), overrides: Vec::new() };
    let mut default_used = vec![false; mesh.vertex_count()];
    for t in mesh.triangle_ids() {
        let corners = mesh.triangles[t.index()];
        let case = mixed::case_of(mesh, adjacency, is_texture, &is_place, t);
        count(&mut report, case, corners, &is_place);
        let usual = corners.map(|v| codes.defaults[v.index()]);
        let mut own = usual;
        match case {
            Case::Color => {}
            Case::Texture => own = *of_textured(t),
            Case::ChartEdge { edge, across, across_edge, third, .. } => {
                // The edge runs the other way in the texture triangle across it.
                let (edge, across_edge) = (edge as usize, across_edge as usize);
                let there = of_textured(across);
                own[edge] = there[(across_edge + 1) % 3];
                own[(edge + 1) % 3] = there[across_edge];
                if third {
                    own[(edge + 2) % 3] = copy_of(corners[(edge + 2) % 3]);
                }
            }
            Case::Lone | Case::Split => {
                for corner in 0..3 {
                    if copies.at_corner(mesh, t, case, corner) {
                        own[corner] = copy_of(corners[corner]);
                    } else if is_place[corners[corner].index()] {
                        own[corner] = match corners[..corner].iter().position(|&v| v == corners[corner]) {
                            Some(same) => own[same],
                            None => mixed::nearest_texture_corner(adjacency, is_texture, t, corner)
                                .map_or(usual[corner], |(near, at)| of_textured(near)[at]),
                        };
                    }
                }
            }
        }
        if own == usual {
            corners.iter().for_each(|v| default_used[v.index()] = true);
        } else {
            codes.triangles.push(t);
            codes.overrides.push(own);
        }
    }
    report.code_pairs = code_pairs(mesh, &codes, default_used);
    Ok((codes, report))
}

/// What the charts say.
struct Places {
    /// The codes of all texture triangles, by triangle.
    textured: Vec<(TriangleId, [LightCode; 3])>,
    /// All places of all texture-vertices, by vertex.
    places: Vec<Place>,
    /// What the atlas reads there: `channels` numbers a place, in the order of the charts.
    readbacks: Vec<f32>,
}

fn places(
    mesh: &Mesh,
    is_texture: &[bool],
    charts: &[Chart],
    packing: &Packing,
    channels: usize,
    readback: &dyn Fn(usize, usize, &mut [f32]),
    report: &mut EncodeReport,
) -> Result<Places, EncodeError> {
    let mut textured: Vec<(TriangleId, [LightCode; 3])> = Vec::new();
    let mut places = Vec::new();
    let mut readbacks = Vec::new();
    for (number, chart) in charts.iter().enumerate() {
        let fault = |triangle: TriangleId, problem| EncodeError::ChartTriangle {
            chart: number,
            triangle: triangle.0,
            problem,
        };
        for (what, count, expected) in [
            ("corners of a chart", chart.corners.len(), chart.triangles.len()),
            ("uv of a chart", chart.uv.len(), chart.vertices.len()),
        ] {
            if count != expected {
                return Err(EncodeError::Length { what, count, expected });
            }
        }
        let mut seen: Vec<Option<LightCode>> = vec![None; chart.vertices.len()];
        for (&t, &corners) in chart.triangles.iter().zip(&chart.corners) {
            if t.index() >= mesh.triangle_count() {
                return Err(fault(t, "does not exist"));
            }
            if !is_texture[t.index()] {
                return Err(fault(t, "is no texture triangle"));
            }
            let mut own = [LightCode::default(); 3];
            for (corner, &chart_vertex) in corners.iter().enumerate() {
                let at = chart_vertex as usize;
                let vertex = mesh.triangles[t.index()][corner];
                if chart.vertices.get(at) != Some(&vertex) {
                    return Err(fault(t, "has other vertices in the mesh"));
                }
                own[corner] = match seen[at] {
                    Some(code) => code,
                    None => {
                        let [x, y] = atlas_position(charts, packing, number, at);
                        let code = LightCode::texture([x, y]).ok_or(EncodeError::Position {
                            chart: number,
                            page: packing.placements[number].page,
                            x,
                            y,
                            limit_x: LightCode::LIMIT[0],
                            limit_y: LightCode::LIMIT[1],
                        })?;
                        let [u, v] = code.position().expect("a place was encoded");
                        report.largest_rounding =
                            report.largest_rounding.max((u - x).abs()).max((v - y).abs());
                        places.push(Place { vertex, code, readback: readbacks.len() });
                        readbacks.resize(readbacks.len() + channels, 0.0);
                        let from = readbacks.len() - channels;
                        readback(number, at, &mut readbacks[from..]);
                        seen[at] = Some(code);
                        code
                    }
                };
            }
            textured.push((t, own));
        }
    }
    textured.sort_unstable_by_key(|(t, _)| *t);
    if let Some(pair) = textured.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let triangle = pair[0].0;
        let chart = charts.iter().rposition(|chart| chart.triangles.contains(&triangle)).unwrap_or(0);
        let problem = "stands in a chart already";
        return Err(EncodeError::ChartTriangle { chart, triangle: triangle.0, problem });
    }
    if textured.len() != is_texture.iter().filter(|&&texture| texture).count() {
        let charted = |t: u32| textured.binary_search_by_key(&TriangleId(t), |(t, _)| *t).is_ok();
        let missing = (0..).zip(is_texture).find(|&(t, &texture)| texture && !charted(t));
        return Err(EncodeError::Uncharted { triangle: missing.map_or(0, |(t, _)| t) });
    }
    // Stable: places that share vertex and code keep the order of the charts, so their mean is one number.
    places.sort_by_key(|place| (place.vertex, place.code));
    Ok(Places { textured, places, readbacks })
}

/// What each vertex shows by default (its value, or its first place), and the color codes of the copies,
/// by vertex.
#[expect(clippy::type_complexity, reason = "two lists, named where they are bound")]
fn defaults(
    vertex_values: &[f32],
    channels: usize,
    is_place: &[bool],
    places: &[Place],
    readbacks: &[f32],
    copies: &Copies,
    report: &mut EncodeReport,
) -> Result<(Vec<LightCode>, Vec<(VertexId, LightCode)>), EncodeError> {
    let clamped = &mut report.clamped;
    let mut color = |vertex: usize, values: &[f32]| {
        if let Some(&value) = values.iter().find(|value| !value.is_finite()) {
            return Err(EncodeError::NotFinite { vertex: vertex as u32, value });
        }
        *clamped += usize::from(values.iter().any(|value| !(0.0..=1.0).contains(value)));
        Ok(LightCode::color_of(values))
    };
    let mut defaults = vec![LightCode::default(); is_place.len()];
    for (vertex, values) in vertex_values.chunks_exact(channels).enumerate() {
        if !is_place[vertex] {
            defaults[vertex] = color(vertex, values)?;
        }
    }
    let mut copy_codes = Vec::with_capacity(copies.at_chart_edges + copies.elsewhere);
    for run in places.chunk_by(|a, b| a.vertex == b.vertex) {
        let vertex = run[0].vertex;
        report.texture_vertices += 1;
        if is_place[vertex.index()] {
            defaults[vertex.index()] = run[0].code;
        }
        report.seam_vertices += usize::from(run.len() > 1);
        let mut mean = [0.0; 3];
        for (channel, mean) in mean.iter_mut().enumerate().take(channels) {
            let read = || run.iter().map(|place| readbacks[place.readback + channel]);
            let (low, high) =
                (read().fold(f32::INFINITY, f32::min), read().fold(f32::NEG_INFINITY, f32::max));
            report.readback_spread = report.readback_spread.max(high - low);
            *mean = (read().map(f64::from).sum::<f64>() / run.len() as f64) as f32;
        }
        if copies.marks[vertex.index()] {
            copy_codes.push((vertex, color(vertex.index(), &mean[..channels])?));
        }
    }
    Ok((defaults, copy_codes))
}

fn count(report: &mut EncodeReport, case: Case, corners: [VertexId; 3], is_place: &[bool]) {
    match case {
        Case::Texture => report.texture_triangles += 1,
        Case::Color => report.plain += 1,
        Case::Lone => report.lone += 1,
        Case::ChartEdge { chart_edges, third, .. } => {
            report.several_chart_edges += usize::from(chart_edges > 1);
            *(if third { &mut report.chart_edge_three } else { &mut report.chart_edge_two }) += 1;
        }
        Case::Split if corners.iter().all(|v| is_place[v.index()]) => report.split_three += 1,
        Case::Split => report.split_two += 1,
    }
}

fn code_pairs(mesh: &Mesh, codes: &Codes, mut default_used: Vec<bool>) -> usize {
    let mut others = Vec::new();
    for (t, own) in codes.triangles.iter().zip(&codes.overrides) {
        for (&v, &code) in mesh.triangles[t.index()].iter().zip(own) {
            if code == codes.defaults[v.index()] {
                default_used[v.index()] = true;
            } else {
                others.push((v, code));
            }
        }
    }
    others.sort_unstable();
    others.dedup();
    default_used.iter().filter(|&&used| used).count() + others.len()
}
