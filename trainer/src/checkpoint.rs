//! Everything that training needs to go on as if it had never stopped, in one file.
//!
//! Shuffles, mirroring and dropout are functions of the seed and the step, so their state is the step.
//! A file appears under its name only when it is complete and on the disk.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use swath_planner::network::Parameters;

use crate::optimiser::AdamState;
use crate::{Error, TrainConfig};

/// Most bytes of a checkpoint; ENet's has 4.5 million.
const MAX_CHECKPOINT_BYTES: u64 = 256 << 20;
/// Format of the file.
const FORMAT: u32 = 1;

/// The position of a run, with what it has reached.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Progress {
    /// Steps taken.
    pub step: u64,
    /// Steps in the whole run, 0 if it has no end.
    pub total_steps: u64,
    /// Samples shown.
    pub samples: u64,
    /// Forward passes, parts of batches counted singly.
    pub passes: u64,
    /// Sum of the losses since they were last asked for.
    pub loss_sum: f64,
    /// Steps in `loss_sum`.
    pub loss_steps: u64,
    /// Best mIoU on the validation samples so far.
    pub best_miou: Option<f64>,
    /// Scorings since the best.
    pub since_best: u64,
    /// Number of the newest published weights.
    pub version: u64,
    /// Numbers of the samples that come back more often.
    #[serde(default)]
    pub hard: Vec<u64>,
}

/// What a checkpoint holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Configuration of the run.
    pub config: TrainConfig,
    /// Where it stands.
    pub progress: Progress,
    /// The network.
    pub parameters: Parameters,
    /// The optimiser.
    pub adam: AdamState,
}

#[derive(Serialize, Deserialize)]
struct State {
    format: u32,
    config: TrainConfig,
    progress: Progress,
    adam_steps: u64,
}

impl Checkpoint {
    /// Writes the checkpoint in place of an older one.
    ///
    /// # Errors
    /// [`Error::Io`] if the disk does not take it, [`Error::Checkpoint`] if it cannot be laid out.
    pub fn save(&self, path: &Path) -> Result<(), Error> {
        let unusable = |error: &dyn std::fmt::Display| Error::Checkpoint {
            path: path.to_owned(),
            what: format!("cannot be written: {error}"),
        };
        let state = State {
            format: FORMAT,
            config: self.config.clone(),
            progress: self.progress.clone(),
            adam_steps: self.adam.steps,
        };
        let state = serde_json::to_string(&state).map_err(|error| unusable(&error))?;
        let parts = [
            ("values", bytes_of(self.parameters.values())),
            ("running", bytes_of(self.parameters.running())),
            ("adam_mean", bytes_of(&self.adam.mean)),
            ("adam_square", bytes_of(&self.adam.square)),
        ];
        let mut views = Vec::new();
        for (name, bytes) in &parts {
            let view = TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes);
            views.push((*name, view.map_err(|error| unusable(&error))?));
        }
        let metadata = HashMap::from([("state".to_owned(), state)]);
        let bytes =
            safetensors::serialize(views, Some(metadata)).map_err(|error| unusable(&error))?;
        write_atomically(path, &bytes)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read, [`Error::Checkpoint`] if it is not one.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let io = |source| Error::Io {
            path: path.to_owned(),
            source,
        };
        let wrong = |what: String| Error::Checkpoint {
            path: path.to_owned(),
            what,
        };
        let len = fs::metadata(path).map_err(io)?.len();
        if len > MAX_CHECKPOINT_BYTES {
            return Err(wrong(format!(
                "{len} bytes, expected at most {MAX_CHECKPOINT_BYTES}"
            )));
        }
        let bytes = fs::read(path).map_err(io)?;
        let unreadable = |error: safetensors::SafeTensorError| wrong(clip(&error));
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(unreadable)?;
        let file = SafeTensors::deserialize(&bytes).map_err(unreadable)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let state = metadata
            .get("state")
            .ok_or_else(|| wrong("no state".to_owned()))?;
        let state: State = serde_json::from_str(state).map_err(|error| wrong(clip(&error)))?;
        if state.format != FORMAT {
            return Err(wrong(format!("format {}, expected {FORMAT}", state.format)));
        }
        let mut parts = BTreeMap::new();
        let mut parameters = Parameters::initial(state.config.architecture, 0);
        let (values, running) = (parameters.values().len(), parameters.running().len());
        for (name, len) in [
            ("values", values),
            ("running", running),
            ("adam_mean", values),
            ("adam_square", values),
        ] {
            let view = file.tensor(name).map_err(|error| wrong(clip(&error)))?;
            if view.dtype() != Dtype::F32 || view.shape() != [len] {
                let (dtype, shape) = (view.dtype(), view.shape());
                return Err(wrong(format!(
                    "{name} is {dtype:?} {shape:?}, expected F32 [{len}]"
                )));
            }
            parts.insert(name, floats_of(view.data()));
        }
        let mut take = |name: &str| parts.remove(name).unwrap_or_default();
        parameters.values_mut().copy_from_slice(&take("values"));
        parameters.running_mut().copy_from_slice(&take("running"));
        Ok(Self {
            config: state.config,
            progress: state.progress,
            parameters,
            adam: AdamState {
                steps: state.adam_steps,
                mean: take("adam_mean"),
                square: take("adam_square"),
            },
        })
    }
}

/// Writes a file so that under its name there is always a complete one, be it the old or the new.
///
/// # Errors
/// [`Error::Io`] names the file.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(".partial");
    let mut file = File::create(&temporary).map_err(io)?;
    file.write_all(bytes).map_err(io)?;
    file.sync_all().map_err(io)?;
    drop(file);
    fs::rename(&temporary, path).map_err(io)?;
    // The new name itself is on the disk only once the directory is.
    let directory = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty());
    let directory = File::open(directory.unwrap_or(Path::new("."))).map_err(io)?;
    directory.sync_all().map_err(io)
}

fn clip(error: &dyn std::fmt::Display) -> String {
    error.to_string().chars().take(200).collect()
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

fn floats_of(bytes: &[u8]) -> Vec<f32> {
    let floats = bytes.chunks_exact(4);
    floats
        .map(|raw| f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkpoint() -> Checkpoint {
        let parameters = Parameters::initial(TrainConfig::default().architecture, 3);
        let len = parameters.values().len();
        Checkpoint {
            config: TrainConfig::default(),
            progress: Progress {
                step: 7,
                total_steps: 20,
                samples: 100,
                passes: 9,
                loss_sum: 0.1 + 0.2,
                loss_steps: 3,
                best_miou: Some(1.0 / 3.0),
                since_best: 2,
                version: 2,
                hard: vec![3, 1],
            },
            adam: AdamState {
                steps: 7,
                mean: parameters
                    .values()
                    .iter()
                    .map(|value| value * 0.1)
                    .collect(),
                square: vec![1e-30; len],
            },
            parameters,
        }
    }

    #[test]
    fn what_is_saved_is_loaded_bit_for_bit() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("checkpoint");
        checkpoint().save(&path).unwrap();
        assert_eq!(Checkpoint::load(&path).unwrap(), checkpoint());
        let first = fs::read(&path).unwrap();
        checkpoint().save(&path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), first);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn truncated_and_foreign_files_are_errors_that_name_the_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("checkpoint");
        checkpoint().save(&path).unwrap();
        let whole = fs::read(&path).unwrap();
        for len in [0, 4, 8, 100, 2000, whole.len() - 1] {
            fs::write(&path, &whole[..len]).unwrap();
            let error = Checkpoint::load(&path).unwrap_err().to_string();
            assert!(error.contains("checkpoint"), "{error}");
        }
        let weights = swath_planner::network::Network::save(
            &swath_planner::network::NetworkInfo::default(),
            &Parameters::initial(TrainConfig::default().architecture, 1),
        );
        fs::write(&path, weights).unwrap();
        let error = Checkpoint::load(&path).unwrap_err().to_string();
        assert!(error.contains("state"), "{error}");
    }
}
