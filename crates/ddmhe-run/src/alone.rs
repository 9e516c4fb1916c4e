//! Steps in a row of which x̂(t) and the cost alone are asked for, with the weights of the
//! recording: as long as a filter makes them nothing else has to be looked at in between.

use crate::memory::Memory;
use crate::panels::{padded, square};
use crate::plan::common::Shared;
use crate::tol;

/// Where the estimates of steps in a row go.
#[derive(Debug)]
pub struct Row<'a> {
    /// x̂ of each (n), in the user's units.
    pub x: &'a mut [f64],
    /// (17) of each.
    pub cost: &'a mut [f64],
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// Steps of full windows without bounds and evidence that a filter makes of these outputs and
    /// inputs, one after the other: how many; the next one is another, or comes after the window
    /// has moved in memory. Numbers are those of as many steps alone.
    #[inline(always)]
    pub fn filter_row(
        &mut self,
        shared: &Shared<'_>,
        (y, u): (&[f64], &[f64]),
        out: Row<'_>,
    ) -> usize {
        let Some(kalman) = &shared.kalman else { return 0 };
        let (at, depth, block) = (self.stretches(), self.depth, self.block.as_mut());
        let [n, p, m] = at.channels();
        let usual =
            self.missing == 0 && self.outputs.len == depth && self.filtering.continues(depth);
        if !usual {
            return 0;
        }
        let mut room = self.filtering.make_room(block);
        for of in [&mut self.outputs, &mut self.states, &mut self.inputs] {
            of.make_room(block);
            room = if of.width > 0 { room.min(of.room()) } else { room };
        }
        let samples = (y.len() / p).min(room);
        let (mut of_x, mut of_y) = (self.states.window().end, self.outputs.window().end);
        let (mut of_u, [mut of_nu, ahead]) = (self.inputs.window().end, self.filtering.ends());
        let (known, room) = block.split_at_mut(ahead);
        let next = &mut room[..padded(n + p)];
        let [mut y, mut u] = [y, u];
        for made in 0..samples {
            let (y_now, u_now);
            (y_now, y) = y.split_at(p);
            (u_now, u) = u.split_at(m);
            write(shared.output_deviations(y_now), &mut known[of_y..of_y + p]);
            write(shared.input_deviations(u_now), &mut known[of_u..of_u + m]);
            let (x, y, u) =
                (&known[of_x - n..of_x], &known[of_y..of_y + p], &known[of_u..of_u + m]);
            kalman.ahead(x, y, u, next);
            // NaN where an output was not measured
            let near = |all: bool, v: &f64| all & (v.abs() <= tol::MEASURABLE);
            if !(y.iter().fold(true, near) & next[..n].iter().fold(true, near)) {
                return self.made(made);
            }
            let x = &mut out.x[made * n..(made + 1) * n];
            write(shared.state_of(&next[..n]), x);
            write(shared.state_deviations(x), &mut known[of_x..of_x + n]);
            write(next[n..n + p].iter().copied(), &mut known[of_nu..of_nu + p]);
            (of_x, of_y, of_u, of_nu) = (of_x + n, of_y + p, of_u + m, of_nu + p);
            out.cost[made] = square(&known[of_nu - depth * p..of_nu]);
        }
        self.made(samples)
    }

    fn made(&mut self, samples: usize) -> usize {
        self.outputs.move_on(samples);
        self.states.move_on(samples);
        self.inputs.move_on(samples);
        self.filtering.move_on(samples);
        samples
    }

    /// The inputs in the window of a step that was so many before the newest, if the window did not
    /// move in memory since.
    pub fn inputs_before(&self, steps: usize) -> &[f64] {
        let now = self.inputs.last(self.depth);
        let back = steps * self.inputs.width;
        &self.block.as_ref()[now.start - back..now.end - back]
    }
}

#[inline(always)]
fn write(from: impl Iterator<Item = f64>, to: &mut [f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from;
    }
}
