//! `swath evaluate`: a network and two baselines against labels.

use std::path::Path;

use serde::Serialize;
use swath_bridge::recording::Writer;
use swath_bridge::{clock, keys};
use swath_trainer::{
    DISTANCE_GROUPS_M, Evaluated, IOU_GROUPS, Limits, Predictor, Ranking, Report, evaluate,
    evaluations, limits, ranking,
};

use super::train::{open, set_aside};
use crate::cli::EvaluateOptions;
use crate::config::Config;
use crate::human::{decimal, percent};
use crate::output::{self, Failure};
use crate::{network, outputs};

mod picture;

/// Run that evaluations of files are recorded under.
const RUN: &str = "file";

/// Runs the command.
pub(crate) fn run(options: &EvaluateOptions, config: &Config) -> Result<(), Failure> {
    for out in options.out.iter().chain(&options.picture) {
        outputs::test_apart(out, options.data.iter().chain(&options.weights))?;
        outputs::test_file(out)?;
    }
    let network = network::load(options.weights.as_deref())?;
    let mut examples = open(&options.data)?.into_examples();
    if let Some(count) = options.aside.aside {
        examples = set_aside(examples, &options.aside, count).1;
    }
    let info = network.info();
    let dilation_m = options.dilation_m.unwrap_or(info.label_dilation_m);
    let predictors = [
        Predictor::Network(&network),
        Predictor::Reference {
            already_m: info.reference_dilation_m,
        },
        Predictor::Dubins {
            vehicle: &config.vehicle,
        },
    ];
    let mut reports = Vec::new();
    for predictor in predictors.iter().copied() {
        reports.push((
            predictor.name(),
            evaluate(predictor, &examples, dilation_m, true)?,
        ));
    }
    let ranking = ranking(&network, &examples)?;
    if options.limits {
        print_limits(&limits(&network, &examples, &config.vehicle)?)?;
    }
    if let Some(path) = &options.picture {
        picture::draw(path, predictors[0], (&examples, dilation_m), config)?;
    }
    if let Some(out) = &options.out {
        record(out, &split_name(options), &reports)?;
    }
    if options.json {
        output::json(&Json::new(&reports, ranking)?)?;
    } else {
        print(&reports)?;
        print_ranking(ranking)?;
    }
    Ok(())
}

fn split_name(options: &EvaluateOptions) -> String {
    let stems = options.data.iter().filter_map(|path| path.file_stem());
    stems
        .map(|stem| stem.to_string_lossy())
        .collect::<Vec<_>>()
        .join("+")
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Json {
    #[serde(flatten)]
    network: ScoreJson,
    ms_per_sample: f64,
    dilation_m: f64,
    by_scene: Vec<(String, ScoreJson)>,
    by_distance: Vec<DistanceJson>,
    baselines: Vec<(&'static str, ScoreJson)>,
    /// How well targets are ranked before any search.
    ranking: Option<RankingJson>,
}

#[derive(Debug, Serialize)]
struct RankingJson {
    solvable: usize,
    unsolvable: usize,
    auc: f64,
    auc_clearance: f64,
    rank_cost: f64,
    rank_steps: f64,
}

#[derive(Debug, Serialize)]
struct ScoreJson {
    samples: u64,
    miou: f64,
    iou_path: f64,
    iou_background: f64,
    joined_share: f64,
}

#[derive(Debug, Serialize)]
struct DistanceJson {
    /// Metres; null beyond the last group.
    to_m: f64,
    #[serde(flatten)]
    score: ScoreJson,
}

impl ScoreJson {
    fn new(counts: &swath_trainer::Counts) -> Self {
        Self {
            samples: counts.samples,
            miou: counts.miou(),
            iou_path: counts.iou_path(),
            iou_background: counts.iou_background(),
            joined_share: counts.joined_share(),
        }
    }
}

impl Json {
    fn new(reports: &[(&'static str, Report)], ranking: Option<Ranking>) -> anyhow::Result<Self> {
        let Some(((_, network), baselines)) = reports.split_first() else {
            anyhow::bail!("nothing was evaluated");
        };
        let scenes = network.scores.by_scene.iter();
        let groups = DISTANCE_GROUPS_M.iter().zip(&network.scores.by_distance);
        Ok(Self {
            network: ScoreJson::new(&network.scores.total),
            ms_per_sample: network.ms_per_sample,
            dilation_m: network.dilation_m,
            by_scene: scenes
                .map(|(scene, counts)| (scene.clone(), ScoreJson::new(counts)))
                .collect(),
            by_distance: groups
                .map(|(&to_m, counts)| DistanceJson {
                    to_m,
                    score: ScoreJson::new(counts),
                })
                .collect(),
            baselines: baselines
                .iter()
                .map(|(name, report)| (*name, ScoreJson::new(&report.scores.total)))
                .collect(),
            ranking: ranking.map(|ranking| RankingJson {
                solvable: ranking.targets.0,
                unsolvable: ranking.targets.1,
                auc: ranking.auc,
                auc_clearance: ranking.auc_clearance,
                rank_cost: ranking.rank_cost,
                rank_steps: ranking.rank_steps,
            }),
        })
    }
}

fn print_ranking(ranking: Option<Ranking>) -> anyhow::Result<()> {
    let Some(ranking) = ranking else {
        return Ok(());
    };
    let (with, without) = ranking.targets;
    output::line(format_args!(
        "targets before any search: {with} with a path, {without} without; area under the ROC curve \
         {} (clearance alone {}); rank correlation with cost {}, with steps {}",
        decimal(ranking.auc, 3),
        decimal(ranking.auc_clearance, 3),
        decimal(ranking.rank_cost, 3),
        decimal(ranking.rank_steps, 3)
    ))
}

fn print_limits(limits: &Limits) -> anyhow::Result<()> {
    output::line(format_args!(
        "labels against other paths of the same cost, {} samples: mIoU {}, path IoU {}",
        limits.ties.samples,
        percent(limits.ties.miou(), 2),
        percent(limits.ties.iou_path(), 2)
    ))?;
    let mut from = 0.0;
    for (to, group) in IOU_GROUPS.iter().zip(limits.groups) {
        output::line(format_args!(
            "regions with a path IoU from {from:.2} on: {} samples, path found to {}, ratio of cost to \
             optimum {}, at most 1.01 in {}",
            group.samples,
            group.solved,
            decimal(group.cost_ratios / group.solved as f64, 3),
            group.as_good
        ))?;
        from = *to;
    }
    Ok(())
}

fn print(reports: &[(&'static str, Report)]) -> anyhow::Result<()> {
    output::line("predictor            samples     mIoU  path IoU  background IoU  joined  ms")?;
    for (name, report) in reports {
        let total = &report.scores.total;
        output::line(format_args!(
            "{name:<20} {:>7}  {:>7}  {:>8}  {:>14}  {:>6}  {}",
            total.samples,
            percent(total.miou(), 2),
            percent(total.iou_path(), 2),
            percent(total.iou_background(), 2),
            percent(total.joined_share(), 1),
            decimal(report.ms_per_sample, 2),
        ))?;
    }
    let Some((_, network)) = reports.first() else {
        return Ok(());
    };
    for (scene, counts) in &network.scores.by_scene {
        output::line(format_args!(
            "  {scene:<18} {:>7}  {:>7}",
            counts.samples,
            percent(counts.miou(), 2)
        ))?;
    }
    let mut from_m = 0.0;
    for (to_m, counts) in DISTANCE_GROUPS_M.iter().zip(&network.scores.by_distance) {
        if counts.samples > 0 {
            output::line(format_args!(
                "  {from_m:>3.0} m to {to_m:>3.0} m     {:>7}  {:>7}",
                counts.samples,
                percent(counts.miou(), 2)
            ))?;
        }
        from_m = *to_m;
    }
    Ok(())
}

/// Writes the counts, from which a report makes its table.
fn record(out: &Path, split: &str, reports: &[(&'static str, Report)]) -> anyhow::Result<()> {
    let mut writer = Writer::create(out)?;
    for (predictor, report) in reports {
        let of = Evaluated {
            run: RUN,
            version: 0,
            predictor,
            split,
        };
        for message in evaluations(of, report) {
            let now = clock::now_nanos();
            writer.write(&keys::evaluation(RUN), &message, now, now)?;
        }
    }
    writer.finish()?;
    Ok(())
}
