//! The rigid body seen by sensors that lag behind it: of first order, one time constant τ for all
//! outputs.
//!
//! > τ ẏ = z - y,  z = G Nᵀ ω + r:  y(t) = ∫ e^{-u} z(t - τ u) du over u > 0
//!
//! Sensors that have been on for long have forgotten how they began, so y is a function of ω and θ
//! alone: the motion, made back from ω, is averaged with those weights by Gauss's and Laguerre's
//! rule of three nodes. It is exact where z is a polynomial of time to the fifth degree, else off
//! by some .05 (τ W)⁶.

use crate::panels::Root;
use crate::rigid::body::{Body, BodyParts};
use crate::rigid::layout::{DRAG_CUBIC, output_cubic};
use crate::rigid::motion::{Entry, Family, Given, MOVING, Motion, Slopes, Steps};
use crate::rigid::motion::{after, flow, flow_with_slopes};
use crate::rigid::small::Vector;
use crate::rigid::start::Start;
use core::ops::Range;

/// Unknowns that one output depends on: ω and what moves it, two of G, one of r, and τ.
const SEEN: usize = DRAG_CUBIC + 4;

/// Nodes u and weights of ∫ e^{-u} f(u) du.
const NODES: [(f64, f64); 3] = [
    (0.415_774_556_783_479_1, 0.711_093_009_929_172_9),
    (2.294_280_360_279_042, 0.278_517_733_569_241),
    (6.289_945_082_937_479_4, 0.010_389_256_501_586_133),
];
/// Deviations that a lag is off at most: below 0 its own, else of its prior.
const CERTAIN: f64 = 2.5;
/// Substeps of the way back to each from that before it.
const SUBSTEPS: [usize; 3] = [1, 2, 3];

/// Place of τ (s): that of the output's γ, since drag and output have no cubic part.
pub const fn lag(p: usize) -> usize {
    output_cubic(p)
}

/// A body whose outputs lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedBody<const P: usize, const N: usize> {
    /// The body, without a cubic part.
    pub body: Body<P, N>,
}

/// What the unknowns determine.
#[derive(Debug, Clone, Copy)]
pub struct LaggedParts<const P: usize> {
    body: BodyParts<P>,
    lag: f64,
}

/// ω as the sensors average it, with its derivatives.
struct Averaged {
    w: Vector,
    slopes: Slopes,
    by_lag: Vector,
}

impl<const P: usize, const N: usize> LaggedBody<P, N> {
    /// A body as one that may lag, without a lag yet; `spread`: the deviation of its prior (s).
    pub fn start(of: &Start<Body<P, N>, N>, spread: f64) -> Start<Self, N> {
        let Start { motion: mut body, mut z, firsts } = *of;
        z[lag(P)] = 0.0;
        body.given.spread[lag(P)] = spread;
        Start { motion: LaggedBody { body }, z, firsts }
    }

    /// The body on its way back to a node, and how many samples that is.
    #[inline(always)]
    fn back(&self, lag: f64, node: usize) -> (Body<P, N>, f64) {
        let steps = Steps { substeps: SUBSTEPS[node], ..self.body.given.steps };
        let from = if node == 0 { 0.0 } else { NODES[node - 1].0 };
        let samples = -(NODES[node].0 - from) * lag / steps.dt;
        (Body { given: Given { steps, ..self.body.given }, ..self.body }, samples)
    }

    /// ω as the sensors average it; ω itself where the motion back runs away.
    #[inline(always)]
    fn average(&self, c: &LaggedParts<P>, w: &Vector) -> Vector {
        let (mut sum, mut at) = ([0.0; 3], *w);
        for (node, (_, weight)) in NODES.into_iter().enumerate() {
            let (body, samples) = self.back(c.lag, node);
            let Some(moved) = flow(&body, &c.body, (&(), &()), samples, at) else { return *w };
            at = moved.w;
            (0..3).for_each(|i| sum[i] += weight * at[i]);
        }
        sum
    }

    /// The same with its derivatives.
    #[inline(always)]
    fn average_with_slopes(&self, c: &LaggedParts<P>, w: &Vector) -> Averaged {
        let mut itself = [[0.0; MOVING]; 3];
        (0..3).for_each(|i| itself[i][i] = 1.0);
        let mut sum = Averaged { w: [0.0; 3], slopes: [[0.0; MOVING]; 3], by_lag: [0.0; 3] };
        let (mut at, mut slopes) = (*w, itself);
        for (node, (u, weight)) in NODES.into_iter().enumerate() {
            let ((body, samples), mut own) = (self.back(c.lag, node), [[0.0; MOVING]; 3]);
            let moved = flow_with_slopes(&body, &c.body, (&(), &()), samples, at, &mut own);
            let Some(moved) = moved else {
                return Averaged { w: *w, slopes: itself, by_lag: [0.0; 3] };
            };
            (at, slopes) = (moved.w, after(&own, &slopes));
            let rate = self.body.rate(&c.body, &(), &at);
            for i in 0..3 {
                sum.w[i] += weight * at[i];
                sum.by_lag[i] -= weight * u * rate[i];
                let both = sum.slopes[i].iter_mut().zip(&slopes[i]);
                both.for_each(|(sum, own)| *sum += weight * own);
            }
        }
        sum
    }
}

impl<const P: usize, const N: usize> Motion<P, N> for LaggedBody<P, N> {
    type Parts = LaggedParts<P>;
    type Known = ();
    type Drive = ();
    type Row = [Entry; SEEN];

    const EVERYWHERE: &'static [()] = Body::<P, N>::EVERYWHERE;

    #[inline(always)]
    fn between((): &(), (): &(), _: f64) {}

    fn given(&self) -> &Given<N> {
        &self.body.given
    }

    #[inline(always)]
    fn parts(&self, z: &[f64; N]) -> LaggedParts<P> {
        LaggedParts { body: self.body.parts(z), lag: z[lag(P)] }
    }

    #[inline(always)]
    fn rate(&self, c: &LaggedParts<P>, (): &(), w: &Vector) -> Vector {
        self.body.rate(&c.body, &(), w)
    }

    #[inline(always)]
    fn slope(&self, c: &LaggedParts<P>, (): &(), w: &Vector, slopes: &mut Slopes) -> Vector {
        self.body.slope(&c.body, &(), w, slopes)
    }

    #[inline(always)]
    fn output(&self, c: &LaggedParts<P>, (): &(), w: &Vector) -> [f64; P] {
        self.body.output(&c.body, &(), &self.average(c, w))
    }

    #[inline(always)]
    fn rows(&self, c: &LaggedParts<P>, (): &(), w: &Vector) -> [[Entry; SEEN]; P] {
        let mean = self.average_with_slopes(c, w);
        let of_body = self.body.rows(&c.body, &(), &mean.w);
        let mut rows = [[(0, 0.0); SEEN]; P];
        for (row, own) in rows.iter_mut().zip(&of_body) {
            let h = [own[0].1, own[1].1, own[2].1];
            let shown = |column: Vector| h[0] * column[0] + h[1] * column[1] + h[2] * column[2];
            for (k, entry) in row[..DRAG_CUBIC].iter_mut().enumerate() {
                *entry = (k, shown([0, 1, 2].map(|i| mean.slopes[i][k])));
            }
            // β moves the body and is seen by itself
            own[3..5].iter().for_each(|(at, v)| row[*at].1 += v);
            row[DRAG_CUBIC..DRAG_CUBIC + 3].copy_from_slice(&own[5..8]);
            row[SEEN - 1] = (lag(P), shown(mean.by_lag));
        }
        rows
    }
}

impl<const P: usize, const N: usize> Family<P, N> for LaggedBody<P, N> {
    const OFFSETS: usize = Body::<P, N>::OFFSETS;
    const MAY_BE_CUBIC: bool = false;

    fn sized(p: usize) -> impl Iterator<Item = Range<usize>> {
        Body::<P, N>::sized(p)
    }

    fn given_mut(&mut self) -> &mut Given<N> {
        &mut self.body.given
    }

    fn rebased(&self, z: &[f64; N]) -> (Self, [f64; N]) {
        let (body, z) = self.body.rebased(z);
        (LaggedBody { body }, z)
    }

    fn frame(&self) -> [f64; 9] {
        self.body.frame()
    }

    fn in_frame(&self, frame: &[f64; 9]) -> Self {
        LaggedBody { body: self.body.in_frame(frame) }
    }

    fn unseen(&self, z: &[f64; N]) -> Option<Vector> {
        self.body.unseen(z)
    }

    fn lag(&self, z: &[f64; N], covariance: &[[f64; N]; N]) -> Option<[f64; 2]> {
        let at = lag(P);
        Some([z[at], covariance[at][at].root()])
    }

    /// What is surely no lag, or a longer one than was thought possible, explains something else.
    fn is_credible(&self, z: &[f64; N], covariance: &[[f64; N]; N]) -> bool {
        let at = lag(P);
        let (sd, prior) = (covariance[at][at].root(), self.given().spread[at]);
        z[at] > -CERTAIN * sd && z[at] < CERTAIN * prior
    }

    fn ahead((): &(), (): &()) {}
}
