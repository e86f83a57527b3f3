"""Drives a running planner node as a zenoh peer that is not swath.

Publishes a reference, targets and a grid, receives the plan, the chosen path and the viewing grids,
and checks that they answer just what was sent.

Usage: plan_with_planner.py ENDPOINT MSG_DIR [VEHICLE]
"""

import json
import math
import pathlib
import queue
import sys
import time

import numpy
import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# The longest that the planner may take to appear, and to answer.
PATIENCE_S = 60.0
SOLVED, GOAL_OCCUPIED, OUT_OF_BOUNDS = 0, 4, 5
# The size of a grid in cells along x and y, of a cell, and how far the grid reaches behind and to
# the right of the vehicle.
LENGTH_CELLS, WIDTH_CELLS, RESOLUTION_M = 401, 151, 0.2
BEHIND_M, RIGHT_M = 20.1, 15.1
# A wall across the way to the first target that leaves a gap on the left, and a block on the second.
WALL = {"x": (18.0, 20.0), "y": (-15.0, 4.0)}
BLOCK = {"x": (38.0, 42.0), "y": (-10.0, -6.0)}
# The vehicle's turning circle has a radius of 5.5 m.
TIGHTEST_PER_M = 1 / 5.5 + 1e-4
GOALS = [(35.0, 0.0, 0.0), (40.0, -8.0, 0.0), (80.0, 0.0, 0.0)]
EXPECTED = [SOLVED, GOAL_OCCUPIED, OUT_OF_BOUNDS]


def typestore(definitions):
    """ROS 2's types and swath's, the latter from their definitions."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {}
    for path in sorted(pathlib.Path(definitions).glob("swath_msgs/*.msg")):
        types |= get_types_from_msg(path.read_text(), f"swath_msgs/msg/{path.stem}")
    store.register(types)
    return store


class Messages:
    """Makes messages of a typestore."""

    def __init__(self, store, stamp_nanos):
        self.types = store.types
        seconds, nanos = divmod(stamp_nanos, 1_000_000_000)
        stamp = self.types["builtin_interfaces/msg/Time"](seconds, nanos)
        self.stamp = stamp
        self.header = self.types["std_msgs/msg/Header"](stamp, "base_link")

    def pose(self, x, y, yaw):
        point = self.types["geometry_msgs/msg/Point"](x, y, 0.0)
        half = yaw / 2
        quaternion = self.types["geometry_msgs/msg/Quaternion"]
        turn = quaternion(0.0, 0.0, math.sin(half), math.cos(half))
        return self.types["geometry_msgs/msg/Pose"](point, turn)

    def targets(self):
        poses = [self.pose(*goal) for goal in GOALS]
        return self.types["geometry_msgs/msg/PoseArray"](self.header, poses)

    def reference(self):
        stamped = self.types["geometry_msgs/msg/PoseStamped"]
        poses = [stamped(self.header, self.pose(float(x), 0.0, 0.0)) for x in range(0, 50)]
        return self.types["nav_msgs/msg/Path"](self.header, poses)

    def grid(self):
        cells = numpy.zeros((WIDTH_CELLS, LENGTH_CELLS), dtype=numpy.int8)
        for rectangle in (WALL, BLOCK):
            x = [round((value + BEHIND_M) / RESOLUTION_M) for value in rectangle["x"]]
            y = [round((value + RIGHT_M) / RESOLUTION_M) for value in rectangle["y"]]
            cells[y[0] : y[1], x[0] : x[1]] = 100
        origin = self.pose(-BEHIND_M, -RIGHT_M, 0.0)
        info = self.types["nav_msgs/msg/MapMetaData"](
            self.stamp, RESOLUTION_M, LENGTH_CELLS, WIDTH_CELLS, origin
        )
        return self.types["nav_msgs/msg/OccupancyGrid"](self.header, info, cells.ravel())


class Peer:
    """A zenoh session that speaks the typestore's CDR."""

    def __init__(self, endpoint, store):
        config = zenoh.Config()
        for key, value in {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "listen/endpoints": [],
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(PATIENCE_S * 1000),
            "connect/exit_on_failure": True,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.store = store

    def subscribe(self, key, kind):
        """A queue of messages of a type."""
        received = queue.Queue(maxsize=100)

        def take(sample):
            received.put_nowait(self.store.deserialize_cdr(sample.payload.to_bytes(), kind))

        self.session.declare_subscriber(key, take)
        return received

    def publisher(self, key):
        """A publisher that has a subscriber: what is put from now on is heard."""
        publisher = self.session.declare_publisher(key, encoding=zenoh.Encoding.APPLICATION_CDR)
        matched = queue.Queue()
        publisher.declare_matching_listener(lambda status: matched.put(status.matching))
        deadline = time.monotonic() + PATIENCE_S
        while not publisher.matching_status.matching:
            matched.get(timeout=max(0.0, deadline - time.monotonic()))
        return publisher

    def put(self, publisher, message):
        publisher.put(bytes(self.store.serialize_cdr(message, message.__msgtype__)))


def check_plan(plan, messages):
    """The plan answers the grid and the targets that were sent, in their order."""
    assert plan.header.stamp == messages.stamp, plan.header
    assert [target.status for target in plan.targets] == EXPECTED, plan.targets
    assert plan.method == "swath" and plan.chosen == 0, (plan.method, plan.chosen)
    assert plan.consulted == "without" and plan.weights_version == 0, plan.consulted
    assert math.isnan(plan.weights_age_s), plan.weights_age_s
    assert plan.search_ms > 0.0 and plan.deadline_ms == 100.0, plan
    solved = plan.targets[0]
    assert (plan.reason, plan.detail, len(plan.rejected)) == ("", "", 0), plan
    assert solved.steps > 0 and solved.cost >= solved.length_m > 35.0, solved
    assert solved.drivability == solved.AT_SPEED and 1.0 <= solved.bound <= 1.2001, solved
    assert len(solved.curvature_per_m) == len(solved.path)
    assert max(abs(curvature) for curvature in solved.curvature_per_m) <= TIGHTEST_PER_M
    check_path([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in solved.path])
    for target in plan.targets[1:]:
        assert len(target.path) == 0 and math.isnan(target.cost), target


def check_path(path):
    """A path begins at the vehicle, ends at its goal, and keeps out of the wall."""
    x, y, yaw = path[0]
    assert math.hypot(x, y) < 0.15 and abs(yaw) < 0.1, path[0]
    x, y, yaw = path[-1]
    assert math.dist((x, y), GOALS[0][:2]) <= 0.5 + 1e-3 and abs(yaw) <= math.radians(15.1)
    for (x, y, _), (next_x, next_y, _) in zip(path, path[1:]):
        assert math.dist((x, y), (next_x, next_y)) <= 0.2 + 1e-3, (x, y)
        inside = WALL["x"][0] <= x <= WALL["x"][1] and WALL["y"][0] <= y <= WALL["y"][1]
        assert not inside, (x, y)
    assert max(y for _, y, _ in path) > WALL["y"][1], "the way leads around the wall"


def answer(received, messages):
    """The first message about the grid that was sent; before, a planner says that it has none."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        message = received.get(timeout=max(0.0, deadline - time.monotonic()))
        if message.header.stamp == messages.stamp:
            return message


def exchange(peer, messages, base):
    """Sends what a plan is made of and checks what comes back; the steps of the search."""
    plans = peer.subscribe(f"{base}/plan", "swath_msgs/msg/PlanReport")
    paths = peer.subscribe(f"{base}/path", "nav_msgs/msg/Path")
    publishers = [peer.publisher(f"{base}/{kind}") for kind in ("reference", "targets", "grid")]
    for publisher, message in zip(
        publishers, (messages.reference(), messages.targets(), messages.grid())
    ):
        peer.put(publisher, message)
    plan = answer(plans, messages)
    check_plan(plan, messages)
    chosen = answer(paths, messages)
    assert chosen.header.frame_id == "base_link", chosen.header
    assert len(chosen.poses) == len(plan.targets[0].path), "the one path there is is chosen"
    return plan.targets[0].steps


def main(endpoint, definitions, vehicle="v0"):
    store = typestore(definitions)
    messages = Messages(store, time.time_ns())
    peer = Peer(endpoint, store)
    try:
        steps = exchange(peer, messages, f"swath/vehicle/{vehicle}")
    finally:
        # Its threads would keep a failed test alive.
        peer.session.close()
    print(f"a zenoh peer that is not swath was planned for: {steps} steps")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
