//! Steps of a restored estimator, timed one by one beside other libraries': see peers/native.py.
//!
//! Arguments: a snapshot, outputs (f64, little endian), how many of them come before the first
//! timed step, and the file that the nanoseconds are written to (u64, little endian).

use ddmhe_core::DdMhe;
use std::time::Instant;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [snapshot, outputs, before, out] = &arguments[..] else {
        return Err("usage: timed_steps SNAPSHOT OUTPUTS BEFORE OUT".into());
    };
    let mut mhe = DdMhe::restore(&std::fs::read(snapshot)?)?;
    let bytes = std::fs::read(outputs)?;
    let outputs: Vec<f64> =
        bytes.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let before = before.parse::<usize>()? * mhe.p();
    mhe.run(&outputs)?; // all of it in the caches, as after any other step
    mhe.reset(None)?;
    mhe.run(&outputs[..before])?;
    let mut nanoseconds = Vec::with_capacity(outputs.len());
    for y in outputs[before..].chunks_exact(mhe.p()) {
        let start = Instant::now();
        mhe.step(y)?;
        nanoseconds.push(start.elapsed().as_nanos() as u64);
    }
    std::fs::write(out, nanoseconds.iter().flat_map(|t| t.to_le_bytes()).collect::<Vec<_>>())?;
    Ok(())
}
