//! The machine's vector units for passes over data.

use ddmhe_run::rigid::pass::Units;

/// The widest that the machine has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide(pulp::Arch);

impl Wide {
    pub fn new() -> Self {
        Wide(pulp::Arch::new())
    }
}

impl Units for Wide {
    #[inline(always)]
    fn run<R>(&self, work: impl FnOnce() -> R) -> R {
        self.0.dispatch(work)
    }
}
