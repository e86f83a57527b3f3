//! Maps made in code, for tests and benches: the same on every machine.

#![expect(unreachable_pub, reason = "a module that is part of several programs")]

use swath_bridge::{Cell, GridSpec, Pose2};
use swath_planner::Plane;

/// A map with targets on it.
#[derive(Debug)]
pub struct Scene {
    /// What tests and benches call it.
    pub name: &'static str,
    /// Its occupied cells.
    pub obstacles: Plane,
    /// Fifty targets; some of them cannot be reached.
    pub goals: Vec<Pose2>,
}

/// Every scene, on the default grid.
pub fn all() -> Vec<Scene> {
    vec![open_road(), lot(), slalom()]
}

/// A road of three lanes with a vehicle in each, some way ahead.
pub fn open_road() -> Scene {
    let mut scene = Scene::empty("open road");
    scene.block((-20.0, 60.0), (6.4, 6.8));
    scene.block((-20.0, 60.0), (-6.8, -6.4));
    scene.block((18.0, 22.4), (-1.0, 0.8));
    scene.block((31.0, 35.4), (2.6, 4.4));
    scene.block((44.0, 48.4), (-4.6, -2.8));
    scene.add_goals((8.0, 5.0), (-4.0, 2.0));
    scene
}

/// Rows of parked vehicles to both sides of an aisle, with gaps.
pub fn lot() -> Scene {
    let mut scene = Scene::empty("lot");
    for bay in 0..20u32 {
        let x_m = -18.0 + 3.8 * f64::from(bay);
        for (row, y_m) in [-13.0, -6.8, 5.0, 10.6].into_iter().enumerate() {
            // Some bays are empty, one after another in each row.
            if (bay as usize + 2 * row) % 5 != 4 {
                scene.block((x_m, x_m + 1.8), (y_m, y_m + 4.2));
            }
        }
    }
    scene.block((36.0, 40.0), (-1.0, 0.4));
    scene.add_goals((8.0, 5.0), (-6.0, 3.0));
    scene
}

/// Walls with a gap, alternately left and right.
pub fn slalom() -> Scene {
    let mut scene = Scene::empty("slalom");
    for gate in 0..4u32 {
        let x_m = 10.0 + 12.0 * f64::from(gate);
        let sides = if gate % 2 == 0 {
            (-15.2, 2.0)
        } else {
            (-2.0, 15.2)
        };
        scene.block((x_m, x_m + 0.4), sides);
    }
    scene.add_goals((8.0, 5.0), (-6.0, 3.0));
    scene
}

impl Scene {
    fn empty(name: &'static str) -> Self {
        let spec = GridSpec::default();
        Self {
            name,
            obstacles: Plane::empty(spec.rows, spec.cols),
            goals: Vec::new(),
        }
    }

    /// Occupies the cells whose centres lie in a rectangle of the vehicle frame, metres.
    fn block(&mut self, x_m: (f64, f64), y_m: (f64, f64)) {
        let spec = GridSpec::default();
        let first = spec.cell_at(x_m.1, y_m.1);
        let last = spec.cell_at(x_m.0, y_m.0);
        for row in first.row..=last.row {
            for col in first.col..=last.col {
                self.obstacles.set(Cell::new(row, col));
            }
        }
    }

    /// Ten rows of five targets; of each (nearest, step) the first is along and the second across.
    fn add_goals(&mut self, along_m: (f64, f64), across_m: (f64, f64)) {
        for row in 0..10u32 {
            for column in 0..5u32 {
                let x_m = along_m.0 + along_m.1 * f64::from(row);
                let y_m = across_m.0 + across_m.1 * f64::from(column);
                let yaw_rad = 0.1 * f64::from((row + column) % 5) - 0.2;
                self.goals.push(Pose2::new(x_m, y_m, yaw_rad));
            }
        }
    }
}
