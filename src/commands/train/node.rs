//! `swath train` as a node.

use std::io::Read as _;
use std::path::Path;

use anyhow::Context;
use swath_bridge::msg::swath::TrainStatus;
use swath_bridge::signature::SigningKey;
use swath_trainer::node::{self, NodeConfig};
use swath_trainer::{TrainConfig, write_atomically};

use super::make_directory;
use crate::cli::{NetworkOptions, TrainOptions};
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress;
use crate::runtime::{stop_signal, with_session};

/// File of the key that signs a run's weights.
const KEY_FILE: &str = "signing.key";
const KEY_BYTES: usize = 32;

/// Trains on the live stream until stopped.
pub(super) fn run(
    options: &TrainOptions,
    network: &NetworkOptions,
    config: &Config,
    train: TrainConfig,
) -> Result<(), Failure> {
    make_directory(&options.out)?;
    let node_config = NodeConfig {
        train,
        grid: config.grid,
        vehicle: config.vehicle,
        directory: Some(options.out.clone()),
        publish_every_steps: options.publish_every.max(1),
        ..NodeConfig::new(&options.run, signing_key(&options.out.join(KEY_FILE))?)
    };
    let bar = progress::spinner("trainer");
    bar.set_message("waits for samples");
    let summary = with_session(network, async |session| {
        let observe = |status: &TrainStatus| {
            bar.set_position(status.step);
            bar.set_message(format!(
                "steps, {} samples, loss {:.3}, mIoU {:.3}, weights v{}",
                status.received, status.loss, status.miou, status.weights_version
            ));
        };
        node::run(&session, node_config, stop_signal(), observe)
            .await
            .context("trainer node")
    })?;
    bar.finish_and_clear();
    let miou = summary
        .miou
        .map_or_else(|| "not scored".to_owned(), |miou| format!("{miou:.4}"));
    output::line(format_args!(
        "{} steps, weights v{} (mIoU {miou}) in {}",
        summary.steps,
        summary.version,
        options.out.display()
    ))?;
    Ok(())
}

/// The key in a file, which is made from the system's randomness if it is missing.
fn signing_key(path: &Path) -> anyhow::Result<SigningKey> {
    let context = || path.display().to_string();
    if path.exists() {
        let bytes = std::fs::read(path).with_context(context)?;
        let key: [u8; KEY_BYTES] = bytes.as_slice().try_into().with_context(|| {
            format!(
                "{}: {} bytes, expected a key of {KEY_BYTES}",
                context(),
                bytes.len()
            )
        })?;
        return Ok(SigningKey::from_bytes(&key));
    }
    let mut key = [0; KEY_BYTES];
    let source = Path::new("/dev/urandom");
    std::fs::File::open(source)
        .and_then(|mut file| file.read_exact(&mut key))
        .with_context(|| source.display().to_string())?;
    write_atomically(path, &key)?;
    keep_private(path)?;
    Ok(SigningKey::from_bytes(&key))
}

fn keep_private(path: &Path) -> anyhow::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    let only_mine = std::fs::Permissions::from_mode(0o600);
    std::fs::set_permissions(path, only_mine).with_context(|| path.display().to_string())
}
