//! From a recording's trajectory space and the weights to the block of numbers of one depth that a
//! step reads, and to the block that all depths share: see [`ddmhe_run::plan`].

use crate::block::Block;
use crate::config::Bounds;
use crate::driving::Driving;
use crate::evidence::maps::Maps;
use crate::evidence::model::ModelNumbers;
use crate::evidence::{Calibration, PlanNumbers};
use crate::first_window::Samples;
use crate::reduction::{Reduced, reduce};
use crate::response::OwnResponse;
use crate::riccati::Filter;
use crate::scaling::Scaling;
use crate::space::TrajectorySpace;
use crate::surplus::Surplus;
use crate::tol;
use crate::weights::Weights;
#[cfg(feature = "serde")]
use ddmhe_run::active_set::ActiveBound;
use ddmhe_run::active_set::RowsMut;
use ddmhe_run::evidence::ModelSpans;
use ddmhe_run::layout::Layout;
use ddmhe_run::panels::write_panels;
use ddmhe_run::plan::{Common, Depth, Kind, Margin, Shared, Sizes, Span};
use ddmhe_run::problem::WindowProblem;
use faer::linalg::solvers::SvdError;
use faer::{Mat, MatRef};
use std::sync::Arc;

/// Everything about one depth that depends only on the recording and the settings, factored.
pub(crate) struct Draft {
    /// The map x̄(t-m) → x̂(t) with y = 0 (n × n).
    pub prior_map: Mat<f64>,
    depth: Depth,
    surplus: Option<Surplus>, // where the cost leaves a choice
    block: Block,
    maps: Option<Maps>, // what evidence is made with, if any is asked for
}

/// The same, to be solved.
pub(crate) struct Prepared {
    pub surplus: Option<Surplus>,
    ready: Ready,
}

// A problem is slices of its blocks: they are made once, not at every step.
self_cell::self_cell!(
    struct Ready {
        owner: (Arc<Ground>, Block),
        #[covariant]
        dependent: WindowProblem,
    }
);

impl Draft {
    /// Factors the problem. `measured` (m·p, time-major) says which outputs exist; None: all.
    /// `judged` are the variances of stated noise, where answers carry evidence.
    pub fn new(
        layout: Layout,
        space: &TrajectorySpace,
        scaling: &Scaling,
        weights: &Weights,
        (x_bounds, centered): (Option<&Bounds>, bool),
        (measured, judged): (Option<&[bool]>, Option<&[f64]>),
    ) -> Result<Self, SvdError> {
        let reduced = reduce(layout, space, weights, centered, measured)?;
        let kind = Kind {
            centered,
            plain_prior: weights.plain_prior(),
            surplus: reduced.unseen.is_some(),
            for_pattern: measured.is_some(),
            filtered: weights.settled() && measured.is_none(),
            penalised: space.lambda > 0.0,
            judged: judged.is_some(),
        };
        let depth = Depth {
            prior_weight: weights.discount(layout.depth) * weights.unit,
            ..Depth::new(layout, space.rank(), kind)
        };
        let mut block = Block::new(depth.len);
        depth.write_header(block.numbers_mut());
        write_maps(&depth, &reduced, space, &mut block);
        write_rows(&depth, &reduced, space, scaling, &mut block);
        write_limits(&depth, x_bounds, scaling, &mut block);
        block.write(depth.prior, weights.prior_factor());
        let noise = judged.filter(|_| measured.is_none());
        let maps = noise.map(|noise| Maps::new(layout, &reduced, weights, noise));
        let (last, r) = (layout.x(layout.depth).start, depth.rank);
        let Reduced { K, A, .. } = &reduced;
        let entry = |i: usize, j: usize| (0..r).map(|k| A[(last + i, k)] * K[(k, j)]).sum();
        let prior_map = Mat::from_fn(layout.n, layout.n, entry);
        let rows = depth.rows(block.numbers());
        let surplus = reduced.unseen.map(|unseen| Surplus::new(&rows, unseen));
        Ok(Draft { surplus, prior_map, depth, block, maps })
    }

    /// With what its windows are measured by; `opening`: in a run from an unknown state.
    pub fn measured_by(&mut self, (evidence, opening): (&Calibration, bool), scaling: &Scaling) {
        let Some(maps) = self.maps.take() else { return };
        let numbers = evidence.of_depth((self.depth.layout, opening), &maps, scaling);
        let spans = self.depth.evidence;
        self.block.write(spans.levels, numbers.levels);
        self.block.write(spans.carry, numbers.carry);
        self.block.write(spans.error, numbers.error);
        self.block.write(spans.deleted, numbers.deleted);
        self.block.write(spans.of_prior, numbers.of_prior);
        self.block.write(spans.innovation, numbers.innovation);
        self.block.write(spans.settled, numbers.settled);
        self.block.write(spans.going_on, numbers.going_on);
    }

    /// Number of directions r.
    pub fn rank(&self) -> usize {
        self.depth.rank
    }

    /// To be solved, beside what all depths share.
    pub fn on(self, ground: &Arc<Ground>) -> Prepared {
        let Draft { surplus, depth, block, .. } = self;
        let ready = Ready::new((Arc::clone(ground), block), |(ground, block)| {
            WindowProblem::new(ground.shared(), depth, block.numbers())
        });
        Prepared { surplus, ready }
    }

    /// All of them likewise.
    pub fn all_on(drafts: Vec<Draft>, ground: &Arc<Ground>) -> Vec<Prepared> {
        drafts.into_iter().map(|draft| draft.on(ground)).collect()
    }
}

impl Prepared {
    /// The problem.
    #[inline(always)]
    pub fn problem(&self) -> &WindowProblem<'_> {
        self.ready.borrow_dependent()
    }

    /// Sizes of its windows.
    #[inline(always)]
    pub fn layout(&self) -> Layout {
        self.problem().depth.layout
    }

    /// Whether these can be active bounds of this problem.
    #[cfg(feature = "serde")]
    pub fn allows(&self, sides: &[ActiveBound]) -> bool {
        let rows = self.layout().apart();
        let known = |side: &ActiveBound| side.row < rows && (side.sign == 1.0 || side.sign == -1.0);
        sides.len() <= self.problem().depth.rank && sides.iter().all(known)
    }
}

/// z_0 and K, and z_c0 and K_c: z = K ([x̄; y] - c).
fn write_maps(depth: &Depth, reduced: &Reduced, space: &TrajectorySpace, block: &mut Block) {
    let c: Vec<f64> = depth.layout.seen().map(|row| space.mean[row]).collect();
    let mut map = |K: MatRef<'_, f64>, c: &[f64], constant: Span, gain: Span| {
        let minus = |i: usize| -c.iter().enumerate().map(|(j, c)| K[(i, j)] * c).sum::<f64>();
        block.write(constant, (0..K.nrows()).map(minus));
        write_panels(K.shape(), |i, j| K[(i, j)], gain.of_mut(block.numbers_mut()));
    };
    map(reduced.K.as_ref(), &c, depth.z_0, depth.gain);
    if let Some(K_c) = &reduced.K_c {
        map(K_c.as_ref(), &c[depth.layout.n..], depth.center, depth.center_gain);
    }
}

/// (16b): the rows of w = c + A z, apart: states and disturbances in the user's units, outputs as
/// deviations.
fn write_rows(
    depth: &Depth,
    Reduced { A, A_w, .. }: &Reduced,
    space: &TrajectorySpace,
    scaling: &Scaling,
    block: &mut Block,
) {
    let Layout { n, p, .. } = depth.layout;
    let (r, split, len) = (depth.rank, depth.layout.split(), depth.layout.apart());
    let moves = moving(space);
    let (mut rows, mut offset, mut unit) = (Mat::zeros(len, r), vec![0.0; len], vec![0.0; len]);
    for (i, row) in depth.layout.states().enumerate() {
        (0..r).filter(|_| moves[row]).for_each(|j| rows[(i, j)] = A[(row, j)] * scaling.s_x[i % n]);
        (offset[i], unit[i]) = (space.mean[row] * scaling.s_x[i % n], scaling.unit_x[i % n]);
    }
    for (k, row) in depth.layout.outputs().enumerate() {
        let i = split + k;
        (0..r).filter(|_| moves[row]).for_each(|j| rows[(i, j)] = A[(row, j)]);
        (offset[i], unit[i]) = (space.mean[row], scaling.unit_y[k % p] / scaling.s_y[k % p]);
    }
    let second = depth.layout.second_split();
    if let (Some(A_w), Some(driven)) = (A_w, &space.driven) {
        for k in 0..A_w.nrows() {
            let (i, s) = (second + k, scaling.s_x[k % n]);
            (0..r).for_each(|j| rows[(i, j)] = A_w[(k, j)] * s);
            unit[i] = driven.units[k % n];
        }
    }
    let numbers = block.numbers_mut();
    write_panels((len, r), |i, j| rows[(i, j)], depth.window.of_mut(numbers));
    block.write(depth.offset, offset);
    block.write(depth.unit, unit.iter().copied());
    let (mut normals, mut inverse, mut slack) =
        (vec![0.0; depth.normals.len()], vec![0.0; len], vec![0.0; len]);
    RowsMut { normals: &mut normals, inverse: &mut inverse, slack: &mut slack }.write(
        r,
        |i, j| rows[(i, j)],
        &unit,
    );
    block.write(depth.normals, normals);
    block.write(depth.inverse, inverse);
    block.write(depth.slack, slack);
}

/// (16c): the configured box on the states, as distances from their means; with bounds about x_c(t)
/// those of a step replace it.
fn write_limits(depth: &Depth, x_bounds: Option<&Bounds>, scaling: &Scaling, block: &mut Block) {
    let (n, used) = (depth.layout.n, depth.layout.states_len());
    let mean = |i: usize| if depth.kind.centered { 0.0 } else { scaling.mean_x[i % n] };
    let limit = |values: Option<&Vec<f64>>, none: f64, i: usize| match values {
        Some(values) if i < used => values[i % values.len()] - mean(i),
        _ => none,
    };
    let [lo, hi] = depth.x_limits;
    let split = depth.layout.split();
    let (low, high) = (x_bounds.map(|b| &b.lo), x_bounds.map(|b| &b.hi));
    block.write(lo, (0..split).map(|i| limit(low, f64::NEG_INFINITY, i)));
    block.write(hi, (0..split).map(|i| limit(high, f64::INFINITY, i)));
}

/// The filter that a window without bounds is, with the weights of the recording.
fn write_filter(common: &Common, driving: &Driving, filter: &Filter, block: &mut Block) {
    let (spans, model) = (common.kalman, &driving.model);
    for (M, span) in [
        (&filter.ahead, spans.filter),
        (&filter.smoother, spans.smoother),
        (&model.C, spans.output),
    ] {
        write_panels(M.shape(), |i, j| M[(i, j)], span.of_mut(block.numbers_mut()));
    }
    for (M, span) in [
        (&model.A, spans.A),
        (&model.B, spans.B),
        (&model.C, spans.C),
        (&model.D, spans.D),
        (&driving.Q, spans.Q),
        (&filter.P, spans.P),
        (&filter.information, spans.information),
    ] {
        block.write(span, by_rows(M));
    }
    block.write(spans.e, model.e.iter().copied());
    block.write(spans.R, driving.R.iter().copied());
    block.write(spans.offset, filter.offset.iter().copied());
    block.write(spans.output_offset, model.r.iter().copied());
}

/// What the recording leaves open of that filter's model.
fn write_model(spans: ModelSpans, model: &ModelNumbers, block: &mut Block) {
    for (M, span) in [
        (&model.carry, spans.carry),
        (&model.error, spans.error),
        (&model.whiten, spans.whiten),
        (&model.bias, spans.bias),
    ] {
        block.write(span, by_rows(M));
    }
    block.write(spans.mean, model.mean.iter().copied());
    block.write(spans.samples, model.samples);
}

/// The entries of a matrix, row by row.
fn by_rows(M: &Mat<f64>) -> Vec<f64> {
    let columns = M.ncols();
    (0..M.nrows() * columns).map(|k| M[(k / columns, k % columns)]).collect()
}

/// Which rows of the window move at all: what is left of one that does not is rounding of the
/// decomposition, and bounds on it would send the minimiser far away for nothing.
fn moving(space: &TrajectorySpace) -> Vec<bool> {
    let lengths: Vec<f64> = space.basis.row_iter().map(|row| row.norm_l2()).collect();
    let largest = lengths.iter().copied().fold(0.0, f64::max);
    lengths.iter().map(|&length| length > tol::UNMOVED * largest).collect()
}

/// The block that all depths share, and the window that a new run begins with.
pub(crate) struct Ground {
    common: Common,
    block: Block,
}

impl Ground {
    /// `start`: a new run's window.
    pub fn new(
        sizes: Sizes,
        (scaling, response): (&Scaling, Option<&OwnResponse>),
        (weights, driving): (&Weights, Option<&Driving>),
        [x, v, w]: [Option<&Bounds>; 3],
        (start, evidence): (&Samples, Option<PlanNumbers>),
    ) -> Self {
        let (M, n, p) = (sizes.horizon, sizes.n, sizes.p);
        let of_w = driving.map_or(vec![1.0], |driving| driving.units(scaling));
        let price = driving
            .map_or(0.0, |driving| weights.price(&driving.told_noise(scaling)) * weights.unit);
        let common = Common {
            margins: [&scaling.unit_x, &scaling.unit_y, &of_w].map(|units| Margin::new(units)),
            rho: weights.rho,
            unit: weights.unit,
            price,
            ..Common::new(sizes)
        };
        let mut block = Block::new(common.len);
        let inverse = |s: &[f64]| s.iter().map(|s| 1.0 / s).collect::<Vec<_>>();
        let (per_s_x, per_s_y) = (inverse(&scaling.s_x), inverse(&scaling.s_y));
        let mut write = |span: Span, values: &[f64], times: usize| {
            block.write(span, values.iter().copied().cycle().take(values.len() * times));
        };
        write(common.mean_x, &scaling.mean_x, 1);
        write(common.s_x, &scaling.s_x, 1);
        write(common.per_s_x, &per_s_x, 1);
        write(common.mean_y, &scaling.mean_y, 1);
        write(common.s_y, &scaling.s_y, 1);
        write(common.means, &scaling.mean_x, M + 1);
        write(common.scales[0], &scaling.s_y, M);
        write(common.scales[1], &per_s_y, M);
        write(common.mean_u, &scaling.mean_u, 1);
        write(common.s_u, &scaling.unit_u, 1);
        write(common.theta, response.map_or(&[], OwnResponse::theta), 1);
        write(common.states, &start.states, 1);
        write(common.outputs, &start.outputs, 1);
        write(common.inputs, &start.inputs, 1);
        let whitening = driving.map_or(vec![], |driving| driving.whitening(scaling));
        write(common.whitening, &whitening, 1);
        let limits =
            [(x, common.x_limits, n), (v, common.v_limits, M * p), (w, common.w_limits, M * n)];
        for (bounds, spans, times) in limits {
            let Some(bounds) = bounds else { continue };
            write(spans[0], &bounds.lo, times / bounds.lo.len());
            write(spans[1], &bounds.hi, times / bounds.hi.len());
        }
        block.write(common.R, weights.output_weight());
        block.write(common.discount, (1..=M).map(|age| weights.age(age)));
        if let Some((driving, filter)) = driving.and_then(|own| Some((own, own.filter()?))) {
            write_filter(&common, driving, &filter, &mut block);
        }
        if let Some(noise) = weights.diagonal_noise(M, &scaling.s_y) {
            let weighed = |(k, w): (usize, &f64)| w * scaling.s_y[k % p];
            block.write(common.evidence.weights, noise.iter().enumerate().map(weighed));
            block.write(common.noise, noise);
        }
        if let Some(numbers) = evidence {
            let spans = common.evidence;
            block.write(spans.start, numbers.start);
            block.write(spans.per_spread, numbers.per_spread);
            block.write(spans.away, numbers.away);
            block.write(spans.uncertain, numbers.uncertain);
            for (range, of) in [(numbers.x_range, spans.x_range), (numbers.u_range, spans.u_range)]
            {
                range.into_iter().zip(of).for_each(|(values, span)| block.write(span, values));
            }
            block.write(spans.patience, numbers.patience);
            block.write(spans.growth, numbers.growth);
            block.write(spans.drift, numbers.drift);
            if let Some(model) = numbers.model {
                write_model(spans.model, &model, &mut block);
            }
        }
        Ground { common, block }
    }

    /// To be read.
    pub fn shared(&self) -> Shared<'_> {
        Shared::new(&self.common, self.block.numbers())
    }

    /// Sizes and choices.
    pub fn sizes(&self) -> Sizes {
        self.common.sizes
    }

    /// All blocks as one plan: see [`ddmhe_run::Plan::from_bytes`].
    pub fn bytes(&self, problems: &[Prepared], opening: &[Prepared]) -> Vec<u8> {
        let all = || problems.iter().chain(opening);
        let total =
            self.common.len + all().map(|prepared| prepared.problem().depth.len).sum::<usize>();
        let mut numbers = self.block.numbers().to_vec();
        let blocks = [problems.len(), opening.len()];
        self.common.write_header(&mut numbers, total, blocks);
        for prepared in all() {
            let (_, block) = prepared.ready.borrow_owner();
            numbers.extend_from_slice(block.numbers());
        }
        ddmhe_run::plan::seal(&mut numbers);
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }
}
