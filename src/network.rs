//! The network that a command uses: that of a file, or the one that comes with swath.

use std::path::Path;

use anyhow::Context;
use swath_planner::network::{Network, NetworkInfo, Parameters};
use swath_trainer::SHIPPED_WEIGHTS;

use crate::config::Config;

/// The weights file at a path, or the one that comes with swath.
fn bytes(path: Option<&Path>) -> anyhow::Result<Vec<u8>> {
    match path {
        Some(path) => std::fs::read(path).with_context(|| name(Some(path))),
        None => Ok(SHIPPED_WEIGHTS.to_vec()),
    }
}

fn name(path: Option<&Path>) -> String {
    path.map_or_else(
        || "the network that comes with swath".to_owned(),
        |path| path.display().to_string(),
    )
}

/// Loads a network, without a path the one that comes with swath.
pub(crate) fn load(path: Option<&Path>) -> anyhow::Result<Network> {
    Network::load(&bytes(path)?).with_context(|| name(path))
}

/// Loads the parameters of a network, and what it is for.
pub(crate) fn load_parameters(path: Option<&Path>) -> anyhow::Result<(NetworkInfo, Parameters)> {
    let (parameters, metadata) =
        Parameters::from_safetensors(&bytes(path)?).with_context(|| name(path))?;
    let info = NetworkInfo::from_metadata(&metadata).with_context(|| name(path))?;
    Ok((info, parameters))
}

/// Why a network is of no use for a configuration, if it is not.
pub(crate) fn misfit(info: &NetworkInfo, config: &Config) -> Option<String> {
    if info.spec != config.grid {
        let (rows, cols) = (info.spec.rows, info.spec.cols);
        return Some(format!("it is for {rows} x {cols} cells"));
    }
    (info.vehicle != config.vehicle.digest()).then(|| "it is for another vehicle".to_owned())
}
