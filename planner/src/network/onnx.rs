//! A network as an ONNX file, for runtimes that others wrote.
//!
//! Opset 17, single precision, any batch size. Inputs: `planes` (batch × 3 × rows × cols of the
//! network's input: obstacles, reference, and the disc around the target for `enet` or around the
//! vehicle for `enet-shared`), and for `enet-shared` `features` (batch × 27 × rows / 8 × cols / 8).
//! Outputs: `logits` (batch × 1 × rows × cols), a cell belongs to the region where its logit is above
//! 0; and for `enet-shared` `scores` (batch × 3). Parameters keep the names that they have in weights files. What the network was trained for is
//! in the metadata.

mod proto;

use super::graph::{
    Activation, BufferId, Conv, Graph, NEAR_GOAL, NORM_EPSILON, Norm, Op, TensorSpec,
};
use super::parameters::Parameters;
use super::predictor::NetworkInfo;
use proto::{Attribute, Model};

/// Name of the input planes.
const PLANES: &str = "planes";
/// Name of the features of the goal.
const FEATURES: &str = "features";
/// Name of the cells' logits.
const LOGITS: &str = "logits";
/// Name of what is said of the goal.
const SCORES: &str = "scores";

/// The bytes of an ONNX file of a network.
pub fn to_onnx(info: &NetworkInfo, parameters: &Parameters) -> Vec<u8> {
    let graph = Graph::new(parameters.architecture(), info.encoding().input_size());
    let mut model = Model::default();
    for (name, shape, values) in parameters.tensors() {
        // Slopes are for channels, which ONNX wants in front of rows and columns.
        let shape = if name.ends_with("prelu.weight") {
            vec![shape[0], 1, 1]
        } else {
            shape
        };
        model.tensor(&name, &shape, values);
    }
    let mut writer = Writer { graph, model };
    writer.input(PLANES, Graph::INPUT);
    if let Some(goal) = writer.graph.goal {
        writer.input(FEATURES, goal);
    }
    for op in writer.graph.ops.clone() {
        writer.op(&op);
    }
    writer.output();
    for (key, value) in info.metadata() {
        writer.model.metadata(&key, &value);
    }
    writer.model.into_bytes()
}

struct Writer {
    graph: Graph,
    model: Model,
}

impl Writer {
    fn name(&self, buffer: BufferId) -> String {
        match buffer {
            Graph::INPUT => PLANES.to_owned(),
            _ if Some(buffer) == self.graph.goal => FEATURES.to_owned(),
            _ if buffer == self.graph.output() => LOGITS.to_owned(),
            _ if Some(buffer) == self.graph.scores => SCORES.to_owned(),
            _ => format!("buffer{buffer}"),
        }
    }

    fn input(&mut self, name: &str, buffer: BufferId) {
        let extent = self.graph.buffers[buffer];
        let shape = [extent.channels, extent.rows, extent.cols];
        self.model.input(name, &shape);
    }

    fn output(&mut self) {
        let extent = self.graph.buffers[self.graph.output()];
        let shape = [extent.channels, extent.rows, extent.cols];
        self.model.output(LOGITS, &shape);
        if let Some(scores) = self.graph.scores {
            let channels = self.graph.buffers[scores].channels;
            self.model.output(SCORES, &[channels]);
        }
    }

    /// The name of the tensor that begins there in its vector.
    fn tensor(&self, trained: bool, start: usize) -> &TensorSpec {
        let tensors = &self.graph.tensors;
        tensors
            .iter()
            .find(|tensor| tensor.kind.is_trained() == trained && tensor.start == start)
            .expect("operations refer to tensors of their graph")
    }

    fn op(&mut self, op: &Op) {
        match *op {
            Op::Conv(conv) => self.conv(&conv),
            Op::Norm(norm) => self.norm(&norm),
            Op::PoolInput { x, y, .. } => {
                let (x, y) = (self.name(x), self.name(y));
                let pooled = format!("{y}.pooled");
                let window = [
                    Attribute::ints("kernel_shape", [2, 2]),
                    Attribute::ints("strides", [2, 2]),
                ];
                self.model.node("MaxPool", &[&x], &pooled, &window);
                let convolved = format!("{y}.convolved");
                let axis = [Attribute::int("axis", 1)];
                self.model.node("Concat", &[&convolved, &pooled], &y, &axis);
            }
            Op::Pool { x, y } => self.pool(x, y),
            Op::Upsample { x, y } => {
                let (x, y) = (self.name(x), self.name(y));
                let scales = format!("{y}.scales");
                self.model.tensor(&scales, &[4], &[1.0, 1.0, 2.0, 2.0]);
                let linear = [
                    Attribute::text("mode", "linear"),
                    Attribute::text("coordinate_transformation_mode", "half_pixel"),
                ];
                self.model.node("Resize", &[&x, "", &scales], &y, &linear);
            }
            Op::Add { a, b, y } => {
                let (a, b, y) = (self.name(a), self.name(b), self.name(y));
                self.model.node("Add", &[&a, &b], &y, &[]);
            }
            Op::Score {
                x,
                goal,
                kernel,
                bias,
                ..
            } => self.score((x, goal), (kernel, bias)),
            Op::Head { x, y, kernel, bias } => {
                let kernel = self.tensor(true, kernel).name.clone();
                let bias = self.tensor(true, bias).name.clone();
                let (x, y) = (self.name(x), self.name(y));
                let window = [
                    Attribute::ints("kernel_shape", [2, 2]),
                    Attribute::ints("strides", [2, 2]),
                ];
                let inputs = [x.as_str(), &kernel, &bias];
                self.model.node("ConvTranspose", &inputs, &y, &window);
            }
        }
    }

    fn conv(&mut self, conv: &Conv) {
        let window = conv.window;
        let side = |cells: usize| i64::try_from(cells).expect("windows are small");
        let both = |cells: usize| [side(cells), side(cells)];
        let (rows, cols) = (side(window.padding.0), side(window.padding.1));
        let kernel = [side(window.kernel.0), side(window.kernel.1)];
        let mut attributes = vec![
            Attribute::ints("kernel_shape", kernel),
            Attribute::ints("pads", [rows, cols, rows, cols]),
        ];
        let kind = if window.transposed {
            attributes.push(Attribute::ints("strides", both(window.stride)));
            attributes.push(Attribute::ints("output_padding", [1, 1]));
            "ConvTranspose"
        } else {
            attributes.push(Attribute::ints("strides", both(window.stride)));
            attributes.push(Attribute::ints("dilations", both(window.dilation)));
            "Conv"
        };
        let kernel = self.tensor(true, conv.kernel).name.clone();
        let (x, mut y) = (self.name(conv.x), self.name(conv.y));
        if conv.outputs < self.graph.buffers[conv.y].channels {
            y.push_str(".convolved");
        }
        self.model.node(kind, &[&x, &kernel], &y, &attributes);
    }

    fn norm(&mut self, norm: &Norm) {
        let channels = norm.channels;
        let names: Vec<String> = [
            (true, norm.scale),
            (true, norm.scale + channels),
            (false, norm.running),
            (false, norm.running + channels),
        ]
        .into_iter()
        .map(|(trained, start)| self.tensor(trained, start).name.clone())
        .collect();
        let (x, y) = (self.name(norm.x), self.name(norm.y));
        let mut last = x;
        let mut stages: Vec<(&str, Vec<String>, Vec<Attribute>)> = vec![(
            "BatchNormalization",
            names,
            vec![Attribute::float("epsilon", NORM_EPSILON)],
        )];
        if let Some(residual) = norm.residual {
            stages.push(("Add", vec![self.name(residual)], Vec::new()));
        }
        match norm.activation {
            Activation::Identity => {}
            Activation::Relu => stages.push(("Relu", Vec::new(), Vec::new())),
            Activation::Prelu(start) => {
                let slope = self.tensor(true, start).name.clone();
                stages.push(("PRelu", vec![slope], Vec::new()));
            }
        }
        let count = stages.len();
        for (index, (kind, others, attributes)) in stages.into_iter().enumerate() {
            let to = if index + 1 == count {
                y.clone()
            } else {
                format!("{y}.{kind}")
            };
            let mut inputs = vec![last.as_str()];
            inputs.extend(others.iter().map(String::as_str));
            self.model.node(kind, &inputs, &to, &attributes);
            last = to;
        }
    }

    fn score(&mut self, (x, goal): (BufferId, BufferId), (kernel, bias): (usize, usize)) {
        let kernel = self.tensor(true, kernel).name.clone();
        let bias = self.tensor(true, bias).name.clone();
        let (x, goal) = (self.name(x), self.name(goal));
        let model = &mut self.model;
        let feature = i64::try_from(NEAR_GOAL).expect("features are few");
        model.integers("score.feature", &[feature]);
        model.integers("score.pixels", &[2, 3]);
        model.tensor("score.least", &[1], &[1e-6]);
        let feature = [Attribute::int("axis", 1)];
        model.node("Gather", &[&goal, "score.feature"], "score.bell", &feature);
        model.node("Relu", &["score.bell"], "score.near", &[]);
        let kept = [Attribute::int("keepdims", 1)];
        model.node(
            "ReduceSum",
            &["score.near", "score.pixels"],
            "score.sum",
            &kept,
        );
        model.node("Max", &["score.sum", "score.least"], "score.total", &[]);
        model.node("Div", &["score.near", "score.total"], "score.share", &[]);
        model.node("Mul", &[&x, "score.share"], "score.shares", &[]);
        let dropped = [Attribute::int("keepdims", 0)];
        let inputs = ["score.shares", "score.pixels"];
        model.node("ReduceSum", &inputs, "score.weighted", &dropped);
        let over_pixels = [
            Attribute::int("keepdims", 0),
            Attribute::ints("axes", [2, 3]),
        ];
        model.node("ReduceMean", &[&x], "score.plain", &over_pixels);
        let axis = [Attribute::int("axis", 1)];
        let both = ["score.plain", "score.weighted"];
        model.node("Concat", &both, "score.means", &axis);
        let transposed = [Attribute::int("transB", 1)];
        model.node(
            "Gemm",
            &["score.means", &kernel, &bias],
            SCORES,
            &transposed,
        );
    }

    fn pool(&mut self, x: BufferId, y: BufferId) {
        let missing = self.graph.buffers[y].channels - self.graph.buffers[x].channels;
        let (x, y) = (self.name(x), self.name(y));
        let window = [
            Attribute::ints("kernel_shape", [2, 2]),
            Attribute::ints("strides", [2, 2]),
        ];
        let pooled = format!("{y}.pooled");
        self.model.node("AveragePool", &[&x], &pooled, &window);
        let pads = format!("{y}.pads");
        let missing = i64::try_from(missing).expect("channels are few");
        self.model.integers(&pads, &[0, 0, 0, 0, 0, missing, 0, 0]);
        self.model.node("Pad", &[&pooled, &pads], &y, &[]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Architecture;

    #[test]
    fn a_file_holds_every_parameter_and_is_the_same_every_time() {
        for architecture in Architecture::ALL {
            let info = NetworkInfo {
                architecture,
                ..NetworkInfo::default()
            };
            let parameters = Parameters::initial(architecture, 1);
            let bytes = to_onnx(&info, &parameters);
            let values: usize = parameters.tensors().iter().map(|(_, _, v)| v.len()).sum();
            assert!(bytes.len() > 4 * values);
            assert!(bytes == to_onnx(&info, &parameters));
        }
    }
}
