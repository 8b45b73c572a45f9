//! From solutions to vertex values: the guard against wild ones, and the bounds.

use std::ops::Range;

use lightkiln_mesh::VertexId;
use rayon::prelude::*;

use crate::optimum;
use crate::system::{CHUNK, GUARD_RANGES, NONE, System};
use crate::{Bounds, FitReport};

impl System<'_> {
    /// Writes a block of solutions into the vertex values, with the guard against wild ones.
    pub(crate) fn write(
        &self,
        solution: &[f64],
        block: Range<usize>,
        values: &mut [f32],
        report: &mut FitReport,
    ) {
        let (channels, width) = (self.observed.channels(), block.len());
        let guarded: Vec<usize> = values
            .par_chunks_mut(CHUNK * channels)
            .enumerate()
            .map(|(c, values)| {
                let mut guarded = 0;
                for (i, out) in values.chunks_exact_mut(channels).enumerate() {
                    let vertex = c * CHUNK + i;
                    let unknown = self.unknown_of[vertex];
                    if unknown == NONE {
                        continue;
                    }
                    let t = self.fans.around(VertexId(vertex as u32))[0];
                    let sheet = self.sheet_of[t.index()] as usize;
                    let ranges = &self.ranges[sheet * channels..(sheet + 1) * channels][block.clone()];
                    let found = &solution[unknown as usize * width..][..width];
                    for ((out, &difference), &[mean, low, high]) in
                        out[block.clone()].iter_mut().zip(found).zip(ranges)
                    {
                        let value = mean + difference;
                        let reach = GUARD_RANGES * (high - low);
                        // Rounding of a constant is no shot.
                        let reach = reach.max(1e-6 * mean.abs());
                        let kept =
                            if value.is_finite() { value.clamp(low - reach, high + reach) } else { mean };
                        guarded += usize::from(kept != value);
                        *out = kept as f32;
                    }
                }
                guarded
            })
            .collect();
        report.guarded_values += guarded.into_iter().sum::<usize>();
    }

    /// Replaces a block of solutions by the optimum under bounds, sheet by sheet and channel by channel, where
    /// any value is outside.
    pub(crate) fn bound(
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

    pub(crate) fn count_outside(
        &self,
        values: &[f32],
        block: Range<usize>,
        low: f32,
        high: f32,
        report: &mut FitReport,
    ) {
        let channels = self.observed.channels();
        for &v in &self.vertex_of {
            for &value in &values[v as usize * channels..(v as usize + 1) * channels][block.clone()] {
                report.count_outside(value, low, high);
            }
        }
    }

    /// Clamps unknown values, or counts and leaves them.
    pub(crate) fn apply_bounds(&self, values: &mut [f32], report: &mut FitReport) {
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
