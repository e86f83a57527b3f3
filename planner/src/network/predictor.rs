//! A loaded network: weights, what they were trained for, and predictions for many targets at once.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use swath_bridge::{GridSpec, Pose2, SpeedLimits, Vehicle};

use super::disc_ways::DiscWays;
use super::engine::{Inference, Isa, Workspace};
use super::graph::Architecture;
use super::input::{Encoding, InputSize, Surroundings};
use super::parameters::{Parameters, architecture_of, missing_entries};
use super::reach::Reach;
use super::speed_limits;
use crate::{Error, Plane};

/// Most cells along a side of a network's grid.
const MAX_SIDE_CELLS: u32 = 1024;

/// What a network was trained for. It travels in the metadata of the weights file.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkInfo {
    /// Which network.
    pub architecture: Architecture,
    /// The grid.
    pub spec: GridSpec,
    /// At what resolution the network sees the grid.
    pub size: InputSize,
    /// Digest of the vehicle's dimensions, see [`Vehicle::digest`].
    pub vehicle: String,
    /// Smallest turning radius of the vehicle, metres.
    pub min_turning_radius_m: f64,
    /// How its speed limits its turns. The paper's limits are not written into weights files.
    pub speed_limits: SpeedLimits,
    /// Half of the vehicle's width, metres.
    pub half_width_m: f64,
    /// Distance from the path to the edge of the region that was learnt, metres.
    pub label_dilation_m: f64,
    /// Distance from the reference to the edge of its plane, metres.
    pub reference_dilation_m: f64,
    /// Radius of the disc around the target, metres.
    pub target_dilation_m: f64,
}

impl Default for NetworkInfo {
    fn default() -> Self {
        let vehicle = Vehicle::default();
        Self {
            architecture: Architecture::default(),
            spec: GridSpec::default(),
            size: InputSize::default(),
            vehicle: vehicle.digest(),
            min_turning_radius_m: vehicle.min_turning_radius_m,
            speed_limits: vehicle.speed_limits(),
            half_width_m: vehicle.half_width_m,
            label_dilation_m: 1.4,
            reference_dilation_m: 1.0,
            target_dilation_m: 1.0,
        }
    }
}

impl NetworkInfo {
    /// How grids enter and leave the network.
    pub const fn encoding(&self) -> Encoding {
        Encoding {
            architecture: self.architecture,
            spec: self.spec,
            size: self.size,
            disc_m: self.target_dilation_m,
            min_turning_radius_m: self.min_turning_radius_m,
            speed_limits: self.speed_limits,
            half_width_m: self.half_width_m,
        }
    }

    /// The metadata of a weights file.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let number = |value: f64| value.to_string();
        let own_limits = if self.speed_limits == Vehicle::default().speed_limits() {
            BTreeMap::new()
        } else {
            speed_limits::to_metadata(&self.speed_limits)
        };
        [
            ("architecture", self.architecture.name().to_owned()),
            ("size", self.size.name().to_owned()),
            ("rows", self.spec.rows.to_string()),
            ("cols", self.spec.cols.to_string()),
            ("ego_row", self.spec.ego_row.to_string()),
            ("ego_col", self.spec.ego_col.to_string()),
            ("resolution_m", number(self.spec.resolution_m)),
            ("vehicle", self.vehicle.clone()),
            ("min_turning_radius_m", number(self.min_turning_radius_m)),
            ("half_width_m", number(self.half_width_m)),
            ("label_dilation_m", number(self.label_dilation_m)),
            ("reference_dilation_m", number(self.reference_dilation_m)),
            ("target_dilation_m", number(self.target_dilation_m)),
        ]
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .chain(own_limits)
        .collect()
    }

    /// Reads the metadata of a weights file; entries of other names are ignored.
    ///
    /// # Errors
    /// [`Error::Weights`] names the entry that is missing or out of range.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, Error> {
        let text = |key: &str| metadata.get(key).ok_or_else(|| missing_entries(metadata));
        let wrong = |key: &str, found: &str, expected: &str| Error::Weights {
            what: format!("{key} is {:?}, expected {expected}", clip(found)),
        };
        let size = text("size")?;
        let size = InputSize::from_name(size).ok_or_else(|| wrong("size", size, "full or half"))?;
        let cells = |key: &str, least: u32| {
            let found = text(key)?;
            found
                .parse::<u32>()
                .ok()
                .filter(|cells| (least..=MAX_SIDE_CELLS).contains(cells))
                .ok_or_else(|| wrong(key, found, &format!("{least} to {MAX_SIDE_CELLS} cells")))
        };
        let metres = |key: &str| {
            let found = text(key)?;
            found
                .parse::<f64>()
                .ok()
                .filter(|metres| (0.01..=100.0).contains(metres))
                .ok_or_else(|| wrong(key, found, "0.01 to 100 m"))
        };
        let spec = GridSpec {
            rows: cells("rows", 1)?,
            cols: cells("cols", 1)?,
            resolution_m: metres("resolution_m")?,
            ego_row: cells("ego_row", 0)?,
            ego_col: cells("ego_col", 0)?,
        };
        Ok(Self {
            architecture: architecture_of(metadata)?,
            spec,
            size,
            vehicle: clip(text("vehicle")?),
            min_turning_radius_m: metres("min_turning_radius_m")?,
            speed_limits: speed_limits::from_metadata(metadata)?,
            half_width_m: metres("half_width_m")?,
            label_dilation_m: metres("label_dilation_m")?,
            reference_dilation_m: metres("reference_dilation_m")?,
            target_dilation_m: metres("target_dilation_m")?,
        })
    }
}

/// The beginning of text from a file, for an error or a log.
pub(super) fn clip(text: &str) -> String {
    text.chars().take(64).collect()
}

/// What a network says of a goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// The cells that are more likely in the path's surroundings than not.
    pub region: Plane,
    /// How well the goal can be reached, if the architecture says so.
    pub reach: Option<Reach>,
}

/// A network that predicts path regions. It may be used from several threads at once.
#[derive(Debug)]
pub struct Network {
    info: NetworkInfo,
    inference: Inference,
    maps: Mutex<Vec<(Workspace, DiscWays)>>,
    goals: Mutex<Vec<Workspace>>,
}

impl Network {
    /// A network of these parameters, which must be of the same architecture.
    pub fn new(info: NetworkInfo, parameters: &Parameters) -> Self {
        debug_assert_eq!(info.architecture, parameters.architecture());
        let size = info.encoding().input_size();
        Self {
            inference: Inference::new(Isa::detect(), size, parameters),
            maps: Mutex::new(Vec::new()),
            goals: Mutex::new(Vec::new()),
            info,
        }
    }

    /// The network in a safetensors file, as [`Self::save`] writes it.
    ///
    /// # Errors
    /// [`Error::Weights`] names what was expected and what was found.
    pub fn load(safetensors: &[u8]) -> Result<Self, Error> {
        let (parameters, metadata) = Parameters::from_safetensors(safetensors)?;
        Ok(Self::new(
            NetworkInfo::from_metadata(&metadata)?,
            &parameters,
        ))
    }

    /// A safetensors file of parameters and what they were trained for.
    pub fn save(info: &NetworkInfo, parameters: &Parameters) -> Vec<u8> {
        parameters.to_safetensors(&info.metadata())
    }

    /// What the network was trained for.
    pub const fn info(&self) -> &NetworkInfo {
        &self.info
    }

    /// The region of the path to each goal, and how well it can be reached.
    ///
    /// Goals are spread over the cores.
    ///
    /// # Errors
    /// [`Error::Shape`] if a plane is not of the network's grid.
    pub fn predict(
        &self,
        surroundings: &Surroundings<'_>,
        goals: &[Pose2],
    ) -> Result<Vec<Prediction>, Error> {
        let encoding = self.info.encoding();
        self.each(surroundings, goals, |logits, reach| Prediction {
            region: encoding.region(logits),
            reach,
        })
    }

    /// The probability of each cell, row-major, to be in the region of the path to each goal.
    ///
    /// # Errors
    /// [`Error::Shape`] if a plane is not of the network's grid.
    pub fn probabilities(
        &self,
        surroundings: &Surroundings<'_>,
        goals: &[Pose2],
    ) -> Result<Vec<Vec<f32>>, Error> {
        let encoding = self.info.encoding();
        self.each(surroundings, goals, |logits, _| {
            let mut cells = vec![0.0; encoding.cells()];
            encoding.decode(logits, &mut cells);
            for cell in &mut cells {
                *cell = 1.0 / (1.0 + libm::expf(-*cell));
            }
            cells
        })
    }

    fn each<T: Send>(
        &self,
        surroundings: &Surroundings<'_>,
        goals: &[Pose2],
        finish: impl Fn(&[f32], Option<Reach>) -> T + Sync,
    ) -> Result<Vec<T>, Error> {
        let encoding = self.info.encoding();
        encoding.check(surroundings.obstacles)?;
        encoding.check(surroundings.reference)?;
        if goals.is_empty() {
            return Ok(Vec::new());
        }
        let (mut map, mut ways) = take(&self.maps);
        let shares_map = encoding.features_len() > 0;
        if shares_map {
            let planes = self.inference.planes(&mut map);
            encoding.encode_planes(surroundings, None, planes)?;
            rayon::join(
                || self.inference.see_map(&mut map),
                || encoding.survey(surroundings, &mut ways),
            );
        }
        let alone = goals.len() == 1;
        let predictions = goals.par_iter().map(|goal| {
            let mut memory = take(&self.goals);
            let input = self.inference.goal_input(&mut memory);
            if shares_map {
                encoding.encode_goal(surroundings, &ways, goal, input);
            } else {
                encoding.encode_planes(surroundings, Some(goal), input)?;
            }
            self.inference.see_goal(&map, &mut memory, alone);
            let scores = self.inference.scores(&memory);
            let reach = scores.and_then(Reach::from_scores);
            let result = finish(self.inference.logits(&memory), reach);
            give(&self.goals, memory);
            Ok(result)
        });
        let predictions = predictions.collect();
        give(&self.maps, (map, ways));
        predictions
    }
}

fn take<T: Default>(pool: &Mutex<Vec<T>>) -> T {
    let mut pool = pool.lock().unwrap_or_else(PoisonError::into_inner);
    pool.pop().unwrap_or_default()
}

fn give<T>(pool: &Mutex<Vec<T>>, memory: T) {
    let mut pool = pool.lock().unwrap_or_else(PoisonError::into_inner);
    pool.push(memory);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Reference;
    use crate::network::graph::{GOAL_FEATURES, INPUT_PLANES, SIDE_MULTIPLE};
    use candle_core::{DType, Device, Tensor};
    use proptest::prelude::*;
    use std::sync::OnceLock;

    fn initial(seed: u64) -> Parameters {
        Parameters::initial(Architecture::default(), seed)
    }

    fn file() -> &'static [u8] {
        static FILE: OnceLock<Vec<u8>> = OnceLock::new();
        FILE.get_or_init(|| Network::save(&NetworkInfo::default(), &initial(7)))
    }

    #[test]
    fn saved_weights_load_as_they_were() {
        let (parameters, metadata) = Parameters::from_safetensors(file()).unwrap();
        assert_eq!(parameters, initial(7));
        assert_eq!(
            NetworkInfo::from_metadata(&metadata).unwrap(),
            NetworkInfo::default()
        );
        assert!(file() == Network::save(&NetworkInfo::default(), &parameters));
    }

    #[test]
    fn each_goal_is_predicted_as_if_it_were_alone() {
        for architecture in Architecture::ALL {
            let spec = GridSpec {
                rows: 61,
                cols: 35,
                resolution_m: 0.4,
                ego_row: 50,
                ego_col: 17,
            };
            let info = NetworkInfo {
                architecture,
                spec,
                ..NetworkInfo::default()
            };
            let network = Network::new(info, &Parameters::initial(architecture, 3));
            let plane = |step: usize| {
                let mut plane = Plane::empty(61, 35);
                (0..plane.len())
                    .step_by(step)
                    .for_each(|index| plane.set_index(index));
                plane
            };
            let goals = [6.0, 12.0, 17.0].map(|x_m| Pose2::new(x_m, 2.0, 0.1));
            let (obstacles, reference) = (plane(5), plane(13));
            let surroundings = Surroundings {
                obstacles: &obstacles,
                reference: &reference,
                speed_m_per_s: 1.4,
            };
            let together = network.predict(&surroundings, &goals).unwrap();
            assert_ne!(together[0], together[1]);
            for (goal, prediction) in goals.iter().zip(&together) {
                let goal = std::slice::from_ref(goal);
                let alone = network.predict(&surroundings, goal).unwrap();
                assert_eq!(&alone[0], prediction);
                let scored = architecture == Architecture::EnetShared;
                assert_eq!(prediction.reach.is_some(), scored);
                let cells = network.probabilities(&surroundings, goal).unwrap();
                let above = cells[0].iter().filter(|&&p| p > 0.5).count();
                assert!(above.abs_diff(prediction.region.count()) <= 1);
            }
            assert!(network.predict(&surroundings, &[]).unwrap().is_empty());
            let small = Plane::empty(3, 3);
            let surroundings = Surroundings {
                obstacles: &small,
                ..surroundings
            };
            assert!(network.predict(&surroundings, &goals).is_err());
        }
    }

    #[test]
    fn missing_and_absurd_metadata_are_named() {
        let complete = NetworkInfo::default().metadata();
        for (key, absurd) in [
            ("architecture", "segnet"),
            ("size", "double"),
            ("rows", "4294967295"),
            ("cols", "0"),
            ("ego_row", "-3"),
            ("min_turning_radius_m", "0"),
            ("resolution_m", "NaN"),
            ("label_dilation_m", "-1"),
        ] {
            let mut metadata = complete.clone();
            metadata.insert(key.to_owned(), absurd.to_owned());
            let error = NetworkInfo::from_metadata(&metadata)
                .unwrap_err()
                .to_string();
            assert!(error.contains(key) && error.contains(absurd), "{error}");
            metadata.remove(key);
            let error = NetworkInfo::from_metadata(&metadata)
                .unwrap_err()
                .to_string();
            assert!(error.contains(key), "{error}");
        }
    }

    #[test]
    fn headers_that_promise_more_than_there_is_are_refused() {
        let mut long_header = file().to_vec();
        long_header[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(Network::load(&long_header).is_err());
        let mut far_offset = file().to_vec();
        let text = b"\"data_offsets\":[";
        let at = far_offset
            .windows(text.len())
            .position(|part| part == text)
            .unwrap();
        far_offset[at + text.len()] = b'9';
        assert!(Network::load(&far_offset).is_err());
        let mut not_a_number = file().to_vec();
        let end = not_a_number.len();
        not_a_number[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        let error = Network::load(&not_a_number).unwrap_err().to_string();
        assert!(error.contains("finite"), "{error}");
    }

    /// The logits of the cells by the plain candle model.
    fn plainly(
        info: &NetworkInfo,
        parameters: &Parameters,
        surroundings: &Surroundings<'_>,
        goal: &Pose2,
    ) -> Vec<f32> {
        let encoding = info.encoding();
        let mut input = vec![0.0; encoding.input_len()];
        encoding.encode(surroundings, goal, &mut input).unwrap();
        let (planes, features) = input.split_at(encoding.planes_len());
        let (rows, cols) = encoding.input_size();
        let tensor = |values: &[f32], shape: (usize, usize, usize, usize)| {
            let channels_last = Tensor::from_slice(values, shape, &Device::Cpu).unwrap();
            let channels_first = channels_last.permute((0, 3, 1, 2)).unwrap();
            channels_first.contiguous().unwrap()
        };
        let planes = tensor(planes, (1, rows, cols, INPUT_PLANES));
        let features = (!features.is_empty()).then(|| {
            let shape = (1, rows / SIDE_MULTIPLE, cols / SIDE_MULTIPLE, GOAL_FEATURES);
            tensor(features, shape)
        });
        let reference = Reference::new(parameters, &Device::Cpu, DType::F64).unwrap();
        let logits = reference
            .forward(&planes, features.as_ref(), false)
            .unwrap();
        let logits = logits.to_dtype(DType::F32).unwrap();
        let logits: Vec<f32> = logits.flatten_all().unwrap().to_vec1().unwrap();
        let mut cells = vec![0.0; encoding.cells()];
        encoding.decode(&logits, &mut cells);
        cells
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn on_grids_of_any_size_predictions_are_those_of_plain_candle(
            shared: bool, half: bool, rows in 1u32..90, cols in 1u32..60, seed in 0u64..1000,
        ) {
            let info = NetworkInfo {
                architecture: if shared { Architecture::EnetShared } else { Architecture::Enet },
                size: if half { InputSize::Half } else { InputSize::Full },
                spec: GridSpec { rows, cols, resolution_m: 0.2, ego_row: rows / 2, ego_col: cols / 3 },
                ..NetworkInfo::default()
            };
            let parameters = Parameters::initial(info.architecture, seed);
            let (mut obstacles, mut reference) = (Plane::empty(rows, cols), Plane::empty(rows, cols));
            (0..obstacles.len()).step_by(17).for_each(|index| obstacles.set_index(index));
            (0..reference.len()).step_by(3).for_each(|index| reference.set_index(index));
            let surroundings = Surroundings {
                obstacles: &obstacles,
                reference: &reference,
                speed_m_per_s: 1.4,
            };
            let goal = Pose2::new(3.0, -1.0, 0.4);
            let expected = plainly(&info, &parameters, &surroundings, &goal);
            let network = Network::new(info, &parameters);
            let found = network.each(&surroundings, &[goal], |logits, _| {
                let mut cells = vec![0.0; network.info.encoding().cells()];
                network.info.encoding().decode(logits, &mut cells);
                cells
            });
            let pairs = found.unwrap().swap_remove(0).into_iter().zip(&expected);
            let off = pairs.fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
            let largest = expected.iter().fold(0.0_f32, |most, cell| most.max(cell.abs()));
            prop_assert!(off <= 1e-4 * largest.max(1.0), "{} of {}", off, largest);
        }
    }

    proptest! {
        #[test]
        fn truncated_files_and_noise_are_errors(
            len in 0usize..4000, noise in proptest::collection::vec(any::<u8>(), 0..400),
        ) {
            prop_assert!(Network::load(&file()[..len]).is_err());
            prop_assert!(Network::load(&noise).is_err());
        }

        #[test]
        fn damage_in_the_header_never_panics(at in 0usize..20_000, value: u8) {
            let mut damaged = file().to_vec();
            damaged[at] = value;
            let _ = Network::load(&damaged);
        }
    }
}
