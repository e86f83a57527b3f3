//! States that a search under a bound has come to, by cell, and its open list.
//!
//! A state's key may be anything up to ε (g + h), g being its cost so far and h a lower bound on the
//! rest; and a search may stop as soon as no key is less than the cost C of a path that is known. Then
//! C ≤ ε × the optimum, whatever the keys were: as long as a path of the optimal cost is not known, some
//! state on an optimal path is open at its optimal cost g (the first one on it that was not expanded at
//! that cost), and C ≤ its key ≤ ε (g + h) ≤ ε × the optimum. This asks neither for a consistent h nor
//! for an order of expansions. So a state that is reached for the first time gets g + w h with w ≤ ε,
//! and one that was expanded before, at a greater cost, the greatest key that is allowed. It is then
//! nearly never expanded again, which weighted search with an inconsistent h would do hundreds of times.
//! And a state may be dropped once its greatest key is not less than C, whatever its key is: it might as
//! well have had that one.

use bytemuck::Zeroable;
use bytemuck::allocation::zeroed_vec;
use swath_bridge::GridSpec;

use super::bound::Aim;
use super::memory::{Parent, Place, State};
use super::open::OpenList;
use crate::Error;
use crate::motion::{ArrivalBlock, BLOCK, BLOCK_BITS, BLOCKS};

/// Memory is asked for so many blocks at once, 72 MiB: to make it larger takes milliseconds, when there may
/// be none left.
const FIRST_BLOCKS: usize = 1 << 18;
/// Stands for no block. Memory of a large grid begins as zeros, which takes none until it is written to.
const NO_BLOCK: u32 = 0;
/// Fractions of weights are counted in this.
const WEIGHT_BITS: u32 = 16;
const WEIGHT_ONE: f64 = 65_536.0;
/// Greatest ε: beyond, costs times weights could pass the range of keys.
pub(super) const MAX_EPSILON: f64 = 64.0;

/// Whether a state was expanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Never.
    New,
    /// At its cost.
    Expanded,
    /// At a greater cost.
    Improved,
}

/// What is the same for all states of a cell.
#[derive(Debug, Clone, Copy, Default, Zeroable)]
pub(super) struct About {
    /// Lower bound on the length of the rest, in units.
    pub(super) length: u32,
    /// For the lower bound on turns.
    pub(super) aim: Aim,
    /// Lower bound on the cost of a state that is in no exact trunk, in units.
    pub(super) beyond: u32,
}

#[derive(Debug, Clone, Copy, Default, Zeroable)]
struct CellSlot {
    generation: u32,
    about: About,
    /// Where its states are, by range of directions; [`NO_BLOCK`] for those not reached.
    blocks: [u32; BLOCKS],
}

/// Costs of the best ways to a block's states, in units; `u32::MAX` where there is none yet. They fill
/// whole cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Costs([u32; BLOCK]);

impl Costs {
    const NONE: Self = Self([u32::MAX; BLOCK]);

    /// A bit for each of the states that is come to at a lower cost through one of cost `cost`; what is
    /// not allowed counts too.
    #[inline]
    fn improved_by(&self, cost: u32, block: &ArrivalBlock) -> u32 {
        let mut bytes = [0u8; BLOCK];
        for ((byte, known), step) in bytes.iter_mut().zip(&self.0).zip(&block.costs) {
            *byte = u8::from(cost.wrapping_add(*step) < *known);
        }
        let (mut bits, mut shift) = (0, 0);
        for eight in bytes.as_chunks::<8>().0 {
            // The lowest bits of eight bytes, moved next to one another.
            let eight = u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            bits |= (eight as u32) << shift;
            shift += 8;
        }
        bits
    }
}

/// Where the states of a cell are kept that share a block of directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block(u32);

impl Block {
    /// The place of one of them.
    #[inline]
    pub(super) const fn place(self, within: u32) -> Place {
        Place(self.0 << BLOCK_BITS | within)
    }
}

/// The block of a place, and the place within it.
#[inline]
const fn split_place(Place(place): Place) -> (usize, usize) {
    ((place >> BLOCK_BITS) as usize, place as usize % BLOCK)
}

/// States with the best ways to them, in memory that is reused from search to search.
#[derive(Debug, Default)]
pub(super) struct Tree {
    generation: u32,
    cells: Vec<CellSlot>,
    /// Numbers of the cells that were reached.
    reached: Vec<u32>,
    /// By block, and within it by direction.
    costs: Vec<Costs>,
    parents: Vec<[Parent; BLOCK]>,
    stages: Vec<[Stage; BLOCK]>,
    used_blocks: usize,
    pub(super) open: OpenList,
}

impl Tree {
    /// Makes ready for a search on a grid.
    pub(super) fn prepare(&mut self, spec: &GridSpec) -> Result<(), Error> {
        spec.validate()?;
        if self.cells.len() != spec.len() || self.generation == u32::MAX {
            self.cells = zeroed_vec(spec.len());
            self.generation = 0;
        }
        self.generation += 1;
        self.reached.clear();
        // The first block stands for none.
        self.used_blocks = 1;
        self.reserve();
        self.open.clear();
        Ok(())
    }

    /// Becomes the same as another one on the same grid, in memory that was made ready for it.
    pub(super) fn copy(&mut self, other: &Self) {
        self.reached.clone_from(&other.reached);
        for &cell in &other.reached {
            let cell = cell as usize;
            self.cells[cell] = CellSlot {
                generation: self.generation,
                ..other.cells[cell]
            };
        }
        self.used_blocks = other.used_blocks;
        self.reserve();
        let used = ..other.used_blocks;
        self.costs[used].copy_from_slice(&other.costs[used]);
        self.parents[used].copy_from_slice(&other.parents[used]);
        self.stages[used].copy_from_slice(&other.stages[used]);
        self.open.copy(&other.open);
    }

    /// Makes sure that there are so many blocks as are used.
    fn reserve(&mut self) {
        let more = self.used_blocks.saturating_sub(self.costs.len());
        if more > 0 {
            // Pages that nothing is written to take no memory.
            let more_at_first = FIRST_BLOCKS.saturating_sub(self.costs.len()).max(more);
            self.costs.reserve(more_at_first);
            self.parents.reserve(more_at_first);
            self.stages.reserve(more_at_first);
            self.costs.resize(self.used_blocks, Costs::NONE);
            self.parents
                .resize(self.used_blocks, [Parent::START; BLOCK]);
            self.stages.resize(self.used_blocks, [Stage::New; BLOCK]);
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells of 2^3 blocks"
    )]
    #[cold]
    fn claim_block(&mut self, cell: usize, block: usize) -> Block {
        let number = self.used_blocks;
        self.used_blocks += 1;
        self.reserve();
        self.costs[number] = Costs::NONE;
        self.stages[number] = [Stage::New; BLOCK];
        self.cells[cell].blocks[block] = number as u32;
        Block(number as u32)
    }

    /// A block of a cell. If that was not reached before, `about` is asked about it.
    #[inline]
    pub(super) fn block(
        &mut self,
        cell: usize,
        block: usize,
        about: impl FnOnce(usize) -> About,
    ) -> Block {
        let slot = &mut self.cells[cell];
        if slot.generation != self.generation {
            *slot = CellSlot {
                generation: self.generation,
                about: about(cell),
                ..CellSlot::default()
            };
            self.reached.push(State::new(cell, 0).0 >> u8::BITS);
        }
        match slot.blocks[block] {
            NO_BLOCK => self.claim_block(cell, block),
            number => Block(number),
        }
    }

    /// A block of a cell, if a state in it may have been reached.
    #[inline]
    pub(super) fn find_block(&self, cell: usize, block: usize) -> Option<Block> {
        let slot = &self.cells[cell];
        let number = slot.blocks[block];
        (slot.generation == self.generation && number != NO_BLOCK).then_some(Block(number))
    }

    /// The place of a state. If its cell was not reached before, `about` is asked about it.
    #[inline]
    pub(super) fn place(&mut self, state: State, about: impl FnOnce(usize) -> About) -> Place {
        let (block, within) = state.split();
        self.block(state.cell(), block, about).place(within)
    }

    /// The place of a state that may not have been reached.
    #[inline]
    pub(super) fn find(&self, state: State) -> Option<Place> {
        let (block, within) = state.split();
        Some(self.find_block(state.cell(), block)?.place(within))
    }

    /// Which states of a block are come to at a lower cost, from one of cost `cost` behind what follows
    /// them; a bit for each.
    #[inline]
    pub(super) fn improved(&self, block: Block, (arrivals, cost): (&ArrivalBlock, u32)) -> u32 {
        self.costs[block.0 as usize].improved_by(cost, arrivals)
    }

    /// What is known of a cell that was reached.
    #[inline]
    pub(super) fn about(&self, cell: usize) -> &About {
        &self.cells[cell].about
    }

    /// Cost of the best way to a state, in units; `u32::MAX` if there is none yet.
    #[inline]
    pub(super) fn cost(&self, place: Place) -> u32 {
        let (block, within) = split_place(place);
        self.costs[block].0[within]
    }

    #[inline]
    pub(super) fn stage(&self, place: Place) -> Stage {
        let (block, within) = split_place(place);
        self.stages[block][within]
    }

    #[inline]
    pub(super) fn set_stage(&mut self, place: Place, stage: Stage) {
        let (block, within) = split_place(place);
        self.stages[block][within] = stage;
    }

    /// Notes a better way to a state.
    #[inline]
    pub(super) fn improve(&mut self, place: Place, cost: u32, parent: Parent) {
        let (block, within) = split_place(place);
        self.costs[block].0[within] = cost;
        self.parents[block][within] = parent;
    }

    /// Puts a state that was improved on the open list, unless its greatest key is not below `best`.
    /// From it at least `rest` is to come. One that is late gets its greatest key, and so do all
    /// once a path is known: what is left to find out is whether there is a better one.
    #[inline]
    pub(super) fn enqueue(
        &mut self,
        (state, place): (State, Place),
        weights: Weights,
        (cost, rest, is_late): (u32, u32, bool),
        best: Option<u32>,
    ) {
        let stage = self.stage(place);
        let greatest = weights.ceiling(u64::from(cost) + u64::from(rest));
        let key = if is_late || best.is_some() {
            greatest
        } else {
            weights.key(cost, rest, stage)
        };
        if stage == Stage::Expanded {
            self.set_stage(place, Stage::Improved);
        }
        if best.is_none_or(|best| greatest < best) {
            self.push(state, key);
        }
    }

    #[inline]
    pub(super) fn push(&mut self, state: State, key: u32) {
        self.open.push(u64::from(key) << 32 | u64::from(state.0));
    }

    /// Takes the state with the smallest key that is not expanded at its cost already, and that key.
    /// Ties go to the smaller cell number and then to the smaller direction.
    #[expect(clippy::cast_possible_truncation, reason = "both halves of a key are")]
    #[inline]
    pub(super) fn pop(&mut self) -> Option<(State, Place, u32)> {
        loop {
            let key = self.open.pop()?;
            let state = State(key as u32);
            let Some(place) = self.find(state) else {
                continue;
            };
            if matches!(self.stage(place), Stage::New | Stage::Improved) {
                return Some((state, place, (key >> 32) as u32));
            }
        }
    }

    /// Takes the state with the smallest key that is its cost and was not expanded, in the same order.
    #[expect(clippy::cast_possible_truncation, reason = "both halves of a key are")]
    #[inline]
    pub(super) fn pop_at_cost(&mut self) -> Option<(State, u32)> {
        loop {
            let key = self.open.pop()?;
            let (state, cost) = (State(key as u32), (key >> 32) as u32);
            let is_current =
                |place| self.cost(place) == cost && self.stage(place) != Stage::Expanded;
            if self.find(state).is_some_and(is_current) {
                return Some((state, cost));
            }
        }
    }

    /// For each cell that was reached: the least cost of its states that were not expanded, in units, and
    /// its number; nothing if there are none.
    pub(super) fn least_waiting(&self) -> impl Iterator<Item = Option<(u32, u32)>> {
        self.reached.iter().map(|&cell| {
            let blocks = self.cells[cell as usize].blocks.into_iter();
            let states = blocks.filter(|&block| block != NO_BLOCK).flat_map(|block| {
                let (costs, stages) = (&self.costs[block as usize].0, &self.stages[block as usize]);
                costs.iter().zip(stages)
            });
            let waiting = states.filter(|&(_, &stage)| stage != Stage::Expanded);
            let least = *waiting.map(|(cost, _)| cost).min()?;
            (least != u32::MAX).then_some((least, cell))
        })
    }

    /// How a state that was reached was reached.
    pub(super) fn parent(&self, state: State) -> Parent {
        self.find(state).map_or(Parent::START, |place| {
            let (block, within) = split_place(place);
            self.parents[block][within]
        })
    }
}

/// How keys are made of costs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    epsilon: u64,
    first: u64,
}

impl Weights {
    /// Keys for a bound ε and a weight w that is not greater, both from 1 to [`MAX_EPSILON`].
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "weights are at least 1 and bounded"
    )]
    pub(super) fn new(epsilon: f64, first: f64) -> Self {
        let fixed = |weight: f64| (weight.clamp(1.0, MAX_EPSILON) * WEIGHT_ONE) as u64;
        Self {
            epsilon: fixed(epsilon),
            first: fixed(first.min(epsilon)),
        }
    }

    /// The bound ε.
    pub(super) fn epsilon(self) -> f64 {
        self.epsilon as f64 / WEIGHT_ONE
    }

    /// The greatest cost of a path that is within the bound if the optimum is at least `least`.
    #[inline]
    pub(super) fn ceiling(self, least: u64) -> u32 {
        saturated((least * self.epsilon) >> WEIGHT_BITS)
    }

    /// The least optimum of which this may be a key.
    #[inline]
    pub(super) fn floor(self, key: u32) -> u32 {
        saturated((u64::from(key) << WEIGHT_BITS) / self.epsilon)
    }

    /// The key of a state of cost `cost`, from which at least `rest` is to come.
    #[inline]
    pub(super) fn key(self, cost: u32, rest: u32, stage: Stage) -> u32 {
        if stage == Stage::New {
            saturated(u64::from(cost) + ((u64::from(rest) * self.first) >> WEIGHT_BITS))
        } else {
            self.ceiling(u64::from(cost) + u64::from(rest))
        }
    }
}

#[inline]
fn saturated(key: u64) -> u32 {
    u32::try_from(key).unwrap_or(u32::MAX)
}
