//! The paths of a frame made drivable, in parallel.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use swath_bridge::{Outcome, Vehicle};

use super::FrameInput;
use crate::Error;
use crate::plan::TargetPlan;
use crate::pool::Pool;
use crate::smooth::{ObstacleCells, SmoothConfig, SmoothRequest, Smoother};
use crate::tolerance::GoalTolerance;

/// How the paths of a frame are to be driven.
#[derive(Clone, Copy)]
pub(super) struct Drive<'a> {
    pub(super) vehicle: &'a Vehicle,
    pub(super) config: &'a SmoothConfig,
    pub(super) speed_m_per_s: f64,
    pub(super) tolerance: GoalTolerance,
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
    let on = (input, &drive);
    // What takes long waits until all that takes little is done.
    let at_once = in_order(pool, drive, &order, |smoother, &number, stop| {
        (
            number,
            smoother.smooth_at_once(&cells, &request_for(on, &targets[number], stop)),
        )
    })?;
    let (mut paths, mut hard) = (Vec::new(), Vec::new());
    for (number, path) in at_once {
        match path {
            Ok(path) => paths.push((number, path)),
            Err(tried) => hard.push((number, tried)),
        }
    }
    paths.extend(in_order(
        pool,
        drive,
        &hard,
        |smoother, &(number, tried), stop| {
            (
                number,
                smoother.smooth_at_length(&cells, &request_for(on, &targets[number], stop), tried),
            )
        },
    )?);
    for (number, path) in paths {
        targets[number].drivable = Some(path);
    }
    Ok(())
}

fn request_for<'a>(
    (input, drive): (&'a FrameInput<'_>, &Drive<'_>),
    target: &'a TargetPlan,
    stop: &'a (dyn Fn() -> bool + Sync),
) -> SmoothRequest<'a> {
    SmoothRequest {
        chords: &target.result.path,
        goal: target.goal,
        tolerance: drive.tolerance,
        speed_m_per_s: drive.speed_m_per_s,
        start_curvature_per_m: input.start.curvature_per_m,
        stop: Some(stop),
    }
}

/// Does work for each item that there is time for, with smoothers on all threads; items are taken, and
/// results given, in their order.
fn in_order<T: Sync, R: Send>(
    pool: &Pool<Option<Smoother>>,
    drive: Drive<'_>,
    items: &[T],
    work: impl Fn(&mut Smoother, &T, &(dyn Fn() -> bool + Sync)) -> R + Sync,
) -> Result<Vec<R>, Error> {
    let next = AtomicUsize::new(0);
    let of_thread = |_: usize| {
        pool.with(|slot: &mut Option<Smoother>| {
            let fits = |smoother: &Smoother| smoother.config() == drive.config;
            let smoother = match slot.take().filter(fits) {
                Some(smoother) => slot.insert(smoother),
                None => slot.insert(Smoother::new(drive.vehicle, *drive.config)?),
            };
            let mut done = Vec::new();
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(index) else {
                    break;
                };
                let grace = if index == 0 { GRACE } else { Duration::ZERO };
                let stop = || (drive.is_late)(grace);
                if stop() {
                    break;
                }
                done.push((index, work(smoother, item, &stop)));
            }
            Ok(done)
        })
    };
    let threads = rayon::current_num_threads().min(items.len());
    let done: Result<Vec<Vec<_>>, Error> = (0..threads).into_par_iter().map(of_thread).collect();
    let mut done: Vec<(usize, R)> = done?.into_iter().flatten().collect();
    done.sort_unstable_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}
