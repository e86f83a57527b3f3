//! The paper's second table: from one target to fifty.

use std::collections::BTreeSet;

use super::Section;
use crate::comparison::{Comparison, PairSet};
use crate::format::{NOTHING, count, median, optional, spread, times, times_of_pairs};
use crate::grid::{Grid, escape_markdown};
use crate::paper;

/// Most numbers of targets beside the paper's that are shown; live planners give every number there is.
const MAX_OTHER_NUMBERS: usize = 12;

/// The section, from all comparisons.
pub(crate) fn section(comparisons: &[Comparison], drawn: &[String]) -> Section {
    let mut section = Section::titled("Number of targets");
    let all: Vec<&Comparison> = comparisons
        .iter()
        .filter(|c| c.set == PairSet::All)
        .collect();
    let methods: BTreeSet<&str> = all.iter().map(|c| c.compared.method.as_str()).collect();
    if methods.is_empty() {
        section.paragraph(
            "No frame was planned by two methods, so there is nothing to compare. `swath bench` \
             makes such plans.",
        );
        return section;
    }
    section.paragraph(
        "Search times are elapsed, all targets in parallel; the network's time is beside them, not \
         in them. Times are the median and the quartiles over frames, reached targets the mean. \
         Ratios are the compared method's time by the baseline's: of the two medians, and pair by \
         pair. The paper's figures were taken on other hardware and with one search at a time.",
    );
    for method in methods {
        let of_method: Vec<&Comparison> = all
            .iter()
            .copied()
            .filter(|comparison| comparison.compared.method == method)
            .collect();
        compare(&mut section, &of_method);
    }
    section.plot(
        drawn,
        "time_by_targets.svg",
        "Search time by number of targets",
    );
    section.plot(
        drawn,
        "reached_by_targets.svg",
        "Targets reached by number of targets",
    );
    section
}

fn compare(section: &mut Section, comparisons: &[&Comparison]) {
    let Some(first) = comparisons.first() else {
        return;
    };
    let (baseline, compared) = (&first.baseline.method, &first.compared.method);
    let (shown_baseline, shown_compared) = (escape_markdown(baseline), escape_markdown(compared));
    section.heading(&format!("{shown_compared} against {shown_baseline}"));
    let comparisons = &shown(section, comparisons);
    section.labelled_table(
        format!("tab:targets-{compared}"),
        format!("Time and targets reached by number of targets, {compared} against {baseline}."),
        time_table(comparisons, baseline, compared),
    );
    section.heading(&format!(
        "{shown_compared} against {shown_baseline}: processor time, steps, and all told"
    ));
    section.table(&effort_table(comparisons, baseline, compared));
    section.heading(&format!(
        "{shown_compared} against {shown_baseline}, target by target"
    ));
    section.paragraph(
        "Ratios over the targets that both methods reached; the cost is the true one, never scaled.",
    );
    section.table(&target_table(comparisons, baseline, compared));
}

/// Leaves out the numbers of targets that the paper does not have if they are many, and says so.
fn shown<'a>(section: &mut Section, comparisons: &[&'a Comparison]) -> Vec<&'a Comparison> {
    let is_in_paper = |c: &&Comparison| paper::target_count(c.targets).is_some();
    let (in_paper, others): (Vec<_>, Vec<_>) = comparisons.iter().copied().partition(is_in_paper);
    if others.len() <= MAX_OTHER_NUMBERS {
        return comparisons.to_vec();
    }
    let frames: usize = others.iter().map(|comparison| comparison.pairs).sum();
    section.paragraph(&format!(
        "{} frames with {} other numbers of targets are in `tables/comparisons.csv` alone.",
        count(frames as u64),
        others.len()
    ));
    in_paper
}

/// The paper's table with our columns before its own. A number of targets that the paper has and the
/// recordings do not keeps its row.
fn time_table(comparisons: &[&Comparison], baseline: &str, compared: &str) -> Grid {
    let mut grid = Grid::new([
        "targets".to_owned(),
        "frames".to_owned(),
        format!("{baseline} (ms)"),
        "reached".to_owned(),
        format!("{compared} (ms)"),
        "reached".to_owned(),
        "ratio".to_owned(),
        "ratio, pairs".to_owned(),
        "network (ms)".to_owned(),
        "paper: TiEV A* (ms)".to_owned(),
        "reached".to_owned(),
        "paper: improved (ms)".to_owned(),
        "reached".to_owned(),
        "ratio".to_owned(),
        "FCN (ms)".to_owned(),
    ])
    .grouped(&[("", 2), ("here", 7), ("paper", 6)]);
    let mut numbers: BTreeSet<u32> = paper::TARGET_COUNTS.iter().map(|row| row.targets).collect();
    numbers.extend(comparisons.iter().map(|comparison| comparison.targets));
    for targets in numbers {
        let here = comparisons
            .iter()
            .find(|comparison| comparison.targets == targets);
        let here = here.map_or_else(
            || {
                let nothing = std::iter::repeat_n(NOTHING.to_owned(), 7);
                ["0".to_owned()].into_iter().chain(nothing).collect()
            },
            |comparison| measured(comparison),
        );
        let paper = paper::target_count(targets)
            .map(printed)
            .unwrap_or_default();
        grid.row([targets.to_string()].into_iter().chain(here).chain(paper));
    }
    grid
}

fn measured(comparison: &Comparison) -> Vec<String> {
    let (baseline, compared) = (&comparison.baseline, &comparison.compared);
    vec![
        count(comparison.pairs as u64),
        spread(baseline.search_ms.as_ref()),
        optional(baseline.solved_mean),
        spread(compared.search_ms.as_ref()),
        optional(compared.solved_mean),
        times(comparison.search.of_medians),
        times_of_pairs(&comparison.search),
        median(compared.network_ms.as_ref()),
    ]
}

fn printed(row: &paper::TargetCountRow) -> [String; 6] {
    [
        format!("{:.3}", row.tiev_ms),
        row.tiev_solved.to_string(),
        format!("{:.3}", row.fcn_ms),
        row.fcn_solved.to_string(),
        times(Some(row.ratio())),
        format!("{:.2}", row.network_ms),
    ]
}

fn effort_table(comparisons: &[&Comparison], baseline: &str, compared: &str) -> Grid {
    let mut grid = Grid::new([
        "targets".to_owned(),
        format!("processor, {baseline} (ms)"),
        format!("processor, {compared} (ms)"),
        "ratio".to_owned(),
        format!("steps, {baseline}"),
        format!("steps, {compared}"),
        "ratio".to_owned(),
        format!("total with network, {baseline} (ms)"),
        format!("total with network, {compared} (ms)"),
        "ratio".to_owned(),
    ]);
    for comparison in comparisons {
        let (baseline, compared) = (&comparison.baseline, &comparison.compared);
        grid.row([
            comparison.targets.to_string(),
            spread(baseline.cpu_ms.as_ref()),
            spread(compared.cpu_ms.as_ref()),
            times(comparison.cpu.of_medians),
            spread(baseline.steps.as_ref()),
            spread(compared.steps.as_ref()),
            times(comparison.steps.of_medians),
            spread(baseline.total_ms.as_ref()),
            spread(compared.total_ms.as_ref()),
            times(comparison.total.of_medians),
        ]);
    }
    grid
}

fn target_table(comparisons: &[&Comparison], baseline: &str, compared: &str) -> Grid {
    let mut grid = Grid::new([
        "targets".to_owned(),
        "all frames' targets".to_owned(),
        "reached by both".to_owned(),
        format!("by {baseline} alone"),
        format!("by {compared} alone"),
        "steps, ratio".to_owned(),
        "processor, ratio".to_owned(),
        "cost, ratio".to_owned(),
        "cost, most".to_owned(),
    ]);
    for comparison in comparisons {
        let by_target = &comparison.by_target;
        grid.row([
            comparison.targets.to_string(),
            count(by_target.targets as u64),
            count(by_target.both as u64),
            count(by_target.baseline_only as u64),
            count(by_target.compared_only as u64),
            times_of_pairs(&by_target.steps),
            times_of_pairs(&by_target.time),
            times_of_pairs(&by_target.cost),
            times(by_target.cost.of_pairs.map(|spread| spread.most)),
        ]);
    }
    grid
}
