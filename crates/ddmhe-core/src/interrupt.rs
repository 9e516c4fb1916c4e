//! Long work that can be stopped, and the cores it is spread over.

use crate::error::Error;
#[cfg(feature = "rayon")]
use rayon::iter::{ParallelBridge, ParallelIterator};
#[cfg(feature = "rayon")]
use rayon::{ThreadBuilder, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// How long work goes on before it asks again whether to stop.
const PAUSE: Duration = Duration::from_millis(50);
/// Steps between two looks at the clock, at most: a look costs as much as a tenth of the shortest
/// step.
const STRIDE: u32 = 32;

/// Asks now and then, from inside a loop, whether to stop.
pub struct Interrupt<'a> {
    stop: &'a mut dyn FnMut() -> bool,
    asked: Instant,
    looked: Instant,
    stride: u32,
    left: u32,
}

impl<'a> Interrupt<'a> {
    /// `stop` is asked every 50 ms or so; true ends the loop.
    pub fn new(stop: &'a mut dyn FnMut() -> bool) -> Self {
        let now = Instant::now();
        Interrupt { stop, asked: now, looked: now, stride: 1, left: 1 }
    }

    /// Whether to stop; called once a turn, and next to free.
    #[inline(always)]
    pub fn stopped(&mut self) -> bool {
        self.left -= 1;
        self.left == 0 && self.look()
    }

    #[cold]
    fn look(&mut self) -> bool {
        let now = Instant::now();
        // short turns: more of them until the next look; long ones: each
        self.stride =
            if now - self.looked < PAUSE / 16 { (2 * self.stride).min(STRIDE) } else { 1 };
        (self.looked, self.left) = (now, self.stride);
        if now - self.asked < PAUSE {
            return false;
        }
        self.asked = now;
        (self.stop)()
    }
}

/// `work` of every item on all cores, in the items' order; None for those that `stop` came before.
///
/// The threads are made for this call and end with it: a forked process can call it again, which a
/// pool that outlives the call forbids (its threads do not exist in the child). `stop` is asked
/// every 50 ms by the calling thread, with the number of items done; `work` is told by the flag.
///
/// # Errors
/// [`Error::Value`] where the system gives no threads.
pub(crate) fn on_all_cores<T: Send, R: Send>(
    items: Vec<T>,
    work: impl Fn(T, &AtomicBool) -> R + Sync,
    stop: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Option<R>>, Error> {
    let (stopped, done) = (AtomicBool::new(false), AtomicUsize::new(0));
    let one = |item: T| {
        let found = (!stopped.load(Ordering::Relaxed)).then(|| work(item, &stopped));
        done.fetch_add(1, Ordering::Relaxed);
        found
    };
    std::thread::scope(|scope| {
        let (send, receive) = channel();
        scope.spawn(move || drop(send.send(all(items, &one)))); // the receiver waits for it
        loop {
            match receive.recv_timeout(PAUSE) {
                Ok(Ok(found)) => return Ok(found),
                Ok(Err(e)) => return Err(e),
                Err(RecvTimeoutError::Timeout) => {
                    if stop(done.load(Ordering::Relaxed)) {
                        stopped.store(true, Ordering::Relaxed);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(Vec::new()), // a panic
            }
        }
    })
}

/// `one` of every item on all cores, in the items' order.
#[cfg(feature = "rayon")]
fn all<T: Send, R: Send>(
    items: Vec<T>,
    one: &(impl Fn(T) -> Option<R> + Sync),
) -> Result<Vec<Option<R>>, Error> {
    let work = || {
        // taken in their order, so that what is finished when `stop` comes are the first
        let numbered = items.into_iter().enumerate().par_bridge();
        let mut found: Vec<(usize, Option<R>)> = numbered.map(|(k, item)| (k, one(item))).collect();
        found.sort_unstable_by_key(|(k, _)| *k);
        found.into_iter().map(|(_, found)| found).collect()
    };
    ThreadPoolBuilder::new()
        .build_scoped(ThreadBuilder::run, |pool| pool.install(work))
        .map_err(|e| Error::value("RAYON_NUM_THREADS", "as many threads as the system gives", e))
}

/// `one` of every item, one after the other.
#[cfg(not(feature = "rayon"))]
fn all<T, R>(items: Vec<T>, one: &impl Fn(T) -> Option<R>) -> Result<Vec<Option<R>>, Error> {
    Ok(items.into_iter().map(one).collect())
}
