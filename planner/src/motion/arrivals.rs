//! The headings that an action may follow, in blocks of 32 that neighbour, so that a search backward
//! looks at a block at once. Searches keep a cell's states in the same blocks: few of its directions are
//! reached, and what is closer together is found sooner.

use super::Side;
use crate::action::{Action, DIRECTIONS};
use crate::collision::WORD;

/// Directions of a block, as bits of a direction and as their number.
pub(crate) const BLOCK_BITS: u32 = 5;
pub(crate) const BLOCK: usize = 1 << BLOCK_BITS;
/// Blocks of all directions.
pub(crate) const BLOCKS: usize = DIRECTIONS / BLOCK;

/// What may come before an action.
#[derive(Debug)]
pub(crate) struct Arrivals {
    direction: u8,
    /// Farthest that a heading before it lies to the left and to the right, directions.
    left_steps: u8,
    right_steps: u8,
    blocks: Vec<ArrivalBlock>,
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
    /// Nothing may come before the action yet.
    pub(super) const fn by(action: &Action) -> Self {
        Self {
            direction: action.direction,
            left_steps: 0,
            right_steps: 0,
            blocks: Vec::new(),
        }
    }

    /// Adds a heading, after all smaller ones, from which one turns by `steps` to a side, and what turn and
    /// length cost then, in units.
    pub(super) fn add(&mut self, heading: u8, (side, steps): (Side, u8), cost: u32) {
        // Who turns to the left comes from the right.
        let farthest = match side {
            Side::Left => &mut self.right_steps,
            Side::Right => &mut self.left_steps,
        };
        *farthest = steps.max(*farthest);
        let (number, within) = (usize::from(heading) / BLOCK, usize::from(heading) % BLOCK);
        if self.blocks.last().is_none_or(|last| last.number != number) {
            self.blocks.push(ArrivalBlock {
                number,
                allowed: 0,
                costs: [0; BLOCK],
            });
        }
        if let Some(block) = self.blocks.last_mut() {
            block.allowed |= 1 << within;
            block.costs[within] = cost;
        }
    }

    /// The parts of it that are not empty.
    pub(crate) const fn blocks(&self) -> &[ArrivalBlock] {
        self.blocks.as_slice()
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
