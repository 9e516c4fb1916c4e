//! Which motion made the recording: fits from several starts, the simplest family that explains it,
//! and the affine motion as the yardstick where none does.

use crate::rigid::affine::{Affine, affine_unknowns};
use crate::rigid::family::Fitted;
use crate::rigid::recording::Recording;
use crate::rigid::wide::Wide;
use ddmhe_run::rigid::anchoring::{OPTIMA, Optima, other_offset};
use ddmhe_run::rigid::pass::{Compiled, Units};
use ddmhe_run::rigid::posterior::{EULER, SAME};
use ddmhe_run::rigid::{Fit, Motion, Posterior, Start};

/// Steps of a fit, and of one with blurred noise.
const STEPS: (usize, usize) = (100, 20);
/// Noise is blurred to 10^-1, 10^-2, … of the signals.
const DECADES: i32 = 7;
/// An optimum of the recording is kept whose cost exceeds the least by less than this.
const KEPT: f64 = 300.0;

/// What the recording says.
pub(crate) struct Choice<M, const N: usize> {
    /// Optima, the best first; none where the affine motion is better.
    pub optima: Optima<M, N>,
    /// Whether the best explains the recording.
    pub explained: bool,
    /// What the noise of its outputs is to be multiplied by, 1 where it explains the recording.
    pub inflation: f64,
    /// The best rigid body, believed or not.
    pub closest: Option<Posterior<M, N>>,
}

/// A fit to the recording with noise that is lowered by decades: convergence from afar also where
/// there is hardly any. Between two fits a body is expressed about its own unseen direction.
fn annealed<const P: usize, const N: usize, M: Motion<P, N> + Clone>(
    (recording, known): (&Recording<P>, &[M::Known]),
    mut start: Start<M, N>,
    rebased: impl Fn(Start<M, N>) -> Start<M, N>,
    units: &impl Units,
) -> Option<Posterior<M, N>> {
    let mut before = None;
    for decade in 1..=DECADES {
        let blur = 10f64.powi(-decade);
        let data = recording.data(known, blur);
        let last = data.of_x == recording.of_x && data.of_y == recording.of_y;
        let steps = if last { STEPS.0 } else { STEPS.1 };
        let Some(found) = Fit::new(&start, data.y.len(), steps).finish(&data, units) else {
            return before;
        };
        if last {
            return Some(found);
        }
        start = rebased(found.start());
        before = Some(found);
    }
    before
}

/// A fit to the recording.
fn fit<const P: usize, const N: usize, M: Motion<P, N> + Clone>(
    (recording, known): (&Recording<P>, &[M::Known]),
    start: &Start<M, N>,
) -> Option<Posterior<M, N>> {
    let data = recording.data(known, 0.0);
    Fit::new(start, data.y.len(), STEPS.0).finish(&data, &Wide::new())
}

/// The distinct optima of one family, the best first.
fn optima<M: Fitted<P, N>, const P: usize, const N: usize>(
    of: (&Recording<P>, &[M::Known]),
    cubic: bool,
) -> Vec<Posterior<M, N>> {
    let mut found: Vec<Posterior<M, N>> = Vec::new();
    for trial in M::STARTS[usize::from(cubic)] {
        let start = M::start(of.0, of.1, *trial, cubic);
        let own = annealed(of, start, |start: Start<M, N>| start.rebased(), &Wide::new());
        let new = own.filter(|own| !found.iter().any(|f| (f.cost - own.cost).abs() < SAME));
        found.extend(new);
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let euler = found.first().filter(|_| M::SIMULATED).and_then(|best| {
        let mut start = best.start();
        start.motion.given_mut().steps.substeps = 0;
        fit(of, &start)
    });
    match euler {
        Some(euler) if euler.cost < found[0].cost - EULER => found.insert(0, euler),
        euler => found.extend(euler),
    }
    found
}

/// The fit, or that with the other prior on offsets: the larger evidence.
fn settled<M: Fitted<P, N>, const P: usize, const N: usize>(
    of: (&Recording<P>, &[M::Known]),
    found: Posterior<M, N>,
) -> Posterior<M, N> {
    let wide = ddmhe_run::rigid::anchoring::OFFSET * of.0.size;
    let start = other_offset(&found, &of.0.of_later, wide);
    fit(of, &start).filter(|other| other.evidence > found.evidence).unwrap_or(found)
}

/// How well a fit describes the recording for its number of unknowns.
fn rating<M, const N: usize>(found: &Posterior<M, N>, samples: usize, unknowns: usize) -> f64 {
    let n = 3.0 * samples as f64;
    let misfit: f64 = found.misfit.chi[..2].iter().map(|chi| chi.max(1.0).ln()).sum();
    -0.5 * n * misfit - 0.5 * unknowns as f64 * (2.0 * n).ln()
}

impl<M, const N: usize> Choice<M, N> {
    /// Of a recording, with what is known of its samples. `NA` unknowns has the affine motion.
    pub fn of<const P: usize, const NA: usize>(recording: &Recording<P>, known: &[M::Known]) -> Self
    where
        M: Fitted<P, N>,
    {
        let explaining = Self::explaining(recording, known);
        explaining.unwrap_or_else(|tried| Self::without::<P, NA>((recording, known), &tried))
    }

    /// The simplest motion of the family that explains the recording; else those that do not.
    pub fn explaining<const P: usize>(
        recording: &Recording<P>,
        known: &[M::Known],
    ) -> Result<Self, Vec<Posterior<M, N>>>
    where
        M: Fitted<P, N>,
    {
        let mut tried = Vec::new();
        for cubic in [false, true] {
            let found = optima::<M, P, N>((recording, known), cubic);
            let Some(best) = found.first().copied() else { continue };
            tried.push(best);
            if best.misfit.explained(recording.known) {
                let near = found.into_iter().take(OPTIMA).filter(|f| f.cost < best.cost + KEPT);
                let mut optima = [const { None }; OPTIMA];
                let all = near.map(|f| settled((recording, known), f));
                optima.iter_mut().zip(all).for_each(|(to, f)| *to = Some(f));
                let closest = optima[0];
                return Ok(Choice { optima, explained: true, inflation: 1.0, closest });
            }
        }
        Err(tried)
    }

    /// Where none of the best explains the recording.
    fn without<const P: usize, const NA: usize>(
        (recording, known): (&Recording<P>, &[M::Known]),
        tried: &[Posterior<M, N>],
    ) -> Self
    where
        M: Fitted<P, N>,
    {
        let samples = recording.x.len();
        let absent = M::OF_OUTPUT * (P - recording.p);
        let of_body = |f: &Posterior<M, N>| {
            rating(f, samples, N - absent - if f.motion.given().cubic { 0 } else { 2 })
        };
        // of equals the first
        let closest = tried.iter().rev().max_by(|a, b| of_body(a).total_cmp(&of_body(b))).copied();
        let of_affine = (recording, Affine::<P, NA>::EVERYWHERE);
        let affine: Option<Posterior<Affine<P, NA>, NA>> =
            annealed(of_affine, recording.affine(), |start| start, &Compiled);
        let of_affine = affine.map(|f| rating(&f, samples, affine_unknowns(recording.p)));
        let none = [const { None }; OPTIMA];
        let Some(best) = closest.filter(|f| of_affine.is_none_or(|other| other <= of_body(f)))
        else {
            return Choice { optima: none, explained: false, inflation: 1.0, closest };
        };
        let up = best.misfit.chi.map(|chi| chi.max(1.0).sqrt());
        let mut data = recording.data(known, 0.0);
        data.of_x = data.of_x.map(|v| v * up[0]);
        data.of_y = data.of_y.map(|v| v * up[1]);
        let wider = Fit::new(&best.start(), data.y.len(), STEPS.0).finish(&data, &Wide::new());
        let mut optima = none;
        optima[0] = Some(wider.unwrap_or(best));
        Choice { optima, explained: false, inflation: up[1], closest }
    }
}
