"""Compares decoded messages with the values that their writer noted down."""

import math

import numpy


def fields(message):
    """Names of a decoded message's fields, whichever library decoded it."""
    names = getattr(message, "__slots__", None) or vars(message)
    return {name for name in names if not name.startswith("_") and name.isidentifier()} - {
        name for name in dir(type(message)) if name.isupper()
    }


def differences(expected, found, where):
    """Every place at which a decoded value is not the expected one."""
    if isinstance(expected, dict):
        names = fields(found)
        if names != set(expected):
            return [f"{where}: fields {sorted(names)}, expected {sorted(expected)}"]
        return [
            difference
            for name, value in expected.items()
            for difference in differences(value, getattr(found, name), f"{where}.{name}")
        ]
    if isinstance(expected, list):
        if len(expected) != len(found):
            return [f"{where}: {len(found)} elements, expected {len(expected)}"]
        return [
            difference
            for index, value in enumerate(expected)
            for difference in differences(value, found[index], f"{where}[{index}]")
        ]
    return [] if same(expected, found) else [f"{where}: {found!r}, expected {expected!r}"]


def same(expected, found):
    """Whether two numbers, names or truth values are the same."""
    if expected is None:
        return math.isnan(found)
    if isinstance(expected, (str, bool)):
        return expected == found
    if isinstance(expected, int):
        # Signed bytes are noted down as unsigned ones.
        return found in (expected, expected - 256 if 127 < expected < 256 else expected)
    # Single precision is noted down with as many digits as tell it from its neighbours.
    return found in (expected, float(numpy.float32(expected)))
