//! Recordings: validated stretches of (state, output) data of one system.

pub(crate) use crate::check::check_finite;
use crate::error::Error;
use crate::hankel::BlockHankel;
use crate::units::{shown, units, unknown};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// One uninterrupted recording x[0..=T], y[0..T), u[0..T), all time-major.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct Recording {
    pub x: Vec<f64>, // (T+1)·n
    pub y: Vec<f64>, // T·p
    pub u: Vec<f64>, // T·m
}

/// Validated recordings of one system: the data that stand in for its model.
///
/// States x (n channels) and outputs y (p channels) were taken together; each recording has one
/// more state than outputs, x[-T..0] and y[-T..-1] of Liu 2026, Section III. Known inputs u (m
/// channels, [`History::with_inputs`]) were applied at the instants of the outputs: u(k) acts on
/// x(k+1), and y(k) may depend on it. Several recordings may be joined with [`History::concat`]; no
/// window ever crosses a seam.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "Unchecked"))]
pub struct History {
    n: usize,
    p: usize,
    m: usize,
    dt: f64,
    recordings: Vec<Recording>,
    x_units: Vec<String>, // one a channel, "" where unknown
    y_units: Vec<String>,
    u_units: Vec<String>,
}

/// A [`History`] as it comes from elsewhere.
#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(rename = "History", deny_unknown_fields)]
struct Unchecked {
    n: usize,
    p: usize,
    m: usize,
    dt: f64,
    recordings: Vec<Recording>,
    x_units: Vec<String>,
    y_units: Vec<String>,
    u_units: Vec<String>,
}

#[cfg(feature = "serde")]
impl TryFrom<Unchecked> for History {
    type Error = Error;

    fn try_from(given: Unchecked) -> Result<Self, Error> {
        let Unchecked { n, p, m, dt, recordings, x_units, y_units, u_units } = given;
        let part = |r: &Recording| {
            let free = History::new(n, p, &r.x, &r.y, dt)?;
            if m > 0 { free.with_inputs(m, &r.u) } else { Ok(free) }
        };
        let parts: Vec<History> = recordings.iter().map(part).collect::<Result<_, Error>>()?;
        let joined = History::concat(&parts)?.with_units(&x_units, &y_units)?;
        if m > 0 { joined.with_input_units(&u_units) } else { Ok(joined) }
    }
}

impl History {
    /// A history of one recording.
    ///
    /// `x`: (T+1)·n numbers, time-major (sample k at `x[k*n..(k+1)*n]`), `y`: T·p numbers,
    /// `dt`: sampling interval in seconds (kept for reports; the method itself needs no time unit).
    ///
    /// # Errors
    /// [`Error::Shape`] when sizes do not fit, [`Error::NotFinite`], [`Error::Value`] when `dt` ≤
    /// 0.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?; // one state more than outputs
    /// assert_eq!((history.n(), history.p(), history.T()), (1, 1, 30));
    /// let short = History::new(1, 1, &x[..30], &y[..30], 0.1);
    /// assert!(matches!(short, Err(Error::Shape { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(n: usize, p: usize, x: &[f64], y: &[f64], dt: f64) -> Result<Self, Error> {
        if n == 0 {
            return Err(Error::shape("x", "at least one state channel", "none"));
        }
        if p == 0 {
            return Err(Error::shape("y", "at least one output channel", "none"));
        }
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Error::value("dt", "a positive number of seconds", dt));
        }
        if !x.len().is_multiple_of(n) {
            return Err(Error::shape("x", format!("a multiple of n = {n} numbers"), x.len()));
        }
        if !y.len().is_multiple_of(p) {
            return Err(Error::shape("y", format!("a multiple of p = {p} numbers"), y.len()));
        }
        let (rows_x, T) = (x.len() / n, y.len() / p);
        if T == 0 {
            return Err(Error::shape("y", "at least 1 sample", "0 samples"));
        }
        if rows_x != T + 1 {
            return Err(Error::shape(
                "x",
                format!("{} samples, one more than y's {T}", T + 1),
                format!("{rows_x} samples"),
            ));
        }
        check_finite("x", x, n)?;
        check_finite("y", y, p)?;
        let recordings = vec![Recording { x: x.to_vec(), y: y.to_vec(), u: Vec::new() }];
        let (x_units, y_units, u_units) = (unknown(n), unknown(p), Vec::new());
        Ok(History { n, p, m: 0, dt, recordings, x_units, y_units, u_units })
    }

    /// The same history with its m known inputs: T·m numbers, time-major, u(k) at the instant of
    /// y(k). Of several recordings, those of one after the other.
    ///
    /// # Errors
    /// [`Error::Shape`] for another number of them or none, [`Error::NotFinite`].
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// let u: Vec<f64> = (0..40).map(|k| f64::from(k * k % 7)).collect();
    /// let mut x = vec![0.0];
    /// for k in 0..40 {
    ///     x.push(0.9 * x[k] + u[k]);
    /// }
    /// let history = History::new(1, 1, &x, &x[..40], 0.1)?.with_inputs(1, &u)?;
    /// let mut estimator = DdMhe::new(&history, Config::default())?;
    /// let last = x[40]; // the log goes on with u = 1
    /// let estimate = estimator.step_with(Step { y: &[last], u: &[1.0], x_bounds: None })?;
    /// assert!((estimate.x[0] - (0.9 * last + 1.0)).abs() < 1e-6);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn with_inputs(mut self, m: usize, u: &[f64]) -> Result<Self, Error> {
        let T = self.T();
        if m == 0 {
            return Err(Error::shape("u", "at least one input channel", "none"));
        }
        if u.len() != T * m {
            let expected = format!("{T} samples of m = {m} inputs, as many as of y");
            let found = match u.len().is_multiple_of(m) {
                true => format!("{} samples", u.len() / m),
                false => format!("{} numbers", u.len()),
            };
            return Err(Error::shape("u", expected, found));
        }
        check_finite("u", u, m)?;
        let mut rest = u;
        for recording in &mut self.recordings {
            let (own, after) = rest.split_at(recording.y.len() / self.p * m);
            (recording.u, rest) = (own.to_vec(), after);
        }
        (self.m, self.u_units) = (m, unknown(m));
        Ok(self)
    }

    /// The same history with the units of its channels: channels of one unit share a scale. Each
    /// list holds one name a channel, or a single one for all; an empty name is an unknown unit,
    /// unlike every other.
    ///
    /// # Errors
    /// [`Error::Shape`] for a list of another length.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?.with_units(&["m"], &["N"])?;
    /// assert_eq!(history.x_units(), ["m"]);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn with_units<S: AsRef<str>>(
        mut self,
        x_units: &[S],
        y_units: &[S],
    ) -> Result<Self, Error> {
        self.x_units = units("x_units", x_units, self.n)?;
        self.y_units = units("y_units", y_units, self.p)?;
        Ok(self)
    }

    /// The same history with the units of its inputs, as in [`with_units`](Self::with_units).
    ///
    /// # Errors
    /// [`Error::Shape`] for a list of another length.
    pub fn with_input_units<S: AsRef<str>>(mut self, u_units: &[S]) -> Result<Self, Error> {
        self.u_units = units("u_units", u_units, self.m)?;
        Ok(self)
    }

    /// Units of the states, one a channel; "" where unknown.
    pub fn x_units(&self) -> &[String] {
        &self.x_units
    }

    /// Units of the outputs, one a channel; "" where unknown.
    pub fn y_units(&self) -> &[String] {
        &self.y_units
    }

    /// Units of the inputs, one a channel; "" where unknown.
    pub fn u_units(&self) -> &[String] {
        &self.u_units
    }

    /// Joins recordings of one system; windows never cross a seam.
    ///
    /// # Errors
    /// [`Error::Shape`] when the list is empty or channel counts differ, [`Error::Value`] when `dt`
    /// or a unit differs.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// let first = History::new(1, 1, &x[..21], &y[..20], 0.1)?;
    /// let second = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// assert_eq!(History::concat(&[first, second])?.recordings(), 2);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn concat(histories: &[History]) -> Result<Self, Error> {
        let first = histories
            .first()
            .ok_or_else(|| Error::shape("histories", "at least one History", "an empty list"))?;
        let mut joined = first.clone();
        for h in &histories[1..] {
            if (h.n, h.p, h.m) != (first.n, first.p, first.m) {
                return Err(Error::shape(
                    "histories",
                    format!("{} in every recording", first.sizes()),
                    h.sizes(),
                ));
            }
            for (name, mine, others) in [
                ("x_units", &first.x_units, &h.x_units),
                ("y_units", &first.y_units, &h.y_units),
                ("u_units", &first.u_units, &h.u_units),
            ] {
                if mine != others {
                    return Err(Error::value(
                        "histories",
                        format!("{name} = {} in every recording", shown(mine)),
                        shown(others),
                    ));
                }
            }
            if (h.dt - first.dt).abs() > 1e-9 * first.dt {
                return Err(Error::value(
                    "histories",
                    format!("dt = {} s in every recording", first.dt),
                    h.dt,
                ));
            }
            joined.recordings.extend_from_slice(&h.recordings);
        }
        Ok(joined)
    }

    /// The same with the inputs of the sample before, where each counts a sample `late`r, or of the
    /// sample after; None where a recording has no two samples.
    pub(crate) fn shifted_inputs(&self, late: bool) -> Option<Self> {
        let (n, p, m) = (self.n, self.p, self.m);
        let mut shifted = self.clone();
        for r in &mut shifted.recordings {
            let T = r.y.len() / p;
            (T > 1).then_some(())?;
            if late {
                (r.x, r.y) = (r.x[n..].to_vec(), r.y[p..].to_vec());
                r.u.truncate((T - 1) * m);
            } else {
                r.x.truncate(T * n);
                r.y.truncate((T - 1) * p);
                r.u = r.u[m..].to_vec();
            }
        }
        Some(shifted)
    }

    /// Channels, in words.
    fn sizes(&self) -> String {
        match self.m {
            0 => format!("n = {}, p = {}", self.n, self.p),
            m => format!("n = {}, p = {}, m = {m}", self.n, self.p),
        }
    }

    /// Some output samples of recording `i`, with the state behind the last of them.
    pub(crate) fn stretch(&self, i: usize, samples: std::ops::Range<usize>) -> Self {
        let (n, p, m) = (self.n, self.p, self.m);
        let Recording { x, y, u } = &self.recordings[i];
        let (from, to) = (samples.start, samples.end);
        let part = Recording {
            x: x[from * n..(to + 1) * n].to_vec(),
            y: y[from * p..to * p].to_vec(),
            u: u[from * m..to * m].to_vec(),
        };
        self.of(vec![part])
    }

    /// All recordings but one.
    pub(crate) fn without(&self, i: usize) -> Self {
        let others = self.recordings.iter().enumerate().filter(|(k, _)| *k != i);
        self.of(others.map(|(_, recording)| recording.clone()).collect())
    }

    /// With other recordings of the same system.
    fn of(&self, recordings: Vec<Recording>) -> Self {
        let (x_units, y_units) = (self.x_units.clone(), self.y_units.clone());
        let u_units = self.u_units.clone();
        History { recordings, x_units, y_units, u_units, ..*self }
    }

    /// The same without its inputs.
    pub fn without_inputs(&self) -> Self {
        let mut free = self.clone();
        (free.m, free.u_units) = (0, Vec::new());
        free.recordings.iter_mut().for_each(|r| r.u = Vec::new());
        free
    }

    /// Number of states n.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of outputs p.
    pub fn p(&self) -> usize {
        self.p
    }

    /// Number of known inputs m; 0 for a system without.
    pub fn m(&self) -> usize {
        self.m
    }

    /// Number of output samples T, over all recordings.
    #[allow(non_snake_case)]
    pub fn T(&self) -> usize {
        self.recordings.iter().map(|r| r.y.len() / self.p).sum()
    }

    /// Sampling interval in seconds.
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// Number of recordings.
    pub fn recordings(&self) -> usize {
        self.recordings.len()
    }

    /// State samples of recording `i`, (Tᵢ+1)·n numbers.
    ///
    /// # Errors
    /// [`Error::Value`] when there is no such recording.
    pub fn x(&self, i: usize) -> Result<&[f64], Error> {
        self.recording(i).map(|r| &r.x[..])
    }

    /// Output samples of recording `i`, Tᵢ·p numbers.
    ///
    /// # Errors
    /// [`Error::Value`] when there is no such recording.
    pub fn y(&self, i: usize) -> Result<&[f64], Error> {
        self.recording(i).map(|r| &r.y[..])
    }

    /// Input samples of recording `i`, Tᵢ·m numbers.
    ///
    /// # Errors
    /// [`Error::Value`] when there is no such recording.
    pub fn u(&self, i: usize) -> Result<&[f64], Error> {
        self.recording(i).map(|r| &r.u[..])
    }

    fn recording(&self, i: usize) -> Result<&Recording, Error> {
        let last = self.recordings.len() - 1;
        self.recordings
            .get(i)
            .ok_or_else(|| Error::value("i", format!("0 to {last}, a recording's number"), i))
    }

    /// As [`x`](Self::x), for a recording that is known to be there.
    pub(crate) fn states(&self, i: usize) -> &[f64] {
        &self.recordings[i].x
    }

    /// As [`y`](Self::y), for a recording that is known to be there.
    pub(crate) fn outputs(&self, i: usize) -> &[f64] {
        &self.recordings[i].y
    }

    /// As [`u`](Self::u), for a recording that is known to be there.
    pub(crate) fn inputs(&self, i: usize) -> &[f64] {
        &self.recordings[i].u
    }

    /// Inputs of the window of `depth` outputs that begins with sample k of recording i.
    pub(crate) fn window_inputs(&self, i: usize, k: usize, depth: usize) -> &[f64] {
        &self.recordings[i].u[k * self.m..(k + depth) * self.m]
    }

    /// The last recorded state x(0).
    pub fn last_state(&self) -> &[f64] {
        let x = &self.recordings[self.recordings.len() - 1].x;
        &x[x.len() - self.n..]
    }

    /// Number N of windows of `depth` outputs and `depth` + 1 states: Σᵢ max(0, Tᵢ - depth + 1).
    pub fn windows(&self, depth: usize) -> usize {
        self.recordings.iter().map(|r| (r.y.len() / self.p + 1).saturating_sub(depth)).sum()
    }

    /// H_{depth+1}(x) and H_depth(y) of each recording that is long enough, without copying; none
    /// for depth 0.
    pub fn hankel(&self, depth: usize) -> impl Iterator<Item = (BlockHankel<'_>, BlockHankel<'_>)> {
        self.recordings.iter().filter(move |r| r.y.len() / self.p >= depth).filter_map(move |r| {
            Some((
                BlockHankel::new(&r.x, self.n, depth + 1).ok()?,
                BlockHankel::new(&r.y, self.p, depth).ok()?,
            ))
        })
    }
}
