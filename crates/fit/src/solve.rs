//! One solver per sheet: dense for small ones, a supernodal Cholesky factor for large ones.
//!
//! Matrices are scaled to a unit diagonal before they are factored, so that pivots can be compared to
//! rounding.

use std::sync::OnceLock;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use crate::pcg;
use crate::system::{Rows, Sheet};
use crate::{FitError, FitOptions, FitReport, Solver};

/// Sheets up to this many unknowns are solved by a dense factor.
const DENSE: usize = 48;
/// Sheets beyond this many unknowns are tried by conjugate gradients first.
const ITERATIVE: usize = 4096;
/// Iterations that conjugate gradients are given.
const ITERATIONS: usize = 300;
/// Pivots of the scaled matrix below this are rounding and raised to it.
const LEAST_PIVOT: f64 = 1e-15;

/// What solves one sheet.
pub(crate) enum SheetSolver {
    /// No unknowns.
    Empty,
    Dense(Dense),
    Sparse(Box<Sparse>),
    /// Conjugate gradients, and the factor that takes over where they do not converge.
    Iterative(OnceLock<Box<Sparse>>),
}

impl SheetSolver {
    /// Factors a sheet; `before`, its solver for another alpha, gives the symbolic factor.
    pub fn new(rows: &Rows, sheet: &Sheet, options: &FitOptions, before: Self) -> Result<Self, FitError> {
        let symbolic = match before {
            Self::Sparse(sparse) => Some(sparse.symbolic),
            Self::Iterative(fallback) => fallback.into_inner().map(|sparse| sparse.symbolic),
            Self::Empty | Self::Dense(_) => None,
        };
        let iterative = match options.solver {
            Solver::Auto => ITERATIVE,
            Solver::Direct => usize::MAX,
            Solver::Iterative => DENSE,
        };
        Ok(match sheet.unknowns().len() {
            0 => Self::Empty,
            n if n <= DENSE => Self::Dense(Dense::new(rows, sheet)),
            n if n > iterative => Self::Iterative(OnceLock::new()),
            _ => Self::Sparse(Box::new(Sparse::new(rows, sheet, symbolic)?)),
        })
    }

    /// Solves in place: `part` holds `width` values per unknown. Returns the iterations taken.
    pub fn solve(
        &self,
        rows: &Rows,
        sheet: &Sheet,
        part: &mut [f64],
        width: usize,
    ) -> Result<usize, FitError> {
        match self {
            Self::Empty => {}
            Self::Dense(dense) => dense.solve(part, width),
            Self::Sparse(sparse) => sparse.solve(part, width),
            Self::Iterative(fallback) => {
                if let Some(sparse) = fallback.get() {
                    sparse.solve(part, width);
                    return Ok(0);
                }
                match pcg::solve(rows, sheet, None, part, width, ITERATIONS) {
                    pcg::Outcome::Converged { iterations } => return Ok(iterations),
                    pcg::Outcome::Stalled { iterations } => {
                        let sparse = Box::new(Sparse::new(rows, sheet, None)?);
                        fallback.get_or_init(|| sparse).solve(part, width);
                        return Ok(iterations);
                    }
                }
            }
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
            Self::Iterative(fallback) => match fallback.get() {
                None => report.iterative_sheets += 1,
                Some(sparse) => {
                    report.iterative_fallbacks += 1;
                    report.factor_entries += sparse.values.len();
                }
            },
        }
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
    fn new(rows: &Rows, sheet: &Sheet, symbolic: Option<SymbolicCholesky<u32>>) -> Result<Self, FitError> {
        let unknowns = sheet.unknowns();
        let (first, n) = (unknowns.start, unknowns.len());
        let unsolved = |reason: String| FitError::Unsolved { unknowns: n, reason };
        let scale: Vec<f64> = unknowns.clone().map(|u| 1.0 / rows.diagonal(u).sqrt()).collect();
        // Row by row up to the diagonal is column by column down to it: the upper half.
        let mut starts = Vec::with_capacity(n + 1);
        starts.push(0_u32);
        let (mut indices, mut entries) = (Vec::new(), Vec::new());
        for (r, unknown) in unknowns.enumerate() {
            let (columns, row) = rows.row(unknown);
            for (&column, &entry) in columns.iter().zip(row).take_while(|e| *e.0 as usize <= unknown) {
                let c = column as usize - first;
                indices.push(c as u32);
                entries.push(entry * scale[r] * scale[c]);
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
            .map_err(|error| unsolved(format!("{error:?}")))?,
        };
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| unsolved("out of memory".into()))?;
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
            .map_err(|error| unsolved(format!("{error:?}")))?;
        Ok(Self { scale, symbolic, values })
    }

    fn solve(&self, part: &mut [f64], width: usize) {
        let n = self.scale.len();
        let mut columns = vec![0.0; part.len()];
        for (r, scale) in self.scale.iter().enumerate() {
            for k in 0..width {
                columns[k * n + r] = part[r * width + k] * scale;
            }
        }
        let factor = LltRef::new(&self.symbolic, &self.values);
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(width, Par::Seq));
        factor.solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut columns, n, width),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        for (r, scale) in self.scale.iter().enumerate() {
            for k in 0..width {
                part[r * width + k] = columns[k * n + r] * scale;
            }
        }
    }
}
