//! The diagonal as a preconditioner, and beside it the few pairs of unknowns that it separates badly.
//!
//! Two unknowns that hardly any observation tells apart have an eigenvalue of `D⁻¹ A` near `1 - c`, where
//! `c = |a_ij| / √(a_ii a_jj)`. On a million vertices with slivers four pairs of `c > 0.8` lie below all other eigenvalues,
//! and every channel pays for them. Where two unknowns are each other's strongest and `c` is beyond [`STRONG`], their
//! 2 x 2 block of `A` is inverted in place of its diagonal (block Jacobi; Saad 2003, section 12.2).

use rayon::prelude::*;

use crate::assembly::Rows;
use crate::pcg::CHUNK;
use crate::system::Sheet;

/// What joins a pair; an even mesh has 1/6 everywhere.
const STRONG: f64 = 0.5;
/// Share of a block's diagonal product below which its determinant is rounding.
const LEAST_DETERMINANT: f64 = 1e-13;

/// A row of the preconditioner that is not the diagonal's alone. Rows are counted from the sheet's first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Paired {
    pub row: u32,
    pub partner: u32,
    /// The block's inverse, less that of its diagonal: what the residuals of the row and of its partner add.
    pub own: f64,
    pub other: f64,
}

impl Paired {
    /// What this row of the preconditioned residual has beyond the diagonal's.
    #[inline]
    pub fn beyond<const W: usize>(&self, own: &[f64; W], other: &[f64; W]) -> [f64; W] {
        std::array::from_fn(|k| self.own * own[k] + self.other * other[k])
    }
}

/// The paired rows of a sheet by chunks of [`CHUNK`] rows, ascending.
pub(crate) struct Pairs {
    chunks: Vec<Vec<Paired>>,
}

impl Pairs {
    pub fn new(rows: &Rows, sheet: &Sheet) -> Self {
        let unknowns = sheet.unknowns();
        let first = unknowns.start;
        let chunks = (0..unknowns.len().div_ceil(CHUNK))
            .into_par_iter()
            .map(|c| {
                let from = first + c * CHUNK;
                let paired = |u| {
                    let partner = strongest(rows, u)?;
                    (strongest(rows, partner)? == u).then(|| block(rows, first, u, partner))?
                };
                (from..(from + CHUNK).min(unknowns.end)).filter_map(paired).collect()
            })
            .collect();
        Self { chunks }
    }

    /// The paired rows of a chunk.
    pub fn of(&self, chunk: usize) -> &[Paired] {
        &self.chunks[chunk]
    }
}

/// The unknown that one is coupled to most, of equal ones the first, where that is beyond [`STRONG`].
fn strongest(rows: &Rows, unknown: usize) -> Option<usize> {
    let (columns, entries) = rows.row(unknown);
    let (mut most, mut found) = (STRONG * STRONG * rows.diagonal(unknown), None);
    for (&column, &entry) in columns.iter().zip(entries) {
        let column = column as usize;
        let coupling = entry * entry;
        // Without a division: most entries are far from it.
        if column != unknown && coupling > most * rows.diagonal(column) {
            (most, found) = (coupling / rows.diagonal(column), Some(column));
        }
    }
    found
}

/// The row of an unknown in the inverse of its and its partner's block. `None`: the block is singular to rounding.
fn block(rows: &Rows, first: usize, unknown: usize, partner: usize) -> Option<Paired> {
    let (columns, entries) = rows.row(unknown);
    let coupling = entries[columns.binary_search(&(partner as u32)).ok()?];
    let [a, b] = [unknown, partner].map(|u| rows.diagonal(u));
    let determinant = a * b - coupling * coupling;
    let [row, partner] = [unknown, partner].map(|u| (u - first) as u32);
    (determinant > LEAST_DETERMINANT * a * b).then(|| Paired {
        row,
        partner,
        own: b / determinant - 1.0 / a,
        other: -coupling / determinant,
    })
}
