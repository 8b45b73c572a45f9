//! A sparse Cholesky factor that is made once and solved many times, always on one thread.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side};

/// The factor of a symmetric positive-definite matrix.
pub(crate) struct Factor {
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
    size: usize,
}

/// Two right-hand sides, one after the other, and the scratch memory of a solve.
pub(crate) struct Workspace {
    /// `2 * size` values: first all x, then all y; a solve replaces them.
    pub(crate) columns: Vec<f64>,
    buffer: MemBuffer,
}

impl Factor {
    /// Factorizes `size` x `size` from entries (row, column, value) of the lower triangle; entries of one
    /// place add up. `None` if the matrix is not positive-definite in f64, or does not fit memory.
    pub(crate) fn new(size: usize, lower: &[Triplet<u32, u32, f64>]) -> Option<Self> {
        let matrix = SparseColMat::<u32, f64>::try_new_from_triplets(size, size, lower).ok()?;
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .ok()?;
        let mut values = vec![0.0; symbolic.len_val()];
        let request = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut buffer = MemBuffer::try_new(request).ok()?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut buffer),
                Default::default(),
            )
            .ok()?;
        Some(Self { symbolic, values, size })
    }

    /// Memory for [`Factor::solve`].
    pub(crate) fn workspace(&self) -> Workspace {
        let request = self.symbolic.solve_in_place_scratch::<f64>(2, Par::Seq);
        Workspace { columns: vec![0.0; 2 * self.size], buffer: MemBuffer::new(request) }
    }

    /// Replaces both right-hand sides with their solutions.
    pub(crate) fn solve(&self, work: &mut Workspace) {
        let factor = LltRef::new(&self.symbolic, &self.values);
        let right = MatMut::from_column_major_slice_mut(&mut work.columns, self.size, 2);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(&mut work.buffer));
    }
}
