//! A recording, settings and outputs made of the fuzzer's bytes.
#![no_main]

use ddmhe_fuzz::{case::Case, check};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    check::everything(&Case::new(bytes));
});
