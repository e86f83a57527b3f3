//! The bounded queue between zenoh's threads, which must never wait, and a task that takes its time.

use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::Notify;
use zenoh::bytes::ZBytes;

use crate::keys::Qos;

/// A message as it arrived.
#[derive(Debug, Clone)]
pub(crate) struct Arrived {
    pub(crate) key: String,
    pub(crate) payload: ZBytes,
    pub(crate) received_nanos: u64,
    /// By the sender's clock, if the message says.
    pub(crate) sent_nanos: Option<u64>,
}

/// What zenoh's threads hand messages over to. None of this may wait.
pub(crate) trait Inbox: Send + Sync + std::fmt::Debug {
    /// Takes a message in.
    fn push(&self, arrived: Arrived);
    /// Takes note of messages that were sent and did not arrive.
    fn add_missed(&self, count: u64);
    /// Lets the other side come to its end.
    fn close(&self);
}

/// What is given up when a queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Overflow {
    /// What was there first: a message replaces an older one of its key at once.
    ReplaceByKey,
    /// What was there first.
    DropOldest,
    /// What comes last.
    DropNewest,
}

impl Overflow {
    pub(crate) const fn of(qos: Qos) -> Self {
        match qos {
            Qos::Newest | Qos::Latched => Self::ReplaceByKey,
            Qos::Block => Self::DropNewest,
            Qos::Durable | Qos::Kept | Qos::Interactive | Qos::Lossy => Self::DropOldest,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Queue {
    state: Mutex<State>,
    capacity: usize,
    overflow: Overflow,
    changed: Notify,
    received: AtomicU64,
    dropped: AtomicU64,
    missed: AtomicU64,
}

#[derive(Debug, Default)]
struct State {
    arrived: VecDeque<Arrived>,
    closed: bool,
}

impl Queue {
    pub(crate) fn new(capacity: usize, overflow: Overflow) -> Self {
        Self {
            state: Mutex::default(),
            capacity: capacity.max(1),
            overflow,
            changed: Notify::new(),
            received: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            missed: AtomicU64::new(0),
        }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        // Nothing inside the lock can panic half way through a change.
        self.state
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    pub(crate) fn try_pop(&self) -> Option<Arrived> {
        self.state().arrived.pop_front()
    }

    /// The next message, or `None` when the queue is closed and empty.
    pub(crate) async fn pop(&self) -> Option<Arrived> {
        loop {
            {
                let mut state = self.state();
                if let Some(arrived) = state.arrived.pop_front() {
                    return Some(arrived);
                }
                if state.closed {
                    return None;
                }
            }
            // A change since then has left a permit, so that this returns at once.
            self.changed.notified().await;
        }
    }

    pub(crate) fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    pub(crate) fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }
}

impl Inbox for Queue {
    fn push(&self, arrived: Arrived) {
        self.received.fetch_add(1, Ordering::Relaxed);
        let mut state = self.state();
        if self.overflow == Overflow::ReplaceByKey {
            let older = state.arrived.iter().position(|old| old.key == arrived.key);
            if let Some(index) = older {
                state.arrived.remove(index);
                self.dropped.fetch_add(1, Ordering::Relaxed);
            }
        }
        if state.arrived.len() >= self.capacity {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            if self.overflow == Overflow::DropNewest {
                return;
            }
            state.arrived.pop_front();
        }
        state.arrived.push_back(arrived);
        drop(state);
        self.changed.notify_one();
    }

    fn close(&self) {
        self.state().closed = true;
        self.changed.notify_one();
    }

    fn add_missed(&self, count: u64) {
        self.missed.fetch_add(count, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrived(key: &str, number: u8) -> Arrived {
        Arrived {
            key: key.to_owned(),
            payload: ZBytes::from(vec![number]),
            received_nanos: 0,
            sent_nanos: None,
        }
    }

    fn left(queue: &Queue) -> Vec<u8> {
        std::iter::from_fn(|| queue.try_pop())
            .map(|arrived| arrived.payload.to_bytes()[0])
            .collect()
    }

    fn fill(queue: &Queue) {
        for (key, number) in [("a", 0), ("b", 1), ("a", 2), ("b", 3), ("c", 4)] {
            queue.push(arrived(key, number));
        }
    }

    #[test]
    fn a_full_queue_gives_up_what_its_policy_says_and_counts_it() {
        for (overflow, kept, dropped) in [
            (Overflow::DropOldest, vec![3, 4], 3),
            (Overflow::DropNewest, vec![0, 1], 3),
            (Overflow::ReplaceByKey, vec![3, 4], 3),
        ] {
            let queue = Queue::new(2, overflow);
            fill(&queue);
            assert_eq!(left(&queue), kept, "{overflow:?}");
            assert_eq!(queue.dropped(), dropped, "{overflow:?}");
            assert_eq!(queue.received(), 5);
        }
    }

    #[test]
    fn the_newest_of_every_key_is_kept() {
        let queue = Queue::new(3, Overflow::ReplaceByKey);
        fill(&queue);
        assert_eq!(left(&queue), [2, 3, 4]);
        assert_eq!(queue.dropped(), 2);
    }

    #[tokio::test]
    async fn a_closed_queue_gives_what_it_has_and_ends() {
        let queue = Queue::new(3, Overflow::DropOldest);
        queue.push(arrived("a", 7));
        queue.close();
        assert!(queue.pop().await.is_some());
        assert!(queue.pop().await.is_none());
    }
}
