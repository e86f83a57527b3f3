//! The headings that an action may follow, in blocks of 32 that neighbour, so that a search backward
//! looks at a block at once.

use super::{Preceding, Side};
use crate::action::DIRECTIONS;
use crate::collision::WORD;

/// Directions of a block, as bits of a direction and as their number.
pub(crate) const BLOCK_BITS: u32 = 5;
pub(crate) const BLOCK: usize = 1 << BLOCK_BITS;

/// What may come before an action.
#[derive(Debug)]
pub(crate) struct Arrivals {
    direction: u8,
    /// Farthest that a heading before it lies to the left and to the right, directions.
    left_steps: u8,
    right_steps: u8,
    blocks: Box<[ArrivalBlock]>,
}

/// The part of it with headings of one block.
#[derive(Debug)]
pub(crate) struct ArrivalBlock {
    /// The block's number.
    pub(crate) number: usize,
    /// A bit for each heading that the action may follow.
    pub(crate) allowed: u32,
    /// By heading: turn and length, in units, if it is allowed.
    pub(crate) costs: [u32; BLOCK],
}

/// Neighbouring directions: the first, and how many there are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    first: u8,
    count: usize,
}

impl Arrivals {
    /// The arrivals by an action in a direction, by what may precede it and what each heading costs.
    pub(super) fn new(direction: u8, preceding: &Preceding, cost_of: impl Fn(u8) -> u32) -> Self {
        let block_of = |number: usize| {
            let mut block = ArrivalBlock {
                number,
                allowed: 0,
                costs: [0; BLOCK],
            };
            for (heading, cost) in (0..=u8::MAX).skip(number * BLOCK).zip(&mut block.costs) {
                let (word, bit) = (usize::from(heading) / WORD, usize::from(heading) % WORD);
                if preceding.headings[word] >> bit & 1 != 0 {
                    block.allowed |= 1 << (usize::from(heading) % BLOCK);
                    *cost = cost_of(heading);
                }
            }
            block
        };
        let blocks = (0..DIRECTIONS / BLOCK).map(block_of);
        Self {
            direction,
            left_steps: preceding.left_steps,
            right_steps: preceding.right_steps,
            blocks: blocks.filter(|block| block.allowed != 0).collect(),
        }
    }

    /// The parts of it that are not empty.
    pub(crate) const fn blocks(&self) -> &[ArrivalBlock] {
        &self.blocks
    }

    /// The headings from which the turn to the action is free, as far as one to the same side may precede
    /// it. `blocked` gives the blocked turns of a group.
    #[inline]
    pub(crate) fn turnable(&self, blocked: impl Fn(usize) -> u64) -> Run {
        let left = free_turns(Side::Left, self.direction, self.left_steps, &blocked);
        let right = free_turns(Side::Right, self.direction, self.right_steps, &blocked);
        Run {
            first: self.direction.wrapping_sub(right),
            count: usize::from(right) + 1 + usize::from(left),
        }
    }
}

/// How many turns out of a direction to a side are free before the first that is not, at most `most`.
#[inline]
fn free_turns(side: Side, direction: u8, most: u8, blocked: impl Fn(usize) -> u64) -> u8 {
    let mut free = 0;
    while free < most {
        let turn = usize::from(side.passed(direction, free));
        let (group, bit) = (turn / WORD, turn % WORD);
        let (clear, rest) = match side {
            Side::Left => ((blocked(group) >> bit).trailing_zeros(), WORD - bit),
            Side::Right => (
                (blocked(group) << (WORD - 1 - bit)).leading_zeros(),
                bit + 1,
            ),
        };
        let here = rest.min(clear as usize);
        // At most a word, so it fits.
        free = free.saturating_add(u8::try_from(here).unwrap_or(u8::MAX));
        if here < rest {
            break;
        }
    }
    free.min(most)
}

impl Run {
    /// Bits of a block's directions that are in the run.
    #[inline]
    pub(crate) fn of_block(self, number: usize) -> u32 {
        // Where the block begins in the run, and from which of its directions on the run begins anew.
        let begin = (number * BLOCK + DIRECTIONS - usize::from(self.first)) % DIRECTIONS;
        let again = DIRECTIONS - begin;
        let before = bits_below(self.count.saturating_sub(begin));
        before | bits_below(self.count + again) & !bits_below(again)
    }
}

/// The lowest bits, so many.
#[inline]
fn bits_below(count: usize) -> u32 {
    if count >= BLOCK {
        u32::MAX
    } else {
        (1 << count) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_run_has_its_directions_and_no_others(first: u8, count in 1..=DIRECTIONS) {
            let run = Run { first, count };
            for direction in 0..=u8::MAX {
                let bits = run.of_block(usize::from(direction) / BLOCK);
                let is_in = bits >> (usize::from(direction) % BLOCK) & 1 != 0;
                let place = usize::from(direction.wrapping_sub(first));
                prop_assert_eq!(is_in, place < count, "{}", direction);
            }
        }

        #[test]
        fn turns_are_free_up_to_the_first_that_is_blocked(
            direction: u8,
            most in 0..=128_u8,
            far: u8,
            noise: [u64; 4],
            sides in prop_oneof![Just(Side::Left), Just(Side::Right)],
        ) {
            // Few blocked turns, or many.
            for blocked in [[0; 4], bit_of(far), noise] {
                let by_one = (0..most).take_while(|&turned| {
                    let turn = usize::from(sides.passed(direction, turned));
                    blocked[turn / WORD] >> (turn % WORD) & 1 == 0
                });
                let expected = u8::try_from(by_one.count()).unwrap();
                let free = free_turns(sides, direction, most, |group| blocked[group]);
                prop_assert_eq!(free, expected);
            }
        }
    }

    fn bit_of(turn: u8) -> [u64; 4] {
        let mut bits = [0; 4];
        bits[usize::from(turn) / WORD] = 1 << (usize::from(turn) % WORD);
        bits
    }
}
