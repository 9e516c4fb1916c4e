//! What all [plain](crate::plain) windows of one depth have in common, and one pass over the noise
//! of such a window.

use crate::panels::{Column, WIDTH, each, halve, nearer, smaller};
use crate::plan::common::{Limits, Shared};
use crate::plan::depth::Depth;

/// Each array as long as its block of the window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AtOnce<'a> {
    pub bounded: bool,
    pub means: &'a [f64],
    s_y: &'a [f64],
    weights: &'a [f64],
    pub v_limits: Option<Limits<'a>>,
}

impl<'a> AtOnce<'a> {
    /// None where windows need more: a disturbance, a filter, a box of each step's own, or weights
    /// that are not diagonal.
    pub fn new(shared: &Shared<'a>, depth: &Depth) -> Option<Self> {
        let (sizes, layout) = (&shared.sizes, depth.layout);
        let moving_box = depth.kind.centered || sizes.m > 0;
        let (x, v) = (shared.x_limits, shared.v_limits);
        if layout.driven || sizes.recorded || (x.is_some() && moving_box) {
            return None;
        }
        let len = layout.outputs_len();
        Some(AtOnce {
            bounded: x.is_some() || v.is_some(),
            means: shared.means(layout),
            s_y: shared.scales(layout),
            weights: shared.noise(layout)?,
            v_limits: v.map(|Limits { lo, hi }| Limits { lo: &lo[..len], hi: &hi[..len] }),
        })
    }
}

/// v = (y - ŷ) s_y; its smallest distances to its bounds, in eight groups, and Σ weight v²: all in
/// one pass over the window.
#[inline(always)]
pub(crate) fn noise<const BOUNDED: bool>(
    known: &AtOnce<'_>,
    outputs: &[f64],
    fitted: &[f64],
    Limits { lo, hi }: Limits<'_>,
    v: &mut [f64],
) -> (Column, f64) {
    let len = v.len();
    let (y, fitted) = (&outputs[..len], &fitted[..len]);
    let (s_y, weights) = (&known.s_y[..len], &known.weights[..len]);
    let (lo, hi) = if BOUNDED { (&lo[..len], &hi[..len]) } else { (y, y) };
    let (mut least, mut sums) = ([f64::INFINITY; WIDTH], [0.0; WIDTH]);
    let scaled = |y, fitted, s| each(each(y, fitted, |y, fitted| y - fitted), s, |d, s| d * s);
    let squares = |weight, v: Column| each(weight, each(v, v, |a, b| a * b), |w, v| w * v);
    let (y_8, fitted_8, s_8) = (y.as_chunks().0, fitted.as_chunks().0, s_y.as_chunks().0);
    let (weights_8, lo_8, hi_8) = (weights.as_chunks().0, lo.as_chunks().0, hi.as_chunks().0);
    let (v_8, rest) = v.as_chunks_mut::<WIDTH>();
    let data = v_8.iter_mut().zip(y_8).zip(fitted_8).zip(s_8);
    for ((((((v, y), fitted), s), weight), lo), hi) in data.zip(weights_8).zip(lo_8).zip(hi_8) {
        *v = scaled(*y, *fitted, *s);
        sums = each(sums, squares(*weight, *v), |sum, part| sum + part);
        if BOUNDED {
            least = nearer(least, *v, *lo, *hi);
        }
    }
    let rest = rest.len();
    if rest == 0 {
        return (least, halve(sums, |a, b| a + b));
    }
    if let (Some(y), Some(fitted), Some(s)) =
        (y.last_chunk(), fitted.last_chunk(), s_y.last_chunk())
        && let (Some(weight), Some(lo), Some(hi)) =
            (weights.last_chunk(), lo.last_chunk(), hi.last_chunk())
        && let Some(v) = v.last_chunk_mut()
    {
        *v = scaled(*y, *fitted, *s); // the last eight, some of them once more
        squares(*weight, *v)[WIDTH - rest..].iter().for_each(|part| sums[0] += part);
        if BOUNDED {
            least = nearer(least, *v, *lo, *hi);
        }
        return (least, halve(sums, |a, b| a + b));
    }
    for i in 0..len {
        v[i] = (y[i] - fitted[i]) * s_y[i];
        sums[0] += weights[i] * (v[i] * v[i]);
        if BOUNDED {
            least[i] = smaller(smaller(v[i] - lo[i], hi[i] - v[i]), least[i]);
        }
    }
    (least, halve(sums, |a, b| a + b))
}

#[cfg(test)]
mod tests {
    use super::{AtOnce, noise};
    use crate::panels::{margins, scaled_difference, weighted_square};
    use crate::plan::common::Limits;

    #[test]
    fn one_pass_over_the_noise_is_three_passes_to_the_last_bit() {
        let numbers = |seed: f64| core::array::from_fn::<f64, 30, _>(|i| (seed * i as f64).sin());
        let [y, fitted, s_y, weights] = [0.7, 1.9, 2.3, 3.1].map(numbers);
        let (lo, hi) = (numbers(0.1).map(|x| -2.0 - x), numbers(0.3).map(|x| 2.0 + x));
        for len in 1..30 {
            let limits = Limits { lo: &lo[..len], hi: &hi[..len] };
            let known = AtOnce {
                bounded: true,
                means: &[],
                s_y: &s_y[..len],
                weights: &weights[..len],
                v_limits: Some(limits),
            };
            let (mut v, mut expected) = ([0.0; 30], [0.0; 30]);
            let (v, expected) = (&mut v[..len], &mut expected[..len]);
            scaled_difference(&y[..len], &fitted[..len], &s_y[..len], expected);
            let square = weighted_square(&weights, expected);
            let nearest = |of: [f64; 8]| of.into_iter().fold(f64::INFINITY, f64::min);
            let (least, found) = noise::<true>(&known, &y, &fitted, limits, v);
            assert_eq!((&*v, found), (&*expected, square), "{len}");
            assert_eq!(nearest(least), nearest(margins(v, &lo, &hi)), "{len}");
            let (_, found) = noise::<false>(&known, &y, &fitted, limits, v);
            assert_eq!((&*v, found), (&*expected, square), "{len} without bounds");
        }
    }
}
