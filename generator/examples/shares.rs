//! Counts outcomes, search steps and time by kind of scene.
//!
//! `cargo run --release -p swath-generator --example shares -- [SAMPLES] [SEED]`

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write;
use std::time::Instant;

use swath_bridge::Outcome;
use swath_generator::{Generator, GeneratorConfig, Scenes};
use swath_planner::search::SearchMemory;

#[derive(Default)]
struct Row {
    outcomes: [u64; Outcome::ALL.len()],
    steps: Vec<u64>,
    times_ms: Vec<f64>,
    obstacles: u64,
    goals_m: Vec<f32>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let samples: u64 = arguments.next().map_or(Ok(700), |text| text.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let generator = Generator::new(GeneratorConfig::default(), Scenes::Procedural)?;
    let mut memory = SearchMemory::new();
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    for index in 0..samples {
        let begin = Instant::now();
        let sample = generator.sample(seed, index, &mut memory)?;
        let time_ms = begin.elapsed().as_secs_f64() * 1e3;
        for name in [sample.scene.as_str(), "~ all"] {
            let row = rows.entry(name.to_owned()).or_default();
            row.outcomes[usize::from(sample.outcome)] += 1;
            row.steps.push(sample.steps);
            row.times_ms.push(time_ms);
            row.goals_m.push(sample.goal.x_m.hypot(sample.goal.y_m));
            row.obstacles += sample
                .obstacles
                .iter()
                .map(|b| u64::from(b.count_ones()))
                .sum::<u64>();
        }
    }
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "scene: {:?}; steps median, p90; ms mean, p90; cells; metres p10, median, p90",
        Outcome::ALL.map(Outcome::name)
    )?;
    for (name, row) in &mut rows {
        row.steps.sort_unstable();
        row.times_ms.sort_by(f64::total_cmp);
        row.goals_m.sort_by(f32::total_cmp);
        let count = row.steps.len();
        let mean_ms = row.times_ms.iter().sum::<f64>() / count as f64;
        writeln!(
            out,
            "{name:10} {:?}  {:6} {:6}  {mean_ms:6.1} {:6.1}  {}  {:.0} {:.0} {:.0}",
            row.outcomes,
            row.steps[count / 2],
            row.steps[count * 9 / 10],
            row.times_ms[count * 9 / 10],
            row.obstacles / count as u64,
            row.goals_m[count / 10],
            row.goals_m[count / 2],
            row.goals_m[count * 9 / 10],
        )?;
    }
    Ok(())
}
