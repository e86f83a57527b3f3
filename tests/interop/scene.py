"""Writes a made-up frame: a picture, goals and a reference for `swath plan`, and the same as a recording.

Usage: scene.py FOLDER SEED
"""

import math
import pathlib
import sys

import numpy
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

# The grid of the network that comes with swath: rows, columns, metres, and the vehicle's cell.
ROWS, COLS, RESOLUTION_M, EGO_ROW, EGO_COL = 401, 151, 0.2, 300, 75
VEHICLE = "car-1"


def cells_of(random):
    """A grid of boxes that keep away from the vehicle; 1 where there is one."""
    cells = numpy.zeros((ROWS, COLS), dtype=numpy.uint8)
    for _ in range(random.integers(5, 60)):
        row, col = random.integers(0, ROWS), random.integers(0, COLS)
        rows, cols = random.integers(1, 20), random.integers(1, 12)
        beside = row + rows < EGO_ROW - 30 or row > EGO_ROW + 15
        if beside or col + cols < EGO_COL - 15 or col > EGO_COL + 15:
            cells[row : row + rows, col : col + cols] = 1
    return cells


def goals_of(random):
    """Goals ahead, behind, off the grid, within the turning circle and straight ahead."""
    ahead = [(random.uniform(3, 58), random.uniform(-14, 14), random.uniform(-1, 1)) for _ in range(12)]
    behind = [(random.uniform(-19, 0), random.uniform(-14, 14), random.uniform(-3, 3)) for _ in range(4)]
    return [*ahead, *behind, (70.0, 3.0, 0.0), (1.0, 4.0, 2.0), (30.0, 0.0, 0.0)]


def reference_of(random):
    bend = random.uniform(-0.01, 0.01)
    return [(float(x), bend * x * x, math.atan(2 * bend * x)) for x in range(-5, 60)]


def write_texts(folder, cells, goals, reference):
    grey = numpy.where(cells == 1, 0, 254).astype(numpy.uint8)
    (folder / "map.pgm").write_bytes(f"P5\n{COLS} {ROWS}\n255\n".encode() + grey.tobytes())
    for name, poses in (("goals.txt", goals), ("reference.txt", reference)):
        lines = [f"{x} {y} {yaw}\n" for x, y, yaw in poses]
        (folder / name).write_text("".join(lines))


class Recording:
    """A recording of a vehicle's topics as ROS 2 writes them."""

    def __init__(self, file):
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self.writer = Writer(file, compression=CompressionType.NONE)
        self.writer.start(profile="ros2", library="swath's interop test")
        stamp = self.type("builtin_interfaces/msg/Time")(1000, 0)
        self.header = self.type("std_msgs/msg/Header")(stamp, "base_link")

    def type(self, name):
        return self.store.types[name]

    def pose(self, x, y, yaw):
        point = self.type("geometry_msgs/msg/Point")(x, y, 0.0)
        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return self.type("geometry_msgs/msg/Pose")(point, self.type("geometry_msgs/msg/Quaternion")(*turn))

    def write(self, kind, message):
        name = message.__msgtype__
        text, _ = self.store.generate_msgdef(name, ros_version=2)
        schema = self.writer.register_schema(name, "ros2msg", text.encode())
        topic = f"/swath/vehicle/{VEHICLE}/{kind}"
        channel = self.writer.register_channel(topic, "cdr", schema)
        data = bytes(self.store.serialize_cdr(message, name))
        self.writer.add_message(channel, log_time=10**12, data=data, publish_time=10**12)

    def finish(self):
        self.writer.finish()


def write_recording(path, cells, goals, reference):
    with open(path, "wb") as file:
        recording = Recording(file)
        stamped = recording.type("geometry_msgs/msg/PoseStamped")
        poses = [stamped(recording.header, recording.pose(*pose)) for pose in reference]
        recording.write("reference", recording.type("nav_msgs/msg/Path")(recording.header, poses))
        poses = [recording.pose(*goal) for goal in goals]
        targets = recording.type("geometry_msgs/msg/PoseArray")
        recording.write("targets", targets(recording.header, poses))
        behind_m = (EGO_ROW - ROWS + 0.5) * RESOLUTION_M
        right_m = (EGO_COL - COLS + 0.5) * RESOLUTION_M
        origin = recording.pose(behind_m, right_m, 0.0)
        meta = recording.type("nav_msgs/msg/MapMetaData")
        info = meta(recording.header.stamp, RESOLUTION_M, ROWS, COLS, origin)
        # The message's cells run along x first, and both axes grow.
        data = (cells[::-1, ::-1].T.astype(numpy.int8) * 100).ravel()
        grid = recording.type("nav_msgs/msg/OccupancyGrid")
        recording.write("grid", grid(recording.header, info, numpy.ascontiguousarray(data)))
        recording.finish()


def main(folder, seed):
    folder = pathlib.Path(folder)
    random = numpy.random.default_rng(int(seed))
    cells, goals, reference = cells_of(random), goals_of(random), reference_of(random)
    write_texts(folder, cells, goals, reference)
    write_recording(folder / "frame.mcap", cells, goals, reference)


main(*sys.argv[1:])
