"""The inputs of a network that `swath export --onnx` wrote, and the regions from its outputs.

Only numpy is needed. docs/network.md explains every value that is computed here.

Frames: x points ahead of the vehicle, y to its left, angles are counter-clockwise, metres and radians.
A grid has row 0 farthest ahead and column 0 farthest left.
"""

import math
from dataclasses import dataclass

import numpy

# Sides of the network's input are multiples of this, and features have an eighth of its resolution.
SIDE_MULTIPLE = 8
GOAL_FEATURES = 27

# Scales of the features, metres.
LENGTH_M = 40.0
WIDTH_M = 15.0
COURSE_REACH_M = 10.0
# Standard deviations of the bells, metres.
GOAL_BELLS_M = (2.0, 8.0)
VEHICLE_BELL_M = 4.0
COURSE_BELL_M = 1.5
# A bell is 0 from this exponent on.
MAX_EXPONENT = 28.0
# Distance of two stations of a course, metres, and the largest number of them.
STATION_STEP_M = 1.0
MAX_STATIONS = 200

# Side of the coarse cells of a disc's ways, metres.
COARSE_SIDE_M = 0.4
# Blocked coarse cells around the grid.
BORDER = 2
# Costs of a straight, a diagonal and a knight's move, in fifths of a coarse cell's side.
STRAIGHT, DIAGONAL, KNIGHT = 5, 7, 11
UNREACHED = 65535
# What lies behind the vehicle is blocked as far as this, metres.
WALL_M = 1.2

# How the speed limits the curvature where the metadata do not say: the paper's car. Largest lateral
# acceleration, m/s2, and rows of km/h:1/m.
LATERAL_ACCELERATION_M_PER_S2 = "2"
CURVATURE_BY_SPEED = (
    "5:0.2,10:0.13437,20:0.03939,30:0.01922,40:0.01155,50:0.00778,60:0.0056,70:0.00429"
)


@dataclass(frozen=True)
class Pose:
    """A place and a heading in the vehicle's frame."""

    x_m: float
    y_m: float
    yaw_rad: float

    def then(self, other):
        """A pose that is given relative to this one."""
        sin, cos = math.sin(self.yaw_rad), math.cos(self.yaw_rad)
        return Pose(
            self.x_m + cos * other.x_m - sin * other.y_m,
            self.y_m + sin * other.x_m + cos * other.y_m,
            wrapped(self.yaw_rad + other.yaw_rad),
        )


VEHICLE = Pose(0.0, 0.0, 0.0)


def wrapped(angle_rad):
    """The same angle above -pi and at most pi."""
    if -math.pi < angle_rad <= math.pi:
        return angle_rad
    turned = angle_rad - math.tau * math.floor((angle_rad + math.pi) / math.tau)
    return math.pi if turned <= -math.pi else turned


@dataclass(frozen=True)
class NetworkInfo:
    """What the network was trained for: the metadata of the ONNX file."""

    architecture: str
    half_size: bool
    rows: int
    cols: int
    ego_row: int
    ego_col: int
    resolution_m: float
    min_turning_radius_m: float
    max_lateral_acceleration_m_per_s2: float
    # Rows of km/h and 1/m.
    curvature_by_speed: tuple
    half_width_m: float
    reference_dilation_m: float
    target_dilation_m: float

    @staticmethod
    def from_metadata(metadata):
        acceleration = metadata.get("max_lateral_acceleration_m_per_s2", LATERAL_ACCELERATION_M_PER_S2)
        rows = metadata.get("curvature_by_speed", CURVATURE_BY_SPEED).split(",")
        return NetworkInfo(
            architecture=metadata["architecture"],
            half_size=metadata["size"] == "half",
            rows=int(metadata["rows"]),
            cols=int(metadata["cols"]),
            ego_row=int(metadata["ego_row"]),
            ego_col=int(metadata["ego_col"]),
            resolution_m=float(metadata["resolution_m"]),
            min_turning_radius_m=float(metadata["min_turning_radius_m"]),
            max_lateral_acceleration_m_per_s2=float(acceleration),
            curvature_by_speed=tuple(tuple(map(float, row.split(":"))) for row in rows if row),
            half_width_m=float(metadata["half_width_m"]),
            reference_dilation_m=float(metadata["reference_dilation_m"]),
            target_dilation_m=float(metadata["target_dilation_m"]),
        )

    @property
    def shrink(self):
        """Cells along the side of a pixel."""
        return 2 if self.half_size else 1

    @property
    def input_size(self):
        """Rows and columns of the input: padded below and on the right to multiples of 8."""
        pixels = (-(-self.rows // self.shrink), -(-self.cols // self.shrink))
        return tuple(-(-side // SIDE_MULTIPLE) * SIDE_MULTIPLE for side in pixels)

    def centres(self):
        """x of each row's centres and y of each column's, metres."""
        x_m = (self.ego_row - numpy.arange(self.rows)) * self.resolution_m
        y_m = (self.ego_col - numpy.arange(self.cols)) * self.resolution_m
        return x_m, y_m

    def first_block_centre(self, cells):
        """The centre of the first block of so many cells a side, metres."""
        inset_m = 0.5 * (cells * self.resolution_m - self.resolution_m)
        return self.ego_row * self.resolution_m - inset_m, self.ego_col * self.resolution_m - inset_m


def turning_radius_m(info, speed_m_per_s):
    """The smallest turning radius at a speed: the vehicle's, or one that the speed allows."""
    radius_m = info.min_turning_radius_m
    radius_m = max(radius_m, speed_m_per_s**2 / info.max_lateral_acceleration_m_per_s2)
    if info.curvature_by_speed:
        speeds, curvatures = zip(*info.curvature_by_speed)
        # Interpolated; outside the table it is that of the nearest row.
        radius_m = max(radius_m, 1.0 / numpy.interp(abs(speed_m_per_s) * 3.6, speeds, curvatures))
    return radius_m


# Planes


def near_line(info, poses, radius_m):
    """Whether each cell's centre lies within a distance of the line through some poses."""
    x_m, y_m = info.centres()
    cells = numpy.zeros((info.rows, info.cols), dtype=bool)
    pairs = list(zip(poses, poses[1:])) if len(poses) > 1 else [(pose, pose) for pose in poses]
    for start, end in pairs:
        along_x, along_y = end.x_m - start.x_m, end.y_m - start.y_m
        dx, dy = x_m[:, None] - start.x_m, y_m[None, :] - start.y_m
        squared = along_x * along_x + along_y * along_y
        share = numpy.zeros_like(dx + dy)
        if squared > 0.0:
            share = numpy.clip((dx * along_x + dy * along_y) / squared, 0.0, 1.0)
        off_x, off_y = dx - share * along_x, dy - share * along_y
        cells |= off_x * off_x + off_y * off_y <= radius_m * radius_m
    return cells


def planes(info, obstacles, reference, goal):
    """The input `planes` of one goal: 3 x rows x cols of obstacles, reference and disc.

    The disc lies around the goal for `enet` and around the vehicle for `enet-shared`.
    """
    middle = goal if info.architecture == "enet" else VEHICLE
    line = near_line(info, reference, info.reference_dilation_m)
    disc = near_line(info, [middle], info.target_dilation_m)
    rows, cols = info.input_size
    shrink = info.shrink
    padded = numpy.zeros((3, rows * shrink, cols * shrink), dtype=numpy.float32)
    padded[:, : info.rows, : info.cols] = numpy.stack([obstacles, line, disc])
    # A pixel is 1 if any of its cells is.
    return padded.reshape(3, rows, shrink, cols, shrink).max(axis=(2, 4))


def cells_of(info, logits):
    """The logit of each cell of the grid from `logits` (rows x cols of the input).

    At half size they are doubled bilinearly: 3/4 of the nearer pixel and 1/4 of the other one,
    along each axis, edges repeated.
    """
    if info.half_size:
        for axis in (0, 1):
            before = numpy.concatenate([logits.take([0], axis), logits], axis).take(
                range(logits.shape[axis]), axis
            )
            behind = numpy.concatenate([logits, logits.take([-1], axis)], axis).take(
                range(1, logits.shape[axis] + 1), axis
            )
            pairs = [0.75 * logits + 0.25 * before, 0.75 * logits + 0.25 * behind]
            shape = list(logits.shape)
            shape[axis] *= 2
            logits = numpy.stack(pairs, axis + 1).reshape(shape)
    return logits[: info.rows, : info.cols]


# Dubins' shortest path in the open


def positive_turn(angle_rad):
    """The same angle from 0 to a full turn; what is short of a full turn by rounding only is 0."""
    turned = wrapped(angle_rad)
    return turned + math.tau if turned < -1e-9 else max(turned, 0.0)


def dubins_word(turns, goal):
    """The lengths of the three parts of a word from the origin, in turning radii, if it leads there.

    `turns`: 1 to the left, 0 straight, -1 to the right.
    """
    first, middle, last = turns
    # From the centre of the first circle to that of the last one.
    dx = goal.x_m - last * math.sin(goal.yaw_rad)
    dy = goal.y_m + last * math.cos(goal.yaw_rad) - first
    distance, direction = math.hypot(dx, dy), math.atan2(dy, dx)
    if middle == 0 and first == last:
        heading, length = direction, distance
    elif middle == 0:
        squared = distance * distance - 4.0
        if squared < 0.0:
            return None
        length = math.sqrt(squared)
        heading = direction + first * math.atan2(2.0, length)
    else:
        if distance > 4.0:
            return None
        half = math.acos(distance / 4.0)
        heading = direction + first * (math.pi / 2 + half)
        length = math.pi + 2.0 * half
    after = heading + middle * length
    return (
        positive_turn(first * heading),
        length,
        positive_turn(last * (goal.yaw_rad - after)),
    )


def along_part(turn, length, radius_m):
    """The pose after `length` turning radii of a part from the origin."""
    if turn == 0:
        return Pose(length * radius_m, 0.0, 0.0)
    x_m = radius_m * math.sin(length)
    y_m = turn * radius_m * (1.0 - math.cos(length))
    return Pose(x_m, y_m, wrapped(turn * length))


def dubins_path(goal, radius_m):
    """Poses at most a metre apart on the shortest path to the goal in the open."""
    scaled = Pose(goal.x_m / radius_m, goal.y_m / radius_m, wrapped(goal.yaw_rad))
    words = ((1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (-1, 1, -1), (1, -1, 1))
    known = [(turns, dubins_word(turns, scaled)) for turns in words]
    # Of several the first: `min` keeps the order.
    turns, lengths = min((word for word in known if word[1]), key=lambda word: sum(word[1]))
    poses, begin = [VEHICLE], VEHICLE
    for turn, length in zip(turns, lengths):
        steps = max(math.ceil(length * radius_m / STATION_STEP_M), 1)
        for step in range(1, steps + 1):
            poses.append(begin.then(along_part(turn, length * step / steps, radius_m)))
        begin = begin.then(along_part(turn, length, radius_m))
    return poses


# Ways of a disc around the obstacles


def moves():
    """Row, column and cost of each move, by rows and then columns."""
    costs = {(0, 1): STRAIGHT, (1, 1): DIAGONAL, (1, 2): KNIGHT}
    steps = [(row, col) for row in range(-2, 3) for col in range(-2, 3)]
    sizes = [(step, tuple(sorted((abs(step[0]), abs(step[1]))))) for step in steps]
    return [(*step, costs[size]) for step, size in sizes if size in costs]


MOVES = moves()


class DiscWays:
    """Shortest ways of a disc as wide as the vehicle, from the vehicle to every coarse cell."""

    def __init__(self, info, obstacles, radius_m):
        self.shrink = max(int(COARSE_SIDE_M * (1.0 + 1e-9) / info.resolution_m), 1)
        self.side_m = self.shrink * info.resolution_m
        self.first_x_m, self.first_y_m = info.first_block_centre(self.shrink)
        self.rows = -(-info.rows // self.shrink) + 2 * BORDER
        self.cols = -(-info.cols // self.shrink) + 2 * BORDER
        self.blocked = self.blocked_cells(obstacles, info.half_width_m, radius_m)
        self.cost = [UNREACHED] * (self.rows * self.cols)
        self.via = [0] * len(self.cost)
        start = self.index_at(0.0, 0.0)
        if start is not None:
            self.search(start)

    def blocked_cells(self, obstacles, half_width_m, radius_m):
        """Where the disc's centre cannot be, for each coarse cell."""
        blocked = numpy.zeros((self.rows, self.cols), dtype=bool)
        row, col = numpy.nonzero(obstacles)
        blocked[row // self.shrink + BORDER, col // self.shrink + BORDER] = True
        # Cells within the disc's radius less half a cell; at most four of them to a side.
        reach = max(half_width_m - 0.5 * self.side_m, 0.0) / self.side_m + 1e-9
        most = min(int(reach), 2 * BORDER)
        grown = numpy.zeros((self.rows + 2 * most, self.cols + 2 * most), dtype=bool)
        for rows in range(-most, most + 1):
            for cols in range(-most, most + 1):
                if math.hypot(rows, cols) <= reach:
                    top, left = most + rows, most + cols
                    grown[top : top + self.rows, left : left + self.cols] |= blocked
        blocked = grown[most : most + self.rows, most : most + self.cols]
        inside = numpy.zeros_like(blocked)
        inside[BORDER:-BORDER, BORDER:-BORDER] = True
        blocked |= ~inside
        # The two circles that the vehicle cannot turn into, and a wall behind it.
        x_m = self.first_x_m - (numpy.arange(self.rows) - float(BORDER))[:, None] * self.side_m
        y_m = self.first_y_m - (numpy.arange(self.cols) - float(BORDER))[None, :] * self.side_m
        near = (abs(x_m) < radius_m) & (abs(y_m) < 2.0 * radius_m)
        in_circle = numpy.hypot(x_m, abs(y_m) - radius_m) < radius_m - self.side_m
        behind = (x_m < -0.5 * self.side_m) & (x_m > -WALL_M) & (abs(y_m) <= radius_m)
        blocked |= near & (in_circle | behind)
        return blocked.ravel().tolist()

    def index_at(self, x_m, y_m):
        """The coarse cell of a place on the grid, if it is one."""
        row = rounded((self.first_x_m - x_m) / self.side_m) + BORDER
        col = rounded((self.first_y_m - y_m) / self.side_m) + BORDER
        on_grid = BORDER <= row < self.rows - BORDER and BORDER <= col < self.cols - BORDER
        return row * self.cols + col if on_grid else None

    def centre_of(self, index):
        row, col = divmod(index, self.cols)
        x_m = self.first_x_m - (row - float(BORDER)) * self.side_m
        return x_m, self.first_y_m - (col - float(BORDER)) * self.side_m

    def search(self, start):
        """Dijkstra's search; cells of one cost are taken in the order in which they were reached."""
        steps = []
        for rows, cols, cost in MOVES:
            between = ()
            if cost == KNIGHT:
                # The two cells that the move passes between.
                near = (int(rows / 2), int(cols / 2))
                far = (rows - near[0], cols - near[1])
                between = (near[0] * self.cols + near[1], far[0] * self.cols + far[1])
            steps.append((rows * self.cols + cols, cost, between))
        self.blocked[start] = False
        self.cost[start] = 0
        waiting = {0: [start]}
        now = 0
        while waiting:
            for index in waiting.pop(now, ()):
                if self.cost[index] != now:
                    continue
                for via, (offset, cost, between) in enumerate(steps):
                    after, total = index + offset, now + cost
                    if self.blocked[after] or total >= self.cost[after]:
                        continue
                    if any(self.blocked[index + cell] for cell in between):
                        continue
                    self.cost[after], self.via[after] = total, via
                    waiting.setdefault(total, []).append(after)
            now += 1

    def to(self, goal):
        """The corners of the way to a goal, pulled taut; none if a disc does not get there."""
        end = self.reached_near(goal)
        if end is None:
            return None
        chain = [end]
        while self.cost[chain[-1]] > 0:
            rows, cols, _ = MOVES[self.via[chain[-1]]]
            chain.append(chain[-1] - rows * self.cols - cols)
        chain.reverse()
        corners, anchor = [(0.0, 0.0)], 0
        for number in range(1, len(chain)):
            if number > anchor + 1 and not self.is_clear(chain[anchor], chain[number]):
                anchor = number - 1
                corners.append(self.centre_of(chain[anchor]))
        return [*corners, (goal.x_m, goal.y_m)]

    def reached_near(self, goal):
        """The goal's cell, or the cheapest one within two cells if the disc does not get there."""
        at = self.index_at(goal.x_m, goal.y_m)
        if at is None or self.cost[at] != UNREACHED:
            return at
        around = [at + r * self.cols + c for r in range(-2, 3) for c in range(-2, 3)]
        reached = [index for index in around if self.cost[index] != UNREACHED]
        return min(reached, key=lambda index: self.cost[index], default=None)

    def is_clear(self, start, end):
        """Whether the straight line between two cells meets nothing blocked."""
        (row, col), (to_row, to_col) = divmod(start, self.cols), divmod(end, self.cols)
        steps = max(abs(to_row - row), abs(to_col - col), 1)
        for step in range(1, steps):
            share = step / float(steps)
            at_row = int(row + (to_row - row) * share + 0.5)
            at_col = int(col + (to_col - col) * share + 0.5)
            if self.blocked[at_row * self.cols + at_col]:
                return False
        return True


def rounded(value):
    """The nearest integer, halves away from zero."""
    return math.floor(value + 0.5) if value >= 0.0 else -math.floor(0.5 - value)


# Features of a goal


def along(corners):
    """Poses along the line through some corners, from the first to the last."""
    poses = []
    for start, end in zip(corners, corners[1:]):
        dx, dy = end[0] - start[0], end[1] - start[1]
        steps = min(max(math.ceil(math.hypot(dx, dy) / STATION_STEP_M), 1), MAX_STATIONS)
        for step in range(min(steps, MAX_STATIONS - len(poses))):
            share = step / float(steps)
            x_m, y_m = start[0] + dx * share, start[1] + dy * share
            poses.append(Pose(x_m, y_m, math.atan2(dy, dx)))
    poses.append(Pose(*corners[-1], math.atan2(dy, dx)))
    return poses


class Course:
    """Stations of a way, and what pixels are told of it."""

    def __init__(self, poses):
        single = [(pose.x_m, pose.y_m, math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)) for pose in poses]
        self.x, self.y, self.cos, self.sin = numpy.array(single, dtype=numpy.float32).T

    def features(self, x, y):
        """Across, close by, the course's direction, how far along: of the nearest station."""
        dx, dy = x[..., None] - self.x, y[..., None] - self.y
        squared = dx * dx + dy * dy
        # Of several stations at the same distance the first.
        nearest = squared.argmin(axis=-1)
        pick = nearest[..., None]
        dx, dy, squared = (numpy.take_along_axis(a, pick, -1)[..., 0] for a in (dx, dy, squared))
        cos, sin = self.cos[nearest], self.sin[nearest]
        across = numpy.clip(dy * cos - dx * sin, -COURSE_REACH_M, COURSE_REACH_M)
        place = nearest.astype(numpy.float32) / numpy.float32(LENGTH_M)
        return [across / COURSE_REACH_M, bell(squared, COURSE_BELL_M), cos, sin, place]

    def detour(self, reach_m):
        """How much longer the course is than the straight line, as a share of it, at most 3."""
        return min(max(len(self.x) * STATION_STEP_M / reach_m - 1.0, 0.0), 3.0)


def bell(squared, width_m):
    exponent = squared / numpy.float32(2.0 * width_m * width_m)
    return numpy.where(exponent > MAX_EXPONENT, 0.0, numpy.exp(-exponent)).astype(numpy.float32)


def goal_features(info, ways, goal, radius_m):
    """The input `features` of one goal: 27 x rows / 8 x cols / 8 of the input."""
    rows, cols = (side // SIDE_MULTIPLE for side in info.input_size)
    cells = SIDE_MULTIPLE * info.shrink
    side_m = cells * info.resolution_m
    first_x_m, first_y_m = info.first_block_centre(cells)
    x = (first_x_m - numpy.arange(rows) * side_m).astype(numpy.float32)[:, None]
    y = (first_y_m - numpy.arange(cols) * side_m).astype(numpy.float32)[None, :]
    x, y = numpy.broadcast_arrays(x, y)
    corners = ways.to(goal)
    straight = [(0.0, 0.0), (goal.x_m, goal.y_m)]
    drive = dubins_path(goal, radius_m)
    drive = Course(drive if len(drive) <= MAX_STATIONS else along(straight))
    way = Course(along(corners or straight))
    reach_m = max(math.hypot(goal.x_m, goal.y_m), 1.0)
    goal_x, goal_y = numpy.float32(goal.x_m), numpy.float32(goal.y_m)
    cos, sin = numpy.float32(math.cos(goal.yaw_rad)), numpy.float32(math.sin(goal.yaw_rad))
    dx, dy = x - goal_x, y - goal_y
    squared = dx * dx + dy * dy
    features = [
        (dx * cos + dy * sin) / LENGTH_M,
        (dy * cos - dx * sin) / WIDTH_M,
        numpy.sqrt(squared) / LENGTH_M,
        bell(squared, GOAL_BELLS_M[0]),
        bell(squared, GOAL_BELLS_M[1]),
        cos,
        sin,
        x / LENGTH_M,
        y / WIDTH_M,
        bell(x * x + y * y, VEHICLE_BELL_M),
        goal_x / LENGTH_M,
        goal_y / WIDTH_M,
        (goal_x * y - goal_y * x) / (reach_m * WIDTH_M),
        numpy.clip((goal_x * x + goal_y * y) / (reach_m * reach_m), -1.0, 2.0),
        *drive.features(x, y),
        drive.detour(reach_m),
        *way.features(x, y),
        way.detour(reach_m),
        float(corners is not None),
    ]
    assert len(features) == GOAL_FEATURES
    full = [numpy.broadcast_to(feature, (rows, cols)) for feature in features]
    return numpy.stack(full).astype(numpy.float32)
