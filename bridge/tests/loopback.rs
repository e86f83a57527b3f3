//! Processes that are started without any configuration find each other on this machine.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use swath_bridge::{Ports, Session, SessionConfig};

/// What the test gives a child to do; without it a child has nothing to do.
const CHILD_ID: &str = "SWATH_TEST_CHILD";
/// The process of the test, by which its children choose their ports.
const PARENT: &str = "SWATH_TEST_PARENT";
/// Longer than anything here takes.
const PATIENCE: Duration = Duration::from_mins(10);

/// Ports of this run of the test alone, so that it meets neither a demo nor another run.
fn config(parent: u32) -> SessionConfig {
    SessionConfig {
        ports: Ports {
            first: 10_000 + 8 * u16::try_from(parent % 900).unwrap(),
            count: 8,
        },
        ..SessionConfig::default()
    }
}

/// What a child process does: it is a node and prints every change that it sees.
#[test]
#[ignore = "run by the other test, in processes of its own"]
fn child() {
    let Ok(id) = std::env::var(CHILD_ID) else {
        return;
    };
    let parent = std::env::var(PARENT).unwrap().parse().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.spawn(async move {
        let session = Session::open(&config(parent)).await.unwrap();
        let _token = session.declare_node("test", &id).await.unwrap();
        let mut nodes = session.watch_nodes().await.unwrap();
        while let Some(change) = nodes.recv().await {
            let sign = if change.is_alive { '+' } else { '-' };
            let line = format!("\nnode {sign}{}\n", change.id);
            std::io::Write::write_all(&mut std::io::stdout(), line.as_bytes()).unwrap();
        }
    });
    // The child ends with its parent, whatever becomes of that.
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    std::process::exit(0);
}

struct Node {
    process: Child,
    lines: Receiver<String>,
}

impl Node {
    fn start(id: &str) -> Self {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child", "--ignored", "--nocapture"])
            .env(CHILD_ID, id)
            .env(PARENT, std::process::id().to_string())
            .env_remove("ZENOH_CONFIG")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = process.stdout.take().unwrap();
        let (sender, lines) = sync_channel(1024);
        std::thread::Builder::new()
            .name(format!("output of {id}"))
            .spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if let Some(change) = line.strip_prefix("node ") {
                        let _ = sender.send(change.to_owned());
                    }
                }
            })
            .unwrap();
        Self { process, lines }
    }

    /// Waits until the node has seen all of these changes, in any order.
    fn sees(&self, expected: &[&str]) {
        let mut left = expected.to_vec();
        while !left.is_empty() {
            let change = self.lines.recv_timeout(PATIENCE);
            let change = change.unwrap_or_else(|_| panic!("never saw {left:?}"));
            left.retain(|&wanted| wanted != change);
        }
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn processes_find_each_other_and_survive_the_first_ones_death() {
    let a = Node::start("a");
    a.sees(&["+a"]);
    let b = Node::start("b");
    let c = Node::start("c");
    for node in [&b, &c] {
        node.sees(&["+a", "+b", "+c"]);
    }
    a.sees(&["+b", "+c"]);
    // Killed, not asked to end: the one that was there first, on the lowest port.
    drop(a);
    b.sees(&["-a"]);
    c.sees(&["-a"]);
    // The newcomer takes its port; those above must find it by themselves.
    let d = Node::start("d");
    d.sees(&["+b", "+c", "+d"]);
    b.sees(&["+d"]);
    c.sees(&["+d"]);
}
