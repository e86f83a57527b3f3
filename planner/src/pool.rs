//! Memories that are lent out and come back.

use std::sync::{Mutex, PoisonError};

/// Most that are kept.
const MAX_POOLED_MEMORIES: usize = 64;

/// Memories of searches that are not running.
#[derive(Debug)]
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Default> Pool<T> {
    /// Lends a memory.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        // A poisoned lock is fine: a memory is prepared anew before each use.
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut memory = lock().pop().unwrap_or_default();
        let result = work(&mut memory);
        let mut memories = lock();
        if memories.len() < MAX_POOLED_MEMORIES {
            memories.push(memory);
        }
        result
    }
}
