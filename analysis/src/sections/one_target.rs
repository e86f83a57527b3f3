//! The paper's first table: one target, time and steps.

use super::Section;
use crate::comparison::{Comparison, PairSet, Ratio, Side};
use crate::format::{count, median, spread, times, times_of_pairs};
use crate::grid::{Grid, escape_markdown};
use crate::methods::MethodStatistics;
use crate::paper;

/// The section, from all comparisons.
pub(crate) fn section(comparisons: &[Comparison], methods: &[MethodStatistics]) -> Section {
    let mut section = Section::titled("One target");
    let of_one: Vec<&Comparison> = comparisons.iter().filter(|c| c.targets == 1).collect();
    if of_one.is_empty() {
        section.paragraph(
            "No frame was planned to one target by two methods, so there is nothing to compare. \
             `swath bench` makes such plans.",
        );
    }
    for set in [PairSet::Solved, PairSet::All] {
        for comparison in of_one.iter().filter(|comparison| comparison.set == set) {
            pair_table(&mut section, comparison);
        }
    }
    every_plan(&mut section, methods);
    section
}

fn pair_table(section: &mut Section, comparison: &Comparison) {
    let (baseline, compared) = (&comparison.baseline, &comparison.compared);
    let which = match comparison.set {
        PairSet::Solved => "that both methods reached",
        PairSet::All => "whatever became of the target",
    };
    let pairs = count(comparison.pairs as u64);
    section.heading(&format!(
        "{} against {}: {pairs} frames, {which}",
        escape_markdown(&compared.method),
        escape_markdown(&baseline.method)
    ));
    let mut grid = Grid::new([
        "method",
        "search, elapsed (ms)",
        "processor (ms)",
        "steps",
        "paper: time (ms)",
        "paper: steps",
    ]);
    grid.row(method_row(baseline));
    grid.row(method_row(compared));
    let ratios = [&comparison.search, &comparison.cpu, &comparison.steps];
    let of_medians = ratios.map(|ratio: &Ratio| times(ratio.of_medians));
    let paper =
        if (baseline.method.as_str(), compared.method.as_str()) == (paper::TIEV, paper::TIEV_FCN) {
            [
                times(paper::target_count(1).map(paper::TargetCountRow::ratio)),
                times(Some(paper::FCN_STEPS / paper::TIEV_STEPS)),
            ]
        } else {
            [String::new(), String::new()]
        };
    grid.row(
        ["ratio of medians".to_owned()]
            .into_iter()
            .chain(of_medians)
            .chain(paper),
    );
    let of_pairs = ratios.map(times_of_pairs);
    grid.row(
        ["ratio, pair by pair".to_owned()]
            .into_iter()
            .chain(of_pairs),
    );
    if comparison.set == PairSet::Solved {
        section.labelled_table(
            format!("tab:one-target-{}", compared.method),
            format!(
                "One target: median (quartiles) over {pairs} frames whose target both methods reached."
            ),
            grid,
        );
    } else {
        section.table(&grid);
    }
}

fn method_row(side: &Side) -> [String; 6] {
    let one = paper::target_count(1);
    let (time, steps) = match side.method.as_str() {
        paper::TIEV => (one.map(|row| row.tiev_ms), Some(paper::TIEV_STEPS)),
        paper::TIEV_FCN => (one.map(|row| row.fcn_ms), Some(paper::FCN_STEPS)),
        _ => (None, None),
    };
    [
        side.method.clone(),
        spread(side.search_ms.as_ref()),
        spread(side.cpu_ms.as_ref()),
        spread(side.steps.as_ref()),
        time.map_or_else(String::new, |time| format!("{time:.3}")),
        steps.map_or_else(String::new, crate::format::significant),
    ]
}

/// All plans of each method, of live planners too.
fn every_plan(section: &mut Section, methods: &[MethodStatistics]) {
    section.heading("Every plan, by method");
    if methods.is_empty() {
        section.paragraph("No plans were recorded.");
        return;
    }
    section.paragraph(
        "All plans in the recordings, of any number of targets and whether another method planned \
         the same frame or not: not a comparison.",
    );
    let mut grid = Grid::new([
        "method",
        "plans",
        "targets",
        "reached",
        "search, elapsed (ms)",
        "processor (ms)",
        "network (ms)",
        "total (ms)",
        "steps",
    ]);
    for method in methods {
        grid.row([
            method.side.method.clone(),
            count(method.plans as u64),
            count(method.targets),
            count(method.solved),
            spread(method.side.search_ms.as_ref()),
            spread(method.side.cpu_ms.as_ref()),
            median(method.side.network_ms.as_ref()),
            spread(method.side.total_ms.as_ref()),
            spread(method.side.steps.as_ref()),
        ]);
    }
    section.table(&grid);
}
