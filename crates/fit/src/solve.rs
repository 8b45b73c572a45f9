//! One solver per sheet: dense for small ones, a supernodal Cholesky factor for large ones.
//!
//! Matrices are scaled to a unit diagonal before they are factored, so that pivots can be compared to
//! rounding.

use std::sync::OnceLock;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use glam::Vec3;
use rayon::prelude::*;

use crate::assembly::Rows;
use crate::chebyshev::Chebyshev;
use crate::pairs::Pairs;
use crate::pcg::{self, Preconditioned};
use crate::schwarz::Schwarz;
use crate::system::Sheet;
use crate::{FitError, FitOptions, FitReport, Solver, Unsolved};

/// Sheets up to this many unknowns are solved by a dense factor.
const DENSE: usize = 48;
/// Sheets beyond this many unknowns are tried by conjugate gradients first.
const ITERATIVE: usize = 4096;
/// Iterations that conjugate gradients are given.
const ITERATIONS: usize = 300;
/// Iterations that they are given with overlapping blocks.
const PATIENCE: usize = 2000;
/// Sheets up to this many unknowns fall back to one factor, larger ones to overlapping blocks.
const FACTORED: usize = 150_000;
/// Right-hand sides that a sparse factor solves for together; further ones are solved in parallel. Not a matter of how
/// many threads there are, for it may show in the last bits.
const TOGETHER: usize = 8;
/// Pivots of the scaled matrix below this are rounding and raised to it.
const LEAST_PIVOT: f64 = 1e-15;

/// What solves one sheet.
pub(crate) enum SheetSolver {
    /// No unknowns.
    Empty,
    Dense(Dense),
    Sparse(Box<Sparse>),
    /// Conjugate gradients, and the factor that takes over where they do not converge.
    Iterative(Iterative),
}

/// What a sheet solved by conjugate gradients has learnt.
pub(crate) struct Iterative {
    pairs: Pairs,
    /// Where they do not converge.
    fallback: OnceLock<Fallback>,
    /// Where they did, for the channels to come.
    chebyshev: OnceLock<Chebyshev>,
}

/// What takes over where the diagonal does not precondition well enough.
enum Fallback {
    Factor(Box<Sparse>),
    Blocks(Schwarz),
}

/// What a solver may look up beside the matrix.
pub(crate) struct Context<'a> {
    pub rows: &'a Rows,
    pub options: &'a FitOptions,
    /// Where an unknown lies.
    pub places: &'a (dyn Fn(usize) -> Vec3 + Sync),
}

impl SheetSolver {
    /// Factors a sheet; `before`, its solver for another alpha, gives the symbolic factor.
    pub fn new(context: &Context<'_>, sheet: &Sheet, before: Self) -> Result<Self, FitError> {
        let symbolic = match before {
            Self::Sparse(sparse) => Some(sparse.symbolic),
            _ => None,
        };
        let iterative = match context.options.solver {
            Solver::Auto => ITERATIVE,
            Solver::Direct => usize::MAX,
            Solver::Iterative => DENSE,
        };
        let rows = context.rows;
        Ok(match sheet.unknowns().len() {
            0 => Self::Empty,
            n if n <= DENSE => Self::Dense(Dense::new(rows, sheet)),
            n if n > iterative => Self::Iterative(Iterative::new(rows, sheet)),
            _ => match Sparse::new(rows, sheet, symbolic, context.limit())? {
                Some(sparse) => Self::Sparse(Box::new(sparse)),
                None => Self::Iterative(Iterative::new(rows, sheet)),
            },
        })
    }

    /// Solves in place: `part` holds `width` values per unknown. Returns the iterations taken.
    pub fn solve(
        &self,
        context: &Context<'_>,
        sheet: &Sheet,
        part: &mut [f64],
        width: usize,
    ) -> Result<usize, FitError> {
        match self {
            Self::Empty => {}
            Self::Dense(dense) => dense.solve(part, width),
            Self::Sparse(sparse) => sparse.solve(part, width),
            Self::Iterative(iterative) => return iterative.solve(context, sheet, part, width),
        }
        Ok(0)
    }

    pub fn count(&self, report: &mut FitReport) {
        match self {
            Self::Empty => {}
            Self::Dense(_) => report.dense_sheets += 1,
            Self::Sparse(sparse) => {
                report.factored_sheets += 1;
                report.factor_entries += sparse.values.len();
            }
            Self::Iterative(iterative) => match iterative.fallback.get() {
                None => report.iterative_sheets += 1,
                Some(fallback) => {
                    report.iterative_fallbacks += 1;
                    report.factor_entries += match fallback {
                        Fallback::Factor(sparse) => sparse.entries(),
                        Fallback::Blocks(blocks) => blocks.entries(),
                    };
                }
            },
        }
    }
}

impl Context<'_> {
    /// Bytes that one factor may take.
    fn limit(&self) -> usize {
        self.options.memory_limit.unwrap_or(usize::MAX)
    }
}

impl Iterative {
    fn new(rows: &Rows, sheet: &Sheet) -> Self {
        Self { pairs: Pairs::new(rows, sheet), fallback: OnceLock::new(), chebyshev: OnceLock::new() }
    }

    fn solve(
        &self,
        context: &Context<'_>,
        sheet: &Sheet,
        part: &mut [f64],
        width: usize,
    ) -> Result<usize, FitError> {
        let rows = context.rows;
        let mut iterations = 0;
        if self.fallback.get().is_none() {
            let shortcut = self.chebyshev.get();
            if let Some(steps) = shortcut.and_then(|c| c.solve(rows, sheet, &self.pairs, part, width)) {
                return Ok(steps);
            }
            let by = Preconditioned::Diagonal(&self.pairs);
            match pcg::solve(rows, sheet, by, part, width, ITERATIONS) {
                pcg::Outcome::Converged { iterations, spectrum } => {
                    self.chebyshev.get_or_init(|| Chebyshev::new(spectrum));
                    return Ok(iterations);
                }
                pcg::Outcome::Stalled { iterations: taken } => iterations = taken,
            }
            let factor = if sheet.unknowns().len() <= FACTORED {
                Sparse::new(rows, sheet, None, context.limit())?
            } else {
                None
            };
            let fallback = match factor {
                Some(factor) => Fallback::Factor(Box::new(factor)),
                None => Fallback::Blocks(Schwarz::new(rows, sheet, context.places)?),
            };
            self.fallback.get_or_init(|| fallback);
        }
        match self.fallback.get() {
            Some(Fallback::Factor(factor)) => factor.solve(part, width),
            Some(Fallback::Blocks(blocks)) => {
                let by = Preconditioned::Blocks(blocks);
                match pcg::solve(rows, sheet, by, part, width, PATIENCE) {
                    pcg::Outcome::Converged { iterations: taken, .. } => iterations = iterations.max(taken),
                    // The last resort has no limit: an unconverged answer is none.
                    pcg::Outcome::Stalled { .. } => match Sparse::new(rows, sheet, None, usize::MAX)? {
                        Some(factor) => factor.solve(part, width),
                        None => {
                            return Err(FitError::Unsolved {
                                unknowns: sheet.unknowns().len(),
                                cause: Unsolved::NotConverged { iterations: PATIENCE },
                            });
                        }
                    },
                }
            }
            None => {}
        }
        Ok(iterations)
    }
}

/// A dense factor `L` of the scaled matrix, row by row.
pub(crate) struct Dense {
    scale: Vec<f64>,
    lower: Vec<f64>,
}

impl Dense {
    fn new(rows: &Rows, sheet: &Sheet) -> Self {
        let unknowns = sheet.unknowns();
        let (first, n) = (unknowns.start, unknowns.len());
        let scale: Vec<f64> = unknowns.clone().map(|u| 1.0 / rows.diagonal(u).sqrt()).collect();
        let mut lower = vec![0.0; n * n];
        for (r, unknown) in unknowns.enumerate() {
            let (columns, entries) = rows.row(unknown);
            for (&column, entry) in columns.iter().zip(entries) {
                let c = column as usize - first;
                if c <= r {
                    lower[r * n + c] = entry * scale[r] * scale[c];
                }
            }
        }
        for r in 0..n {
            for c in 0..=r {
                let dot: f64 = (0..c).map(|k| lower[r * n + k] * lower[c * n + k]).sum();
                let rest = lower[r * n + c] - dot;
                lower[r * n + c] =
                    if c == r { rest.max(LEAST_PIVOT).sqrt() } else { rest / lower[c * n + c] };
            }
        }
        Self { scale, lower }
    }

    fn solve(&self, part: &mut [f64], width: usize) {
        let (n, lower) = (self.scale.len(), &self.lower);
        for k in 0..width {
            let at = |r: usize| r * width + k;
            for r in 0..n {
                let dot: f64 = (0..r).map(|c| lower[r * n + c] * part[at(c)]).sum();
                part[at(r)] = (part[at(r)] * self.scale[r] - dot) / lower[r * n + r];
            }
            for r in (0..n).rev() {
                let dot: f64 = (r + 1..n).map(|c| lower[c * n + r] * part[at(c)]).sum();
                part[at(r)] = (part[at(r)] - dot) / lower[r * n + r];
            }
            for r in 0..n {
                part[at(r)] *= self.scale[r];
            }
        }
    }
}

/// A sparse Cholesky factor of the scaled matrix.
pub(crate) struct Sparse {
    scale: Vec<f64>,
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
}

impl Sparse {
    /// The factor of a whole sheet; `symbolic` is its structure, where another alpha has left it, and `limit` the
    /// bytes that it may take.
    fn new(
        rows: &Rows,
        sheet: &Sheet,
        symbolic: Option<SymbolicCholesky<u32>>,
        limit: usize,
    ) -> Result<Option<Self>, FitError> {
        let unknowns = sheet.unknowns();
        let first = unknowns.start;
        Self::of(rows, first, unknowns.len(), &|r| r as u32, &|c| Some(c), symbolic, limit)
    }

    /// The factor of the rows and columns of `members`, ascending, counted from `first`.
    pub fn of_subset(rows: &Rows, first: usize, members: &[u32]) -> Result<Self, FitError> {
        let local = |c: u32| members.binary_search(&c).ok().map(|c| c as u32);
        let found = Self::of(rows, first, members.len(), &|r| members[r], &local, None, usize::MAX)?;
        found.ok_or(FitError::Unsolved {
            unknowns: members.len(),
            cause: Unsolved::OutOfMemory { entries: 0 },
        })
    }

    pub fn entries(&self) -> usize {
        self.values.len()
    }

    /// `None`: the factor would not fit the limit.
    fn of(
        rows: &Rows,
        first: usize,
        n: usize,
        member: &dyn Fn(usize) -> u32,
        local: &dyn Fn(u32) -> Option<u32>,
        symbolic: Option<SymbolicCholesky<u32>>,
        limit: usize,
    ) -> Result<Option<Self>, FitError> {
        let unsolved = |cause: Unsolved| FitError::Unsolved { unknowns: n, cause };
        let global = |r: usize| first + member(r) as usize;
        let scale: Vec<f64> = (0..n).map(|r| 1.0 / rows.diagonal(global(r)).sqrt()).collect();
        // Row by row up to the diagonal is column by column down to it: the upper half.
        let mut starts = Vec::with_capacity(n + 1);
        starts.push(0_u32);
        let (mut indices, mut entries) = (Vec::new(), Vec::new());
        for r in 0..n {
            let (columns, row) = rows.row(global(r));
            for (&column, &entry) in columns.iter().zip(row).take_while(|e| *e.0 as usize <= global(r)) {
                // Blocks begin within a sheet, and a row may reach before them.
                let Some(c) = column.checked_sub(first as u32).and_then(local) else { continue };
                indices.push(c);
                entries.push(entry * scale[r] * scale[c as usize]);
            }
            starts.push(indices.len() as u32);
        }
        let structure = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &indices);
        let symbolic = match symbolic {
            Some(symbolic) => symbolic,
            None => factorize_symbolic_cholesky(
                structure,
                Side::Upper,
                SymmetricOrdering::Amd,
                CholeskySymbolicParams::default(),
            )
            .map_err(|error| unsolved(error.into()))?,
        };
        if symbolic.len_val().saturating_mul(8) > limit {
            return Ok(None);
        }
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch)
            .map_err(|_| unsolved(Unsolved::OutOfMemory { entries: symbolic.len_val() }))?;
        let regularization = LltRegularization {
            dynamic_regularization_delta: LEAST_PIVOT,
            dynamic_regularization_epsilon: LEAST_PIVOT,
        };
        symbolic
            .factorize_numeric_llt(
                &mut values,
                SparseColMatRef::new(structure, &entries),
                Side::Upper,
                regularization,
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .map_err(|LltError::NonPositivePivot { index }| unsolved(Unsolved::Pivot { pivot: index }))?;
        Ok(Some(Self { scale, symbolic, values }))
    }

    pub fn solve(&self, part: &mut [f64], width: usize) {
        let n = self.scale.len();
        let mut columns = vec![0.0; part.len()];
        for (r, scale) in self.scale.iter().enumerate() {
            for k in 0..width {
                columns[k * n + r] = part[r * width + k] * scale;
            }
        }
        let factor = LltRef::new(&self.symbolic, &self.values);
        columns.par_chunks_mut(n * TOGETHER).for_each(|columns| {
            let width = columns.len() / n;
            let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(width, Par::Seq));
            factor.solve_in_place_with_conj(
                Conj::No,
                MatMut::from_column_major_slice_mut(columns, n, width),
                Par::Seq,
                MemStack::new(&mut memory),
            );
        });
        for (r, scale) in self.scale.iter().enumerate() {
            for k in 0..width {
                part[r * width + k] = columns[k * n + r] * scale;
            }
        }
    }
}
