//! Nodes as processes, on a namespace of their own.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use swath_bridge::{Session, SessionConfig};

const CONFIG_FILE: &str = "swath.toml";

/// Nodes that share a namespace and a configuration.
pub(crate) struct System {
    pub(crate) namespace: String,
    config: PathBuf,
}

impl System {
    /// A system whose configuration is kept in `folder`.
    pub(crate) fn new(folder: &Path, config: &str) -> Self {
        let path = folder.join(CONFIG_FILE);
        std::fs::write(&path, config).unwrap();
        Self {
            namespace: format!("test-{}", std::process::id()),
            config: path,
        }
    }

    /// Starts `swath` with these arguments.
    pub(crate) fn start(&self, arguments: &[&str]) -> Node {
        let child = Command::new(env!("CARGO_BIN_EXE_swath"))
            .args(["--namespace", &self.namespace, "--config"])
            .arg(&self.config)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn();
        Node(child.unwrap())
    }

    /// A session that meets the nodes.
    pub(crate) async fn session(&self) -> Session {
        let config = SessionConfig {
            namespace: Some(self.namespace.clone()),
            ..SessionConfig::default()
        };
        Session::open(&config).await.unwrap()
    }
}

/// A node that is killed if a test ends without stopping it.
pub(crate) struct Node(pub(crate) Child);

impl Node {
    /// Asks the node to end, and waits until it has.
    pub(crate) fn stop(mut self) -> ExitStatus {
        let id = Pid::from_raw(i32::try_from(self.0.id()).unwrap());
        kill(id, Signal::SIGTERM).unwrap();
        self.0.wait().unwrap()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // It has usually ended by now.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
