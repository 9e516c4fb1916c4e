//! `tests/no_std` steps a plan without std and without an allocator: it is built, run, and its
//! numbers are compared.

use crate::systems::noise;
use ddmhe_core::{Bounds, Config, DdMhe, Estimate, History, Start, Status};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// What a program without std may still ask of others: copies of memory, which the compiler calls
/// by these names, the three functions that the program names itself, and what every program's
/// start-up code has.
const ASKED: [&str; 12] = [
    "memcpy",
    "memmove",
    "memset",
    "memcmp",
    "bcmp",
    "write",
    "abort",
    "__libc_start_main",
    "__cxa_finalize",
    "__gmon_start__",
    "_ITM_deregisterTMCloneTable",
    "_ITM_registerTMCloneTable",
];

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// What a command prints, if it ends well.
fn printed(command: &mut Command) -> Vec<u8> {
    let found = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let said = String::from_utf8_lossy(&found.stderr);
    assert!(found.status.success(), "{command:?}: {}\n{said}", found.status);
    found.stdout
}

fn text(command: &mut Command) -> String {
    String::from_utf8(printed(command)).unwrap()
}

/// Where this test's files are: below the directory that cargo keeps for tests.
fn made() -> PathBuf {
    let made = Path::new(env!("CARGO_TARGET_TMPDIR")).join("no_std");
    fs::create_dir_all(&made).unwrap();
    made
}

/// Cargo on the program, whatever was asked of the cargo that runs this test.
fn cargo(command: &str, arguments: &[&str]) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.arg(command).args(["--locked", "--manifest-path"]);
    cargo.arg(root().join("tests/no_std/Cargo.toml")).args(arguments);
    for asked in ["CARGO_BUILD_TARGET", "CARGO_ENCODED_RUSTFLAGS", "RUSTFLAGS"] {
        cargo.env_remove(asked);
    }
    cargo
}

/// Builds the program, or a part of it, with these files in it; where what was built is.
fn build(name: &str, plan: &[u8], outputs: &[f64], arguments: &[&str]) -> PathBuf {
    let made = made();
    let file = |kind: &str, bytes: &[u8]| {
        let path = made.join(format!("{name}.{kind}"));
        // what was built with the same bytes need not be built again
        if fs::read(&path).ok().as_deref() != Some(bytes) {
            fs::write(&path, bytes).unwrap();
        }
        path
    };
    let log: Vec<u8> = outputs.iter().flat_map(|y| y.to_le_bytes()).collect();
    let target = made.join("target");
    printed(
        cargo("build", &["--release", "--quiet", "--target-dir"])
            .arg(&target)
            .args(arguments)
            .env("DDMHE_PLAN", file("plan", plan))
            .env("DDMHE_OUTPUTS", file("outputs", &log)),
    );
    target
}

/// Angular rates ω (rad/s) of a tumbling body that eddy currents brake, every .1 s for 12 s, and
/// the measured torques: J ω̇ = -ω × Jω + τ, τ = -c (ω - .2 ω × e), e the axis of the field.
fn detumbled(start: [f64; 3], seed: u64) -> (Vec<f64>, Vec<f64>) {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let (J, dt) = ([1.0, 1.4, 0.8], 0.1);
    let (mut w, mut rates, mut torques) = (start, start.to_vec(), Vec::new());
    for v in noise(seed, 3 * 120, 2e-3).as_chunks::<3>().0 {
        let spun = cross(w, [0.0, 0.6, 0.8]);
        let torque: [f64; 3] = std::array::from_fn(|i| -0.15 * (w[i] - 0.2 * spun[i]));
        torques.extend((0..3).map(|i| torque[i] + v[i]));
        let gyro = cross(w, std::array::from_fn(|i| J[i] * w[i]));
        w = std::array::from_fn(|i| w[i] + dt * (torque[i] - gyro[i]) / J[i]);
        rates.extend(w);
    }
    (rates, torques)
}

/// An estimator with boxes that are active now and then, and outputs that are lost now and then.
fn braked() -> (DdMhe, Vec<f64>) {
    let (x, y) = detumbled([0.3, -0.2, 0.4], 1);
    let history = History::new(3, 3, &x, &y, 0.1).unwrap();
    let within = |size: f64| Some(Bounds { lo: vec![-size; 3], hi: vec![size; 3] });
    let config = Config {
        horizon: Some(8),
        x_bounds: within(0.2),
        v_bounds: within(1.5e-3),
        start: Start::Unknown,
        ..Config::default()
    };
    let (_, mut outputs) = detumbled([0.35, 0.25, -0.3], 2);
    (0..360).step_by(17).for_each(|k| outputs[k] = f64::NAN);
    outputs[150..153].fill(f64::NAN);
    (DdMhe::new(&history, config).unwrap(), outputs)
}

/// What the program sends of an estimate.
fn sent(e: &Estimate) -> Vec<f64> {
    let evidence = [e.cost, f64::from(e.status.code()), e.active as f64];
    [&e.x[..], &e.window, &e.v, &evidence].concat()
}

/// As they can be compared: which NaN stands for "not measured" says nothing.
fn bits(numbers: impl Iterator<Item = f64>) -> Vec<u64> {
    numbers.map(|x| if x.is_nan() { f64::NAN } else { x }.to_bits()).collect()
}

/// Names that `nm` prints with this option.
fn symbols(program: &Path, option: &str) -> BTreeSet<String> {
    let mut nm = Command::new("nm");
    nm.args(["--format=posix", option]).arg(program);
    assert!(
        nm.output().is_ok(),
        "nm (binutils) is needed to see what a program asks of others, not found"
    );
    // "name@version type …"
    let name = |line: &str| line.split([' ', '@']).next().map(str::to_owned);
    text(&mut nm).lines().filter_map(name).collect()
}

/// Symbols that a program without std and without an allocator has no use for.
fn needless(program: &Path) -> Vec<String> {
    let asked = symbols(program, "--undefined-only");
    let asked = asked.into_iter().filter(|name| !ASKED.contains(&name.as_str()));
    // a path of std, in both of Rust's ways to write a name; or anything that allocates
    let own = |name: &String| ["3std", "std..", "alloc"].iter().any(|part| name.contains(part));
    asked.chain(symbols(program, "--defined-only").into_iter().filter(own)).collect()
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "the program is linked for Linux")]
fn a_program_without_std_makes_the_same_estimates() {
    let (mut mhe, outputs) = braked();
    let target = build("braked", &mhe.plan().unwrap(), &outputs, &[]);
    let program = target.join("release/ddmhe-no-std");
    let flown = printed(&mut Command::new(&program));
    let flown = bits(flown.as_chunks().0.iter().map(|number| f64::from_le_bytes(*number)));

    let (mut expected, mut active, mut lost) = (Vec::new(), 0, 0);
    for y in outputs.chunks_exact(3) {
        let estimate = mhe.step(y).unwrap();
        expected.extend(sent(estimate));
        active += usize::from(estimate.status == Status::Optimal && estimate.active > 0);
        lost += usize::from(y.iter().any(|y| y.is_nan()));
    }
    assert!(active > 20 && lost > 20, "{active} {lost}");
    let expected = bits(expected.into_iter());
    assert_eq!(flown.len(), expected.len());
    assert_eq!(flown.iter().zip(&expected).position(|(a, b)| a != b), None);

    assert_eq!(needless(&program), [""; 0]);
    // which says something: this program has both
    let both = needless(&env::current_exe().unwrap());
    assert!(both.iter().any(|name| name.contains("alloc")), "{both:?}");
    assert!(both.iter().any(|name| name.contains("3std")), "{both:?}");
    assert!(both.iter().any(|name| name == "malloc"), "{both:?}");
}

/// A machine with 32 bits, no operating system and no std to link by mistake.
#[test]
fn a_microcontroller_compiles_it() {
    const TARGET: &str = "thumbv7em-none-eabihf";
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| OsStr::new("rustc").into());
    let libraries = text(Command::new(rustc).args(["--print=target-libdir", "--target", TARGET]));
    if !Path::new(libraries.trim()).is_dir() {
        use std::io::Write;
        // not by a macro, whose text the harness keeps to itself
        let why = format!("skipped: {TARGET} is not installed (rustup target add {TARGET})\n");
        return std::io::stderr().write_all(why.as_bytes()).unwrap();
    }
    let (mhe, outputs) = braked();
    let target = build("thumb", &mhe.plan().unwrap(), &outputs, &["--lib", "--target", TARGET]);
    assert!(target.join(TARGET).join("release/libddmhe_no_std.rlib").is_file());
}

#[test]
fn a_step_needs_three_small_crates() {
    let tree = |edges| {
        let options = ["--package=ddmhe-run", "--prefix=depth", "--format={p} | {f}", edges];
        text(&mut cargo("tree", &options))
    };
    let needed = tree("--edges=normal");
    let direct: Vec<_> = needed.lines().filter_map(|line| line.strip_prefix('1')).collect();
    assert!((1..=3).contains(&direct.len()), "{needed}");
    for line in needed.lines() {
        let (_, features) = line.split_once('|').unwrap();
        let of = |feature: &str| features.split([',', ' ']).any(|found| found == feature);
        assert!(!of("std") && !of("alloc") && !of("default"), "{needed}");
    }
}

/// The crates that fly are those that the other tests test.
#[test]
fn both_lock_files_name_the_same_versions() {
    let lock = |path: &str| fs::read_to_string(root().join(path)).unwrap();
    let (all, flown) = (lock("Cargo.lock"), lock("tests/no_std/Cargo.lock"));
    let crates = flown.split("[[package]]").skip(1).map(str::trim);
    let flown: Vec<_> = crates.filter(|of| !of.contains("name = \"ddmhe-no-std\"")).collect();
    assert!(flown.len() >= 4, "{flown:?}");
    flown.iter().for_each(|of| assert!(all.contains(of), "{of}"));
}
