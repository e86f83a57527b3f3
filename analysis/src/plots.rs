//! The plots: what is drawn, from the values of the report.

mod canvas;

use std::collections::BTreeMap;
use std::path::Path;

use crate::Error;
use crate::agreement::Agreement;
use crate::comparison::{Comparison, PairSet};
use crate::frames::{counts, names, numbers};
use crate::health::Health;
use crate::paper;
use crate::spread::Spread;
use crate::tables::Tables;

use canvas::{Chart, Mark, Series};

const TABLE: &str = "plots";
/// Bars of the latency histogram.
const LATENCY_BARS: usize = 40;

/// All that plots are drawn from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sources<'a> {
    pub(crate) tables: &'a Tables,
    pub(crate) comparisons: &'a [Comparison],
    pub(crate) agreements: &'a [Agreement],
    pub(crate) health: &'a Health,
    pub(crate) baseline: &'a str,
}

/// Draws every plot that there is something to draw for, and gives their file names in order.
///
/// # Errors
/// [`Error::Plot`] if one could not be drawn, [`Error::Table`] if a column is missing.
pub(crate) fn draw(sources: &Sources<'_>, directory: &Path) -> Result<Vec<String>, Error> {
    let charts = [
        boxes(
            sources,
            "search_time.svg",
            "Search time, one target",
            "ms, elapsed",
            |side| side.search_ms,
        ),
        boxes(
            sources,
            "search_steps.svg",
            "Expansions, one target",
            "steps",
            |side| side.steps,
        ),
        time_by_targets(sources),
        reached_by_targets(sources),
        training(sources, "loss.svg", ("Training loss", "loss"))?.legend_above(),
        miou(sources)?,
        miou_by_distance(sources),
        samples_per_s(sources),
        weights_age(sources)?,
        latency(sources)?,
    ];
    let mut drawn = Vec::new();
    for chart in charts {
        if chart.draw(directory)? {
            drawn.push(chart.file.to_owned());
        }
    }
    Ok(drawn)
}

/// Boxes of one measure by method, over the pairs of one target that both methods reached; over all
/// pairs if there are none such.
fn boxes(
    sources: &Sources<'_>,
    file: &'static str,
    title: &'static str,
    y_label: &'static str,
    measure: fn(&crate::comparison::Side) -> Option<Spread>,
) -> Chart {
    let mut chart = Chart::new(file, title, ("", y_label)).log_y();
    let of_one = |set| {
        let of_set = move |c: &&Comparison| c.targets == 1 && c.set == set;
        sources
            .comparisons
            .iter()
            .filter(of_set)
            .collect::<Vec<_>>()
    };
    let mut comparisons = of_one(PairSet::Solved);
    if comparisons.is_empty() {
        comparisons = of_one(PairSet::All);
    }
    for comparison in comparisons {
        for side in [&comparison.baseline, &comparison.compared] {
            if let Some(spread) = measure(side) {
                chart.boxes.push((side.method.clone(), spread));
            }
        }
    }
    chart
}

/// Comparisons over all pairs, by compared method.
fn by_method<'a>(sources: &Sources<'a>) -> Vec<(&'a str, Vec<&'a Comparison>)> {
    let mut by_method: Vec<(&str, Vec<&Comparison>)> = Vec::new();
    for comparison in sources.comparisons.iter().filter(|c| c.set == PairSet::All) {
        match by_method.last_mut() {
            Some((method, of_method)) if *method == comparison.compared.method => {
                of_method.push(comparison);
            }
            _ => by_method.push((&comparison.compared.method, vec![comparison])),
        }
    }
    by_method
}

fn time_by_targets(sources: &Sources<'_>) -> Chart {
    let mut chart = Chart::new(
        "time_by_targets.svg",
        "Search time by number of targets (medians)",
        ("targets", "ms, elapsed"),
    )
    .log_y();
    let median = |spread: Option<Spread>| spread.map_or(f64::NAN, |spread| spread.median);
    let by_method = by_method(sources);
    if let Some((_, comparisons)) = by_method.first() {
        chart.line(
            sources.baseline,
            comparisons
                .iter()
                .map(|c| (f64::from(c.targets), median(c.baseline.search_ms))),
        );
    }
    for (method, comparisons) in &by_method {
        chart.line(
            method,
            comparisons
                .iter()
                .map(|c| (f64::from(c.targets), median(c.compared.search_ms))),
        );
    }
    if chart.has_data() {
        let rows = paper::TARGET_COUNTS;
        chart.thin_line(
            "paper, TiEV A*",
            rows.map(|r| (f64::from(r.targets), r.tiev_ms)),
        );
        chart.thin_line(
            "paper, improved TiEV A*",
            rows.map(|r| (f64::from(r.targets), r.fcn_ms)),
        );
    }
    chart
}

fn reached_by_targets(sources: &Sources<'_>) -> Chart {
    let mut chart = Chart::new(
        "reached_by_targets.svg",
        "Targets reached by number of targets",
        ("targets", "% of the targets"),
    )
    .starting_at_zero();
    let share = |solved: Option<f64>, targets: u32| {
        (
            f64::from(targets),
            solved.unwrap_or(f64::NAN) / f64::from(targets) * 100.0,
        )
    };
    let by_method = by_method(sources);
    if let Some((_, comparisons)) = by_method.first() {
        chart.line(
            sources.baseline,
            comparisons
                .iter()
                .map(|c| share(c.baseline.solved_mean, c.targets)),
        );
    }
    for (method, comparisons) in &by_method {
        chart.line(
            method,
            comparisons
                .iter()
                .map(|c| share(c.compared.solved_mean, c.targets)),
        );
    }
    if chart.has_data() {
        let rows = paper::TARGET_COUNTS;
        let of_paper = |solved: u32, targets| share(Some(f64::from(solved)), targets);
        chart.thin_line(
            "paper, TiEV A*",
            rows.map(|r| of_paper(r.tiev_solved, r.targets)),
        );
        chart.thin_line(
            "paper, improved TiEV A*",
            rows.map(|r| of_paper(r.fcn_solved, r.targets)),
        );
    }
    chart
}

/// A column of the status over steps, a line a run.
fn training(
    sources: &Sources<'_>,
    file: &'static str,
    (title, column): (&'static str, &'static str),
) -> Result<Chart, Error> {
    let mut chart = Chart::new(file, title, ("step", column));
    let status = &sources.tables.status;
    let runs = names(status, "run", TABLE)?;
    let steps = counts(status, "step", TABLE)?;
    let values = numbers(status, column, TABLE)?;
    let mut distinct = runs.clone();
    distinct.sort();
    distinct.dedup();
    for run in &distinct {
        let mut points: Vec<(f64, f64)> = (0..runs.len())
            .filter(|row| runs[*row] == *run)
            .map(|row| (steps[row] as f64, values[row]))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        chart.line(run, points);
    }
    Ok(chart)
}

/// mIoU over steps as the status says, the paper's and the baselines' as level lines.
fn miou(sources: &Sources<'_>) -> Result<Chart, Error> {
    let mut chart = training(sources, "miou.svg", ("mIoU", "miou"))?;
    let Some((first, last)) = chart.x_range() else {
        return Ok(chart);
    };
    // A single evaluation has no width for a level line to be drawn over.
    let last = if first < last { last } else { first + 1.0 };
    let mut level = |name: &str, value: f64| chart.thin_line(name, [(first, value), (last, value)]);
    if sources.agreements.iter().any(Agreement::is_comparable) {
        level("paper", paper::MIOU);
    }
    for agreement in sources
        .agreements
        .iter()
        .filter(|a| !a.subject.is_learned() && a.subject.group.is_empty())
    {
        if let Some(miou) = agreement.sums.miou() {
            let subject = &agreement.subject;
            level(&format!("{} ({})", subject.predictor, subject.split), miou);
        }
    }
    Ok(chart)
}

/// mIoU over the distance of the target, at the nearer end of each group.
fn miou_by_distance(sources: &Sources<'_>) -> Chart {
    let labels = ("distance of the target, from (m)", "mIoU");
    let mut chart = Chart::new("miou_by_distance.svg", "mIoU by distance", labels);
    let mut lines: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for agreement in sources.agreements.iter().filter(|a| a.is_newest) {
        let subject = &agreement.subject;
        if let (Some(from_m), Some(miou)) = (subject.distance_m(), agreement.sums.miou()) {
            let name = format!("{} ({})", subject.predictor, subject.split);
            lines.entry(name).or_default().push((from_m, miou));
        }
    }
    for (name, mut points) in lines {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        chart.line(&name, points);
    }
    chart
}

fn samples_per_s(sources: &Sources<'_>) -> Chart {
    let mut chart = Chart::new(
        "samples_per_s.svg",
        "Samples a second, all generators",
        ("time since the first sample (s)", "samples a second"),
    )
    .starting_at_zero();
    let rates = &sources.health.samples.rates;
    let mut recordings: Vec<u64> = rates.iter().map(|point| point.recording).collect();
    recordings.dedup();
    for recording in recordings {
        let of_recording = rates.iter().filter(|point| point.recording == recording);
        chart.line(
            &format!("recording {}", recording + 1),
            of_recording.map(|point| (point.time_s, point.rate_per_s)),
        );
    }
    chart
}

fn weights_age(sources: &Sources<'_>) -> Result<Chart, Error> {
    let mut chart = Chart::new(
        "weights_age.svg",
        "Age of the weights at each plan",
        ("time since the first plan (s)", "age (s)"),
    );
    let plans = &sources.tables.plans;
    let recordings = counts(plans, "recording", TABLE)?;
    let log_nanos = counts(plans, "log_nanos", TABLE)?;
    let ages_s = numbers(plans, "weights_age_s", TABLE)?;
    let mut distinct = recordings.clone();
    distinct.sort_unstable();
    distinct.dedup();
    for recording in distinct {
        let rows = (0..recordings.len()).filter(|row| recordings[*row] == recording);
        let start = rows.clone().map(|row| log_nanos[row]).min().unwrap_or(0);
        let points = rows
            .map(|row| ((log_nanos[row] - start) as f64 * 1e-9, ages_s[row]))
            .filter(|(_, age_s)| age_s.is_finite())
            .collect();
        chart.series.push(Series {
            name: format!("recording {}", recording + 1),
            mark: Mark::Points,
            points,
        });
    }
    Ok(chart)
}

fn latency(sources: &Sources<'_>) -> Result<Chart, Error> {
    let mut chart = Chart::new(
        "latency.svg",
        "From a grid's arrival to its plan",
        ("latency (ms)", "plans"),
    );
    let mut latencies_ms = numbers(&sources.tables.plans, "latency_ms", TABLE)?;
    latencies_ms.retain(|latency| *latency > 0.0);
    let Some(spread) = Spread::of(latencies_ms.iter().copied()) else {
        return Ok(chart);
    };
    let width = ((spread.most - spread.least) / LATENCY_BARS as f64).max(1e-3);
    let mut bars = vec![0u32; LATENCY_BARS];
    for latency in latencies_ms {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "no latency is below the least, and the cast saturates"
        )]
        let bar = ((latency - spread.least) / width) as usize;
        bars[bar.min(LATENCY_BARS - 1)] += 1;
    }
    let edges = (0..LATENCY_BARS).map(|bar| spread.least + bar as f64 * width);
    chart.bars = edges
        .zip(bars)
        .map(|(edge, plans)| (edge, edge + width, f64::from(plans)))
        .collect();
    Ok(chart)
}
