//! What the evidence on estimates is made with: see [`ddmhe_run::evidence`] for what becomes of it.
//!
//! Windows that are held out of the recording ([`replay`]) say what V, errors and innovations are
//! where the motion is like the recording. With v = V/V₀, V₀ the mean of V,
//!
//! > Q₀ = C (Σ e eᵀ) C / Σ s(v),  C = diag c_i,  c_i = max(1, q_.997(|e_i| / √(s(v) Q₀ᵢᵢ)) / 3)
//!
//! so that 3 √(s Q₀ᵢᵢ) holds 99.7 % of the held-out errors; the variances of the innovations alike.
//! A window is novel above three times the largest V, or J, of these. Their root-mean-square error
//! is what the recording promises, state by state.
//!
//! *Stated noise* beyond the recording's, of covariance R, adds Γ (I ⊗ R) Γᵀ to Q₀ with Γ: y →
//! x̂(t), and its mean to V₀. An exact recording shows no noise: with stated noise Q₀ and V₀ are
//! these alone.
//!
//! *The weights of the recording* need no windows that are held out: see [`model`].

mod cloud;
pub(crate) mod maps;
pub(crate) mod model;
mod plan_numbers;
pub(crate) mod replay;

use crate::config::Config;
use crate::error::Error;
use crate::history::History;
use crate::recorded_default::shape;
use crate::scaling::{EXACT, Scaling};
use crate::variation::fifth_differences;
use cloud::Cloud;
use ddmhe_run::evidence::Rule;
use ddmhe_run::evidence::formulas::inflation;
use ddmhe_run::layout::Layout;
use ddmhe_run::tol;
use faer::Mat;
use maps::Maps;
pub(crate) use plan_numbers::PlanNumbers;
use plan_numbers::{Recorded, SPREAD};
use replay::{Replayed, Setup, folds, replay};

/// A window is novel above so many times the largest V of held-out windows.
const NOVEL: f64 = 3.0;
/// A run does not go on from the recording's end above so many times that.
const GOES_ON: f64 = 1.5;
/// Where a recording shows no noise and none is stated, so that outputs may have any: above
/// their recorded spread.
const GROSS: f64 = 1.0;
/// Of that spread, above which the reading noise of an output is noise.
const SILENT: f64 = 1e-3;
/// Share of held-out errors within three deviations.
const COVERED: f64 = 0.997;
/// Of the largest distance of recorded states, from where on leaving them counts.
const FAR: f64 = 0.7;
/// Held-out errors grow where those of the last third of a stretch are so many times the first's.
const GROWS: f64 = 1.5;
/// They are taken to grow by this at least where the motion is curved and noise hides it.
const HIDDEN: f64 = 3.0;

/// What windows of one depth are measured by, in scaled units.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    pub depth: usize,
    /// V₀, what V and J are novel above, and what they are above where a run does not go on.
    pub levels: [f64; 5],
    /// Q₀ (n × n).
    pub error: Mat<f64>,
    /// Variances of the innovations (p).
    pub innovation: Vec<f64>,
}

/// What all depths are measured by.
#[derive(Debug, Clone)]
pub(crate) struct Calibration {
    pub rule: Rule,
    silent: bool,               // whether later outputs may have any noise
    references: Vec<Reference>, // ascending
    opening: Vec<Reference>,    // of a run from an unknown state
    /// What it says of its states.
    pub states: Recorded,
}

impl Calibration {
    /// From windows that are held out of the recording; None where none is asked for.
    pub fn new(
        history: &History,
        config: &Config,
        setup: Setup<'_>,
        horizon: usize,
    ) -> Result<Option<Self>, Error> {
        if !config.evidence {
            return Ok(None);
        }
        let (scaling, n) = (setup.scaling, history.n());
        let exact = is_exact(scaling);
        let recorded = setup.driving.is_some_and(|driving| driving.stationary.is_some());
        let stated = config.output_noise.is_some();
        let rule = match (recorded, exact, stated) {
            (true, ..) => Rule::Filter,
            (false, true, true) => Rule::Stated,
            (false, true, false) => Rule::Exact,
            (false, false, true) => Rule::Louder,
            (false, false, false) => Rule::Curved,
        };
        // what is neither smooth nor explained by the states
        let read = |i: usize| {
            let rough = fifth_differences(history, History::outputs, (i, history.p()));
            rough.min(scaling.one_step[n + i][0]) > (SILENT * scaling.unit_y[i]).powi(2)
        };
        let silent = !stated && (exact || !(0..history.p()).any(read));
        let replayed = replay(history, setup, horizon)?;
        let references = replayed.iter().map(|(depth, of)| Reference::new(rule, *depth, of));
        let references: Vec<Reference> = references.collect();
        let promise = match replayed.last() {
            Some((_, of)) => of.rms().iter().zip(&scaling.s_x).map(|(e, s)| e * s).collect(),
            None => vec![f64::NAN; n],
        };
        let reading = |i: usize| {
            fifth_differences(history, History::states, (i, n)).min(scaling.one_step[i][0])
        };
        let start = (0..n).map(reading).collect();
        let away = away(history, scaling);
        let growth = growth(history, scaling, rule, replayed.last().map(|(_, of)| of));
        let opening = Vec::new();
        let states = Recorded { promise, start, away, growth };
        Ok(Some(Calibration { rule, silent, references, opening, states }))
    }

    /// With what the first windows of a run from an unknown state are measured by.
    pub fn open(
        &mut self,
        history: &History,
        setup: Setup<'_>,
        horizon: usize,
    ) -> Result<(), Error> {
        if self.rule == Rule::Filter {
            return Ok(()); // its covariance follows from the model
        }
        let replayed = replay(history, Setup { unknown: true, ..setup }, horizon)?;
        let rule = self.rule;
        self.opening =
            replayed.iter().map(|(depth, of)| Reference::new(rule, *depth, of)).collect();
        Ok(())
    }

    /// What a window of this depth is measured by: the deepest that was replayed and is not deeper.
    fn reference(&self, depth: usize, opening: bool) -> Option<&Reference> {
        let all = if opening { &self.opening } else { &self.references };
        all.iter().rev().find(|of| of.depth <= depth).or_else(|| all.first())
    }
}

impl Reference {
    fn new(rule: Rule, depth: usize, of: &Replayed) -> Self {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        let V_0 = mean(&of.V).max(f64::MIN_POSITIVE.sqrt());
        let (V, J) = (most(&of.V).max(V_0), most(&of.J));
        let levels = [V_0, NOVEL * V, NOVEL * J, GOES_ON * V, GOES_ON * J];
        let rule = if rule == Rule::Louder { Rule::Curved } else { rule };
        let s: Vec<f64> = of.V.iter().map(|V| inflation(rule, V / V_0, f64::INFINITY)).collect();
        let error = covering(&of.errors, &s);
        let innovations = covering(&of.innovations, &s);
        let innovation = innovations.diagonal().column_vector().iter().copied().collect();
        Reference { depth, levels, innovation, error }
    }
}

/// Σ_x⁻¹ / (.7 D_most) in scaled units: how far a state has left the recorded ones.
fn away(history: &History, scaling: &Scaling) -> Mat<f64> {
    let n = history.n();
    let all = 0..history.recordings();
    let own = Cloud::new(all.clone().flat_map(|i| history.states(i).chunks_exact(n)), scaling);
    let recorded = all.flat_map(|i| history.states(i).chunks_exact(n));
    let most = recorded.map(|x| own.distance(x, scaling)).fold(0.0, f64::max);
    let held = folds(history).iter().map(|fold| fold.farthest(scaling)).fold(0.0, f64::max);
    let most = (FAR * most.max(held)).max(f64::MIN_POSITIVE);
    own.inverse * faer::Scale(1.0 / most)
}

/// How held-out errors grow with the time since what they were made from: 2q, .1 T and T, q = 0
/// where they do not. Thirds of a stretch of .2 T lie at 1 : 5, so g = 5^q.
fn growth(
    history: &History,
    scaling: &Scaling,
    rule: Rule,
    deepest: Option<&Replayed>,
) -> [f64; 3] {
    let T = history.T() as f64;
    let spread: Vec<f64> = scaling.unit_x.iter().zip(&scaling.s_x).map(|(u, s)| u / s).collect();
    let g = match deepest {
        Some(of) if rule.is_curved() && history.recordings() == 1 => of.growth(&spread),
        _ => return [0.0, 0.1 * T, T],
    };
    let (white, straight) = shape(history, scaling);
    // white residuals of a curved motion: noise hides the growth
    let g = if white && !straight { g.max(HIDDEN) } else { g };
    let grows = g > GROWS && !(white && straight);
    [if grows { 2.0 * g.ln() / 5.0_f64.ln() } else { 0.0 }, 0.1 * T, T]
}

/// C (Σ e eᵀ) C / Σ s, of vectors e and their s: three deviations cover [`COVERED`] of each entry.
fn covering(vectors: &[Vec<f64>], s: &[f64]) -> Mat<f64> {
    let n = vectors.first().map_or(0, Vec::len);
    let total = s.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let moment = |i: usize, j: usize| vectors.iter().map(|e| e[i] * e[j]).sum::<f64>() / total;
    let Q = Mat::from_fn(n, n, moment);
    let factor = |i: usize| {
        let deviation = |(e, s): (&Vec<f64>, &f64)| e[i].abs() / (s * Q[(i, i)]).sqrt();
        let mut all: Vec<f64> = vectors.iter().zip(s).map(deviation).collect();
        all.retain(|v| v.is_finite());
        (quantile(&mut all, COVERED) / 3.0).max(1.0)
    };
    let c: Vec<f64> = (0..n).map(factor).collect();
    Mat::from_fn(n, n, |i, j| Q[(i, j)] * c[i] * c[j])
}

/// Between order statistics, linearly; 0 of no values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (below, part) = (at.floor() as usize, at.fract());
    values[below] + part * (values[(below + 1).min(last)] - values[below])
}

impl Replayed {
    /// Root-mean-square error of the last thirds of all held-out stretches over that of the first.
    fn growth(&self, spread: &[f64]) -> f64 {
        let (mut first, mut last) = ((0.0, 0), (0.0, 0));
        let mut from = 0;
        for to in &self.stretches {
            let third = (to - from) / 3;
            let size = |e: &[Vec<f64>]| -> f64 {
                let of = |e: &Vec<f64>| -> f64 {
                    e.iter().zip(spread).map(|(e, s)| (e / s).powi(2)).sum()
                };
                e.iter().map(of).sum()
            };
            first = (first.0 + size(&self.errors[from..from + third]), first.1 + third);
            let (end, rest) = (from + 2 * third, to - from - 2 * third);
            last = (last.0 + size(&self.errors[end..*to]), last.1 + rest);
            from = *to;
        }
        let mean = |(sum, count): (f64, usize)| sum / count.max(1) as f64;
        let ratio = (mean(last) / mean(first)).sqrt();
        if ratio.is_finite() { ratio } else { 1.0 }
    }

    /// Root-mean-square error, state by state.
    fn rms(&self) -> Vec<f64> {
        let n = self.errors.first().map_or(0, Vec::len);
        let mean = |i: usize| self.errors.iter().map(|e| e[i] * e[i]).sum::<f64>();
        (0..n).map(|i| (mean(i) / self.errors.len() as f64).sqrt()).collect()
    }
}

/// What a depth is measured by, in the user's units: see [`ddmhe_run::evidence::OfDepth`].
pub(crate) struct DepthNumbers {
    pub levels: [f64; 5],
    pub carry: Vec<f64>,
    pub error: Vec<f64>,
    pub deleted: Vec<f64>,
    pub of_prior: Vec<f64>,
    pub innovation: Vec<f64>,
    pub settled: Vec<f64>,
    pub going_on: Vec<f64>,
}

impl DepthNumbers {
    /// None, for a rule that asks for none.
    fn none(most: f64) -> Self {
        let [carry, error, deleted, of_prior, innovation, settled, going_on] =
            std::array::from_fn(|_| Vec::new());
        let levels = [1.0, most, most, most, most];
        DepthNumbers { levels, carry, error, deleted, of_prior, innovation, settled, going_on }
    }
}

impl Calibration {
    /// Of one depth; `opening`: of a run from an unknown state, whose x̄ is no estimate.
    pub fn of_depth(
        &self,
        (layout, opening): (Layout, bool),
        maps: &Maps,
        scaling: &Scaling,
    ) -> DepthNumbers {
        let (n, p) = (layout.n, layout.p);
        let (s_x, s_y) = (&scaling.s_x, &scaling.s_y);
        let entries = |M: &Mat<f64>, of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            let columns = M.ncols();
            let entry = |k: usize| (k / columns, k % columns);
            (0..M.nrows() * columns).map(entry).map(|(i, j)| M[(i, j)] * of(i, j)).collect()
        };
        let Maps { carry, deleted, of_prior, noise } = maps;
        let kept = |M: &Mat<f64>| if opening { Mat::zeros(M.nrows(), n) } else { M.clone() };
        let gross = |i: usize| if self.silent { (GROSS * scaling.unit_y[i]).powi(2) } else { 0.0 };
        if self.rule == Rule::Filter {
            let going_on = (0..p).map(gross).collect();
            return DepthNumbers { going_on, ..DepthNumbers::none(f64::INFINITY) };
        }
        let beyond = f64::INFINITY;
        let none = Reference {
            depth: 1,
            levels: [f64::MIN_POSITIVE.sqrt(), beyond, beyond, beyond, beyond],
            error: Mat::zeros(n, n),
            innovation: vec![0.0; p],
        };
        let of = self.reference(layout.depth, opening).unwrap_or(&none);
        let error = Mat::from_fn(n, n, |i, j| of.error[(i, j)] + noise.error[(i, j)]);
        let variances = |of: &Reference| -> Vec<f64> {
            let own = of.innovation.iter().zip(&noise.innovation).zip(s_y);
            own.map(|((own, more), s)| (own + more) * s * s).collect()
        };
        let [V_0, most @ ..] = of.levels;
        let more = noise.rare();
        let [V_most, J_most, V_on, J_on] = most.map(|most| most + more);
        let levels = match self.rule {
            // of noise of one unit: the run itself says how much there is
            Rule::Exact => [noise.V[0], more, beyond, beyond, beyond],
            _ if self.silent => [V_0 + noise.V[0], V_most, J_most, beyond, beyond],
            _ => [V_0 + noise.V[0], V_most, J_most, V_on, J_on],
        };
        let settled = variances(self.reference(layout.depth, false).unwrap_or(&none));
        let known =
            |i: usize| if self.rule == Rule::Exact { 0.0 } else { tol::GOES_ON * settled[i] };
        DepthNumbers {
            levels,
            carry: entries(&kept(carry), &|i, j| s_x[i] / s_x[j]),
            error: entries(&error, &|i, j| s_x[i] * s_x[j]),
            deleted: entries(deleted, &|i, j| s_y[i] / s_y[j]),
            of_prior: entries(&kept(of_prior), &|i, j| s_y[i] / s_x[j]),
            innovation: variances(of),
            going_on: (0..p).map(|i| known(i).max(gross(i))).collect(),
            settled,
        }
    }
}

/// Whether an affine step explains the recording but for rounding.
fn is_exact(scaling: &Scaling) -> bool {
    scaling.misfit(&scaling.one_step).into_iter().fold(0.0, f64::max) < EXACT
}

/// Variances of stated noise beyond what the recording has, in scaled units (p); none stated:
/// zeros.
pub(crate) fn stated_beyond(config: &Config, scaling: &Scaling) -> Vec<f64> {
    let p = scaling.s_y.len();
    let Some(stated) = &config.output_noise else {
        // of an exact recording one unit, to measure a run by
        return vec![f64::from(u8::from(is_exact(scaling))); p];
    };
    // fifth differences of fast motion are none of noise; what an affine step leaves holds both
    let (n, exact) = (scaling.s_x.len(), is_exact(scaling));
    let recorded = |i: usize| match exact {
        true => 0.0,
        false => scaling.noise_y[i].min(scaling.one_step[n + i][0]),
    };
    let beyond = |i: usize| {
        let stated = stated[i % stated.len()];
        (stated * stated - recorded(i)).max(0.0) / (scaling.s_y[i] * scaling.s_y[i])
    };
    (0..p).map(beyond).collect()
}

/// What the recording cannot promise, in words.
pub(crate) fn words(evidence: &Calibration, scaling: &Scaling) -> Vec<String> {
    if evidence.states.promise.iter().all(|h| h.is_nan()) {
        return vec![
            "the recording is too short to hold windows out of it: it cannot say how far off \
            estimates may be"
                .into(),
        ];
    }
    let broken = evidence.states.promise.iter().zip(&scaling.unit_x).enumerate();
    broken
        .filter(|(_, (h, spread))| **h > SPREAD * **spread)
        .map(|(i, (h, spread))| {
            format!(
                "the recording cannot promise state {i} (counted from 0): windows that were held \
                out of it are off by {h:.3e}, and it moves by {spread:.3e} (standard deviations)"
            )
        })
        .collect()
}
