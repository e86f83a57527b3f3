//! What a planner node logs of messages that it cannot use, or only with care: each cause, and not each
//! message.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::{Arc, Mutex};
use std::time::Instant;

use surroundings::{Moment, Surroundings, config, soon};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::Weights;
use swath_bridge::signature::{SigningKey, sign};
use swath_bridge::{FREE, GridSpec, Occupancy, Pose2, keys};
use swath_planner::network::{Network, NetworkInfo, Parameters};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata};

mod surroundings;

/// The texts of all warnings so far.
#[derive(Debug, Clone, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    fn with(&self, part: &str) -> Vec<String> {
        let all = self.0.lock().unwrap();
        all.iter()
            .filter(|text| text.contains(part))
            .cloned()
            .collect()
    }
}

struct Text<'a>(&'a mut String);

impl Visit for Text<'_> {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "message" {
            *self.0 = format!("{value:?}");
        }
    }
}

impl tracing::Subscriber for Warnings {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN && metadata.target().starts_with("swath")
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut text = String::new();
        event.record(&mut Text(&mut text));
        self.0.lock().unwrap().push(text);
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

fn weights(run: &str, version: u64, info: &NetworkInfo) -> Weights {
    let mut weights = Weights {
        header: Header::at(version * 1000, ""),
        run: run.to_owned(),
        version,
        step: version,
        epoch: 0,
        architecture: "enet".to_owned(),
        input_rows: 0,
        input_cols: 0,
        vehicle: info.vehicle.clone(),
        loss: 0.0,
        miou: f32::NAN,
        iou_path: f32::NAN,
        iou_background: f32::NAN,
        digest: [0; 32],
        public_key: Vec::new(),
        signature: Vec::new(),
        safetensors: Network::save(info, &Parameters::initial(info.architecture, version)),
    };
    sign(&mut weights, &SigningKey::from_bytes(&[7; 32])).unwrap();
    weights
}

/// The only test of this file, since it takes the log of the whole process.
/// Causes, what is logged of each, and whether it is said only once.
const CAUSES: [(&str, &str, bool); 3] = [
    (
        "they are for another grid",
        "the network is for 400 x 151 cells",
        true,
    ),
    (
        "the size cannot be worked with",
        "need 60551 values, found 17",
        false,
    ),
    (
        "a cell's value is out of range",
        "value 101 at index 7",
        false,
    ),
];

#[tokio::test(flavor = "multi_thread")]
async fn each_cause_is_logged_and_not_each_message() {
    let warnings = Warnings::default();
    tracing::subscriber::set_global_default(warnings.clone()).unwrap();
    let begin = Instant::now();
    let mut node = Surroundings::start(config(), None).await;
    let topic = keys::weights("test");
    let publisher = node.session.publisher(&topic).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    let other_vehicle = NetworkInfo {
        vehicle: "0123456789abcdef".to_owned(),
        ..NetworkInfo::default()
    };
    let other_grid = NetworkInfo {
        spec: GridSpec {
            rows: 400,
            ..GridSpec::default()
        },
        ..NetworkInfo::default()
    };
    for version in 1..=3 {
        let grid = weights("small", 20 + version, &other_grid);
        publisher.put(&grid).await.unwrap();
        let vehicle = weights("truck", 10 + version, &other_vehicle);
        publisher.put(&vehicle).await.unwrap();
        // The queue holds a few: one after the other.
        let moment = Moment {
            grid: Some(Occupancy::filled(GridSpec::default(), FREE).to_message(Header::at(0, ""))),
            targets: Some(("", vec![Pose2::new(20.0, 0.0, 0.0)])),
            ..Moment::default()
        };
        node.plan(&moment, |report| {
            let refused = report.rejected.iter().filter(|one| one.topic == "weights");
            refused.map(|one| one.messages).sum::<u64>() >= version && report.chosen >= 0
        })
        .await;
    }
    let mut short = Occupancy::filled(GridSpec::default(), FREE).to_message(Header::at(0, ""));
    let mut damaged = short.clone();
    short.data.truncate(17);
    damaged.data[7] = 101;
    for _ in 0..20 {
        for grid in [&short, &damaged] {
            node.grids.put(grid).await.unwrap();
            node.next_report(|_| true).await;
        }
    }
    let rejections = node.end().await.rejections;
    let elapsed = begin.elapsed();
    for (cause, text, once) in CAUSES {
        let counted = rejections.iter().find(|one| one.cause == cause).unwrap();
        assert!(counted.messages >= 1, "{counted:?}");
        let lines = warnings.with(text);
        let lines: Vec<_> = lines
            .iter()
            .filter(|line| !line.starts_with("the path is empty"))
            .collect();
        // One for each ten seconds at most, besides the first.
        let most = if once { 1 } else { 1 + elapsed.as_secs() / 10 };
        assert!(!lines.is_empty() && lines.len() as u64 <= most, "{lines:?}");
    }
    let lines = warnings.with("another vehicle");
    assert_eq!(lines.len(), 1, "{lines:?}");
    assert!(lines[0].contains("\"truck\"") && lines[0].contains("0123456789abcdef"));
}
