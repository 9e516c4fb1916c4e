//! Windows of the recording that are estimated without it: what V, the errors and the innovations
//! are where the motion is like the recording.
//!
//! The last two fifths of a recording are estimated from what came before, from .6 T and from .8 T
//! on; of several recordings the four longest each from the others. The prior of each window is the
//! recorded state, its scales, weights and λ are those of the whole recording. Depths are M, M/2,
//! …, 1, each as long as the part it is made from has .4 T windows of it, 2n+1 at least.

use crate::driving::Driving;
use crate::error::Error;
use crate::evidence::cloud::Cloud;
use crate::history::History;
use crate::reduction::{Reduced, factorisation, reduce};
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::space::{Selection, TrajectorySpace, WindowStack, free_window};
use crate::variation::Rest;
use crate::weights::Weights;
use ddmhe_run::layout::Layout;
use faer::Mat;

/// Where the parts that are held out begin, and where the last one ends, in shares of the
/// recording.
const ORIGINS: [f64; 3] = [0.6, 0.8, 1.0];
/// Recordings that are held out in turn.
const RECORDINGS: usize = 4;
/// Windows that a depth needs of the part it is made from, as a share of its outputs.
const WINDOWS: f64 = 0.4;

/// What estimates are made with beside the recording.
#[derive(Clone, Copy)]
pub(crate) struct Setup<'a> {
    pub scaling: &'a Scaling,
    pub weights: &'a Weights,
    pub selection: &'a Selection,
    pub driving: Option<&'a Driving>,
    pub rest: Option<Rest<'a>>,
    /// Whether x̄ is the recording's mean: windows of a run from an unknown state.
    pub unknown: bool,
}

/// What windows of one depth were like, in scaled units.
#[derive(Debug, Clone, Default)]
pub(crate) struct Replayed {
    /// V of each.
    pub V: Vec<f64>,
    /// J of each.
    pub J: Vec<f64>,
    /// x̂ - x of each (n).
    pub errors: Vec<Vec<f64>>,
    /// How many windows there are at the end of each held-out stretch.
    pub stretches: Vec<usize>,
    /// What its newest output differs by from what the others say it is (p).
    pub innovations: Vec<Vec<f64>>,
}

/// A part that estimates are made from, and a recording of which they are made from sample `first`
/// on.
pub(crate) struct Fold {
    from: History,
    held_out: History,
    first: usize,
}

/// All depths, ascending; empty where nothing can be held out.
pub(crate) fn replay(
    history: &History,
    setup: Setup<'_>,
    horizon: usize,
) -> Result<Vec<(usize, Replayed)>, Error> {
    let folds = folds(history);
    let halves = std::iter::successors(Some(horizon), |depth| (*depth > 1).then_some(depth / 2));
    let mut depths: Vec<usize> = halves.collect();
    depths.reverse();
    let mut found: Vec<(usize, Replayed)> =
        depths.iter().map(|depth| (*depth, Replayed::default())).collect();
    for fold in &folds {
        let own = |depth: usize| fold.depth(depth);
        let deepest = own(horizon);
        let response = setup.response(&fold.from, horizon);
        let scales = (setup.scaling, response.as_ref());
        let stack =
            WindowStack::new(&fold.from, scales, deepest, setup.rest).driven_by(setup.driving);
        // the deepest first: the stack keeps the latest
        for (depth, found) in found.iter_mut().rev() {
            let space = stack.space(own(*depth), setup.selection);
            fold.estimate(&setup, response.as_ref(), &space, found)?;
        }
    }
    found.retain(|(_, replayed)| !replayed.V.is_empty());
    Ok(found)
}

impl Setup<'_> {
    fn response(&self, history: &History, horizon: usize) -> Option<OwnResponse> {
        match self.driving.filter(|driving| driving.stationary.is_some()) {
            Some(driving) => OwnResponse::of_model(&driving.model, self.scaling, horizon),
            None => OwnResponse::new(history, self.scaling, horizon),
        }
    }
}

pub(crate) fn folds(history: &History) -> Vec<Fold> {
    let count = history.recordings();
    let outputs = |i: usize| history.outputs(i).len() / history.p();
    if count == 1 {
        let T = outputs(0);
        let at = ORIGINS.map(|share| (share * T as f64) as usize);
        let fold = |(first, end): (&usize, &usize)| Fold {
            from: history.stretch(0, 0..*first),
            held_out: history.stretch(0, 0..*end),
            first: *first,
        };
        let whole = |(first, end): &(&usize, &usize)| **first > history.n() && end > first;
        return at.iter().zip(&at[1..]).filter(whole).map(fold).collect();
    }
    let mut longest: Vec<usize> = (0..count).collect();
    longest.sort_by_key(|&i| std::cmp::Reverse(outputs(i)));
    let fold = |&i: &usize| Fold {
        from: history.without(i),
        held_out: history.stretch(i, 0..outputs(i)),
        first: 0,
    };
    longest.iter().take(RECORDINGS).map(fold).collect()
}

impl Fold {
    /// D of the held-out state that is furthest from those that its estimates are made from.
    pub fn farthest(&self, scaling: &Scaling) -> f64 {
        let n = self.from.n();
        let from = (0..self.from.recordings()).flat_map(|i| self.from.states(i).chunks_exact(n));
        let cloud = Cloud::new(from, scaling);
        let held_out = self.held_out.states(0).chunks_exact(n).skip(self.first + 1);
        held_out.map(|x| cloud.distance(x, scaling)).fold(0.0, f64::max)
    }

    /// As deep as a window of `depth` may be.
    fn depth(&self, depth: usize) -> usize {
        let (T, n) = (self.from.T(), self.from.n());
        let needed = (2 * n + 1).max((WINDOWS * T as f64) as usize);
        let enough = |depth: &usize| self.from.windows(*depth) >= needed;
        let most = (1..=depth).rev().find(enough).unwrap_or(1);
        most.min(self.held_out.T())
    }

    /// Windows of the held-out recording that end in its part.
    fn estimate(
        &self,
        setup: &Setup<'_>,
        response: Option<&OwnResponse>,
        space: &TrajectorySpace,
        found: &mut Replayed,
    ) -> Result<(), Error> {
        let (n, p, m) = (self.from.n(), self.from.p(), space.depth);
        let layout = Layout { n, p, depth: m, driven: setup.driving.is_some() };
        let reduced = reduce(layout, space, setup.weights, false, None).map_err(factorisation)?;
        let ends: Vec<usize> = ((self.first + 1).max(m)..=self.held_out.T()).collect();
        let (x, y) = (self.held_out.states(0), self.held_out.outputs(0));
        let window = |end: &usize| {
            let k = end - m;
            let u = self.held_out.window_inputs(0, k, m);
            let of = (&x[k * n..(end + 1) * n], &y[k * p..end * p], u);
            free_window(setup.scaling, response, of)
        };
        let windows: Vec<Vec<f64>> = ends.iter().map(window).collect();
        let seen: Vec<usize> = layout.seen().collect();
        // x̄ is the recorded state, or the recording's mean
        let prior = |i: usize, value: f64| if setup.unknown && i < n { 0.0 } else { value };
        let f = Mat::from_fn(seen.len(), windows.len(), |i, k| {
            prior(i, windows[k][seen[i]]) - space.mean[seen[i]]
        });
        let Reduced { K, A, .. } = &reduced;
        let z = K * &f;
        let fitted = Mat::from_fn(seen.len(), A.ncols(), |i, j| A[(seen[i], j)]);
        let residual = &f - &fitted * &z;
        let last = layout.x(m).start;
        let states = A.subrows(last, n) * &z;
        let deleted = deleted(&reduced, layout);
        let blocks = setup.weights.blocks(layout, &vec![true; m * p]);
        for k in 0..windows.len() {
            let column = |M: &Mat<f64>| M.col(k).iter().copied().collect::<Vec<f64>>();
            let (f, left) = (column(&f), column(&residual));
            let [inner, J] = setup.weights.products(&blocks, &f, &left);
            let penalised = space.lambda > 0.0 || setup.driving.is_some();
            found.V.push(if penalised { inner } else { J });
            found.J.push(if setup.driving.is_some() { inner } else { J });
            let error = |i: usize| states[(i, k)] + space.mean[last + i] - windows[k][last + i];
            found.errors.push((0..n).map(error).collect());
            let newest = &left[seen.len() - p..];
            let own = |i: usize| (0..p).map(|j| deleted[(i, j)] * newest[j]).sum::<f64>();
            found.innovations.push((0..p).map(own).collect());
        }
        found.stretches.push(found.V.len());
        Ok(())
    }
}

/// (I - H_nn)⁻¹ (p × p): from the newest fitted noise to what the newest output differs by from
/// what the others say it is.
pub(crate) fn deleted(Reduced { K, A, .. }: &Reduced, layout: Layout) -> Mat<f64> {
    let (p, newest) = (layout.p, layout.y(layout.depth - 1).start);
    let H = A.subrows(newest, p) * K.subcols(K.ncols() - p, p);
    let rest = Mat::from_fn(p, p, |i, j| f64::from(u8::from(i == j)) - H[(i, j)]);
    use faer::linalg::solvers::DenseSolveCore;
    rest.partial_piv_lu().inverse()
}
