"""Compares the logits of swath with those of ONNX Runtime on the exported network.

Usage: compare_onnx.py NETWORK.onnx FOLDER, where FOLDER holds what the example `logits` wrote.
"""

import pathlib
import sys

import numpy
import onnxruntime

MOST = 1e-4


def array(folder, name):
    shape = [int(side) for side in (folder / f"{name}.shape").read_text().split()]
    return numpy.fromfile(folder / name, dtype="<f4").reshape(shape)


def main(network, folder):
    session = onnxruntime.InferenceSession(network, providers=["CPUExecutionProvider"])
    inputs = {value.name: array(folder, value.name) for value in session.get_inputs()}
    (logits,) = session.run(["logits"], inputs)
    expected = array(folder, "logits")
    largest = float(numpy.abs(expected).max())
    off = float(numpy.abs(logits - expected).max())
    if logits.shape != expected.shape or not off <= MOST * largest:
        sys.exit(f"{network}: logits {logits.shape} are off by {off}, the largest being {largest}")
    print(f"{network}: {logits.shape} logits agree to {off / largest:.1e} of the largest")


main(sys.argv[1], pathlib.Path(sys.argv[2]))
