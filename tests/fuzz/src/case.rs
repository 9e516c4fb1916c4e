//! A recording, settings and what is measured afterwards, made of bytes.

use super::source::Source;
use ddmhe_core::{
    Bounds, Center, Certificate, Config, Disturbance, Equilibrium, Error, Gate, History,
    ProcessNoise, Soft, Space, Start, Stuck, Weighting,
};

/// One sample: y, u and the bounds of its step.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Outputs (p), or another number of them.
    pub y: Vec<f64>,
    /// Inputs (m), or another number of them.
    pub u: Vec<f64>,
    /// Bounds for this step alone.
    pub x_bounds: Option<Bounds>,
}

/// Everything that an estimator is given.
#[derive(Debug, Clone)]
pub struct Case {
    /// Channels n, p, m.
    pub sizes: [usize; 3],
    /// States (T+1)·n, outputs T·p, inputs T·m.
    pub recording: [Vec<f64>; 3],
    /// The settings.
    pub config: Config,
    /// What is measured.
    pub samples: Vec<Sample>,
}

impl Case {
    /// The case that these bytes stand for.
    pub fn new(bytes: &[u8]) -> Self {
        let mut source = Source(bytes);
        let sizes = [1 + source.below(3), 1 + source.below(2), source.below(3) % 2];
        let T = 12 + source.below(36);
        let config = config(&mut source, sizes);
        let (recording, online) = match source.byte() % 8 {
            7 => (arbitrary(&mut source, sizes, T), None),
            _ => {
                let (recording, online) = simulated(&mut source, sizes, T);
                (recording, Some(online))
            }
        };
        let samples = samples(&mut source, sizes, online);
        Case { sizes, recording, config, samples }
    }

    /// The recording, if it is one.
    ///
    /// # Errors
    /// As [`History::new`].
    pub fn history(&self) -> Result<History, Error> {
        let ([n, p, m], [x, y, u]) = (self.sizes, &self.recording);
        let history = History::new(n, p, x, y, 0.1)?;
        if m > 0 { history.with_inputs(m, u) } else { Ok(history) }
    }
}

/// Numbers that no system made, now and then too many or too few of them.
fn arbitrary(source: &mut Source<'_>, [n, p, m]: [usize; 3], T: usize) -> [Vec<f64>; 3] {
    let odd = source.once_in(2);
    let extra = usize::from(source.once_in(8));
    let lengths = [(T + 1) * n + extra, T * p, T * m];
    lengths.map(|length| source.numbers(length, odd))
}

/// A recording of a coupled decaying system and 40 outputs and inputs that follow it.
fn simulated(
    source: &mut Source<'_>,
    [n, p, m]: [usize; 3],
    T: usize,
) -> ([Vec<f64>; 3], [Vec<f64>; 2]) {
    let noise = [0.0, 1e-9, 0.02, 0.3][source.below(4)];
    let scale = [1.0, 1e-40, 1e40, 273.15, 1e8, 1e-8][source.below(6)];
    let offset = [0.0, 0.0, 300.0, 1e6][source.below(4)];
    let (radius, angle) = (0.9 + source.sane() / 32.0, 0.3 + source.sane() / 8.0);
    let mut random = 0x9e37_79b9 ^ u64::from(source.byte());
    let mut noisy = move |size: f64| {
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        size * ((random >> 33) as f64 / f64::from(1u32 << 30) - 1.0)
    };
    let (mut x, mut y, mut u) = (Vec::new(), Vec::new(), Vec::new());
    let mut state: Vec<f64> = (0..n).map(|i| 1.0 + 0.5 * i as f64).collect();
    for _ in 0..T + 40 {
        let input: Vec<f64> = (0..m).map(|_| noisy(1.0)).collect();
        x.extend(state.iter().map(|s| scale * (s + noisy(0.1 * noise)) + offset));
        for j in 0..p {
            let sum = state[j % n] + 0.4 * state[(j + 1) % n];
            y.push(sum + 0.2 * input.first().unwrap_or(&0.0) + noisy(noise));
        }
        let (s, c) = angle.sin_cos();
        let next = |i: usize| radius * (c * state[i] - s * state[(i + 1) % n]);
        let pushed = input.first().map_or(0.05, |u| 0.3 * u);
        state = (0..n).map(|i| next(i) + pushed).collect();
        u.extend(input);
    }
    x.truncate((T + 1) * n);
    let (later_y, later_u) = (y.split_off(T * p), u.split_off(T * m));
    ([x, y, u], [later_y, later_u])
}

fn samples(
    source: &mut Source<'_>,
    [n, p, m]: [usize; 3],
    online: Option<[Vec<f64>; 2]>,
) -> Vec<Sample> {
    let boxed = source.once_in(3);
    let count = 1 + source.below(40);
    let mut sample = |k: usize| {
        let (mut y, mut u) = match &online {
            Some([y, u]) => (y[k * p..(k + 1) * p].to_vec(), u[k * m..(k + 1) * m].to_vec()),
            None => (source.numbers(p, true), source.numbers(m, true)),
        };
        match source.byte() % 32 {
            25 => y[source.below(p)] = f64::NAN,
            26 => y.fill(f64::NAN),
            27 => y[source.below(p)] = source.number(),
            28 => y = source.numbers(p, true),
            29 => y.push(0.0),
            30 => u = source.numbers(m, true),
            31 => u.push(source.number()),
            _ => {}
        }
        let x_bounds = if boxed && source.once_in(4) { Some(bounds(source, n)) } else { None };
        Sample { y, u, x_bounds }
    };
    (0..count).map(&mut sample).collect()
}

/// Boxes that hold something in most cases.
fn bounds(source: &mut Source<'_>, width: usize) -> Bounds {
    let size = [1.0, 0.1, 10.0, 1e-3, 1e6][source.below(5)];
    let mut bounds = Bounds { lo: vec![-size; width], hi: vec![size; width] };
    match source.byte() % 8 {
        4 => bounds.lo.fill(f64::NEG_INFINITY),
        5 => bounds.hi.fill(f64::INFINITY),
        6 => bounds.lo[source.below(width)] = source.number(),
        7 => bounds.hi = source.numbers(width, true),
        _ => {}
    }
    bounds
}

fn config(source: &mut Source<'_>, [n, p, m]: [usize; 3]) -> Config {
    let certificate = source.maybe(8, |source| certificate(source, n, p));
    let scalars = certificate.is_none() || source.once_in(8);
    Config {
        horizon: source.maybe(2, |source| source.below(14)),
        rho: source.maybe(3, Source::number).filter(|_| scalars),
        mu: source.maybe(3, Source::number).filter(|_| scalars),
        weights: *pick(
            source,
            &[Weighting::Auto, Weighting::Recorded, Weighting::Scaled, Weighting::Paper],
        ),
        x_prior: source.maybe(4, |source| source.numbers(n, true)),
        x_bounds: source.maybe(3, |source| bounds(source, n)),
        x_center: *pick(source, &[Center::Absolute, Center::Absolute, Center::History]),
        v_bounds: source.maybe(4, |source| bounds(source, p)),
        process_noise: process_noise(source, n),
        w_bounds: source.maybe(6, |source| bounds(source, n)),
        soft: source.maybe(4, soft),
        equilibrium: source.maybe(8, |source| {
            let [x, y, u] = [n, p, m].map(|width| source.numbers(width, true));
            Equilibrium { x, y, u }
        }),
        start: *pick(source, &[Start::State, Start::Recording, Start::Unknown, Start::Auto]),
        space: space(source),
        disturbance: certificate.as_ref().and(source.maybe(2, |source| {
            let [initial, w, v] = [0; 3].map(|_| source.number().abs());
            Disturbance { initial, w, v }
        })),
        certificate,
        output_noise: source.maybe(6, |source| {
            let count = if source.once_in(2) { 1 } else { p };
            (0..count).map(|_| source.number().abs()).collect()
        }),
        drift: source.maybe(8, |source| source.numbers(n * n, true)),
        evidence: !source.once_in(4),
        gate: match source.below(4) {
            0 => Gate::Auto,
            1 => Gate::At(source.number().abs()),
            _ => Gate::None,
        },
        stuck: *pick(source, &[Stuck::Tell, Stuck::Missing]),
    }
}

fn pick<'a, T>(source: &mut Source<'_>, from: &'a [T]) -> &'a T {
    &from[source.below(from.len())]
}

fn soft(source: &mut Source<'_>) -> Soft {
    match source.below(3) {
        0 => Soft::all(source.number().abs()),
        1 => Soft { x: Some(source.number()), ..Soft::default() },
        _ => Soft { v: Some(1.0), w: Some(source.number()), ..Soft::default() },
    }
}

fn space(source: &mut Source<'_>) -> Space {
    match source.below(6) {
        0 | 1 => Space::Auto,
        2 => Space::Exact,
        3 => Space::Truncated { rank: source.maybe(2, |source| source.below(6)), tol: None },
        4 => Space::Truncated { rank: None, tol: Some(source.number()) },
        _ => Space::Ridge { weight: source.number(), normalised: source.once_in(2) },
    }
}

fn process_noise(source: &mut Source<'_>, n: usize) -> ProcessNoise {
    match source.below(8) {
        0..=3 => ProcessNoise::Auto,
        4 => ProcessNoise::None,
        5 => ProcessNoise::Recorded,
        6 => ProcessNoise::Residual,
        _ => ProcessNoise::Given(diagonal(source, n)),
    }
}

/// A diagonal matrix, now and then with another entry off its diagonal.
fn diagonal(source: &mut Source<'_>, size: usize) -> Vec<f64> {
    let first = source.number().abs();
    let entry = |k: usize| if k.is_multiple_of(size + 1) { first } else { 0.0 };
    let mut matrix: Vec<f64> = (0..size * size).map(entry).collect();
    if source.once_in(4) {
        let at = source.below(size * size);
        matrix[at] = source.number();
    }
    matrix
}

fn certificate(source: &mut Source<'_>, n: usize, p: usize) -> Certificate {
    let unit = |size: usize| {
        let entry = |k: usize| f64::from(u8::from(k.is_multiple_of(size + 1)));
        (0..size * size).map(entry).collect::<Vec<f64>>()
    };
    let own = source.once_in(3);
    let mut matrix = |size: usize| if own { diagonal(source, size) } else { unit(size) };
    let [P, Q, R] = [n, n, p].map(&mut matrix);
    let eta = [0.5, 0.3, 0.9][source.below(3)];
    Certificate { P, Q, R, eta, growth: source.maybe(2, Source::number), model: None }
}
