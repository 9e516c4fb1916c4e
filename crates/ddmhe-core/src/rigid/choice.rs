//! Which motion made the recording: fits from several starts, the simplest family that explains it,
//! and the affine motion as the yardstick where none does.

use crate::rigid::affine::Affine;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::anchoring::{OPTIMA, Optima, other_offset};
use ddmhe_run::rigid::layout::unknowns;
use ddmhe_run::rigid::posterior::{EULER, SAME};
use ddmhe_run::rigid::{Body, Fit, Motion, Posterior};

/// Steps of a fit, and of one with blurred noise.
const STEPS: (usize, usize) = (100, 20);
/// Noise is blurred to 10^-1, 10^-2, … of the signals.
const DECADES: i32 = 7;
/// Starts of the plain body, and of the one with a cubic part.
const STARTS: [usize; 2] = [5, 1];
/// An optimum of the recording is kept whose cost exceeds the least by less than this.
const KEPT: f64 = 300.0;

/// What the recording says.
pub(crate) struct Choice<const P: usize, const N: usize> {
    /// Optima, the best first; none where the affine motion is better.
    pub optima: Optima<P, N>,
    /// Whether the best explains the recording.
    pub explained: bool,
    /// What the noise of its outputs is to be multiplied by, 1 where it explains the recording.
    pub inflation: f64,
    /// The best rigid body, believed or not.
    pub closest: Option<Posterior<Body<P, N>, N>>,
}

/// A fit to the recording with noise that is lowered by decades: convergence from afar also where
/// there is hardly any. Between two fits a body is expressed about its own unseen direction.
fn annealed<const P: usize, const N: usize, M: Motion<P, N> + Clone>(
    recording: &Recording<P>,
    (mut motion, mut z): (M, [f64; N]),
    rebased: impl Fn(&M, &[f64; N]) -> (M, [f64; N]),
) -> Option<Posterior<M, N>> {
    let mut before = None;
    for decade in 1..=DECADES {
        let blur = 10f64.powi(-decade);
        let data = recording.data(blur);
        let last = data.of_x == recording.of_x && data.of_y == recording.of_y;
        let steps = if last { STEPS.0 } else { STEPS.1 };
        let Some(found) = Fit::new(&motion, &z, data.y.len(), steps).finish(&data) else {
            return before;
        };
        if last {
            return Some(found);
        }
        (motion, z) = rebased(&found.motion, &found.z);
        before = Some(found);
    }
    before
}

/// A fit to the recording.
fn fit<const P: usize, const N: usize, M: Motion<P, N> + Clone>(
    recording: &Recording<P>,
    motion: &M,
    z: &[f64; N],
) -> Option<Posterior<M, N>> {
    let data = recording.data(0.0);
    Fit::new(motion, z, data.y.len(), STEPS.0).finish(&data)
}

/// The distinct optima of one family, the best first.
fn optima<const P: usize, const N: usize>(
    recording: &Recording<P>,
    cubic: bool,
) -> Vec<Posterior<Body<P, N>, N>> {
    let mut found: Vec<Posterior<Body<P, N>, N>> = Vec::new();
    for trial in 0..STARTS[usize::from(cubic)] {
        let start = recording.body(trial, cubic);
        let own = annealed(recording, start, |body: &Body<P, N>, z| body.rebased(z));
        let new = own.filter(|own| !found.iter().any(|f| (f.cost - own.cost).abs() < SAME));
        found.extend(new);
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let euler = found.first().and_then(|best| {
        let mut body = best.motion;
        body.steps.substeps = 0;
        fit(recording, &body, &best.z)
    });
    match euler {
        Some(euler) if euler.cost < found[0].cost - EULER => found.insert(0, euler),
        euler => found.extend(euler),
    }
    found
}

/// The fit, or that with the other prior on offsets: the larger evidence.
fn settled<const P: usize, const N: usize>(
    recording: &Recording<P>,
    found: Posterior<Body<P, N>, N>,
) -> Posterior<Body<P, N>, N> {
    let wide = ddmhe_run::rigid::anchoring::OFFSET * recording.size;
    let (body, z) = other_offset(&found, &recording.of_later, wide);
    fit(recording, &body, &z).filter(|other| other.evidence > found.evidence).unwrap_or(found)
}

/// How well a fit describes the recording for its number of unknowns.
fn rating<M, const N: usize>(found: &Posterior<M, N>, samples: usize, unknowns: usize) -> f64 {
    let n = 3.0 * samples as f64;
    let misfit: f64 = found.misfit.chi[..2].iter().map(|chi| chi.max(1.0).ln()).sum();
    -0.5 * n * misfit - 0.5 * unknowns as f64 * (2.0 * n).ln()
}

impl<const P: usize, const N: usize> Choice<P, N> {
    /// Of a recording. `NA` unknowns has the affine motion.
    pub fn of<const NA: usize>(recording: &Recording<P>) -> Self {
        let mut tried = Vec::new();
        for cubic in [false, true] {
            let found = optima(recording, cubic);
            let Some(best) = found.first().copied() else { continue };
            tried.push(best);
            if best.misfit.explained(recording.known) {
                let near = found.into_iter().take(OPTIMA).filter(|f| f.cost < best.cost + KEPT);
                let mut optima = [const { None }; OPTIMA];
                let all = near.map(|f| settled(recording, f));
                optima.iter_mut().zip(all).for_each(|(to, f)| *to = Some(f));
                return Choice { optima, explained: true, inflation: 1.0, closest: optima[0] };
            }
        }
        Self::without::<NA>(recording, &tried)
    }

    /// Where none of the best explains the recording.
    fn without<const NA: usize>(
        recording: &Recording<P>,
        tried: &[Posterior<Body<P, N>, N>],
    ) -> Self {
        let samples = recording.x.len();
        let of_body = |f: &Posterior<Body<P, N>, N>| {
            rating(f, samples, unknowns(P) - if f.motion.cubic { 0 } else { 2 })
        };
        // of equals the first
        let closest = tried.iter().rev().max_by(|a, b| of_body(a).total_cmp(&of_body(b))).copied();
        let affine: Option<Posterior<Affine<P, NA>, NA>> =
            annealed(recording, recording.affine(), |motion: &Affine<P, NA>, z| (*motion, *z));
        let of_affine = affine.map(|f| rating(&f, samples, NA));
        let none = [const { None }; OPTIMA];
        let Some(best) = closest.filter(|f| of_affine.is_none_or(|other| other <= of_body(f)))
        else {
            return Choice { optima: none, explained: false, inflation: 1.0, closest };
        };
        let up = best.misfit.chi.map(|chi| chi.max(1.0).sqrt());
        let mut data = recording.data(0.0);
        data.of_x = data.of_x.map(|v| v * up[0]);
        data.of_y = data.of_y.map(|v| v * up[1]);
        let wider = Fit::new(&best.motion, &best.z, data.y.len(), STEPS.0).finish(&data);
        let mut optima = none;
        optima[0] = Some(wider.unwrap_or(best));
        Choice { optima, explained: false, inflation: up[1], closest }
    }
}
