//! The block of one depth of a plan, and which depths are kept.

use crate::active_set::rows::Rows;
use crate::evidence::DepthSpans;
use crate::layout::Layout;
use crate::panels::{padded, panels_len};
use crate::plan::span::{Cursor, Span};
use crate::tol;

/// Numbers in the header of the block of one depth.
pub(crate) const HEAD: usize = 8;

/// What distinguishes the block of one depth beside its sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Kind {
    /// Whether bounds on the states are about x_c(t).
    pub centered: bool,
    /// Whether the weight of the prior is diagonal.
    pub plain_prior: bool,
    /// Whether the cost leaves directions to the least norm: bounds then take two stages.
    pub surplus: bool,
    /// Whether it was made for the outputs that one window has.
    pub for_pattern: bool,
    /// Whether its minimiser is a Kalman filter's where no bound is active.
    pub filtered: bool,
    /// Whether ‖α‖² has a weight.
    pub penalised: bool,
    /// Whether its answers carry evidence.
    pub judged: bool,
}

/// The block of one depth: where its arrays are. All in scaled units, but for the state and
/// disturbance rows, which are in the user's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth {
    /// Sizes of its windows.
    pub layout: Layout,
    /// Number of directions r.
    pub rank: usize,
    /// What it is.
    pub kind: Kind,
    /// 2ρ^m of (17), of a distance in scaled units; 1 at an unknown start.
    pub prior_weight: f64,
    /// z_0 (r, padded): z* = z_0 + K \[x̄; y\].
    pub z_0: Span,
    /// K in panels (r × (n + m p)).
    pub gain: Span,
    /// A in panels, w = c + A z, all rows.
    pub window: Span,
    /// c, all rows.
    pub offset: Span,
    /// What a tolerance on each row is in units of.
    pub unit: Span,
    /// See [`Rows`].
    pub slack: Span,
    /// See [`Rows`].
    pub inverse: Span,
    /// See [`Rows`].
    pub normals: Span,
    /// Bounds on the state rows: distances from the means.
    pub x_limits: [Span; 2],
    /// √ of P of (17): its diagonal (n), or U with P = UᵀU (n × n, by rows).
    pub prior: Span,
    /// z_c0 (r, padded) of z_c = z_c0 + K_c y, if centred.
    pub center: Span,
    /// K_c in panels (r × m p), if centred.
    pub center_gain: Span,
    /// What the evidence on its answers is made with.
    pub evidence: DepthSpans,
    /// Numbers in the block, header included.
    pub len: usize,
}

impl Depth {
    /// Of these sizes.
    pub fn new(layout: Layout, rank: usize, kind: Kind) -> Self {
        let mut next = Cursor(HEAD);
        let (split, rows, n) = (layout.split(), layout.apart(), layout.n);
        let centered = |len: usize| if kind.centered { len } else { 0 };
        let mut depth = Depth {
            layout,
            rank,
            kind,
            prior_weight: 1.0,
            gain: next.take(panels_len(rank, layout.seen_len())),
            window: next.take(panels_len(rows, rank)),
            z_0: next.take(padded(rank)),
            offset: next.take(rows),
            unit: next.take(rows),
            slack: next.take(rows),
            inverse: next.take(rows),
            normals: next.take(rows * Rows::stride_of(rank)),
            x_limits: [next.take(split), next.take(split)],
            prior: next.take(if kind.plain_prior { n } else { n * n }),
            center: next.take(centered(padded(rank))),
            center_gain: next.take(centered(panels_len(rank, layout.outputs_len()))),
            evidence: DepthSpans::new([n, layout.p], kind.judged, &mut next),
            len: 0,
        };
        depth.len = next.0;
        depth
    }

    /// What its rows are to the active-set method.
    #[inline(always)]
    pub fn rows(self, own: &[f64]) -> Rows<'_> {
        Rows {
            r: self.rank,
            normals: self.normals.of(own),
            offset: self.offset.of(own),
            inverse: self.inverse.of(own),
            slack: self.slack.of(own),
            unit: self.unit.of(own),
        }
    }
}

/// Depths of the windows that a run grows through, from the horizon down to 1. `every`: each of
/// them, Algorithm 1 as printed; otherwise, above [`SHORT`](tol::SHORT), each is at most half as
/// deep again as the next.
pub fn kept_depths(horizon: usize, every: bool) -> impl Iterator<Item = usize> {
    let next = move |depth: usize| match depth {
        depth if every || depth <= tol::SHORT => depth - 1,
        depth => (depth - depth.div_ceil(tol::DEPTHS)).max(tol::SHORT),
    };
    let down = move |depth: &usize| Some(next(*depth)).filter(|depth| *depth > 0);
    core::iter::successors(Some(horizon), down)
}
