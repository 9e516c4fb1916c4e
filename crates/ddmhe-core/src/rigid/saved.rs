//! A run of the rigid body's estimator as it is continued in another process.

use crate::error::Error;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::anchoring::{OPTIMA, Optima};
use ddmhe_run::rigid::motion::Steps;
use ddmhe_run::rigid::stepper::{Work, last_fit, slice};
use ddmhe_run::rigid::{Anchoring, Body, Data, Filter, Misfit, Posterior, Stepper};
use serde::{Deserialize, Serialize};

/// What changes from step to step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Saved {
    /// One list an optimum; none where there is no motion any more.
    optima: Vec<Vec<f64>>,
    filter: Vec<f64>,
    later: Vec<f64>,
    fits: usize,
    begun: usize,
    work: SavedWork,
}

/// What goes on beside the filter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
enum SavedWork {
    /// Nothing.
    #[default]
    None,
    /// Fits: their starts, the number of outputs, how often they were advanced, the optimum other
    /// than the best that they begin at, too, and whether they try the other prior on offsets.
    Fits(Vec<Vec<f64>>, usize, usize, usize, bool),
    /// A filter on its way to the newest output: optima, filter, and the next output.
    Replay(Vec<Vec<f64>>, Vec<f64>, usize),
}

impl Saved {
    pub fn of<const P: usize, const N: usize>(
        stepper: Option<&Stepper<P, N>>,
        later: &[[f64; P]],
    ) -> Self {
        let Some(stepper) = stepper else { return Saved::default() };
        let work = match &stepper.work {
            None => SavedWork::None,
            Some(Work::Fits(fits, calls, other)) => {
                let starts = fits.starts().map(|(body, z)| [of_body(body), z.to_vec()].concat());
                SavedWork::Fits(starts.collect(), fits.end(), *calls, *other, fits.settles())
            }
            Some(Work::Replay(optima, filter, next)) => {
                SavedWork::Replay(of_optima(optima), of_filter(filter), *next)
            }
        };
        Saved {
            optima: of_optima(&stepper.optima),
            filter: of_filter(&stepper.filter),
            later: later.as_flattened().to_vec(),
            fits: stepper.fits,
            begun: stepper.begun,
            work,
        }
    }

    /// The run that was saved, `new` as it begins, but for its work.
    ///
    /// # Errors
    /// [`Error::Value`] for content that no run has.
    pub fn resumed<const P: usize, const N: usize>(
        &self,
        new: Option<Stepper<P, N>>,
        recording: &Recording<P>,
    ) -> Result<(Option<Stepper<P, N>>, Vec<[f64; P]>), Error> {
        if self.optima.is_empty() {
            return Ok((None, Vec::new()));
        }
        let mut stepper = new.ok_or_else(wrong)?;
        let (later, rest) = self.later.as_chunks::<P>();
        let infinite = self.later.iter().any(|v| v.is_infinite());
        if !rest.is_empty() || infinite || self.fits > later.len() + 1 || self.begun > later.len() {
            return Err(wrong());
        }
        (stepper.t, stepper.fits, stepper.begun) = (later.len(), self.fits, self.begun);
        let steps = recording.steps();
        stepper.optima = read_optima(&stepper, steps, &self.optima).ok_or_else(wrong)?;
        stepper.filter = read_filter(&stepper, &stepper.optima, &self.filter).ok_or_else(wrong)?;
        let mut log = Vec::with_capacity(last_fit(recording.y.len()).max(later.len()) + 1);
        log.extend_from_slice(later);
        Ok((Some(stepper), log))
    }

    /// Its work, of which fits are made again as far as they had come.
    ///
    /// # Errors
    /// [`Error::Value`] for content that no run has.
    pub fn resume_work<const P: usize, const N: usize>(
        &self,
        stepper: &mut Stepper<P, N>,
        recording: &Recording<P>,
        data: &Data<'_, P>,
    ) -> Result<(), Error> {
        let steps = recording.steps();
        stepper.work = match &self.work {
            SavedWork::None => None,
            SavedWork::Fits(starts, end, calls, other, settles) => {
                let all = data.y.len()..data.y.len() + data.later.len() + 1;
                if starts.len() > OPTIMA + 1
                    || !all.contains(end)
                    || *calls > stepper.t
                    || *other >= OPTIMA
                {
                    return Err(wrong());
                }
                let base = stepper.best().ok_or_else(wrong)?.motion;
                let mut read = Vec::new();
                for numbers in starts {
                    let mut from = Reader(numbers);
                    let body = read_body(&base, steps, &mut from).ok_or_else(wrong)?;
                    read.push((body, from.take().ok_or_else(wrong)?));
                }
                let settings = (stepper.size, stepper.known, *settles);
                let fits = Anchoring::new(read.into_iter(), *end, settings);
                let mut fits = fits.ok_or_else(wrong)?;
                for _ in 0..*calls {
                    fits.advance(data, slice(P));
                }
                Some(Work::Fits(fits, *calls, *other))
            }
            SavedWork::Replay(optima, filter, next) => {
                if *next > stepper.t {
                    return Err(wrong());
                }
                let optima = read_optima(stepper, steps, optima).ok_or_else(wrong)?;
                let filter = read_filter(stepper, &optima, filter).ok_or_else(wrong)?;
                Some(Work::Replay(optima, filter, *next))
            }
        };
        Ok(())
    }
}

fn wrong() -> Error {
    Error::value("blob", "an estimator of a rigid body", "numbers of none")
}

/// z and P by rows, score and share of wild samples.
fn of_filter<const P: usize, const N: usize>(filter: &Filter<P, N>) -> Vec<f64> {
    [&filter.z[..], filter.P.as_flattened(), &[filter.score, filter.wild]].concat()
}

fn read_filter<const P: usize, const N: usize>(
    stepper: &Stepper<P, N>,
    optima: &Optima<P, N>,
    numbers: &[f64],
) -> Option<Filter<P, N>> {
    let mut filter = Filter::new(optima[0].as_ref()?, &stepper.filter.noise);
    let mut from = Reader(numbers);
    from.fill(&mut filter.z)?;
    from.fill(filter.P.as_flattened_mut())?;
    [filter.score, filter.wild] = from.take()?;
    from.0.is_empty().then_some(filter)
}

fn of_optima<const P: usize, const N: usize>(optima: &Optima<P, N>) -> Vec<Vec<f64>> {
    optima.iter().flatten().map(numbers).collect()
}

fn read_optima<const P: usize, const N: usize>(
    stepper: &Stepper<P, N>,
    steps: Steps,
    saved: &[Vec<f64>],
) -> Option<Optima<P, N>> {
    let base = stepper.best()?.motion;
    let mut optima = [const { None }; OPTIMA];
    (1..=OPTIMA).contains(&saved.len()).then_some(())?;
    for (to, numbers) in optima.iter_mut().zip(saved) {
        *to = Some(posterior(&base, steps, numbers)?);
    }
    Some(optima)
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

fn of_body<const P: usize, const N: usize>(body: &Body<P, N>) -> Vec<f64> {
    let flag = |there: bool| f64::from(u8::from(there));
    let flags = [flag(body.cubic), flag(body.steps.substeps == 0)];
    [&body.b0[..], body.N0.as_flattened(), &flags, &body.spread].concat()
}

fn read_body<const P: usize, const N: usize>(
    base: &Body<P, N>,
    steps: Steps,
    from: &mut Reader<'_>,
) -> Option<Body<P, N>> {
    let mut body = *base;
    body.b0 = from.take()?;
    from.fill(body.N0.as_flattened_mut())?;
    let [cubic, euler] = from.take()?;
    body.cubic = cubic != 0.0;
    body.steps = Steps { substeps: if euler != 0.0 { 0 } else { steps.substeps }, ..steps };
    body.spread = from.take()?;
    Some(body)
}

fn numbers<const P: usize, const N: usize>(of: &Posterior<Body<P, N>, N>) -> Vec<f64> {
    let Posterior { motion, z, w, P: covariance, cost, evidence, misfit } = of;
    let size = [*cost, *evidence];
    let rest = [&z[..], w, covariance.as_flattened(), &size, &misfit.chi, &misfit.terms];
    [of_body(motion), rest.concat()].concat()
}

fn posterior<const P: usize, const N: usize>(
    base: &Body<P, N>,
    steps: Steps,
    numbers: &[f64],
) -> Option<Posterior<Body<P, N>, N>> {
    let mut from = Reader(numbers);
    let motion = read_body(base, steps, &mut from)?;
    let (z, w) = (from.take()?, from.take()?);
    let mut covariance = [[0.0; N]; N];
    from.fill(covariance.as_flattened_mut())?;
    let [cost, evidence] = from.take()?;
    let misfit = Misfit { chi: from.take()?, terms: from.take()? };
    from.0.is_empty().then_some(Posterior { motion, z, w, P: covariance, cost, evidence, misfit })
}
