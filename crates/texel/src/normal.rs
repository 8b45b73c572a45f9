//! Sparse least squares by normal equations and Cholesky, all channels at once.

use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};

/// Sum of weighted squares of rows `coefficients . x - target`, gathered as `A^T W A x = A^T W b`.
pub(crate) struct NormalEquations {
    unknowns: usize,
    channels: usize,
    triplets: Vec<Triplet<u32, u32, f64>>,
    right: Mat<f64>,
}

impl NormalEquations {
    pub fn new(unknowns: usize, channels: usize) -> Self {
        Self { unknowns, channels, triplets: Vec::new(), right: Mat::zeros(unknowns, channels) }
    }

    /// Adds one row: `(unknown, coefficient)`, its weight, and its target per channel. An unknown may be named
    /// more than once.
    pub fn add(&mut self, row: &[(u32, f64)], weight: f64, target: impl Fn(usize) -> f64) {
        for &(i, a) in row {
            for &(j, b) in row {
                if i >= j {
                    self.triplets.push(Triplet::new(i, j, weight * a * b));
                }
            }
        }
        for channel in 0..self.channels {
            let scaled = weight * target(channel);
            if scaled != 0.0 {
                for &(i, a) in row {
                    self.right[(i as usize, channel)] += a * scaled;
                }
            }
        }
    }

    /// Unknowns x channels, or `None` where the matrix is not positive definite.
    pub fn solve(mut self) -> Option<Mat<f64>> {
        // Few distinct entries, many times each: sum them here, in order, before the solver copies them.
        self.triplets.sort_by_key(|t| (t.col, t.row));
        self.triplets.dedup_by(|next, sum| {
            let same = (next.row, next.col) == (sum.row, sum.col);
            if same {
                sum.val += next.val;
            }
            same
        });
        let matrix: SparseColMat<u32, f64> =
            SparseColMat::try_new_from_triplets(self.unknowns, self.unknowns, &self.triplets).ok()?;
        drop(self.triplets);
        let factor = matrix.sp_cholesky(Side::Lower).ok()?;
        let solution = factor.solve(&self.right);
        (0..self.channels).all(|c| solution.col(c).iter().all(|x| x.is_finite())).then_some(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_equations_line_fit_is_exact() {
        // x0 + x1 t at t = 0..5 through 2 - 3 t, and twice that in the second channel.
        let mut equations = NormalEquations::new(2, 2);
        for t in 0..5 {
            let t = f64::from(t);
            equations.add(&[(0, 1.0), (1, t)], 1.0 + t, |c| (2.0 - 3.0 * t) * (c + 1) as f64);
        }
        let x = equations.solve().unwrap();
        assert!((x[(0, 0)] - 2.0).abs() < 1e-12 && (x[(1, 1)] + 6.0).abs() < 1e-12);
    }

    #[test]
    fn normal_equations_singular_is_none() {
        let mut equations = NormalEquations::new(2, 1);
        equations.add(&[(0, 1.0)], 1.0, |_| 1.0);
        assert!(equations.solve().is_none());
    }
}
