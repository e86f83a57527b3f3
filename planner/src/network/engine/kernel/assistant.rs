//! A second thread that helps with many short pieces of work, one after the other.
//!
//! Waking a thread takes about as long as a convolution of a small image, so the assistant does not
//! sleep in between. Nobody waits for it: what it has not begun is done by who offered it.

use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, Ordering};

/// Nothing to do.
const IDLE: u8 = 0;
/// Work is offered.
const OFFERED: u8 = 1;
/// The assistant is at it.
const TAKEN: u8 = 2;
/// There will be no more.
const OVER: u8 = 3;
/// The assistant panicked at it.
const FAILED: u8 = 4;

/// Looks at the state before a thread lets others run.
const SPINS: u32 = 2000;

/// The work that is offered, which lives on the stack of who offers it.
struct Offer<'a> {
    run: &'a mut (dyn FnMut() + Send),
}

/// Shared by the thread that offers work and the one that helps.
#[derive(Debug)]
pub(crate) struct Assistant {
    state: AtomicU8,
    is_there: AtomicBool,
    offer: AtomicPtr<()>,
}

/// Runs something with an assistant on another thread of the pool, as soon as one is free.
pub(crate) fn with_assistant<R: Send>(run: impl FnOnce(&Assistant) -> R + Send) -> R {
    let assistant = Assistant {
        state: AtomicU8::new(IDLE),
        is_there: AtomicBool::new(false),
        offer: AtomicPtr::new(std::ptr::null_mut()),
    };
    let work = || {
        let _over = OnDrop(|| assistant.state.store(OVER, Ordering::Release));
        run(&assistant)
    };
    rayon::join(work, || assistant.help()).0
}

impl Assistant {
    /// Does both, the second on the other thread if that is free.
    pub(crate) fn join(&self, first: impl FnOnce(), second: impl FnOnce() + Send) {
        if !self.is_there.load(Ordering::Acquire) {
            first();
            return second();
        }
        let mut second = Some(second);
        let mut run = || {
            if let Some(second) = second.take() {
                second();
            }
        };
        let mut offer = Offer { run: &mut run };
        self.offer.store((&raw mut offer).cast(), Ordering::Relaxed);
        self.state.store(OFFERED, Ordering::Release);
        // The offer must not be left while the assistant may be at it, not even by a panic.
        let taken_back = {
            let _wait = OnDrop(|| self.take_back_or_wait());
            first();
            self.take_back()
        };
        assert!(
            self.state.load(Ordering::Acquire) != FAILED,
            "the assistant panicked"
        );
        if taken_back {
            (offer.run)();
        }
    }

    /// Whether the offer was still open.
    fn take_back(&self) -> bool {
        let taken =
            self.state
                .compare_exchange(OFFERED, IDLE, Ordering::Acquire, Ordering::Relaxed);
        taken.is_ok()
    }

    fn take_back_or_wait(&self) {
        if self.take_back() {
            return;
        }
        let mut spins = 0;
        while self.state.load(Ordering::Acquire) == TAKEN {
            pause(&mut spins);
        }
    }

    fn help(&self) {
        self.is_there.store(true, Ordering::Release);
        let mut spins = 0;
        loop {
            match self.state.load(Ordering::Acquire) {
                OVER => return,
                OFFERED => {
                    let taken = self.state.compare_exchange(
                        OFFERED,
                        TAKEN,
                        Ordering::Acquire,
                        Ordering::Relaxed,
                    );
                    if taken.is_ok() {
                        let failed = OnDrop(|| self.state.store(FAILED, Ordering::Release));
                        let offer = self.offer.load(Ordering::Relaxed).cast::<Offer<'_>>();
                        // SAFETY: it was stored before the state said so, and who stored it waits
                        // until the state is no longer TAKEN.
                        unsafe { ((*offer).run)() };
                        std::mem::forget(failed);
                        self.state.store(IDLE, Ordering::Release);
                        spins = 0;
                    }
                }
                _ => pause(&mut spins),
            }
        }
    }
}

fn pause(spins: &mut u32) {
    *spins += 1;
    if (*spins).is_multiple_of(SPINS) {
        std::thread::yield_now();
    } else {
        std::hint::spin_loop();
    }
}

struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    fn sum_of_pairs(threads: usize) -> usize {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let sum = AtomicUsize::new(0);
        pool.install(|| {
            with_assistant(|assistant| {
                for index in 0..20_000 {
                    let (mut low, mut high) = (0, 0);
                    assistant.join(|| low = index, || high = 2 * index);
                    sum.fetch_add(low + high, Ordering::Relaxed);
                }
            });
        });
        sum.into_inner()
    }

    #[test]
    fn everything_is_done_once_whether_there_is_a_second_thread_or_not() {
        let expected = 3 * (0..20_000).sum::<usize>();
        for threads in [1, 2, 3] {
            assert_eq!(sum_of_pairs(threads), expected);
        }
    }

    #[test]
    fn a_panic_on_either_side_ends_both() {
        for fails_first in [true, false] {
            let outcome = std::panic::catch_unwind(|| {
                with_assistant(|assistant| {
                    for _ in 0..1000 {
                        assistant.join(
                            || assert!(!fails_first, "first"),
                            || assert!(fails_first, "second"),
                        );
                    }
                });
            });
            assert!(outcome.is_err());
        }
    }
}
