//! The set of windows that the data allow: mean + basis (+ regularisation weight).
//!
//! # Derivation from (16b)
//! A window of depth m stacks w = [x(0); y(0); …; x(m-1); y(m-1); x(m)] ∈ R^d, d = m(n+p) + n. The
//! N windows of the recording are the columns of W (d × N), the two block Hankel matrices of (16b)
//! interleaved in time, so that a shorter window is the head of a longer one. (16b) asks for w = W
//! α with 1ᵀα = 1.
//!
//! *Centring.* Write α = 1/N + δ with 1ᵀδ = 0. Then W α = c + (W - c 1ᵀ) δ with the mean window c =
//! W 1/N: the row of ones in (16b) is exactly the centring, and it need not be carried further.
//!
//! *Orthonormal basis.* With the thin singular value decomposition W - c 1ᵀ = U S Vᵀ every such δ
//! acts only through z = Vᵀδ, and
//!
//! > w = c + U S z,  ‖α‖² = 1/N + ‖z‖² for the shortest α with that window
//!
//! (Vᵀ1 = 0 because the deviations sum to zero, so 1/N and V z are orthogonal). The N unknowns α
//! become r = rank.
//!
//! *Scaling.* Every channel is divided by its scale, [`Scaling`]: channels of one unit share one,
//! all others have each their own. For the exact space this changes nothing but the numerics; for a
//! truncated or regularised one it defines what "small" means. Everything inside this crate's
//! estimator is in these units.
//!
//! *Rounding.* W is recorded in double precision, so it is off by a matrix E with |E_ij| ≤ ε_j =
//! eps·max|channel|/s: by a multiple of eps where channels are centred, by a thousand times that
//! where they stand a thousand deviations from zero. Singular values move by at most ‖E‖₂ ≤ ‖E‖_F ≤
//! √(N Σ ε_j²) (Weyl), so a direction below that may be nothing but rounding. A recording that was
//! computed step by step carries the rounding of each step along its window as well;
//! [`tol::DATA_ROUNDING`] makes room for that.
//!
//! *Coordinates.* Without a weight the coordinates are b = S z and the basis is U, orthonormal:
//! directions that the recording hardly excited are not ill-conditioned. With a weight they are a =
//! √N z, of unit variance over the recording, the basis is U S/√N and ‖α‖² = (1 + ‖a‖²)/N.
//!
//! *Disturbance.* Where one is fitted, its columns G follow those of the recording (see the module
//! `driving`). With the weights of the recording the windows are those of its linear model, x(0)
//! the coordinates, in the place of the recorded ones.

use crate::driving::{Driven, Driving};
use crate::history::History;
use crate::linear_model::LinearModel;
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::tol;
use crate::variation::{Rest, copies};
use ddmhe_run::layout::Layout;
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Mat, MatRef, Par, Spec};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::cell::{OnceCell, RefCell};
use std::rc::Rc;

/// Which windows count as trajectories of the system.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Space {
    /// The documented default rule: see [`defaults`](crate::defaults).
    #[default]
    Auto,
    /// Every direction above rounding level: the equality (16b) as printed, with the least-norm α
    /// where the cost leaves a choice. Right for noise-free recordings of (locally) linear systems.
    Exact,
    /// The strongest directions only: at most `rank`, and none below `tol`·σ₁. With neither given,
    /// rank n, the dimension that noise-free linear data have.
    Truncated {
        /// Largest number of directions; windows too short for it keep what they have.
        rank: Option<usize>,
        /// Relative singular value below which a direction is dropped.
        tol: Option<f64>,
    },
    /// Every direction above rounding level, and `weight`·‖α‖² added to the cost (17), in its
    /// units.
    Ridge {
        /// Weight, > 0.
        weight: f64,
        /// Whether it is on ‖a‖² = N‖α‖² - 1 in scaled units instead: the same for every recording
        /// length, horizon and unit.
        normalised: bool,
    },
}

/// A choice of space in normalised units, the same for every depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Selection {
    pub rank: Option<usize>,
    pub tol: Option<f64>,
    /// λ, weight on ‖a‖² = N‖α‖² - 1 in scaled units.
    pub penalty: Penalty,
}

impl Selection {
    /// The same with ten times the default rule's weight; None where the rule set none.
    pub fn heavier(self) -> Option<Self> {
        match self.penalty {
            Penalty::Normalised(weight) => {
                Some(Selection { penalty: Penalty::Normalised(10.0 * weight), ..self })
            }
            Penalty::None | Penalty::Alpha(_) => None,
        }
    }
}

/// The two ways to state a weight on ‖α‖².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Penalty {
    None,
    /// On ‖a‖², normalised: independent of N and of units.
    Normalised(f64),
    /// On ‖α‖², in scaled units of the cost.
    Alpha(f64),
}

/// The windows of one depth that the data allow.
#[derive(Debug, Clone)]
pub struct TrajectorySpace {
    /// Depth m: outputs in the window.
    pub depth: usize,
    /// Number N of recorded windows behind it.
    pub windows: usize,
    /// Mean window c (d), as scaled deviations from the channel means.
    pub mean: Vec<f64>,
    /// Basis (d × r), in scaled units.
    pub basis: Mat<f64>,
    /// The r singular values kept, of the centred and scaled stack.
    pub singular_values: Vec<f64>,
    /// Weight λ on ‖a‖² (cost in scaled units); 0 when there is none.
    pub lambda: f64,
    /// What a disturbance makes of it, if one is fitted.
    pub(crate) driven: Option<Driven>,
}

impl TrajectorySpace {
    /// Number of directions r, those of a disturbance included.
    pub fn rank(&self) -> usize {
        self.basis.ncols()
    }

    /// The directions without those of a disturbance.
    pub fn undisturbed(&self) -> usize {
        self.rank() - self.driven.as_ref().map_or(0, |driven| driven.coordinates)
    }

    /// The windows of the linear model without a disturbance: x(0) are their coordinates.
    fn of_model(model: &LinearModel, layout: Layout, windows: usize) -> Self {
        let LinearModel { A, C, e, r, .. } = model;
        let Layout { n, p, depth, .. } = layout;
        let mut mean = vec![0.0; depth * (n + p) + n];
        let mut basis = Mat::zeros(mean.len(), n);
        let (mut x, mut power) = (Mat::<f64>::zeros(n, 1), Mat::<f64>::identity(n, n));
        for k in 0..=depth {
            let now = layout.x(k).start;
            (0..n).for_each(|i| mean[now + i] = x[(i, 0)]);
            basis.subrows_mut(now, n).copy_from(&power);
            if k == depth {
                break;
            }
            let (seen, y) = (C * &x, layout.y(k).start);
            (0..p).for_each(|i| mean[y + i] = seen[(i, 0)] + r[i]);
            basis.subrows_mut(y, p).copy_from(C * &power);
            x = A * &x;
            (0..n).for_each(|i| x[(i, 0)] += e[i]);
            power = A * &power;
        }
        TrajectorySpace {
            depth,
            windows,
            mean,
            basis,
            singular_values: vec![1.0; n],
            lambda: 0.0,
            driven: None,
        }
    }

    /// With those of a disturbance.
    fn driven_by(mut self, driving: &Driving, layout: Layout, scaling: &Scaling) -> Self {
        let (own, G, W) = (self.rank(), driving.columns(layout), driving.disturbances(layout));
        let beside = |own: usize, M: &Mat<f64>, before: &dyn Fn(usize, usize) -> f64| {
            Mat::from_fn(M.nrows(), own + M.ncols(), |i, j| match j.checked_sub(own) {
                None => before(i, j),
                Some(j) => M[(i, j)],
            })
        };
        let basis = beside(own, &G, &|i, j| self.basis[(i, j)]);
        self.basis = basis;
        self.driven = Some(Driven {
            coordinates: G.ncols(),
            rows: beside(own, &W, &|_, _| 0.0),
            units: driving.units(scaling),
            variances: driving.told_noise(scaling),
        });
        self
    }
}

/// All recorded windows up to one depth, factored once so that every depth's space is cheap.
///
/// With the windows as rows, [1 Wᵀ] = Q R. Because windows are ordered in time, the leading columns
/// of R are the factor of every shorter window over the same starts; a shorter depth only appends
/// the few windows that start too late for the deepest. The first column of R is the centring. One
/// QR of all data serves all depths; what is left for each is an SVD of at most d × d.
pub(crate) struct WindowStack<'a> {
    history: &'a History,
    scaling: &'a Scaling,
    response: Option<&'a OwnResponse>,
    equilibrium: Option<Rest<'a>>,
    driving: Option<&'a Driving>,
    depth: usize,
    R: OnceCell<Mat<f64>>, // of the windows of `depth`: min(N, 1+d) × (1+d)
    // and its depth: settings are tried at one depth after another
    latest: RefCell<Option<(usize, Rc<Decomposed>)>>,
    room: RefCell<MemBuffer>, // of the decompositions
}

/// The centred windows of one depth.
struct Decomposed {
    windows: usize,
    mean: Vec<f64>,  // c (d)
    U: Mat<f64>,     // right singular vectors of the factor, as columns
    sigma: Vec<f64>, // largest first
}

impl<'a> WindowStack<'a> {
    /// The windows of `depth`, without their forced motion where there are inputs.
    pub fn new(
        history: &'a History,
        (scaling, response): (&'a Scaling, Option<&'a OwnResponse>),
        depth: usize,
        equilibrium: Option<Rest<'a>>,
    ) -> Self {
        WindowStack {
            history,
            scaling,
            response,
            equilibrium,
            driving: None,
            depth,
            R: OnceCell::new(),
            latest: RefCell::default(),
            room: RefCell::new(MemBuffer::new(StackReq::EMPTY)),
        }
    }

    /// With a disturbance, if there is one.
    pub fn driven_by(mut self, driving: Option<&'a Driving>) -> Self {
        self.driving = driving;
        self
    }

    /// [1 Wᵀ] for windows of `depth`, leaving out those of each recording that also start a window
    /// of depth `covered`.
    fn rows(&self, depth: usize, covered: usize) -> Mat<f64> {
        let (n, p) = (self.history.n(), self.history.p());
        let mut starts = Vec::new();
        for i in 0..self.history.recordings() {
            let T = self.history.outputs(i).len() / p;
            let first = if covered == 0 { 0 } else { (T + 1).saturating_sub(covered) };
            starts.extend((first..(T + 1).saturating_sub(depth)).map(|k| (i, k)));
        }
        let mut rows = Mat::zeros(starts.len(), 1 + depth * (n + p) + n);
        for (row, &(i, k)) in starts.iter().enumerate() {
            // (16b): a column [1; x(k); y(k); …; x(k+depth)] of the stacked Hankel matrices, as a
            // row
            rows[(row, 0)] = 1.0;
            let (x, y) = (&self.history.states(i)[k * n..], &self.history.outputs(i)[k * p..]);
            let u = self.history.window_inputs(i, k, depth);
            let window = (&x[..(depth + 1) * n], &y[..depth * p], u);
            let entries = free_window(self.scaling, self.response, window);
            entries.into_iter().enumerate().for_each(|(a, v)| rows[(row, 1 + a)] = v);
        }
        rows
    }

    /// The space of windows of `depth`.
    pub fn space(&self, depth: usize, selection: &Selection) -> TrajectorySpace {
        if let Some(driving) = self.driving.filter(|driving| driving.stationary.is_some()) {
            let (layout, windows) = (self.layout(depth), self.history.windows(depth));
            let space = TrajectorySpace::of_model(&driving.model, layout, windows);
            return space.driven_by(driving, layout, self.scaling);
        }
        let latest = self
            .latest
            .borrow()
            .as_ref()
            .filter(|(of, _)| *of == depth)
            .map(|(_, windows)| Rc::clone(windows));
        let windows = latest.unwrap_or_else(|| {
            self.latest.take(); // its place is needed
            let windows = Rc::new(self.decomposed(depth));
            self.latest.replace(Some((depth, Rc::clone(&windows))));
            windows
        });
        let rounding = self.scaling.rounding(windows.windows, depth);
        let recorded = select(&windows, depth, rounding, selection);
        match self.driving {
            None => recorded,
            Some(driving) => recorded.driven_by(driving, self.layout(depth), self.scaling),
        }
    }

    fn layout(&self, depth: usize) -> Layout {
        let (n, p) = (self.history.n(), self.history.p());
        Layout { n, p, depth, driven: self.driving.is_some() }
    }

    fn decomposed(&self, depth: usize) -> Decomposed {
        let (n, p) = (self.history.n(), self.history.p());
        let d = depth * (n + p) + n;
        let recorded = self.history.windows(depth);
        let late = self.rows(depth, self.depth);
        let factor = self.R.get_or_init(|| {
            let rows = self.rows(self.depth, 0);
            upper(rows.as_ref(), rows.ncols())
        });
        let shared = factor.nrows().min(1 + d);
        let copies = if self.equilibrium.is_some() { copies(recorded) } else { 0 };

        let mut stacked = Mat::zeros(shared + late.nrows() + usize::from(copies > 0), 1 + d);
        for j in 0..=d {
            for i in 0..shared.min(j + 1) {
                stacked[(i, j)] = factor[(i, j)];
            }
            for i in 0..late.nrows() {
                stacked[(shared + i, j)] = late[(i, j)];
            }
        }
        if let Some(rest) = &self.equilibrium {
            // `copies` equal rows have the same factor as one row times √copies.
            let (row, weight) = (shared + late.nrows(), (copies as f64).sqrt());
            stacked[(row, 0)] = weight;
            let window = (
                &rest.x.repeat(depth + 1)[..],
                &rest.y.repeat(depth)[..],
                &rest.u.repeat(depth)[..],
            );
            let entries = free_window(self.scaling, self.response, window);
            for (j, v) in entries.into_iter().enumerate() {
                stacked[(row, 1 + j)] = weight * v;
            }
        }
        let windows = recorded + copies;
        let R = upper(stacked.as_ref(), 1 + d);
        drop((late, stacked));
        let mean = (0..d).map(|j| R[(0, 1 + j)] / R[(0, 0)]).collect();
        let factor = R.submatrix(1, 1, R.nrows() - 1, d);
        let (U, sigma) = right_singular(factor, &mut self.room.borrow_mut());
        Decomposed { windows, mean, U, sigma }
    }
}

/// The free motion of a window of states, outputs and inputs in the user's units: [x(0); y(0); …;
/// x(depth)] as scaled deviations, without what the inputs made of it.
pub(crate) fn free_window(
    scaling: &Scaling,
    response: Option<&OwnResponse>,
    (x, y, u): (&[f64], &[f64], &[f64]),
) -> Vec<f64> {
    let (n, p) = (scaling.s_x.len(), scaling.s_y.len());
    let ys = y.chunks_exact(p).chain([&[][..]]);
    let mut window: Vec<f64> =
        x.chunks_exact(n).zip(ys).flat_map(|(x, y)| scaling.deviations(x, y)).collect();
    if let Some(response) = response {
        let (x_f, y_f) = response.forced(&scaling.input_deviations(u).collect::<Vec<_>>());
        let y_f = y_f.chunks_exact(p).chain([&[][..]]);
        let forced = x_f.chunks_exact(n).zip(y_f).flat_map(|(x, y)| x.iter().chain(y));
        window.iter_mut().zip(forced).for_each(|(w, forced)| *w -= forced);
    }
    window
}

/// The triangular factor of a QR decomposition, min(rows, columns) × columns, zeros below the
/// diagonal.
fn upper(rows: MatRef<'_, f64>, columns: usize) -> Mat<f64> {
    let qr = rows.qr();
    let R = qr.thin_R();
    Mat::from_fn(R.nrows(), columns, |i, j| if i <= j { R[(i, j)] } else { 0.0 })
}

/// Mean, basis and weight of what a selection keeps.
fn select(
    found: &Decomposed,
    depth: usize,
    rounding: f64,
    selection: &Selection,
) -> TrajectorySpace {
    let Decomposed { windows, mean, U, sigma } = found;
    let (windows, d) = (*windows, mean.len());
    let sigma_1 = sigma.first().copied().unwrap_or(0.0);
    let floor = (sigma_1
        * (tol::RANK_EPS * windows.max(d) as f64).max(selection.tol.unwrap_or(0.0)))
    .max(tol::DATA_ROUNDING * rounding);
    let above = sigma.iter().take_while(|&&s| s > floor).count();
    let rank = above.min(selection.rank.unwrap_or(usize::MAX));
    let N = windows as f64;
    let lambda = match selection.penalty {
        Penalty::None => 0.0,
        Penalty::Normalised(weight) => weight,
        Penalty::Alpha(weight) => weight / N,
    };
    let length = |i: usize| if lambda > 0.0 { sigma[i] / N.sqrt() } else { 1.0 };
    let basis = Mat::from_fn(d, rank, |i, j| U[(i, j)] * length(j));
    TrajectorySpace {
        depth,
        windows,
        mean: mean.clone(),
        basis,
        singular_values: sigma[..rank].to_vec(),
        lambda,
        driven: None,
    }
}

/// Right singular vectors (as columns) and singular values, largest first.
///
/// One room serves all depths and is given back last: an allocator that gets large pieces back
/// between what stays keeps them, and pieces of their size, for itself.
fn right_singular(A: MatRef<'_, f64>, room: &mut MemBuffer) -> (Mat<f64>, Vec<f64>) {
    let (rows, columns) = A.shape();
    if rows == 0 {
        return (Mat::zeros(columns, 0), Vec::new());
    }
    let (thin, par, size) = (ComputeSvdVectors::Thin, Par::Seq, rows.min(columns));
    let (mut U, mut V) = (Mat::zeros(rows, size), Mat::zeros(columns, size));
    let mut S = Diag::zeros(size);
    let needed = svd_scratch::<f64>(rows, columns, thin, thin, par, Spec::default());
    if room.len() < needed.size_bytes() {
        *room = MemBuffer::new(StackReq::EMPTY); // before the next one: not both at once
        *room = MemBuffer::new(needed);
    }
    let (stack, params) = (MemStack::new(room), Spec::default());
    match svd(A, S.as_mut(), Some(U.as_mut()), Some(V.as_mut()), par, stack, params) {
        Ok(()) => (V, S.column_vector().iter().copied().collect()),
        // The iteration has no known failure on finite data; an empty space is reported by the
        // caller as a rank error.
        Err(_) => (Mat::zeros(A.ncols(), 0), Vec::new()),
    }
}
