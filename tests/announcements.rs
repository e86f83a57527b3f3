//! What nodes say on standard error, and that nothing depends on whether anybody can read it.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use swath_bridge::msg::header::Header;
use swath_bridge::poses::path_message;
use swath_bridge::{FREE, GridSpec, Occupancy, Pose2, Session, SessionConfig, keys};

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(3);
/// Most characters of a line.
const MOST_CHARS: usize = 100;
/// Most lines that are kept until they are looked at.
const LINES: usize = 4096;

/// An endpoint on loopback that nobody listens on.
fn endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    format!("tcp/{}", listener.local_addr().unwrap())
}

/// A node whose standard error is read line by line.
struct Node {
    process: Child,
    lines: Receiver<String>,
}

impl Node {
    fn start(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_swath"))
            .args(arguments)
            .env_remove("ZENOH_CONFIG")
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = process.stderr.take().unwrap();
        let (sender, lines) = sync_channel(LINES);
        std::thread::Builder::new()
            .name("log of a node".to_owned())
            .spawn(move || {
                for line in BufReader::new(log).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            })
            .unwrap();
        Self { process, lines }
    }

    /// Waits for a line with these words; every line on the way has to fit.
    fn says(&self, words: &str) -> String {
        self.says_all(&[words])
    }

    /// Waits for lines with all of these words, in any order. Returns the last one.
    fn says_all(&self, words: &[&str]) -> String {
        let (mut left, mut before) = (words.to_vec(), Vec::new());
        loop {
            let line = self.lines.recv_timeout(PATIENCE);
            let line = line.unwrap_or_else(|_| panic!("never said {left:?} but {before:#?}"));
            let is_advice = line.contains("swath: ");
            assert!(line.chars().count() <= MOST_CHARS || is_advice, "{line}");
            left.retain(|words| !line.contains(words));
            if left.is_empty() {
                return line;
            }
            before.push(line);
        }
    }

    fn signal(&self, signal: Signal) {
        let id = Pid::from_raw(i32::try_from(self.process.id()).unwrap());
        kill(id, signal).unwrap();
    }

    /// Asks the node to end, and waits until it has.
    fn stop(mut self) -> ExitStatus {
        self.signal(Signal::SIGTERM);
        self.process.wait().unwrap()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // It has usually ended by now.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn namespace(what: &str) -> String {
    format!("{what}-{}", std::process::id())
}

#[test]
fn nodes_say_where_they_listen_whom_they_joined_and_who_comes_and_goes() {
    let place = endpoint();
    let planner = Node::start(&["--connect", &place, "plan", "--vehicle", "car-1"]);
    planner.says("planner car-1 starts");
    planner.says(&format!("does not listen, connects to {place}"));
    planner.says("no other node yet");
    planner.says(&format!("not connected to {place} for"));
    planner.says("check the address");

    let generator = Node::start(&["--listen", &place, "generate", "--id", "lab-1"]);
    generator.says("generator lab-1 starts");
    generator.says(&format!("listens on {place}"));
    planner.says_all(&[
        &format!("INFO connected to {place}"),
        "generator lab-1 came",
    ]);

    let late = Node::start(&["--connect", &place, "plan", "--vehicle", "car-2"]);
    // Both in one line when the machine is quick, a line each when it is not.
    late.says_all(&["generator lab-1", "planner car-1"]);
    generator.says("planner car-2 came");
    planner.says("planner car-2 came");
    assert!(late.stop().success());
    generator.says("planner car-2 went");
    planner.says("planner car-2 went");
    assert!(planner.stop().success());
    generator.says("planner car-1 went");
    assert!(generator.stop().success());
}

#[test]
fn nodes_without_options_meet_in_a_namespace_of_their_user() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run.mcap");
    let recorder = Node::start(&["bridge", "record", "--out", out.to_str().unwrap()]);
    recorder.says("recorder run starts");
    recorder.says("listens on tcp/127.0.0.1:");
    recorder.says(&format!(
        "in namespace {}",
        swath_bridge::default_namespace()
    ));
    assert!(recorder.stop().success());
}

/// Waits until a node of a namespace can be seen, which is after it has said that it starts.
fn wait_for_a_node(namespace: &str) {
    let config = SessionConfig {
        namespace: Some(namespace.to_owned()),
        ..SessionConfig::default()
    };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let seen = runtime.block_on(async {
        let session = Session::open(&config).await.unwrap();
        let mut nodes = session.watch_nodes().await.unwrap();
        tokio::time::timeout(PATIENCE, nodes.recv()).await
    });
    assert!(seen.unwrap().unwrap().is_alive);
}

#[test]
fn a_second_planner_for_a_vehicle_is_refused_unless_it_shares_and_a_killed_one_is_replaced() {
    let name = namespace("second");
    let plan = ["--namespace", &name, "plan", "--vehicle", "car-1"];
    let share = [&plan[..], &["--share-vehicle"]].concat();
    let first = Node::start(&plan);
    wait_for_a_node(&name);

    let mut refused = Node::start(&plan);
    refused.says("planner car-1 runs already");
    let advice = refused.says("swath: ");
    assert!(
        advice.contains("--vehicle") && advice.contains("--share-vehicle"),
        "{advice}"
    );
    assert_eq!(refused.process.wait().unwrap().code(), Some(1));

    let shares = Node::start(&share);
    shares.says("a second planner car-1 runs");
    first.says("a second planner car-1 runs");
    assert!(shares.stop().success());
    first.says("planner car-1 went");

    first.signal(Signal::SIGKILL);
    let again = Node::start(&plan);
    again.says("no other node yet");
    assert!(again.stop().success());
}

#[test]
fn a_second_recorder_is_warned_and_warns() {
    let folder = tempfile::tempdir().unwrap();
    let name = namespace("recorders");
    let record = |file: &str| {
        let out = folder.path().join(file);
        Node::start(&[
            "--namespace",
            &name,
            "bridge",
            "record",
            "--out",
            out.to_str().unwrap(),
        ])
    };
    let first = record("a.mcap");
    first.says("no other node yet");
    let second = record("b.mcap");
    second.says("a second recorder runs");
    first.says("a second recorder runs");
    assert!(first.stop().success() && second.stop().success());
}

/// Sends grids until two plans have come.
async fn two_plans(session: &Session) {
    let grids = session.publisher(&keys::grid("v0")).await.unwrap();
    let references = session.publisher(&keys::reference("v0")).await.unwrap();
    let mut plans = session.subscriber(&keys::plan("v0"), 16).await.unwrap();
    let open = Occupancy::filled(GridSpec::default(), FREE);
    let road: Vec<Pose2> = (0..60)
        .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
        .collect();
    let (mut stamp, mut planned) = (0, 0);
    while planned < 2 {
        stamp += 1;
        let header = Header::at(stamp, "base_link");
        references.put(&path_message(&header, &road)).await.unwrap();
        grids.put(&open.to_message(header)).await.unwrap();
        let came = tokio::time::timeout(Duration::from_millis(200), plans.recv()).await;
        planned += usize::from(came.is_ok_and(|plan| plan.is_some()));
    }
}

#[test]
fn a_planner_whose_log_cannot_be_written_plans_on() {
    let name = namespace("full");
    let full = || File::options().write(true).open("/dev/full").unwrap();
    let mut planner = Command::new(env!("CARGO_BIN_EXE_swath"))
        .args(["--namespace", &name, "-vv", "plan"])
        .stdin(Stdio::null())
        .stdout(full())
        .stderr(full())
        .spawn()
        .unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let planned = runtime.block_on(async {
        let config = SessionConfig {
            namespace: Some(name.clone()),
            ..SessionConfig::default()
        };
        let session = Session::open(&config).await.unwrap();
        tokio::time::timeout(PATIENCE, two_plans(&session)).await
    });
    let still_runs = planner.try_wait().unwrap().is_none();
    let id = Pid::from_raw(i32::try_from(planner.id()).unwrap());
    if still_runs {
        kill(id, Signal::SIGTERM).unwrap();
    }
    let status = planner.wait().unwrap();
    assert!(planned.is_ok(), "no plans; it ended with {status}");
    assert!(still_runs && status.success(), "{status}");
}

#[test]
fn a_place_that_cannot_be_listened_on_is_named_once_without_a_place_in_a_source() {
    let taken = endpoint();
    let holder = Node::start(&["--listen", &taken, "generate"]);
    holder.says(&format!("listens on {taken}"));
    for (arguments, named) in [
        (["--listen", &taken, "plan"], "in use"),
        (["--listen", "tcp/192.0.2.1:1", "plan"], "192.0.2.1"),
        (["--zenoh-config", "no-such.json5", "plan"], "No such file"),
    ] {
        let mut node = Node::start(&arguments);
        let said = node.says("swath: ");
        assert!(said.contains(named) && !said.contains(".rs:"), "{said}");
        for once in [arguments[1], "os error"] {
            assert!(said.matches(once).count() <= 1, "{said}");
        }
        assert_eq!(node.process.wait().unwrap().code(), Some(1));
    }
    assert!(holder.stop().success());
}
