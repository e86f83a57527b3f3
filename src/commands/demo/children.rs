//! Nodes as child processes.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use anyhow::Context;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Time that a node has to stop when it is asked to.
const PATIENCE: Duration = Duration::from_mins(2);

/// Niceness of nodes in the background: they get about a tenth of a processor that others want.
const BACKGROUND_NICENESS: i32 = 10;

/// Starts nodes of this very program.
#[derive(Debug)]
pub(super) struct Launcher {
    program: PathBuf,
    logs: PathBuf,
    shared: Vec<String>,
}

impl Launcher {
    /// Nodes write what they say below `out`.
    pub(super) fn new(
        out: &Path,
        namespace: &str,
        config_file: Option<&Path>,
    ) -> anyhow::Result<Self> {
        let logs = out.join("logs");
        std::fs::create_dir_all(&logs).with_context(|| logs.display().to_string())?;
        let mut shared = vec!["--namespace".to_owned(), namespace.to_owned()];
        if let Some(path) = config_file {
            shared.extend(["--config".to_owned(), path.display().to_string()]);
        }
        Ok(Self {
            program: std::env::current_exe()?,
            logs,
            shared,
        })
    }

    /// Starts a node. One in the background leaves the processors to the others when they want them.
    pub(super) fn start(
        &self,
        name: String,
        arguments: Vec<String>,
        is_background: bool,
    ) -> anyhow::Result<Child> {
        let log = self.logs.join(format!("{name}.log"));
        let file = File::create(&log).with_context(|| log.display().to_string())?;
        let process = tokio::process::Command::new(&self.program)
            .args(&self.shared)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(file.try_clone()?)
            .stderr(file)
            .kill_on_drop(true)
            .spawn()
            .with_context(|| format!("{name} did not start"))?;
        if is_background {
            to_background(&name, process.id());
        }
        Ok(Child { name, process, log })
    }
}

/// Makes a process that has just been started one of less weight; its threads come later and follow it.
fn to_background(name: &str, id: Option<u32>) {
    let id = id.and_then(|id| i32::try_from(id).ok());
    let Some(id) = id.and_then(rustix::process::Pid::from_raw) else {
        return;
    };
    if let Err(error) = rustix::process::setpriority_process(Some(id), BACKGROUND_NICENESS) {
        tracing::debug!("{name} keeps its priority: {error}");
    }
}

/// A running node.
#[derive(Debug)]
pub(super) struct Child {
    name: String,
    process: tokio::process::Child,
    log: PathBuf,
}

impl Child {
    /// Fails if the node has ended by itself.
    pub(super) fn check(&mut self) -> anyhow::Result<()> {
        if let Some(status) = self.process.try_wait()? {
            anyhow::bail!(
                "{} ended early ({status}): {}",
                self.name,
                last_line(&self.log).unwrap_or_else(|| self.log.display().to_string())
            );
        }
        Ok(())
    }

    /// Asks the node to stop and waits until it has.
    pub(super) async fn stop(mut self) -> anyhow::Result<()> {
        if let Some(id) = self.process.id().and_then(|id| i32::try_from(id).ok()) {
            // It may have ended meanwhile; waiting tells.
            let _ = kill(Pid::from_raw(id), Signal::SIGTERM);
        }
        let Ok(status) = tokio::time::timeout(PATIENCE, self.process.wait()).await else {
            tracing::warn!(
                "{} did not stop within {PATIENCE:?} and was killed",
                self.name
            );
            return Ok(self.process.kill().await?);
        };
        let status = status?;
        if !status.success() {
            tracing::warn!(
                "{} ended with {status}, see {}",
                self.name,
                self.log.display()
            );
        }
        Ok(())
    }
}

fn last_line(log: &Path) -> Option<String> {
    let text = std::fs::read_to_string(log).ok()?;
    text.lines()
        .rev()
        .find(|line| !line.trim().is_empty())
        .map(str::to_owned)
}
