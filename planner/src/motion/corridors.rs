//! Which straight drives pass near a cell: sixteen sectors of headings, and the cells that the vehicle
//! covers with any heading of a part of one.
//!
//! A chord of the lookup table leads from centre to centre. It is a sum of two of the sixteen shortest
//! steps (straight, diagonal, knight's move), those to either side of its direction, and they can be
//! ordered so that no centre passed on the way lies farther than half a cell from the chord. There, the
//! vehicle made narrower by as much on both sides lies within the vehicle on the chord. So where a chord
//! is free, so are the narrower vehicles of its heading along those steps.

use swath_bridge::{Pose2, Vehicle};

use crate::action::{Action, ActionTable};
use crate::kernel::Kernel;

/// Number of shortest steps, and of sectors between them.
pub(crate) const SECTORS: usize = 16;
/// Parts of a sector: more find narrower gaps closed, and cost time.
const PARTS: usize = 4;
/// Width that the vehicle loses to each side, cells: half a cell and some for rounding.
const NARROWER_CELLS: f64 = 0.55;

/// The shortest steps and the cells covered between them.
#[derive(Debug, Default)]
pub(crate) struct Corridors {
    /// The steps' rows and columns, counter-clockwise from straight ahead.
    pub(crate) steps: Vec<(i32, i32)>,
    /// Covered by every heading of a part of a sector; the sector from a step to the next one.
    pub(crate) parts: Vec<(usize, Kernel)>,
}

impl Corridors {
    pub(super) fn new(vehicle: &Vehicle, resolution_m: f64, table: &ActionTable) -> Self {
        let is_short = |action: &&Action| action.d_row.abs().max(action.d_col.abs()) <= 2;
        let short: Vec<&Action> = table.actions().iter().filter(is_short).collect();
        let mut corridors = Self {
            steps: short.iter().map(|step| (step.d_row, step.d_col)).collect(),
            parts: Vec::new(),
        };
        let narrower = Vehicle {
            half_width_m: vehicle.half_width_m - NARROWER_CELLS * resolution_m,
            ..*vehicle
        };
        if narrower.half_width_m <= 0.0 {
            return corridors;
        }
        for (sector, step) in short.iter().enumerate() {
            let next = short.get(sector + 1);
            let end = next.map_or(256, |next| usize::from(next.direction));
            let headings: Vec<u8> = (step.direction..=u8::MAX)
                .take(end - usize::from(step.direction))
                .collect();
            for part in headings.chunks(headings.len().div_ceil(PARTS)) {
                let covered = part
                    .iter()
                    .map(|&heading| {
                        let pose = Pose2::new(0.0, 0.0, table.angle_rad(heading));
                        Kernel::of_pose(&narrower, resolution_m, &pose)
                    })
                    .reduce(|all, next| all.intersection(&next));
                corridors
                    .parts
                    .extend(covered.map(|covered| (sector, covered)));
            }
        }
        corridors
    }
}
