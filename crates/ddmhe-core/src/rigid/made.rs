//! Which run a recording makes.

use crate::error::Error;
use crate::estimate::Estimate;
use crate::history::History;
use crate::rigid::affine::affine_unknowns;
use crate::rigid::config::{RigidConfig, is_of_rates, may_lag};
use crate::rigid::ground::Ground;
use crate::rigid::measured::Measured;
use crate::rigid::online::{Online, Run};
use crate::rigid::report::Report;
#[cfg(feature = "serde")]
use crate::rigid::saved::Saved;
use ddmhe_run::rigid::field::field_unknowns;
use ddmhe_run::rigid::layout::unknowns;
use ddmhe_run::rigid::{Body, FieldBody, LaggedBody, Limits};

/// What a recording of other than three rates leaves.
#[derive(Clone, Copy)]
struct NoBody;

impl Online for NoBody {
    fn advance(&mut self, _: &Measured<'_>, _: &mut Estimate) -> bool {
        false
    }

    fn limits(&self) -> Option<Limits> {
        None
    }

    fn score(&self) -> f64 {
        0.0
    }

    fn refit(&mut self) -> bool {
        false
    }

    fn refit_while(&mut self, _: &mut dyn FnMut() -> bool) -> Option<bool> {
        Some(false)
    }

    fn give_up(&mut self) {}

    fn retire(&mut self) {}

    fn restart(&mut self) {}

    fn tell_all(&self, _: &mut dyn Online, _: &mut Estimate) -> bool {
        false
    }

    fn is_rigid(&self) -> bool {
        false
    }

    fn explained(&self) -> bool {
        false
    }

    fn seeks_lag(&self) -> bool {
        false
    }

    fn suspects_lag(&mut self) -> bool {
        false
    }

    fn credible(&self) -> bool {
        false
    }

    fn doubted(&self) -> bool {
        false
    }

    fn second_spread(&self) -> Option<f64> {
        None
    }

    fn report(&self) -> Option<Report> {
        None
    }

    #[cfg(feature = "serde")]
    fn saved(&self) -> Saved {
        Saved::default()
    }

    #[cfg(feature = "serde")]
    fn resume(&mut self, _: &Saved) -> Result<(), Error> {
        Ok(())
    }

    fn copy(&self) -> Box<dyn Online> {
        Box::new(*self)
    }
}

/// A new run, in the narrowest of three types that has room for the outputs: each is a quarter of a
/// megabyte of machine code.
///
/// # Errors
/// [`Error::Value`] for a recording of zeros.
pub(crate) fn online(history: &History, config: &RigidConfig) -> Result<Box<dyn Online>, Error> {
    fn of<const P: usize, const N: usize, const NA: usize>(
        history: &History,
        config: &RigidConfig,
    ) -> Result<Box<dyn Online>, Error> {
        Ok(Box::new(Run::on(Ground::<Body<P, N>, P, N>::new::<NA>(history, config)?)))
    }
    if !is_of_rates(history) {
        return Ok(Box::new(NoBody));
    }
    if config.field.is_some() {
        type InField = FieldBody<3, { field_unknowns(3) }>;
        let ground = Ground::<InField, _, _>::new::<{ affine_unknowns(3) }>(history, config)?;
        return Ok(Box::new(Run::on(ground)));
    }
    if config.output_lag == Some(true)
        && let Some(own) = lagging(history, config)?
    {
        return Ok(own);
    }
    let own = match history.p() {
        1 => of::<1, { unknowns(1) }, { affine_unknowns(1) }>(history, config),
        2 | 3 => of::<3, { unknowns(3) }, { affine_unknowns(3) }>(history, config),
        _ => of::<6, { unknowns(6) }, { affine_unknowns(6) }>(history, config),
    }?;
    let other = if own.explained() { None } else { lagging(history, config)? };
    Ok(other.unwrap_or(own))
}

/// A new run of a body that is seen by sensors that lag, if it may be and explains the recording.
///
/// # Errors
/// As [`online`].
pub(crate) fn lagging(
    history: &History,
    config: &RigidConfig,
) -> Result<Option<Box<dyn Online>>, Error> {
    type Lagging = LaggedBody<3, { unknowns(3) }>;
    if config.output_lag == Some(false) || !may_lag(history, config) {
        return Ok(None);
    }
    let ground = Ground::<Lagging, _, _>::lagging(history, config)?;
    Ok(ground.map(|ground| Box::new(Run::on(ground)) as Box<dyn Online>))
}
