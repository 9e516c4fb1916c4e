//! A run of the rigid body's estimator as it is continued in another process.

use crate::error::Error;
use crate::rigid::later::Later;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::anchoring::{Manner, OPTIMA};
use ddmhe_run::rigid::motion::{Family, Steps};
use ddmhe_run::rigid::pass::Units;
use ddmhe_run::rigid::stepper::{Work, slice};
use ddmhe_run::rigid::{Anchoring, Data, Firsts, Member, Misfit, Mixture, Posterior};
use ddmhe_run::rigid::{Refit, Start, Stepper};
use serde::{Deserialize, Serialize};

/// What changes from step to step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Saved {
    /// One list a member; none where there is no motion any more.
    members: Vec<Vec<f64>>,
    /// How many later outputs their fits are of.
    of: usize,
    t: usize,
    later: Vec<f64>,
    rates: Vec<f64>,
    /// Of later samples, then of the last two.
    pub known: Vec<f64>,
    fits: usize,
    begun: usize,
    ended: usize,
    unexplained: bool,
    work: SavedWork,
    /// How many later outputs the fit was of that was asked last whether outputs lag.
    pub asked: usize,
}

/// What goes on beside the filters.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
enum SavedWork {
    /// Nothing.
    #[default]
    None,
    /// Fits: their starts, the number of outputs, how often they were advanced, whether they try
    /// the other prior on offsets, and whether they are of means.
    Fits(Vec<Vec<f64>>, usize, usize, bool, bool),
    /// Members on their way to the newest output, how many later outputs their fits are of, and the
    /// next output.
    Replay(Vec<Vec<f64>>, usize, usize),
}

impl Saved {
    pub fn of<M: Family<P, N>, const P: usize, const N: usize>(
        stepper: Option<&Stepper<M, P, N>>,
        later: &Later<P>,
        known: Vec<f64>,
    ) -> Self {
        let Some(stepper) = stepper else { return Saved::default() };
        let work = match &stepper.work {
            None => SavedWork::None,
            Some(Work::Fits(fits, calls)) => {
                let (starts, end) = (fits.starts().map(of_start).collect(), fits.end());
                let manner = fits.manner();
                SavedWork::Fits(starts, end, *calls, manner.settles, manner.of_means)
            }
            Some(Work::Replay(mixture, next)) => {
                let members = mixture.members().map(of_member).collect();
                SavedWork::Replay(members, mixture.of, *next)
            }
        };
        Saved {
            members: stepper.mixture.members().map(of_member).collect(),
            of: stepper.mixture.of,
            t: stepper.t,
            later: later.outputs.as_flattened().to_vec(),
            rates: later.rates.as_flattened().to_vec(),
            known,
            fits: stepper.fits,
            begun: stepper.begun,
            ended: stepper.ended,
            unexplained: stepper.unexplained,
            work,
            asked: 0,
        }
    }

    /// The run that was saved, `new` as it begins, but for its work; and what was measured,
    /// `nothing` yet.
    ///
    /// # Errors
    /// [`Error::Value`] for content that no run has.
    pub fn resumed<M: Family<P, N>, const P: usize, const N: usize>(
        &self,
        new: Option<Stepper<M, P, N>>,
        recording: &Recording<P>,
        mut nothing: Later<P>,
    ) -> Result<(Option<Stepper<M, P, N>>, Later<P>), Error> {
        if self.members.is_empty() {
            return Ok((None, nothing));
        }
        let mut stepper = new.ok_or_else(wrong)?;
        let ((later, rest), (rates, left)) =
            (self.later.as_chunks::<P>(), self.rates.as_chunks::<3>());
        let infinite = |of: &[f64]| of.iter().any(|v| v.is_infinite());
        if !(rest.is_empty() && left.is_empty())
            || infinite(&self.later)
            || infinite(&self.rates)
            || !(rates.is_empty() || rates.len() == later.len())
            || later.len() > self.t
            || self.fits > self.t + 1
            || self.begun > self.t
            || self.ended > self.t
            || self.of > self.t
            || self.asked > self.t
        {
            return Err(wrong());
        }
        (stepper.t, stepper.fits, stepper.begun) = (self.t, self.fits, self.begun);
        (stepper.ended, stepper.unexplained) = (self.ended, self.unexplained);
        let mixture = read_mixture(&stepper, recording.steps(), (&self.members, self.of));
        stepper.mixture = mixture.ok_or_else(wrong)?;
        for (k, y) in later.iter().enumerate() {
            nothing.push(*y, rates.get(k).copied());
        }
        Ok((Some(stepper), nothing))
    }

    /// Its work, of which fits are made again as far as they had come.
    ///
    /// # Errors
    /// [`Error::Value`] for content that no run has.
    pub fn resume_work<M: Family<P, N>, const P: usize, const N: usize>(
        &self,
        stepper: &mut Stepper<M, P, N>,
        recording: &Recording<P>,
        (data, units): (&Data<'_, P, M::Known>, &impl Units),
    ) -> Result<(), Error> {
        let steps = recording.steps();
        stepper.work = match &self.work {
            SavedWork::None => None,
            SavedWork::Fits(starts, end, calls, settles, of_means) => {
                let all = data.y.len()..data.y.len() + data.later.len() + 1;
                if starts.len() > OPTIMA + 1 || !all.contains(end) || *calls > stepper.t {
                    return Err(wrong());
                }
                let base = &stepper.leading().ok_or_else(wrong)?.found;
                let read = starts.iter().map(|start| read_start(base, steps, &mut Reader(start)));
                let read: Vec<_> = read.collect::<Option<_>>().ok_or_else(wrong)?;
                let later = end - data.y.len();
                if *of_means && data.means.is_none_or(|means| means.reach(later) != later) {
                    return Err(wrong());
                }
                let data = if *of_means { &data.in_means() } else { data };
                let near = stepper.refit == Some(Refit::Sliced);
                let manner = Manner { settles: *settles, near, of_means: *of_means };
                let settings = (stepper.size, stepper.known);
                let fits = Anchoring::new(read.into_iter(), *end, settings, manner);
                let mut fits = fits.ok_or_else(wrong)?;
                for _ in 0..*calls {
                    if fits.advance(data, slice(recording.p), units) {
                        return Err(wrong()); // ended fits are no work
                    }
                }
                Some(Work::Fits(fits, *calls))
            }
            SavedWork::Replay(members, of, next) => {
                let mixture = read_mixture(stepper, steps, (members, *of)).ok_or_else(wrong)?;
                if *next > data.later.len() || *of > *next {
                    return Err(wrong());
                }
                Some(Work::Replay(mixture, *next))
            }
        };
        Ok(())
    }
}

pub(crate) fn wrong() -> Error {
    Error::value("blob", "an estimator of a rigid body", "numbers of none")
}

fn read_mixture<M: Family<P, N>, const P: usize, const N: usize>(
    stepper: &Stepper<M, P, N>,
    steps: Steps,
    (members, of): (&[Vec<f64>], usize),
) -> Option<Mixture<M, P, N>> {
    (1..=OPTIMA).contains(&members.len()).then_some(())?;
    let read = members.iter().map(|numbers| read_member(stepper, steps, numbers));
    Mixture::of(read.collect::<Option<Vec<_>>>()?.into_iter(), of)
}

/// A fit; then z and P by rows, score, shares of wild samples and, if any, nominal z of its filter.
fn of_member<M: Family<P, N>, const P: usize, const N: usize>(
    member: &Member<M, P, N>,
) -> Vec<f64> {
    let filter = &member.filter;
    let rest = [filter.score, filter.wild, filter.wild_rates];
    let nominal = filter.nominal.as_ref().map_or(&[][..], |at| &at[..]);
    [&numbers(&member.found)[..], &filter.z, filter.P.as_flattened(), &rest, nominal].concat()
}

fn read_member<M: Family<P, N>, const P: usize, const N: usize>(
    stepper: &Stepper<M, P, N>,
    steps: Steps,
    numbers: &[f64],
) -> Option<Member<M, P, N>> {
    let leading = stepper.leading()?;
    let mut from = Reader(numbers);
    let found = posterior(&leading.found, steps, &mut from)?;
    let mut member = Member::new(&found, &leading.filter.noise);
    let filter = &mut member.filter;
    from.fill(&mut filter.z)?;
    from.fill(filter.P.as_flattened_mut())?;
    [filter.score, filter.wild, filter.wild_rates] = from.take()?;
    if !from.0.is_empty() {
        filter.nominal = Some(from.take()?);
    }
    from.0.is_empty().then_some(member)
}

/// Finite numbers one after the other.
struct Reader<'a>(&'a [f64]);

impl Reader<'_> {
    fn take<const K: usize>(&mut self) -> Option<[f64; K]> {
        let mut out = [0.0; K];
        self.fill(&mut out)?;
        Some(out)
    }

    fn fill(&mut self, to: &mut [f64]) -> Option<()> {
        let (own, rest) = self.0.split_at_checked(to.len())?;
        own.iter().all(|v| v.is_finite()).then_some(())?;
        to.copy_from_slice(own);
        self.0 = rest;
        Some(())
    }
}

fn of_body<M: Family<P, N>, const P: usize, const N: usize>(motion: &M) -> Vec<f64> {
    let flag = |there: bool| f64::from(u8::from(there));
    let flags = [flag(motion.given().cubic), flag(motion.is_simulated())];
    [&motion.frame()[..], &flags, &motion.given().spread].concat()
}

fn read_body<M: Family<P, N>, const P: usize, const N: usize>(
    base: &M,
    steps: Steps,
    from: &mut Reader<'_>,
) -> Option<M> {
    let mut motion = base.in_frame(&from.take()?);
    let [cubic, euler] = from.take()?;
    let given = motion.given_mut();
    given.cubic = M::MAY_BE_CUBIC && cubic != 0.0;
    given.steps = Steps { substeps: if euler != 0.0 { 0 } else { steps.substeps }, ..steps };
    given.spread = from.take()?;
    Some(motion)
}

/// A motion, (ω, θ), and the first rates of earlier recordings.
fn of_start<M: Family<P, N>, const P: usize, const N: usize>(start: &Start<M, N>) -> Vec<f64> {
    let Start { motion, z, firsts } = start;
    [&of_body(motion)[..], z, firsts.rates().as_flattened()].concat()
}

/// One with as many earlier recordings as another.
fn read_start<M: Family<P, N>, const P: usize, const N: usize>(
    base: &Posterior<M, N>,
    steps: Steps,
    from: &mut Reader<'_>,
) -> Option<Start<M, N>> {
    let (motion, z) = (read_body(&base.motion, steps, from)?, from.take()?);
    let mut firsts = base.firsts.rates().to_vec();
    from.fill(firsts.as_flattened_mut())?;
    Some(Start { motion, z, firsts: Firsts::of(firsts.into_iter()) })
}

fn numbers<M: Family<P, N>, const P: usize, const N: usize>(of: &Posterior<M, N>) -> Vec<f64> {
    let Posterior { w, P: covariance, cost, evidence, misfit, .. } = of;
    let size = [*cost, *evidence];
    let rest = [&w[..], covariance.as_flattened(), &size, &misfit.chi, &misfit.terms];
    [of_start(&of.start()), rest.concat()].concat()
}

fn posterior<M: Family<P, N>, const P: usize, const N: usize>(
    base: &Posterior<M, N>,
    steps: Steps,
    from: &mut Reader<'_>,
) -> Option<Posterior<M, N>> {
    let Start { motion, z, firsts } = read_start(base, steps, from)?;
    let w = from.take()?;
    let mut covariance = [[0.0; N]; N];
    from.fill(covariance.as_flattened_mut())?;
    let [cost, evidence] = from.take()?;
    let misfit = Misfit { chi: from.take()?, terms: from.take()? };
    Some(Posterior { motion, z, firsts, w, P: covariance, cost, evidence, misfit })
}

#[cfg(test)]
mod tests {
    use super::{Saved, SavedWork};
    use crate::history::History;
    use crate::rigid::config::{Refits, RigidConfig};
    use crate::rigid::made::online;
    use crate::rigid::measured::Measured;
    use crate::rigid::online::{Online, blank};

    /// Rates and outputs of a body that is braked about two of its axes, by Euler's rule.
    fn body(count: usize) -> (Vec<f64>, Vec<f64>) {
        let (mut w, mut x, mut y) = ([0.2, 0.15, -0.1], Vec::new(), Vec::new());
        for _ in 0..count {
            x.extend(w);
            y.extend([3.0 * w[0] + w[1], w[1] - 2.0 * w[0], 0.5 * w[0]]);
            for _ in 0..100 {
                let f = [
                    (-0.2 * w[1] * w[2] - 0.02 * w[0]) / 0.8,
                    0.4 * w[2] * w[0] - 0.01 * w[1],
                    -0.2 * w[0] * w[1] / 1.2,
                ];
                (0..3).for_each(|i| w[i] += 0.001 * f[i]);
            }
        }
        (x, y)
    }

    /// A run with fits beside its filters, and as it was saved.
    fn working() -> (Box<dyn Online>, Saved) {
        let (x, y) = body(500);
        let history = History::new(3, 3, &x[..3 * 151], &y[..3 * 150], 0.1).unwrap();
        let config = RigidConfig { refit: Refits::Sliced, ..RigidConfig::default() };
        let (mut run, mut estimate) = (online(&history, &config).unwrap(), blank(3));
        let mut fits = None;
        for y in y[450..].chunks_exact(3) {
            assert!(run.advance(&Measured { y, ..Measured::default() }, &mut estimate));
            let saved = run.saved();
            if matches!(&saved.work, SavedWork::Fits(_, _, calls, ..) if *calls > 0) {
                fits = Some(saved);
            }
        }
        (run, fits.unwrap())
    }

    #[test]
    fn work_that_would_have_ended_is_refused_at_once() {
        let (mut run, mut saved) = working();
        run.resume(&saved).unwrap();
        saved.t = usize::MAX / 4;
        if let SavedWork::Fits(_, _, calls, ..) = &mut saved.work {
            *calls = usize::MAX / 4;
        }
        assert!(run.resume(&saved).is_err());
    }
}
