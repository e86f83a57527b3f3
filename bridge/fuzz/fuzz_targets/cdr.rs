//! Every message type, chosen by the first byte: whatever decodes must encode, and the two must agree.

#![no_main]

use libfuzzer_sys::fuzz_target;
use swath_bridge::cdr;
use swath_bridge::msg::Message;
use swath_bridge::msg::{geometry, header, nav, sensor, swath, tf2};

fn round_trip<M: Message>(payload: &[u8]) {
    let Ok(message) = cdr::from_slice::<M>(payload) else {
        return;
    };
    // Bytes are compared, since a NaN in a message differs from itself.
    let Ok(encoded) = cdr::to_vec(&message) else {
        // A string with a NUL inside can be read but not written.
        return;
    };
    let again: M = cdr::from_slice(&encoded).expect("what was encoded decodes");
    assert_eq!(cdr::to_vec(&again).expect("and encodes"), encoded);
}

fuzz_target!(|data: &[u8]| {
    let Some((&kind, payload)) = data.split_first() else {
        return;
    };
    let decoders = [
        round_trip::<geometry::PoseArray>,
        round_trip::<geometry::TransformStamped>,
        round_trip::<header::Duration>,
        round_trip::<header::Header>,
        round_trip::<nav::OccupancyGrid>,
        round_trip::<nav::Odometry>,
        round_trip::<nav::Path>,
        round_trip::<sensor::LaserScan>,
        round_trip::<sensor::PointCloud2>,
        round_trip::<swath::Evaluation>,
        round_trip::<swath::PlanReport>,
        round_trip::<swath::Sample>,
        round_trip::<swath::TrainStatus>,
        round_trip::<swath::Weights>,
        round_trip::<tf2::TFMessage>,
    ];
    decoders[usize::from(kind) % decoders.len()](payload);
});
