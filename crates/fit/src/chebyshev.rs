//! Chebyshev iteration for many channels, once conjugate gradients have measured the spectrum.
//!
//! Conjugate gradients move ten vectors through memory in each step and wait for sums; Chebyshev's three-term
//! recurrence moves four and waits for none, and it may run in single precision because each round only corrects
//! the residual that double precision has measured (Saad 2003, algorithm 12.1; iterative refinement). The
//! result is taken by the same measure as that of conjugate gradients.
//!
//! Channels are interleaved, and what runs over them is compiled for the widest registers that the machine has
//! ([`pulp::Arch`]); products are rounded before they are added, so that every machine gives the same bytes.

use std::sync::{Mutex, OnceLock, PoisonError};

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::assembly::Rows;
use crate::pairs::{Paired, Pairs};
use crate::pcg::{CHUNK, TOLERANCE};
use crate::system::Sheet;

/// The most that one round of single precision takes off the error.
const ROUND: f64 = 1e-5;
/// Rounds before the channel is given back to conjugate gradients.
const ROUNDS: usize = 8;

/// Smallest and largest eigenvalue of `M⁻¹ A`, as conjugate gradients found them; `M` is the diagonal with its pairs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spectrum {
    pub least: f64,
    pub most: f64,
}

/// `M⁻¹ A` in single precision with columns counted from the sheet's first.
struct Chunk {
    starts: Vec<u32>,
    entries: Vec<(u32, f32)>,
}

/// What many channels of one sheet share.
pub(crate) struct Chebyshev {
    spectrum: Spectrum,
    chunks: OnceLock<Vec<Chunk>>,
    /// Vectors of the channels before, which those to come write over.
    work: Mutex<Work>,
}

/// The vectors of a solution, channels interleaved.
#[derive(Default)]
struct Work {
    x: Vec<f64>,
    goal: Vec<f32>,
    now: Vec<f32>,
    before: Vec<f32>,
}

impl Chebyshev {
    pub fn new(spectrum: Spectrum) -> Self {
        Self { spectrum, chunks: OnceLock::new(), work: Mutex::default() }
    }

    /// Solves for `width` interleaved channels: `x` holds the right-hand side and becomes the solution. `None`
    /// leaves it as it was: it did not converge.
    pub fn solve(
        &self,
        rows: &Rows,
        sheet: &Sheet,
        pairs: &Pairs,
        x: &mut [f64],
        width: usize,
    ) -> Option<usize> {
        match width {
            1 => self.run::<1>(rows, sheet, pairs, x),
            2 => self.run::<2>(rows, sheet, pairs, x),
            3 => self.run::<3>(rows, sheet, pairs, x),
            4 => self.run::<4>(rows, sheet, pairs, x),
            5..=8 => self.padded::<8>(rows, sheet, pairs, x, width),
            9..=16 => self.padded::<16>(rows, sheet, pairs, x, width),
            _ => None,
        }
    }

    fn padded<const W: usize>(
        &self,
        rows: &Rows,
        sheet: &Sheet,
        pairs: &Pairs,
        x: &mut [f64],
        width: usize,
    ) -> Option<usize> {
        if width == W {
            return self.run::<W>(rows, sheet, pairs, x);
        }
        let mut wide = vec![0.0; x.len() / width * W];
        for (wide, x) in wide.chunks_exact_mut(W).zip(x.chunks_exact(width)) {
            wide[..width].copy_from_slice(x);
        }
        let steps = self.run::<W>(rows, sheet, pairs, &mut wide)?;
        for (wide, x) in wide.chunks_exact(W).zip(x.chunks_exact_mut(width)) {
            x.copy_from_slice(&wide[..width]);
        }
        Some(steps)
    }

    fn run<const W: usize>(
        &self,
        rows: &Rows,
        sheet: &Sheet,
        pairs: &Pairs,
        rhs: &mut [f64],
    ) -> Option<usize> {
        let arch = Arch::new();
        let first = sheet.unknowns().start;
        let chunks = self.chunks.get_or_init(|| scaled(rows, sheet, pairs));
        let (low, high) = (0.95 * self.spectrum.least, 1.03 * self.spectrum.most);
        let (middle, half) = (0.5 * (high + low), (0.5 * (high - low)).max(1e-3 * high));
        let root = (high / low).sqrt();
        let per_step = ((root + 1.0) / (root - 1.0)).ln();
        // The bound of the theory has twice this; what is left is measured, and a round more costs little.
        let steps_for = |factor: f64| ((1.0 / factor).ln() / per_step).ceil().clamp(3.0, 400.0) as usize;
        let enough = TOLERANCE * self.spectrum.least.min(1.0);

        // A panic elsewhere left vectors that are written before they are read.
        let mut work = std::mem::take(&mut *self.work.lock().unwrap_or_else(PoisonError::into_inner));
        let length = rhs.len();
        let (rhs, _) = rhs.as_chunks_mut::<W>();
        work.x.resize(length, 0.0);
        work.goal.resize(length, 0.0);
        work.now.resize(length, 0.0);
        work.before.resize(length, 0.0);
        let (x, _) = work.x.as_chunks_mut::<W>();
        let (goal, _) = work.goal.as_chunks_mut::<W>();
        let (mut now, _) = work.now.as_chunks_mut::<W>();
        let (mut before, _) = work.before.as_chunks_mut::<W>();

        // Single precision has the range of numbers around 1.
        let sizes = rhs.par_chunks(CHUNK).enumerate().map(|(c, rhs)| {
            let mut most = [0.0_f64; W];
            for (i, rhs) in rhs.iter().enumerate() {
                let d = 1.0 / rows.diagonal(first + c * CHUNK + i);
                for k in 0..W {
                    most[k] = most[k].max((rhs[k] * d).abs());
                }
            }
            most
        });
        let size = largest(sizes.collect());
        let scale = size.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        let size = size.map(|s| if s > 0.0 { s } else { 0.0 });
        let mut taken = 0;
        let mut solved = false;
        for round in 0..ROUNDS {
            // M⁻¹ (b - A x), and its size beside that of x.
            let sizes: Vec<[[f64; W]; 2]> = goal
                .par_chunks_mut(CHUNK)
                .enumerate()
                .map(|(c, goal)| {
                    let x = (round > 0).then_some(&*x);
                    let (from, pairs) = (c * CHUNK, pairs.of(c));
                    arch.dispatch(Residual { rows, pairs, first, from, rhs, x, scale: &scale, goal })
                })
                .collect();
            let residual = largest(sizes.iter().map(|s| s[0]).collect());
            let reach = largest(sizes.iter().map(|s| s[1]).collect());
            if residual.iter().any(|s| !s.is_finite()) {
                break;
            }
            if (0..W).all(|k| residual[k] <= enough * reach[k]) {
                solved = true;
                break;
            }
            // How much of the residual may stay. Before the first round the solution is taken to be as large as
            // its right-hand side.
            let asked = (0..W)
                .filter(|&k| residual[k] > 0.0)
                .map(|k| enough * if round == 0 { size[k] } else { reach[k] } / residual[k])
                .fold(1.0, f64::min);
            let steps = steps_for(asked.max(ROUND));
            // x₀ = 0, x₁ = c / θ, then three terms; `before` is overwritten by what comes next.
            let start = (1.0 / middle) as f32;
            now.par_chunks_mut(CHUNK).zip(goal.par_chunks(CHUNK)).for_each(|(now, goal)| {
                for (now, goal) in now.as_flattened_mut().iter_mut().zip(goal.as_flattened()) {
                    *now = goal * start;
                }
            });
            let mut rho = half / middle;
            for step in 0..steps {
                let next_rho = 1.0 / (2.0 * middle / half - rho);
                let momentum = (next_rho * rho) as f32;
                let length = (2.0 * next_rho / half) as f32;
                rho = next_rho;
                let all: &[[f32; W]] = now;
                before.par_chunks_mut(CHUNK).zip(goal.par_chunks(CHUNK)).zip(chunks).enumerate().for_each(
                    |(c, ((before, goal), chunk))| {
                        let from = c * CHUNK;
                        let zero = step == 0;
                        let work = Step { chunk, from, all, goal, before, zero, momentum, length };
                        arch.dispatch(work);
                    },
                );
                std::mem::swap(&mut now, &mut before);
                taken += 1;
            }
            x.par_chunks_mut(CHUNK).zip(now.par_chunks(CHUNK)).for_each(|(x, now)| {
                for (x, now) in x.iter_mut().zip(now) {
                    for k in 0..W {
                        let before = if round == 0 { 0.0 } else { x[k] };
                        x[k] = before + f64::from(now[k]) * size[k];
                    }
                }
            });
        }
        if solved {
            rhs.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(rhs, x)| rhs.copy_from_slice(x));
        }
        *self.work.lock().unwrap_or_else(PoisonError::into_inner) = work;
        solved.then_some(taken)
    }
}

fn largest<const W: usize>(parts: Vec<[f64; W]>) -> [f64; W] {
    // Not `max`: a NaN has to show.
    parts.into_iter().fold([0.0; W], |most, part| {
        std::array::from_fn(|k| if part[k] > most[k] || part[k].is_nan() { part[k] } else { most[k] })
    })
}

/// `M⁻¹ (b - A x)` of one chunk, scaled; without `x` it is taken as zero. Gives the largest entries of it and of `x`.
struct Residual<'a, const W: usize> {
    rows: &'a Rows,
    pairs: &'a [Paired],
    first: usize,
    from: usize,
    rhs: &'a [[f64; W]],
    x: Option<&'a [[f64; W]]>,
    scale: &'a [f64; W],
    goal: &'a mut [[f32; W]],
}

impl<const W: usize> Residual<'_, W> {
    /// `b - A x` of one row.
    #[inline(always)]
    fn row(&self, row: usize) -> [f64; W] {
        let mut sum = self.rhs[row];
        if let Some(x) = self.x {
            let (columns, entries) = self.rows.row(self.first + row);
            for (&column, &entry) in columns.iter().zip(entries) {
                let other = &x[column as usize - self.first];
                for k in 0..W {
                    sum[k] -= entry * other[k];
                }
            }
        }
        sum
    }
}

impl<const W: usize> NullaryFnOnce for Residual<'_, W> {
    type Output = [[f64; W]; 2];

    #[inline(always)]
    fn call(self) -> Self::Output {
        let (mut most, mut reach) = ([0.0_f64; W], [0.0_f64; W]);
        let mut pairs = self.pairs.iter().peekable();
        for i in 0..self.goal.len() {
            let row = self.from + i;
            let sum = self.row(row);
            let d = 1.0 / self.rows.diagonal(self.first + row);
            let mut left = sum.map(|s| s * d);
            if let Some(pair) = pairs.next_if(|p| p.row as usize == row) {
                let beyond = pair.beyond(&sum, &self.row(pair.partner as usize));
                for k in 0..W {
                    left[k] += beyond[k];
                }
            }
            for k in 0..W {
                most[k] = if left[k].abs() <= most[k] { most[k] } else { left[k].abs() };
                self.goal[i][k] = (left[k] * self.scale[k]) as f32;
            }
            if let Some(x) = self.x {
                let here = &x[row];
                for k in 0..W {
                    reach[k] = if here[k].abs() > reach[k] { here[k].abs() } else { reach[k] };
                }
            }
        }
        [most, reach]
    }
}

/// One step of the recurrence over one chunk: `before` becomes what comes after `all`.
struct Step<'a, const W: usize> {
    chunk: &'a Chunk,
    from: usize,
    all: &'a [[f32; W]],
    goal: &'a [[f32; W]],
    before: &'a mut [[f32; W]],
    /// What came before is zero.
    zero: bool,
    momentum: f32,
    length: f32,
}

impl<const W: usize> NullaryFnOnce for Step<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { chunk, from, all, goal, before, zero, momentum, length } = self;
        for (i, (before, goal)) in before.iter_mut().zip(goal).enumerate() {
            let range = chunk.starts[i] as usize..chunk.starts[i + 1] as usize;
            let mut sum = *goal;
            for &(column, entry) in &chunk.entries[range] {
                let other = &all[column as usize];
                for k in 0..W {
                    sum[k] -= entry * other[k];
                }
            }
            let here = &all[from + i];
            for k in 0..W {
                let last = if zero { 0.0 } else { before[k] };
                before[k] = here[k] + momentum * (here[k] - last) + length * sum[k];
            }
        }
    }
}

fn scaled(rows: &Rows, sheet: &Sheet, pairs: &Pairs) -> Vec<Chunk> {
    let unknowns = sheet.unknowns();
    let first = unknowns.start;
    (0..unknowns.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| {
            let mut chunk = Chunk { starts: vec![0], entries: Vec::with_capacity(CHUNK * 13) };
            let from = first + c * CHUNK;
            let mut paired = pairs.of(c).iter().peekable();
            for unknown in from..(from + CHUNK).min(unknowns.end) {
                let scale = 1.0 / rows.diagonal(unknown);
                let of = |unknown: usize, scale: f64| {
                    let (columns, entries) = rows.row(unknown);
                    columns.iter().zip(entries).map(move |(&c, &e)| (c - first as u32, e * scale))
                };
                match paired.next_if(|p| first + p.row as usize == unknown) {
                    None => chunk.entries.extend(of(unknown, scale).map(|(c, e)| (c, e as f32))),
                    Some(pair) => {
                        let own = of(unknown, scale + pair.own);
                        let other = of(first + pair.partner as usize, pair.other);
                        let mut both: Vec<(u32, f64)> = own.chain(other).collect();
                        both.sort_by_key(|e| e.0);
                        let joined = both.chunk_by(|a, b| a.0 == b.0);
                        chunk
                            .entries
                            .extend(joined.map(|e| (e[0].0, e.iter().map(|e| e.1).sum::<f64>() as f32)));
                    }
                }
                chunk.starts.push(chunk.entries.len() as u32);
            }
            chunk
        })
        .collect()
}
