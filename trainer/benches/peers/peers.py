"""Times a network in ONNX Runtime and in PyTorch.

Reads one request a line on standard input, a JSON object, and answers each with one line. The PyTorch
model is made from the operators and weights of the ONNX file, so that all run the same network.
"""

import json
import sys
import time

import numpy
import onnx
import onnxruntime
import torch
import torch.nn.functional as F
from onnx import numpy_helper


class Torch:
    """An ONNX graph on PyTorch's operators, channels last."""

    def __init__(self, path):
        graph = onnx.load(path).graph
        self.nodes = graph.node
        self.values = {}
        for tensor in graph.initializer:
            value = torch.from_numpy(numpy_helper.to_array(tensor).copy())
            if value.dim() == 4:
                value = value.to(memory_format=torch.channels_last)
            self.values[tensor.name] = value
        self.trained = [
            value
            for name, value in self.values.items()
            if name.endswith((".weight", ".bias"))
        ]

    def __call__(self, planes, training):
        values = dict(self.values)
        values["planes"] = planes.to(memory_format=torch.channels_last)
        for node in self.nodes:
            settings = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
            inputs = [values[name] if name else None for name in node.input]
            values[node.output[0]] = run(node.op_type, inputs, settings, training)
        return values["logits"]


def run(kind, inputs, settings, training):
    x = inputs[0]
    if kind == "Conv":
        return F.conv2d(x, inputs[1], None, settings["strides"], settings["pads"][:2], settings["dilations"])
    if kind == "ConvTranspose":
        bias = inputs[2] if len(inputs) > 2 else None
        pads = settings.get("pads", [0, 0])[:2]
        more = settings.get("output_padding", [0, 0])
        return F.conv_transpose2d(x, inputs[1], bias, settings["strides"], pads, more)
    if kind == "BatchNormalization":
        scale, shift, mean, variance = inputs[1:]
        return F.batch_norm(x, mean, variance, scale, shift, training, 0.1, settings["epsilon"])
    if kind == "PRelu":
        return F.prelu(x, inputs[1].flatten())
    if kind == "Relu":
        return F.relu(x)
    if kind == "Add":
        return x + inputs[1]
    if kind == "AveragePool":
        return F.avg_pool2d(x, 2)
    if kind == "MaxPool":
        return F.max_pool2d(x, 2)
    if kind == "Concat":
        return torch.cat(inputs, 1)
    if kind == "Pad":
        return F.pad(x, (0, 0, 0, 0, 0, int(inputs[1][5])))
    if kind == "Resize":
        return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
    raise ValueError(f"operator {kind} is not known here")


class Peers:
    def __init__(self):
        self.sessions = {}
        self.models = {}

    def session(self, path, threads):
        if (path, threads) not in self.sessions:
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = threads
            self.sessions[path, threads] = onnxruntime.InferenceSession(
                path, options, providers=["CPUExecutionProvider"]
            )
        return self.sessions[path, threads]

    def model(self, path):
        if path not in self.models:
            self.models[path] = Torch(path)
        return self.models[path]

    def answer(self, request):
        planes = numpy.random.default_rng(1).random(request["shape"], dtype="f4")
        path, threads = request["path"], request["threads"]
        if request["runtime"] == "onnxruntime":
            session = self.session(path, threads)
            return seconds(lambda: session.run(["logits"], {"planes": planes}))
        model = self.model(path)
        torch.set_num_threads(threads)
        tensor = torch.from_numpy(planes)
        if not request["training"]:
            with torch.inference_mode():
                return seconds(lambda: model(tensor, False))
        for value in model.trained:
            value.requires_grad_(True)
            value.grad = None
        elapsed = seconds(lambda: model(tensor, True).sum().backward())
        for value in model.trained:
            value.requires_grad_(False)
        return elapsed


def seconds(work):
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


peers = Peers()
for line in sys.stdin:
    print(json.dumps(peers.answer(json.loads(line))), flush=True)
