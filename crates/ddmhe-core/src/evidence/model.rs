//! What the recording leaves open of its model: the numbers of [`ddmhe_run::evidence::model`].

use crate::covariance::inverse_factor;
use crate::driving::Driving;
use crate::history::History;
use crate::linear_model::LinearModel;
use crate::scaling::Scaling;
use faer::Mat;

/// All in scaled units.
pub(crate) struct ModelNumbers {
    pub carry: Mat<f64>,  // F (n × n)
    pub error: Mat<f64>,  // G (n × n)
    pub whiten: Mat<f64>, // W (q × q)
    pub bias: Mat<f64>,   // (n × q)
    pub mean: Vec<f64>,   // (q)
    pub samples: [f64; 2],
}

impl ModelNumbers {
    /// Of a recording and its driven model; None without a stationary filter.
    pub fn new(history: &History, scaling: &Scaling, driving: &Driving) -> Option<Self> {
        let Driving { model: LinearModel { A, C, .. }, Q, R, N, .. } = driving;
        let (n, p) = (A.nrows(), C.nrows());
        let filter = driving.filter()?;
        let carry = filter.ahead.submatrix(0, 0, n, n).to_owned(); // A - L C
        let L = filter.gain(p);
        // [I, -L]
        let steps = Mat::from_fn(n, n + p, |i, j| match j.checked_sub(n) {
            None => f64::from(u8::from(i == j)),
            Some(j) => -L[(i, j)],
        });
        // what noise on the states leaves in a step: it enters twice
        let J = Mat::from_fn(n + p, n, |i, j| match i.checked_sub(n) {
            None => f64::from(u8::from(i == j)) - A[(i, j)],
            Some(i) => -C[(i, j)],
        });
        let readings = &J * N * J.transpose();
        let own = Mat::from_fn(n + p, n + p, |i, j| match (i.checked_sub(n), j.checked_sub(n)) {
            (None, None) => Q[(i, j)],
            (Some(i), Some(j)) if i == j => R[i],
            _ => 0.0,
        });
        let error = &steps * (own + readings) * steps.transpose();
        let (T, mean, moment) = moments(history, scaling);
        let q = mean.len();
        let whiten = inverse_factor(&moment)?;
        let inverse = whiten.transpose() * &whiten;
        let bias = -(&carry * N * inverse.subrows(0, n)) * faer::Scale(T);
        let unknowns = q as f64 + 1.0;
        let few = (T + unknowns) / (T - unknowns).max(1.0);
        Some(ModelNumbers { carry, error, whiten, bias, mean, samples: [1.0 / T.sqrt(), few] })
    }
}

/// Number of steps, mean of their regressors \[x; u\] and Σ of the squares of the deviations from
/// it.
fn moments(history: &History, scaling: &Scaling) -> (f64, Vec<f64>, Mat<f64>) {
    let (n, p, m) = (history.n(), history.p(), history.m());
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for i in 0..history.recordings() {
        let T = history.outputs(i).len() / p;
        let (x, u) = (history.states(i), history.inputs(i));
        for k in 0..T {
            let own = scaling.deviations(&x[k * n..(k + 1) * n], &[]);
            rows.push(own.chain(scaling.input_deviations(&u[k * m..(k + 1) * m])).collect());
        }
    }
    let (T, q) = (rows.len() as f64, n + m);
    let mean: Vec<f64> = (0..q).map(|i| rows.iter().map(|row| row[i]).sum::<f64>() / T).collect();
    let product = |i: usize, j: usize| {
        rows.iter().map(|row| (row[i] - mean[i]) * (row[j] - mean[j])).sum::<f64>()
    };
    let mut moment = Mat::from_fn(q, q, product);
    // an input that never moved has no error to make
    for i in 0..q {
        if moment[(i, i)] <= 0.0 {
            moment[(i, i)] = f64::MAX.sqrt();
        }
    }
    (T, mean, moment)
}
