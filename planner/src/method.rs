//! The methods of planning, by name.

use serde::{Deserialize, Serialize};

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's A*, optimal on its graph.
    Tiev,
    /// The same inside a predicted region (the paper's Algorithm 1).
    TievFcn,
    /// Weighted A*, within a factor of the optimum; no network.
    Weighted,
    /// All targets together, within the same factor; no network.
    Swath,
    /// Hybrid A* with arcs.
    Hybrid,
    /// The same inside a predicted region.
    HybridFcn,
    /// RRT* with Dubins drives.
    RrtStar,
    /// The same with poses drawn from a predicted region.
    RrtStarFcn,
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 8] = [
        Self::Tiev,
        Self::TievFcn,
        Self::Weighted,
        Self::Swath,
        Self::Hybrid,
        Self::HybridFcn,
        Self::RrtStar,
        Self::RrtStarFcn,
    ];

    /// The methods that are compared unless others are named.
    pub const COMPARED: [Self; 4] = [Self::Tiev, Self::TievFcn, Self::Weighted, Self::Swath];

    /// The name used on the command line, in JSON and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiev => "tiev",
            Self::TievFcn => "tiev-fcn",
            Self::Weighted => "weighted",
            Self::Swath => "swath",
            Self::Hybrid => "hybrid",
            Self::HybridFcn => "hybrid-fcn",
            Self::RrtStar => "rrt-star",
            Self::RrtStarFcn => "rrt-star-fcn",
        }
    }

    /// The method of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether it needs regions.
    pub const fn needs_regions(self) -> bool {
        matches!(self, Self::TievFcn | Self::HybridFcn | Self::RrtStarFcn)
    }

    /// The same planner without a region; itself if it needs none.
    #[must_use]
    pub const fn without_regions(self) -> Self {
        match self {
            Self::TievFcn => Self::Tiev,
            Self::HybridFcn => Self::Hybrid,
            Self::RrtStarFcn => Self::RrtStar,
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_keep_their_names_and_their_twins() {
        for method in Method::ALL {
            assert_eq!(Method::from_name(method.name()), Some(method));
            assert!(!method.without_regions().needs_regions());
            let is_same = method.without_regions() == method;
            assert_eq!(is_same, !method.needs_regions());
        }
    }
}
