//! The table, and how much faster `swath` is.

use crate::judge::{Judge, length_m};
use crate::problem::Problem;
use crate::run::{Drive, Fate, Run};

/// One line of the table: times in milliseconds, then numbers of goals.
pub(crate) struct Row {
    planner: String,
    drive: Drive,
    cpu_ms: f64,
    solved_cpu_ms: f64,
    elapsed_ms: f64,
    solved: usize,
    unreachable: usize,
    undecided: usize,
    crashed: usize,
    /// Paths that the judge does not accept.
    refused: usize,
    /// Lengths as multiples of those of ours, for goals that both solve.
    length_ratios: Vec<f64>,
}

/// Rows of runs; their lengths are compared with those of the last of ours.
pub(crate) fn rows(problem: &Problem, judge: &Judge<'_>, ours: &[Run], runs: &[Run]) -> Vec<Row> {
    let best = ours.last().map_or(&[][..], |run| run.fates.as_slice());
    runs.iter()
        .map(|run| row(problem, judge, best, run))
        .collect()
}

fn row(problem: &Problem, judge: &Judge<'_>, best: &[Fate], run: &Run) -> Row {
    let mut row = Row {
        planner: run.planner.clone(),
        drive: run.drive,
        cpu_ms: run.cpu_ms,
        solved_cpu_ms: run.solved_cpu_ms,
        elapsed_ms: run.elapsed_ms,
        solved: 0,
        unreachable: 0,
        undecided: 0,
        crashed: 0,
        refused: 0,
        length_ratios: Vec::new(),
    };
    for ((fate, best), goal) in run.fates.iter().zip(best).zip(&problem.goals) {
        match fate {
            Fate::Solved(path) if judge.accepts(path, goal, run.drive) => {
                row.solved += 1;
                if let Fate::Solved(ours) = best {
                    row.length_ratios.push(length_m(path) / length_m(ours));
                }
            }
            Fate::Solved(_) => row.refused += 1,
            Fate::Unreachable => row.unreachable += 1,
            Fate::Undecided => row.undecided += 1,
            Fate::Crashed => row.crashed += 1,
        }
    }
    row
}

/// Prints the names of the columns.
pub(crate) fn print_head() {
    println!(
        "{:9} {:24} {:>8} {:>8} {:>8} {:>6} {:>11} {:>9} {:>7} {:>7} {:>6} {:>6}",
        "map",
        "planner",
        "cpu",
        "solved's",
        "elapsed",
        "solved",
        "unreachable",
        "undecided",
        "refused",
        "crashed",
        "length",
        "max"
    );
}

impl Row {
    /// Prints the row of a map.
    pub(crate) fn print(&self, map: &str) {
        let mean = self.length_ratios.iter().sum::<f64>() / self.length_ratios.len() as f64;
        let most = self.length_ratios.iter().copied().fold(f64::NAN, f64::max);
        println!(
            "{map:9} {:24} {:8.0} {:8.0} {:8.0} {:6} {:11} {:9} {:7} {:7} {mean:6.3} {most:6.3}",
            self.planner,
            self.cpu_ms,
            self.solved_cpu_ms,
            self.elapsed_ms,
            self.solved,
            self.unreachable,
            self.undecided,
            self.refused,
            self.crashed,
        );
    }
}

/// What share of the processor time of the fastest of theirs, and of the fastest that drives forward
/// only like ours, the last of ours takes; those that solve less than half as many goals are left out.
pub(crate) fn ratios(map: &str, ours: &[Row], theirs: &[Row]) -> String {
    let Some(ours) = ours.last() else {
        return String::new();
    };
    let fastest = |drives: &[Drive]| {
        theirs
            .iter()
            .filter(|row| drives.contains(&row.drive) && 2 * row.solved >= ours.solved)
            .min_by(|a, b| a.cpu_ms.total_cmp(&b.cpu_ms))
    };
    let describe = |row: Option<&Row>| {
        row.map_or("none solves half as many".to_owned(), |row| {
            format!(
                "1/{:.1} of {} (1/{:.1} of what its solved goals took)",
                row.cpu_ms / ours.cpu_ms,
                row.planner,
                row.solved_cpu_ms / ours.cpu_ms
            )
        })
    };
    format!(
        "{map}: {} takes {}; forward only: {}",
        ours.planner,
        describe(fastest(&[Drive::Forward, Drive::Reversing])),
        describe(fastest(&[Drive::Forward]))
    )
}
