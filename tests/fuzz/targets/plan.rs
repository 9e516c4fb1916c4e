//! Bytes of a plan, under a length and a checksum that fit.
#![no_main]

use ddmhe_fuzz::flight;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    flight::fly(bytes, 40);
});
