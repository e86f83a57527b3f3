//! Gaps and duplicates among sequence numbers that arrived in any order.

/// What became of a sender's sequence numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct SequenceCount {
    /// Messages that arrived.
    pub(crate) received: u64,
    /// Arrivals of numbers that had arrived before.
    pub(crate) duplicates: u64,
    /// Numbers between the smallest and the largest that never arrived. Those before the smallest
    /// are not counted: a recorder may start later than a sender.
    pub(crate) missing: u64,
}

impl SequenceCount {
    /// Counts the numbers that arrived.
    pub(crate) fn of(mut arrived: Vec<u64>) -> Self {
        let received = arrived.len() as u64;
        arrived.sort_unstable();
        arrived.dedup();
        let distinct = arrived.len() as u64;
        let missing = match (arrived.first(), arrived.last()) {
            // The span holds all numbers that could have come, less one; so does `distinct - 1`.
            (Some(first), Some(last)) => (last - first) - (distinct - 1),
            _ => 0,
        };
        Self {
            received,
            duplicates: received - distinct,
            missing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_whole_range_of_numbers_does_not_overflow() {
        let count = SequenceCount::of(vec![u64::MAX, 0]);
        assert_eq!(count.missing, u64::MAX - 1);
        assert_eq!(SequenceCount::of(Vec::new()), SequenceCount::default());
    }

    proptest! {
        /// Numbers are dropped and repeated as each one's `fate` says, then shuffled; the count has
        /// to find just that.
        #[test]
        fn gaps_and_duplicates_are_found_in_any_order(
            first in 0..1_000_000u64,
            (fates, order) in prop::collection::vec(0..4u64, 1..80)
                .prop_flat_map(|fates| {
                    let arrivals: Vec<u64> = (0u64..)
                        .zip(&fates)
                        .flat_map(|(offset, &copies)| vec![offset; usize::try_from(copies).unwrap()])
                        .collect();
                    (Just(fates), Just(arrivals).prop_shuffle())
                }),
        ) {
            let came: Vec<usize> = (0..fates.len()).filter(|&i| fates[i] > 0).collect();
            let missing = came.windows(2).map(|pair| pair[1] - pair[0] - 1).sum::<usize>() as u64;
            let duplicates = fates.iter().map(|copies| copies.saturating_sub(1)).sum::<u64>();
            let count = SequenceCount::of(order.iter().map(|offset| first + offset).collect());
            prop_assert_eq!(count, SequenceCount {
                received: order.len() as u64, duplicates, missing,
            });
        }
    }
}
