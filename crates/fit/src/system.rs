//! Unknowns, the normal matrix in compressed rows, and right-hand sides.
//!
//! The energy of the default is, over light vertices `x`,
//!
//! ```text
//!   Σ_p w_p (f_p - g_x(p))²            the data: Schaefer eq. 2, Kavan eq. 3
//! + alpha R(x)                         the regularizer of the options: Kavan eq. 9
//! + Σ_flaps (EDGE_TIE + DAMPING d) E   our edge term, free for linear functions
//! + GRAPH_TIE Σ_edges a (x_i - x_j)²   what is left: one triangle with one observation
//! ```
//!
//! where `d` is how much less a flap's vertices see than their area should show them: 0 where every vertex
//! sees at least [`SEEN_SHARE`] of `a / 6`, 1 where one sees nothing. A vertex whose only observation lies
//! far from it is thus continued linearly from its neighbours rather than shot through that observation.
//! Constants come out exact because each sheet is solved for the difference to its mean; linear functions
//! cost only the last term, which is ten orders below the data.
//!
//! Rows are gathered vertex by vertex from the triangles around, in parallel and without maps.

use std::ops::Range;

use lightkiln_mesh::{Adjacency, Fans, Mesh, TriangleId, VertexId, sheets};
use rayon::prelude::*;

use crate::elements::{Element, Flap, gradient};
use crate::observations::ByTriangle;
use crate::optimum;
use crate::solve::{Context, SheetSolver};
use crate::{Bounds, Fit, FitError, FitOptions, FitReport, Held, Mass, Method, Observations, Regularizer};

/// Weight of the edge term that is always there: where vertices see enough each but too little together, noise grows
/// by at most `1 / √EDGE_TIE`.
pub const EDGE_TIE: f64 = 1e-3;
/// Observations in two neighbouring triangles from which on the edge term that is always there fades.
const ENOUGH: f64 = 8.0;
/// Weight of the edge term around a vertex that sees nothing.
pub const DAMPING: f64 = 0.1;
/// A vertex that sees this share of its expected mass needs no damping.
pub const SEEN_SHARE: f64 = 0.1;
/// Weight of the differences along edges that hold what even the edge term leaves open.
pub const GRAPH_TIE: f64 = 1e-10;
/// Share of a sheet's mean triangle area that stands in where a triangle has none.
const AREA_FLOOR: f64 = 1e-3;
/// How many ranges beyond the observations of its sheet a value may lie.
const GUARD_RANGES: f64 = 2.0;
/// Rows gathered at a time by one thread.
pub(crate) const CHUNK: usize = 2048;
/// Channels solved at a time: first few, which measure the spectrum, then many.
const FIRST_BLOCK: usize = 4;
const BLOCK: usize = 16;
/// Unknowns beyond which memory for many channels at a time is dear.
const MANY_UNKNOWNS: usize = 3_000_000;
/// A vertex that is not solved for.
const NONE: u32 = u32::MAX;

/// The symmetric matrix, both halves, in chunks of [`CHUNK`] rows.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    chunks: Vec<RowChunk>,
}

#[derive(Debug, Default)]
pub(crate) struct RowChunk {
    starts: Vec<u32>,
    columns: Vec<u32>,
    entries: Vec<f64>,
    diagonal: Vec<f64>,
    // Entries whose column is a held vertex: row, vertex, entry.
    held: Vec<(u32, u32, f64)>,
}

impl Rows {
    /// Columns in ascending order, and entries.
    #[inline]
    pub fn row(&self, unknown: usize) -> (&[u32], &[f64]) {
        let chunk = &self.chunks[unknown / CHUNK];
        let r = unknown % CHUNK;
        let range = chunk.starts[r] as usize..chunk.starts[r + 1] as usize;
        (&chunk.columns[range.clone()], &chunk.entries[range])
    }

    #[inline]
    pub fn diagonal(&self, unknown: usize) -> f64 {
        self.chunks[unknown / CHUNK].diagonal[unknown % CHUNK]
    }

    pub fn entries(&self) -> usize {
        self.chunks.iter().map(|c| c.columns.len()).sum()
    }
}

/// One sheet's share of the unknowns and what is known of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sheet {
    pub first: u32,
    pub last: u32,
    /// Mean area of its triangles; positive.
    unit: f64,
}

impl Sheet {
    pub fn unknowns(&self) -> Range<usize> {
        self.first as usize..self.last as usize
    }
}

/// A fit in the making: the assembled matrix, its factors, and everything a right-hand side needs.
///
/// `alpha` can change between solves: the structure and symbolic factors stay.
pub struct System<'a> {
    mesh: &'a Mesh,
    adjacency: &'a Adjacency,
    fans: Fans,
    observed: ByTriangle<'a>,
    held: Option<&'a Held<'a>>,
    options: FitOptions,
    unknown_of: Vec<u32>,
    vertex_of: Vec<u32>,
    /// How much less than its share a vertex sees, 0..=1, by vertex.
    deficit: Vec<f32>,
    /// By triangle.
    sheet_of: Vec<u32>,
    sheets: Vec<Sheet>,
    /// Sheets × C: mean, smallest and largest observation.
    ranges: Vec<[f64; 3]>,
    neutral: Vec<f64>,
    rows: Rows,
    solvers: Vec<SheetSolver>,
    /// The solvers are those of another alpha.
    stale: bool,
    report: FitReport,
}

impl<'a> System<'a> {
    /// Numbers the unknowns and assembles the matrix.
    ///
    /// # Errors
    /// As [`crate::fit`].
    pub fn new(
        mesh: &'a Mesh,
        adjacency: &'a Adjacency,
        observations: &Observations<'a>,
        held: Option<&'a Held<'a>>,
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        check(mesh, observations, held, options)?;
        let observed = ByTriangle::new(mesh, *observations)?;
        let mut system = Self {
            mesh,
            adjacency,
            fans: Fans::new(mesh),
            observed,
            held,
            options: *options,
            unknown_of: Vec::new(),
            vertex_of: Vec::new(),
            deficit: Vec::new(),
            sheet_of: Vec::new(),
            sheets: Vec::new(),
            ranges: Vec::new(),
            neutral: Vec::new(),
            rows: Rows::default(),
            solvers: Vec::new(),
            stale: true,
            report: FitReport::default(),
        };
        system.number();
        system.weigh();
        system.assemble();
        Ok(system)
    }

    /// Changes the weight of the regularizer and assembles the matrix again; symbolic factors stay.
    ///
    /// # Errors
    /// [`FitError::Alpha`].
    pub fn set_alpha(&mut self, alpha: f32) -> Result<(), FitError> {
        if !(alpha.is_finite() && alpha >= 0.0) {
            return Err(FitError::Alpha { alpha });
        }
        self.options.alpha = alpha;
        self.assemble();
        self.stale = true;
        Ok(())
    }

    /// Sheets, their means and ranges, and the unknowns in the order of their sheets.
    fn number(&mut self) {
        let (mesh, channels) = (self.mesh, self.observed.channels());
        let (sheet_of, count) = sheets(mesh);
        let is_held = |v: usize| self.held.is_some_and(|h| h.vertices[v]);

        let mut area = vec![0.0; count];
        let mut triangles = vec![0_usize; count];
        let mut weight = vec![0.0; count];
        let mut ranges = vec![[0.0, f64::INFINITY, f64::NEG_INFINITY]; count * channels];
        let mut total = vec![0.0; channels];
        let mut degenerate = 0;
        for t in mesh.triangle_ids() {
            let sheet = sheet_of[t.index()] as usize;
            let a = mesh.area(t);
            degenerate += usize::from(a <= 0.0);
            area[sheet] += a;
            triangles[sheet] += 1;
            for seen in self.observed.in_triangle(t) {
                weight[sheet] += seen.weight;
                for (c, &value) in self.observed.values(seen.index).iter().enumerate() {
                    let value = f64::from(value);
                    let range = &mut ranges[sheet * channels + c];
                    range[0] += seen.weight * value;
                    range[1] = range[1].min(value);
                    range[2] = range[2].max(value);
                    total[c] += seen.weight * value;
                }
            }
        }
        let all_weight: f64 = weight.iter().sum();
        let neutral: Vec<f64> = (0..channels)
            .map(|c| match self.options.neutral {
                Some(value) => f64::from(value),
                None if all_weight > 0.0 => total[c] / all_weight,
                None => 1.0,
            })
            .collect();

        // Vertices by sheet: each vertex lies in exactly one, as sheets join over vertices.
        let mut sheet_of_vertex = vec![NONE; mesh.vertex_count()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            for v in corners {
                sheet_of_vertex[v.index()] = sheet_of[t];
            }
        }
        let mut held_in = vec![0_usize; count];
        let mut free_in = vec![0_u32; count];
        for v in 0..mesh.vertex_count() {
            let sheet = sheet_of_vertex[v] as usize;
            if is_held(v) {
                self.report.held_vertices += 1;
                if sheet < count {
                    held_in[sheet] += 1;
                    if weight[sheet] <= 0.0 {
                        let held = self.held.map_or(&[][..], |h| &h.values[v * channels..(v + 1) * channels]);
                        for (c, &value) in held.iter().enumerate() {
                            let range = &mut ranges[sheet * channels + c];
                            range[0] += f64::from(value);
                            range[1] = range[1].min(f64::from(value));
                            range[2] = range[2].max(f64::from(value));
                        }
                    }
                }
            } else if sheet < count {
                free_in[sheet] += 1;
            } else {
                self.report.isolated_vertices += 1;
            }
        }
        let mut first = 0;
        let mut list = Vec::with_capacity(count);
        for sheet in 0..count {
            let known = if weight[sheet] > 0.0 { weight[sheet] } else { held_in[sheet] as f64 };
            let mut free = free_in[sheet];
            if known <= 0.0 {
                self.report.undetermined_sheets += 1;
                self.report.undetermined_vertices += free as usize;
                free = 0;
            } else {
                for range in &mut ranges[sheet * channels..(sheet + 1) * channels] {
                    range[0] = (range[0] / known).clamp(range[1], range[2]);
                }
            }
            let unit = [area[sheet], weight[sheet], 1.0].into_iter().find(|&u| u > 0.0).unwrap_or(1.0)
                / triangles[sheet].max(1) as f64;
            list.push(Sheet { first, last: first + free, unit });
            first += free;
        }
        let mut fill: Vec<u32> = list.iter().map(|s| s.first).collect();
        let mut unknown_of = vec![NONE; mesh.vertex_count()];
        let mut vertex_of = vec![0; first as usize];
        for v in 0..mesh.vertex_count() {
            let sheet = sheet_of_vertex[v] as usize;
            if sheet < count && !is_held(v) && fill[sheet] < list[sheet].last {
                unknown_of[v] = fill[sheet];
                vertex_of[fill[sheet] as usize] = v as u32;
                fill[sheet] += 1;
            }
        }
        self.report.observations = self.observed.len();
        self.report.ignored_observations = self.observed.ignored;
        self.report.not_finite_observations = self.observed.not_finite;
        self.report.non_manifold_edges = self.adjacency.non_manifold_edges();
        self.report.degenerate_triangles = degenerate;
        self.report.unknowns = vertex_of.len();
        self.report.sheets = list.iter().filter(|s| s.last > s.first).count();
        self.unknown_of = unknown_of;
        self.vertex_of = vertex_of;
        self.sheet_of = sheet_of;
        self.sheets = list;
        self.ranges = ranges;
        self.neutral = neutral;
    }

    /// What each vertex sees of what its area should show it.
    fn weigh(&mut self) {
        let seen_and_deficit: Vec<(bool, f32)> = (0..self.mesh.vertex_count())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|v| {
                if self.unknown_of[v] == NONE {
                    return (true, 0.0);
                }
                let (mut area, mut mass) = (0.0, 0.0);
                for &t in self.fans.around(VertexId(v as u32)) {
                    area += self.mesh.area(t);
                    for seen in self.observed.in_triangle(t) {
                        mass += seen.weight * hat(self.mesh, t, v as u32, seen.barycentric).powi(2);
                    }
                }
                let expected = SEEN_SHARE * area / 6.0;
                let deficit =
                    if mass >= expected && mass > 0.0 { 0.0 } else { 1.0 - mass / expected.max(mass) };
                (mass > 0.0, if deficit.is_finite() { deficit as f32 } else { 1.0 })
            })
            .collect();
        self.report.unseen_vertices = seen_and_deficit.iter().filter(|s| !s.0).count();
        self.deficit = seen_and_deficit.iter().map(|s| s.1).collect();
        self.report.damped_vertices = self.deficit.iter().filter(|&&d| d > 0.0).count();
    }

    /// Gathers all rows.
    fn assemble(&mut self) {
        let unknowns = self.vertex_of.len();
        let chunks = (0..unknowns.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| self.gather(chunk * CHUNK..((chunk + 1) * CHUNK).min(unknowns)))
            .collect();
        self.rows = Rows { chunks };
        self.report.matrix_entries = self.rows.entries();
    }

    fn gather(&self, unknowns: Range<usize>) -> RowChunk {
        let mut chunk = RowChunk::default();
        chunk.starts.push(0);
        chunk.columns.reserve(unknowns.len() * 14);
        chunk.entries.reserve(unknowns.len() * 14);
        let mut row = Accumulator::default();
        for unknown in unknowns {
            self.gather_row(self.vertex_of[unknown], &mut row);
            row.finish();
            let mut diagonal = 0.0;
            for &(vertex, entry) in &row.entries {
                let column = self.unknown_of[vertex as usize];
                if column as usize == unknown {
                    diagonal = entry;
                }
                if column == NONE {
                    chunk.held.push((unknown as u32, vertex, entry));
                } else {
                    chunk.columns.push(column);
                    chunk.entries.push(entry);
                }
            }
            if diagonal <= 0.0 {
                // A vertex whose triangles name nothing else and show nothing: any value will do.
                diagonal = 1.0;
                let at = chunk.columns.iter().rposition(|&c| c as usize == unknown);
                if let Some(at) = at {
                    chunk.entries[at] = diagonal;
                }
            }
            chunk.diagonal.push(diagonal);
            chunk.starts.push(chunk.columns.len() as u32);
        }
        chunk
    }

    /// Everything that couples one vertex to others: entries of its row by vertex.
    fn gather_row(&self, vertex: u32, row: &mut Accumulator) {
        let (mesh, alpha) = (self.mesh, f64::from(self.options.alpha));
        let ours = self.options.method == Method::Ours;
        let analytic = self.options.method == Method::LeastSquares { mass: Mass::Analytic };
        // Also at alpha 0, so that the structure is the same for every alpha.
        let regularizer = self.options.regularizer;
        let edge = matches!(regularizer, Regularizer::Edge | Regularizer::Both);
        row.start(vertex);
        for &t in self.fans.around(VertexId(vertex)) {
            let corners = mesh.triangles[t.index()].map(|v| v.0);
            let unit = self.sheets[self.sheet_of[t.index()] as usize].unit;
            let area = mesh.area(t);
            if analytic {
                for &a in corners.iter().filter(|&&a| a == vertex) {
                    corners.iter().for_each(|&b| row.add(b, area / 12.0));
                    row.add(a, area / 12.0);
                }
            } else {
                let mut sums = [0.0; 3];
                for seen in self.observed.in_triangle(t) {
                    let here = seen.weight * hat(mesh, t, vertex, seen.barycentric);
                    for (sum, b) in sums.iter_mut().zip(seen.barycentric) {
                        *sum += here * b;
                    }
                }
                for (&b, sum) in corners.iter().zip(sums) {
                    row.add(b, sum);
                }
            }
            let tie = GRAPH_TIE * (area / 3.0 + AREA_FLOOR * unit);
            for &b in corners.iter().filter(|&&b| b != vertex) {
                row.add(vertex, tie);
                row.add(b, -tie);
            }
            if matches!(regularizer, Regularizer::Gradient | Regularizer::Both) {
                row.add_element(&gradient(mesh, t), alpha);
            }
            if !(ours || edge || regularizer == Regularizer::EdgePrinted) {
                continue;
            }
            for e in 0..3 {
                let Some(flap) = Flap::across(mesh, self.adjacency, t, e) else { continue };
                // Where the vertex is in both triangles the flap is met twice.
                let in_both = vertex != flap.vertices[2] || vertex == flap.vertices[3];
                if in_both && !flap.is_owner() {
                    continue;
                }
                if regularizer == Regularizer::EdgePrinted
                    && let Some(element) = flap.printed(mesh)
                {
                    row.add_element(&element, alpha);
                }
                if (ours || edge)
                    && let Some(mut element) = flap.unfolded(mesh)
                {
                    let mut weight = if edge { alpha * element.weight } else { 0.0 };
                    if ours {
                        let deficit =
                            flap.vertices.iter().map(|&v| self.deficit[v as usize]).fold(0.0, f32::max);
                        let seen = self.observed.count(flap.first) + self.observed.count(flap.second);
                        let tie = EDGE_TIE * (ENOUGH / seen.max(1) as f64).powi(2).clamp(1e-3, 1.0);
                        weight +=
                            (tie + DAMPING * f64::from(deficit)) * element.weight + tie * AREA_FLOOR * unit;
                    }
                    element.weight = weight;
                    row.add_element(&element, 1.0);
                }
            }
        }
    }

    /// Factors the matrix, sheet by sheet, each by the solver that suits it.
    ///
    /// # Errors
    /// [`FitError::Unsolved`] where no solver works within the memory limit.
    pub fn factor(&mut self) -> Result<(), FitError> {
        let mut before = std::mem::take(&mut self.solvers);
        before.resize_with(self.sheets.len(), || SheetSolver::Empty);
        let places = |unknown: usize| self.mesh.positions[self.vertex_of[unknown] as usize];
        let context = Context { rows: &self.rows, options: &self.options, places: &places };
        self.solvers = self
            .sheets
            .par_iter()
            .zip(before)
            .map(|(sheet, before)| SheetSolver::new(&context, sheet, before))
            .collect::<Result<_, _>>()?;
        self.stale = false;
        Ok(())
    }

    /// The right-hand side of channels `channels`, unknown by unknown, for the difference to the sheet's mean.
    fn right_hand_side(&self, channels: Range<usize>) -> Vec<f64> {
        let width = channels.len();
        let all = self.observed.channels();
        let analytic = self.options.method == Method::LeastSquares { mass: Mass::Analytic };
        let mut rhs = vec![0.0; self.vertex_of.len() * width];
        rhs.par_chunks_mut(CHUNK * width).enumerate().for_each(|(c, part)| {
            for (r, out) in part.chunks_exact_mut(width).enumerate() {
                let vertex = self.vertex_of[c * CHUNK + r];
                let around = self.fans.around(VertexId(vertex));
                let sheet = self.sheet_of[around[0].index()] as usize;
                let means = &self.ranges[sheet * all..(sheet + 1) * all][channels.clone()];
                let (mut count, mut area, mut hats) = (0_usize, 0.0, 0.0);
                for &t in around {
                    area += self.mesh.area(t);
                    for seen in self.observed.in_triangle(t) {
                        let h = hat(self.mesh, t, vertex, seen.barycentric);
                        let weight = if analytic { h } else { seen.weight * h };
                        count += 1;
                        hats += h;
                        let values = &self.observed.values(seen.index)[channels.clone()];
                        for ((out, &value), mean) in out.iter_mut().zip(values).zip(means) {
                            *out += weight * (f64::from(value) - mean[0]);
                        }
                    }
                }
                if analytic && count > 0 {
                    // Eq. 14 with the mean put back, less the mean's share of the matrix: a vertex without
                    // observations is left at the mean instead of black.
                    let share = area / count as f64;
                    for (out, mean) in out.iter_mut().zip(means) {
                        *out = *out * share + mean[0] * (share * hats - area / 3.0);
                    }
                }
            }
            if let (Some(held), Some(chunk)) = (self.held, self.rows.chunks.get(c)) {
                for &(row, vertex, entry) in &chunk.held {
                    let t = self.fans.around(VertexId(vertex))[0];
                    let sheet = self.sheet_of[t.index()] as usize;
                    let at = (row as usize - c * CHUNK) * width;
                    for (k, channel) in channels.clone().enumerate() {
                        let given = f64::from(held.values[vertex as usize * all + channel]);
                        part[at + k] -= entry * (given - self.ranges[sheet * all + channel][0]);
                    }
                }
            }
        });
        rhs
    }

    /// Solves for all channels and applies the bounds.
    ///
    /// # Errors
    /// [`FitError::Unsolved`]. Factors the matrix if [`System::factor`] was not called.
    pub fn solve(&mut self) -> Result<Fit, FitError> {
        if self.stale {
            self.factor()?;
        }
        let channels = self.observed.channels();
        let mut report = self.report.clone();
        let mut values: Vec<f32> = Vec::with_capacity(self.mesh.vertex_count() * channels);
        for v in 0..self.mesh.vertex_count() {
            match self.held {
                Some(held) if held.vertices[v] => {
                    values.extend(&held.values[v * channels..(v + 1) * channels]);
                }
                _ => values.extend(self.neutral.iter().map(|&n| n as f32)),
            }
        }
        let optimum = matches!(self.options.bounds, Bounds::Optimum { .. });
        let wide = if self.vertex_of.len() > MANY_UNKNOWNS { FIRST_BLOCK } else { BLOCK };
        let mut from = 0;
        while from < channels {
            let block = from..channels.min(from + if from == 0 { FIRST_BLOCK } else { wide });
            from = block.end;
            let width = block.len();
            let mut solution = self.right_hand_side(block.clone());
            let rhs = if optimum { solution.clone() } else { Vec::new() };
            let mut parts = Vec::with_capacity(self.sheets.len());
            let mut rest = solution.as_mut_slice();
            for sheet in &self.sheets {
                let (part, tail) = rest.split_at_mut(sheet.unknowns().len() * width);
                parts.push(part);
                rest = tail;
            }
            let places = |unknown: usize| self.mesh.positions[self.vertex_of[unknown] as usize];
            let context = Context { rows: &self.rows, options: &self.options, places: &places };
            let iterations = parts
                .into_par_iter()
                .zip(self.sheets.par_iter().zip(&self.solvers))
                .map(|(part, (sheet, solver))| solver.solve(&context, sheet, part, width))
                .collect::<Result<Vec<_>, _>>()?;
            report.iterations = iterations.into_iter().fold(report.iterations, usize::max);
            self.write(&solution, block.clone(), &mut values, &mut report);
            if let Bounds::Optimum { low, high } = self.options.bounds {
                self.count_outside(&values, block.clone(), low, high, &mut report);
                self.bound(&rhs, &mut solution, block.clone(), low, high, &mut report);
                self.write(&solution, block, &mut values, &mut report);
            }
        }
        self.apply_bounds(&mut values, &mut report);
        for solver in &self.solvers {
            solver.count(&mut report);
        }
        let widest = channels.min(wide.max(FIRST_BLOCK));
        // Rows of columns and entries; factors; per unknown and channel the right-hand side and four vectors; fans,
        // deficits, numbers and the order of observations.
        report.memory_bytes = report.matrix_entries * 12
            + report.factor_entries * 8
            + self.vertex_of.len() * (8 * 5 * widest + 32)
            + self.mesh.vertex_count() * 16
            + self.mesh.triangle_count() * 20
            + self.observed.len() * 4;
        Ok(Fit { values, report })
    }

    /// Writes a block of solutions into the vertex values, with the guard against wild ones.
    fn write(&self, solution: &[f64], block: Range<usize>, values: &mut [f32], report: &mut FitReport) {
        let (channels, width) = (self.observed.channels(), block.len());
        for (s, sheet) in self.sheets.iter().enumerate() {
            let ranges = &self.ranges[s * channels..(s + 1) * channels][block.clone()];
            for unknown in sheet.unknowns() {
                let at = self.vertex_of[unknown] as usize * channels;
                let out = &mut values[at..at + channels][block.clone()];
                let found = &solution[unknown * width..(unknown + 1) * width];
                for ((out, &difference), &[mean, low, high]) in out.iter_mut().zip(found).zip(ranges) {
                    let value = mean + difference;
                    let reach = GUARD_RANGES * (high - low);
                    // Rounding of a constant is no shot.
                    let reach = reach.max(1e-6 * mean.abs());
                    let guarded =
                        if value.is_finite() { value.clamp(low - reach, high + reach) } else { mean };
                    report.guarded_values += usize::from(guarded != value);
                    *out = guarded as f32;
                }
            }
        }
    }

    /// Replaces a block of solutions by the optimum under bounds, sheet by sheet and channel by channel, where
    /// any value is outside.
    fn bound(
        &self,
        rhs: &[f64],
        solution: &mut [f64],
        block: Range<usize>,
        low: f32,
        high: f32,
        report: &mut FitReport,
    ) {
        let (channels, width) = (self.observed.channels(), block.len());
        let (low, high) = (f64::from(low), f64::from(high));
        let jobs: Vec<(usize, usize)> =
            (0..self.sheets.len()).flat_map(|s| (0..width).map(move |k| (s, k))).collect();
        let found: Vec<_> = jobs
            .par_iter()
            .map(|&(s, k)| {
                let column = |from: &[f64]| -> Vec<f64> {
                    self.sheets[s].unknowns().map(|u| from[u * width + k]).collect()
                };
                let mean = self.ranges[s * channels + block.start + k][0];
                let (low, high) = (low - mean, high - mean);
                let mut x = column(solution);
                if x.iter().all(|v| (low..=high).contains(v)) {
                    return (Vec::new(), 0, true, 0);
                }
                let (steps, met) =
                    optimum::minimize(&self.rows, &self.sheets[s], &column(rhs), &mut x, low, high);
                let active = x.iter().filter(|&&v| v <= low || v >= high).count();
                (x, steps, met, active)
            })
            .collect();
        for ((s, k), (x, steps, met, active)) in jobs.into_iter().zip(found) {
            report.optimum_steps = report.optimum_steps.max(steps);
            report.optimum_unmet += usize::from(!met);
            report.active_bounds += active;
            for (unknown, value) in self.sheets[s].unknowns().zip(x) {
                solution[unknown * width + k] = value;
            }
        }
    }

    fn count_outside(
        &self,
        values: &[f32],
        block: Range<usize>,
        low: f32,
        high: f32,
        report: &mut FitReport,
    ) {
        let channels = self.observed.channels();
        for &v in &self.vertex_of {
            for value in &values[v as usize * channels..(v as usize + 1) * channels][block.clone()] {
                report.below += usize::from(*value < low);
                report.above += usize::from(*value > high);
                report.farthest_outside = report.farthest_outside.max(low - *value).max(*value - high);
            }
        }
    }

    /// Clamps unknown values, or counts and leaves them.
    fn apply_bounds(&self, values: &mut [f32], report: &mut FitReport) {
        let Some((low, high)) = self.options.bounds.range() else { return };
        let channels = self.observed.channels();
        report.clamp_after_interpolation =
            matches!(self.options.bounds, Bounds::ClampAfterInterpolation { .. });
        if !matches!(self.options.bounds, Bounds::Optimum { .. }) {
            self.count_outside(values, 0..channels, low, high, report);
        }
        if !report.clamp_after_interpolation {
            for &v in &self.vertex_of {
                for value in &mut values[v as usize * channels..(v as usize + 1) * channels] {
                    *value = value.clamp(low, high);
                }
            }
        }
    }
}

/// The hat function of a vertex at barycentric coordinates of a triangle that names it.
#[inline]
pub(crate) fn hat(mesh: &Mesh, triangle: TriangleId, vertex: u32, barycentric: [f64; 3]) -> f64 {
    let corners = mesh.triangles[triangle.index()];
    corners.iter().zip(barycentric).map(|(v, b)| if v.0 == vertex { b } else { 0.0 }).sum()
}

/// One row while it is gathered.
#[derive(Default)]
struct Accumulator {
    vertex: u32,
    entries: Vec<(u32, f64)>,
}

impl Accumulator {
    /// Rows up to this long are searched, longer ones sorted at the end.
    const SEARCHED: usize = 64;

    fn start(&mut self, vertex: u32) {
        self.vertex = vertex;
        self.entries.clear();
        self.entries.push((vertex, 0.0));
    }

    #[inline]
    fn add(&mut self, column: u32, entry: f64) {
        if self.entries.len() <= Self::SEARCHED
            && let Some(found) = self.entries.iter_mut().find(|e| e.0 == column)
        {
            found.1 += entry;
            return;
        }
        self.entries.push((column, entry));
    }

    /// Adds this row's share of `scale` times an element.
    #[inline]
    fn add_element(&mut self, element: &Element, scale: f64) {
        let mut here = glam::DVec3::ZERO;
        for (v, c) in element.vertices.iter().zip(element.coefficients) {
            if *v == self.vertex {
                here += c;
            }
        }
        here *= scale * element.weight;
        for (&v, c) in element.vertices.iter().zip(element.coefficients) {
            self.add(v, here.dot(c));
        }
    }

    /// Sorts by column and joins equal columns.
    fn finish(&mut self) {
        self.entries.sort_by_key(|e| e.0);
        self.entries.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 += later.1;
            }
            same
        });
    }
}

/// Checks everything that does not need the observations' order.
pub(crate) fn check(
    mesh: &Mesh,
    observations: &Observations<'_>,
    held: Option<&Held<'_>>,
    options: &FitOptions,
) -> Result<(), FitError> {
    let channels = observations.channels;
    if !(options.alpha.is_finite() && options.alpha >= 0.0) {
        return Err(FitError::Alpha { alpha: options.alpha });
    }
    if let Some((low, high)) = options.bounds.range()
        && !(low <= high)
    {
        return Err(FitError::Bounds { low, high });
    }
    if let Some(held) = held {
        let vertices = mesh.vertex_count();
        if held.vertices.len() != vertices || Some(held.values.len()) != vertices.checked_mul(channels) {
            return Err(FitError::Held {
                flags: held.vertices.len(),
                values: held.values.len(),
                vertices,
                channels,
            });
        }
        for vertex in (0..vertices).filter(|&v| held.vertices[v]) {
            if held.values[vertex * channels..(vertex + 1) * channels].iter().any(|v| !v.is_finite()) {
                return Err(FitError::HeldNotFinite { vertex });
            }
        }
    }
    Ok(())
}
