//! What the estimator says of the body.

use ddmhe_run::rigid::layout::{INERTIA, TILT};
use ddmhe_run::rigid::motion::Family;
use ddmhe_run::rigid::small::{along_basis, inertia};
use ddmhe_run::rigid::{Mixture, Posterior};

/// One optimum of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// Σ|x - ω|²/σx² + Σ|y - ŷ|²/σy² + |θ/sd|².
    pub cost: f64,
    /// log of the probability of the data, but for a constant of them.
    pub evidence: f64,
    /// J, trace 3 (3 × 3, by rows).
    pub inertia: [[f64; 3]; 3],
    /// Whether drag and output have a cubic part.
    pub cubic: bool,
    /// How probable it is as of now, of those that are kept.
    pub probability: f64,
}

/// What the estimator says of the body, as of now.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Mean squares of the latest fit's residuals in units of their noise: of states, of outputs,
    /// and of both in means over ten samples.
    pub chi: [f64; 4],
    /// What each is below where the motion explains the data.
    pub limits: [f64; 4],
    /// log of the probability of the latest fit's data, but for a constant of them.
    pub evidence: f64,
    /// The optima that are kept, the best first.
    pub optima: Vec<Optimum>,
    /// J, trace 3 (3 × 3): its scale cannot be seen.
    pub inertia: [[f64; 3]; 3],
    /// Standard deviations of its entries.
    pub inertia_std: [[f64; 3]; 3],
    /// The direction about which a turn shows in no output and is not braked, of length 1; NaN in a
    /// known field, which moves: none stays so.
    pub unseen: [f64; 3],
    /// By how long the outputs lag behind the motion, and its standard deviation (s): of a body
    /// that explains the data with a lag alone.
    pub lag: Option<[f64; 2]>,
    /// All of it in sentences.
    pub words: Vec<String>,
}

impl Report {
    /// Of a run.
    pub(crate) fn of_run<M: Family<P, N>, const P: usize, const N: usize>(
        mixture: &Mixture<M, P, N>,
        known: bool,
    ) -> Option<Self> {
        let leading = mixture.at(mixture.leading())?;
        let now = (&leading.filter.z, &leading.filter.P);
        let mut report = Report::of(&leading.found, now, known);
        let all = mixture.members().zip(mixture.probabilities());
        report.optima = all.map(|(member, p)| optimum(&member.found, p)).collect();
        report.optima.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Some(report)
    }

    /// Of a fit that nothing goes on from.
    pub(crate) fn of_fit<M: Family<P, N>, const P: usize, const N: usize>(
        best: &Posterior<M, N>,
        known: bool,
    ) -> Self {
        Report::of(best, (&best.z, &best.P), known)
    }

    /// Of a fit, with z and P as of now.
    fn of<M: Family<P, N>, const P: usize, const N: usize>(
        best: &Posterior<M, N>,
        (z, covariance): (&[f64; N], &[[f64; N]; N]),
        known: bool,
    ) -> Self {
        let mut report = Report {
            chi: best.misfit.chi,
            limits: best.misfit.limits(known),
            evidence: best.evidence,
            optima: Vec::new(),
            inertia: inertia(&z[INERTIA..TILT]),
            inertia_std: inertia_std(covariance),
            unseen: best.motion.unseen(z).unwrap_or([f64::NAN; 3]),
            lag: best.motion.lag(z, covariance),
            words: Vec::new(),
        };
        let recordings = best.firsts.rates().len() + 1;
        report.words =
            report.sentences(best.misfit.explained(known), best.motion.given().cubic, recordings);
        report
    }

    fn sentences(&self, explained: bool, cubic: bool, recordings: usize) -> Vec<String> {
        let parts = ["rates", "outputs", "rates over ten samples", "outputs over ten samples"];
        let above = (0..4).filter(|&i| self.chi[i] >= self.limits[i]);
        let above: Vec<String> = above
            .map(|i| format!("{} {:.2} (limit {:.2})", parts[i], self.chi[i], self.limits[i]))
            .collect();
        let body = if cubic { "a rigid body with cubic drag" } else { "a rigid body" };
        let data = match recordings {
            1 => "the data".into(),
            several => format!("the data of {several} recordings"),
        };
        let first = match explained {
            true => format!(
                "{body} explains {data}: residuals are {:.2} (rates) and {:.2} (outputs) times \
                 their noise, squared",
                self.chi[0], self.chi[1]
            ),
            false => format!(
                "no rigid body explains {data}; the nearest leaves, squared and in units of \
                 their noise: {}",
                above.join(", ")
            ),
        };
        let [x, y, z] = self.unseen;
        let second = match x.is_nan() {
            true => {
                "what shows in no output changes with the field, as B does: no direction stays \
                     unseen while it turns"
                    .into()
            }
            false => format!(
                "a turn about ({x:.3}, {y:.3}, {z:.3}) shows in no output: nothing can tell an \
                 error along it but the motion, if the body is rigid"
            ),
        };
        let third = self.lag.map(|[lag, sd]| {
            format!(
                "outputs lag behind the motion by {lag:.3} s, as those of a first-order sensor do \
                 (± {sd:.3})"
            )
        });
        [first, second].into_iter().chain(third).collect()
    }
}

fn optimum<M: Family<P, N>, const P: usize, const N: usize>(
    f: &Posterior<M, N>,
    probability: f64,
) -> Optimum {
    Optimum {
        cost: f.cost,
        evidence: f.evidence,
        inertia: inertia(&f.z[INERTIA..TILT]),
        cubic: f.motion.given().cubic,
        probability,
    }
}

/// Standard deviations of J's entries, which are linear in j.
fn inertia_std<const N: usize>(P: &[[f64; N]; N]) -> [[f64; 3]; 3] {
    let columns = [0, 1, 2].map(|i| {
        let mut unit = [0.0; 3];
        unit[i] = 1.0;
        along_basis(&unit)
    });
    [0, 1, 2].map(|i| {
        [0, 1, 2].map(|k| {
            let entry = |j: usize| columns[k][j][i];
            let sum = |a: usize, b: usize| entry(a) * entry(b) * P[INERTIA + a][INERTIA + b];
            (0..5)
                .flat_map(|a| (0..5).map(move |b| (a, b)))
                .map(|(a, b)| sum(a, b))
                .sum::<f64>()
                .max(0.0)
                .sqrt()
        })
    })
}
