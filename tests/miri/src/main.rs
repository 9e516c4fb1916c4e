//! Every plan of the fuzzer's corpus, as it is and with changed bytes, read and stepped:
//! `cargo +nightly miri run --manifest-path tests/miri/Cargo.toml -- DAMAGED`.

#[path = "../../fuzz/src/flight.rs"]
mod flight;
#[path = "../../fuzz/src/sealed.rs"]
#[allow(dead_code, reason = "snapshots need the whole core")]
mod sealed;

const CORPUS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus/plan");

/// Bytes at random, from Knuth's generator.
fn next(seed: &mut u64) -> usize {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    usize::try_from(*seed >> 33).unwrap_or_default()
}

#[allow(clippy::print_stdout)]
fn main() -> std::io::Result<()> {
    let damaged = std::env::args().nth(1).and_then(|word| word.parse().ok()).unwrap_or(3_usize);
    let (mut plans, mut flown, mut steps, mut seed) = (0, 0, 0, 1);
    let mut files = std::fs::read_dir(CORPUS)?.collect::<Result<Vec<_>, _>>()?;
    files.sort_by_key(std::fs::DirEntry::path);
    for file in files {
        let whole = std::fs::read(file.path())?;
        for k in 0..=damaged {
            let mut bytes = whole.clone();
            for _ in 0..k.min(4) {
                let at = next(&mut seed) % bytes.len();
                bytes[at] = u8::try_from(next(&mut seed) % 256).unwrap_or_default();
            }
            let made = flight::fly(&bytes, 6);
            plans += 1;
            flown += usize::from(made > 0);
            steps += made;
        }
    }
    println!("{plans} plans, {flown} of them stepped, {steps} steps: nothing undefined");
    Ok(())
}
