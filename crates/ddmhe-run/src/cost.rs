//! The cost (17) of a window, in the user's units.

use crate::panels::{Root, dot, weighted_square};
use crate::problem::{Data, Scratch, WindowProblem};
use crate::reweight::reduced;

impl WindowProblem<'_> {
    /// (17): the distance of x̂(t-m) from the prior and the fitted noise v, weighted; with the
    /// fitted disturbance, where there is one.
    #[inline(always)]
    pub(crate) fn cost(&self, data: &Data<'_>, s: &mut Scratch<'_>, v: &[f64]) -> f64 {
        let mut prior = self.depth.prior_weight * self.prior_size(data.prior, s);
        if let Some(lacking) = data.lacking {
            let n = data.prior.len();
            let moved = &s.spare.parts().moved[..n];
            let along = |(row, moved_i): (&[f64], &f64)| moved_i * dot(row, moved);
            prior -= lacking.chunks_exact(n).zip(moved).map(along).sum::<f64>();
        }
        if self.depth.layout.driven {
            prior += self.shared.price * self.disturbance_size(self.disturbances(s.window));
        }
        prior
            + match self.shared.noise(self.depth.layout) {
                Some(weights) if data.missing => {
                    let known = &mut s.spare.parts().outputs[..v.len()];
                    known
                        .iter_mut()
                        .zip(v)
                        .for_each(|(known, v)| *known = if v.is_nan() { 0.0 } else { *v });
                    weighted_square(weights, known)
                }
                Some(weights) => weighted_square(weights, v),
                None => self.shared.unit * self.noise_cost(v, s.spare.parts().block),
            }
    }

    /// ‖x̂(t-m) - x̄‖²_P in scaled units. Unless P is diagonal the distance is in the scratch then.
    #[inline(always)]
    pub(crate) fn prior_size(&self, prior: &[f64], s: &mut Scratch<'_>) -> f64 {
        let (U, n) = (self.prior, prior.len());
        let (first, per_s_x) = (&s.window[..n], &self.shared.per_s_x[..n]);
        let moved = first.iter().zip(per_s_x).zip(prior).map(|((x, per), prior)| x * per - prior);
        let mut sum = 0.0;
        if self.depth.kind.plain_prior {
            for (u, moved) in U[..n].iter().zip(moved) {
                sum += (u * moved) * (u * moved);
            }
            return sum;
        }
        let room = &mut s.spare.parts().moved[..n];
        room.iter_mut().zip(moved).for_each(|(room, moved)| *room = moved);
        for row in U.chunks_exact(n) {
            let along: f64 = row.iter().zip(&*room).map(|(u, moved)| u * moved).sum();
            sum += along * along;
        }
        let size = sum.root();
        size * size
    }

    /// Σ_k ‖w(k)‖² in their own deviations, ‖·‖²_{Q⁻¹}.
    fn disturbance_size(&self, w: &[f64]) -> f64 {
        let n = self.depth.layout.n;
        let rows = || self.shared.whitening.chunks_exact(n);
        let along = |row: &[f64], w: &[f64]| row.iter().zip(w).map(|(a, w)| a * w).sum::<f64>();
        let square = |w: &[f64]| rows().map(|row| along(row, w)).map(|d| d * d).sum::<f64>();
        w.chunks_exact(n).map(square).sum()
    }

    /// The second term of (17) in scaled units for a certificate's R, of the fitted noise v in the
    /// user's units (m·p, time-major, NaN where not measured); `block` is room for p × p numbers.
    fn noise_cost(&self, v: &[f64], block: &mut [f64]) -> f64 {
        let (p, s_y) = (self.depth.layout.p, self.shared.s_y);
        v.chunks_exact(p).fold(0.0, |sum, v| {
            reduced(self.shared.R, p, |i| v[i].is_finite(), &mut block[..p * p]);
            let known = |i: usize| if v[i].is_finite() { v[i] / s_y[i] } else { 0.0 };
            let row = |i: usize| (0..p).map(|j| block[i * p + j] * known(j)).sum::<f64>();
            self.shared.rho * sum + (0..p).map(|i| known(i) * row(i)).sum::<f64>()
        })
    }
}
