//! Smoothed paths on problems: how many can be driven, why not, how long they are, what they cost, and
//! what the independent checker says.
//!
//! `cargo bench -p swath-planner --bench smoothing -- [DIRECTORY]` reads every `NAME.pgm` with its
//! `NAME.goals.txt`; without a directory, the problems below `$SWATH_DATA` or `../shared/data`.
//! Goals are searched with `tiev`, 300 ms each, at 1.4 m/s or `$SWATH_SPEED`.

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program whose result is its output"
)]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swath_bridge::{GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, Fault, check_path};
use swath_planner::smooth::{ObstacleCells, SmoothConfig, SmoothRequest, Smoother};
use swath_planner::{
    CollisionMap, CpuTimer, GoalTolerance, Method, MotionModel, PlanConfig, Plane, Planner,
    TargetPlan, millis,
};

#[path = "../tests/data/mod.rs"]
mod data;

const LIMIT_MS: u64 = 300;
const SPEED_M_PER_S: f64 = 1.4;
/// Each path is smoothed this often; the least time counts.
const REPETITIONS: usize = 3;

/// What the paths of some problems came to.
#[derive(Debug, Default)]
struct Tally {
    paths: usize,
    drivable: usize,
    by_reason: BTreeMap<String, usize>,
    violations: BTreeMap<Fault, usize>,
    length_ratios: Vec<f64>,
    times_ms: Vec<f64>,
    iterations: usize,
    metres: f64,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.paths += other.paths;
        self.drivable += other.drivable;
        for (reason, count) in &other.by_reason {
            *self.by_reason.entry(reason.clone()).or_default() += count;
        }
        for (fault, count) in &other.violations {
            *self.violations.entry(*fault).or_default() += count;
        }
        self.length_ratios.extend(&other.length_ratios);
        self.times_ms.extend(&other.times_ms);
        self.iterations += other.iterations;
        self.metres += other.metres;
    }

    fn print(&mut self, name: &str) {
        let count = self.paths.max(1) as f64;
        self.times_ms.sort_by(f64::total_cmp);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let quantile = |share: f64| {
            let index = (share * (self.times_ms.len().max(1) - 1) as f64).round();
            let found = self
                .times_ms
                .iter()
                .zip(0..)
                .find(|(_, at)| f64::from(*at) >= index);
            found.map_or(f64::NAN, |(time, _): (&f64, i32)| *time)
        };
        println!(
            "{name:<16} {:>5} paths {:>6.2} % drivable, length ×{:.4}, {:>5.1} iterations, ms: mean {:.2} \
             p50 {:.2} p99 {:.2} max {:.2} ({:.3} for 50 m); not: {:?}; violations {:?}",
            self.paths,
            100.0 * self.drivable as f64 / count,
            mean(&self.length_ratios),
            self.iterations as f64 / count,
            mean(&self.times_ms),
            quantile(0.5),
            quantile(0.99),
            quantile(1.0),
            50.0 * self.times_ms.iter().sum::<f64>() / self.metres.max(1e-9),
            self.by_reason,
            self.violations,
        );
    }
}

/// Where problems are, and their names: those of the directory that was given, or the six.
fn problems() -> Option<(PathBuf, Vec<String>)> {
    let given = std::env::args()
        .skip(1)
        .find(|argument| !argument.starts_with('-'));
    let Some(directory) = given.map(PathBuf::from) else {
        let names = data::NAMES.map(str::to_owned);
        return Some((data::problems()?, names.to_vec()));
    };
    let entries = std::fs::read_dir(&directory).expect("the directory can be read");
    let paths = entries.filter_map(|entry| entry.ok().map(|entry| entry.path()));
    let maps = paths.filter(|path| path.extension().is_some_and(|extension| extension == "pgm"));
    let names = maps.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()));
    let mut names: Vec<String> = names.collect();
    names.sort();
    Some((directory, names))
}

fn from_environment(name: &str, default: f64) -> f64 {
    let text = std::env::var(name).ok();
    text.and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// A map with its goals' chord paths.
struct Problem {
    obstacles: Plane,
    cells: ObstacleCells,
    plans: Vec<TargetPlan>,
}

impl Problem {
    fn read(
        (directory, name): (&Path, &str),
        model: &Arc<MotionModel>,
        speed_m_per_s: f64,
    ) -> Result<Self, Box<dyn Error>> {
        let spec = GridSpec::default();
        let (obstacles, goals) = data::read(directory, name)?;
        let map = CollisionMap::new(Arc::clone(model), spec, &obstacles)?;
        let config = PlanConfig {
            speed_m_per_s,
            method: Method::Tiev,
            time_limit_ms: LIMIT_MS,
            ..PlanConfig::default()
        };
        let mut plans = Planner::new().plan(&map, &goals, None, &config)?;
        plans.retain(|plan| plan.result.outcome == Outcome::Solved);
        Ok(Self {
            cells: ObstacleCells::new(spec, &obstacles)?,
            obstacles,
            plans,
        })
    }

    fn tally(&self, smoother: &mut Smoother, speed_m_per_s: f64) -> Tally {
        let limit_per_m = smoother.curvature_limit_per_m(speed_m_per_s);
        let limits = CheckLimits::new(&Vehicle::default(), limit_per_m);
        let mut tally = Tally::default();
        for plan in &self.plans {
            let request = SmoothRequest {
                chords: &plan.result.path,
                goal: plan.goal,
                tolerance: GoalTolerance::default(),
                speed_m_per_s,
                start_curvature_per_m: Some(0.0),
                stop: None,
            };
            let mut least_ms = f64::INFINITY;
            for _ in 0..REPETITIONS {
                let timer = CpuTimer::of_thread();
                std::hint::black_box(smoother.smooth(&self.cells, &request));
                least_ms = least_ms.min(millis(timer.elapsed()));
            }
            let smooth = smoother.smooth(&self.cells, &request);
            tally.paths += 1;
            tally.times_ms.push(least_ms);
            tally.iterations += smooth.iterations;
            tally.metres += plan.result.length_m;
            if !smooth.is_drivable() {
                let reason = format!("{:?} {:?}", smooth.drivability, smooth.shortfall);
                *tally.by_reason.entry(reason).or_default() += 1;
                continue;
            }
            tally.drivable += 1;
            tally
                .length_ratios
                .push(smooth.length_m() / plan.result.length_m);
            let ends = Ends {
                start: Pose2::default(),
                start_curvature_per_m: Some(0.0),
                goal: plan.goal,
            };
            let ground = (&GridSpec::default(), &self.obstacles);
            for violation in check_path(ground, &limits, &ends, &smooth.points) {
                *tally.violations.entry(violation.fault).or_default() += 1;
            }
        }
        tally
    }
}

fn main() {
    let Some((directory, names)) = problems() else {
        return;
    };
    let vehicle = Vehicle::default();
    let model = MotionModel::new(&vehicle, GridSpec::default().resolution_m);
    let model = Arc::new(model.expect("the default vehicle fits the default cells"));
    let smoother = Smoother::new(&vehicle, SmoothConfig::default());
    let mut smoother = smoother.expect("the default vehicle is one");
    let speed_m_per_s = from_environment("SWATH_SPEED", SPEED_M_PER_S);
    let mut total = Tally::default();
    for name in &names {
        let problem = match Problem::read((&directory, name), &model, speed_m_per_s) {
            Ok(problem) => problem,
            Err(error) => {
                eprintln!("{name}: {error}");
                continue;
            }
        };
        let mut tally = problem.tally(&mut smoother, speed_m_per_s);
        tally.print(name);
        total.add(&tally);
    }
    total.print("all");
}
