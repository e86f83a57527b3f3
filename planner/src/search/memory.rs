//! The memory of a search, reused from one to the next: states by cell, and the open list.

use swath_bridge::GridSpec;

use crate::Error;
use crate::action::DIRECTIONS;

/// A cell and a direction, as one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct State(u32);

impl State {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    pub(super) const fn new(cell: usize, direction: u8) -> Self {
        Self((cell as u32) << 8 | direction as u32)
    }

    pub(super) const fn cell(self) -> usize {
        (self.0 >> 8) as usize
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the low byte is the direction"
    )]
    pub(super) const fn direction(self) -> u8 {
        self.0 as u8
    }
}

/// What is known of a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Cost of the best way here, in units; `u32::MAX` if there is none yet.
    pub(super) cost: u32,
    /// Action of the lookup table that led here.
    pub(super) action: u16,
    /// Direction before this action.
    pub(super) from_direction: u8,
    closed: bool,
}

impl Node {
    const UNREACHED: Self = Self {
        cost: u32::MAX,
        action: 0,
        from_direction: 0,
        closed: false,
    };

    pub(super) const fn start() -> Self {
        Self {
            cost: 0,
            ..Self::UNREACHED
        }
    }

    pub(super) const fn reached(cost: u32, action: u16, from_direction: u8) -> Self {
        Self {
            cost,
            action,
            from_direction,
            closed: false,
        }
    }
}

/// The states of one cell.
type Block = [Node; DIRECTIONS];

/// Memory of a search. Cells are claimed when they are first reached, so that starting a search costs
/// nothing and memory grows with the cells reached: 2 KiB each, at most all of the grid's.
#[derive(Debug, Default)]
pub struct SearchMemory {
    /// Number of the running search.
    generation: u32,
    /// By cell: the search that claimed it, its block, and its heuristic in units.
    cells: Vec<CellSlot>,
    blocks: Vec<Block>,
    used_blocks: usize,
    open: OpenList,
}

#[derive(Debug, Clone, Copy, Default)]
struct CellSlot {
    generation: u32,
    block: u32,
    estimate: u32,
}

impl SearchMemory {
    /// Memory that grows with its first searches.
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes ready for a search on a grid.
    pub(super) fn prepare(&mut self, spec: &GridSpec) -> Result<(), Error> {
        spec.validate()?;
        if self.cells.len() != spec.len() || self.generation == u32::MAX {
            self.cells.clear();
            self.cells.resize(spec.len(), CellSlot::default());
            self.generation = 0;
        }
        self.generation += 1;
        self.used_blocks = 0;
        self.open.clear();
        Ok(())
    }

    pub(super) fn is_claimed(&self, cell: usize) -> bool {
        self.cells[cell].generation == self.generation
    }

    /// Gives a cell a block of unreached states.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "there are at most as many blocks as cells"
    )]
    pub(super) fn claim(&mut self, cell: usize, estimate: u32) {
        if self.used_blocks == self.blocks.len() {
            self.blocks.push([Node::UNREACHED; DIRECTIONS]);
        } else {
            self.blocks[self.used_blocks].fill(Node::UNREACHED);
        }
        let block = self.used_blocks as u32;
        self.cells[cell] = CellSlot {
            generation: self.generation,
            block,
            estimate,
        };
        self.used_blocks += 1;
    }

    /// A state of a claimed cell.
    pub(super) fn node(&self, state: State) -> &Node {
        let block = self.cells[state.cell()].block as usize;
        &self.blocks[block][usize::from(state.direction())]
    }

    /// A state of a claimed cell.
    pub(super) fn node_mut(&mut self, state: State) -> &mut Node {
        let block = self.cells[state.cell()].block as usize;
        &mut self.blocks[block][usize::from(state.direction())]
    }

    /// Puts a state of a claimed cell on the open list.
    pub(super) fn push(&mut self, state: State, cost: u32) {
        let total = cost.saturating_add(self.cells[state.cell()].estimate);
        self.open.push(u64::from(total) << 32 | u64::from(state.0));
    }

    /// Takes the state with the smallest total from the open list and closes it. Ties go to the
    /// smaller cell number (farther ahead, then farther left) and then to the smaller direction.
    #[expect(clippy::cast_possible_truncation, reason = "the low half is the state")]
    pub(super) fn pop(&mut self) -> Option<State> {
        loop {
            let state = State(self.open.pop()? as u32);
            let node = self.node_mut(state);
            // An improved state is pushed again; what was pushed before comes later and is stale.
            if !node.closed {
                node.closed = true;
                return Some(state);
            }
        }
    }
}

/// A four-way heap of keys, smallest first.
#[derive(Debug, Default)]
struct OpenList {
    keys: Vec<u64>,
}

impl OpenList {
    fn clear(&mut self) {
        self.keys.clear();
    }

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
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_open_list_gives_keys_in_order(keys in proptest::collection::vec(any::<u64>(), 0..300)) {
            let mut open = OpenList::default();
            let mut sorted = keys.clone();
            sorted.sort_unstable();
            for key in keys {
                open.push(key);
            }
            let popped: Vec<u64> = std::iter::from_fn(|| open.pop()).collect();
            prop_assert_eq!(popped, sorted);
        }
    }

    #[test]
    fn claimed_cells_are_forgotten_by_the_next_search() {
        let spec = GridSpec {
            rows: 4,
            cols: 4,
            ego_row: 0,
            ego_col: 0,
            ..GridSpec::default()
        };
        let mut memory = SearchMemory::new();
        memory.prepare(&spec).unwrap();
        memory.claim(3, 7);
        memory.node_mut(State::new(3, 9)).cost = 1;
        memory.prepare(&spec).unwrap();
        assert!(!memory.is_claimed(3));
        memory.claim(3, 7);
        assert_eq!(memory.node(State::new(3, 9)).cost, u32::MAX);
        assert_eq!(memory.blocks.len(), 1, "blocks are reused");
    }
}
