//! Sharing of memory between buffers that are never needed at the same time.

/// Which slot each buffer lives in, and how long the slots are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Slots {
    /// Slot of each buffer; `None` for those that are never used.
    pub(super) of_buffer: Vec<Option<usize>>,
    /// Floats in each slot.
    pub(super) lens: Vec<usize>,
}

/// Gives each buffer a slot. A buffer is (length, first and last step of use), in any order; two
/// buffers share a slot only if one's last step lies before the other's first.
pub(super) fn assign(buffers: &[(usize, Option<(usize, usize)>)]) -> Slots {
    let mut order: Vec<usize> = (0..buffers.len()).collect();
    order.sort_by_key(|&buffer| (buffers[buffer].1, buffer));
    let mut of_buffer = vec![None; buffers.len()];
    let mut lens: Vec<usize> = Vec::new();
    let mut busy_until: Vec<usize> = Vec::new();
    for buffer in order {
        let (len, Some((first, last))) = buffers[buffer] else {
            continue;
        };
        // The slot that wastes or grows least; the first of several.
        let best = (0..lens.len())
            .filter(|&slot| busy_until[slot] < first)
            .min_by_key(|&slot| lens[slot].abs_diff(len));
        let slot = best.unwrap_or_else(|| {
            lens.push(0);
            busy_until.push(0);
            lens.len() - 1
        });
        lens[slot] = lens[slot].max(len);
        busy_until[slot] = last;
        of_buffer[buffer] = Some(slot);
    }
    Slots { of_buffer, lens }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn buffers_in_one_slot_never_overlap_in_time(
            raw in proptest::collection::vec((1usize..100, 0usize..20, 0usize..10), 1..40)
        ) {
            let buffers: Vec<_> = raw
                .iter()
                .map(|&(len, first, span)| (len, Some((first, first + span))))
                .collect();
            let slots = assign(&buffers);
            for a in 0..buffers.len() {
                let slot = slots.of_buffer[a].unwrap();
                prop_assert!(slots.lens[slot] >= buffers[a].0);
                for b in 0..a {
                    if slots.of_buffer[b] == Some(slot) {
                        let ((a0, a1), (b0, b1)) = (buffers[a].1.unwrap(), buffers[b].1.unwrap());
                        prop_assert!(a1 < b0 || b1 < a0);
                    }
                }
            }
        }
    }
}
