//! Unknowns, the normal matrix in compressed rows, and right-hand sides.
//!
//! The energy of the default is, over light vertices `x`,
//!
//! ```text
//!   Σ_p w_p (f_p - g_x(p))²            the data: Schaefer eq. 2, Kavan eq. 3
//! + alpha R(x)                         the regularizer of the options: Kavan eq. 9
//! + DAMPING Σ_flaps max(d, t) E       our edge term, free for linear functions
//! + GRAPH_TIE Σ_edges a (x_i - x_j)²   what is left: one triangle with one observation
//! ```
//!
//! where `d` is how much less a flap's vertices see than their area should show them: 0 where every vertex
//! sees at least [`SEEN_SHARE`] of `a / 6`, 1 where one sees nothing. A vertex whose only observation lies
//! far from it is thus continued linearly from its neighbours rather than shot through that observation. And
//! `t = (ENOUGH / n)³` where the two triangles share `n` observations: vertices that see enough each may see
//! too little together, and there noise would grow without bound. Where triangles are larger than the sample
//! spacing `t` is nothing; where they are smaller no sample could tell their neighbours apart.
//! Constants come out exact because each sheet is solved for the difference to its mean; linear functions
//! cost only the last term, which is ten orders below the data.
//!
//! Rows are gathered vertex by vertex from the triangles around, in parallel and without maps.

use std::ops::Range;

use lightkiln_mesh::{Adjacency, Fans, Mesh, TriangleId, VertexId, sheets};
use pulp::Arch;
use rayon::prelude::*;

use crate::assembly::Rows;
use crate::observations::ByTriangle;
use crate::solve::{Context, SheetSolver};
use crate::{Bounds, Fit, FitError, FitOptions, FitReport, Held, Mass, Method, Observations};

/// Weight of the edge term around a vertex that sees nothing, and between triangles that share [`ENOUGH`]
/// observations or fewer.
pub const DAMPING: f64 = 0.1;
/// Observations in two neighbouring triangles from which on the edge term fades, with the third power of their number.
pub const ENOUGH: f64 = 2.0;
/// What the edge term never falls below.
pub const EDGE_TIE: f64 = 1e-6;
/// A vertex that sees this share of its expected mass needs no damping.
pub const SEEN_SHARE: f64 = 0.1;
/// Weight of the differences along edges that hold what even the edge term leaves open.
pub const GRAPH_TIE: f64 = 1e-10;
/// Share of a sheet's mean triangle area that stands in where a triangle has none.
pub(crate) const AREA_FLOOR: f64 = 1e-3;
/// How many ranges beyond the observations of its sheet a value may lie.
pub(crate) const GUARD_RANGES: f64 = 2.0;
/// Rows gathered at a time by one thread.
pub(crate) const CHUNK: usize = 2048;
/// Channels solved at a time: first few, which measure the spectrum, then many.
const FIRST_BLOCK: usize = 4;
const BLOCK: usize = 16;
/// Unknowns beyond which memory for many channels at a time is dear.
const MANY_UNKNOWNS: usize = 3_000_000;
/// A vertex that is not solved for.
pub(crate) const NONE: u32 = u32::MAX;

/// One sheet's share of the unknowns and what is known of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sheet {
    pub first: u32,
    pub last: u32,
    /// Mean area of its triangles; positive.
    pub unit: f64,
}

impl Sheet {
    pub fn unknowns(&self) -> Range<usize> {
        self.first as usize..self.last as usize
    }
}

/// Neighbouring triangles of one sheet, and what they see.
struct Run {
    sheet: u32,
    area: f64,
    triangles: usize,
    degenerate: usize,
    unseen: usize,
    weight: f64,
    /// By channel: weighted sum, smallest and largest observation.
    ranges: Vec<[f64; 3]>,
}

/// A fit in the making: the assembled matrix, its factors, and everything a right-hand side needs.
///
/// `alpha` can change between solves: the structure and symbolic factors stay.
pub struct System<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) adjacency: &'a Adjacency,
    pub(crate) fans: Fans,
    pub(crate) observed: ByTriangle<'a>,
    pub(crate) held: Option<&'a Held<'a>>,
    pub(crate) options: FitOptions,
    pub(crate) unknown_of: Vec<u32>,
    pub(crate) vertex_of: Vec<u32>,
    /// How much less than its share a vertex sees, 0..=1, by vertex.
    pub(crate) deficit: Vec<f32>,
    /// By triangle.
    pub(crate) sheet_of: Vec<u32>,
    pub(crate) sheets: Vec<Sheet>,
    /// Sheets × C: mean, smallest and largest observation.
    pub(crate) ranges: Vec<[f64; 3]>,
    pub(crate) neutral: Vec<f64>,
    pub(crate) rows: Rows,
    pub(crate) solvers: Vec<SheetSolver>,
    /// The solvers are those of another alpha.
    pub(crate) stale: bool,
    pub(crate) report: FitReport,
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
        let (mut degenerate, mut unseen) = (0, 0);
        let runs: Vec<Vec<Run>> = (0..mesh.triangle_count().div_ceil(CHUNK))
            .into_par_iter()
            .map(|c| self.runs(&sheet_of, c * CHUNK..((c + 1) * CHUNK).min(mesh.triangle_count())))
            .collect();
        for run in runs.into_iter().flatten() {
            let sheet = run.sheet as usize;
            area[sheet] += run.area;
            triangles[sheet] += run.triangles;
            degenerate += run.degenerate;
            unseen += run.unseen;
            weight[sheet] += run.weight;
            let all = &mut ranges[sheet * channels..(sheet + 1) * channels];
            for ((range, total), part) in all.iter_mut().zip(&mut total).zip(run.ranges) {
                range[0] += part[0];
                range[1] = range[1].min(part[1]);
                range[2] = range[2].max(part[2]);
                *total += part[0];
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
        for (v, &sheet) in sheet_of_vertex.iter().enumerate() {
            let sheet = sheet as usize;
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
        self.report.unseen_triangles = unseen;
        self.report.single_triangles = triangles.iter().filter(|&&n| n == 1).count();
        self.report.unknowns = vertex_of.len();
        self.report.sheets = list.iter().filter(|s| s.last > s.first).count();
        self.unknown_of = unknown_of;
        self.vertex_of = vertex_of;
        self.sheet_of = sheet_of;
        self.sheets = list;
        self.ranges = ranges;
        self.neutral = neutral;
    }

    /// What the triangles of a range say of their sheets, by runs of one sheet.
    fn runs(&self, sheet_of: &[u32], range: Range<usize>) -> Vec<Run> {
        let channels = self.observed.channels();
        let mut runs: Vec<Run> = Vec::new();
        for t in range.map(|t| TriangleId(t as u32)) {
            let sheet = sheet_of[t.index()];
            if runs.last().is_none_or(|run| run.sheet != sheet) {
                let ranges = vec![[0.0, f64::INFINITY, f64::NEG_INFINITY]; channels];
                runs.push(Run {
                    sheet,
                    area: 0.0,
                    triangles: 0,
                    degenerate: 0,
                    unseen: 0,
                    weight: 0.0,
                    ranges,
                });
            }
            let run = runs.last_mut().expect("one was just pushed");
            let area = self.mesh.area(t);
            run.area += area;
            run.triangles += 1;
            run.degenerate += usize::from(area <= 0.0);
            run.unseen += usize::from(self.observed.count(t) == 0);
            for seen in self.observed.in_triangle(t) {
                run.weight += seen.weight;
                for (range, &value) in run.ranges.iter_mut().zip(self.observed.values(seen.index)) {
                    let value = f64::from(value);
                    range[0] += seen.weight * value;
                    range[1] = range[1].min(value);
                    range[2] = range[2].max(value);
                }
            }
        }
        runs
    }

    /// What each vertex sees of what its area should show it.
    fn weigh(&mut self) {
        let coincident = (0..self.mesh.vertex_count() as u32)
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|&v| coincides(self.mesh, &self.fans, v));
        self.report.coincident_vertices = coincident.count();
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
        let arch = Arch::new();
        let mut rhs = vec![0.0; self.vertex_of.len() * width];
        rhs.par_chunks_mut(CHUNK * width).enumerate().for_each(|(c, part)| {
            // Channels of a fixed number are worked on together.
            match width {
                1 => self.project::<1>(arch, c, channels.start, part.as_chunks_mut().0),
                3 => self.project::<3>(arch, c, channels.start, part.as_chunks_mut().0),
                4 => self.project::<4>(arch, c, channels.start, part.as_chunks_mut().0),
                BLOCK => self.project::<BLOCK>(arch, c, channels.start, part.as_chunks_mut().0),
                _ => {
                    for (k, channel) in channels.clone().enumerate() {
                        let mut column = vec![[0.0]; part.len() / width];
                        self.project::<1>(arch, c, channel, &mut column);
                        part.iter_mut().skip(k).step_by(width).zip(column).for_each(|(out, [c])| *out = c);
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

    /// Chunk `c` of the right-hand side of `W` channels from `first`.
    fn project<const W: usize>(&self, arch: Arch, c: usize, first: usize, part: &mut [[f64; W]]) {
        let all = self.observed.channels();
        let analytic = self.options.method == Method::LeastSquares { mass: Mass::Analytic };
        for (r, out) in part.iter_mut().enumerate() {
            let vertex = self.vertex_of[c * CHUNK + r];
            let around = self.fans.around(VertexId(vertex));
            let sheet = self.sheet_of[around[0].index()] as usize;
            let ranges = &self.ranges[sheet * all + first..][..W];
            let means: [f64; W] = std::array::from_fn(|k| ranges[k][0]);
            let (mut count, mut area, mut hats) = (0_usize, 0.0, 0.0);
            arch.dispatch(|| {
                let mut sum = [0.0; W];
                for &t in around {
                    area += self.mesh.area(t);
                    for seen in self.observed.in_triangle(t) {
                        let h = hat(self.mesh, t, vertex, seen.barycentric);
                        let weight = if analytic { h } else { seen.weight * h };
                        count += 1;
                        hats += h;
                        let (values, _) = self.observed.values(seen.index)[first..].as_chunks::<W>();
                        for k in 0..W {
                            sum[k] += weight * (f64::from(values[0][k]) - means[k]);
                        }
                    }
                }
                *out = sum;
            });
            if analytic && count > 0 {
                // Eq. 14 with the mean put back, less the mean's share of the matrix: a vertex without
                // observations is left at the mean instead of black.
                let share = area / count as f64;
                for (out, mean) in out.iter_mut().zip(means) {
                    *out = *out * share + mean * (share * hats - area / 3.0);
                }
            }
        }
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
        // Vectors of the first channels in double precision, of those to come mostly in single precision beside a copy
        // of the matrix; then rows of columns and entries; factors; fans, deficits, numbers and the order of observations.
        let first = 8 * 5 * channels.min(FIRST_BLOCK);
        let later = (8 * 2 + 4 * 3) * (channels - channels.min(FIRST_BLOCK)).min(wide);
        let copies = if later > 0 && report.iterative_sheets > 0 { 8 } else { 0 };
        report.memory_bytes = report.matrix_entries * (12 + copies)
            + report.factor_entries * 8
            + self.vertex_of.len() * (first.max(later) + 32)
            + self.mesh.vertex_count() * 16
            + self.mesh.triangle_count() * 20
            + self.observed.len() * 4;
        Ok(Fit { values, report })
    }
}

/// Whether an edge of a vertex has no length.
pub(crate) fn coincides(mesh: &Mesh, fans: &Fans, vertex: u32) -> bool {
    let here = mesh.positions[vertex as usize];
    fans.around(VertexId(vertex)).iter().any(|t| {
        let corners = mesh.triangles[t.index()];
        // Once for the vertex itself.
        corners.iter().filter(|v| mesh.positions[v.index()] == here).count() > 1
    })
}

/// The hat function of a vertex at barycentric coordinates of a triangle that names it.
#[inline]
pub(crate) fn hat(mesh: &Mesh, triangle: TriangleId, vertex: u32, barycentric: [f64; 3]) -> f64 {
    let corners = mesh.triangles[triangle.index()];
    corners.iter().zip(barycentric).map(|(v, b)| if v.0 == vertex { b } else { 0.0 }).sum()
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
        && (low > high || low.is_nan() || high.is_nan())
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
