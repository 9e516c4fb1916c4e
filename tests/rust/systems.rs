//! Affine systems x⁺ = A x + e, y = C x + r to record and to estimate.

use ddmhe_core::{Certificate, History};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rotation and decay with offsets: n = 2·blocks states, one output per block and one sum of all
/// states.
pub struct System {
    pub blocks: Vec<(f64, f64)>, // radius, angle
    pub offset: f64,
}

impl System {
    pub fn n(&self) -> usize {
        2 * self.blocks.len()
    }

    pub fn p(&self) -> usize {
        self.blocks.len() + 1
    }

    fn next(&self, x: &[f64]) -> Vec<f64> {
        let rotate = |(i, &(radius, angle)): (usize, &(f64, f64))| {
            let (s, c) = angle.sin_cos();
            let (a, b) = (x[2 * i], x[2 * i + 1]);
            [radius * (c * a - s * b) + self.offset, radius * (s * a + c * b)]
        };
        self.blocks.iter().enumerate().flat_map(rotate).collect()
    }

    fn output(&self, x: &[f64]) -> Vec<f64> {
        let own = (0..self.blocks.len()).map(|i| x[2 * i] + 0.3);
        own.chain([x.iter().sum::<f64>() - self.offset]).collect()
    }

    /// x (T+1)·n and y T·p, time-major.
    pub fn simulate(&self, start: &[f64], T: usize) -> (Vec<f64>, Vec<f64>) {
        let (mut x, mut y, mut state) = (start.to_vec(), Vec::new(), start.to_vec());
        for _ in 0..T {
            y.extend(self.output(&state));
            state = self.next(&state);
            x.extend(&state);
        }
        (x, y)
    }

    /// The same moved by two inputs (T·2): the first pushes the first state and is seen in the
    /// first output, the second pushes all states.
    pub fn driven(&self, start: &[f64], u: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (mut x, mut y, mut state) = (start.to_vec(), Vec::new(), start.to_vec());
        for u in u.chunks_exact(2) {
            let mut output = self.output(&state);
            output[0] += 0.5 * u[0];
            y.extend(output);
            state = self.next(&state);
            state[0] += 0.2 * u[0];
            state.iter_mut().for_each(|x| *x += 0.1 * u[1]);
            x.extend(&state);
        }
        (x, y)
    }

    pub fn record(&self, start: &[f64], T: usize) -> History {
        let (x, y) = self.simulate(start, T);
        History::new(self.n(), self.p(), &x, &y, 0.1).unwrap()
    }
}

/// A system of `blocks` well separated modes.
pub fn modes(blocks: usize) -> System {
    System {
        blocks: (0..blocks).map(|i| (1.0 - 0.01 * i as f64, 0.4 + 0.7 * i as f64)).collect(),
        offset: 0.2,
    }
}

/// P = Q = I (n × n) and R = I (p × p), errors growing by 1.2 a sample without outputs.
pub fn unit_certificate(n: usize, p: usize, eta: f64) -> Certificate {
    let identity =
        |size: usize| (0..size * size).map(|k| f64::from(u8::from(k % (size + 1) == 0))).collect();
    let (P, Q, R) = (identity(n), identity(n), identity(p));
    Certificate { P, Q, R, eta, growth: Some(1.2), model: None }
}

pub fn noise(seed: u64, len: usize, size: f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-size..size)).collect()
}
