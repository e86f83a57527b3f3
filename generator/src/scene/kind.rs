//! The kinds of scenes of the default mix.

use serde::{Deserialize, Serialize};

/// A kind of procedural scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneKind {
    /// A straight road.
    Straight,
    /// A road with one bend.
    Curved,
    /// A road with bends to either side.
    #[serde(rename = "s-shaped")]
    SShaped,
    /// An intersection: left, right or straight on.
    Turn,
    /// An alley, gates, walls across or roadworks.
    Narrow,
    /// A parking lot.
    Parking,
    /// Open ground with things on it.
    Clutter,
}

impl SceneKind {
    /// Every kind, in the order in which they take turns.
    pub const ALL: [Self; 7] = [
        Self::Straight,
        Self::Curved,
        Self::SShaped,
        Self::Turn,
        Self::Narrow,
        Self::Parking,
        Self::Clutter,
    ];

    /// The kind of the scene at an index where `kinds` take turns: equal shares in any run of scenes.
    pub fn of_index(kinds: &[Self], index: u64) -> Self {
        let turn = usize::try_from(index % kinds.len().max(1) as u64).unwrap_or(0);
        kinds.get(turn).copied().unwrap_or(Self::Straight)
    }

    /// The name in samples, reports and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Straight => "straight",
            Self::Curved => "curved",
            Self::SShaped => "s-shaped",
            Self::Turn => "turn",
            Self::Narrow => "narrow",
            Self::Parking => "parking",
            Self::Clutter => "clutter",
        }
    }
}
