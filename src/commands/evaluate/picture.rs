//! Samples in a row, from the worst predicted to the best.

use std::path::Path;

use swath_bridge::Pose2;
use swath_bridge::picture::{BLACK, BLUE, GREEN, ORANGE, Picture, RED};
use swath_planner::Plane;
use swath_trainer::{Example, Predictor, ranked};

use crate::config::Config;

/// Which samples are shown: so much of all of them are predicted worse.
const RANKS: [f64; 8] = [0.0, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0];
const PIXELS_A_CELL: u32 = 2;
const GOAL_RADIUS_M: f64 = 0.5;
const LINE_PX: f64 = 2.0;

/// Draws the samples: obstacles black, reference blue, what is in label and region green, in the label
/// alone red, in the region alone orange.
pub(super) fn draw(
    path: &Path,
    predictor: Predictor<'_>,
    (examples, dilation_m): (&[Example], f64),
    config: &Config,
) -> anyhow::Result<()> {
    let ranked = ranked(predictor, examples, dilation_m)?;
    let last = ranked.len().saturating_sub(1) as f64;
    let mut pictures = Vec::new();
    for rank in RANKS {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a small count"
        )]
        let index = (rank * last).round() as usize;
        let (iou, example, region) = &ranked[index];
        let label = example.label_at(dilation_m);
        let mut picture = of_sample(example, (region, &label), config);
        picture.text(&format!("{iou:.2}"), (6.0, 6.0), BLACK);
        pictures.push(picture);
    }
    Picture::side_by_side(&pictures).write_png(path)?;
    Ok(())
}

fn of_sample(example: &Example, (region, label): (&Plane, &Plane), config: &Config) -> Picture {
    let mut picture = Picture::blank(&example.spec, PIXELS_A_CELL);
    picture.overlay(BLUE, 0.15, |cell| example.reference.get(cell));
    picture.overlay(GREEN, 0.6, |cell| region.get(cell) && label.get(cell));
    picture.overlay(RED, 0.7, |cell| !region.get(cell) && label.get(cell));
    picture.overlay(ORANGE, 0.7, |cell| region.get(cell) && !label.get(cell));
    picture.overlay(BLACK, 1.0, |cell| example.obstacles.get(cell));
    picture.line(&example.path, BLACK, 1.0);
    picture.disc(&example.goal, GOAL_RADIUS_M, RED);
    let front = example.goal.then(&Pose2::new(2.0, 0.0, 0.0));
    picture.line(&[example.goal, front], RED, LINE_PX);
    picture.vehicle(&Pose2::default(), &config.vehicle, BLUE);
    picture
}
