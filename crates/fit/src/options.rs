//! What a caller chooses, and what it is told.

use faer::sparse::FaerError;

/// Where the mass matrix of a least-squares fit comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mass {
    /// From the observations (Schaefer eq. 3-4).
    Sampled,
    /// From the triangles' areas, with the right-hand side of Kavan eq. 14.
    Analytic,
}

/// How vertex values come from observations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The value of the observation nearest to the vertex among those in its triangles; an observation that
    /// lies on the vertex is thus taken as it is.
    PointSample,
    /// Weighted by the hat function: mass lumping (Kavan eq. 8).
    Average,
    /// Least squares with the paper's matrices and nothing that holds unseen vertices but a tie to their
    /// neighbours far below rounding of the data.
    LeastSquares {
        /// Where the mass matrix comes from.
        mass: Mass,
    },
    /// Least squares over the observations, held where they say too little (see [`crate::system`]).
    #[default]
    Ours,
}

/// What smooths the fit, with weight [`FitOptions::alpha`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Regularizer {
    /// Nothing.
    None,
    /// Squared gradients (Kavan eq. 10-12). At large alpha: the mean of each sheet.
    Gradient,
    /// Jumps of the gradient over interior edges, as printed (Kavan eq. 13).
    EdgePrinted,
    /// Jumps of the gradient over interior edges, both sides scaled alike and unfolded: linear functions are
    /// free, and an edge counts by the cosine of its fold. At large alpha: piecewise linear fits.
    #[default]
    Edge,
    /// [`Regularizer::Gradient`] and [`Regularizer::Edge`] together (Kavan section 4).
    Both,
}

/// What happens to values outside the range of the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Bounds {
    /// They stay.
    #[default]
    None,
    /// They are clamped.
    Clamp {
        /// Smallest value.
        low: f32,
        /// Largest value.
        high: f32,
    },
    /// They stay, and whoever interpolates clamps afterwards ([`FitReport::clamp_after_interpolation`]).
    ClampAfterInterpolation {
        /// Smallest value.
        low: f32,
        /// Largest value.
        high: f32,
    },
    /// The minimum of the same energy under the bounds.
    Optimum {
        /// Smallest value.
        low: f32,
        /// Largest value.
        high: f32,
    },
}

impl Bounds {
    /// The range, where there is one.
    pub fn range(self) -> Option<(f32, f32)> {
        match self {
            Self::None => None,
            Self::Clamp { low, high }
            | Self::ClampAfterInterpolation { low, high }
            | Self::Optimum { low, high } => Some((low, high)),
        }
    }
}

/// How large sheets are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// By size and by measured convergence.
    #[default]
    Auto,
    /// A Cholesky factor for every sheet.
    Direct,
    /// Preconditioned conjugate gradients for every sheet too large for a dense factor; a sheet that does not
    /// converge falls back to a factor.
    Iterative,
}

/// Options of [`crate::fit`]. `Default` is ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// How values come from observations.
    pub method: Method,
    /// What smooths them.
    pub regularizer: Regularizer,
    /// Weight of the regularizer, unitless, ≥ 0. 0.1 is the paper's recommendation, 0 the closest fit.
    pub alpha: f32,
    /// What happens outside the signal's range.
    pub bounds: Bounds,
    /// Value of vertices that nothing determines: sheets without observations, vertices without triangles.
    /// `None`: the weighted mean of all observations, 1 if there are none.
    pub neutral: Option<f32>,
    /// How large sheets are solved.
    pub solver: Solver,
    /// Bytes that factors may take; beyond, sheets are solved by conjugate gradients. `None`: no limit.
    pub memory_limit: Option<usize>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            method: Method::default(),
            regularizer: Regularizer::default(),
            alpha: 0.01,
            bounds: Bounds::default(),
            neutral: None,
            solver: Solver::default(),
            memory_limit: None,
        }
    }
}

/// Vertices whose values are given.
#[derive(Clone, Copy, Debug)]
pub struct Held<'a> {
    /// V: true where the value is given and not solved for.
    pub vertices: &'a [bool],
    /// V × C; read only where `vertices` is true.
    pub values: &'a [f32],
}

/// Vertex values and how they came about.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// V × C.
    pub values: Vec<f32>,
    /// Counts.
    pub report: FitReport,
}

/// Counts of one fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitReport {
    /// Observations that counted.
    pub observations: usize,
    /// Observations of weight 0 or less.
    pub ignored_observations: usize,
    /// Observations with a NaN or infinite value, weight or position.
    pub not_finite_observations: usize,
    /// Vertices solved for.
    pub unknowns: usize,
    /// Vertices whose values were given.
    pub held_vertices: usize,
    /// Vertices of no triangle: they take the neutral value.
    pub isolated_vertices: usize,
    /// Vertices of sheets that nothing determines: they take the neutral value.
    pub undetermined_vertices: usize,
    /// Sheets that nothing determines.
    pub undetermined_sheets: usize,
    /// Unknown vertices that see no observation in any of their triangles.
    pub unseen_vertices: usize,
    /// Unknown vertices that see less than a tenth of what their area should show them.
    pub damped_vertices: usize,
    /// Values pulled back because they shot beyond what the observations of their sheet allow.
    pub guarded_values: usize,
    /// Sheets solved.
    pub sheets: usize,
    /// Sheets solved by a dense factor.
    pub dense_sheets: usize,
    /// Sheets solved by a sparse Cholesky factor.
    pub factored_sheets: usize,
    /// Sheets solved by conjugate gradients.
    pub iterative_sheets: usize,
    /// Sheets where conjugate gradients did not converge and a factor took over.
    pub iterative_fallbacks: usize,
    /// Most iterations that any sheet and channel took.
    pub iterations: usize,
    /// Stored entries of the symmetric matrix, both halves.
    pub matrix_entries: usize,
    /// Stored entries of all sparse factors.
    pub factor_entries: usize,
    /// Estimated peak of what the fit allocated, in bytes, without its result.
    pub memory_bytes: usize,
    /// Non-manifold edges that the regularizer leaves out.
    pub non_manifold_edges: usize,
    /// Triangles of no area.
    pub degenerate_triangles: usize,
    /// Triangles without an observation that counts.
    pub unseen_triangles: usize,
    /// Sheets of one triangle.
    pub single_triangles: usize,
    /// Vertices in the very place of a neighbour, or named twice by a triangle: an edge there has no length.
    pub coincident_vertices: usize,
    /// Unknown values below the lower bound before bounds were applied.
    pub below: usize,
    /// Unknown values above the upper bound before bounds were applied.
    pub above: usize,
    /// How far the worst value was outside.
    pub farthest_outside: f32,
    /// How far all of them were outside, added up; see [`FitReport::mean_outside`].
    pub outside_sum: f64,
    /// Values at a bound after [`Bounds::Optimum`].
    pub active_bounds: usize,
    /// Most steps that [`Bounds::Optimum`] took for any sheet and channel.
    pub optimum_steps: usize,
    /// Sheets and channels where [`Bounds::Optimum`] stopped at a feasible point short of its tolerance.
    pub optimum_unmet: usize,
    /// The shader must clamp after interpolation.
    pub clamp_after_interpolation: bool,
}

impl FitReport {
    /// How far values outside the bounds were outside, on average; 0 where none was.
    pub fn mean_outside(&self) -> f64 {
        self.outside_sum / (self.below + self.above).max(1) as f64
    }

    /// Counts a value that lies outside a range.
    pub(crate) fn count_outside(&mut self, value: f32, low: f32, high: f32) {
        self.below += usize::from(value < low);
        self.above += usize::from(value > high);
        let excess = (low - value).max(value - high).max(0.0);
        self.farthest_outside = self.farthest_outside.max(excess);
        self.outside_sum += f64::from(excess);
    }
}

/// What a fit refuses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The observation arrays do not fit each other.
    #[error("{points} points with {weights} weights and {values} values of {channels} channels")]
    Observations {
        /// Number of points.
        points: usize,
        /// Number of weights.
        weights: usize,
        /// Number of values.
        values: usize,
        /// Channels each.
        channels: usize,
    },
    /// An observation lies in a triangle that does not exist.
    #[error("observation {observation} lies in triangle {triangle} of {triangles}")]
    Triangle {
        /// The observation.
        observation: usize,
        /// The triangle it names.
        triangle: usize,
        /// How many there are.
        triangles: usize,
    },
    /// The held arrays do not fit the mesh.
    #[error("{flags} held flags and {values} held values for {vertices} vertices of {channels} channels")]
    Held {
        /// Number of flags.
        flags: usize,
        /// Number of values.
        values: usize,
        /// Vertices of the mesh.
        vertices: usize,
        /// Channels.
        channels: usize,
    },
    /// Vertex values do not fit the mesh, or variances not the observations.
    #[error("{values} values for {vertices} vertices of {channels} channels")]
    Values {
        /// Number of values.
        values: usize,
        /// Vertices of the mesh.
        vertices: usize,
        /// Channels.
        channels: usize,
    },
    /// A held value is NaN or infinite.
    #[error("held value of vertex {vertex} is not finite")]
    HeldNotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// Alpha is negative or not finite.
    #[error("alpha {alpha} is not a finite number of at least 0")]
    Alpha {
        /// As given.
        alpha: f32,
    },
    /// Bounds are not a range.
    #[error("bounds {low}..{high} are no range")]
    Bounds {
        /// Lower bound.
        low: f32,
        /// Upper bound.
        high: f32,
    },
    /// More elements than 32-bit ids can name.
    #[error("{count} elements do not fit 32-bit ids")]
    TooLarge {
        /// How many.
        count: usize,
    },
    /// A sheet could be solved by no solver.
    #[error("sheet of {unknowns} unknowns: {cause}")]
    Unsolved {
        /// Unknowns of the sheet, or of the block of it that failed.
        unknowns: usize,
        /// What failed.
        cause: Unsolved,
    },
}

/// Why a sheet has no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsolved {
    /// Conjugate gradients did not converge, and the factor that follows them was not to be had.
    #[error("no convergence in {iterations} iterations")]
    NotConverged {
        /// How many they were given.
        iterations: usize,
    },
    /// The factor does not fit the memory of the machine.
    #[error("no memory for a factor of {entries} entries")]
    OutOfMemory {
        /// Entries of the factor; 0 where not even its structure fits.
        entries: usize,
    },
    /// The factor has more entries than 32-bit ids can name.
    #[error("a factor beyond 32-bit ids")]
    TooManyEntries,
    /// The matrix is not positive definite.
    #[error("pivot {pivot} is not positive")]
    Pivot {
        /// Number of the pivot, in the order of elimination.
        pivot: usize,
    },
}

impl From<FaerError> for Unsolved {
    fn from(error: FaerError) -> Self {
        match error {
            FaerError::IndexOverflow => Self::TooManyEntries,
            _ => Self::OutOfMemory { entries: 0 },
        }
    }
}
