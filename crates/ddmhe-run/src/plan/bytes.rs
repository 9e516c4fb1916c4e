//! Plans as bytes, and back.

use crate::evidence::Rule;
use crate::layout::Layout;
use crate::plan::common::{Begin, Common, HEADER, Margin, Shared, Sizes};
use crate::plan::depth::{Depth, HEAD, Kind};
use crate::prices::Prices;
use core::fmt;

const MAGIC: u64 = u64::from_le_bytes(*b"ddmheplN");
/// Goes up with every change of what a plan holds.
const FORMAT: f64 = 5.0;
/// Where the checksum is, which is of everything else.
const SUM: usize = 3;
/// Where the prices of leaving bounds are.
const PRICES: usize = HEADER - 3;
/// From how many deviations on an output is rejected.
const GATE: usize = 24;

/// Bytes where doubles can be read: `static PLAN: Aligned<[u8; LEN]> =
/// Aligned(*include_bytes!(…))`.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Aligned<T>(pub T);

/// Why bytes are no plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PlanError {
    /// They do not begin where a double can be: see [`Aligned`].
    Alignment,
    /// Nothing that this package wrote.
    Foreign,
    /// Of another format.
    Format,
    /// Cut off, or longer than they say.
    Length,
    /// Changed since they were written.
    Checksum,
    /// Their sizes contradict each other, or are more than this machine can count.
    Sizes,
    /// The machine is big-endian.
    Endian,
    /// Room for a step holds fewer numbers than [`Stepper::room`](crate::Stepper::room).
    Room,
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PlanError::Alignment => {
                "plan: expected bytes aligned to 8, found others (Aligned does it)"
            }
            PlanError::Foreign => {
                "plan: expected a plan, found bytes that this package did not write"
            }
            PlanError::Format => "plan: expected this version's format, found another",
            PlanError::Length => {
                "plan: expected a whole plan, found one that was cut off or is longer"
            }
            PlanError::Checksum => "plan: expected a plan as it was made, found changed bytes",
            PlanError::Sizes => "plan: expected sizes that fit, found others",
            PlanError::Endian => "plan: expected a little-endian machine, found a big-endian one",
            PlanError::Room => "memory: expected at least Stepper::room numbers, found fewer",
        })
    }
}

impl core::error::Error for PlanError {}

fn bit(flags: f64, number: u32) -> bool {
    flags as u64 >> number & 1 == 1
}

fn flags(bits: &[bool]) -> f64 {
    bits.iter().rev().fold(0.0, |sum, bit| 2.0 * sum + f64::from(*bit))
}

impl Common {
    /// Into the header of its own numbers. `total` is the length of the plan with its `blocks`:
    /// depths, and depths of an unknown start.
    pub fn write_header(&self, numbers: &mut [f64], total: usize, blocks: [usize; 2]) {
        let Sizes { n, p, m, lag, horizon, rank, filled, .. } = self.sizes;
        let Sizes { x_bounded, v_bounded, w_bounded, driven, .. } = self.sizes;
        let Sizes { centered, plain_noise, recorded, prices, .. } = self.sizes;
        numbers[0] = f64::from_bits(MAGIC);
        numbers[1] = FORMAT;
        let sizes = [n, p, horizon, rank, filled, blocks[0], blocks[1]];
        numbers[2] = total as f64;
        numbers[SUM] = 0.0;
        numbers[4..11].iter_mut().zip(sizes).for_each(|(number, size)| *number = size as f64);
        let soft = prices.any();
        numbers[11] = flags(&[
            x_bounded,
            v_bounded,
            centered,
            plain_noise,
            w_bounded,
            driven,
            recorded,
            soft,
            self.sizes.drifts,
            self.sizes.stuck_missing,
            self.sizes.start == Begin::Unknown,
            self.sizes.start == Begin::Auto,
        ]);
        numbers[GATE] = self.sizes.gate;
        numbers[12] = self.rho;
        numbers[13] = self.unit;
        for (margin, at) in self.margins.iter().zip(numbers[14..20].chunks_exact_mut(2)) {
            at.copy_from_slice(&[margin.per_largest, margin.per_smallest]);
        }
        (numbers[20], numbers[21], numbers[22]) = (m as f64, lag as f64, self.price);
        numbers[23] = f64::from(self.sizes.rule.code());
        numbers[PRICES..PRICES + 3].copy_from_slice(&[prices.x, prices.v, prices.w]);
    }

    /// From its numbers, with the blocks. `largest` is the largest number of this machine's width:
    /// sizes whose products exceed it are refused before they are multiplied.
    fn read(numbers: &[f64], largest: u64) -> Option<(Self, [usize; 2])> {
        let mut sizes = [0; 7];
        for (size, number) in sizes.iter_mut().zip(&numbers[4..11]) {
            *size = whole(*number)?;
        }
        let [n, p, horizon, rank, filled, depths, opening] = sizes;
        let bits = known_flags(numbers[11], 12)?;
        let [x, v, w] = [0, 1, 2].map(|i| numbers[PRICES + i]);
        let prices = Prices { x, v, w };
        let nothing = prices.w > 0.0 && !bit(bits, 5); // to be left
        if !prices.valid() || prices.any() != bit(bits, 7) || nothing {
            return None;
        }
        let (m, lag) = (whole(numbers[20])?, whole(numbers[21])?);
        let rule = Rule::from_code(u32::try_from(whole(numbers[23])?).ok()?)?;
        let sizes = Sizes {
            n,
            p,
            m,
            lag,
            horizon,
            rank,
            filled,
            x_bounded: bit(bits, 0),
            v_bounded: bit(bits, 1),
            centered: bit(bits, 2),
            plain_noise: bit(bits, 3),
            w_bounded: bit(bits, 4),
            driven: bit(bits, 5),
            recorded: bit(bits, 6),
            prices,
            rule,
            drifts: bit(bits, 8),
            gate: numbers[GATE],
            stuck_missing: bit(bits, 9),
            start: begin(bit(bits, 10), bit(bits, 11))?,
        };
        let some = n > 0 && p > 0 && horizon > 0 && rank > 0 && depths > 0 && lag > 0;
        let unlike = (rule == Rule::Filter) != (sizes.recorded && sizes.judged())
            || sizes.drifts && !sizes.judged();
        if !some || filled > horizon || unlike || !sizes.countable(largest) {
            return None;
        }
        if !sizes.doubts_fit() || sizes.opens() != (opening > 0) {
            return None;
        }
        let margin = |at: usize| Margin { per_largest: numbers[at], per_smallest: numbers[at + 1] };
        let common = Common {
            rho: numbers[12],
            unit: numbers[13],
            margins: [margin(14), margin(16), margin(18)],
            price: numbers[22],
            ..Common::new(sizes)
        };
        Some((common, [depths, opening]))
    }
}

/// Where a run starts, by its flags.
fn begin(unknown: bool, auto: bool) -> Option<Begin> {
    match (unknown, auto) {
        (false, false) => Some(Begin::Known),
        (true, false) => Some(Begin::Unknown),
        (false, true) => Some(Begin::Auto),
        (true, true) => None,
    }
}

impl Sizes {
    /// Whether what doubts outputs, or the start, goes with the rest: it takes evidence, and a run
    /// from an unknown state begins without an output.
    fn doubts_fit(&self) -> bool {
        let asks = self.gate != 0.0 || self.stuck_missing || self.start == Begin::Auto;
        let gate = self.gate == 0.0 || self.gate > 1.0 && self.gate.is_finite();
        gate && (self.judged() || !asks) && (self.start != Begin::Unknown || self.filled == 0)
    }
}

impl Depth {
    /// Into the header of its own numbers.
    pub fn write_header(&self, numbers: &mut [f64]) {
        let Kind { centered, plain_prior, surplus, for_pattern, filtered, .. } = self.kind;
        let Kind { penalised, judged, .. } = self.kind;
        let Layout { n, p, depth, .. } = self.layout;
        [n, p, depth, self.rank].iter().zip(&mut *numbers).for_each(|(s, at)| *at = *s as f64);
        numbers[4] =
            flags(&[centered, plain_prior, surplus, for_pattern, filtered, penalised, judged]);
        numbers[5] = self.prior_weight;
    }
}

/// A size: whole, and none that a plan could have is larger.
fn whole(number: f64) -> Option<usize> {
    let size = number as usize;
    ((0.0..=1e6).contains(&number) && size as f64 == number).then_some(size)
}

/// So many flags, if there is none that this version does not know.
fn known_flags(number: f64, known: u32) -> Option<f64> {
    whole(number).filter(|flags| *flags < 1 << known).map(|_| number)
}

/// The block of a depth that begins at `at`, if it is within the sizes of the plan: its own are
/// multiplied then, and not before.
#[inline]
fn block<'a>(numbers: &'a [f64], at: usize, sizes: &Sizes) -> Option<(Depth, &'a [f64])> {
    let rest = numbers.get(at..)?;
    let head = rest.get(..HEAD)?;
    let (n, p, depth) = (whole(head[0])?, whole(head[1])?, whole(head[2])?);
    let (rank, bits) = (whole(head[3])?, known_flags(head[4], 7)?);
    let within = n == sizes.n && p == sizes.p && (1..=sizes.horizon).contains(&depth);
    if !within || !(1..=sizes.rank).contains(&rank) {
        return None;
    }
    let kind = Kind {
        centered: bit(bits, 0),
        plain_prior: bit(bits, 1),
        surplus: bit(bits, 2),
        for_pattern: bit(bits, 3),
        filtered: bit(bits, 4),
        penalised: bit(bits, 5),
        judged: bit(bits, 6),
    };
    if kind.filtered && !sizes.recorded || kind.judged != sizes.judged() {
        return None;
    }
    let layout = sizes.layout(depth);
    let depth = Depth { prior_weight: head[5], ..Depth::new(layout, rank, kind) };
    Some((depth, rest.get(..depth.len)?))
}

/// CRC-32 of everything but the checksum itself.
fn checksum(bytes: &[u8]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    sum.update(&bytes[..8 * SUM]);
    sum.update(&bytes[8 * (SUM + 1)..]);
    sum.finalize()
}

/// The checksum into the header of a plan that is otherwise complete; its bytes are those of the
/// numbers.
pub fn seal(numbers: &mut [f64]) {
    numbers[SUM] = 0.0;
    numbers[SUM] = f64::from(checksum(bytemuck::cast_slice(numbers)));
}

impl<'a> Plan<'a> {
    /// A plan in bytes that were made from an estimator. Nothing is copied.
    ///
    /// # Errors
    /// [`PlanError`] says what is wrong with them; a plan that was read makes no step fail.
    pub fn from_bytes(bytes: &'a [u8]) -> Result<Self, PlanError> {
        if cfg!(target_endian = "big") {
            return Err(PlanError::Endian);
        }
        if !(bytes.as_ptr() as usize).is_multiple_of(align_of::<f64>()) {
            return Err(PlanError::Alignment);
        }
        if !bytes.starts_with(&MAGIC.to_le_bytes()) {
            return Err(PlanError::Foreign);
        }
        let numbers: &[f64] = bytemuck::try_cast_slice(bytes).map_err(|_| PlanError::Length)?;
        if numbers.len() < HEADER {
            return Err(PlanError::Length);
        }
        if numbers[1] != FORMAT {
            return Err(PlanError::Format);
        }
        if numbers[2] != numbers.len() as f64 {
            return Err(PlanError::Length);
        }
        if numbers[SUM] != f64::from(checksum(bytes)) {
            return Err(PlanError::Checksum);
        }
        let largest = usize::MAX as u64;
        let (common, [depths, opening]) = Common::read(numbers, largest).ok_or(PlanError::Sizes)?;
        let plan = Plan { common, numbers, depths, opening };
        plan.fits().then_some(plan).ok_or(PlanError::Sizes)
    }

    /// Whether the blocks are there, of the sizes that the header says, and enough for every step
    /// of a run: the depths ascend from one that a new run's first output fills, to the horizon.
    fn fits(&self) -> bool {
        let Sizes { horizon, rank, filled, centered, .. } = self.common.sizes;
        let opens = self.common.sizes.opens();
        let (mut at, mut deepest, mut highest) = (self.common.len, 0, 0);
        for number in 0..self.depths + self.opening {
            let Some((depth, _)) = block(self.numbers, at, &self.common.sizes) else {
                return false;
            };
            let (m, rows) = (depth.layout.depth, depth.layout.apart());
            let first = number == 0 || number == self.depths;
            let ascends = first || m > deepest;
            if !ascends || depth.rank > rows || depth.kind.centered != centered {
                return false;
            }
            // a run that opens begins with one output, whatever the window of a new run holds
            let first_window = if opens { 1 } else { filled + 1 };
            let late = number == 0 && m > first_window;
            let shallow = number + 1 == self.depths && m != horizon;
            if late || shallow || depth.kind.for_pattern {
                return false;
            }
            at += depth.len;
            (deepest, highest) = (m, highest.max(depth.rank));
        }
        at == self.numbers.len() && highest == rank
    }
}

/// A plan that was read from bytes.
#[derive(Debug, Clone)]
pub struct Plan<'a> {
    common: Common,
    numbers: &'a [f64],
    depths: usize,  // number of blocks
    opening: usize, // and of those of an unknown start
}

impl<'a> Plan<'a> {
    /// States n.
    pub fn n(&self) -> usize {
        self.common.sizes.n
    }

    /// Outputs p.
    pub fn p(&self) -> usize {
        self.common.sizes.p
    }

    /// Known inputs m; 0 for a system without.
    pub fn m(&self) -> usize {
        self.common.sizes.m
    }

    /// Horizon M.
    pub fn horizon(&self) -> usize {
        self.common.sizes.horizon
    }

    /// What all depths share.
    pub fn shared(&self) -> Shared<'a> {
        Shared::new(&self.common, self.numbers)
    }

    /// Whether a new run starts from an unknown state.
    pub fn starts_unknown(&self) -> bool {
        self.common.sizes.start == Begin::Unknown
    }

    /// Whether a new run finds out by itself where it starts.
    pub fn finds_start(&self) -> bool {
        self.common.sizes.start == Begin::Auto
    }

    /// The block of the deepest windows that `outputs` outputs fill, with its numbers. `opening`:
    /// of a run from an unknown state, exactly of that depth if there is one.
    pub fn depth(&self, outputs: usize, opening: bool) -> Option<(Depth, &'a [f64])> {
        let (mut at, mut found) = (self.common.len, None);
        for number in 0..self.depths + self.opening {
            let (depth, own) = block(self.numbers, at, &self.common.sizes)?;
            at += depth.len;
            let wanted = match number < self.depths {
                true => !opening && depth.layout.depth <= outputs,
                false => opening && depth.layout.depth == outputs,
            };
            found = if wanted { Some((depth, own)) } else { found };
        }
        found
    }
}
