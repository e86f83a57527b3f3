//! Methods against each other on the same frames.
//!
//! A pair is two plans, one of each method, in one recording, of the same vehicle, stamp, frame,
//! scene and goals. Only pairs are compared. A method that planned a frame twice enters with its
//! first plan.

use polars::prelude::{
    DataFrame, IntoLazy as _, JoinArgs, JoinType, LazyFrame, SortMultipleOptions, col, lit,
};

use crate::Error;
use crate::error::InTable as _;
use crate::frames::{names, numbers};
use crate::spread::{Spread, ratio};
use crate::tables::Tables;

/// What two plans must share to be a pair.
const KEYS: [&str; 7] = [
    "recording",
    "vehicle",
    "stamp_nanos",
    "frame",
    "scene",
    "targets",
    "goals_digest",
];
/// What of each plan is compared.
const MEASURES: [&str; 7] = [
    "plan",
    "solved",
    "steps",
    "network_ms",
    "search_ms",
    "cpu_ms",
    "total_ms",
];
/// Ends the names of the compared method's columns.
pub(crate) const COMPARED: &str = "_compared";
const TABLE: &str = "comparisons";

/// Which pairs a comparison is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PairSet {
    /// Every pair, whatever became of its targets.
    All,
    /// Pairs in which both methods reached every target.
    Solved,
}

impl PairSet {
    /// Name in tables.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Solved => "solved",
        }
    }
}

/// One method's part of a comparison.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Side {
    /// Method.
    pub(crate) method: String,
    /// Mean number of targets reached.
    pub(crate) solved_mean: Option<f64>,
    /// Expansions of all targets together.
    pub(crate) steps: Option<Spread>,
    /// Elapsed, network.
    pub(crate) network_ms: Option<Spread>,
    /// Elapsed, search.
    pub(crate) search_ms: Option<Spread>,
    /// Processor time of the whole plan.
    pub(crate) cpu_ms: Option<Spread>,
    /// Elapsed, network and search.
    pub(crate) total_ms: Option<Spread>,
}

/// How many times as much the compared method takes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Ratio {
    /// Of the two medians.
    pub(crate) of_medians: Option<f64>,
    /// Of each pair.
    pub(crate) of_pairs: Option<Spread>,
}

/// Targets of pairs, one by one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct TargetComparison {
    /// Targets of all pairs.
    pub(crate) targets: usize,
    /// Reached by both methods.
    pub(crate) both: usize,
    /// Reached by the baseline alone.
    pub(crate) baseline_only: usize,
    /// Reached by the compared method alone.
    pub(crate) compared_only: usize,
    /// Expansions by target that both reached.
    pub(crate) steps: Ratio,
    /// Processor time by target that both reached.
    pub(crate) time: Ratio,
    /// Cost by target that both reached.
    pub(crate) cost: Ratio,
}

/// Two methods on the pairs of one number of targets.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Comparison {
    /// Number of targets of each plan.
    pub(crate) targets: u32,
    /// Which pairs.
    pub(crate) set: PairSet,
    /// Number of pairs.
    pub(crate) pairs: usize,
    /// The method that is compared with.
    pub(crate) baseline: Side,
    /// The method that is compared.
    pub(crate) compared: Side,
    /// Of expansions.
    pub(crate) steps: Ratio,
    /// Of the elapsed search time.
    pub(crate) search: Ratio,
    /// Of processor time.
    pub(crate) cpu: Ratio,
    /// Of elapsed time, the network included.
    pub(crate) total: Ratio,
    /// Target by target.
    pub(crate) by_target: TargetComparison,
}

/// Compares every method with the baseline, by number of targets, in both sets of pairs. Ordered by
/// method, number of targets and set.
///
/// # Errors
/// [`Error::Table`] if polars fails.
pub(crate) fn comparisons(tables: &Tables, baseline: &str) -> Result<Vec<Comparison>, Error> {
    let mut methods = names(&tables.plans, "method", TABLE)?;
    methods.sort();
    methods.dedup();
    let mut comparisons = Vec::new();
    for method in methods.iter().filter(|method| *method != baseline) {
        let pairs = pairs(&tables.plans, baseline, method)?;
        let targets = target_pairs(&pairs, &tables.targets)?;
        for count in target_counts(&pairs)? {
            for set in [PairSet::All, PairSet::Solved] {
                let chosen = choose(pairs.clone().lazy(), count, set);
                let of_pairs = chosen.collect().in_table(TABLE)?;
                if of_pairs.height() == 0 {
                    continue;
                }
                let chosen = choose(targets.clone().lazy(), count, set);
                let of_targets = chosen.collect().in_table(TABLE)?;
                let by_target = compare_targets(&of_targets)?;
                let compared = compare(&of_pairs, (baseline, method))?;
                comparisons.push(Comparison {
                    targets: count,
                    set,
                    by_target,
                    ..compared
                });
            }
        }
    }
    Ok(comparisons)
}

fn choose(pairs: LazyFrame, targets: u32, set: PairSet) -> LazyFrame {
    let pairs = pairs.filter(col("targets").eq(lit(targets)));
    match set {
        PairSet::All => pairs,
        PairSet::Solved => pairs.filter(
            col("solved")
                .eq(col("targets"))
                .and(col(format!("solved{COMPARED}")).eq(col("targets"))),
        ),
    }
}

/// One row a pair, in the order of the baseline's plans: the keys, the baseline's measures and the compared method's.
pub(crate) fn pairs(plans: &DataFrame, baseline: &str, compared: &str) -> Result<DataFrame, Error> {
    let first_plans_of = |method: &str| {
        plans
            .clone()
            .lazy()
            .filter(col("method").eq(lit(method)).and(col("targets").gt(lit(0))))
            .group_by_stable(KEYS.map(col))
            .agg(MEASURES.map(|measure| col(measure).first()))
    };
    first_plans_of(baseline)
        .join(
            first_plans_of(compared),
            KEYS.map(col),
            KEYS.map(col),
            JoinArgs::new(JoinType::Inner).with_suffix(Some(COMPARED.into())),
        )
        .sort(["plan"], SortMultipleOptions::default())
        .collect()
        .in_table(TABLE)
}

/// One row a target of a pair.
pub(crate) fn target_pairs(pairs: &DataFrame, targets: &DataFrame) -> Result<DataFrame, Error> {
    let keys = ["plan", "targets", "scene", "solved"].map(col).into_iter();
    let compared = ["plan", "solved", "network_ms", "cpu_ms", "total_ms"]
        .map(|name| col(format!("{name}{COMPARED}")));
    let measures = ["plan", "index", "outcome", "cost", "steps", "time_ms"].map(col);
    let targets = targets.clone().lazy().select(measures);
    let plan_compared = format!("plan{COMPARED}");
    pairs
        .clone()
        .lazy()
        .select(keys.chain(compared).collect::<Vec<_>>())
        .join(
            targets.clone(),
            [col("plan")],
            [col("plan")],
            JoinArgs::new(JoinType::Inner),
        )
        .join(
            targets,
            [col(plan_compared), col("index")],
            [col("plan"), col("index")],
            JoinArgs::new(JoinType::Inner).with_suffix(Some(COMPARED.into())),
        )
        .sort(["plan", "index"], SortMultipleOptions::default())
        .collect()
        .in_table(TABLE)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the column holds 32-bit counts"
)]
fn target_counts(pairs: &DataFrame) -> Result<Vec<u32>, Error> {
    let mut counts: Vec<u32> = numbers(pairs, "targets", TABLE)?
        .into_iter()
        .map(|count| count as u32)
        .collect();
    counts.sort_unstable();
    counts.dedup();
    Ok(counts)
}

/// Compares the plans of pairs; the caller knows which pairs they are and adds their targets.
fn compare(pairs: &DataFrame, (baseline, compared): (&str, &str)) -> Result<Comparison, Error> {
    Ok(Comparison {
        targets: 0,
        set: PairSet::All,
        pairs: pairs.height(),
        baseline: side(pairs, baseline, "")?,
        compared: side(pairs, compared, COMPARED)?,
        steps: ratio_of(pairs, "steps")?,
        search: ratio_of(pairs, "search_ms")?,
        cpu: ratio_of(pairs, "cpu_ms")?,
        total: ratio_of(pairs, "total_ms")?,
        by_target: TargetComparison::default(),
    })
}

/// One method's measures, from the columns that end in `suffix`.
///
/// # Errors
/// [`Error::Table`] if a column is missing.
pub(crate) fn side(plans: &DataFrame, method: &str, suffix: &str) -> Result<Side, Error> {
    let column = |name: &str| numbers(plans, &format!("{name}{suffix}"), TABLE);
    let solved = column("solved")?;
    Ok(Side {
        method: method.to_owned(),
        solved_mean: ratio(solved.iter().sum(), solved.len() as f64),
        steps: Spread::of(column("steps")?),
        network_ms: Spread::of(column("network_ms")?),
        search_ms: Spread::of(column("search_ms")?),
        cpu_ms: Spread::of(column("cpu_ms")?),
        total_ms: Spread::of(column("total_ms")?),
    })
}

fn ratio_of(pairs: &DataFrame, measure: &str) -> Result<Ratio, Error> {
    let baseline = numbers(pairs, measure, TABLE)?;
    let compared = numbers(pairs, &format!("{measure}{COMPARED}"), TABLE)?;
    Ok(Ratio::of(&baseline, &compared))
}

impl Ratio {
    fn of(baseline: &[f64], compared: &[f64]) -> Self {
        let medians = (
            Spread::of(compared.iter().copied()),
            Spread::of(baseline.iter().copied()),
        );
        let of_medians = match medians {
            (Some(compared), Some(baseline)) => ratio(compared.median, baseline.median),
            _ => None,
        };
        let of_pairs = baseline.iter().zip(compared);
        Self {
            of_medians,
            of_pairs: Spread::of(of_pairs.filter_map(|(below, above)| ratio(*above, *below))),
        }
    }
}

fn compare_targets(targets: &DataFrame) -> Result<TargetComparison, Error> {
    let solved = |column: &str| -> Result<Vec<bool>, Error> {
        let outcomes = names(targets, column, TABLE)?;
        Ok(outcomes.iter().map(|outcome| outcome == "solved").collect())
    };
    let by_baseline = solved("outcome")?;
    let by_compared = solved(&format!("outcome{COMPARED}"))?;
    let count = |baseline: bool, compared: bool| {
        by_baseline
            .iter()
            .zip(&by_compared)
            .filter(|(first, second)| (**first, **second) == (baseline, compared))
            .count()
    };
    let ratio_where_both = |measure: &str| -> Result<Ratio, Error> {
        let of_both = |column: &str| -> Result<Vec<f64>, Error> {
            let values = numbers(targets, column, TABLE)?.into_iter();
            let both = by_baseline.iter().zip(&by_compared);
            let chosen = values
                .zip(both)
                .filter(|(_, (first, second))| **first && **second);
            Ok(chosen.map(|(value, _)| value).collect())
        };
        Ok(Ratio::of(
            &of_both(measure)?,
            &of_both(&format!("{measure}{COMPARED}"))?,
        ))
    };
    Ok(TargetComparison {
        targets: targets.height(),
        both: count(true, true),
        baseline_only: count(true, false),
        compared_only: count(false, true),
        steps: ratio_where_both("steps")?,
        time: ratio_where_both("time_ms")?,
        cost: ratio_where_both("cost")?,
    })
}
