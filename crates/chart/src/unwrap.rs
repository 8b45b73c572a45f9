//! From regions of texture triangles to charts: flatten, judge, split what does not hold, until it holds.

use glam::DVec2;
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId};
use rayon::prelude::*;

use crate::arap::{Flattening, Rest, Start, doubled_area, innermost};
use crate::chart::{Chart, ChartError};
use crate::check::check_plane;
use crate::merge::Neighbors;
use crate::patch::{CUT, Patch};
use crate::place::{Placed, place, size_for};
use crate::quality::{Fault, image, judge, part_overlap, repair_flips, singular_values};
use crate::segment::{DEVELOPABLE, Shape, segment};

/// How charts are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartOptions {
    /// World units per texel; all charts have this density.
    pub texel_size: f32,
    /// Texels kept free around each chart, on all sides. With at least 1, bilinear lookups stay inside.
    pub gutter: u32,
    /// Texels per side that no chart exceeds, gutters included.
    pub max_size: u32,
    /// Most that a triangle may be stretched or shrunk in any direction, as a factor above 1.
    pub max_stretch: f32,
    /// Local/global steps per flattening.
    pub iterations: u32,
}

impl ChartOptions {
    /// The defaults: a gutter of 1, charts of at most 2048 texels, stretch up to 2, 20 steps.
    pub fn new(texel_size: f32) -> Self {
        Self { texel_size, gutter: 1, max_size: 2048, max_stretch: 2.0, iterations: 20 }
    }
}

/// What was made, in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChartReport {
    /// Charts.
    pub charts: usize,
    /// Triangles in them.
    pub triangles: usize,
    /// Chart vertices in them.
    pub vertices: usize,
    /// Times that a piece had to be split because it could not be flattened whole.
    pub splits: usize,
    /// Times that two neighbouring pieces turned out to hold as one.
    pub merges: usize,
    /// Edges cut inside charts, to open tubes, holes and handles.
    pub cut_edges: usize,
    /// Flipped triangles that were turned back by moving a vertex.
    pub flips_repaired: usize,
    /// Area-weighted mean over triangles of the larger singular value or the inverse of the smaller.
    pub mean_stretch: f64,
    /// The worst of them among triangles higher than half a texel.
    pub max_stretch: f64,
    /// Area-weighted mean of (s1^2 + s2^2 + s1^-2 + s2^-2) / 4: the symmetric Dirichlet energy, 1 = isometric.
    pub symmetric_dirichlet: f64,
    /// Area of all triangles on the surface, in square texels.
    pub surface_area: f64,
    /// Area of all triangles in the charts before snapping, in square texels.
    pub chart_area: f64,
    /// Texels of all chart rectangles.
    pub rectangle_texels: u64,
    /// Triangles that have no area any more after snapping, or turned over by less than a snapping step.
    pub collapsed: usize,
    /// Length of the interior edges between texture triangles that charts cut, in world units.
    pub seam_length: f64,
    /// Charts of one triangle that had to be shrunk to fit the largest chart.
    pub shrunk: usize,
}

/// Makes charts of regions (connected sets of texture triangles, in any order).
///
/// Every chart is a disk without flipped or overlapping triangles ([`crate::check::verify`]) at one texel
/// density, except that a single triangle wider than `max_size` is shrunk to it. Charts come out ordered by
/// their smallest triangle, and equal for any number of threads.
///
/// # Errors
/// [`ChartError`] for options or regions that make no sense.
pub fn charts(
    mesh: &Mesh,
    adjacency: &Adjacency,
    regions: &[Vec<TriangleId>],
    options: &ChartOptions,
) -> Result<(Vec<Chart>, ChartReport), ChartError> {
    if !(options.texel_size > 0.0 && options.texel_size.is_finite()) {
        return Err(ChartError::TexelSize { texel_size: options.texel_size });
    }
    let max_size = options.max_size / 4 * 4;
    // A chart needs room between its gutters, and an f32 must hold its coordinates to 1/8 texel.
    if max_size < size_for(1.0, options.gutter.min(1 << 16)) || max_size > 1 << 20 {
        return Err(ChartError::MaxSize { max_size: options.max_size, gutter: options.gutter });
    }
    let mut taken = vec![false; mesh.triangle_count()];
    for (region, triangles) in regions.iter().enumerate() {
        for t in triangles {
            let Some(seen) = taken.get_mut(t.index()) else {
                return Err(ChartError::Triangle { region, triangle: t.0, triangles: mesh.triangle_count() });
            };
            if std::mem::replace(seen, true) {
                return Err(ChartError::Duplicate { region, triangle: t.0 });
            }
        }
    }
    let unwrap = Unwrap { mesh, adjacency, taken: &taken, options: ChartOptions { max_size, ..*options } };
    let mut pieces: Vec<Piece> = regions
        .par_iter()
        .filter(|region| !region.is_empty())
        .map(|region| {
            let mut sorted = region.clone();
            sorted.sort_unstable();
            unwrap.region(sorted)
        })
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();
    pieces.sort_by_key(|piece| piece.chart.triangles[0]);
    let mut report = ChartReport::default();
    for piece in &pieces {
        report.add(&piece.numbers);
    }
    report.mean_stretch /= report.surface_area.max(f64::MIN_POSITIVE);
    report.symmetric_dirichlet /= report.surface_area.max(f64::MIN_POSITIVE);
    Ok((pieces.into_iter().map(|piece| piece.chart).collect(), report))
}

impl ChartReport {
    /// Adds up; the means are still sums over area.
    fn add(&mut self, other: &Self) {
        self.charts += other.charts;
        self.triangles += other.triangles;
        self.vertices += other.vertices;
        self.splits += other.splits;
        self.merges += other.merges;
        self.cut_edges += other.cut_edges;
        self.flips_repaired += other.flips_repaired;
        self.mean_stretch += other.mean_stretch;
        self.max_stretch = self.max_stretch.max(other.max_stretch);
        self.symmetric_dirichlet += other.symmetric_dirichlet;
        self.surface_area += other.surface_area;
        self.chart_area += other.chart_area;
        self.rectangle_texels += other.rectangle_texels;
        self.collapsed += other.collapsed;
        self.seam_length += other.seam_length;
        self.shrunk += other.shrunk;
    }
}

/// Triangles in tried unions of pieces, per triangle of a region.
const MERGE_EFFORT: usize = 3;

/// A chart and its share of the report.
struct Piece {
    chart: Chart,
    numbers: ChartReport,
}

/// Why a piece must be split.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Refusal {
    /// A closed surface.
    Closed,
    /// Normals or area show already that it cannot work.
    Hopeless,
    /// The largest chart is smaller.
    TooLarge,
    /// Most of its rectangle would stay empty, as of a large ring's: pages are not so easily filled.
    Sparse,
    /// The solver failed, or a coordinate is not finite.
    NotFinite,
    /// It was flattened well, but snapping turned triangles over or brought parts over each other.
    Snapped,
    /// It was flattened with flips or too much stretch.
    Distorted,
    /// It was flattened, but lies over itself; labels that part it there.
    Overlaps(Option<Vec<u32>>),
}

/// Charts of more texels than the first must fill the second share of their rectangle.
const SPARSE_TEXELS: f64 = 8192.0;
const SPARSE_FILL: f64 = 0.3;

/// What a flattening is tried for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// If it fails, the patch is split: worth a second start and a good place to split at.
    Split,
    /// If it fails, nothing is lost.
    Merge,
}

struct Unwrap<'a> {
    mesh: &'a Mesh,
    adjacency: &'a Adjacency,
    taken: &'a [bool],
    options: ChartOptions,
}

impl Unwrap<'_> {
    fn region(&self, triangles: Vec<TriangleId>) -> Vec<Piece> {
        let patch = Patch::new(self.mesh, self.adjacency, triangles);
        let sets = patch.components(&vec![0; patch.len()]);
        if sets.len() == 1 {
            return self.merged(&patch, self.solve(&patch, 0));
        }
        let parts = sets.into_iter().map(|set| self.patch(set));
        parts.flat_map(|patch| self.merged(&patch, self.solve(&patch, 0))).collect()
    }

    /// Tries to put neighbouring pieces together, those first that share most of their border. The work is
    /// bounded: unions of [`MERGE_EFFORT`] times the triangles of the patch.
    fn merged(&self, patch: &Patch, pieces: Vec<Piece>) -> Vec<Piece> {
        if pieces.len() < 2 {
            return pieces;
        }
        let mut label = vec![0; patch.len()];
        for (number, piece) in pieces.iter().enumerate() {
            for t in &piece.chart.triangles {
                if let Ok(at) = patch.triangles.binary_search(t) {
                    label[at] = number as u32;
                }
            }
        }
        let place = |v: u32| self.mesh.positions[patch.vertices[v as usize].index()].as_dvec3();
        let length = |half: u32| place(patch.tail(half)).distance(place(patch.head(half)));
        let mut neighbors = Neighbors::new(patch, &label, pieces.len(), length);
        let mut pieces: Vec<Option<Piece>> = pieces.into_iter().map(Some).collect();
        let mut effort = MERGE_EFFORT * patch.len();
        while let Some((a, b)) = neighbors.take_best() {
            let (Some(first), Some(second)) = (&pieces[a as usize], &pieces[b as usize]) else { continue };
            let mut union = first.chart.triangles.clone();
            union.extend(&second.chart.triangles);
            union.sort_unstable();
            let Some(left) = effort.checked_sub(union.len()) else { continue };
            effort = left;
            let splits = first.numbers.splits + second.numbers.splits;
            let merges = first.numbers.merges + second.numbers.merges + 1;
            if let Ok(mut piece) = self.attempt(&self.patch(union), Purpose::Merge) {
                piece.numbers.splits = splits;
                piece.numbers.merges = merges;
                pieces[a as usize] = Some(piece);
                pieces[b as usize] = None;
                neighbors.join(a, b);
            }
        }
        pieces.into_iter().flatten().collect()
    }

    fn patch(&self, triangles: Vec<TriangleId>) -> Patch {
        Patch::new(self.mesh, self.adjacency, triangles)
    }

    /// One chart if that holds, else the charts of its parts.
    fn solve(&self, patch: &Patch, depth: u32) -> Vec<Piece> {
        let parted = match self.attempt(patch, Purpose::Split) {
            Ok(piece) => return vec![piece],
            Err(Refusal::Overlaps(parted)) => parted.map(|label| patch.components(&label)),
            Err(Refusal::Sparse) => {
                let places = patch.places(self.mesh, self.options.texel_size);
                Some(patch.components(&segment(patch, &Shape::new(patch, &places), true)))
            }
            Err(_) => None,
        };
        let sets = match parted {
            // A clean break, or cones have not helped so far.
            Some(sets) if (2..=3).contains(&sets.len()) || (depth >= 5 && sets.len() > 1) => sets,
            _ if depth < 40 => {
                let places = patch.places(self.mesh, self.options.texel_size);
                // Normals that led to nothing so often are noise.
                patch.components(&segment(patch, &Shape::new(patch, &places), depth >= 10))
            }
            _ => patch.triangles.iter().map(|&t| vec![t]).collect(),
        };
        let parts: Vec<Vec<Piece>> =
            sets.into_par_iter().map(|set| self.solve(&self.patch(set), depth + 1)).collect();
        let mut pieces: Vec<Piece> = parts.into_iter().flatten().collect();
        if let Some(first) = pieces.first_mut() {
            first.numbers.splits += 1;
        }
        pieces
    }

    /// Flattens a patch in one piece.
    fn attempt(&self, whole: &Patch, purpose: Purpose) -> Result<Piece, Refusal> {
        let mut patch = whole.clone();
        let places = patch.places(self.mesh, self.options.texel_size);
        if patch.len() > 500 {
            let room = f64::from(self.options.max_size).powi(2);
            let rest: f64 = Rest::new(&patch, &places).area();
            if rest > room || Shape::new(&patch, &places).error() > 2.0 * DEVELOPABLE {
                return Err(Refusal::Hopeless);
            }
        }
        let cut_edges = patch.cut_to_disk(self.mesh).ok_or(Refusal::Closed)?;
        let places = patch.places(self.mesh, self.options.texel_size);
        let rest = Rest::new(&patch, &places);
        let (mut uv, flips_repaired) = self.flatten(&patch, &rest, purpose)?;
        let mut numbers = ChartReport { charts: 1, cut_edges, flips_repaired, ..ChartReport::default() };
        let mut placed = place(&uv, self.options.gutter);
        let too_large = |placed: &Placed| placed.size.iter().any(|&s| s > self.options.max_size);
        if too_large(&placed) {
            if patch.len() > 1 {
                return Err(Refusal::TooLarge);
            }
            let span = uv.iter().flat_map(|a| uv.iter().map(|b| a.distance(*b))).fold(0.0, f64::max);
            let room = f64::from(self.options.max_size - 2 * self.options.gutter) - 0.5;
            uv.iter_mut().for_each(|p| *p *= room / span);
            placed = place(&uv, self.options.gutter);
            numbers.shrunk = 1;
        }
        let texels = f64::from(placed.size[0]) * f64::from(placed.size[1]);
        if texels > SPARSE_TEXELS && patch.len() > 1 && rest.area() < SPARSE_FILL * texels {
            return Err(Refusal::Sparse);
        }
        self.measure(&patch, &rest, &uv, &placed, &mut numbers);
        join_closed_cuts(&patch, &mut placed);
        let border: Vec<u32> = patch.loops().iter().flatten().map(|&half| patch.tail(half)).collect();
        let chart = Chart {
            triangles: patch.triangles,
            vertices: patch.vertices,
            corners: patch.corners,
            uv: placed.uv,
            size: placed.size,
        };
        // Snapping may close what was barely open.
        if chart.triangles.len() > 1 && check_plane(&chart, border).is_err() {
            return Err(Refusal::Snapped);
        }
        Ok(Piece { chart, numbers })
    }

    /// Flattens from one start after the other until one holds. Returns how many flips were repaired.
    fn flatten(&self, patch: &Patch, rest: &Rest, purpose: Purpose) -> Result<(Vec<DVec2>, usize), Refusal> {
        let stretch = f64::from(self.options.max_stretch.max(1.01));
        let mut flattening = Flattening::new(patch, rest);
        let mut refusal = Refusal::NotFinite;
        for start in [Start::Unfolded, Start::Tutte] {
            let Some(mut uv) = flattening.run(start, self.options.iterations) else { continue };
            let repaired = repair_flips(patch, rest, &mut uv);
            equalize_area(patch, rest, &mut uv);
            if patch.len() == 1 {
                return Ok((uv, repaired));
            }
            match judge(patch, rest, &uv, stretch) {
                Ok(()) => return Ok((uv, repaired)),
                // What overlaps would have to be bent out of shape by another start.
                Err(Fault::Overlaps) => {
                    let parted = (purpose == Purpose::Split)
                        .then(|| part_overlap(patch, rest, &uv, innermost(patch)))
                        .flatten();
                    return Err(Refusal::Overlaps(parted));
                }
                Err(Fault::Flipped | Fault::Stretched) => refusal = Refusal::Distorted,
            }
            // An isometry has no better version, and a large patch is cheaper to split than to try again.
            if purpose == Purpose::Merge || patch.border.iter().all(|&b| b) || patch.len() > 20_000 {
                break;
            }
        }
        Err(refusal)
    }

    fn measure(&self, patch: &Patch, rest: &Rest, uv: &[DVec2], placed: &Placed, numbers: &mut ChartReport) {
        numbers.triangles = patch.len();
        numbers.vertices = patch.vertices.len();
        numbers.surface_area = rest.area();
        numbers.rectangle_texels = u64::from(placed.size[0]) * u64::from(placed.size[1]);
        for (t, x) in rest.corners.iter().enumerate() {
            let u = image(patch, uv, t);
            numbers.chart_area += doubled_area(&u) / 2.0;
            let area = doubled_area(x) / 2.0;
            // Triangles far below a texel may collapse; as a mean over area they would drown all others.
            // Without area there is nothing to weigh a stretch with.
            let [large, small] = singular_values(x, &u).unwrap_or([1.0, 1.0]);
            let small = small.max(0.05);
            let stretch = large.max(1.0 / small);
            numbers.mean_stretch += area * stretch;
            numbers.symmetric_dirichlet += area
                * (large * large + small * small + (large * large).recip() + (small * small).recip())
                / 4.0;
            let longest = (0..3).map(|e| x[e].distance(x[(e + 1) % 3])).fold(0.0, f64::max);
            if area > 0.25 * longest {
                numbers.max_stretch = numbers.max_stretch.max(stretch);
            }
            let snapped = patch.corners[t].map(|v| placed.uv[v as usize].as_dvec2());
            numbers.collapsed += usize::from(doubled_area(&snapped) <= 0.0);
            for e in 0..3 {
                let id = patch.triangles[t];
                if patch.twins[t * 3 + e] == CUT
                    && let EdgeKind::Interior { triangle, .. } = self.adjacency.across(id, e)
                    && self.taken[triangle.index()]
                {
                    let [a, b] = [e, (e + 1) % 3].map(|c| self.mesh.corners(id)[c].as_dvec3());
                    numbers.seam_length += a.distance(b) / 2.0;
                }
            }
        }
    }
}

/// Scales to the area on the surface: that is what a chart's texels are for.
fn equalize_area(patch: &Patch, rest: &Rest, uv: &mut [DVec2]) {
    let flat: f64 = (0..patch.len()).map(|t| doubled_area(&image(patch, uv, t)) / 2.0).sum();
    let scale = (rest.area() / flat).sqrt();
    // Slivers can leave an area that says nothing about lengths.
    if (0.5..2.0).contains(&scale) {
        uv.iter_mut().for_each(|p| *p *= scale);
    }
}

/// Where both sides of a cut come to lie on each other (a plane with a hole), snapping must not part them:
/// equal coordinates are one vertex again for whoever encodes them.
fn join_closed_cuts(patch: &Patch, placed: &mut Placed) {
    let mut order: Vec<u32> = (0..patch.vertices.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (patch.vertices[v as usize], v));
    for run in order.chunk_by(|&a, &b| patch.vertices[a as usize] == patch.vertices[b as usize]) {
        for (i, &v) in run.iter().enumerate().skip(1) {
            let here = placed.uv[v as usize];
            let near = |w: &&u32| (placed.uv[**w as usize] - here).abs().max_element() < 0.2;
            if let Some(&w) = run[..i].iter().find(near) {
                placed.uv[v as usize] = placed.uv[w as usize];
            }
        }
    }
}
