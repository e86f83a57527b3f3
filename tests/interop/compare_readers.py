"""Reads any recording with programs that others wrote: mcap with mcap-ros2-support, and rosbags.

Every message must decode in both, and to the same values. Exits with 1 and says why if not.

Usage: compare_readers.py RECORDING.mcap [EXPECTED_TOPICS]
"""

import dataclasses
import math
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


def plain(value):
    """A message as nested tuples, whichever library it is of."""
    if dataclasses.is_dataclass(value):
        # rosbags also counts constants, which have capital letters, among the fields.
        names = [field.name for field in dataclasses.fields(value)]
        names = [name for name in names if name.islower() and name != "__msgtype__"]
        return tuple(plain(getattr(value, name)) for name in names)
    if hasattr(value, "__slots__") and not isinstance(value, (str, bytes)):
        return tuple(plain(getattr(value, name)) for name in value.__slots__)
    if isinstance(value, (bytes, bytearray)):
        return tuple(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return tuple(plain(part) for part in value)
    if isinstance(value, float):
        return "NaN" if math.isnan(value) else value
    return value


def with_mcap(path):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        header = reader.get_header()
        assert header.profile == "ros2", header
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema.encoding == "ros2msg", schema
            assert channel.message_encoding == "cdr", channel
            yield channel.topic, schema.name, message.log_time, plain(decoded)


def with_rosbags(path):
    with AnyReader([Path(path)]) as reader:
        for connection in reader.connections:
            for qos in connection.ext.offered_qos_profiles:
                assert qos.depth > 0, qos
        for connection, log_time, raw in reader.messages():
            decoded = reader.deserialize(raw, connection.msgtype)
            yield connection.topic, connection.msgtype, log_time, plain(decoded)


def main():
    path = sys.argv[1]
    ours = sorted(with_mcap(path), key=lambda message: message[:3])
    theirs = sorted(with_rosbags(path), key=lambda message: message[:3])
    topics = {topic for topic, *_ in ours}
    assert len(ours) == len(theirs), f"{len(ours)} messages in mcap, {len(theirs)} in rosbags"
    for one, other in zip(ours, theirs):
        assert one == other, f"mcap and rosbags differ:\n{one}\n{other}"
    if len(sys.argv) > 2:
        assert len(topics) == int(sys.argv[2]), topics
    print(f"{path}: {len(ours)} messages on {len(topics)} topics decode in mcap and rosbags")


if __name__ == "__main__":
    main()
