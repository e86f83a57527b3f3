//! Each method against the baseline, summed over the targets that both reached.

use std::collections::BTreeSet;

use super::Section;
use crate::format::{count, optional, times};
use crate::grid::{Grid, escape_markdown};
use crate::pairwise::{COSTLIEST_PERCENT, Pairwise};
use crate::paper;

/// Most numbers of targets that are shown; live planners give every number there is.
const MAX_NUMBERS: usize = 12;

/// The section, from all comparisons.
pub(crate) fn section(pairwise: &[Pairwise]) -> Section {
    let mut section = Section::titled("Pairwise");
    let methods: BTreeSet<&str> = pairwise.iter().map(|row| row.compared.as_str()).collect();
    if methods.is_empty() {
        section.paragraph("No frame was planned by two methods, so there is nothing to compare.");
        return section;
    }
    section.paragraph(&format!(
        "Summed over the targets that both methods reached: steps and processor time of the targets' \
         own searches, the compared method's by the baseline's. What a method does once for all \
         targets is in no target's time; it is in the last two columns, which set the whole frame, \
         network included, against the baseline's processor time for one target that it reaches \
         (medians). Few targets make most of a sum, so it stands also without the {COSTLIEST_PERCENT} \
         % that took the baseline most steps. The network's time is elapsed, a frame."
    ));
    for method in methods {
        let rows: Vec<&Pairwise> = pairwise
            .iter()
            .filter(|row| row.compared == method)
            .collect();
        compare(&mut section, method, &rows);
    }
    section
}

fn compare(section: &mut Section, method: &str, rows: &[&Pairwise]) {
    let Some(first) = rows.first() else { return };
    section.heading(&format!(
        "{} against {}, summed",
        escape_markdown(method),
        escape_markdown(&first.baseline)
    ));
    let numbers: BTreeSet<u32> = rows.iter().map(|row| row.targets).collect();
    if numbers.len() > MAX_NUMBERS {
        section.paragraph(&format!(
            "{} numbers of targets are in `tables/pairwise.csv` alone.",
            numbers.len()
        ));
        return;
    }
    let mut grid = Grid::new([
        "scene",
        "targets",
        "frames",
        "both",
        "baseline alone",
        "compared alone",
        "steps",
        "time",
        "steps, but costliest",
        "time, but costliest",
        "cost, mean",
        "cost, most",
        "network (ms)",
        "frame by target, elapsed",
        "processor",
    ]);
    for row in rows {
        grid.row(cells(escape_markdown(&row.scene), row));
    }
    if (first.baseline.as_str(), method) == (paper::TIEV, paper::TIEV_FCN) {
        let one = paper::target_count(1).map(paper::TargetCountRow::ratio);
        let steps = Some(paper::FCN_STEPS / paper::TIEV_STEPS);
        let nothing = || std::iter::repeat_n(String::new(), 4);
        let row = ["the paper".to_owned(), "1".to_owned()].into_iter();
        grid.row(row.chain(nothing()).chain([times(steps), times(one)]));
    }
    section.table(&grid);
}

fn cells(scene: String, row: &Pairwise) -> [String; 15] {
    [
        scene,
        row.targets.to_string(),
        count(row.frames as u64),
        count(row.both as u64),
        count(row.baseline_only as u64),
        count(row.compared_only as u64),
        times(row.all.steps_ratio()),
        times(row.all.time_ratio()),
        times(row.but_costliest.steps_ratio()),
        times(row.but_costliest.time_ratio()),
        cost(row.cost_ratio_mean),
        cost(row.cost_ratio_most),
        optional(row.network_ms_mean),
        times(row.frame_by_target_elapsed),
        times(row.frame_by_target_cpu),
    ]
}

/// A ratio of costs, which lie close together.
fn cost(ratio: Option<f64>) -> String {
    ratio.map_or_else(|| times(None), |ratio| format!("{ratio:.4}"))
}
