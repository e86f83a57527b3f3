//! Plans to two goals around a wall, as a library: the example of the README.

#![expect(clippy::print_stdout, reason = "what an example finds is printed")]

use std::sync::Arc;

use swath_bridge::{GridSpec, Pose2, Vehicle};
use swath_planner::{FrameInput, FramePlanner, MotionModel, PlanConfig, Plane, Start};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spec = GridSpec::default();
    let mut obstacles = Plane::empty(spec.rows, spec.cols);
    // A wall across the way, 20 m ahead.
    for step in 0..60 {
        obstacles.set(spec.cell_at(20.0, -4.0 + 0.2 * f64::from(step)));
    }
    let goals = [Pose2::new(40.0, 0.0, 0.0), Pose2::new(35.0, 5.0, 0.3)];
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &[],
        goals: &goals,
        start: Start::default(),
    };
    let model = Arc::new(MotionModel::new(&Vehicle::default(), spec.resolution_m)?);
    let plan = FramePlanner::new(model).plan(&input, None, &PlanConfig::default())?;
    for target in &plan.targets {
        let path = target.poses();
        println!("{:?}: {} poses", target.result.outcome, path.len());
    }
    Ok(())
}
