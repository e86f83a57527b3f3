//! Hard examples: targets on which the planner, with the network as it is, searches longest come back
//! more often.

use std::sync::Arc;

use rayon::prelude::*;
use swath_bridge::{GridSpec, Vehicle};
use swath_planner::network::Network;

use crate::guided::Guided;
use crate::{Error, Example};

/// Examples that are tried at a time.
pub(crate) const CANDIDATES: usize = 128;
/// Of those tried, one in so many is hard.
const ONE_IN: usize = 4;
/// Most expansions of a search; what takes more is as hard as can be.
const MAX_EXPANSIONS: u64 = 100_000;

/// Finds out which examples are hard.
#[derive(Debug)]
pub struct Miner(Guided);

impl Miner {
    /// A miner for a vehicle on grids like `spec`.
    ///
    /// # Errors
    /// The planner's, if vehicle or resolution are out of range.
    pub fn new(vehicle: &Vehicle, spec: &GridSpec) -> Result<Self, Error> {
        Guided::new(vehicle, spec, MAX_EXPANSIONS).map(Self)
    }

    /// The numbers of those candidates on which `tiev-fcn` with the regions of `network` takes the
    /// most expansions: a quarter of them, the hardest first.
    ///
    /// # Errors
    /// The planner's, if an example is of another grid.
    pub fn hardest(
        &self,
        network: &Network,
        candidates: &[(u64, Arc<Example>)],
    ) -> Result<Vec<u64>, Error> {
        let steps = candidates
            .par_iter()
            .map(|(number, example)| Ok((self.steps(network, example)?, *number)));
        let mut steps: Vec<(u64, u64)> = steps.collect::<Result<_, Error>>()?;
        steps.sort_unstable_by(|a, b| b.cmp(a));
        steps.truncate(candidates.len().div_ceil(ONE_IN));
        Ok(steps.into_iter().map(|(_, number)| number).collect())
    }

    fn steps(&self, network: &Network, example: &Example) -> Result<u64, Error> {
        let planned = self.0.plan(network, example)?;
        Ok(planned.map_or(0, |(_, result)| result.steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::examples;
    use swath_bridge::Vehicle;
    use swath_planner::network::{NetworkInfo, Parameters};

    #[test]
    fn the_hardest_quarter_comes_first_and_is_the_same_again() {
        let examples: Vec<(u64, Arc<Example>)> =
            (0..).zip(examples(9).into_iter().map(Arc::new)).collect();
        let spec = examples[0].1.spec;
        let info = NetworkInfo {
            spec,
            ..NetworkInfo::default()
        };
        let network = Network::new(info.clone(), &Parameters::initial(info.architecture, 1));
        let miner = Miner::new(&Vehicle::default(), &spec).unwrap();
        let hardest = miner.hardest(&network, &examples).unwrap();
        assert_eq!(hardest.len(), 3);
        assert_eq!(hardest, miner.hardest(&network, &examples).unwrap());
        let steps = |number: u64| {
            let index = usize::try_from(number).unwrap();
            miner.steps(&network, &examples[index].1).unwrap()
        };
        let least = hardest.iter().map(|&number| steps(number)).min().unwrap();
        let others = (0..9).filter(|number| !hardest.contains(number));
        assert!(others.map(steps).all(|steps| steps <= least));
    }
}
