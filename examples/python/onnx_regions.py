"""Predicts path regions with ONNX Runtime: from a grid, a reference and goals, without swath.

    pip install numpy onnxruntime
    swath export --onnx network.onnx
    python onnx_regions.py network.onnx --map map.pgm --goals goals.txt --reference reference.txt \\
        --out regions.npy

`regions.npy` holds the probability of each cell to lie in the region of the path to each goal:
goals x rows x cols, single precision, row 0 farthest ahead, column 0 farthest left.
`swath plan ... --method tiev-fcn --regions F.npy` writes the same array, and `--expect F.npy`
compares with it.

A grid of a recording is read with `--recording F.mcap --vehicle car-1` (and
`pip install mcap mcap-ros2-support`).
"""

import argparse
import math
import pathlib
import sys

import numpy
import onnxruntime

from network_inputs import DiscWays, NetworkInfo, Pose, cells_of, goal_features, planes, turning_radius_m

# Where ROS maps are occupied: the share of black above which a pixel is an obstacle.
OCCUPIED_THRESHOLD = 0.65
# The percentage from which a cell of an occupancy grid is an obstacle.
OBSTACLE_PERCENT = 50
# How far probabilities may be from expected ones.
TOLERANCE = 1e-4


def read_poses(path):
    """The poses of a file of `x y yaw` lines."""
    poses = []
    for number, line in enumerate(pathlib.Path(path).read_text().splitlines(), 1):
        content = line.split("#")[0].replace(",", " ").split()
        if not content:
            continue
        if len(content) != 3:
            sys.exit(f"{path}: line {number}: expected x y yaw")
        poses.append(Pose(*map(float, content)))
    return poses


def read_picture(path, info):
    """The obstacles of a binary PGM picture of the grid's size, the vehicle heading up."""
    path = pathlib.Path(path)
    if path.with_suffix(".yaml").exists():
        sys.exit(f"{path}: maps with a YAML file are not read here, only pictures of the grid")
    data = path.read_bytes()
    fields, at = [], 0
    while len(fields) < 4:
        end = at
        while not data[end : end + 1].isspace():
            end += 1
        if data[at:end].startswith(b"#"):
            end = data.index(b"\n", at)
        elif end > at:
            fields.append(data[at:end])
        at = end + 1
    kind, cols, rows, greatest = fields[0], *map(int, fields[1:])
    if kind != b"P5" or greatest != 255 or (rows, cols) != (info.rows, info.cols):
        wanted = f"P5 of {info.cols} x {info.rows} pixels up to 255"
        sys.exit(f"{path}: {kind.decode()} of {cols} x {rows} up to {greatest}, expected {wanted}")
    grey = numpy.frombuffer(data, numpy.uint8, rows * cols, at).reshape(rows, cols)
    return (255 - grey.astype(float)) / 255 > OCCUPIED_THRESHOLD


def heading_rad(orientation):
    """The heading of a quaternion that turns about z only."""
    return 2.0 * math.atan2(orientation.z, orientation.w)


def read_recording(path, vehicle, number, info):
    """Obstacles, reference and goals of one grid of a recording of a vehicle's topics."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    latest, grids = {}, 0
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            topic = channel.topic.strip("/")
            kind = topic.rpartition(f"vehicle/{vehicle}/")[2]
            if kind == topic or kind not in ("grid", "reference", "targets"):
                continue
            latest[kind] = message
            grids += kind == "grid"
            if grids > number and "targets" in latest:
                break
        else:
            sys.exit(f"{path}: {grids} grids of {vehicle}, expected more than {number}, and targets")
    grid = latest["grid"]
    for kind in ("reference", "targets"):
        frame = latest[kind].header.frame_id if kind in latest else grid.header.frame_id
        if frame != grid.header.frame_id:
            wanted = grid.header.frame_id
            sys.exit(f"{path}: the {kind} is in the frame {frame}, expected that of the grid, {wanted}")
    stamped = latest["reference"].poses if "reference" in latest else []
    poses = [[pose.pose for pose in stamped], latest["targets"].poses]
    reference, goals = (
        [Pose(p.position.x, p.position.y, heading_rad(p.orientation)) for p in part] for part in poses
    )
    return obstacles_of(grid, info, path), reference, goals


def obstacles_of(grid, info, path):
    """The obstacles of a nav_msgs/OccupancyGrid, whose cells run along x first, both axes growing."""
    spec, origin = grid.info, grid.info.origin.position
    resolution_m = float(str(numpy.float32(spec.resolution)))
    behind, right = (round(-place / resolution_m - 0.5) for place in (origin.x, origin.y))
    found = (spec.width, spec.height, resolution_m, spec.width - 1 - behind, spec.height - 1 - right)
    wanted = (info.rows, info.cols, info.resolution_m, info.ego_row, info.ego_col)
    if found != wanted:
        sys.exit(f"{path}: a grid of {found}, expected {wanted}: rows, cols, metres, vehicle's cell")
    cells = numpy.array(grid.data, numpy.int8).reshape(spec.height, spec.width)
    return cells[::-1, ::-1].T >= OBSTACLE_PERCENT


def network_inputs(info, obstacles, reference, goals, speed_m_per_s):
    """The inputs by name, a goal a row of the batch."""
    batch = [planes(info, obstacles, reference, goal) for goal in goals]
    inputs = {"planes": numpy.stack(batch)}
    if info.architecture == "enet-shared":
        radius_m = turning_radius_m(info, speed_m_per_s)
        ways = DiscWays(info, obstacles, radius_m)
        features = [goal_features(info, ways, goal, radius_m) for goal in goals]
        inputs["features"] = numpy.stack(features)
    return inputs


def print_goals(goals, regions, scores, info):
    """A line a goal: the region's area, and what the network says of the goal."""
    for number, (goal, region) in enumerate(zip(goals, regions)):
        area = numpy.count_nonzero(region > 0.5) * info.resolution_m**2
        line = f"{number:>3}  {goal.x_m:7.2f} {goal.y_m:7.2f} {goal.yaw_rad:6.2f}  {area:6.1f} m2"
        if scores is not None:
            solvable, cost, steps = scores[number].astype(float)
            line += f"  path with {1 / (1 + math.exp(-solvable)):.3f}"
            line += f", cost {math.exp(3.3 + 0.6 * min(max(cost, -6), 6)):.1f}"
            line += f", steps {math.exp(9 + 2 * min(max(steps, -6), 6)):.0f}"
        print(line)


def compare(regions, path):
    """Ends with an error unless the regions are those of a file."""
    expected = numpy.load(path)
    if expected.shape != regions.shape:
        sys.exit(f"{path}: {expected.shape}, expected {regions.shape}")
    off = float(numpy.abs(regions - expected).max())
    if not off <= TOLERANCE:
        goal = int(numpy.abs(regions - expected).max(axis=(1, 2)).argmax())
        sys.exit(f"{path}: the region of goal {goal} is off by {off:.1e}, expected {TOLERANCE:.0e}")
    print(f"{path}: {len(regions)} regions agree, off by at most {off:.1e}")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("network", help="what `swath export --onnx` wrote")
    parser.add_argument("--map", help="PGM picture of the grid's size, the vehicle heading up")
    parser.add_argument("--goals", help="file of x y yaw lines, metres and radians")
    parser.add_argument("--reference", help="file of x y yaw lines")
    parser.add_argument("--recording", help="MCAP file of a vehicle's topics, in place of these")
    parser.add_argument("--vehicle", default="v0", help="the vehicle in the recording")
    parser.add_argument("--frame", type=int, default=0, help="which of its grids, from 0")
    parser.add_argument("--speed", type=float, default=1.4, help="m/s")
    parser.add_argument("--out", help="write the probabilities, goals x rows x cols")
    parser.add_argument("--expect", help="compare with the probabilities of a file")
    options = parser.parse_args()
    if not options.recording and not (options.map and options.goals):
        parser.error("either --map and --goals or --recording is needed")
    return options


def main():
    options = arguments()
    session = onnxruntime.InferenceSession(options.network, providers=["CPUExecutionProvider"])
    info = NetworkInfo.from_metadata(session.get_modelmeta().custom_metadata_map)
    if options.recording:
        frame = read_recording(options.recording, options.vehicle, options.frame, info)
        obstacles, reference, goals = frame
    else:
        obstacles, goals = read_picture(options.map, info), read_poses(options.goals)
        reference = read_poses(options.reference) if options.reference else []
    if not goals:
        sys.exit("there are no goals")
    inputs = network_inputs(info, obstacles, reference, goals, options.speed)
    names = [output.name for output in session.get_outputs()]
    outputs = dict(zip(names, session.run(names, inputs)))
    logits = numpy.stack([cells_of(info, logits[0]) for logits in outputs["logits"]])
    # The logistic function, without overflow.
    regions = (0.5 + 0.5 * numpy.tanh(0.5 * logits)).astype(numpy.float32)
    print_goals(goals, regions, outputs.get("scores"), info)
    if options.out:
        numpy.save(options.out, regions)
    if options.expect:
        compare(regions, options.expect)


if __name__ == "__main__":
    main()
