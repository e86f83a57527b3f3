//! The paths of a frame made drivable, in parallel.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use swath_bridge::{Outcome, Vehicle};

use super::FrameInput;
use crate::Error;
use crate::plan::TargetPlan;
use crate::pool::Pool;
use crate::smooth::{DrivablePath, ObstacleCells, SmoothConfig, SmoothRequest, Smoother};

/// How the paths of a frame are to be driven.
#[derive(Clone, Copy)]
pub(super) struct Drive<'a> {
    pub(super) vehicle: &'a Vehicle,
    pub(super) config: &'a SmoothConfig,
    pub(super) speed_m_per_s: f64,
    /// Numbers of the targets, most useful first.
    pub(super) order: &'a [usize],
    /// Whether the deadline has passed by so much.
    pub(super) is_late: &'a (dyn Fn(Duration) -> bool + Sync),
}

/// The first path may be late by so much: some path is better than none.
const GRACE: Duration = Duration::from_millis(1);

/// Gives every solved target that there is time for its drivable path; in the vehicle's frame.
///
/// # Errors
/// Those of [`Smoother::new`] and [`ObstacleCells::new`].
pub(super) fn make_drivable(
    pool: &Pool<Option<Smoother>>,
    input: &FrameInput<'_>,
    targets: &mut [TargetPlan],
    drive: Drive<'_>,
) -> Result<(), Error> {
    let is_solved = |&&number: &&usize| targets[number].result.outcome == Outcome::Solved;
    let order: Vec<usize> = drive.order.iter().filter(is_solved).copied().collect();
    if order.is_empty() {
        return Ok(());
    }
    let cells = ObstacleCells::new(input.spec, input.obstacles)?;
    let next = AtomicUsize::new(0);
    let work = |_: usize| {
        pool.with(|slot: &mut Option<Smoother>| {
            let fits = |smoother: &Smoother| smoother.config() == drive.config;
            let smoother = match slot.take().filter(fits) {
                Some(smoother) => slot.insert(smoother),
                None => slot.insert(Smoother::new(drive.vehicle, *drive.config)?),
            };
            let mut paths = Vec::new();
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(&number) = order.get(index) else {
                    break;
                };
                let grace = if index == 0 { GRACE } else { Duration::ZERO };
                let stop = || (drive.is_late)(grace);
                if stop() {
                    break;
                }
                let path = smooth(smoother, &cells, (input, &targets[number]), (&drive, &stop));
                paths.push((number, path));
            }
            Ok(paths)
        })
    };
    let threads = rayon::current_num_threads().min(order.len());
    let paths: Result<Vec<_>, Error> = (0..threads).into_par_iter().map(work).collect();
    for (number, path) in paths?.into_iter().flatten() {
        targets[number].drivable = Some(path);
    }
    Ok(())
}

fn smooth(
    smoother: &mut Smoother,
    cells: &ObstacleCells,
    (input, target): (&FrameInput<'_>, &TargetPlan),
    (drive, stop): (&Drive<'_>, &(dyn Fn() -> bool + Sync)),
) -> DrivablePath {
    smoother.smooth(
        cells,
        &SmoothRequest {
            chords: &target.result.path,
            goal: target.goal,
            speed_m_per_s: drive.speed_m_per_s,
            start_curvature_per_m: input.start.curvature_per_m,
            stop: Some(stop),
        },
    )
}
