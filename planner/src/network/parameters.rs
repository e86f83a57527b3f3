//! The parameters of a network as two flat vectors, and as named tensors in a safetensors file.

use std::collections::BTreeMap;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::graph::{Architecture, Graph, Kind, SIDE_MULTIPLE, TensorSpec};
use super::predictor::NetworkInfo;
use crate::Error;

/// Most bytes that a weights file may have; ENet's has 1.5 million.
pub const MAX_WEIGHTS_BYTES: usize = 64 << 20;

/// Slope of every `PReLU` at the beginning.
const INITIAL_SLOPE: f32 = 0.25;
/// What wrappers of `PyTorch` put before the names of tensors: `DataParallel`, and `torch.compile`.
const PREFIXES: [&str; 2] = ["module.", "_orig_mod."];
/// What batch normalisation of `PyTorch` counts and no prediction needs.
const COUNTER: &str = "num_batches_tracked";
/// Types that tensors may have.
const TYPES: [Dtype; 3] = [Dtype::F32, Dtype::F16, Dtype::BF16];
/// Most tensors of each fault that an error names.
const MAX_NAMED: usize = 8;
/// Largest number of characters of an error's evidence that is taken from a file.
const MAX_EVIDENCE: usize = 120;

/// Values of every named tensor: the trained ones and the running statistics.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    architecture: Architecture,
    values: Vec<f32>,
    running: Vec<f32>,
}

impl Parameters {
    /// Parameters as training begins with, the same for the same seed.
    ///
    /// Kernels are drawn from a normal distribution of variance 2 / fan-in (K. He et al., 2015), the
    /// last one of every bottleneck not excepted.
    pub fn initial(architecture: Architecture, seed: u64) -> Self {
        let graph = layout(architecture);
        let mut values = vec![0.0; graph.trained_len];
        let mut running = vec![0.0; graph.running_len];
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for tensor in &graph.tensors {
            let range = tensor.start..tensor.start + tensor.len();
            match tensor.kind {
                Kind::Kernel { fan_in } => {
                    let deviation = libm::sqrt(2.0 / fan_in as f64);
                    for value in &mut values[range] {
                        *value = narrow(deviation * standard_normal(&mut random));
                    }
                }
                Kind::Scale => values[range].fill(1.0),
                Kind::Shift => values[range].fill(0.0),
                Kind::Slope => values[range].fill(INITIAL_SLOPE),
                Kind::RunningMean => running[range].fill(0.0),
                Kind::RunningVariance => running[range].fill(1.0),
            }
        }
        Self {
            architecture,
            values,
            running,
        }
    }

    /// The network they belong to.
    pub const fn architecture(&self) -> Architecture {
        self.architecture
    }

    /// The trained values, in the order of the network.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The trained values, to be changed.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Running means and variances.
    pub fn running(&self) -> &[f32] {
        &self.running
    }

    /// Running means and variances, to be changed.
    pub fn running_mut(&mut self) -> &mut [f32] {
        &mut self.running
    }

    /// Each named tensor: name, shape, values.
    pub fn tensors(&self) -> Vec<(String, Vec<usize>, &[f32])> {
        let graph = layout(self.architecture);
        let named = |tensor: TensorSpec| {
            let values = &self.flat(tensor.kind)[tensor.start..tensor.start + tensor.len()];
            (tensor.name, tensor.shape, values)
        };
        graph.tensors.into_iter().map(named).collect()
    }

    /// For each trained value whether weight decay applies to it: kernels only, as usual for networks
    /// with normalisation.
    pub fn is_kernel(&self) -> Vec<bool> {
        let graph = layout(self.architecture);
        let mut kernel = vec![false; graph.trained_len];
        for tensor in &graph.tensors {
            if matches!(tensor.kind, Kind::Kernel { .. }) {
                kernel[tensor.start..tensor.start + tensor.len()].fill(true);
            }
        }
        kernel
    }

    /// A safetensors file with `metadata`: the same bytes for the same parameters, which the crate of
    /// that name does not promise.
    pub fn to_safetensors(&self, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        let mut header = serde_json::Map::new();
        header.insert("__metadata__".to_owned(), serde_json::json!(metadata));
        let mut data = Vec::new();
        for (name, shape, values) in self.tensors() {
            let start = data.len();
            data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            let offsets = [start, data.len()];
            let entry =
                serde_json::json!({"dtype": "F32", "shape": shape, "data_offsets": offsets});
            header.insert(name, entry);
        }
        let mut header = serde_json::Value::Object(header).to_string().into_bytes();
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.append(&mut header);
        bytes.append(&mut data);
        bytes
    }

    /// The parameters in a safetensors file, and its metadata.
    ///
    /// Tensors of half precision are widened. The prefixes that wrappers of `PyTorch` put before names are
    /// left out, and so are the counters of its batch normalisation. Other tensors are refused.
    ///
    /// # Errors
    /// [`Error::Weights`] names what was expected and what was found.
    pub fn from_safetensors(bytes: &[u8]) -> Result<(Self, BTreeMap<String, String>), Error> {
        if bytes.len() > MAX_WEIGHTS_BYTES {
            return Err(wrong(format!(
                "{} bytes, expected at most {MAX_WEIGHTS_BYTES}",
                bytes.len()
            )));
        }
        let unreadable = |error: safetensors::SafeTensorError| {
            wrong(format!("expected a safetensors file: {}", evidence(&error)))
        };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(unreadable)?;
        let file = SafeTensors::deserialize(bytes).map_err(unreadable)?;
        let metadata: BTreeMap<_, _> = header
            .metadata()
            .clone()
            .unwrap_or_default()
            .into_iter()
            .collect();
        let architecture = architecture_of(&metadata)?;
        let graph = layout(architecture);
        let views = views_by_name(&file)?;
        check_tensors(&graph, &views)?;
        let mut parameters = Self {
            architecture,
            values: vec![0.0; graph.trained_len],
            running: vec![0.0; graph.running_len],
        };
        for tensor in &graph.tensors {
            let Some(view) = views.get(tensor.name.as_str()) else {
                continue;
            };
            let to = &mut parameters.flat_mut(tensor.kind)[tensor.start..][..tensor.len()];
            for (index, (to, value)) in to.iter_mut().zip(floats_of(view)).enumerate() {
                let negative = tensor.kind == Kind::RunningVariance && value < 0.0;
                if !value.is_finite() || negative {
                    let sort = if negative { "at least 0" } else { "finite" };
                    return Err(wrong(format!(
                        "tensor {} holds {value} at {index}, expected {sort}",
                        tensor.name
                    )));
                }
                *to = value;
            }
        }
        Ok((parameters, metadata))
    }

    fn flat(&self, kind: Kind) -> &[f32] {
        if kind.is_trained() {
            &self.values
        } else {
            &self.running
        }
    }

    fn flat_mut(&mut self, kind: Kind) -> &mut [f32] {
        if kind.is_trained() {
            &mut self.values
        } else {
            &mut self.running
        }
    }
}

/// The names and shapes, which do not depend on the size of the input.
fn layout(architecture: Architecture) -> Graph {
    Graph::new(architecture, (SIDE_MULTIPLE, SIDE_MULTIPLE))
}

/// The tensors of a file by the names that swath has for them.
fn views_by_name<'a>(file: &'a SafeTensors<'a>) -> Result<BTreeMap<String, TensorView<'a>>, Error> {
    let mut views = BTreeMap::new();
    for (name, view) in file.iter() {
        let mut short = name;
        while let Some(rest) = PREFIXES
            .iter()
            .find_map(|prefix| short.strip_prefix(prefix))
        {
            short = rest;
        }
        if short.rsplit('.').next() == Some(COUNTER) {
            continue;
        }
        if views.insert(short.to_owned(), view).is_some() {
            let short = evidence(&short);
            return Err(wrong(format!(
                "tensor {short} is there twice, with and without a prefix ({})",
                PREFIXES.join(", ")
            )));
        }
    }
    Ok(views)
}

/// Checks names, shapes and types, and names all that is wrong with them.
fn check_tensors(graph: &Graph, views: &BTreeMap<String, TensorView<'_>>) -> Result<(), Error> {
    let expected: BTreeMap<&str, &TensorSpec> = graph
        .tensors
        .iter()
        .map(|tensor| (tensor.name.as_str(), tensor))
        .collect();
    let missing = graph.tensors.iter().map(|tensor| tensor.name.clone());
    let missing: Vec<String> = missing.filter(|name| !views.contains_key(name)).collect();
    let extra = views
        .keys()
        .filter(|name| !expected.contains_key(name.as_str()));
    let extra: Vec<String> = extra.map(|name| evidence(name)).collect();
    let differing = graph.tensors.iter().filter_map(|tensor| {
        let view = views.get(&tensor.name)?;
        let is_right = view.shape() == tensor.shape && TYPES.contains(&view.dtype());
        (!is_right).then(|| {
            let (dtype, shape) = (view.dtype(), view.shape());
            let wanted = &tensor.shape;
            evidence(&format!(
                "{} is {dtype:?} {shape:?}, expected F32, F16 or BF16 {wanted:?}",
                tensor.name
            ))
        })
    });
    let differing: Vec<String> = differing.collect();
    let found: Vec<String> = [
        ("missing", missing),
        ("not expected", extra),
        ("not as expected", differing),
    ]
    .into_iter()
    .filter(|(_, names)| !names.is_empty())
    .map(|(what, names)| format!("{} {what}: {}", tensors_text(names.len()), listed(&names)))
    .collect();
    if found.is_empty() {
        return Ok(());
    }
    Err(wrong(found.join("; ")))
}

fn tensors_text(count: usize) -> String {
    if count == 1 {
        "1 tensor is".to_owned()
    } else {
        format!("{count} tensors are")
    }
}

/// The first names, and how many there are besides.
fn listed(names: &[String]) -> String {
    let shown = names[..names.len().min(MAX_NAMED)].join(", ");
    match names.len().saturating_sub(MAX_NAMED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// The values of a tensor of one of the [`TYPES`].
fn floats_of(view: &TensorView<'_>) -> Vec<f32> {
    let data = view.data();
    let halves = || data.chunks_exact(2).map(|raw| [raw[0], raw[1]]);
    match view.dtype() {
        Dtype::F16 => halves()
            .map(|raw| half::f16::from_le_bytes(raw).to_f32())
            .collect(),
        Dtype::BF16 => halves()
            .map(|raw| half::bf16::from_le_bytes(raw).to_f32())
            .collect(),
        _ => data
            .chunks_exact(4)
            .map(|raw| f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]]))
            .collect(),
    }
}

fn wrong(what: String) -> Error {
    Error::Weights { what }
}

/// The architecture that the metadata of a weights file name.
pub(super) fn architecture_of(metadata: &BTreeMap<String, String>) -> Result<Architecture, Error> {
    let Some(name) = metadata.get("architecture") else {
        return Err(missing_entries(metadata));
    };
    Architecture::from_name(name).ok_or_else(|| {
        let known = Architecture::ALL.map(Architecture::name).join(" or ");
        wrong(format!(
            "architecture is {:?}, expected {known}",
            evidence(name)
        ))
    })
}

/// Says which entries of the metadata are missing, and how to give them.
pub(super) fn missing_entries(metadata: &BTreeMap<String, String>) -> Error {
    let example = NetworkInfo::default().metadata();
    let missing: Vec<&str> = example
        .keys()
        .filter(|key| !metadata.contains_key(*key))
        .map(String::as_str)
        .collect();
    let example = serde_json::json!(example);
    wrong(format!(
        "the metadata has no {}. A file says what its network is for in its metadata, as text. From \
         Python: safetensors.torch.save_file(tensors, file, metadata={example}), with the values of \
         your network",
        missing.join(", ")
    ))
}

fn evidence(error: &dyn std::fmt::Display) -> String {
    error.to_string().chars().take(MAX_EVIDENCE).collect()
}

/// By G. Box and M. Muller; the cosine of the pair is enough.
fn standard_normal(random: &mut ChaCha8Rng) -> f64 {
    const UNIT: f64 = 1.0 / (1_u64 << 53) as f64;
    let radius = 1.0 - (random.next_u64() >> 11) as f64 * UNIT;
    let turn = (random.next_u64() >> 11) as f64 * UNIT;
    libm::sqrt(-2.0 * libm::log(radius)) * libm::cos(std::f64::consts::TAU * turn)
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "parameters are of single precision"
)]
fn narrow(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
