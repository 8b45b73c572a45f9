//! Conjugate gradients preconditioned by the diagonal with its pairs or by overlapping blocks, with measured convergence.
//!
//! Mass matrices of linear triangles have a condition, after division by the diagonal, that no triangle shape
//! can spoil (Wathen 1987), and our edge term is bounded by the mass around it: some 20 to 50 iterations then
//! suffice for meshes of any size. The Lanczos coefficients that conjugate gradients compute anyway bound the
//! smallest eigenvalue, hence the error: iteration stops when `max |M⁻¹ r| ≤ TOLERANCE λ_min max |x|`.
//!
//! Sums are taken over chunks of fixed size in a fixed order, so that any number of threads gives the same bytes.

use rayon::prelude::*;

use crate::assembly::Rows;
use crate::chebyshev::Spectrum;
use crate::pairs::Pairs;
use crate::system::Sheet;

/// Relative error, in the largest value, at which a solution is taken.
pub(crate) const TOLERANCE: f64 = 5e-7;
/// Unknowns worked on at a time.
pub(crate) const CHUNK: usize = 2048;

/// How one run of conjugate gradients ended.
pub(crate) enum Outcome {
    /// Converged in all channels.
    Converged {
        /// Iterations.
        iterations: usize,
        /// Of the preconditioned matrix.
        spectrum: Spectrum,
    },
    /// Not within the iterations allowed, or not on the way there.
    Stalled {
        /// Iterations.
        iterations: usize,
    },
}

/// What approximates the inverse.
#[derive(Clone, Copy)]
pub(crate) enum Preconditioned<'a> {
    /// The diagonal, and its pairs.
    Diagonal(&'a Pairs),
    Blocks(&'a dyn Preconditioner),
}

/// A symmetric positive definite approximation of the inverse.
pub(crate) trait Preconditioner: Sync {
    /// `z = M⁻¹ r` with `width` interleaved channels.
    fn apply(&self, r: &[f64], z: &mut [f64], width: usize);
}

/// Solves for `W` interleaved channels: `x` holds the right-hand side and becomes the solution, or is left as it was where
/// the iteration stalls.
pub(crate) fn solve(
    rows: &Rows,
    sheet: &Sheet,
    by: Preconditioned<'_>,
    x: &mut [f64],
    width: usize,
    limit: usize,
) -> Outcome {
    match width {
        1 => run::<1>(rows, sheet, by, x, limit),
        2 => run::<2>(rows, sheet, by, x, limit),
        3 => run::<3>(rows, sheet, by, x, limit),
        4 => run::<4>(rows, sheet, by, x, limit),
        5 => run::<5>(rows, sheet, by, x, limit),
        6 => run::<6>(rows, sheet, by, x, limit),
        7 => run::<7>(rows, sheet, by, x, limit),
        8 => run::<8>(rows, sheet, by, x, limit),
        _ => Outcome::Stalled { iterations: 0 },
    }
}

type Sums<const W: usize> = [f64; W];

fn add<const W: usize>(parts: Vec<Sums<W>>) -> Sums<W> {
    parts.into_iter().fold([0.0; W], |mut sum, part| {
        sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        sum
    })
}

fn run<const W: usize>(
    rows: &Rows,
    sheet: &Sheet,
    by: Preconditioned<'_>,
    rhs: &mut [f64],
    limit: usize,
) -> Outcome {
    let unknowns = sheet.unknowns();
    let (first, n) = (unknowns.start, unknowns.len());
    let (rhs, _) = rhs.as_chunks_mut::<W>();
    let inverse_diagonal: Vec<f64> =
        unknowns.into_par_iter().with_min_len(CHUNK).map(|u| 1.0 / rows.diagonal(u)).collect();
    let mut x: Vec<Sums<W>> = vec![[0.0; W]; n];
    let mut r = rhs.to_vec();
    let mut q = vec![[0.0; W]; n];
    let mut z: Vec<Sums<W>> = match by {
        Preconditioned::Diagonal(_) => Vec::new(),
        Preconditioned::Blocks(_) => vec![[0.0; W]; n],
    };
    let mut p = vec![[0.0; W]; n];
    let mut rho = [1.0; W];
    let mut lanczos: Vec<(Sums<W>, Sums<W>)> = Vec::new();
    let mut history: Vec<f64> = Vec::new();
    for iteration in 0..=limit {
        // z = M⁻¹ r and r·z; the largest entry of z measures what is left.
        let parts: Vec<(Sums<W>, Sums<W>, Sums<W>)> = match by {
            Preconditioned::Diagonal(pairs) => r
                .par_chunks(CHUNK)
                .zip(x.par_chunks(CHUNK))
                .zip(inverse_diagonal.par_chunks(CHUNK))
                .enumerate()
                .map(|(c, ((part, x), d))| {
                    let (mut dot, mut step, mut size) = ([0.0; W], [0.0_f64; W], [0.0_f64; W]);
                    for ((r, x), d) in part.iter().zip(x).zip(d) {
                        for k in 0..W {
                            dot[k] += r[k] * r[k] * d;
                            step[k] = step[k].max((r[k] * d).abs());
                            size[k] = size[k].max(x[k].abs());
                        }
                    }
                    for pair in pairs.of(c) {
                        let own = &r[pair.row as usize];
                        let beyond = pair.beyond(own, &r[pair.partner as usize]);
                        let d = inverse_diagonal[pair.row as usize];
                        for k in 0..W {
                            dot[k] += own[k] * beyond[k];
                            step[k] = step[k].max((own[k] * d + beyond[k]).abs());
                        }
                    }
                    (dot, step, size)
                })
                .collect(),
            Preconditioned::Blocks(blocks) => {
                blocks.apply(r.as_flattened(), z.as_flattened_mut(), W);
                r.par_chunks(CHUNK)
                    .zip(x.par_chunks(CHUNK))
                    .zip(z.par_chunks(CHUNK))
                    .map(|((r, x), z)| {
                        let (mut dot, mut step, mut size) = ([0.0; W], [0.0_f64; W], [0.0_f64; W]);
                        for ((r, x), z) in r.iter().zip(x).zip(z) {
                            for k in 0..W {
                                dot[k] += r[k] * z[k];
                                step[k] = step[k].max(z[k].abs());
                                size[k] = size[k].max(x[k].abs());
                            }
                        }
                        (dot, step, size)
                    })
                    .collect()
            }
        };
        let (mut new_rho, mut step, mut size) = ([0.0; W], [0.0_f64; W], [0.0_f64; W]);
        for part in parts {
            for k in 0..W {
                new_rho[k] += part.0[k];
                step[k] = step[k].max(part.1[k]);
                size[k] = size[k].max(part.2[k]);
            }
        }
        if new_rho.iter().chain(&step).any(|v| !v.is_finite()) {
            return Outcome::Stalled { iterations: iteration };
        }
        let near = |k: usize, least: f64| step[k] <= TOLERANCE * least * size[k] || step[k] == 0.0;
        if (0..W).all(|k| near(k, 1.0)) {
            let spectra: [Spectrum; W] =
                std::array::from_fn(|k| extremes(lanczos.iter().map(|l| (l.0[k], l.1[k]))));
            if (0..W).all(|k| near(k, spectra[k].least.min(1.0))) {
                rhs.copy_from_slice(&x);
                let least = spectra.iter().fold(f64::INFINITY, |m, s| m.min(s.least));
                let most = spectra.iter().fold(0.0, |m: f64, s| m.max(s.most));
                return Outcome::Converged { iterations: iteration, spectrum: Spectrum { least, most } };
            }
        }
        // Give up early where the rate so far does not lead there.
        history.push((0..W).map(|k| if size[k] > 0.0 { step[k] / size[k] } else { 0.0 }).fold(0.0, f64::max));
        if iteration >= 40 && iteration % 20 == 0 {
            let (before, now) = (history[iteration / 2], history[iteration]);
            let rate = (now / before).ln() / (iteration - iteration / 2) as f64;
            let needed = (TOLERANCE * 0.05 / now).ln() / rate;
            if !(rate < 0.0 && needed < (limit - iteration) as f64 * 1.5) {
                return Outcome::Stalled { iterations: iteration };
            }
        }
        if iteration == limit {
            break;
        }
        let mut beta = [0.0; W];
        for k in 0..W {
            beta[k] = if iteration > 0 && rho[k] > 0.0 { new_rho[k] / rho[k] } else { 0.0 };
        }
        rho = new_rho;
        match by {
            Preconditioned::Diagonal(pairs) => p
                .par_chunks_mut(CHUNK)
                .zip(r.par_chunks(CHUNK))
                .zip(inverse_diagonal.par_chunks(CHUNK))
                .enumerate()
                .for_each(|(c, ((p, part), d))| {
                    for ((p, r), d) in p.iter_mut().zip(part).zip(d) {
                        for k in 0..W {
                            p[k] = r[k] * d + beta[k] * p[k];
                        }
                    }
                    for pair in pairs.of(c) {
                        let row = pair.row as usize;
                        let beyond = pair.beyond(&r[row], &r[pair.partner as usize]);
                        for k in 0..W {
                            p[row - c * CHUNK][k] += beyond[k];
                        }
                    }
                }),
            Preconditioned::Blocks(_) => {
                p.par_chunks_mut(CHUNK).zip(z.par_chunks(CHUNK)).for_each(|(p, z)| {
                    for (p, z) in p.iter_mut().zip(z) {
                        for k in 0..W {
                            p[k] = z[k] + beta[k] * p[k];
                        }
                    }
                })
            }
        }
        let curvature = add(q
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(c, q)| {
                let mut dot = [0.0; W];
                for (i, q) in q.iter_mut().enumerate() {
                    let i = c * CHUNK + i;
                    let (columns, entries) = rows.row(first + i);
                    let mut sum = [0.0; W];
                    for (&column, &entry) in columns.iter().zip(entries) {
                        let other = &p[column as usize - first];
                        for k in 0..W {
                            sum[k] += entry * other[k];
                        }
                    }
                    for k in 0..W {
                        dot[k] += sum[k] * p[i][k];
                    }
                    *q = sum;
                }
                dot
            })
            .collect());
        let mut alpha = [0.0; W];
        for k in 0..W {
            alpha[k] = if curvature[k] > 0.0 { rho[k] / curvature[k] } else { 0.0 };
        }
        lanczos.push((alpha, beta));
        x.par_chunks_mut(CHUNK)
            .zip(r.par_chunks_mut(CHUNK))
            .zip(p.par_chunks(CHUNK).zip(q.par_chunks(CHUNK)))
            .for_each(|((x, r), (p, q))| {
                for ((x, r), (p, q)) in x.iter_mut().zip(r).zip(p.iter().zip(q)) {
                    for k in 0..W {
                        x[k] += alpha[k] * p[k];
                        r[k] -= alpha[k] * q[k];
                    }
                }
            });
    }
    Outcome::Stalled { iterations: limit }
}

/// The smallest and largest eigenvalue of the Lanczos matrix of conjugate gradients with steps `(alpha, beta)`,
/// by bisection on the signs of pivots.
fn extremes(steps: impl Iterator<Item = (f64, f64)>) -> Spectrum {
    let mut diagonal: Vec<f64> = Vec::new();
    let mut off2: Vec<f64> = Vec::new();
    let mut last = 0.0;
    for (alpha, beta) in steps {
        if alpha <= 0.0 {
            break;
        }
        if last > 0.0 {
            diagonal.push(1.0 / alpha + beta / last);
            off2.push(beta / (last * last));
        } else {
            diagonal.push(1.0 / alpha);
            off2.push(0.0);
        }
        last = alpha;
    }
    if diagonal.is_empty() {
        return Spectrum { least: 1.0, most: 1.0 };
    }
    let pivots = |shift: f64, wanted: fn(f64) -> bool| {
        let mut pivot = 1.0;
        diagonal.iter().zip(&off2).all(|(&d, &o)| {
            pivot = d - shift - o / pivot;
            wanted(pivot)
        })
    };
    let (mut low, mut high) = (0.0, diagonal.iter().copied().fold(f64::INFINITY, f64::min));
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if pivots(middle, |p| p > 0.0) { low = middle } else { high = middle }
    }
    let least = high.max(1e-12);
    let reach = |i: usize| off2[i].sqrt() + off2.get(i + 1).map_or(0.0, |o| o.sqrt());
    low = diagonal.iter().copied().fold(0.0, f64::max);
    high = (0..diagonal.len()).map(|i| diagonal[i] + reach(i)).fold(low, f64::max);
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if pivots(middle, |p| p < 0.0) { high = middle } else { low = middle }
    }
    Spectrum { least, most: high }
}
