"""Opens a recording with `mcap` and with `rosbags` and compares every message in it.

Usage: check_recording.py RECORDING.mcap VALUES.json MSG_DIR
"""

import json
import pathlib
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from values import differences


def with_mcap(path):
    """(topic, type, log time, publish time, message), decoded by mcap-ros2-support."""
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        header = reader.get_header()
        assert header.profile == "ros2", header
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema.encoding == "ros2msg" and channel.message_encoding == "cdr"
            times = message.log_time, message.publish_time
            yield channel.topic, schema.name, *times, decoded


def with_rosbags(path):
    """The same, decoded by rosbags, which gives no publish time."""
    with AnyReader([pathlib.Path(path)]) as reader:
        for connection in reader.connections:
            carried = connection.ext.offered_qos_profiles
            assert bool(carried) == connection.topic.startswith("/swath/"), connection
        for connection, log_time, raw in reader.messages():
            decoded = reader.deserialize(raw, connection.msgtype)
            yield connection.topic, connection.msgtype, log_time, None, decoded


def problems(name, found, expected):
    """What a library made of the recording that its writer did not put in."""
    found = list(found)
    if len(found) != len(expected):
        yield f"{name}: {len(found)} messages, expected {len(expected)}"
    for wanted, (topic, kind, log_nanos, publish_nanos, message) in zip(expected, found):
        where = f"{name}: {topic}"
        head = topic, kind, log_nanos, publish_nanos
        times = wanted["log_nanos"], wanted["publish_nanos"] if publish_nanos else None
        if head != (wanted["topic"], wanted["type"], *times):
            yield f"{where}: {head}, expected {wanted['topic']} at {times}"
        yield from differences(wanted["message"], message, where)


def main(recording, values, definitions):
    expected = json.loads(pathlib.Path(values).read_text())
    defined = {path.stem for path in pathlib.Path(definitions).glob("*/*.msg")}
    written = {entry["type"].split("/")[-1] for entry in expected}
    found = [f"{name} is defined, but not in the recording" for name in sorted(defined - written)]
    found += problems("mcap", with_mcap(recording), expected)
    found += problems("rosbags", with_rosbags(recording), expected)
    for problem in found:
        print(problem, file=sys.stderr)
    if found:
        return 1
    print(f"mcap and rosbags decode all {len(expected)} messages of {len(written)} types")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
