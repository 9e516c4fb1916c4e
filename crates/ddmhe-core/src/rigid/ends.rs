//! Who foretells the ends of a recording that neither a rigid body nor an affine motion explains,
//! whatever the noise.

use crate::error::Error;
use crate::history::History;
use crate::mhe::DdMhe;
use crate::rigid::config::{Refits, RigidConfig, SAMPLES};
use crate::rigid::made::online;
use crate::rigid::measured::Measured;
use crate::rigid::online::blank;

/// Shares of the longest recording to whose beginnings a body that does not explain it is fitted.
const BEGINNINGS: [f64; 2] = [0.5, 0.75];

/// Whether a body that is fitted to the recording's beginnings is nearer to the recorded rates
/// after each of them than an affine estimator: where neither explains the recording, that decides.
/// Of several recordings the longest is cut up, and all others are known.
pub(crate) fn foretells(history: &History, config: &RigidConfig) -> Result<bool, Error> {
    let all = 0..history.recordings();
    let longest = all.clone().max_by_key(|i| history.outputs(*i).len()).unwrap_or(0);
    let (x, y, p) = (history.x(longest)?, history.y(longest)?, history.p());
    let others = all.filter(|i| *i != longest);
    let of = |x: &[f64], y: &[f64]| History::new(3, p, x, y, history.dt());
    let mut recordings: Vec<History> =
        others.map(|i| of(history.states(i), history.outputs(i))).collect::<Result<_, _>>()?;
    let count = y.len() / p;
    let of_affine = config.of_affine(config.x_bounds.clone());
    let field = config.field.as_ref();
    let mut better = false;
    for share in BEGINNINGS {
        let first = (share * count as f64) as usize;
        if history.T() - count + first < SAMPLES {
            continue;
        }
        recordings.push(of(&x[..3 * (first + 1)], &y[..p * first])?);
        let beginning = History::concat(&recordings)?;
        recordings.pop();
        let of_body = RigidConfig {
            refit: Refits::Manual,
            field: field.map(|field| field.first(first + 1, p)),
            ..config.clone()
        };
        let mut body = online(&beginning, &of_body)?;
        let mut affine = DdMhe::new(&beginning, of_affine.clone())?;
        let (mut estimate, mut errors) = (blank(p), (0.0, 0.0));
        let off = |x: &[f64], truth: &[f64]| -> f64 {
            x.iter().zip(truth).map(|(x, truth)| (x - truth) * (x - truth)).sum()
        };
        let later = y[p * first..].chunks(p).zip(x[3 * (first + 1)..].chunks(3));
        for (k, (y, truth)) in later.enumerate() {
            let field = field.map(|field| field.at(first + k, p));
            if !body.advance(&Measured { y, x: None, field }, &mut estimate) {
                return Ok(false);
            }
            errors.0 += off(&estimate.x, truth);
            errors.1 += off(&affine.step(y)?.x, truth);
        }
        if errors.0 > errors.1 {
            return Ok(false);
        }
        better = true;
    }
    Ok(better)
}
