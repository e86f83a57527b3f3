//! The generator node between real sessions.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;
use std::time::Duration;

use swath_bridge::msg::swath::Sample;
use swath_bridge::{Session, SessionConfig, Subscriber, keys};
use swath_generator::node::{self, NodeConfig, NodeSummary};
use swath_generator::{Generator, GeneratorConfig, Scenes};
use swath_planner::search::SearchMemory;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

/// Two sessions that are connected to each other and to nobody else.
async fn pair() -> (Session, Session) {
    let listening = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    let a = Session::open(&listening).await.unwrap();
    let connecting = SessionConfig {
        connect: a.endpoints().await,
        ..SessionConfig::default()
    };
    let b = Session::open(&connecting).await.unwrap();
    (a, b)
}

fn generator() -> Arc<Generator> {
    Arc::new(Generator::new(GeneratorConfig::default(), Scenes::Procedural).unwrap())
}

fn config(id: &str, count: Option<u64>) -> NodeConfig {
    NodeConfig {
        id: id.to_owned(),
        seed: 1,
        first: 0,
        count,
        workers: 1,
    }
}

fn start(
    session: Session,
    config: NodeConfig,
) -> (oneshot::Sender<()>, JoinHandle<(NodeSummary, u64)>) {
    let (stop, stopped) = oneshot::channel::<()>();
    let node = tokio::spawn(async move {
        let mut observed = 0;
        let stopped = async move {
            let _ended = stopped.await;
        };
        let summary = node::run(&session, generator(), config, stopped, |_| observed += 1)
            .await
            .unwrap();
        (summary, observed)
    });
    (stop, node)
}

async fn next(samples: &mut Subscriber<Sample>) -> Sample {
    soon(samples.recv()).await.unwrap().message
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn samples_arrive_in_sequence_and_are_those_of_the_generators_seed() {
    let (session, node_session) = pair().await;
    let mut samples = session.subscriber(&keys::sample("*"), 64).await.unwrap();
    let (_stop, node) = start(node_session, config("g0", Some(6)));
    let seed = node::seed_of(1, "g0");
    let (generator, mut memory) = (generator(), SearchMemory::new());
    for sequence in 0..6 {
        let sample = next(&mut samples).await;
        assert_eq!(
            (sample.generator.as_str(), sample.sequence),
            ("g0", sequence)
        );
        let mut again = generator.sample(seed, sequence, &mut memory).unwrap();
        again.generator = "g0".to_owned();
        let bytes = |sample: &Sample| swath_bridge::cdr::to_vec(sample).unwrap();
        assert!(bytes(&sample) == bytes(&again), "sample {sequence}");
    }
    let (summary, observed) = soon(node).await.unwrap();
    assert_eq!((summary.published, observed), (6, 6));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_waits_for_listeners_and_stops_when_told() {
    let (session, node_session) = pair().await;
    let mut nodes = session.watch_nodes().await.unwrap();
    let (stop, node) = start(node_session, config("g1", None));
    // Its token is there before anybody listens; what it publishes then begins with 0 all the same.
    soon(nodes.recv()).await.unwrap();
    let mut samples = session.subscriber(&keys::sample("g1"), 64).await.unwrap();
    assert_eq!(next(&mut samples).await.sequence, 0);
    assert_eq!(next(&mut samples).await.sequence, 1);
    stop.send(()).unwrap();
    let (summary, observed) = soon(node).await.unwrap();
    assert!(summary.published >= 2);
    assert_eq!(summary.published, observed);
}
