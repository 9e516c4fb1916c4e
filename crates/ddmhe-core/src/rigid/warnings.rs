//! What a user should know of a run of the rigid body's estimator.

use crate::rigid::online::Online;

/// Recorded rates that spread in a second direction by less than so many times their noise lie
/// along a line. So did six of seven, of 210, that were trusted for long while five deviations off.
const A_LINE: f64 = 3.0;

/// What a user should know of a run over n states, in words.
pub(crate) fn warnings(rigid: &dyn Online, n: usize) -> Vec<String> {
    let why = |rest: &str| {
        let report = rigid.report();
        let first = report.and_then(|report| report.words.into_iter().next());
        format!(
            "{}: {rest}",
            first.unwrap_or_else(|| match n {
                3 => "no rigid body fits the recording".into(),
                n => format!("a recording of n = {n} states is of no body's three rates"),
            })
        )
    };
    let mut words = Vec::new();
    match (rigid.explained(), rigid.is_rigid()) {
        (true, true) => {}
        (true, false) => words.push(
            "outputs do what the body of the recording does not: the affine estimator has \
                 taken over"
                .into(),
        ),
        (false, true) => words.push(why(
            "it is nearer than an affine motion, and goes on with more noise than was recorded",
        )),
        (false, false) => words.push(why("the affine estimator stands in for it")),
    }
    if let Some(spread) = rigid.second_spread().filter(|spread| *spread < A_LINE) {
        words.push(format!(
            "recorded rates hardly spread in a second direction ({spread:.1} times their noise): \
                 many bodies do that, and bars may be much too narrow"
        ));
    }
    if rigid.doubted() {
        words
            .push("no estimate is trusted: no body explains all data, whatever their noise".into());
    }
    words
}
