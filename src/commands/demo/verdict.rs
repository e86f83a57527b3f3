//! Whether the machine kept up with a demo, in words.

use swath_analysis::{PlannerSummary, Summary, TrainerSummary};

use crate::human;

/// A planner that misses more than this share of its grids, or is late with it, is too slow.
const MOST_MISSED: f64 = 0.1;
/// A trainer whose stream loses more than this share is too slow.
const MOST_LOST: f64 = 0.01;

/// What the demo says of the machine, a line each, at most 100 characters.
pub(super) fn lines(summary: &Summary) -> Vec<String> {
    let mut faults: Vec<String> = summary.planners.iter().flat_map(of_planner).collect();
    faults.extend(summary.trainers.iter().flat_map(of_trainer));
    if summary.trainers.is_empty() {
        faults.push("the trainer took no step".to_owned());
    }
    if !summary.planners.iter().any(|planner| planner.frames > 0) {
        faults.push("no frame was planned".to_owned());
    }
    if faults.is_empty() {
        return vec![
            "the machine kept up: grids were planned in time, no samples were lost".to_owned(),
        ];
    }
    let mut lines = vec!["the machine was too slow for all of this at once:".to_owned()];
    lines.extend(faults.into_iter().map(|fault| format!("  {fault}")));
    lines.push(
        "what helps: a longer run (--seconds), no other programs beside it, more cores,".to_owned(),
    );
    lines.push("or fewer nodes at a time (swath plan, swath generate, swath train)".to_owned());
    lines
}

fn of_planner(planner: &PlannerSummary) -> Vec<String> {
    let PlannerSummary {
        vehicle,
        frames,
        skipped,
        late,
        ..
    } = planner;
    let mut faults = Vec::new();
    let grids = frames + skipped;
    if *skipped as f64 > MOST_MISSED * grids as f64 {
        faults.push(format!(
            "planner {vehicle}: {skipped} of {grids} grids were not planned, newer ones came first"
        ));
    }
    if *late as f64 > MOST_MISSED * *frames as f64 {
        faults.push(format!(
            "planner {vehicle}: {late} of {frames} plans were ready after their deadline"
        ));
    }
    faults
}

fn of_trainer(trainer: &TrainerSummary) -> Vec<String> {
    let TrainerSummary {
        received, missing, ..
    } = trainer;
    let mut faults = Vec::new();
    if trainer.steps == 0 {
        faults.push("the trainer took no step".to_owned());
    }
    let sent = received.saturating_add(*missing);
    if *missing as f64 > MOST_LOST * sent as f64 {
        let rate = trainer.steps_per_s.map_or(f64::NAN, |rate| rate);
        faults.push(format!(
            "trainer {}: {missing} of {sent} samples were lost, at {} steps a second",
            trainer.run,
            human::rate(rate)
        ));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planner(frames: u64, skipped: u64, late: u64) -> PlannerSummary {
        PlannerSummary {
            vehicle: "v0".to_owned(),
            frames,
            skipped,
            late,
            targets: 50 * frames,
            solved: 40 * frames,
            stops: 0,
            stops_by_reason: Vec::new(),
            latency_ms: Some(20.0),
        }
    }

    fn trainer(steps: u64, missing: u64) -> TrainerSummary {
        TrainerSummary {
            run: "main".to_owned(),
            steps,
            steps_per_s: Some(1.5),
            received: 1000,
            missing,
        }
    }

    fn said(planners: Vec<PlannerSummary>, trainers: Vec<TrainerSummary>) -> String {
        let summary = Summary {
            planners,
            trainers,
            ..Summary::default()
        };
        let lines = lines(&summary);
        assert!(
            lines.iter().all(|line| line.chars().count() <= 100),
            "{lines:?}"
        );
        lines.join("\n")
    }

    #[test]
    fn a_machine_that_kept_up_is_told_so() {
        let said = said(vec![planner(1000, 40, 3)], vec![trainer(200, 5)]);
        assert!(said.starts_with("the machine kept up"), "{said}");
    }

    #[test]
    fn what_was_too_slow_is_named_with_its_figures() {
        let words = said(vec![planner(700, 300, 400)], vec![trainer(200, 500)]);
        for fact in [
            "300 of 1000 grids",
            "400 of 700 plans",
            "500 of 1500 samples",
            "1.5 steps",
        ] {
            assert!(words.contains(fact), "{fact} is not in {words}");
        }
        let words = said(vec![planner(0, 0, 0)], vec![]);
        assert!(words.contains("no frame was planned"), "{words}");
        assert!(words.contains("the trainer took no step"), "{words}");
    }
}
