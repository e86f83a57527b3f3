//! The trained network that comes with swath; `trainer/weights/README.md` is its model card.

use swath_planner::network::{NetworkInfo, Parameters};

use crate::Error;

/// The weights file of the network that is used when no other is named.
pub const SHIPPED_WEIGHTS: &[u8] = include_bytes!("../weights/enet-shared-half.safetensors");

/// The network that comes with swath: what it is for, and its parameters.
///
/// # Errors
/// The planner's, if the file does not fit this version.
pub fn shipped() -> Result<(NetworkInfo, Parameters), Error> {
    let (parameters, metadata) = Parameters::from_safetensors(SHIPPED_WEIGHTS)?;
    Ok((NetworkInfo::from_metadata(&metadata)?, parameters))
}

#[cfg(test)]
mod tests {
    use super::*;
    use swath_bridge::{GridSpec, Vehicle};

    const CARD: &str = include_str!("../weights/README.md");

    #[test]
    fn the_shipped_network_loads_and_is_the_one_of_the_model_card() {
        let (info, parameters) = shipped().unwrap();
        assert_eq!(info.architecture, parameters.architecture());
        assert_eq!(info.spec, GridSpec::default());
        assert_eq!(info.vehicle, Vehicle::default().digest());
        assert!(SHIPPED_WEIGHTS.len() <= 2_000_000);
        let digest = swath_bridge::signature::digest(SHIPPED_WEIGHTS);
        assert!(CARD.contains(&digest), "the card does not name {digest}");
    }
}
