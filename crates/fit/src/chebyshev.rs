//! Chebyshev iteration for many channels, once conjugate gradients have measured the spectrum.
//!
//! Conjugate gradients move ten vectors through memory in each step and wait for sums; Chebyshev's three-term
//! recurrence moves four and waits for none, and it may run in single precision because each round only corrects
//! the residual that double precision has measured (Saad 2003, algorithm 12.1; iterative refinement). The
//! result is taken by the same measure as that of conjugate gradients.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::assembly::Rows;
use crate::pcg::TOLERANCE;
use crate::system::Sheet;

/// Rows worked on at a time.
const CHUNK: usize = 2048;
/// What one round of single precision takes off the error.
const ROUND: f64 = 5e-5;
/// Rounds before the channel is given back to conjugate gradients.
const ROUNDS: usize = 6;

/// Smallest and largest eigenvalue of `D⁻¹ A`, as conjugate gradients found them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spectrum {
    pub least: f64,
    pub most: f64,
}

/// `D⁻¹ A` in single precision with columns counted from the sheet's first.
struct Chunk {
    starts: Vec<u32>,
    entries: Vec<(u32, f32)>,
}

/// What many channels of one sheet share.
pub(crate) struct Chebyshev {
    spectrum: Spectrum,
    chunks: OnceLock<Vec<Chunk>>,
}

impl Chebyshev {
    pub fn new(spectrum: Spectrum) -> Self {
        Self { spectrum, chunks: OnceLock::new() }
    }

    /// Solves for `width` interleaved channels: `x` holds the right-hand side and becomes the solution. `None`
    /// leaves it as it was: it did not converge.
    pub fn solve(&self, rows: &Rows, sheet: &Sheet, x: &mut [f64], width: usize) -> Option<usize> {
        match width {
            1 => self.run::<1>(rows, sheet, x),
            2 => self.run::<2>(rows, sheet, x),
            3 => self.run::<3>(rows, sheet, x),
            4 => self.run::<4>(rows, sheet, x),
            5..=8 => self.padded::<8>(rows, sheet, x, width),
            9..=16 => self.padded::<16>(rows, sheet, x, width),
            _ => None,
        }
    }

    fn padded<const W: usize>(
        &self,
        rows: &Rows,
        sheet: &Sheet,
        x: &mut [f64],
        width: usize,
    ) -> Option<usize> {
        if width == W {
            return self.run::<W>(rows, sheet, x);
        }
        let mut wide = vec![0.0; x.len() / width * W];
        for (wide, x) in wide.chunks_exact_mut(W).zip(x.chunks_exact(width)) {
            wide[..width].copy_from_slice(x);
        }
        let steps = self.run::<W>(rows, sheet, &mut wide)?;
        for (wide, x) in wide.chunks_exact(W).zip(x.chunks_exact_mut(width)) {
            x.copy_from_slice(&wide[..width]);
        }
        Some(steps)
    }

    fn run<const W: usize>(&self, rows: &Rows, sheet: &Sheet, rhs: &mut [f64]) -> Option<usize> {
        let first = sheet.unknowns().start;
        let chunks = self.chunks.get_or_init(|| scaled(rows, sheet));
        let (rhs, _) = rhs.as_chunks_mut::<W>();
        let n = rhs.len();
        let (low, high) = (0.9 * self.spectrum.least, 1.05 * self.spectrum.most);
        let (middle, half) = (0.5 * (high + low), (0.5 * (high - low)).max(1e-3 * high));
        let root = (high / low).sqrt();
        let per_step = ((root + 1.0) / (root - 1.0)).ln();
        let steps = ((2.0 / ROUND).ln() / per_step).ceil().clamp(4.0, 400.0) as usize;

        let mut x = vec![[0.0_f64; W]; n];
        let mut goal = vec![[0.0_f32; W]; n];
        let mut now = vec![[0.0_f32; W]; n];
        let mut before = vec![[0.0_f32; W]; n];
        let mut residual = vec![[0.0_f64; W]; n];
        let mut taken = 0;
        for round in 0..ROUNDS {
            // D⁻¹ (b - A x), and its size beside that of x.
            let sizes: Vec<([f64; W], [f64; W])> = residual
                .par_chunks_mut(CHUNK)
                .zip(rhs.par_chunks(CHUNK))
                .enumerate()
                .map(|(c, (residual, rhs))| {
                    let (mut step, mut size) = ([0.0_f64; W], [0.0_f64; W]);
                    for (i, (residual, rhs)) in residual.iter_mut().zip(rhs).enumerate() {
                        let i = c * CHUNK + i;
                        let mut sum = *rhs;
                        if round > 0 {
                            let (columns, entries) = rows.row(first + i);
                            for (&column, &entry) in columns.iter().zip(entries) {
                                let other = &x[column as usize - first];
                                for k in 0..W {
                                    sum[k] -= entry * other[k];
                                }
                            }
                        }
                        let d = 1.0 / rows.diagonal(first + i);
                        for k in 0..W {
                            residual[k] = sum[k] * d;
                            step[k] = step[k].max(residual[k].abs());
                            size[k] = size[k].max(x[i][k].abs());
                        }
                    }
                    (step, size)
                })
                .collect();
            let (mut step, mut size) = ([0.0_f64; W], [0.0_f64; W]);
            for part in sizes {
                for k in 0..W {
                    step[k] = step[k].max(part.0[k]);
                    size[k] = size[k].max(part.1[k]);
                }
            }
            let least = self.spectrum.least.min(1.0);
            if (0..W).all(|k| step[k] <= TOLERANCE * least * size[k]) {
                rhs.copy_from_slice(&x);
                return Some(taken);
            }
            if step.iter().any(|s| !s.is_finite()) {
                return None;
            }
            let scale = step.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
            goal.par_iter_mut().with_min_len(CHUNK).zip(&residual).for_each(|(goal, residual)| {
                for k in 0..W {
                    goal[k] = (residual[k] * scale[k]) as f32;
                }
            });
            // x₀ = 0, x₁ = c / θ, then three terms; `before` is overwritten by what comes next.
            before.par_iter_mut().with_min_len(CHUNK).for_each(|v| *v = [0.0; W]);
            now.par_iter_mut().with_min_len(CHUNK).zip(&goal).for_each(|(now, goal)| {
                for k in 0..W {
                    now[k] = goal[k] * (1.0 / middle) as f32;
                }
            });
            let mut rho = half / middle;
            for _ in 0..steps {
                let next_rho = 1.0 / (2.0 * middle / half - rho);
                let momentum = (next_rho * rho) as f32;
                let step = (2.0 * next_rho / half) as f32;
                rho = next_rho;
                before.par_chunks_mut(CHUNK).zip(goal.par_chunks(CHUNK)).zip(chunks).enumerate().for_each(
                    |(c, ((before, goal), chunk))| {
                        for (i, (before, goal)) in before.iter_mut().zip(goal).enumerate() {
                            let range = chunk.starts[i] as usize..chunk.starts[i + 1] as usize;
                            let mut sum = *goal;
                            for &(column, entry) in &chunk.entries[range] {
                                let other = &now[column as usize];
                                for k in 0..W {
                                    sum[k] -= entry * other[k];
                                }
                            }
                            let here = &now[c * CHUNK + i];
                            for k in 0..W {
                                before[k] = here[k] + momentum * (here[k] - before[k]) + step * sum[k];
                            }
                        }
                    },
                );
                std::mem::swap(&mut now, &mut before);
                taken += 1;
            }
            x.par_iter_mut().with_min_len(CHUNK).zip(&now).for_each(|(x, now)| {
                for k in 0..W {
                    x[k] += f64::from(now[k]) * step[k];
                }
            });
        }
        None
    }
}

fn scaled(rows: &Rows, sheet: &Sheet) -> Vec<Chunk> {
    let unknowns = sheet.unknowns();
    (0..unknowns.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| {
            let mut chunk = Chunk { starts: vec![0], entries: Vec::with_capacity(CHUNK * 13) };
            let from = unknowns.start + c * CHUNK;
            for unknown in from..(from + CHUNK).min(unknowns.end) {
                let scale = 1.0 / rows.diagonal(unknown);
                let (columns, entries) = rows.row(unknown);
                chunk.entries.extend(
                    columns
                        .iter()
                        .zip(entries)
                        .map(|(&column, entry)| (column - unknowns.start as u32, (entry * scale) as f32)),
                );
                chunk.starts.push(chunk.entries.len() as u32);
            }
            chunk
        })
        .collect()
}
