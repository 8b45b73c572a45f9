//! Least-squares vertex values: Kavan, Bargteil and Sloan 2011, and section 4.1 of Schaefer et al. 2012.
//!
//! | module | what | source |
//! |---|---|---|
//! | [`observations`] | samples sorted by triangle | Schaefer eq. 2 |
//! | [`options`] | methods, regularizers, bounds, report | |
//! | `elements` | gradient, edge and holding terms | Kavan eq. 10-13 |
//! | [`system`] | unknowns, right-hand sides, the order of a fit | Schaefer eq. 3-4; Kavan eq. 4, 7, 9, 14 |
//! | `assembly` | the normal matrix in compressed rows | Schaefer eq. 3-4; Kavan eq. 4, 9 |
//! | `finish` | the guard and the bounds | Kavan 3.3 |
//! | `solve` | one solver per sheet | Kavan 3.3 |
//! | `pairs` | the diagonal with its strongest pairs as a preconditioner | |
//! | `pcg` | conjugate gradients with measured convergence | |
//! | `optimum` | the quadratic program under bounds | Kavan 3.3 |
//! | [`energy`](mod@energy) | error, noise, contrast, gradient jumps | Kavan eq. 1, table 1 |
//! | `chebyshev` | many channels at once | |
//! | `schwarz` | overlapping blocks as a preconditioner | |
//! | [`simple`] | averages and point samples | Kavan eq. 8 |
//!
//! The default never fails: its matrix is assembled from the observations, so that constant and linear
//! signals come out exact, and what the observations leave open is held by two tiny terms (see [`system`]).
//!
//! Deviation: the paper takes `A` as positive definite. With observed masses it is singular wherever a vertex
//! sees no sample, and with analytic masses and a sampled right-hand side it does not reproduce a constant.

mod assembly;
mod chebyshev;
mod elements;
pub mod energy;
mod finish;
pub mod observations;
mod optimum;
pub mod options;
mod pairs;
mod pcg;
mod schwarz;
pub mod simple;
mod solve;
pub mod system;

use lightkiln_mesh::{Adjacency, Mesh};

pub use energy::{Energy, Look, energy, energy_shown, look};
pub use observations::Observations;
pub use options::{
    Bounds, Fit, FitError, FitOptions, FitReport, Held, Mass, Method, Regularizer, Solver, Unsolved,
};
pub use system::System;

/// Fits one value per light vertex and channel to observations of a signal.
///
/// - `observations`: S points with areas and S × C values, any order; weight 0 and values that are not finite
///   are left out and counted
/// - `held`: vertices whose values are given, for example along borders with texture triangles
/// - returns: V × C values in the order of the mesh's vertices, and a report
///
/// Deterministic for any number of threads. Memory: [`FitReport::memory_bytes`].
///
/// # Errors
/// [`FitError`] for arrays that do not fit each other, unknown triangles and options out of range.
pub fn fit(
    mesh: &Mesh,
    adjacency: &Adjacency,
    observations: &Observations<'_>,
    held: Option<&Held<'_>>,
    options: &FitOptions,
) -> Result<Fit, FitError> {
    match options.method {
        Method::PointSample | Method::Average => simple::fit(mesh, observations, held, options),
        Method::LeastSquares { .. } | Method::Ours => {
            let mut system = System::new(mesh, adjacency, observations, held, options)?;
            system.factor()?;
            system.solve()
        }
    }
}
