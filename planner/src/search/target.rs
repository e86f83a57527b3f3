//! The search for one target of a frame: from the goal backward, until it meets ways from the vehicle.
//!
//! All targets start from the same vehicle, so one lower bound on the cost from the vehicle to a state
//! serves all these searches, and it may know of obstacles (see `distance`). A goal that cannot be
//! reached has few states before it, and running out of them is the proof.
//!
//! The bound is the sum of two. One is on length. The other is on turns: a path from the vehicle, heading
//! 0, to a heading θ at a bearing β turns by at least |0 − β| + |β − θ|, all taken the shorter way
//! around. For its turns sweep a range of headings [a, b] that holds 0 and θ and the direction of every
//! chord. If it is narrower than π it holds β, which is the direction of the chords' sum, and the sweep
//! passes it. Else the sweep goes to both ends: if b comes first it turns by b + (b − a) + (θ − a) ≥
//! 2π + θ, which is what 0 → β → θ takes by going left all the way; the other way around likewise.
//! Near the vehicle the cost is known exactly, and so is the least cost of whatever is not near.

use std::sync::OnceLock;

use swath_bridge::{GridSpec, Outcome};

use super::bound::{Aim, ROUNDING, parts_of_turn};
use super::distance::{Distances, NO_WAY};
use super::goal::Goal;
use super::known::Known;
use super::memory::{Parent, State};
use super::tree::{About, Block, Stage, Tree, Weights};
use super::trunk::Trunk;
use super::tube::Tube;
use super::{CellStep, Limits, SHORT_STOP_INTERVAL, TargetResult, floor_units, path};
use crate::Plane;
use crate::action::{ACTIONS, AHEAD};
use crate::collision::{CollisionMap, WORD};
use crate::motion::{ArrivalBlock, COST_UNITS, Successors};

/// Greatest cost of a state that is expanded, so that sums do not wrap: some 4 km, of which no step is
/// more than a thousandth.
const MOST_COST: u32 = u32::MAX - (u32::MAX >> 4);

/// What all targets of a frame share.
#[derive(Debug)]
pub(super) struct Shared<'a> {
    pub(super) map: &'a CollisionMap,
    pub(super) successors: &'a Successors,
    pub(super) steps_of: [CellStep; ACTIONS],
    pub(super) aims: &'a Aims,
    pub(super) distances: &'a Distances,
    pub(super) known: Known<'a>,
    /// By target: where its path is expected; empty if nothing is known of any.
    pub(super) regions: &'a [Option<Plane>],
}

impl Shared<'_> {
    /// What is known of a cell. It is asked for once a search, so it stays out of the way of what is not.
    #[inline(never)]
    fn about(&self, cell: usize) -> About {
        let cols = self.map.spec().cols as usize;
        let at = (cell / cols, cell % cols);
        let about = self.aims.about(self.map, at);
        About {
            length: about.length.max(self.distances.to(at)),
            beyond: self.known.least_beyond(at),
            ..about
        }
    }
}

/// Where cells and headings lie from the vehicle; the same for all maps of a grid.
#[derive(Debug, Default)]
pub(super) struct Aims {
    /// The grid that this is for.
    spec: Option<GridSpec>,
    /// By tile of the grid, once it is asked for: what is known of its cells.
    tiles: Vec<OnceLock<Box<[About]>>>,
    angles: Vec<u32>,
}

impl Aims {
    /// Makes sure that this is for the grid of a map.
    pub(super) fn prepare(&mut self, map: &CollisionMap) {
        let (spec, table) = (map.spec(), map.model().table());
        if self.spec == Some(*spec) {
            return;
        }
        self.spec = Some(*spec);
        let angle = |direction| parts_of_turn(table.angle_rad(direction));
        self.angles = (0..=u8::MAX).map(angle).collect();
        self.tiles.clear();
        self.tiles
            .resize_with(map.tiling().len(), OnceLock::default);
    }

    /// What is known of a cell.
    #[inline]
    fn about(&self, map: &CollisionMap, at: (usize, usize)) -> About {
        let tiling = map.tiling();
        let tile = tiling.tile_of(at);
        self.tiles[tile].get_or_init(|| about_tile(map, tile))[tiling.place_in_tile(at)]
    }
}

#[cold]
fn about_tile(map: &CollisionMap, tile: usize) -> Box<[About]> {
    let (spec, tiling) = (map.spec(), map.tiling());
    let ((first_row, first_col), (rows, cols)) = tiling.cells_of(tile);
    let mut cells = vec![About::default(); rows * tiling.padded_cols()].into_boxed_slice();
    for (row, of_row) in (first_row..).zip(cells.chunks_mut(tiling.padded_cols())) {
        for (col, to) in (first_col..first_col + cols).zip(of_row) {
            *to = about(spec, (row, col));
        }
    }
    cells
}

fn about(spec: &GridSpec, (row, col): (usize, usize)) -> About {
    let ego = spec.centre_of(spec.ego());
    let at = spec.centre_of(spec.cell_of_index(row * spec.cols as usize + col));
    let (x_m, y_m) = (at.0 - ego.0, at.1 - ego.1);
    let length = floor_units(libm::hypot(x_m, y_m));
    if length == 0 {
        // The way back to the vehicle's cell has no bearing; ahead asks for nothing.
        return About::default();
    }
    let bearing_rad = libm::atan2(y_m, x_m);
    let aim = Aim {
        bearing: parts_of_turn(bearing_rad),
        slack: ROUNDING,
        rest: floor_units(bearing_rad.abs()),
    };
    About {
        length,
        aim,
        ..About::default()
    }
}

/// What is known of the states of a cell in one block of directions.
struct Here {
    cell: usize,
    number: usize,
    block: Block,
    about: About,
    /// Where they are among the ways from the vehicle, if they may be there.
    near: Option<Block>,
    far: Option<Block>,
}

/// Where a path from a goal backward meets a way from the vehicle.
#[derive(Debug, Clone, Copy)]
struct Meeting<'a> {
    state: State,
    trunk: &'a Trunk,
}

/// How a search ended.
pub(super) struct End {
    /// What it found.
    pub(super) result: TargetResult,
    /// Whether that is as good as was asked for; else the limit came first.
    pub(super) is_decided: bool,
}

impl End {
    const fn decided(result: TargetResult) -> Self {
        Self {
            result,
            is_decided: true,
        }
    }
}

/// A search for one target.
pub(super) struct Search<'a> {
    shared: &'a Shared<'a>,
    tree: &'a mut Tree,
    weights: Weights,
    /// States outside are expanded as late as the bound allows.
    region: Option<&'a Plane>,
    /// States outside are left out.
    tube: Option<&'a Tube>,
    /// Cost of the best path so far, in units, and where it meets ways from the vehicle.
    best: Option<(u32, Meeting<'a>)>,
    steps: u64,
    /// Whether a state was not expanded because of its cost.
    is_cut_off: bool,
}

impl<'a> Search<'a> {
    /// A search in a tree that was prepared.
    pub(super) const fn new(shared: &'a Shared<'a>, weights: Weights, tree: &'a mut Tree) -> Self {
        Self {
            shared,
            tree,
            weights,
            region: None,
            tube: None,
            best: None,
            steps: 0,
            is_cut_off: false,
        }
    }

    /// The same, without states outside of a tube.
    pub(super) const fn within(self, tube: &'a Tube) -> Self {
        Self {
            tube: Some(tube),
            ..self
        }
    }

    /// Searches for the target of a number.
    pub(super) fn run(mut self, (number, goal): (usize, &Goal), limits: Limits<'_>) -> End {
        self.region = self.shared.regions.get(number).and_then(Option::as_ref);
        let mut least = NO_WAY;
        for state in goal.states() {
            let (number, within) = state.split();
            let block = self.block(state.cell(), number);
            let here = self.here((state.cell(), number), block);
            least = least.min(self.reach((&here, within), (0, Parent::START)));
        }
        // A path over the trunk's far states is good enough if it is within the bound of this bound.
        let far_enough = self.weights.ceiling(u64::from(least));
        let is_spread = self.shared.known.far.is_some();
        if let Some((_, meeting)) = self.best.filter(|best| is_spread && best.0 <= far_enough) {
            return End::decided(self.trace(meeting, least));
        }
        let mut dropped = 0u64;
        while let Some((state, place, key)) = self.tree.pop() {
            if self.best.is_some_and(|(cost, _)| key >= cost) {
                break;
            }
            if let Some(outcome) = limits.reached(self.steps, SHORT_STOP_INTERVAL) {
                return self.stopped(outcome, least.max(self.weights.floor(key)));
            }
            let cost = self.tree.cost(place);
            if let Some((best, _)) = self.best
                && self.greatest_key(state, cost) >= best
            {
                dropped += 1;
                if dropped.is_multiple_of(SHORT_STOP_INTERVAL)
                    && let Some(outcome) = limits.asked()
                {
                    return self.stopped(outcome, least.max(self.weights.floor(key)));
                }
                continue;
            }
            self.tree.set_stage(place, Stage::Expanded);
            self.steps += 1;
            self.expand(state, cost);
        }
        let least = self.best.map_or(0, |(cost, _)| self.weights.floor(cost));
        let without_path = if self.is_cut_off {
            Outcome::BudgetExhausted
        } else {
            Outcome::Unreachable
        };
        End::decided(self.so_far((without_path, least)))
    }

    fn stopped(&self, outcome: Outcome, least: u32) -> End {
        End {
            result: self.so_far((outcome, least)),
            is_decided: false,
        }
    }

    /// The best path so far where every path costs at least so much, or else an outcome.
    fn so_far(&self, (outcome, least): (Outcome, u32)) -> TargetResult {
        match self.best {
            Some((_, meeting)) => self.trace(meeting, least),
            None => TargetResult::without_path(outcome, self.steps),
        }
    }

    /// The path through a state where it meets the trunk, if every path costs at least so much.
    fn trace(&self, meeting: Meeting<'_>, least: u32) -> TargetResult {
        let (map, Meeting { mut state, trunk }) = (self.shared.map, meeting);
        let mut actions = path::actions_to(map, |state| trunk.parent(state), state);
        while let Some((action, _)) = self.tree.parent(state).step() {
            actions.push(action);
            let step = self.shared.steps_of[usize::from(action)];
            let cell = state.cell().wrapping_add_signed(step.offset as isize);
            state = State::new(cell, step.direction);
        }
        let path = path::along(map, &actions, self.steps);
        TargetResult {
            bound: (path.cost * COST_UNITS / f64::from(least.max(1))).max(1.0),
            ..path
        }
    }

    /// Reaches the states from which one action leads to a state.
    #[expect(clippy::cast_possible_truncation, reason = "there are 368 actions")]
    fn expand(&mut self, to: State, cost: u32) {
        let (map, successors) = (self.shared.map, self.shared.successors);
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        let (row, col) = (to.cell() / cols, to.cell() % cols);
        if cost > MOST_COST {
            self.is_cut_off = true;
            return;
        }
        for index in successors.actions_of(to.direction()) {
            let action = &map.model().table().actions()[index];
            let row = row.wrapping_add_signed(-action.d_row as isize);
            let col = col.wrapping_add_signed(-action.d_col as isize);
            if row >= rows || col >= cols {
                continue;
            }
            let chords = map.blocked_chords(index / WORD, (row, col));
            if chords >> (index % WORD) & 1 != 0 {
                continue;
            }
            let arrivals = successors.arrivals(index);
            let turnable = arrivals.turnable(|group| map.blocked_turns(group, (row, col)));
            for block in arrivals.blocks() {
                let allowed = block.allowed & turnable.of_block(block.number);
                if allowed != 0 {
                    let to = (row * cols + col, index as u16);
                    self.reach_block(to, (block, allowed), cost);
                }
            }
        }
    }

    /// Reaches those of a cell's headings in a block that are allowed before an action.
    fn reach_block(
        &mut self,
        (cell, action): (usize, u16),
        (arrivals, allowed): (&ArrivalBlock, u32),
        cost: u32,
    ) {
        let block = self.block(cell, arrivals.number);
        let mut improved = self.tree.improved(block, (arrivals, cost)) & allowed;
        if let Some(tube) = self.tube {
            improved &= tube.of_block(cell, arrivals.number);
        }
        if improved == 0 {
            return;
        }
        let here = self.here((cell, arrivals.number), block);
        while improved != 0 {
            let within = improved.trailing_zeros();
            improved &= improved - 1;
            let cost = cost + arrivals.costs[within as usize];
            self.reach((&here, within), (cost, Parent::new(action, 0)));
        }
    }

    /// The block of a cell with this number.
    #[inline]
    fn block(&mut self, cell: usize, number: usize) -> Block {
        let shared = self.shared;
        self.tree.block(cell, number, |cell| shared.about(cell))
    }

    /// What is known of a block's states.
    #[inline]
    fn here(&self, (cell, number): (usize, usize), block: Block) -> Here {
        let known = &self.shared.known;
        let about = *self.tree.about(cell);
        let is_near = about.length < known.near.radius();
        Here {
            cell,
            number,
            block,
            about,
            near: is_near.then(|| known.near.block(cell, number)).flatten(),
            far: known.far.and_then(|far| far.block(cell, number)),
        }
    }

    /// The greatest key of a state on the open list that was reached at a cost.
    fn greatest_key(&self, state: State, cost: u32) -> u32 {
        let about = self.tree.about(state.cell());
        let rest = self.least(about, state.direction());
        self.weights.ceiling(u64::from(cost) + u64::from(rest))
    }

    /// Lower bound on the cost from the vehicle to a state that is not near it, in units; [`NO_WAY`] if
    /// there is none.
    #[inline]
    fn least(&self, about: &About, direction: u8) -> u32 {
        if about.length == NO_WAY {
            return NO_WAY;
        }
        let angle = self.shared.aims.angles[usize::from(direction)];
        let turns = about.aim.rest + about.aim.least_off(angle);
        about.length.saturating_add(turns).max(about.beyond)
    }

    /// Reaches a state at a lower cost than before. Gives the lower bound on what is before it.
    #[inline]
    fn reach(&mut self, (here, within): (&Here, u32), (cost, parent): (u32, Parent)) -> u32 {
        let place = here.block.place(within);
        let to = State::in_block(here.cell, here.number, within);
        self.tree.improve(place, cost, parent);
        let Known { near, far, .. } = self.shared.known;
        if let Some(block) = here.near
            && let Some(exact) = near.exact_cost(block.place(within))
        {
            // What comes before this state is known to be no better.
            self.meet((to, near), cost.saturating_add(exact));
            return exact;
        }
        let rest = self.least(&here.about, to.direction());
        if rest == NO_WAY {
            return NO_WAY;
        }
        if let (Some(far), Some(block)) = (far, here.far)
            && let Some(way) = far.far_cost(block.place(within))
        {
            self.meet((to, far), cost.saturating_add(way));
        }
        let best = self.best.map(|(best, _)| best);
        let is_late = match self.region {
            Some(region) => !region.get_index(to.cell()),
            // What short searches leave is decided by what can be ruled out, not by what is found first.
            None => far.is_some(),
        };
        self.tree
            .enqueue((to, place), self.weights, (cost, rest, is_late), best);
        rest
    }

    /// Takes note of a path through a state.
    #[inline]
    fn meet(&mut self, (state, trunk): (State, &'a Trunk), cost: u32) {
        if self.best.is_none_or(|(best, _)| cost < best) {
            self.best = Some((cost, Meeting { state, trunk }));
        }
    }
}

const _: () = assert!(AHEAD == 0, "turns are counted from the direction ahead");
