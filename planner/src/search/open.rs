//! The open list: keys of 64 bits, smallest first.
//!
//! The upper half of a key is a total in units. Keys whose totals are near one another share a bucket,
//! and only the bucket at the front is sorted, when its first key is due. Totals rise slowly while a
//! search goes on, so nearly every key is put into a bucket at the price of one store. The few that
//! come later than that but belong before go into a heap, which stays small enough for the fastest
//! cache. So the order is exact.

use std::cmp::Reverse;

/// Totals that differ only in this many low bits share a bucket: 2¹⁴ units are 1.6 cm.
const BUCKET_BITS: u32 = 14;
/// Buckets, enough for totals of 256 m; the last one takes whatever lies beyond.
const BUCKETS: usize = 1 << 14;
/// Keys of a chunk. With its length and its link a chunk fills four cache lines.
const CHUNK_KEYS: usize = 31;
/// Stands for no chunk.
const NONE: u32 = u32::MAX;

/// A priority queue of keys.
#[derive(Debug)]
pub(super) struct OpenList {
    /// What the bucket at the front held when its turn came, greatest first.
    sorted: Vec<u64>,
    /// Keys of the buckets up to `front` that came later.
    late: Heap,
    front: usize,
    /// By bucket: its newest chunk.
    buckets: Vec<u32>,
    chunks: Vec<Chunk>,
    free_chunk: u32,
    /// No bucket from here on holds a key.
    end: usize,
}

#[derive(Debug, Clone, Copy)]
struct Chunk {
    keys: [u64; CHUNK_KEYS],
    len: u32,
    next: u32,
}

impl Default for OpenList {
    fn default() -> Self {
        Self {
            sorted: Vec::new(),
            late: Heap::default(),
            front: 0,
            buckets: vec![NONE; BUCKETS],
            chunks: Vec::new(),
            free_chunk: NONE,
            end: 0,
        }
    }
}

impl OpenList {
    /// Becomes the same as another one; keeps its memory.
    pub(super) fn copy(&mut self, other: &Self) {
        self.sorted.clone_from(&other.sorted);
        self.late.keys.clone_from(&other.late.keys);
        self.front = other.front;
        self.buckets.clone_from(&other.buckets);
        self.chunks.clone_from(&other.chunks);
        self.free_chunk = other.free_chunk;
        self.end = other.end;
    }

    /// Forgets all keys and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.sorted.clear();
        self.late.keys.clear();
        self.buckets[..self.end].fill(NONE);
        self.chunks.clear();
        self.free_chunk = NONE;
        (self.front, self.end) = (0, 0);
    }

    #[inline]
    pub(super) fn push(&mut self, key: u64) {
        let bucket = bucket_of(key);
        if bucket <= self.front {
            self.late.push(key);
            return;
        }
        let newest = self.buckets[bucket];
        match self.chunks.get_mut(newest as usize) {
            Some(chunk) if (chunk.len as usize) < CHUNK_KEYS => {
                chunk.keys[chunk.len as usize] = key;
                chunk.len += 1;
            }
            _ => self.push_chunk(bucket, key),
        }
    }

    /// Puts a key into a new chunk of a bucket.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a state has at most one key for each way to it, far below 2^32 chunks"
    )]
    fn push_chunk(&mut self, bucket: usize, key: u64) {
        let mut chunk = Chunk {
            keys: [0; CHUNK_KEYS],
            len: 1,
            next: self.buckets[bucket],
        };
        chunk.keys[0] = key;
        let index = self.free_chunk;
        if let Some(free) = self.chunks.get_mut(index as usize) {
            self.free_chunk = free.next;
            *free = chunk;
            self.buckets[bucket] = index;
        } else {
            self.buckets[bucket] = self.chunks.len() as u32;
            self.chunks.push(chunk);
        }
        self.end = self.end.max(bucket + 1);
    }

    #[inline]
    pub(super) fn pop(&mut self) -> Option<u64> {
        loop {
            match (self.sorted.last(), self.late.keys.first()) {
                (Some(sorted), Some(late)) if late < sorted => return self.late.pop(),
                (Some(_), _) => return self.sorted.pop(),
                (None, Some(_)) => return self.late.pop(),
                (None, None) => self.advance()?,
            }
        }
    }

    /// Moves the front to the next bucket that holds keys, and sorts these.
    fn advance(&mut self) -> Option<()> {
        let behind = self.buckets.get(self.front + 1..self.end)?;
        let steps = behind.iter().position(|&bucket| bucket != NONE)?;
        self.front += 1 + steps;
        let mut index = std::mem::replace(&mut self.buckets[self.front], NONE);
        while let Some(chunk) = self.chunks.get_mut(index as usize) {
            self.sorted.extend(&chunk.keys[..chunk.len as usize]);
            let next = std::mem::replace(&mut chunk.next, self.free_chunk);
            self.free_chunk = index;
            index = next;
        }
        self.sorted.sort_unstable_by_key(|&key| Reverse(key));
        Some(())
    }
}

const fn bucket_of(key: u64) -> usize {
    let bucket = (key >> (u64::BITS / 2 + BUCKET_BITS)) as usize;
    if bucket < BUCKETS {
        bucket
    } else {
        BUCKETS - 1
    }
}

/// A four-way heap of keys.
#[derive(Debug, Default)]
struct Heap {
    keys: Vec<u64>,
}

impl Heap {
    fn push(&mut self, key: u64) {
        self.keys.push(key);
        let mut index = self.keys.len() - 1;
        while index > 0 {
            let parent = (index - 1) / 4;
            if self.keys[parent] <= key {
                break;
            }
            self.keys[index] = self.keys[parent];
            index = parent;
        }
        self.keys[index] = key;
    }

    fn pop(&mut self) -> Option<u64> {
        let smallest = *self.keys.first()?;
        let key = self.keys.pop()?;
        if self.keys.is_empty() {
            return Some(smallest);
        }
        let mut index = 0;
        loop {
            let first = 4 * index + 1;
            let children = self
                .keys
                .get(first..(first + 4).min(self.keys.len()))
                .unwrap_or(&[]);
            let Some((offset, &child)) = children.iter().enumerate().min_by_key(|(_, key)| **key)
            else {
                break;
            };
            if child >= key {
                break;
            }
            self.keys[index] = child;
            index = first + offset;
        }
        self.keys[index] = key;
        Some(smallest)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BinaryHeap;

    use super::*;
    use proptest::prelude::*;

    /// Totals of a search, a few of them far off.
    fn key() -> impl Strategy<Value = u64> {
        let near = (0u64..60_000_000).prop_map(|total| total << 32);
        prop_oneof![20 => near, 1 => any::<u64>()]
    }

    proptest! {
        #[test]
        fn keys_come_in_order_however_pushes_and_pops_alternate(
            rounds in proptest::collection::vec((proptest::collection::vec(key(), 0..60), 0usize..60), 1..12),
        ) {
            let mut open = OpenList::default();
            for _ in 0..2 {
                open.clear();
                let mut model = BinaryHeap::new();
                for (keys, pops) in &rounds {
                    for &key in keys {
                        open.push(key);
                        model.push(Reverse(key));
                    }
                    for _ in 0..*pops {
                        prop_assert_eq!(open.pop(), model.pop().map(|Reverse(key)| key));
                    }
                }
                while let Some(Reverse(key)) = model.pop() {
                    prop_assert_eq!(open.pop(), Some(key));
                }
                prop_assert_eq!(open.pop(), None);
            }
        }
    }
}
