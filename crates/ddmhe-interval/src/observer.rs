//! Interval observer: a box that is guaranteed to hold the state of
//!
//! > x(k+1) = A x + B u + f(x) + D1 w,  y = C x + r + D2 v,  |w| ≤ w̄, |v| ≤ v̄, |x(0) - p₀| ≤ x̄₀
//! > (13), (17)
//!
//! with Df(x) in \[J̲, J̄\] (14). Equation numbers are those of the interval paper (see the
//! [crate]).
//!
//! # How
//! With x̂⁺ = A x̂ + B u + f(x̂) + L(y - r - C x̂) (19) the error obeys e⁺ = (Ã + J) e + D1 w - L
//! D2 v, Ã = A - L C, J in the interval Jacobian over the segment from x̂ to x. Three sets of e are
//! carried **in parallel**; only outputs are intersected:
//!
//! * the zonotope ⟨0, M⟩: `Paper` has M⁺ = ↓q\[ÃM, T, D1 Mw, L D2 Mv\] with T = \[D^c, D^s\] the
//!   inclusion of \[J\]M (45)-(50); `Tight` treats Ã + \[J\] as one interval matrix, which keeps
//!   the columns of ÃM and J^c M together;
//! * the level V̄ of V = eᵀPe: V⁺ ≤ (1-λ)V + γ(‖w‖² + ‖v‖²) (41) gives the ball (44) and the
//!   ellipsoid's box
//!   |e_i| ≤ √(V̄ (P⁻¹)_ii), which is never looser than the ball of its V̄;
//! * `Tight` only: a box of x itself, contracted with the measurement, backward through the last
//!   transitions, and forward.
//!
//! # What "guaranteed" rests on
//! Everything above is computed with outward rounding: x̂ is a float, and what its own update
//! rounds away joins the zonotope as a box and V̄ as a distance. What f is not known exactly for
//! ([`Dynamics::value`] returns intervals, [`Dynamics::output_error`]) enters the same way, so
//! uncertain parameters need nothing else.

mod cut;
mod dynamics;
mod error_zonotope;
mod estimate;
mod level;
mod mean_value;
mod options;
mod plant;
mod present;
mod sample;
mod shipped;
mod state_box;
mod system;

pub use dynamics::Dynamics;
pub use estimate::IntervalEstimate;
pub use options::{Method, Options};
pub use shipped::{Euler, Linear, Pendulum, Uncertain};
pub use system::{Gain, System};

#[cfg(feature = "serde")]
use crate::blob::{Kind, from_bytes, to_bytes};
use crate::check::check_vector;
use crate::error::Error;
use crate::interval::Interval;
use crate::rounding::diagonal;
use crate::tol;
use cut::Cut;
use error_zonotope::{ErrorSet, ErrorZonotope, Propagated};
use level::Level;
use plant::{Plant, Transition};
use present::Present;
use sample::Sample;
use state_box::StateBox;
use system::checked;

/// A zonotope, an ellipsoid and a box around the state of a bounded-Jacobian system, one step at a
/// time.
pub struct IntervalObserver<D> {
    plant: Plant<D>,
    zonotope: ErrorZonotope,
    level: Level,
    method: Method,
    start: (Vec<f64>, Vec<f64>), // p₀ and x̄₀ (n)
    present: Present,
}

impl<D: Dynamics> IntervalObserver<D> {
    /// An observer that starts with |x(0) - x0_center| ≤ x0_radius.
    ///
    /// # Errors
    /// Shape, NaN, negative radii, J̲ above J̄, λ or γ out of range, P not positive definite, q
    /// below n.
    ///
    /// # Example
    /// ```
    /// use ddmhe_interval::observer::{Dynamics, Gain, IntervalObserver, Options, System};
    /// use ddmhe_interval::{Error, Interval};
    ///
    /// /// x⁺ = x/2 + 0.3 exp(-x²) + w,  y = 2 x + v
    /// struct Bell;
    ///
    /// impl Dynamics for Bell {
    ///     fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
    ///         out[0] = 0.3 * (-Interval::point(x[0]).sqr()).exp();
    ///         Ok(())
    ///     }
    ///
    ///     fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
    ///         out[0] = -0.6 * x[0] * (-x[0].sqr()).exp();
    ///         Ok(())
    ///     }
    /// }
    ///
    /// let system = System {
    ///     A: vec![0.5],
    ///     C: vec![2.0],
    ///     D1: vec![1.0],
    ///     D2: vec![1.0],
    ///     j_lo: vec![-0.26], // the largest slope of 0.3 exp(-x²)
    ///     j_hi: vec![0.26],
    ///     w_radius: vec![0.01],
    ///     v_radius: vec![0.05],
    ///     ..System::default()
    /// };
    /// let unknown = f64::INFINITY; // no peak-to-peak bound was computed: the zonotope alone
    /// let gain = Gain {
    ///     L: vec![0.2],
    ///     P: vec![1.0],
    ///     lambda: 0.5,
    ///     gamma: unknown,
    ///     mu_w: unknown,
    ///     mu_v: unknown,
    ///     ..Gain::default()
    /// };
    /// let mut observer =
    ///     IntervalObserver::new(Bell, system, gain, &[0.0], &[2.0], Options::default())?;
    /// let mut x = 1.9_f64;
    /// for _ in 0..50 {
    ///     let y = [2.0 * x + 0.03]; // a noise within its bound
    ///     let estimate = observer.step(&y, &[])?;
    ///     assert!(estimate.filtered[0].contains(x));
    ///     x = 0.5 * x + 0.3 * (-x * x).exp();
    ///     assert!(estimate.predicted[0].contains(x));
    /// }
    /// assert!(observer.estimate().predicted[0].width() < 0.15);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(
        dynamics: D,
        system: System,
        gain: Gain,
        x0_center: &[f64],
        x0_radius: &[f64],
        options: Options,
    ) -> Result<Self, Error> {
        let n = x0_center.len();
        if n == 0 {
            return Err(Error::shape("x0_center", "at least one number", "none"));
        }
        let (system, mut gain) = checked(system, gain, x0_center, x0_radius)?;
        if options.order < n {
            let expected = format!("at least the number of states, {n}");
            return Err(Error::value("order", expected, options.order));
        }
        let L = std::mem::take(&mut gain.L);
        let level = Level::new(gain, &system, n, options.method)?;
        let start = (x0_center.to_vec(), x0_radius.to_vec());
        Ok(IntervalObserver {
            zonotope: ErrorZonotope::new(&system, L, n, options),
            plant: Plant::new(dynamics, system, n),
            method: options.method,
            present: at_start(&start, &level),
            level,
            start,
        })
    }

    /// Number of states.
    pub fn n(&self) -> usize {
        self.plant.n
    }

    /// Number of outputs.
    pub fn p(&self) -> usize {
        self.plant.p
    }

    /// Number of inputs u.
    pub fn inputs(&self) -> usize {
        self.plant.inputs
    }

    /// Samples consumed.
    pub fn steps(&self) -> usize {
        self.present.step
    }

    /// Back to the first sample.
    pub fn reset(&mut self) {
        self.present = at_start(&self.start, &self.level);
    }

    /// The newest result; before the first step only `predicted` is filled: the bounds of x(0).
    pub fn estimate(&self) -> &IntervalEstimate {
        &self.present.estimate
    }

    /// Where it stands, for [`resume`](Self::resume).
    #[cfg(feature = "serde")]
    pub fn present(&self) -> Vec<u8> {
        to_bytes(Kind::Observer, &self.present)
    }

    /// Continues from where an observer with the same arguments stood.
    ///
    /// # Errors
    /// As [`from_bytes`], and for the sets of another observer.
    #[cfg(feature = "serde")]
    pub fn resume(&mut self, blob: &[u8]) -> Result<(), Error> {
        let present: Present = from_bytes(Kind::Observer, blob)?;
        if !present.fits(self.n(), self.p()) {
            let expected = "the state of an observer with the same arguments";
            return Err(Error::value("blob", expected, "that of another"));
        }
        self.present = present;
        Ok(())
    }

    /// Consumes y(k) (p; NaN = not measured) and u(k): bounds of x(k) with it, and of x(k+1).
    ///
    /// # Errors
    /// Shape, infinite numbers, or [`Error::ModelViolation`] if y(k) contradicts the model and its
    /// bounds. After an error the observer is as before the call: the step can be made again, for
    /// instance with y(k) as not measured.
    pub fn step(&mut self, y: &[f64], u: &[f64]) -> Result<&IntervalEstimate, Error> {
        if y.len() != self.p() {
            return Err(Error::shape("y", format!("{} numbers", self.p()), y.len()));
        }
        if let Some(column) = y.iter().position(|v| v.is_infinite()) {
            let (row, value) = (self.steps(), y[column]);
            return Err(Error::NotFinite { argument: "y", row, column, value });
        }
        check_vector("u", u, self.inputs())?;
        self.present = self.next(y, u)?;
        Ok(&self.present.estimate)
    }

    /// All three sets one sample on.
    fn next(&self, y: &[f64], u: &[f64]) -> Result<Present, Error> {
        let (plant, method, now) = (&self.plant, self.method, &self.present);
        let sample = Sample(now.step);
        let output = plant.output(y, &now.state)?;
        // the box of x(k): its past, this output, and the zonotope that the outputs cut
        let mut past = now.past.clone();
        past.push(plant.transition(&now.state, &output, u));
        StateBox { plant, sample, method }.contract(&mut past)?;
        let last = past.len() - 1;
        let cut = match method {
            Method::Paper => None,
            Method::Tight => {
                let cut = Cut::new(plant, sample, &now.set, &past[last].output);
                cut.narrow(&mut past[last].x)?;
                Some(cut)
            }
        };
        let at = &past[last];
        let J = plant.jacobian(&self.segment(&at.x))?;
        let to = self.zonotope.next(plant, &now.set, &J, &output, &at.input)?;
        let ahead = cut.map(|cut| ahead(plant, sample, &cut, at, &J, &to.free)).transpose()?;
        let level = self.level.next(now.level, &to, output.is_complete());
        let [ball, ellipsoid] = self.level.boxes(level, &to.set.center);
        let predicted = predicted(sample, &to, ahead.as_deref(), &ball, &ellipsoid)?;

        let estimate = IntervalEstimate {
            predicted: predicted.clone(),
            filtered: at.x.clone(),
            ball,
            ellipsoid,
            center: to.set.center.clone(),
            generators: to.set.generators.clone(),
        };
        match method {
            Method::Paper => past.clear(), // only `Tight` looks back
            Method::Tight if past.len() > tol::TRANSITIONS => drop(past.remove(0)),
            Method::Tight => {}
        }
        Ok(Present { step: now.step + 1, set: to.set, level, state: predicted, past, estimate })
    }

    /// The segment from x̂ to x, over which the Jacobian is taken (14): x in the zonotope's hull,
    /// or in all that is known of x.
    fn segment(&self, x: &[Interval]) -> Vec<Interval> {
        let set = &self.present.set;
        let over = match self.method {
            Method::Paper => set.hull(),
            Method::Tight => x.to_vec(),
        };
        over.iter().zip(&set.center).map(|(x, &c)| x.hull(Interval::point(c))).collect()
    }
}

/// The three sets of x(0).
fn at_start((center, radius): &(Vec<f64>, Vec<f64>), level: &Level) -> Present {
    let state: Vec<Interval> =
        center.iter().zip(radius).map(|(&c, &r)| Interval::about(c, r)).collect();
    Present {
        step: 0,
        set: ErrorSet { center: center.clone(), generators: diagonal(radius) },
        level: level.start(radius),
        past: Vec::new(),
        estimate: IntervalEstimate { predicted: state.clone(), ..IntervalEstimate::default() },
        state,
    }
}

/// The box of x(k+1): the image of that of x(k), and x̂(k+1) with what the cut zonotope leads to.
fn ahead<D: Dynamics>(
    plant: &Plant<D>,
    sample: Sample,
    cut: &Cut<'_, D>,
    at: &Transition,
    J: &[Interval],
    free: &[Interval],
) -> Result<Vec<Interval>, Error> {
    let mut ahead = plant.linearised(at)?.image(&at.x);
    for (i, x) in ahead.iter_mut().enumerate() {
        *x = sample.meet(i, *x, free[i] + cut.row(i, J, &at.x)?)?;
    }
    Ok(ahead)
}

/// What all sets of x(k+1) have in common; `Paper`, which has no box ahead, as (59).
fn predicted(
    sample: Sample,
    to: &Propagated,
    ahead: Option<&[Interval]>,
    ball: &[Interval],
    ellipsoid: &[Interval],
) -> Result<Vec<Interval>, Error> {
    let meet = |(i, hull): (usize, Interval)| {
        let inner = match ahead {
            None => Some(ball[i]),
            Some(x) => x[i].intersect(ellipsoid[i]).and_then(|x| x.intersect(ball[i])),
        };
        inner.and_then(|x| x.intersect(hull)).ok_or_else(|| {
            let all = [hull, ball[i], ellipsoid[i]];
            sample.violation(i, all.into_iter().chain(ahead.map(|x| x[i])))
        })
    };
    to.set.hull().into_iter().enumerate().map(meet).collect()
}
