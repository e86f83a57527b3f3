//! Networks that a node takes into use, and whether they are for its grid and vehicle.

use std::sync::Arc;

use swath_bridge::msg::swath::Weights;
use swath_bridge::{GridSpec, Received, signature};
use tokio::task::spawn_blocking;

use super::rejects::Rejects;
use super::{Node, NodeConfig, ServedNetwork};
use crate::Error;
use crate::network::{Network, NetworkInfo};

const OTHER_GRID: &str = "they are for another grid";
const OTHER_VEHICLE: &str = "they are for another vehicle";

/// The name of a network in logs.
fn name(run: &str) -> String {
    if run.is_empty() {
        "the network that the planner began with".to_owned()
    } else {
        format!("weights of run {run:?}")
    }
}

fn misfit(info: &NetworkInfo, grid: &GridSpec) -> Option<Error> {
    (info.spec != *grid).then_some(Error::GridMismatch {
        got: *grid,
        wanted: info.spec,
    })
}

/// Says once for each run that a network was trained for another vehicle.
fn warn_of_vehicle(info: &NetworkInfo, run: &str, config: &NodeConfig, rejects: &mut Rejects) {
    let vehicle = config.vehicle.digest();
    let name = name(run);
    if info.vehicle != vehicle && rejects.is_new(&format!("{name}: {OTHER_VEHICLE}")) {
        tracing::warn!(
            "{name}: trained for another vehicle ({}, this one is {vehicle}); it is used, and may predict \
             regions that are too narrow or too wide",
            info.vehicle
        );
    }
}

/// The network that a node begins with, unless it is for another grid, which is said.
pub(super) fn fitting(
    initial: Option<ServedNetwork>,
    config: &NodeConfig,
    rejects: &mut Rejects,
) -> Option<ServedNetwork> {
    let served = initial?;
    let info = served.network.info();
    if let Some(error) = misfit(info, &config.grid) {
        tracing::warn!(
            "{} is not used: {error}; frames are planned without a network until one comes that fits",
            name(&served.run)
        );
        return None;
    }
    warn_of_vehicle(info, &served.run, config, rejects);
    Some(served)
}

impl Node {
    /// Takes weights into use from the next frame on, if they are intact, trusted, for this grid and newer.
    pub(super) async fn take_weights(&mut self, received: Received<Weights>) {
        let weights = received.message;
        let stamp_nanos = weights.header.stamp.nanos();
        if self
            .network
            .as_ref()
            .is_some_and(|used| used.stamp_nanos >= stamp_nanos)
        {
            tracing::debug!("{}: version {} is not newer", received.key, weights.version);
            return;
        }
        let (run, version) = (weights.run.clone(), weights.version);
        let (trusted, grid) = (self.config.trusted.clone(), self.config.grid);
        let loaded = spawn_blocking(move || {
            signature::verify(&weights, &trusted)?;
            let network = Network::load(&weights.safetensors)?;
            match misfit(network.info(), &grid) {
                Some(error) => Err(error),
                None => Ok(network),
            }
        });
        let error: Box<dyn std::error::Error + Send + Sync> = match loaded.await {
            Ok(Ok(network)) => {
                warn_of_vehicle(network.info(), &run, &self.config, &mut self.rejects);
                tracing::info!("weights {run} version {version} in use");
                self.used_weights += 1;
                self.network = Some(Arc::new(ServedNetwork {
                    network,
                    run,
                    version,
                    stamp_nanos,
                }));
                return;
            }
            Ok(Err(error @ Error::GridMismatch { .. })) => {
                let name = name(&run);
                let said = self.rejects.note_once("weights", OTHER_GRID, &name, &error);
                if let Some(line) = said {
                    tracing::warn!("{}: {line}", received.key);
                }
                return;
            }
            Ok(Err(error)) => error.into(),
            Err(error) => error.into(),
        };
        let cause = match error.downcast_ref() {
            Some(Error::Bridge(_)) => "they are damaged, forged or not trusted",
            Some(Error::Weights { .. }) => "they are no weights of a known network",
            _ => "they cannot be loaded",
        };
        self.reject("weights", cause, &format!("{}: {error}", received.key));
    }
}
