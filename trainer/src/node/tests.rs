//! A trainer node beside a generator that is a test.

use std::time::Duration;

use swath_bridge::SessionConfig;
use swath_planner::network::Network;
use tokio::sync::oneshot;

use super::*;
use crate::example::tests::{sample, small_spec};

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what)
        .await
        .expect("it comes")
}

async fn pair() -> (Session, Session) {
    let listening = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    let first = Session::open(&listening).await.unwrap();
    let connecting = SessionConfig {
        connect: first.endpoints().await,
        ..SessionConfig::default()
    };
    (first, Session::open(&connecting).await.unwrap())
}

fn config(directory: Option<PathBuf>) -> NodeConfig {
    let mut config = NodeConfig::new("test", SigningKey::from_bytes(&[7; 32]));
    config.grid = small_spec();
    config.train.batch = 4;
    config.train.micro_batch = 4;
    config.first_samples = 4;
    config.publish_every_steps = 2;
    config.directory = directory;
    config
}

/// Samples of which every twelfth is of a scene that is set aside.
async fn publish_samples(session: &Session, count: u64) {
    let publisher = session.publisher(&keys::sample("test")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    for index in 0..count {
        let mut sample = sample(index);
        sample.scene_id = index;
        publisher.put(&sample).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_learns_from_the_stream_and_publishes_signed_weights_that_load() {
    let (ours, theirs) = pair().await;
    let mut weights = theirs.subscriber(&keys::weights("*"), 8).await.unwrap();
    let config = NodeConfig {
        steps: Some(4),
        ..config(None)
    };
    let key = config.key.verifying_key();
    let node = tokio::spawn(async move {
        let mut last = None;
        let stop = std::future::pending();
        let summary = run(&ours, config, stop, |status| last = Some(status.clone())).await;
        (summary.unwrap(), last.unwrap(), ours)
    });
    publish_samples(&theirs, 24).await;
    let (summary, last, _ours) = soon(node).await.unwrap();
    assert_eq!((summary.steps, summary.version), (4, 2));
    assert_eq!(last.weights_version, 2);
    assert!(last.samples == 16 && last.rejected == 0 && last.gaps == 0);
    for version in 1..=2 {
        let received = soon(weights.recv()).await.unwrap().message;
        assert_eq!((received.version, received.step), (version, 2 * version));
        signature::verify(&received, &[key]).unwrap();
        Network::load(&received.safetensors).unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_that_is_started_again_publishes_what_it_had_and_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().to_owned();
    let (ours, theirs) = pair().await;
    let first = NodeConfig {
        steps: Some(2),
        ..config(Some(path.clone()))
    };
    let publishing = tokio::spawn(async move {
        publish_samples(&theirs, 12).await;
        theirs
    });
    let stop = std::future::pending();
    let end = soon(Box::pin(run(&ours, first, stop, |_| {}))).await;
    assert_eq!(end.unwrap().version, 1);
    let theirs = soon(publishing).await.unwrap();
    let kept = std::fs::read(path.join(WEIGHTS_FILE)).unwrap();
    let mut weights = theirs.subscriber(&keys::weights("test"), 8).await.unwrap();
    let (end, stop) = oneshot::channel::<()>();
    let again = tokio::spawn(async move {
        let stop = async {
            let _ = stop.await;
        };
        run(&ours, config(Some(path)), stop, |_| {}).await
    });
    let mut newest = soon(weights.recv()).await.unwrap().message;
    while newest.version < 2 {
        // The cache of the first node may still have answered.
        newest = soon(weights.recv()).await.unwrap().message;
    }
    assert_eq!((newest.version, newest.step), (2, 2));
    assert!(newest.safetensors == kept);
    end.send(()).unwrap();
    assert_eq!(soon(again).await.unwrap().unwrap().steps, 2);
}
