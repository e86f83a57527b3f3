//! Scores as the messages that a report is made from: one of all samples, one of each group.

use swath_bridge::clock;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::Evaluation;

use crate::score::DISTANCE_GROUPS_M;
use crate::{Counts, Report};

/// What was evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Evaluated<'a> {
    /// Training run.
    pub run: &'a str,
    /// Version of the weights, 0 for none.
    pub version: u64,
    /// Architecture, or the name of a baseline.
    pub predictor: &'a str,
    /// What it was evaluated on.
    pub split: &'a str,
}

/// The evaluation as a whole, then by kind of scene and by distance of the target. Groups without
/// samples are left out.
pub fn evaluations(of: Evaluated<'_>, report: &Report) -> Vec<Evaluation> {
    let scores = &report.scores;
    let scenes = scores.by_scene.iter();
    let scenes = scenes.map(|(scene, counts)| (format!("scene/{scene}"), *counts));
    let mut from_m = 0.0;
    let distances = DISTANCE_GROUPS_M.iter().zip(scores.by_distance);
    let distances = distances.map(|(&to_m, counts)| {
        let group = if to_m.is_finite() {
            format!("distance/{from_m:.0}-{to_m:.0} m")
        } else {
            format!("distance/{from_m:.0} m on")
        };
        from_m = to_m;
        (group, counts)
    });
    std::iter::once((String::new(), scores.total))
        .chain(scenes)
        .chain(distances)
        .filter(|(_, counts)| counts.samples > 0)
        .map(|(group, counts)| evaluation(of, report, (group, &counts)))
        .collect()
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "messages are of single precision"
)]
fn evaluation(
    of: Evaluated<'_>,
    report: &Report,
    (group, counts): (String, &Counts),
) -> Evaluation {
    Evaluation {
        header: Header::at(clock::now_nanos(), ""),
        run: of.run.to_owned(),
        weights_version: of.version,
        predictor: of.predictor.to_owned(),
        split: of.split.to_owned(),
        group,
        dilation_m: report.dilation_m as f32,
        samples: counts.samples,
        intersection_path: counts.intersection_path,
        union_path: counts.union_path,
        intersection_background: counts.intersection_background,
        union_background: counts.union_background,
        joined: counts.joined,
        ms_per_sample: report.ms_per_sample as f32,
    }
}
