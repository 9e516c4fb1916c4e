//! The zonotope ⟨x̂, M⟩ of the state: x̂ by (19), the generators M of the error by (45)-(50), or
//! with Ã + \[J\] as one interval matrix.

use crate::error::Error;
use crate::interval::{Interval, points, weighted};
use crate::observer::dynamics::Dynamics;
use crate::observer::options::{Method, Options};
use crate::observer::plant::{Output, Plant};
use crate::observer::system::System;
use crate::reduce::{Reduction, reduce};
use crate::rounding::{diagonal, inflation, row_sums};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// ⟨x̂, M⟩, M by columns.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(super) struct ErrorSet {
    pub center: Vec<f64>,
    pub generators: Vec<f64>,
}

impl ErrorSet {
    /// |M| 1, upward.
    pub(super) fn half_widths(&self) -> Vec<f64> {
        row_sums(self.center.len(), &self.generators)
    }

    /// x̂ ± |M| 1.
    pub(super) fn hull(&self) -> Vec<Interval> {
        let ends = self.center.iter().zip(self.half_widths());
        ends.map(|(&c, r)| Interval::about(c, r)).collect()
    }
}

/// The set one sample on, and what the other sets need of the way there.
pub(super) struct Propagated {
    pub set: ErrorSet,
    pub free: Vec<Interval>, // A x̂ + B u + f(x̂) (n)
    pub rest: Vec<f64>,      // half widths of what e⁺ has besides (Ã + J) e + D1 w - L D2 v (n)
}

/// What the recursion has computed once.
pub(super) struct ErrorZonotope {
    options: Options,
    L: Vec<f64>,
    error_map: Vec<Interval>, // Ã (n·n)
    noise: Vec<f64>,          // columns of [D1 Mw, L D2 Mv]
    noise_w: usize,           // of which the first are those of w
    noise_error: Vec<f64>,    // what their rounding lost (n)
}

impl ErrorZonotope {
    /// Of a checked system in n states and L (n·p).
    pub(super) fn new(system: &System, L: Vec<f64>, n: usize, options: Options) -> Self {
        let p = system.C.len() / n;
        let (noise_w, nv) = (system.w_radius.len(), system.v_radius.len());
        // MIN_POSITIVE: what products may lose where they fall below the normal numbers
        let (mut noise, mut noise_error) = (Vec::new(), vec![f64::MIN_POSITIVE; n]);
        for k in 0..noise_w + nv {
            for (i, error) in noise_error.iter_mut().enumerate() {
                let exact = match k.checked_sub(noise_w) {
                    None => {
                        Interval::point(system.D1[i * noise_w + k])
                            * Interval::point(system.w_radius[k])
                    }
                    Some(k) => {
                        let column: Vec<Interval> =
                            (0..p).map(|j| Interval::point(system.D2[j * nv + k])).collect();
                        weighted(&L[i * p..(i + 1) * p], &column)
                            * Interval::point(system.v_radius[k])
                    }
                };
                noise.push(exact.mid());
                *error += exact.rad();
            }
        }
        noise_error.iter_mut().for_each(|e| *e *= inflation(noise_w + nv));
        let error_map = error_map(system, &L, |_| true, p);
        ErrorZonotope { options, L, error_map, noise, noise_w, noise_error }
    }

    /// The set one sample on. J: \[Df\] over the segment from x̂ to x; `input`: B u.
    pub(super) fn next<D: Dynamics>(
        &self,
        plant: &Plant<D>,
        set: &ErrorSet,
        J: &[Interval],
        output: &Output<'_>,
        input: &[Interval],
    ) -> Result<Propagated, Error> {
        let (n, p, system) = (plant.n, plant.p, &plant.system);
        let value = plant.value(&set.center)?;
        let estimate = points(&set.center);
        let innovation = |j: usize| {
            if !output.has(j) {
                return Interval::ZERO;
            }
            Interval::point(output.y[j])
                - Interval::point(system.r[j])
                - weighted(&system.C[j * n..(j + 1) * n], &estimate)
        };
        let innovation: Vec<Interval> = (0..p).map(innovation).collect();
        let (mut center, mut free) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut rest = self.noise_error.clone();
        for i in 0..n {
            let L = &self.L[i * p..(i + 1) * p];
            free.push(weighted(&system.A[i * n..(i + 1) * n], &estimate) + input[i] + value[i]);
            // x̂(k+1), (19): a float, and what it rounded away
            let next = free[i] + weighted(L, &innovation);
            center.push(next.mid());
            rest[i] = (rest[i] + next.rad()) * inflation(1);
            // what C and r are uncertain by enters through L
            for j in (0..p).filter(|&j| output.has(j)) {
                rest[i] = (rest[i] + L[j].abs() * output.error[j]) * inflation(1);
            }
        }
        let generators = self.generators(plant, set, J, output, &rest);
        Ok(Propagated { set: ErrorSet { center, generators }, free, rest })
    }

    /// M⁺, reduced.
    fn generators<D: Dynamics>(
        &self,
        plant: &Plant<D>,
        set: &ErrorSet,
        J: &[Interval],
        output: &Output<'_>,
        rest: &[f64],
    ) -> Vec<f64> {
        let (n, p) = (plant.n, plant.p);
        let complete = output.is_complete();
        let error_map = match complete {
            true => Cow::from(&self.error_map),
            false => Cow::from(error_map(&plant.system, &self.L, |j| output.has(j), p)),
        };
        let M = &set.generators;
        let mut columns = Vec::with_capacity(2 * M.len() + self.noise.len() + n * n);
        let (mut D_s, sums) = (rest.to_vec(), row_sums(n, M));
        match self.options.method {
            Method::Paper => {
                multiply(&error_map, M, &sums, &mut columns, &mut D_s);
                multiply(J, M, &sums, &mut columns, &mut D_s);
            }
            Method::Tight => {
                let closed: Vec<Interval> = error_map.iter().zip(J).map(|(a, j)| *a + *j).collect();
                multiply(&closed, M, &sums, &mut columns, &mut D_s);
            }
        }
        columns.extend_from_slice(&self.noise[..self.noise_w * n]);
        if complete {
            columns.extend_from_slice(&self.noise[self.noise_w * n..]);
        } else {
            // L D2 Mv with the rows of D2 that were measured, boxed
            for (half, L) in D_s.iter_mut().zip(self.L.chunks_exact(p)) {
                let noise = |j: usize| L[j].abs() * plant.output_noise[j].mag();
                let sum: f64 = (0..p).filter(|&j| output.has(j)).map(noise).sum();
                *half = (*half + sum * inflation(p)) * inflation(1);
            }
        }
        columns.extend(diagonal(&D_s));
        let reduction = match self.options.method {
            Method::Paper => Reduction::Paper,
            Method::Tight => self.options.reduction,
        };
        reduce(n, &mut columns, self.options.order, reduction);
        columns
    }
}

/// \[A\] M with columns mid A · M and, added to the half widths D_s, the radius of A times |M| 1
/// and the rounding of the products; `sums` are |M| 1.
fn multiply(A: &[Interval], M: &[f64], sums: &[f64], columns: &mut Vec<f64>, D_s: &mut [f64]) {
    let n = sums.len();
    let mid: Vec<f64> = A.iter().map(|a| a.mid()).collect();
    for g in M.chunks_exact(n) {
        for i in 0..n {
            columns.push((0..n).map(|j| mid[i * n + j] * g[j]).sum());
        }
    }
    for (i, half) in D_s.iter_mut().enumerate() {
        let spread = |j: usize| {
            let a = A[i * n + j];
            (a.rad() + (n as f64 + 2.0) * f64::EPSILON * a.mid().abs()) * sums[j]
        };
        *half = (*half + (0..n).map(spread).sum::<f64>()) * inflation(n);
    }
}

/// Ã = A - L C (n·n), L without the columns of outputs that were not measured.
fn error_map(
    system: &System,
    L: &[f64],
    measured: impl Fn(usize) -> bool,
    p: usize,
) -> Vec<Interval> {
    let n = system.C.len() / p;
    let entry = |(k, &a): (usize, &f64)| {
        let used = (0..p).filter(|&j| measured(j)).fold(Interval::ZERO, |sum, j| {
            sum + Interval::point(L[k / n * p + j]) * Interval::point(system.C[j * n + k % n])
        });
        Interval::point(a) - used
    };
    system.A.iter().enumerate().map(entry).collect()
}
