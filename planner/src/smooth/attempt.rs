//! How a path is smoothed at first, and how when that fails.

use super::cost::Weights;

/// Gap below which nearness counts as contact while a path is improved, metres.
const NEEDED_GAP_M: f64 = 0.03;
/// Contact and a missed goal weigh so much at first, and more in each further round.
const FIRST_CONTACT: f64 = 100.0;

/// How one attempt weighs things.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attempt {
    /// Weight of metres from the goal, squared, and of radians.
    off_goal: f64,
    turned_from_goal: f64,
    stray: f64,
    /// Share of the gap that is preferred.
    pub(super) gap_share: f64,
}

impl Attempt {
    /// Whether it is to end at the goal itself.
    pub(super) fn is_for_goal(&self) -> bool {
        self.off_goal >= FIRST_CONTACT
    }

    /// What a path is judged by at first.
    pub(super) const fn weights(&self, preferred_gap_m: f64) -> Weights {
        Weights {
            bend: 1.0,
            steer: 1.0,
            stray: self.stray,
            length: 0.05,
            near: 1.0,
            preferred_gap_m,
            contact: FIRST_CONTACT,
            needed_gap_m: NEEDED_GAP_M,
            goal: FIRST_CONTACT,
            off_goal: self.off_goal,
            turned_from_goal: self.turned_from_goal,
        }
    }
}

/// First to the goal itself, then with room to shorten and straighten, then close to the chords.
pub(super) const ATTEMPTS: [Attempt; 3] = [
    Attempt {
        off_goal: 100.0,
        turned_from_goal: 200.0,
        stray: 0.02,
        gap_share: 1.0,
    },
    Attempt {
        off_goal: 0.2,
        turned_from_goal: 0.2,
        stray: 0.02,
        gap_share: 1.0,
    },
    Attempt {
        off_goal: 0.02,
        turned_from_goal: 0.02,
        stray: 1.0,
        gap_share: 0.4,
    },
];
