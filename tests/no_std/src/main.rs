//! The machine around the flight software: where it starts, where its numbers go, how it ends.
//!
//! Three functions of the C library stand for a board's: `main` is what its start-up code calls,
//! `write` is the telemetry, `abort` the reset.

#![no_std]
#![no_main]

use core::panic::PanicInfo;

/// Numbers for a stepper.
const ROOM: usize = 1 << 14;

// A crate of bindings would declare the same two functions, and make calling them no safer.
#[allow(unsafe_code)]
#[link(name = "c")]
unsafe extern "C" {
    fn write(file: i32, bytes: *const u8, len: usize) -> isize;
    safe fn abort() -> !;
}

/// A step's numbers to standard output.
#[allow(unsafe_code)]
fn send(mut bytes: &[u8]) {
    while !bytes.is_empty() {
        // SAFETY: `write` reads these bytes and no others.
        let written = unsafe { write(1, bytes.as_ptr(), bytes.len()) };
        let Some(rest) = usize::try_from(written).ok().and_then(|len| bytes.get(len..)) else {
            abort()
        };
        bytes = rest;
    }
}

/// 0, or 1 where the plan is none or the room too small.
#[allow(unsafe_code, reason = "the C library's start-up code calls `main` by this name")]
#[unsafe(no_mangle)]
pub extern "C" fn main() -> i32 {
    let mut memory = [0.0; ROOM];
    i32::from(ddmhe_no_std::fly(&mut memory, |number| send(&number)).is_err())
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    abort()
}
