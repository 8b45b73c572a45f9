//! The least-squares optimum under bounds: the quadratic program that Kavan 3.3 names and does not solve.
//!
//! Modified proportioning with reduced gradient projections (Dostál and Schöberl 2005): conjugate gradients
//! within a face of the box, projected steps that change faces, and a step along the chopped gradient where
//! leaving bounds promises more. It converges for every symmetric positive definite matrix at a rate that depends
//! on its condition only, which scaling by the diagonal makes small here, and a box stays a box under it.

use rayon::prelude::*;

use crate::assembly::Rows;
use crate::system::Sheet;

/// The scaled projected gradient at which the optimum is taken, relative to the range of bounds or values: far below the 1e-6 that
/// the conditions are tested to.
const TOLERANCE: f64 = 1e-8;
/// Steps after which the best feasible point is taken.
const LIMIT: usize = 4000;
/// Rows multiplied at a time.
const CHUNK: usize = 2048;

/// The matrix scaled to a unit diagonal.
struct Scaled<'a> {
    rows: &'a Rows,
    first: usize,
    scale: Vec<f64>,
}

impl Scaled<'_> {
    fn multiply(&self, x: &[f64], out: &mut [f64]) {
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, out)| {
            for (i, out) in out.iter_mut().enumerate() {
                let i = c * CHUNK + i;
                let (columns, entries) = self.rows.row(self.first + i);
                let mut sum = 0.0;
                for (&column, entry) in columns.iter().zip(entries) {
                    let j = column as usize - self.first;
                    sum += entry * self.scale[j] * x[j];
                }
                *out = sum * self.scale[i];
            }
        });
    }

    /// Gershgorin's bound of the largest eigenvalue.
    fn norm(&self) -> f64 {
        (0..self.scale.len()).fold(1.0, |most, i| {
            let (columns, entries) = self.rows.row(self.first + i);
            let sum: f64 = columns
                .iter()
                .zip(entries)
                .map(|(&c, e)| e.abs() * self.scale[c as usize - self.first])
                .sum();
            f64::max(most, sum * self.scale[i])
        })
    }
}

/// The part of a gradient that moves within the box: free where inside, and inward at a bound.
struct Split {
    free: Vec<f64>,
    chopped: Vec<f64>,
    /// Squared norm of `chopped`.
    chopped2: f64,
    /// `free` times what a step of fixed length leaves of it.
    reduced: f64,
    /// Largest entry of either, in units of the unscaled values.
    largest: f64,
}

fn split(x: &[f64], g: &[f64], low: &[f64], high: &[f64], scale: &[f64], step: f64) -> Split {
    let n = x.len();
    let mut s =
        Split { free: vec![0.0; n], chopped: vec![0.0; n], chopped2: 0.0, reduced: 0.0, largest: 0.0 };
    for i in 0..n {
        let part = if x[i] <= low[i] {
            s.chopped[i] = g[i].min(0.0);
            s.chopped2 += s.chopped[i] * s.chopped[i];
            s.chopped[i]
        } else if x[i] >= high[i] {
            s.chopped[i] = g[i].max(0.0);
            s.chopped2 += s.chopped[i] * s.chopped[i];
            s.chopped[i]
        } else {
            s.free[i] = g[i];
            let room = if g[i] > 0.0 { (x[i] - low[i]) / step } else { (high[i] - x[i]) / step };
            s.reduced += g[i].abs() * g[i].abs().min(room);
            g[i]
        };
        s.largest = s.largest.max((part * scale[i]).abs());
    }
    s
}

/// Minimises `½ xᵀ A x - bᵀ x` over `low..=high` from a start `x`, which becomes the minimum.
///
/// Returns the steps taken, and whether the tolerance was met.
pub(crate) fn minimize(
    rows: &Rows,
    sheet: &Sheet,
    b: &[f64],
    x: &mut [f64],
    low: f64,
    high: f64,
) -> (usize, bool) {
    let unknowns = sheet.unknowns();
    let matrix = Scaled {
        rows,
        first: unknowns.start,
        scale: unknowns.map(|u| 1.0 / rows.diagonal(u).sqrt()).collect(),
    };
    let n = x.len();
    // Light has no upper bound: then the values themselves say what is small.
    let (least, most) = x.iter().fold((0.0_f64, 0.0_f64), |(l, m), &v| (l.min(v), m.max(v)));
    let goal = TOLERANCE * (high - low).min(most - least);
    let scale = &matrix.scale;
    let lows: Vec<f64> = scale.iter().map(|s| low / s).collect();
    let highs: Vec<f64> = scale.iter().map(|s| high / s).collect();
    let mut y: Vec<f64> = (0..n).map(|i| (x[i] / scale[i]).clamp(lows[i], highs[i])).collect();
    let b: Vec<f64> = b.iter().zip(scale).map(|(b, s)| b * s).collect();
    let step = 1.9 / matrix.norm();
    let mut g = vec![0.0; n];
    let gradient = |y: &[f64], g: &mut [f64]| {
        matrix.multiply(y, g);
        g.iter_mut().zip(&b).for_each(|(g, b)| *g -= b);
    };
    gradient(&y, &mut g);
    let mut parts = split(&y, &g, &lows, &highs, scale, step);
    let mut p = parts.free.clone();
    let mut ap = vec![0.0; n];
    let mut met = false;
    let mut steps = 0;
    while steps < LIMIT {
        if parts.largest <= goal {
            met = true;
            break;
        }
        steps += 1;
        let proportional = parts.chopped2 <= parts.reduced;
        let direction = if proportional { &p } else { &parts.chopped };
        matrix.multiply(direction, &mut ap);
        let curvature: f64 = direction.iter().zip(&ap).map(|(p, ap)| p * ap).sum();
        if curvature <= 0.0 {
            break;
        }
        let full = g.iter().zip(direction).map(|(g, p)| g * p).sum::<f64>() / curvature;
        let feasible = (0..n).fold(f64::INFINITY, |most, i| {
            let d = direction[i];
            let room = if d > 0.0 { (y[i] - lows[i]) / d } else { (y[i] - highs[i]) / d };
            if d == 0.0 { most } else { most.min(room.max(0.0)) }
        });
        let length = full.min(feasible);
        for i in 0..n {
            y[i] = (y[i] - length * direction[i]).clamp(lows[i], highs[i]);
            g[i] -= length * ap[i];
        }
        if proportional && full > feasible {
            // The step hits a bound: go there, then one projected step, and start conjugation afresh.
            let free = split(&y, &g, &lows, &highs, scale, step).free;
            for i in 0..n {
                y[i] = (y[i] - step * free[i]).clamp(lows[i], highs[i]);
            }
            gradient(&y, &mut g);
            parts = split(&y, &g, &lows, &highs, scale, step);
            p.copy_from_slice(&parts.free);
        } else {
            parts = split(&y, &g, &lows, &highs, scale, step);
            if proportional {
                let beta = parts.free.iter().zip(&ap).map(|(f, ap)| f * ap).sum::<f64>() / curvature;
                p.iter_mut().zip(&parts.free).for_each(|(p, f)| *p = f - beta * *p);
            } else {
                p.copy_from_slice(&parts.free);
            }
        }
    }
    for i in 0..n {
        // A bound met in scaled values is the bound itself, not its neighbour in rounding.
        x[i] = if y[i] <= lows[i] {
            low
        } else if y[i] >= highs[i] {
            high
        } else {
            (y[i] * scale[i]).clamp(low, high)
        };
    }
    (steps, met)
}
