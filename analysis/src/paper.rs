//! The figures that the paper states, to stand beside ours. They were taken on a GTX 1060 and a
//! quad-core i7, so ratios compare and times do not.

/// A row of the paper's table of target numbers. Times in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetCountRow {
    /// Number of targets.
    pub targets: u32,
    /// Time of TiEV A*.
    pub tiev_ms: f64,
    /// Targets that TiEV A* reached.
    pub tiev_solved: u32,
    /// Time of the improved TiEV A*, the network's time not included.
    pub fcn_ms: f64,
    /// Targets that the improved TiEV A* reached.
    pub fcn_solved: u32,
    /// Time of the network.
    pub network_ms: f64,
}

impl TargetCountRow {
    const fn new(targets: u32, tiev: (f64, u32), fcn: (f64, u32), network_ms: f64) -> Self {
        Self {
            targets,
            tiev_ms: tiev.0,
            tiev_solved: tiev.1,
            fcn_ms: fcn.0,
            fcn_solved: fcn.1,
            network_ms,
        }
    }

    /// Time of the improved TiEV A* by that of TiEV A*.
    pub fn ratio(&self) -> f64 {
        self.fcn_ms / self.tiev_ms
    }
}

/// The paper's table of target numbers.
pub const TARGET_COUNTS: [TargetCountRow; 9] = [
    TargetCountRow::new(1, (29.128, 1), (15.431, 1), 16.32),
    TargetCountRow::new(3, (98.871, 3), (54.446, 3), 17.85),
    TargetCountRow::new(7, (212.849, 7), (118.947, 7), 19.16),
    TargetCountRow::new(10, (295.527, 10), (176.991, 10), 20.42),
    TargetCountRow::new(15, (521.167, 15), (288.653, 15), 24.08),
    TargetCountRow::new(20, (595.910, 20), (363.247, 20), 26.92),
    TargetCountRow::new(30, (1027.837, 30), (594.900, 30), 32.69),
    TargetCountRow::new(40, (1602.486, 38), (978.453, 40), 35.00),
    TargetCountRow::new(50, (2026.185, 49), (992.514, 50), 39.28),
];

/// Expansions of TiEV A* to one target.
pub const TIEV_STEPS: f64 = 73_224.0;
/// Expansions of the improved TiEV A* to one target.
pub const FCN_STEPS: f64 = 34_675.0;
/// Mean intersection over union of the paper's network, over 2000 test samples.
pub const MIOU: f64 = 0.9019;
/// Samples of the paper's test split.
pub const TEST_SAMPLES: u64 = 2000;

/// The name of the paper's TiEV A* here.
pub const TIEV: &str = "tiev";
/// The name of the paper's improved TiEV A* here.
pub const TIEV_FCN: &str = "tiev-fcn";

/// The paper's row of a number of targets, if it has one.
pub fn target_count(targets: u32) -> Option<&'static TargetCountRow> {
    TARGET_COUNTS.iter().find(|row| row.targets == targets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_those_that_the_paper_speaks_of() {
        let one = target_count(1).unwrap();
        assert!((one.ratio() - 0.53).abs() < 0.005);
        assert!((FCN_STEPS / TIEV_STEPS - 0.47).abs() < 0.005);
        assert!((target_count(50).unwrap().ratio() - 0.49).abs() < 0.005);
        assert!(target_count(2).is_none());
    }
}
