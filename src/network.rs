//! The network that a command uses: that of a file, or the one that comes with swath.

use std::path::Path;

use anyhow::Context;
use swath_bridge::{GridSpec, Vehicle};
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

/// Why a network may be of no use for a configuration, if it may: its grid or its vehicle differs.
pub(crate) fn misfit(info: &NetworkInfo, config: &Config) -> Option<String> {
    misfit_on(info, &config.grid, &config.vehicle)
}

/// [`misfit`] for a grid that is not the configuration's.
pub(crate) fn misfit_on(info: &NetworkInfo, spec: &GridSpec, vehicle: &Vehicle) -> Option<String> {
    let mut differences = Vec::new();
    if info.spec != *spec {
        let (network, configured) = (grid_text(&info.spec), grid_text(spec));
        differences.push(format!(
            "it is for {network}, but the grid has {configured}"
        ));
    }
    if info.vehicle != vehicle.digest() {
        differences.push(format!(
            "it is for vehicle {} (turning radius {} m, half width {} m), but the vehicle is {} \
             (turning radius {} m, half width {} m)",
            info.vehicle,
            info.min_turning_radius_m,
            info.half_width_m,
            vehicle.digest(),
            vehicle.min_turning_radius_m,
            vehicle.half_width_m
        ));
    }
    (!differences.is_empty()).then(|| differences.join("; "))
}

fn grid_text(spec: &GridSpec) -> String {
    format!(
        "{} x {} cells of {} m with the vehicle at ({}, {})",
        spec.rows, spec.cols, spec.resolution_m, spec.ego_row, spec.ego_col
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_of_another_vehicle_or_grid_is_told_apart() {
        let info = NetworkInfo::default();
        let config = Config::default();
        assert_eq!(misfit(&info, &config), None);
        let mut longer = config.clone();
        longer.vehicle.front_m += 0.1;
        let said = misfit(&info, &longer).unwrap();
        assert!(
            said.contains(&info.vehicle) && said.contains(&longer.vehicle.digest()),
            "{said}"
        );
        assert!(!said.contains("cells"), "{said}");
        let mut finer = config;
        finer.grid.resolution_m = 0.1;
        let said = misfit(&info, &finer).unwrap();
        assert!(
            said.contains("cells of 0.2 m") && said.contains("cells of 0.1 m"),
            "{said}"
        );
        assert!(!said.contains("radius"), "{said}");
    }
}
