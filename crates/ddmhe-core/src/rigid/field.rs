//! A body in a field that is known: where its fits begin.

use crate::rigid::family::Fitted;
use crate::rigid::recording::{GAMMA, INERTIAS, OFFSETS, Recording, drawn};
use ddmhe_run::rigid::field::{DRAG_CUBIC, GAIN, MAGNETIC, OFFSET};
use ddmhe_run::rigid::layout::INERTIA;
use ddmhe_run::rigid::motion::Given;
use ddmhe_run::rigid::small::{cross, dot};
use ddmhe_run::rigid::{Field, FieldBody, Firsts, Start};
use faer::Mat;

/// Prior standard deviations: of M's entries, in units of W over the mean square of B; of log κ.
const SPREAD: [f64; 2] = [0.3, 2.0];
/// Size of M where the fit begins, relative to its prior: it fixes κ.
const BEGINS: f64 = 0.1;
/// Directions of M that the outputs show less of than that, relative to what they show most of,
/// begin at 0.
const SHOWN: f64 = 1e-6;

impl<const P: usize, const N: usize> Fitted<P, N> for FieldBody<P, N> {
    const OF_OUTPUT: usize = 1;
    const SIMULATED: bool = false;
    // the sphere's inertia, and two that are drawn
    const STARTS: [&'static [usize]; 2] = [&[0, 2, 4], &[0]];
    #[cfg(feature = "serde")]
    const NUMBERS: usize = 3 + 3 * P;

    type Lagging = Self;

    fn start(
        recording: &Recording<P>,
        known: &[Field<P>],
        trial: usize,
        cubic: bool,
    ) -> Start<Self, N> {
        let W = recording.W;
        let squares: f64 = known.iter().map(|known| dot(&known.B, &known.B)).sum();
        let m = SPREAD[0] * W * known.len() as f64 / squares; // drag in units of W
        let shown = shown(recording, known);
        let scale = shown.iter().map(|v| v * v).sum::<f64>().sqrt() / (BEGINS * m);
        let mut spread = [1.0; N];
        (spread[DRAG_CUBIC], spread[OFFSET + P]) = (GAMMA, GAMMA);
        spread[INERTIA..MAGNETIC].fill(INERTIAS);
        spread[MAGNETIC..MAGNETIC + 6].fill(m);
        spread[GAIN] = SPREAD[1];
        spread[OFFSET..OFFSET + recording.p].fill(OFFSETS * recording.size);
        let mut z = [0.0; N];
        z[..3].copy_from_slice(&recording.x[0]);
        z[INERTIA..MAGNETIC].copy_from_slice(&drawn(trial));
        z[MAGNETIC..].iter_mut().zip(shown).for_each(|(z, shown)| *z = shown / scale);
        let given = Given { W, steps: recording.steps(), cubic, spread };
        let motion = FieldBody { scale, given };
        Start { motion, z, firsts: Firsts::NONE }
    }

    fn known(B: &[f64], K: &[f64]) -> Field<P> {
        let mut known = Field { B: [0.0; 3], K: [[0.0; 3]; P] };
        known.B.copy_from_slice(B);
        known.K.as_flattened_mut()[..K.len()].copy_from_slice(K);
        known
    }

    #[cfg(feature = "serde")]
    fn numbers(known: &Field<P>) -> Vec<f64> {
        [&known.B[..], known.K.as_flattened()].concat()
    }
}

/// κ M by least squares: y = -K (κ M) (B × x).
fn shown<const P: usize>(recording: &Recording<P>, known: &[Field<P>]) -> [f64; 6] {
    let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let (p, count) = (recording.p, recording.y.len() * recording.p);
    let rows = Mat::from_fn(count, 6, |row, entry| {
        let (k, (a, b)) = (row / p, pairs[entry]);
        let (u, K) = (cross(&known[k].B, &recording.x[k]), known[k].K[row % p]);
        -(K[a] * u[b] + if a == b { 0.0 } else { K[b] * u[a] })
    });
    let y = |row: usize| recording.y[row / p][row % p];
    let Ok(svd) = rows.thin_svd() else { return [1.0; 6] };
    let sigma = svd.S().column_vector();
    let along = |k: usize| (0..count).map(|row| svd.U()[(row, k)] * y(row)).sum::<f64>() / sigma[k];
    let kept = (0..6).filter(|&k| sigma[k] > SHOWN * sigma[0]);
    let kept: Vec<_> = kept.map(|k| (k, along(k))).collect();
    [0, 1, 2, 3, 4, 5].map(|i| kept.iter().map(|(k, along)| svd.V()[(i, *k)] * along).sum())
}
