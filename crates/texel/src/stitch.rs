//! Stitching: texels along chart borders are solved for, so that both sides of a seam read the same.
//!
//! Schaefer 2012, section 4.2, clones values across chart borders and leaves what remains to dilation; section
//! 4.3 needs more: a vertex with several places in the atlas is read from any of them. Here the texels that
//! lookups along borders read are unknowns of one sparse least-squares problem per group of charts that meet:
//!
//! - each texel stays near what was shaded; loosely where it had to be extrapolated,
//! - a texel whose point is the end of the surface holds the lookup at that point to what was shaded there,
//! - both sides of a seam read the same at every half texel,
//! - all places of a light vertex read the same,
//! - points that the caller holds read what the caller says.

use crate::grid::Footprint;
use crate::lift::{ChartTexels, border_edges};
use crate::normal::NormalEquations;
use crate::observe::{Observations, refine};
use crate::prepare::{Shaded, prepare};
use crate::seams::{Place, Seam, Seams};
use crate::{TexelError, check_chart};
use glam::Vec2;
use lightkiln_chart::Chart;
use lightkiln_mesh::Mesh;
use rayon::prelude::*;

/// A point that must read a given value, for example along an edge to a color triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Hold {
    /// Index of the chart.
    pub chart: u32,
    /// In texels of the chart.
    pub uv: Vec2,
    /// One per channel.
    pub value: Vec<f32>,
    /// Relative to the 1 of a shaded texel.
    pub weight: f32,
}

/// What the stitch knows beside the values, and how strongly it pulls. `Default` is ours.
#[derive(Clone, Debug)]
pub struct StitchOptions<'a> {
    /// Per chart and texel: the lifted point was not inside other geometry. `None`: all are valid. Texels that
    /// are not, or hold NaN, are filled from those of their chart that are.
    pub valid: Option<&'a [Vec<bool>]>,
    /// Per chart and texel: variance of the shaded value. `None`: all the same.
    pub variances: Option<&'a [Vec<f32>]>,
    /// Prescribed lookups.
    pub holds: &'a [Hold],
    /// More values at points inside the charts: all texels are then fitted to them, in the sense of least
    /// squares, before borders are stitched.
    pub observations: Option<&'a Observations>,
    /// Pull of a half texel of seam, relative to the 1 of a shaded texel. Larger: less mismatch, more blur, for
    /// two grids that do not line up can agree along a whole seam only on what is linear there.
    pub seam_weight: f32,
    /// Pull between the places of a light vertex.
    pub vertex_weight: f32,
    /// Smallest and largest value that can be stored. Texels that would leave the range are held at its end, so
    /// that what is reported is what is stored.
    pub range: [f32; 2],
}

impl Default for StitchOptions<'_> {
    fn default() -> Self {
        Self {
            valid: None,
            variances: None,
            holds: &[],
            observations: None,
            seam_weight: 30.0,
            vertex_weight: 1e5,
            range: [f32::NEG_INFINITY, f32::INFINITY],
        }
    }
}

/// Largest and root mean square difference of two lookups that should be one; over channels, the largest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mismatch {
    /// Largest difference.
    pub max: f32,
    /// Root mean square difference; along seams, by length.
    pub rms: f32,
}

/// What stitching did. No number is NaN.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StitchReport {
    /// Groups of charts that were solved together.
    pub clusters: usize,
    /// Groups whose equations could not be solved; they keep their values. Not known to happen.
    pub unsolved: usize,
    /// Texels that were solved for.
    pub unknowns: usize,
    /// Seam edges of the mesh.
    pub seams: usize,
    /// Light vertices with several places that are made to agree: where color triangles meet the vertex, or no
    /// seam edge around it is shorter than 1.5 texels. The others are ends of short seam edges, and count there.
    pub shared_vertices: usize,
    /// Along seams, of the values as they came (after filling).
    pub seam_before: Mismatch,
    /// Along seams, at the end.
    pub seam_after: Mismatch,
    /// Between the places of each shared vertex, before.
    pub vertex_before: Mismatch,
    /// Between the places of each shared vertex, at the end.
    pub vertex_after: Mismatch,
    /// Texels that were not valid and took values of their neighbours.
    pub filled: usize,
    /// Texels that were not valid in charts without any valid texel.
    pub unfilled: usize,
    /// Root mean square of lookup minus observation, before and after the fit; 0 without observations.
    pub observed: [f32; 2],
}

// Weights, relative to the 1 of a texel that shows its own centre.
const BEYOND: f64 = 0.5; // the unfolded neighbour is not quite where the plane of the chart says
const EXTRAPOLATED: f64 = 0.02;
const FILLED: f64 = 0.02;
const PINNED: f64 = 1e6;
/// Texels that leave the range by more than this share of it are pinned: a step of 10 bits.
const PIN_SLACK: f32 = 1e-3;
/// Solutions at most; pins of one round may push other texels out of the range.
const ROUNDS: usize = 3;
/// Coefficients below this come from rounding of a point on the border.
const NEGLIGIBLE: f32 = 1e-6;

/// Makes the texels of all charts agree along seams; `values` is changed in place.
///
/// - `texels`: of [`crate::lift()`], one per chart
/// - `values`: per chart, texels x `channels`; entries of texels without a lift are ignored
/// - `channels`: at least 1
///
/// Memory: per cluster of charts, its sparse factor; borders are curves, so it stays near linear in their
/// length. The same bytes for any number of threads.
///
/// # Errors
/// [`TexelError`] where charts, texels, values and options do not fit each other.
pub fn stitch(
    mesh: &Mesh,
    charts: &[Chart],
    texels: &[ChartTexels],
    values: &mut [Vec<f32>],
    channels: usize,
    options: &StitchOptions,
) -> Result<StitchReport, TexelError> {
    check(mesh, charts, texels, values, channels, options)?;
    let seams = Seams::new(mesh, charts);
    let mut shaded: Vec<Shaded> = values
        .par_iter_mut()
        .enumerate()
        .map(|(c, values)| {
            let valid = options.valid.map(|v| &v[c][..]);
            prepare(&texels[c], values, channels, valid, options.variances.map(|v| &v[c][..]))
        })
        .collect();
    let mut report = StitchReport {
        seams: seams.edges.len(),
        shared_vertices: seams.exact.iter().filter(|&&exact| exact).count(),
        filled: shaded.iter().map(|s| s.filled).sum(),
        unfilled: shaded.iter().map(|s| s.unfilled).sum(),
        ..StitchReport::default()
    };
    (report.seam_before, report.vertex_before) = mismatch(&seams, charts, values, channels);
    if let Some(observations) = options.observations {
        report.observed = refine(texels, values, channels, &mut shaded, observations);
    }
    let clusters = clusters(charts.len(), &seams, options.holds);
    report.clusters = clusters.len();
    let input = Input { charts, texels, values, channels, shaded: &shaded, seams: &seams, options };
    let solved: Vec<Solved> = clusters.par_iter().map(|cluster| input.solve(cluster)).collect();
    for (cluster, solved) in clusters.iter().zip(&solved) {
        report.unknowns += solved.unknowns.len();
        let Some(changes) = &solved.changes else {
            report.unsolved += 1;
            continue;
        };
        for (&(slot, texel), change) in solved.unknowns.iter().zip(changes.chunks(channels)) {
            let values = &mut values[cluster.charts[slot as usize] as usize];
            for (value, change) in values[texel as usize * channels..].iter_mut().zip(change) {
                *value += change;
            }
        }
    }
    let [low, high] = options.range;
    values.par_iter_mut().for_each(|values| values.iter_mut().for_each(|v| *v = v.max(low).min(high)));
    (report.seam_after, report.vertex_after) = mismatch(&seams, charts, values, channels);
    Ok(report)
}

/// The bilinear value at each chart vertex: per chart, chart vertices x channels.
///
/// After [`stitch`], all places of a light vertex that color triangles share read the same; this is the value
/// that the vertex has there.
pub fn vertex_readback(charts: &[Chart], values: &[Vec<f32>], channels: usize) -> Vec<Vec<f32>> {
    let read = |(chart, values): (&Chart, &Vec<f32>)| {
        let mut out = vec![0.0; chart.uv.len() * channels];
        if values.len() == chart.size[0] as usize * chart.size[1] as usize * channels && !values.is_empty() {
            for (&uv, out) in chart.uv.iter().zip(out.chunks_mut(channels)) {
                crate::grid::lookup(chart.size, channels, values, uv, out);
            }
        }
        out
    };
    charts.par_iter().zip(values.par_iter()).map(read).collect()
}

fn check(
    mesh: &Mesh,
    charts: &[Chart],
    texels: &[ChartTexels],
    values: &[Vec<f32>],
    channels: usize,
    options: &StitchOptions,
) -> Result<(), TexelError> {
    let fits = |what: &'static str, chart: usize, found: usize, expected: usize| {
        if found == expected { Ok(()) } else { Err(TexelError::Length { what, chart, found, expected }) }
    };
    if channels == 0 {
        return Err(TexelError::Channels { channels });
    }
    fits("texels", charts.len(), texels.len(), charts.len())?;
    fits("values", charts.len(), values.len(), charts.len())?;
    if let Some(valid) = options.valid {
        fits("valid", charts.len(), valid.len(), charts.len())?;
    }
    if let Some(variances) = options.variances {
        fits("variances", charts.len(), variances.len(), charts.len())?;
    }
    for (c, chart) in charts.iter().enumerate() {
        check_chart(mesh, chart).map_err(|fault| TexelError::Chart { chart: c, fault })?;
        let count = chart.size[0] as usize * chart.size[1] as usize;
        fits("texels", c, texels[c].lift.len(), count)?;
        fits("values", c, values[c].len(), count * channels)?;
        if let Some(valid) = options.valid {
            fits("valid", c, valid[c].len(), count)?;
        }
        if let Some(variances) = options.variances {
            fits("variances", c, variances[c].len(), count)?;
        }
    }
    for (k, hold) in options.holds.iter().enumerate() {
        let known = (hold.chart as usize) < charts.len() && hold.value.len() == channels;
        let finite = hold.value.iter().all(|v| v.is_finite()) && hold.uv.is_finite();
        if !(known && finite && hold.weight >= 0.0 && hold.weight.is_finite()) {
            return Err(TexelError::Hold { hold: k });
        }
    }
    if let Some(observations) = options.observations {
        observations.check(charts.len(), channels)?;
    }
    Ok(())
}

/// Largest and mean difference along all seams, and between the places of all shared vertices.
fn mismatch(seams: &Seams, charts: &[Chart], values: &[Vec<f32>], channels: usize) -> (Mismatch, Mismatch) {
    let read = |chart: u32, uv: Vec2, channel: usize| {
        let c = chart as usize;
        Footprint::new(charts[c].size, uv).read(&values[c], channels, channel)
    };
    let mut sums = [(0.0_f32, 0.0_f64, 0.0_f64); 2];
    let mut add = |k: usize, difference: f32, share: f64| {
        let (max, sum, total) = &mut sums[k];
        *max = max.max(difference);
        *sum += share * f64::from(difference).powi(2);
        *total += share;
    };
    let widest = |a: (u32, Vec2), b: (u32, Vec2)| {
        (0..channels).map(|c| (read(a.0, a.1, c) - read(b.0, b.1, c)).abs()).fold(0.0, f32::max)
    };
    for seam in &seams.edges {
        let [left, right] = &seam.sides;
        for (t, share) in seam.points() {
            add(0, widest((left.chart, left.at(t)), (right.chart, right.at(t))), f64::from(share));
        }
    }
    for (group, _) in seams.groups().filter(|(_, exact)| *exact) {
        for place in &group[1..] {
            add(1, widest((group[0].chart, group[0].uv), (place.chart, place.uv)), 1.0);
        }
    }
    let [edges, vertices] = sums.map(|(max, sum, total)| Mismatch {
        max,
        rms: if total > 0.0 { (sum / total).sqrt() as f32 } else { 0.0 },
    });
    (edges, vertices)
}

/// Charts that seams, shared vertices or nothing connect, and what connects them.
#[derive(Default)]
struct Cluster {
    charts: Vec<u32>,
    seams: Vec<u32>,
    /// Ranges of `Seams::places` that must agree exactly.
    groups: Vec<(u32, u32)>,
    holds: Vec<u32>,
}

fn clusters(charts: usize, seams: &Seams, holds: &[Hold]) -> Vec<Cluster> {
    let mut parent: Vec<u32> = (0..charts as u32).collect();
    fn root(parent: &mut [u32], mut c: u32) -> u32 {
        while parent[c as usize] != c {
            parent[c as usize] = parent[parent[c as usize] as usize];
            c = parent[c as usize];
        }
        c
    }
    let mut join = |a: u32, b: u32| {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b) as usize] = a.min(b);
    };
    for seam in &seams.edges {
        join(seam.sides[0].chart, seam.sides[1].chart);
    }
    for (group, _) in seams.groups().filter(|(_, exact)| *exact) {
        group.iter().for_each(|place| join(group[0].chart, place.chart));
    }
    let mut number = vec![u32::MAX; charts];
    let mut clusters: Vec<Cluster> = Vec::new();
    for chart in 0..charts as u32 {
        let root = root(&mut parent, chart) as usize;
        if number[root] == u32::MAX {
            number[root] = clusters.len() as u32;
            clusters.push(Cluster::default());
        }
        number[chart as usize] = number[root];
        clusters[number[root] as usize].charts.push(chart);
    }
    for (k, seam) in seams.edges.iter().enumerate() {
        clusters[number[seam.sides[0].chart as usize] as usize].seams.push(k as u32);
    }
    let mut first = 0;
    for (group, exact) in seams.groups() {
        let end = first + group.len() as u32;
        if exact {
            clusters[number[group[0].chart as usize] as usize].groups.push((first, end));
        }
        first = end;
    }
    for (k, hold) in holds.iter().enumerate() {
        clusters[number[hold.chart as usize] as usize].holds.push(k as u32);
    }
    clusters
}

struct Input<'a> {
    charts: &'a [Chart],
    texels: &'a [ChartTexels],
    values: &'a [Vec<f32>],
    channels: usize,
    shaded: &'a [Shaded],
    seams: &'a Seams,
    options: &'a StitchOptions<'a>,
}

/// The texels of a cluster that were solved for, and what to add to them; `None` where that failed.
struct Solved {
    /// Slot in the cluster's charts, and texel.
    unknowns: Vec<(u32, u32)>,
    changes: Option<Vec<f32>>,
}

/// One equation: a combination of lookups, its weight, and what it should be (nothing: zero).
struct Row<'a> {
    /// Slot in the cluster's charts, place, sign.
    lookups: &'a [(u32, Vec2, f32)],
    weight: f32,
    target: Option<&'a [f32]>,
}

impl Input<'_> {
    fn solve(&self, cluster: &Cluster) -> Solved {
        let mut unknown: Vec<Vec<u32>> =
            cluster.charts.iter().map(|&c| vec![u32::MAX; self.texels[c as usize].len()]).collect();
        let size = |slot: u32| self.charts[cluster.charts[slot as usize] as usize].size;
        // Which texels do the equations and the borders read?
        let mut mark = |slot: u32, uv: Vec2| {
            let footprint = Footprint::new(size(slot), uv);
            for (texel, weight) in footprint.texels.into_iter().zip(footprint.weights) {
                if weight > NEGLIGIBLE {
                    unknown[slot as usize][texel as usize] = 0;
                }
            }
        };
        self.rows(cluster, &mut |row| row.lookups.iter().for_each(|&(slot, uv, _)| mark(slot, uv)));
        for (slot, &c) in cluster.charts.iter().enumerate() {
            self.border_points(c as usize, &mut |uv| mark(slot as u32, uv));
        }
        let mut unknowns = Vec::new();
        for (slot, numbers) in unknown.iter_mut().enumerate() {
            let lift = &self.texels[cluster.charts[slot] as usize].lift;
            for (texel, number) in numbers.iter_mut().enumerate() {
                // Only holds outside the chart read texels that are not shown.
                if *number == 0 && lift[texel].is_some() {
                    *number = unknowns.len() as u32;
                    unknowns.push((slot as u32, texel as u32));
                } else {
                    *number = u32::MAX;
                }
            }
        }
        if unknowns.is_empty() {
            return Solved { unknowns, changes: Some(Vec::new()) };
        }
        // Values that leave the range are pinned to its end and the others solved for again, so that clamping
        // does not undo the agreement.
        let mut pins = vec![f32::NAN; unknowns.len() * self.channels];
        let mut changes = self.changes(cluster, &unknown, &unknowns, &pins);
        for _ in 1..ROUNDS {
            match &changes {
                Some(found) if self.pin(cluster, &unknowns, found, &mut pins) => {
                    changes = self.changes(cluster, &unknown, &unknowns, &pins);
                }
                _ => break,
            }
        }
        Solved { unknowns, changes }
    }

    /// Pins the texels that leave the range, all channels at once, to the nearest change that does not: per
    /// unknown and channel, NaN where there is no pin. Returns whether there is a new one.
    fn pin(&self, cluster: &Cluster, unknowns: &[(u32, u32)], changes: &[f32], pins: &mut [f32]) -> bool {
        let [low, high] = self.options.range;
        let slack = PIN_SLACK * (high - low);
        let mut any = false;
        for (k, &(slot, texel)) in unknowns.iter().enumerate() {
            let own = k * self.channels..(k + 1) * self.channels;
            let (changes, pins) = (&changes[own.clone()], &mut pins[own]);
            let values =
                &self.values[cluster.charts[slot as usize] as usize][texel as usize * self.channels..];
            let leaves = |(value, change): (&f32, &f32)| {
                let sum = value + change;
                sum > high + slack || sum < low - slack
            };
            if pins[0].is_nan() && values.iter().zip(changes).any(leaves) {
                for ((pin, change), value) in pins.iter_mut().zip(changes).zip(values) {
                    *pin = (value + change).max(low).min(high) - value;
                }
                any = true;
            }
        }
        any
    }

    /// Solves for the changes of the unknowns: unknowns x channels.
    fn changes(
        &self,
        cluster: &Cluster,
        unknown: &[Vec<u32>],
        unknowns: &[(u32, u32)],
        pins: &[f32],
    ) -> Option<Vec<f32>> {
        let size = |slot: u32| self.charts[cluster.charts[slot as usize] as usize].size;
        // Unknowns are changes of the values, so that what agrees already stays to the last bit.
        let mut equations = NormalEquations::new(unknowns.len(), self.channels);
        for (k, &(slot, texel)) in unknowns.iter().enumerate() {
            let pins = &pins[k * self.channels..(k + 1) * self.channels];
            if pins[0].is_nan() {
                let weight = self.shaded[cluster.charts[slot as usize] as usize].weight(texel);
                equations.add(&[(k as u32, 1.0)], weight, |_| 0.0);
            } else {
                equations.add(&[(k as u32, 1.0)], PINNED, |c| f64::from(pins[c]));
            }
        }
        let mut terms: Vec<(u32, f64)> = Vec::new();
        let mut now = vec![0.0_f64; self.channels];
        self.rows(cluster, &mut |row| {
            terms.clear();
            now.fill(0.0);
            for &(slot, uv, sign) in row.lookups {
                let values = &self.values[cluster.charts[slot as usize] as usize];
                let footprint = Footprint::new(size(slot), uv);
                for (texel, weight) in footprint.texels.into_iter().zip(footprint.weights) {
                    if weight <= NEGLIGIBLE {
                        continue;
                    }
                    let number = unknown[slot as usize][texel as usize];
                    if number == u32::MAX {
                        return; // reads what is not shown
                    }
                    terms.push((number, f64::from(sign * weight)));
                    let texel = texel as usize * self.channels;
                    for (now, value) in now.iter_mut().zip(&values[texel..]) {
                        *now += f64::from(sign * weight) * f64::from(*value);
                    }
                }
            }
            let target = |c: usize| row.target.map_or(0.0, |t| f64::from(t[c])) - now[c];
            equations.add(&terms, f64::from(row.weight), target);
        });
        let solution = equations.solve()?;
        let entries = (0..unknowns.len()).flat_map(|k| (0..self.channels).map(move |c| (k, c)));
        Some(entries.map(|at| solution[at] as f32).collect())
    }

    /// Visits all equations of a cluster except those that keep a texel near its value.
    fn rows(&self, cluster: &Cluster, visit: &mut dyn FnMut(Row)) {
        let slot = |chart: u32| cluster.charts.partition_point(|&c| c < chart) as u32;
        for (s, &c) in cluster.charts.iter().enumerate() {
            let shaded = &self.shaded[c as usize];
            for (k, end) in shaded.ends.iter().enumerate() {
                let target = &shaded.end_values[k * self.channels..(k + 1) * self.channels];
                visit(Row { lookups: &[(s as u32, end.at, 1.0)], weight: end.weight, target: Some(target) });
            }
        }
        for &k in &cluster.seams {
            let Seam { sides: [left, right], .. } = &self.seams.edges[k as usize];
            for (t, share) in self.seams.edges[k as usize].points() {
                let lookups = [(slot(left.chart), left.at(t), 1.0), (slot(right.chart), right.at(t), -1.0)];
                visit(Row { lookups: &lookups, weight: self.options.seam_weight * share, target: None });
            }
        }
        for &(first, end) in &cluster.groups {
            let group: &[Place] = &self.seams.places[first as usize..end as usize];
            let lead = (slot(group[0].chart), group[0].uv, 1.0);
            for place in &group[1..] {
                let lookups = [lead, (slot(place.chart), place.uv, -1.0)];
                visit(Row { lookups: &lookups, weight: self.options.vertex_weight, target: None });
            }
        }
        for &k in &cluster.holds {
            let hold = &self.options.holds[k as usize];
            let lookups = [(slot(hold.chart), hold.uv, 1.0)];
            visit(Row { lookups: &lookups, weight: hold.weight, target: Some(&hold.value) });
        }
    }

    /// Points at most half a texel apart along the border of a chart.
    fn border_points(&self, c: usize, visit: &mut dyn FnMut(Vec2)) {
        let chart = &self.charts[c];
        for (local, edge) in border_edges(chart) {
            let corners = chart.corners[local as usize];
            let [a, b] =
                [corners[edge as usize], corners[(edge as usize + 1) % 3]].map(|v| chart.uv[v as usize]);
            let count = (2.0 * a.distance(b)).ceil().max(1.0) as u32;
            (0..=count).for_each(|k| visit(a + (b - a) * (k as f32 / count as f32)));
        }
    }
}

impl Shaded {
    /// How strongly a texel keeps its value.
    fn weight(&self, texel: u32) -> f64 {
        use crate::prepare::Trust;
        let confidence = self.confidence.get(texel as usize).map_or(1.0, |&w| f64::from(w));
        match self.trust[texel as usize] {
            Trust::Centre => confidence,
            Trust::Beyond => BEYOND * confidence,
            Trust::Extrapolated => EXTRAPOLATED,
            Trust::Filled => FILLED,
        }
    }
}
