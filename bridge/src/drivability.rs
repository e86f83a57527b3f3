//! How far a planned path can be driven.

use serde::{Deserialize, Serialize};

/// How far a path can be driven as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drivability {
    /// Not at all: these are the chords, which turn on the spot.
    TurnsOnTheSpot,
    /// By the vehicle at its speed.
    AtSpeed,
    /// By the vehicle, but more slowly: it bends more than the speed allows.
    Slower,
    /// By no such vehicle: it is continuous and hits nothing, but bends more than the vehicle can.
    TooTight,
}

impl Drivability {
    /// All of them, in the order of their codes.
    pub const ALL: [Self; 4] = [
        Self::TurnsOnTheSpot,
        Self::AtSpeed,
        Self::Slower,
        Self::TooTight,
    ];

    /// The code in `swath_msgs/TargetPlan`.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// What a code stands for, if it does.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The name used in tables, that of the constant in `swath_msgs/TargetPlan`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::TurnsOnTheSpot => "chords",
            Self::AtSpeed => "at_speed",
            Self::Slower => "slower",
            Self::TooTight => "too_tight",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_drivabilities_are_one_to_one() {
        for (code, drivability) in (0..).zip(Drivability::ALL) {
            assert_eq!(drivability.code(), code);
            assert_eq!(Drivability::from_code(code), Some(drivability));
        }
        assert_eq!(Drivability::from_code(4), None);
    }
}
