//! Every key expression of swath, each with its message and quality of service.
//!
//! Keys are relative to the session's namespace. In a recording a key's topic is the key behind a
//! slash, as ROS names topics.

use std::marker::PhantomData;

use crate::msg::Message;
use crate::msg::geometry::PoseArray;
use crate::msg::nav::{OccupancyGrid, Odometry, Path};
use crate::msg::swath::{Evaluation, PlanReport, Sample, TrainStatus, Weights};
use crate::msg::tf2::TFMessage;

/// Every key that carries messages.
pub const EVERYTHING: &str = "swath/**";
/// Every node's liveliness token.
pub const NODES: &str = "swath/node/**";

/// How a topic is carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Qos {
    /// Blocks the sender when the network is behind: samples.
    Block,
    /// Cached, sequenced, given to late joiners and recovered after a loss: weights.
    Durable,
    /// The newest counts, older ones are dropped: grids.
    Newest,
    /// The last one is given to late joiners: references and targets.
    Latched,
    /// The last one of each sender is given to late joiners, and none replaces another: transforms.
    Kept,
    /// Dropped when the network is behind, sent before other data: plans and paths.
    Interactive,
    /// Dropped when the network is behind: status, odometry, pictures.
    Lossy,
}

/// A key expression (with wildcards when it is subscribed to) of messages of one type.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Topic<M> {
    key: String,
    qos: Qos,
    message: PhantomData<fn() -> M>,
}

impl<M: Message> Topic<M> {
    fn new(key: String, qos: Qos) -> Self {
        Self {
            key,
            qos,
            message: PhantomData,
        }
    }

    /// The key expression.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// How it is carried.
    pub const fn qos(&self) -> Qos {
        self.qos
    }
}

/// Samples of one generator, or `*`.
pub fn sample(generator: &str) -> Topic<Sample> {
    Topic::new(format!("swath/sample/{generator}"), Qos::Block)
}

/// Weights of one training run, or `*`.
pub fn weights(run: &str) -> Topic<Weights> {
    Topic::new(format!("swath/weights/{run}"), Qos::Durable)
}

/// Progress of one training run, or `*`.
pub fn train_status(run: &str) -> Topic<TrainStatus> {
    Topic::new(format!("swath/train/{run}"), Qos::Lossy)
}

/// Evaluations of one training run's weights, or `*`.
pub fn evaluation(run: &str) -> Topic<Evaluation> {
    Topic::new(format!("swath/evaluation/{run}"), Qos::Lossy)
}

/// Obstacles around a vehicle, in its frame or in one that odometry or transforms join with it.
pub fn grid(vehicle: &str) -> Topic<OccupancyGrid> {
    Topic::new(format!("swath/vehicle/{vehicle}/grid"), Qos::Newest)
}

/// A vehicle's pose and speed.
pub fn odom(vehicle: &str) -> Topic<Odometry> {
    Topic::new(format!("swath/vehicle/{vehicle}/odom"), Qos::Lossy)
}

/// Transforms between frames. Those with a stamp of zero hold at any time.
pub fn tf(vehicle: &str) -> Topic<TFMessage> {
    Topic::new(format!("swath/vehicle/{vehicle}/tf"), Qos::Kept)
}

/// Transforms that hold at any time, whatever their stamps.
pub fn tf_static(vehicle: &str) -> Topic<TFMessage> {
    Topic::new(format!("swath/vehicle/{vehicle}/tf_static"), Qos::Kept)
}

/// The rough path that a vehicle is to follow, in a frame as that of a grid.
pub fn reference(vehicle: &str) -> Topic<Path> {
    Topic::new(format!("swath/vehicle/{vehicle}/reference"), Qos::Latched)
}

/// Targets given from outside, in a frame as that of a grid.
pub fn targets(vehicle: &str) -> Topic<PoseArray> {
    Topic::new(format!("swath/vehicle/{vehicle}/targets"), Qos::Latched)
}

/// Plans to every target of a frame, in the grid's frame, or why there are none.
pub fn plan(vehicle: &str) -> Topic<PlanReport> {
    Topic::new(format!("swath/vehicle/{vehicle}/plan"), Qos::Interactive)
}

/// The path of the chosen target, for a controller, in the grid's frame; empty when there is none: stop.
pub fn path(vehicle: &str) -> Topic<Path> {
    Topic::new(format!("swath/vehicle/{vehicle}/path"), Qos::Interactive)
}

/// Predicted path regions, for viewing.
pub fn region(vehicle: &str) -> Topic<OccupancyGrid> {
    Topic::new(format!("swath/vehicle/{vehicle}/region"), Qos::Lossy)
}

/// Cells that the search expanded, for viewing.
pub fn explored(vehicle: &str) -> Topic<OccupancyGrid> {
    Topic::new(format!("swath/vehicle/{vehicle}/explored"), Qos::Lossy)
}

/// What the liveliness tokens of a node begin with; behind it each has a part of its own.
pub fn node(kind: &str, id: &str) -> String {
    format!("swath/node/{kind}/{id}")
}

/// Every liveliness token of a node, or of all of a kind for the id `*`.
pub fn node_tokens(kind: &str, id: &str) -> String {
    format!("{}/*", node(kind, id))
}

/// The topic of a key in a recording.
pub fn topic_of_key(key: &str) -> String {
    format!("/{key}")
}

/// The key of a topic in a recording.
pub fn key_of_topic(topic: &str) -> &str {
    topic.strip_prefix('/').unwrap_or(topic)
}

/// The message type and quality of service of a key, or `None` if it is not one of swath's.
pub fn classify(key: &str) -> Option<(&'static str, Qos)> {
    let parts: Vec<&str> = key.split('/').collect();
    let typed = |name, qos| Some((name, qos));
    match parts[..] {
        ["swath", "sample", _] => typed(Sample::TYPE_NAME, Qos::Block),
        ["swath", "weights", _] => typed(Weights::TYPE_NAME, Qos::Durable),
        ["swath", "train", _] => typed(TrainStatus::TYPE_NAME, Qos::Lossy),
        ["swath", "evaluation", _] => typed(Evaluation::TYPE_NAME, Qos::Lossy),
        ["swath", "vehicle", _, kind] => match kind {
            "grid" => typed(OccupancyGrid::TYPE_NAME, Qos::Newest),
            "odom" => typed(Odometry::TYPE_NAME, Qos::Lossy),
            "tf" | "tf_static" => typed(TFMessage::TYPE_NAME, Qos::Kept),
            "reference" => typed(Path::TYPE_NAME, Qos::Latched),
            "targets" => typed(PoseArray::TYPE_NAME, Qos::Latched),
            "plan" => typed(PlanReport::TYPE_NAME, Qos::Interactive),
            "path" => typed(Path::TYPE_NAME, Qos::Interactive),
            "region" | "explored" => typed(OccupancyGrid::TYPE_NAME, Qos::Lossy),
            _ => None,
        },
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agrees<M: Message>(topic: &Topic<M>) {
        assert_eq!(classify(topic.key()), Some((M::TYPE_NAME, topic.qos())));
        assert_eq!(key_of_topic(&topic_of_key(topic.key())), topic.key());
    }

    #[test]
    fn every_topic_is_classified_as_what_it_carries() {
        agrees(&sample("g0"));
        agrees(&weights("r"));
        agrees(&train_status("r"));
        agrees(&evaluation("r"));
        agrees(&grid("v"));
        agrees(&odom("v"));
        agrees(&tf("v"));
        agrees(&tf_static("v"));
        agrees(&reference("v"));
        agrees(&targets("v"));
        agrees(&plan("v"));
        agrees(&path("v"));
        agrees(&region("v"));
        agrees(&explored("v"));
        assert_eq!(classify("swath/vehicle/v/nonsense"), None);
        assert_eq!(classify("swath/vehicle"), None);
        assert_eq!(classify(&node("planner", "v")), None);
    }
}
