//! The few messages of `onnx.proto` that a network needs, in the wire format of protocol buffers.

/// Version of the file format.
const IR_VERSION: u64 = 8;
/// Version of the operators.
const OPSET: u64 = 17;
/// Element types of tensors.
const FLOAT: u64 = 1;
const INT64: u64 = 7;

/// A message under construction: fields one after the other.
#[derive(Debug, Clone, Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push((value & 0x7f) as u8 | 0x80);
            value >>= 7;
        }
        self.0.push((value & 0x7f) as u8);
    }

    /// A field that is a number; negative ones in two's complement.
    fn number(&mut self, field: u64, value: u64) -> &mut Self {
        self.varint(field << 3);
        self.varint(value);
        self
    }

    fn signed(&mut self, field: u64, value: i64) -> &mut Self {
        self.number(field, value.cast_unsigned())
    }

    fn float(&mut self, field: u64, value: f32) -> &mut Self {
        self.varint(field << 3 | 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    fn bytes(&mut self, field: u64, bytes: &[u8]) -> &mut Self {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend(bytes);
        self
    }

    fn text(&mut self, field: u64, text: &str) -> &mut Self {
        self.bytes(field, text.as_bytes())
    }

    fn message(&mut self, field: u64, message: &Self) -> &mut Self {
        self.bytes(field, &message.0)
    }
}

/// A setting of an operator.
#[derive(Debug, Clone)]
pub(super) struct Attribute(Message);

impl Attribute {
    fn begin(name: &str, kind: u64) -> Message {
        let mut message = Message::default();
        message.text(1, name).number(20, kind);
        message
    }

    pub(super) fn float(name: &str, value: f32) -> Self {
        let mut message = Self::begin(name, 1);
        message.float(2, value);
        Self(message)
    }

    pub(super) fn int(name: &str, value: i64) -> Self {
        let mut message = Self::begin(name, 2);
        message.signed(3, value);
        Self(message)
    }

    pub(super) fn text(name: &str, value: &str) -> Self {
        let mut message = Self::begin(name, 3);
        message.text(4, value);
        Self(message)
    }

    pub(super) fn ints(name: &str, values: impl IntoIterator<Item = i64>) -> Self {
        let mut message = Self::begin(name, 7);
        for value in values {
            message.signed(8, value);
        }
        Self(message)
    }
}

/// A model of one graph.
#[derive(Debug, Default)]
pub(super) struct Model {
    graph: Message,
    metadata: Message,
    nodes: usize,
}

impl Model {
    /// A constant of single precision.
    pub(super) fn tensor(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let raw: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.constant(name, shape, (FLOAT, &raw));
    }

    /// A constant list of integers.
    pub(super) fn integers(&mut self, name: &str, values: &[i64]) {
        let raw: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.constant(name, &[values.len()], (INT64, &raw));
    }

    fn constant(&mut self, name: &str, shape: &[usize], (kind, raw): (u64, &[u8])) {
        let mut tensor = Message::default();
        for &side in shape {
            tensor.number(1, side as u64);
        }
        tensor.number(2, kind).text(8, name).bytes(9, raw);
        self.graph.message(5, &tensor);
    }

    /// An operator with one output.
    pub(super) fn node(
        &mut self,
        kind: &str,
        inputs: &[&str],
        output: &str,
        attributes: &[Attribute],
    ) {
        let mut node = Message::default();
        for input in inputs {
            node.text(1, input);
        }
        node.text(2, output)
            .text(3, &format!("{kind}{}", self.nodes))
            .text(4, kind);
        for Attribute(attribute) in attributes {
            node.message(5, attribute);
        }
        self.nodes += 1;
        self.graph.message(1, &node);
    }

    /// An input of any batch size.
    pub(super) fn input(&mut self, name: &str, shape: &[usize]) {
        self.graph.message(11, &value_info(name, shape));
    }

    /// An output of any batch size.
    pub(super) fn output(&mut self, name: &str, shape: &[usize]) {
        self.graph.message(12, &value_info(name, shape));
    }

    /// An entry of the model's metadata.
    pub(super) fn metadata(&mut self, key: &str, value: &str) {
        let mut entry = Message::default();
        entry.text(1, key).text(2, value);
        self.metadata.message(14, &entry);
    }

    /// The whole file.
    pub(super) fn into_bytes(mut self) -> Vec<u8> {
        self.graph.text(2, "swath");
        let mut opset = Message::default();
        opset.text(1, "").number(2, OPSET);
        let mut model = Message::default();
        model
            .number(1, IR_VERSION)
            .text(2, "swath")
            .text(3, env!("CARGO_PKG_VERSION"))
            .message(7, &self.graph)
            .message(8, &opset);
        model.0.extend(self.metadata.0);
        model.0
    }
}

/// A tensor of single precision with a batch in front.
fn value_info(name: &str, shape: &[usize]) -> Message {
    let mut dimensions = Message::default();
    let mut batch = Message::default();
    batch.text(2, "batch");
    dimensions.message(1, &batch);
    for &side in shape {
        let mut dimension = Message::default();
        dimension.number(1, side as u64);
        dimensions.message(1, &dimension);
    }
    let mut tensor = Message::default();
    tensor.number(1, FLOAT).message(2, &dimensions);
    let mut kind = Message::default();
    kind.message(1, &tensor);
    let mut info = Message::default();
    info.text(1, name).message(2, &kind);
    info
}
