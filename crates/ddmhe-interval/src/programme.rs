//! Small dense linear and quadratic programmes, the only file of the workspace that names Clarabel.
//! Its answers are proposals: who asks for them checks what they prove.

#[cfg(feature = "clarabel")]
use clarabel::algebra::CscMatrix;
#[cfg(feature = "clarabel")]
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SupportedConeT, ZeroConeT,
};

/// Minimise ½‖x‖² (or nothing) + costᵀx subject to A x = b in the first rows and A x ≤ b in the
/// others.
pub struct Programme {
    /// Whether the cost has the term ½‖x‖².
    pub quadratic: bool,
    /// Linear cost, one number a variable.
    pub cost: Vec<f64>,
    /// A (rows × variables), by columns.
    pub columns: Vec<f64>,
    /// b, one number a row.
    pub b: Vec<f64>,
    /// Number of rows that are equations.
    pub equations: usize,
}

/// What the solver proposes.
pub struct Proposal {
    /// The variables.
    pub x: Vec<f64>,
    /// Multipliers of the rows, at least 0 to the solver's tolerance for those that are no
    /// equations. Where no x satisfies the rows: those of a proof of it.
    pub z: Vec<f64>,
    /// Iterations that it took.
    pub iterations: u32,
}

impl Programme {
    /// None: the feature `clarabel` is off.
    #[cfg(not(feature = "clarabel"))]
    pub fn propose(self, _tolerance: f64) -> Option<Proposal> {
        None
    }

    /// The solver's answer for these gap and feasibility tolerances; None if it rejects the data.
    #[cfg(feature = "clarabel")]
    pub fn propose(self, tolerance: f64) -> Option<Proposal> {
        let (rows, width) = (self.b.len(), self.cost.len());
        let cost = match self.quadratic {
            true => CscMatrix::identity(width),
            false => CscMatrix::zeros((width, width)),
        };
        // all entries, zeros too
        let starts = (0..=width).map(|j| j * rows).collect();
        let places = (0..width).flat_map(|_| 0..rows).collect();
        let A = CscMatrix::new(rows, width, starts, places, self.columns);
        let cones: [SupportedConeT<f64>; 2] =
            [ZeroConeT(self.equations), NonnegativeConeT(rows - self.equations)];
        let settings = settings(tolerance);
        let mut solver =
            DefaultSolver::new(&cost, &self.cost, &A, &self.b, &cones, settings).ok()?;
        solver.solve();
        let found = solver.solution;
        Some(Proposal { x: found.x, z: found.z, iterations: found.iterations })
    }
}

#[cfg(feature = "clarabel")]
fn settings(tolerance: f64) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        // z is read by row
        presolve_enable: false,
        input_sparse_dropzeros: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    }
}
