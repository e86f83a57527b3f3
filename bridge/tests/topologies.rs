//! Sessions on a network, in every shape that a user may connect them: what one sends arrives at all
//! others, once.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::net::TcpListener;
use std::time::Duration;

use swath_bridge::keys;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::Path;
use swath_bridge::{Error, Publisher, Session, SessionConfig, Subscriber};

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(2);
/// Time between two looks at something that changes by itself.
const LOOK: Duration = Duration::from_millis(50);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

/// An endpoint on loopback that nobody listens on.
fn endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

async fn open(listen: &[&String], connect: &[&String]) -> Session {
    let owned = |endpoints: &[&String]| endpoints.iter().map(|&one| one.clone()).collect();
    let config = SessionConfig {
        listen: owned(listen),
        connect: owned(connect),
        ..SessionConfig::default()
    };
    Session::open(&config).await.unwrap()
}

fn path(number: u64) -> Path {
    Path {
        header: Header::at(number, "base_link"),
        poses: Vec::new(),
    }
}

/// What one session sends to all others.
struct Sender {
    publisher: Publisher<Path>,
    sent: u64,
}

impl Sender {
    async fn new(session: &Session) -> Self {
        Self {
            publisher: session.publisher(&keys::reference("v")).await.unwrap(),
            sent: 0,
        }
    }

    async fn send(&mut self) -> Path {
        self.sent += 1;
        let message = path(self.sent);
        self.publisher.put(&message).await.unwrap();
        message
    }
}

async fn listener(session: &Session) -> Subscriber<Path> {
    session.subscriber(&keys::reference("*"), 64).await.unwrap()
}

/// Sends from each session in turn; every other one gets each message, and gets it once.
async fn all_hear_all(sessions: &[&Session]) {
    for (number, from) in sessions.iter().enumerate() {
        let key = format!("v{number}");
        let publisher = from.publisher(&keys::reference(&key)).await.unwrap();
        publisher.put(&path(1)).await.unwrap();
        for (other, to) in sessions.iter().enumerate() {
            if other == number {
                continue;
            }
            // Latched: whoever subscribes late gets the last one, from wherever it is.
            let topic = keys::reference(&key);
            let mut heard = to.subscriber(&topic, 64).await.unwrap();
            let message = soon(heard.recv()).await.unwrap().message;
            assert_eq!(message, path(1), "{number} to {other}");
            publisher.put(&path(2)).await.unwrap();
            assert_eq!(soon(heard.recv()).await.unwrap().message, path(2));
            publisher.put(&path(1)).await.unwrap();
            assert_eq!(soon(heard.recv()).await.unwrap().message, path(1));
            assert_eq!(heard.counts().received, 3, "{number} to {other}: twice");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn in_a_star_all_hear_all() {
    let place = endpoint();
    let hub = open(&[&place], &[]).await;
    let spokes = [
        open(&[], &[&place]).await,
        open(&[], &[&place]).await,
        open(&[], &[&place]).await,
    ];
    let [a, b, c] = &spokes;
    all_hear_all(&[&hub, a, b, c]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_that_listen_and_connect_may_form_a_circle() {
    let places = [endpoint(), endpoint(), endpoint()];
    let [p, q, r] = &places;
    let circle = [
        open(&[p], &[r]).await,
        open(&[q], &[p]).await,
        open(&[r], &[q]).await,
    ];
    let spoke = open(&[], &[q]).await;
    let [a, b, c] = &circle;
    all_hear_all(&[a, b, c, &spoke]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_that_connect_to_each_other_are_connected_and_say_so() {
    let (p, q) = (endpoint(), endpoint());
    let a = open(&[&p], &[&q]).await;
    let b = open(&[&q], &[&p]).await;
    all_hear_all(&[&a, &b]).await;
    for session in [&a, &b] {
        soon(async {
            while !session.unconnected().await.is_empty() {
                tokio::time::sleep(LOOK).await;
            }
        })
        .await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_connects_to_two_joins_them() {
    let (p, q) = (endpoint(), endpoint());
    let hubs = [open(&[&p], &[]).await, open(&[&q], &[]).await];
    let between = open(&[], &[&p, &q]).await;
    let spoke = open(&[], &[&q]).await;
    let [a, b] = &hubs;
    all_hear_all(&[a, b, &between, &spoke]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn those_that_connect_come_back_when_the_one_that_listens_does() {
    let place = endpoint();
    let hub = open(&[&place], &[]).await;
    let (a, b) = (open(&[], &[&place]).await, open(&[], &[&place]).await);
    let mut sender = Sender::new(&a).await;
    let mut heard = listener(&b).await;
    let mut nodes = b.watch_nodes().await.unwrap();
    let _token = a.declare_node("generator", "g").await.unwrap();
    let first = sender.send().await;
    assert_eq!(soon(heard.recv()).await.unwrap().message, first);
    assert!(soon(nodes.recv()).await.unwrap().is_alive);

    hub.close().await.unwrap();
    drop(hub);
    assert!(!soon(nodes.recv()).await.unwrap().is_alive);
    soon(async {
        while a.unconnected().await != [place.clone()] {
            tokio::time::sleep(LOOK).await;
        }
    })
    .await;

    let hub = open(&[&place], &[]).await;
    assert!(soon(nodes.recv()).await.unwrap().is_alive);
    // What is sent while the ways are not known again may be lost, as on any network that was cut.
    soon(async {
        loop {
            let sent = sender.send().await;
            while let Ok(heard) = tokio::time::timeout(10 * LOOK, heard.recv()).await {
                if heard.unwrap().message == sent {
                    return;
                }
            }
        }
    })
    .await;
    assert!(a.unconnected().await.is_empty());
    hub.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_connects_before_anyone_listens_is_told_what_is_missing() {
    let place = endpoint();
    let early = open(&[], &[&place]).await;
    assert_eq!(early.unconnected().await, std::slice::from_ref(&place));
    let hub = open(&[&place], &[]).await;
    soon(async {
        while !early.unconnected().await.is_empty() {
            tokio::time::sleep(LOOK).await;
        }
    })
    .await;
    all_hear_all(&[&early, &hub]).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_name_is_free_again_when_its_node_has_gone_and_taken_until_then() {
    let place = endpoint();
    let hub = open(&[&place], &[]).await;
    let (a, b) = (open(&[], &[&place]).await, open(&[], &[&place]).await);
    let held = soon(a.claim_node("planner", "v")).await.unwrap();
    let mut nodes = b.watch_nodes().await.unwrap();
    assert!(soon(nodes.recv()).await.unwrap().is_alive);
    let error = soon(b.claim_node("planner", "v")).await.unwrap_err();
    assert!(matches!(&error, Error::NodeTaken { kind, id } if kind == "planner" && id == "v"));
    // Another name is free, and who shares it is not refused.
    let _other = soon(b.claim_node("planner", "w")).await.unwrap();
    let _shared = soon(hub.declare_node("planner", "w")).await.unwrap();

    let waits = tokio::spawn({
        let b = b.clone();
        async move { b.claim_node("planner", "v").await }
    });
    drop(held);
    soon(waits).await.unwrap().unwrap();
}
