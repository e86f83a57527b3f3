//! Collision maps and searches: to one target, to fifty on all cores, and on large grids.
//!
//! `cargo bench --workspace --bench search`

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use std::hint::black_box;
use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use swath_bridge::{GridSpec, Pose2, Vehicle};
use swath_planner::search::{Limits, SearchMemory, search};
use swath_planner::{
    CollisionMap, FrameInput, FramePlanner, Guidance, Method, MotionModel, PlanConfig, Plane,
    Planner, Start,
};

/// Enough for most targets; the others count too, up to here.
const LIMITS: Limits<'_> = Limits {
    max_expansions: Some(60_000),
    stop: None,
};
const SPEED_M_PER_S: f64 = 1.4;

fn model() -> Arc<MotionModel> {
    let model = MotionModel::new(&Vehicle::default(), GridSpec::default().resolution_m);
    Arc::new(model.expect("the default vehicle fits the default cells"))
}

fn map_of(model: &Arc<MotionModel>, scene: &scenes::Scene) -> CollisionMap {
    let map = CollisionMap::new(Arc::clone(model), GridSpec::default(), &scene.obstacles);
    map.expect("scenes are made for the default grid")
}

fn models(criterion: &mut Criterion) {
    let model = model();
    criterion.bench_function("successors of a speed", |bencher| {
        bencher.iter(|| model.successors(black_box(SPEED_M_PER_S)));
    });
    let mut group = criterion.benchmark_group("collision map");
    for scene in scenes::all() {
        group.bench_function(BenchmarkId::from_parameter(scene.name), |bencher| {
            bencher.iter(|| map_of(&model, &scene));
        });
    }
}

/// One target after the other: on a new map each, as for labels, and on one map, as for a frame.
fn one_target(criterion: &mut Criterion) {
    let model = model();
    let successors = model.successors(SPEED_M_PER_S);
    let mut memory = SearchMemory::new();
    let mut run = |map: &CollisionMap, goal: &Pose2| {
        search(
            map,
            &successors,
            (goal, Guidance::NONE),
            LIMITS,
            &mut memory,
        )
        .expect("no region, no error")
    };
    for scene in scenes::all() {
        let goals: Vec<_> = scene.goals.iter().step_by(7).collect();
        let map = map_of(&model, &scene);
        let steps: u64 = goals.iter().map(|goal| run(&map, goal).steps).sum();
        let mut group = criterion.benchmark_group("tiev to eight targets");
        group
            .throughput(Throughput::Elements(steps))
            .sample_size(10);
        group.bench_function(BenchmarkId::new("a map each", scene.name), |bencher| {
            bencher.iter(|| {
                for goal in &goals {
                    black_box(run(&map_of(&model, &scene), goal));
                }
            });
        });
        group.bench_function(BenchmarkId::new("one map", scene.name), |bencher| {
            bencher.iter(|| {
                for goal in &goals {
                    black_box(run(&map, goal));
                }
            });
        });
    }
}

fn fifty_targets(criterion: &mut Criterion) {
    let model = model();
    let planner = Planner::new();
    let config = PlanConfig {
        method: Method::Tiev,
        speed_m_per_s: SPEED_M_PER_S,
        max_expansions: 60_000,
        ..PlanConfig::default()
    };
    let mut group = criterion.benchmark_group("tiev to fifty targets on all cores");
    group.sample_size(10);
    for scene in scenes::all() {
        group.bench_function(BenchmarkId::from_parameter(scene.name), |bencher| {
            bencher.iter(|| planner.plan(&map_of(&model, &scene), &scene.goals, None, &config));
        });
    }
}

/// The open road in ever larger grids that are free elsewhere: a planner's first frame, and the others.
fn large_grids(criterion: &mut Criterion) {
    let model = model();
    let scene = scenes::open_road();
    let config = PlanConfig {
        smooth: false,
        ..PlanConfig::default()
    };
    let mut group = criterion.benchmark_group("swath to fifty targets in a square grid");
    group.sample_size(10);
    for side in [512, 1024, 2048, 4096] {
        let (spec, obstacles) = in_square_grid(&scene, side);
        let input = FrameInput {
            spec,
            obstacles: &obstacles,
            reference: &[],
            goals: &scene.goals,
            start: Start::default(),
        };
        let plan = |planner: &FramePlanner| planner.plan(&input, None, &config);
        group.bench_function(BenchmarkId::new("the first frame", side), |bencher| {
            bencher.iter_with_large_drop(|| {
                let planner = FramePlanner::new(Arc::clone(&model));
                (plan(&planner), planner)
            });
        });
        let planner = FramePlanner::new(Arc::clone(&model));
        group.bench_function(BenchmarkId::new("another frame", side), |bencher| {
            bencher.iter(|| plan(&planner));
        });
    }
}

/// A scene around the vehicle in the middle of a grid.
fn in_square_grid(scene: &scenes::Scene, side: u32) -> (GridSpec, Plane) {
    let small = GridSpec::default();
    let spec = GridSpec {
        rows: side,
        cols: side,
        ego_row: side / 2,
        ego_col: side / 2,
        ..small
    };
    let mut obstacles = Plane::empty(side, side);
    scene.obstacles.each_set(|index| {
        let (x_m, y_m) = small.centre_of(small.cell_of_index(index));
        obstacles.set(spec.cell_at(x_m, y_m));
    });
    (spec, obstacles)
}

criterion_group!(benches, models, one_target, fifty_targets, large_grids);
criterion_main!(benches);
