//! One window's problem: the numbers that it is made of, the data that it is given, and the room
//! that it is solved in.

use crate::active_set::problem::Windows;
use crate::active_set::rows::Rows;
use crate::at_once::AtOnce;
use crate::evidence::{Minimum, OfDepth};
use crate::kalman::Filtered;
use crate::panels::Panels;
use crate::plan::common::{Limits, Shared};
use crate::plan::depth::Depth;
use crate::status::Status;

/// One window's data.
#[derive(Debug, Clone, Copy)]
pub struct Data<'a> {
    /// x̄ (n), deviations.
    pub prior: &'a [f64],
    /// y (m·p), deviations, NaN where not measured.
    pub outputs: &'a [f64],
    /// Whether there is a NaN.
    pub missing: bool,
    /// The window as a Kalman filter has it, where the weights are the recording's and all of it
    /// was measured.
    pub filtered: Option<Filtered<'a>>,
    /// What the weight of the prior lacks (n·n, by rows, in scaled units), where outputs before the
    /// window were lost.
    pub lacking: Option<&'a [f64]>,
    /// What makes states of the window's deviations, in the user's units ((m+1)·n): the recording's
    /// means, and where there are inputs the forced motion beside them. The outputs are then
    /// without theirs.
    pub means: &'a [f64],
    /// Bounds on the states for this step alone: n numbers each, or (m+1)·n.
    pub x_bounds: Option<Limits<'a>>,
    /// Whether z*, its window and v are in the scratch and in the answer.
    pub begun: bool,
}

/// Where a window's answer goes, in the user's units.
#[derive(Debug)]
pub struct Fit<'a> {
    /// States ((m+1)·n), oldest first.
    pub states: &'a mut [f64],
    /// Fitted noise v (m·p), NaN where not measured.
    pub v: &'a mut [f64],
    /// Fitted disturbance w (m·n); empty where none is fitted.
    pub w: &'a mut [f64],
}

/// Numbers that a step works with, each for the deepest window and the highest rank.
#[derive(Debug)]
pub struct Scratch<'a> {
    /// z*.
    pub unconstrained: &'a mut [f64],
    /// The answer: states, outputs and disturbances, each padded.
    pub window: &'a mut [f64],
    /// What most steps do not look at.
    pub spare: Spare<'a>,
}

/// Room that most steps do not look at: where its parts lie is found when they are asked for.
#[derive(Debug)]
pub struct Spare<'a> {
    /// All of it.
    pub block: &'a mut [f64],
    /// Numbers in each part, in the order of [`Spared`]; the rest is the last one's.
    pub lengths: &'a [usize; 10],
}

/// Its parts.
#[derive(Debug)]
pub struct Spared<'a> {
    /// p × p.
    pub block: &'a mut [f64],
    /// n.
    pub moved: &'a mut [f64],
    /// z.
    pub z: &'a mut [f64],
    /// Lower bounds in the order of the window.
    pub lo: &'a mut [f64],
    /// Upper bounds.
    pub hi: &'a mut [f64],
    /// y with numbers in the place of NaN.
    pub outputs: &'a mut [f64],
    /// L with Hessian L Lᵀ, by rows.
    pub hessian_factor: &'a mut [f64],
    /// For the smoother of [`kalman`](crate::kalman).
    pub smoothing: &'a mut [f64],
    /// For the maps of a window with lost outputs: see [`evidence`](crate::evidence).
    pub sensitivity: &'a mut [f64],
    /// Innovations of the newest output and their variances (p each), where outputs are doubted.
    pub innovation: &'a mut [f64],
    /// Of the active-set method.
    pub work: &'a mut [f64],
}

impl Spare<'_> {
    /// Its parts.
    #[inline(always)]
    pub fn parts(&mut self) -> Spared<'_> {
        let [block, moved, z, lo, hi, outputs, hessian_factor, smoothing, sensitivity, innovation] =
            *self.lengths;
        let (block, room) = self.block.split_at_mut(block);
        let (moved, room) = room.split_at_mut(moved);
        let (z, room) = room.split_at_mut(z);
        let (lo, room) = room.split_at_mut(lo);
        let (hi, room) = room.split_at_mut(hi);
        let (outputs, room) = room.split_at_mut(outputs);
        let (hessian_factor, room) = room.split_at_mut(hessian_factor);
        let (smoothing, room) = room.split_at_mut(smoothing);
        let (sensitivity, room) = room.split_at_mut(sensitivity);
        let (innovation, work) = room.split_at_mut(innovation);
        Spared {
            block,
            moved,
            z,
            lo,
            hi,
            outputs,
            hessian_factor,
            smoothing,
            sensitivity,
            innovation,
            work,
        }
    }
}

/// How the answer of one window was found.
#[derive(Debug, Clone, Copy, Default)]
pub struct WindowSolution {
    /// What the optimisation found.
    pub status: Status,
    /// Whether what is in the scratch are numbers within reach, whatever the status.
    pub sound: bool,
    /// (17), and what is paid for leaving bounds.
    pub cost: f64,
    /// Number of bounds that the window touches or leaves.
    pub active: usize,
    /// Changes of the active set.
    pub iterations: u32,
    /// Whether it is what the filter has.
    pub filtered: bool,
    /// Whether bounds keep it from the minimiser without them.
    pub constrained: bool,
    /// Whether the Hessian is that in the scratch.
    pub downdated: bool,
    /// What it says of itself, where evidence is asked for.
    pub minimum: Minimum,
}

/// Everything about the windows of one depth that depends only on the recording and the settings:
/// see [`Depth`] for what each array is.
#[derive(Debug, Clone, Copy)]
pub struct WindowProblem<'a> {
    /// What all depths share.
    pub shared: Shared<'a>,
    /// Sizes, and what kind of problem it is.
    pub depth: Depth,
    pub(crate) z_0: &'a [f64],
    pub(crate) gain: Panels<'a>,
    pub(crate) window: Panels<'a>,
    pub(crate) rows: Rows<'a>,
    pub(crate) x_limits: Limits<'a>,
    pub(crate) prior: &'a [f64],
    pub(crate) center: &'a [f64],
    pub(crate) center_gain: Panels<'a>,
    pub(crate) evidence: Option<OfDepth<'a>>,
    pub(crate) at_once: Option<AtOnce<'a>>,
}

impl<'a> WindowProblem<'a> {
    /// From where the arrays of one depth are and their numbers.
    pub fn new(shared: Shared<'a>, depth: Depth, own: &'a [f64]) -> Self {
        let (layout, [lo, hi]) = (depth.layout, depth.x_limits);
        WindowProblem {
            shared,
            depth,
            z_0: depth.z_0.of(own),
            gain: Panels::new(layout.seen_len(), depth.gain.of(own)),
            window: Panels::new(depth.rank, depth.window.of(own)),
            rows: depth.rows(own),
            x_limits: Limits { lo: lo.of(own), hi: hi.of(own) },
            prior: depth.prior.of(own),
            center: depth.center.of(own),
            center_gain: Panels::new(layout.outputs_len(), depth.center_gain.of(own)),
            evidence: depth.kind.judged.then(|| OfDepth::new(depth.evidence, own)),
            at_once: AtOnce::new(&shared, &depth),
        }
    }
}

impl Data<'_> {
    /// Whether the cost is another than the one that was prepared.
    #[inline(always)]
    pub fn is_reweighted(&self) -> bool {
        self.missing || self.lacking.is_some()
    }
}

impl WindowProblem<'_> {
    /// What makes states of the window's deviations: the recording's means, unless inputs moved
    /// them.
    #[inline(always)]
    pub fn means<'b>(&'b self, moved: Option<&'b [f64]>) -> &'b [f64] {
        moved.unwrap_or_else(|| self.shared.means(self.depth.layout))
    }
}

impl Windows for WindowProblem<'_> {
    #[inline(always)]
    fn window(&self, z: &[f64], window: &mut [f64]) {
        self.window.tall(self.rows.offset, z, window);
    }

    fn erased(&self) -> &dyn Windows {
        self
    }
}
