//! What a planner made of a problem.

use std::error::Error;

use swath_bridge::Pose2;

/// How a path is to be driven, which says what it is judged by.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drive {
    /// Straight pieces with turns on the spot between them, forward.
    Chords,
    /// A car that drives forward only.
    Forward,
    /// A car that may reverse.
    Reversing,
}

/// What became of one goal.
pub(crate) enum Fate {
    /// The poses of a path.
    Solved(Vec<Pose2>),
    /// There is no path, and that is proved.
    Unreachable,
    /// Neither, within the limit.
    Undecided,
    /// The planner came to a violent end.
    Crashed,
}

/// One planner on one problem.
pub(crate) struct Run {
    pub(crate) planner: String,
    pub(crate) drive: Drive,
    /// One a goal.
    pub(crate) fates: Vec<Fate>,
    /// Processor time of all goals, milliseconds.
    pub(crate) cpu_ms: f64,
    /// Of those goals only for which it found paths; all of it if goals share their time.
    pub(crate) solved_cpu_ms: f64,
    /// Elapsed time of all goals, milliseconds.
    pub(crate) elapsed_ms: f64,
}

impl Run {
    /// A run that has no goals yet.
    pub(crate) const fn new(planner: String, drive: Drive) -> Self {
        Self {
            planner,
            drive,
            fates: Vec::new(),
            cpu_ms: 0.0,
            solved_cpu_ms: 0.0,
            elapsed_ms: 0.0,
        }
    }

    /// Adds the next goal as a planner's process reports it: what became of it, processor and elapsed
    /// milliseconds, and the poses of the path.
    pub(crate) fn add(&mut self, report: &str) -> Result<(), Box<dyn Error>> {
        let mut words = report.split_whitespace();
        let fate = words.next().ok_or("a report is empty")?;
        let numbers = words
            .map(str::parse)
            .collect::<Result<Vec<f64>, _>>()
            .map_err(|error| format!("{report:.80}: {error}"))?;
        let [cpu_ms, elapsed_ms, poses @ ..] = numbers.as_slice() else {
            return Err(format!("{report:.80}: times are missing").into());
        };
        self.cpu_ms += cpu_ms;
        self.elapsed_ms += elapsed_ms;
        self.fates.push(match fate {
            "solved" => {
                self.solved_cpu_ms += cpu_ms;
                let poses = poses.chunks_exact(3);
                Fate::Solved(poses.map(|p| Pose2::new(p[0], p[1], p[2])).collect())
            }
            "none" | "overran" => Fate::Undecided,
            "crashed" => Fate::Crashed,
            other => return Err(format!("{other}: no such outcome").into()),
        });
        Ok(())
    }
}
