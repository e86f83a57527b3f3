//! `swath bridge pictures`: the frames of a recording as PNG files.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use anyhow::{Context, bail};
use swath_bridge::map::Top;
use swath_bridge::msg::Message;
use swath_bridge::msg::geometry::Quaternion;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Path as PathMessage};
use swath_bridge::msg::swath::{PlanReport, Sample, TargetPlan};
use swath_bridge::poses::pose_of_ros;
use swath_bridge::recording::{RawMessage, Reader};
use swath_bridge::scene::{Scene, SceneGoal};
use swath_bridge::{
    Cell, Drivability, FREE, GridSpec, OCCUPIED, OCCUPIED_THRESHOLD, Occupancy, Outcome, Pose2,
    keys,
};
use swath_planner::Plane;
use swath_planner::report::pose_of_planar;

use crate::cli::PicturesOptions;
use crate::commands::plan::reason_of;
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress;

/// Pictures of a vehicle or a generator unless it is said how many.
const USUAL_COUNT: u64 = 50;
/// Frames of a vehicle that wait for their plan.
const MAX_WAITING: usize = 8;

/// Runs the command.
pub(crate) fn run(options: &PicturesOptions, config: &Config) -> Result<(), Failure> {
    let Drawn { pictures, bad } = draw(options, config)?;
    output::line(format_args!(
        "{pictures} pictures written to {}",
        options.out.display()
    ))?;
    if bad > 0 {
        output::line(format_args!(
            "not drawn: {bad} messages that cannot be used"
        ))?;
    }
    Ok(())
}

/// What was drawn of a recording.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drawn {
    pictures: u64,
    /// Messages that cannot be used.
    bad: u64,
}

/// Draws the frames of a recording.
pub(crate) fn draw(options: &PicturesOptions, config: &Config) -> anyhow::Result<Drawn> {
    let bar = progress::bar(0, "pictures");
    let totals = frames_of(&options.file)?;
    if totals.is_empty() {
        bail!(
            "{}: there is no grid and no sample, expected messages on swath/vehicle/*/grid or \
             swath/sample/*",
            options.file.display()
        );
    }
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let mut album = Album {
        out: &options.out,
        config,
        sources: BTreeMap::new(),
        drawn: 0,
        bad: 0,
    };
    for (topic, total) in totals {
        album.sources.insert(topic, Source::new(total, options));
    }
    let mut reader = Reader::open(&options.file)?;
    bar.set_length(reader.len_bytes());
    while let Some(message) = reader.next() {
        album.take(&message?)?;
        bar.set_position(reader.position_bytes());
    }
    album.finish()?;
    bar.finish_and_clear();
    Ok(Drawn {
        pictures: album.drawn,
        bad: album.bad,
    })
}

/// How many grids and samples a recording has on each topic.
fn frames_of(file: &Path) -> anyhow::Result<BTreeMap<String, u64>> {
    let mut totals = BTreeMap::new();
    for message in Reader::open(file)? {
        let message = message?;
        if is_frame(&message) {
            *totals.entry(message.topic.to_string()).or_default() += 1;
        }
    }
    Ok(totals)
}

fn is_frame(message: &RawMessage) -> bool {
    let parts: Vec<&str> = keys::key_of_topic(&message.topic).split('/').collect();
    match parts[..] {
        [.., "swath", "vehicle", _, "grid"] => *message.type_name == *OccupancyGrid::TYPE_NAME,
        [.., "swath", "sample", _] => *message.type_name == *Sample::TYPE_NAME,
        _ => false,
    }
}

/// What is drawn of one topic.
#[derive(Debug)]
struct Source {
    every: u64,
    left: u64,
    seen: u64,
    reference: Vec<Pose2>,
    waiting: VecDeque<Waiting>,
}

/// A frame that waits for its plan.
#[derive(Debug)]
struct Waiting {
    number: u64,
    grid: OccupancyGrid,
    reference: Vec<Pose2>,
    plan: Option<PlanReport>,
    region: Option<OccupancyGrid>,
}

impl Source {
    fn new(total: u64, options: &PicturesOptions) -> Self {
        let count = options.count.unwrap_or(match options.every {
            Some(_) => u64::MAX,
            None => USUAL_COUNT,
        });
        Self {
            every: options
                .every
                .unwrap_or_else(|| total.div_ceil(count).max(1)),
            left: count,
            seen: 0,
            reference: Vec::new(),
            waiting: VecDeque::new(),
        }
    }

    /// The number of the next frame, if it is to be drawn.
    fn next(&mut self) -> Option<u64> {
        let number = self.seen;
        self.seen += 1;
        if !number.is_multiple_of(self.every) || self.left == 0 {
            return None;
        }
        self.left -= 1;
        Some(number)
    }
}

struct Album<'a> {
    out: &'a Path,
    config: &'a Config,
    sources: BTreeMap<String, Source>,
    drawn: u64,
    bad: u64,
}

impl Album<'_> {
    fn take(&mut self, message: &RawMessage) -> anyhow::Result<()> {
        if let Some(source) = self.sources.get_mut(&*message.topic) {
            let Some(number) = source.next() else {
                return Ok(());
            };
            return match &*message.type_name {
                Sample::TYPE_NAME => self.sample(message, number),
                _ => self.grid(message, number),
            };
        }
        // What belongs to a vehicle's grids.
        let Some((vehicle, kind)) = message.topic.rsplit_once('/') else {
            return Ok(());
        };
        let Some(source) = self.sources.get_mut(&format!("{vehicle}/grid")) else {
            return Ok(());
        };
        let is_of = |header: &Header, frame: &&mut Waiting| frame.grid.header.stamp == header.stamp;
        let taken = match kind {
            "reference" => message.decode::<PathMessage>().map(|path| {
                let poses = path.poses.iter().map(|stamped| pose_of_ros(&stamped.pose));
                source.reference = poses.collect();
            }),
            "plan" => message.decode::<PlanReport>().map(|plan| {
                let frame = source
                    .waiting
                    .iter_mut()
                    .find(|frame| is_of(&plan.header, frame));
                if let Some(frame) = frame {
                    frame.plan = Some(plan);
                }
            }),
            "region" => message.decode::<OccupancyGrid>().map(|region| {
                let frame = source
                    .waiting
                    .iter_mut()
                    .find(|frame| is_of(&region.header, frame));
                if let Some(frame) = frame {
                    frame.region = Some(region);
                }
            }),
            _ => Ok(()),
        };
        self.note(taken);
        Ok(())
    }

    /// Counts what cannot be used, and says why of the first.
    fn note<T>(&mut self, result: Result<T, swath_bridge::Error>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                if self.bad == 0 {
                    tracing::warn!("{error}");
                }
                self.bad += 1;
                None
            }
        }
    }

    fn grid(&mut self, message: &RawMessage, number: u64) -> anyhow::Result<()> {
        let Some(grid) = self.note(message.decode::<OccupancyGrid>()) else {
            return Ok(());
        };
        let mut done = None;
        if let Some(source) = self.sources.get_mut(&*message.topic) {
            source.waiting.push_back(Waiting {
                number,
                grid,
                reference: source.reference.clone(),
                plan: None,
                region: None,
            });
            if source.waiting.len() > MAX_WAITING {
                done = source.waiting.pop_front();
            }
        }
        match done {
            Some(frame) => self.draw(&message.topic, frame),
            None => Ok(()),
        }
    }

    /// Draws the frames that still wait.
    fn finish(&mut self) -> anyhow::Result<()> {
        let topics: Vec<String> = self.sources.keys().cloned().collect();
        for topic in topics {
            let source = self.sources.get_mut(&topic);
            let waiting = source.map(|source| std::mem::take(&mut source.waiting));
            for frame in waiting.into_iter().flatten() {
                self.draw(&topic, frame)?;
            }
        }
        Ok(())
    }

    fn draw(&mut self, topic: &str, frame: Waiting) -> anyhow::Result<()> {
        let Some((occupancy, frame_from_grid)) = self.note(cells_of(frame.grid)) else {
            return Ok(());
        };
        let config = self.config;
        let grid_from_frame = frame_from_grid.inverse();
        let in_grid = |pose: &Pose2| grid_from_frame.then(pose);
        let plan = frame.plan.as_ref();
        let start = plan.map_or_else(Pose2::default, |plan| pose_of_planar(&plan.start));
        let chosen = plan.map_or(-1, |plan| plan.chosen);
        let targets = plan.map_or(&[][..], |plan| &plan.targets[..]);
        let goals: Vec<SceneGoal> = (0..)
            .zip(targets)
            .map(|(number, target)| goal_of(number, target, &in_grid))
            .map(|goal| SceneGoal {
                is_chosen: usize::try_from(chosen) == Ok(goal.number),
                ..goal
            })
            .collect();
        let region = frame
            .region
            .and_then(|region| Occupancy::from_message(&region, &occupancy.spec).ok());
        let is_region = |cell: Cell| {
            let value = region.as_ref().and_then(|region| region.get(cell));
            value.is_some_and(|value| value >= OCCUPIED_THRESHOLD)
        };
        let reference: Vec<Pose2> = frame.reference.iter().map(in_grid).collect();
        let vehicle = name_of(topic);
        let solved = goals.iter().filter(|goal| !goal.path.is_empty()).count();
        let title = match plan {
            Some(plan) => format!(
                "{vehicle} frame {}, {}: {solved} of {} solved",
                frame.number,
                plan.method,
                goals.len()
            ),
            None => format!("{vehicle} frame {}, not planned on", frame.number),
        };
        let scene = Scene {
            title: &title,
            occupancy: &occupancy,
            top: if frame_from_grid == Pose2::default() {
                Top::X
            } else {
                Top::Y
            },
            region: region.is_some().then_some(&is_region),
            region_name: "predicted region",
            near_reference: None,
            reference: &reference,
            goals: &goals,
            start: in_grid(&start),
            start_named: start,
            vehicle: &config.vehicle,
        };
        self.write(&scene, &format!("{vehicle}-{:06}", frame.number))
    }

    fn sample(&mut self, message: &RawMessage, number: u64) -> anyhow::Result<()> {
        let Some(sample) = self.note(message.decode::<Sample>()) else {
            return Ok(());
        };
        let (planes, spec) = match planes_of(&sample) {
            Ok(planes) => planes,
            Err(error) => {
                if self.bad == 0 {
                    tracing::warn!("{}: {error:#}", message.topic);
                }
                self.bad += 1;
                return Ok(());
            }
        };
        let config = self.config;
        let [obstacles, reference, label] = planes;
        let mut occupancy = Occupancy::filled(spec, FREE);
        obstacles.each_set(|index| occupancy.cells[index] = OCCUPIED);
        let outcome = Outcome::from_code(sample.outcome).unwrap_or(Outcome::Cancelled);
        let goal = pose_of_planar(&sample.goal);
        let goals = [SceneGoal {
            number: 0,
            pose: goal,
            named: goal,
            path: sample.path.iter().map(pose_of_planar).collect(),
            note: reason_of(outcome).to_owned(),
            is_chosen: false,
        }];
        let name = name_of(&message.topic);
        let title = format!("{name} sample {}, {}", sample.sequence, sample.scene);
        let scene = Scene {
            title: &title,
            occupancy: &occupancy,
            top: Top::X,
            region: Some(&|cell| label.get(cell)),
            region_name: "label",
            near_reference: Some(&|cell| reference.get(cell)),
            reference: &[],
            goals: &goals,
            start: Pose2::default(),
            start_named: Pose2::default(),
            vehicle: &config.vehicle,
        };
        self.write(&scene, &format!("sample-{name}-{number:06}"))
    }

    fn write(&mut self, scene: &Scene<'_>, name: &str) -> anyhow::Result<()> {
        scene
            .drawing()
            .write(&self.out.join(format!("{name}.png")))?;
        self.drawn += 1;
        Ok(())
    }
}

/// The cells of a grid around the vehicle, or if it does not stand on them, around the first cell; and
/// the frame of the cells in the message's.
fn cells_of(mut grid: OccupancyGrid) -> Result<(Occupancy, Pose2), swath_bridge::Error> {
    if let Ok(occupancy) = Occupancy::from_message_as_is(&grid) {
        return Ok((occupancy, Pose2::default()));
    }
    let half_m = f64::from(grid.info.resolution) / 2.0;
    let corner = pose_of_ros(&grid.info.origin);
    grid.info.origin.position.x = -half_m;
    grid.info.origin.position.y = -half_m;
    grid.info.origin.orientation = Quaternion {
        x: 0.0,
        y: 0.0,
        z: 0.0,
        w: 1.0,
    };
    let occupancy = Occupancy::from_message_as_is(&grid)?;
    Ok((occupancy, corner.then(&Pose2::new(half_m, half_m, 0.0))))
}

fn goal_of(number: usize, target: &TargetPlan, in_grid: &dyn Fn(&Pose2) -> Pose2) -> SceneGoal {
    let outcome = Outcome::from_code(target.status).unwrap_or(Outcome::Cancelled);
    let named = pose_of_planar(&target.goal);
    let note = match (outcome, Drivability::from_code(target.drivability)) {
        (Outcome::Solved, Some(Drivability::AtSpeed)) => format!("{:.1} m", target.length_m),
        (Outcome::Solved, drivability) => {
            let name = drivability.map_or("chords", Drivability::name);
            format!("{:.1} m, {}", target.length_m, name.replace('_', " "))
        }
        (other, _) => reason_of(other).to_owned(),
    };
    let poses = target
        .path
        .iter()
        .map(|pose| in_grid(&pose_of_planar(pose)));
    SceneGoal {
        number,
        pose: in_grid(&named),
        named,
        path: poses.collect(),
        note,
        is_chosen: false,
    }
}

/// Obstacles, reference and label of a sample, and its grid.
fn planes_of(sample: &Sample) -> anyhow::Result<([Plane; 3], GridSpec)> {
    let spec = GridSpec {
        rows: sample.rows,
        cols: sample.cols,
        resolution_m: sample.resolution_m.to_string().parse()?,
        ego_row: sample.ego_row,
        ego_col: sample.ego_col,
    };
    spec.validate()?;
    if !pose_of_planar(&sample.goal).is_finite() {
        bail!("a sample whose goal is not finite");
    }
    let plane = |bits: &[u8]| Plane::from_packed(spec.rows, spec.cols, bits.to_vec());
    let planes = [
        plane(&sample.obstacles)?,
        plane(&sample.reference)?,
        plane(&sample.label)?,
    ];
    Ok((planes, spec))
}

/// The vehicle or generator of a topic, as a part of a file's name.
fn name_of(topic: &str) -> String {
    let mut parts = topic.rsplit('/');
    let last = parts.next().unwrap_or_default();
    let name = if last == "grid" {
        parts.next().unwrap_or_default()
    } else {
        last
    };
    let is_plain = |symbol: char| symbol.is_alphanumeric() || "-_.".contains(symbol);
    name.chars()
        .map(|symbol| if is_plain(symbol) { symbol } else { '_' })
        .collect()
}
