//! Units of channels: one name each, "" where unknown.

use crate::error::Error;

/// Names of units in one line, of a long list the beginning.
pub(crate) fn shown(units: &[String]) -> String {
    let text = format!("{units:?}");
    let rest = if text.chars().count() > LONGEST { "…" } else { "" };
    text.chars().take(LONGEST).collect::<String>() + rest
}

/// Characters of names that a message shows.
const LONGEST: usize = 200;

/// The units of channels that have none.
pub(crate) fn unknown(channels: usize) -> Vec<String> {
    vec![String::new(); channels]
}

/// One unit a channel, from as many or from one for all.
pub(crate) fn units(
    argument: &'static str,
    given: &[impl AsRef<str>],
    channels: usize,
) -> Result<Vec<String>, Error> {
    match given {
        [one] => Ok(vec![one.as_ref().trim().to_string(); channels]),
        all if all.len() == channels => {
            Ok(all.iter().map(|unit| unit.as_ref().trim().to_string()).collect())
        }
        _ => Err(Error::shape(argument, format!("1 or {channels} names"), given.len())),
    }
}
