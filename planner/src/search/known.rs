//! What is known of ways from the vehicle, for all targets of a frame: trunks of real ways, and bounds on
//! the costs of all others.

use super::distance::Distances;
use super::trunk::Trunk;
use crate::collision::CollisionMap;
use crate::motion::Successors;

/// What is known of ways from the vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a> {
    /// Near it, exactly.
    pub(super) near: &'a Trunk,
    /// Lower bounds on the costs of all other states, if they were measured.
    pub(super) beyond: Option<&'a Distances>,
    /// Some ways farther off, if there are any yet.
    pub(super) far: Option<&'a Trunk>,
}

impl<'a> Known<'a> {
    /// What is known at first.
    pub(super) const fn near(near: &'a Trunk) -> Self {
        Self {
            near,
            beyond: None,
            far: None,
        }
    }

    /// Lower bound on the cost of a state on a cell that is not near, in units; [`NO_WAY`] if there is no
    /// way to one.
    pub(super) fn least_beyond(&self, at: (usize, usize)) -> u32 {
        let measured = self.beyond.map_or(0, |beyond| beyond.to(at));
        measured.max(self.near.radius())
    }
}

/// Ways from the vehicle that all targets share, as far as a frame needs them.
#[derive(Debug, Default)]
pub(super) struct Trunks {
    pub(super) near: Trunk,
    /// The same, and some ways farther off.
    pub(super) far: Trunk,
    /// The same as `near`, and as exact farther off.
    pub(super) wide: Trunk,
    /// What everything outside of `wide` costs at least.
    beyond: Distances,
    /// Where `wide` ends.
    rim: Vec<(u32, u32)>,
}

impl Trunks {
    /// Makes the far trunk look closer and the wide one go on, by at most so many expansions, and measures
    /// from where that ends. False if it was stopped.
    pub(super) fn go_on(
        &mut self,
        (map, successors): (&CollisionMap, &Successors),
        (left, distances): (&[usize], &Distances),
        ((closer, wide), stop): ((u64, u64), &(dyn Fn() -> bool + Sync)),
    ) -> bool {
        let ((), is_measured) = rayon::join(
            || self.far.spread((map, successors), left, (closer, stop)),
            || {
                self.wide.grow_on((map, successors), (wide, stop))
                    && self.wide.rim(&mut self.rim, stop)
                    && (self.beyond).measure_beyond((map, distances), &mut self.rim, stop)
            },
        );
        is_measured
    }

    /// All that is known then.
    pub(super) const fn known(&self) -> Known<'_> {
        Known {
            near: &self.wide,
            beyond: Some(&self.beyond),
            far: Some(&self.far),
        }
    }

    /// Expansions of all.
    pub(super) const fn steps(&self) -> u64 {
        self.far.steps() + self.wide.steps() - self.near.steps()
    }
}
