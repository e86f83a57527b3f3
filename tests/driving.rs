//! A planner as a process on the grids of a simulated drive, with fifty targets: every frame is planned,
//! every chosen path can be driven, and memory does not grow.
//!
//! One grid follows the plan of the one before, however long that takes. With `SWATH_SOAK_S` it is ten
//! grids a second for so many seconds instead, which have to be planned in time; what it measured is
//! printed.

#![expect(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "helpers of tests, and what a soak measured"
)]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use nodes::{Node, System};
use soak::NOISE;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::poses::{odometry_message, path_message};
use swath_bridge::{Frame, GridSpec, Publisher, Session, Subscriber, Vehicle, keys};
use swath_generator::{Drive, Generator, GeneratorConfig, Scenes};
use swath_planner::check::{CheckLimits, Ends, check_path};
use swath_planner::report::{path_points, pose_of_planar};
use swath_planner::{ObstacleConfig, Plane};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};

mod nodes;
mod soak;

const VEHICLE: &str = "v0";
const PERIOD: Duration = Duration::from_millis(100);
/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(20);
/// A grid that may have been dropped is sent again after this time.
const AGAIN: Duration = Duration::from_secs(10);
/// Deadline of a frame in a soak, milliseconds.
const DEADLINE_MS: &str = "100";
/// Frames that are planned one after the other.
const DRIVE: usize = 30;
/// Frames that are kept until their plan comes.
const FRAMES: usize = 64;
/// Share of the grids that are planned on in a soak.
const LEAST_PLANNED: f64 = 0.9;
const SEED: u64 = 77;

/// What a vehicle sends and hears.
struct Car {
    grids: Publisher<OccupancyGrid>,
    odometry: Publisher<Odometry>,
    references: Publisher<Path>,
    plans: Subscriber<PlanReport>,
    drive: Drive,
    /// What was seen in the newest frames, by stamp.
    seen: BTreeMap<u64, Plane>,
    stamp: u64,
}

impl Car {
    async fn new(session: &Session) -> Self {
        let generator = Generator::new(GeneratorConfig::default(), Scenes::Procedural).unwrap();
        Self {
            grids: session.publisher(&keys::grid(VEHICLE)).await.unwrap(),
            odometry: session.publisher(&keys::odom(VEHICLE)).await.unwrap(),
            references: session.publisher(&keys::reference(VEHICLE)).await.unwrap(),
            plans: session.subscriber(&keys::plan(VEHICLE), 64).await.unwrap(),
            drive: Drive::new(Arc::new(generator), SEED),
            seen: BTreeMap::new(),
            stamp: 0,
        }
    }

    /// Sends the next frame of the drive.
    async fn send(&mut self) -> Frame {
        let (_, frame) = self.drive.next().unwrap();
        self.stamp += u64::try_from(PERIOD.as_nanos()).unwrap();
        self.put(&frame).await;
        frame
    }

    /// Sends a frame at the newest stamp.
    async fn put(&mut self, frame: &Frame) {
        let header = Header::at(self.stamp, "base_link");
        let Frame {
            reference,
            occupancy,
            ..
        } = frame;
        self.references
            .put(&path_message(&header, reference))
            .await
            .unwrap();
        self.odometry
            .put(&odometry_message(&header, frame))
            .await
            .unwrap();
        let obstacles = ObstacleConfig::default().obstacles(occupancy);
        self.seen.insert(self.stamp, obstacles);
        if self.seen.len() > FRAMES {
            self.seen.pop_first();
        }
        self.grids.put(&occupancy.to_message(header)).await.unwrap();
    }

    /// Sends the next frame, again and again until its plan comes.
    async fn plan(&mut self) -> PlanReport {
        let frame = self.send().await;
        loop {
            match timeout(AGAIN, self.plans.recv()).await {
                Ok(plan) => {
                    let plan = plan.unwrap().message;
                    if plan.header.stamp.nanos() == self.stamp {
                        return plan;
                    }
                }
                Err(_elapsed) => self.put(&frame).await,
            }
        }
    }

    /// Checks the chosen path of a report, if there is one; whether there was.
    fn check(&self, report: &PlanReport) -> bool {
        let chosen = usize::try_from(report.chosen).ok();
        let (Some(target), Some(obstacles)) = (
            chosen.map(|number| &report.targets[number]),
            self.seen.get(&report.header.stamp.nanos()),
        ) else {
            return false;
        };
        let points = path_points(target);
        let ends = Ends {
            start: points[0].pose,
            start_curvature_per_m: None,
            goal: pose_of_planar(&target.goal),
        };
        let vehicle = Vehicle::default();
        let limit_per_m = vehicle.curvature_limit_per_m(report.speed_m_per_s.into());
        let limits = CheckLimits::new(&vehicle, limit_per_m);
        let found = check_path((&GridSpec::default(), obstacles), &limits, &ends, &points);
        assert!(found.is_empty(), "frame {}: {found:?}", report.frame);
        true
    }
}

/// What the plans came to.
#[derive(Default)]
struct Tally {
    plans: usize,
    chosen: usize,
    checked: usize,
    solved: usize,
    latencies_ms: Vec<f32>,
    most_late_ms: f32,
    peaks: [u64; 3],
}

impl Tally {
    fn add(&mut self, report: &PlanReport, is_checked: bool) {
        self.plans += 1;
        self.checked += usize::from(is_checked);
        self.chosen += usize::from(report.chosen >= 0);
        self.solved += report
            .targets
            .iter()
            .filter(|target| target.status == 0)
            .count();
        self.latencies_ms.push(report.latency_ms);
        let late_ms = report.total_ms + report.smooth_ms - report.deadline_ms;
        self.most_late_ms = self.most_late_ms.max(late_ms);
    }

    fn print(&mut self, grids: usize) {
        self.latencies_ms.sort_by(f32::total_cmp);
        let last = self.latencies_ms.len() - 1;
        eprintln!(
            "{} of {grids} grids planned, {} with a chosen path, {} of them checked, {} targets solved; \
             grid to plan: p50 {:.1} ms, p99 {:.1} ms, at most {:.1} ms; over the deadline by at most {:.1} ms; memory at \
             most {:?} MiB in each third",
            self.plans,
            self.chosen,
            self.checked,
            self.solved,
            self.latencies_ms[last / 2],
            self.latencies_ms[last * 99 / 100],
            self.latencies_ms[last],
            self.most_late_ms,
            self.peaks.map(|bytes| bytes >> 20),
        );
    }
}

/// Frame after frame, each when the one before is planned.
async fn one_by_one(car: &mut Car, planner: &Node) -> Tally {
    let mut tally = Tally::default();
    for number in 0..DRIVE {
        let report = car.plan().await;
        let is_checked = car.check(&report);
        tally.add(&report, is_checked);
        let peak = &mut tally.peaks[3 * number / DRIVE];
        *peak = soak::memory_bytes(planner).max(*peak);
    }
    tally.print(DRIVE);
    assert_eq!(tally.plans, DRIVE);
    tally
}

/// Ten grids a second, whether the planner follows or not.
async fn by_the_clock(car: &mut Car, planner: &Node, length: Duration) -> Tally {
    // The first frames give the planner its memory.
    while timeout(PERIOD, car.plans.recv()).await.is_err() {
        car.send().await;
    }
    let mut tally = Tally::default();
    let mut ticks = interval(PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (start, mut grids) = (Instant::now(), 0);
    while start.elapsed() < length {
        tokio::select! {
            biased;
            // Reports for which no frame was planned say that no grid came.
            Some(plan) = car.plans.recv() => if plan.message.frame > 0 {
                let is_checked = car.check(&plan.message);
                tally.add(&plan.message, is_checked);
            },
            _ = ticks.tick() => {
                car.send().await;
                grids += 1;
                let third = start.elapsed().as_millis() * 3 / length.as_millis();
                let peak = &mut tally.peaks[usize::try_from(third).unwrap().min(2)];
                *peak = soak::memory_bytes(planner).max(*peak);
            }
        }
    }
    tally.print(grids);
    assert!(tally.plans as f64 >= LEAST_PLANNED * grids as f64);
    tally
}

async fn all(folder: &std::path::Path) {
    let system = System::new(folder, "");
    let session = system.session().await;
    let mut car = Car::new(&session).await;
    let deadline_ms = if soak::asked_for().is_some() {
        DEADLINE_MS
    } else {
        "0"
    };
    let planner: Node = system.start(&["plan", "--deadline-ms", deadline_ms]);
    car.grids.wait_for_subscribers().await.unwrap();
    let tally = match soak::asked_for() {
        Some(length) => by_the_clock(&mut car, &planner, length).await,
        None => one_by_one(&mut car, &planner).await,
    };
    assert_eq!(tally.checked, tally.chosen, "every chosen path is checked");
    assert!(2 * tally.chosen > tally.plans, "mostly stopped");
    assert!(
        tally.peaks[2] <= tally.peaks[1] + NOISE,
        "{:?}",
        tally.peaks
    );
    assert!(planner.stop().success());
}

#[test]
fn a_drive_is_planned_to_fifty_targets_and_every_chosen_path_can_be_driven() {
    let patience = PATIENCE + soak::length();
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let ended = runtime.block_on(async { timeout(patience, all(folder.path())).await });
    assert!(ended.is_ok(), "not done within {patience:?}");
}
