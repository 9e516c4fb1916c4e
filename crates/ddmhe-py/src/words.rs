//! What messages show of what was given: in one line, and of what is long the beginning.

use pyo3::prelude::*;

/// Characters of what was given that a message shows.
const LONGEST: usize = 60;

/// Characters of what somebody else's code said that a message shows.
const LONGEST_SAID: usize = 300;

/// What was given, short and in one line.
pub fn shown(value: &Bound<'_, PyAny>) -> String {
    let text =
        value.repr().map_or_else(|_| "one that cannot be printed".into(), |text| text.to_string());
    let text = one_line(&text);
    if text.chars().count() <= LONGEST {
        return text;
    }
    format!("{}… (a {})", beginning(&text, LONGEST), kind(value))
}

/// The type of what was given.
pub fn kind(value: &Bound<'_, PyAny>) -> String {
    short(&value.get_type().to_string(), LONGEST)
}

/// A name in quotes.
pub fn quoted(name: &str) -> String {
    short(&format!("{name:?}"), LONGEST)
}

/// What an exception of somebody else's code says, or another text of theirs.
pub fn said(text: &str) -> String {
    short(text, LONGEST_SAID)
}

fn short(text: &str, longest: usize) -> String {
    let text = one_line(text);
    if text.chars().count() <= longest { text } else { format!("{}…", beginning(&text, longest)) }
}

fn beginning(text: &str, length: usize) -> String {
    text.chars().take(length).collect()
}

/// The text with escapes for what a terminal would obey or could not show.
fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.split_whitespace().collect::<Vec<_>>().join(" ").chars() {
        match c {
            '\'' | '"' | '\\' => line.push(c),
            _ => line.extend(c.escape_debug()),
        }
    }
    line
}

/// The known name that was most likely meant, as the end of a message.
pub fn nearest(py: Python<'_>, name: &str, known: &[&str]) -> PyResult<String> {
    py.import("ddmhe.checks")?.call_method1("did_you_mean", (name, known))?.extract()
}
