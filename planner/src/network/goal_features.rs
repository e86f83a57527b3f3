//! What `enet-shared` is told of a goal: where it lies from each pixel, and how the vehicle would
//! drive there if nothing were in the way.
//!
//! The paper gives its network the target as one more plane of cells. A network that looks at the map
//! only once needs more: relative coordinates, and since the labels are the shortest paths of a car,
//! the course of the shortest path of a car in the open (L. Dubins, 1957), from which obstacles make
//! it deviate, and that of the shortest way of a disc around the obstacles (`disc_ways`), which says
//! on which side to pass them.

#![expect(
    clippy::inline_always,
    reason = "a loop must be compiled within the function that enables its instructions"
)]

use swath_bridge::Pose2;

use super::disc_ways::DiscWays;
use super::engine::kernel::{Isa, compiled_for};
use super::graph::GOAL_FEATURES;
use crate::dubins::shortest_path;

/// Distances along the drive are divided by this, metres.
const LENGTH_SCALE_M: f32 = 40.0;
/// Distances across the drive are divided by this, metres.
const WIDTH_SCALE_M: f32 = 15.0;
/// Widths of the two bells around the goal, metres.
const GOAL_BELLS_M: [f32; 2] = [2.0, 8.0];
/// Width of the bell around the vehicle, metres.
const VEHICLE_BELL_M: f32 = 4.0;
/// Width of the bell along the open drive, metres.
const DRIVE_BELL_M: f32 = 1.5;
/// Farthest distance from the open drive that is told, and its scale, metres.
const DRIVE_REACH_M: f32 = 10.0;
/// Where a bell is below 1e-12 it is 0: most pixels are far off, and exponentials take time.
const MAX_EXPONENT: f32 = 28.0;
/// Distance between two poses of the open drive, metres.
const DRIVE_STEP_M: f64 = 1.0;
/// An open drive of more poses winds so far around that the straight line says more.
const MAX_DRIVE_POSES: usize = 200;

/// Stations that are looked at together.
const LANES: usize = 16;
const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// Where there is no station, metres.
const FAR_OFF_M: f32 = 1e15;

/// Where the pixels lie whose features are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pixels {
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Side of a pixel, metres.
    pub(super) side_m: f64,
    /// Centre of the first pixel in the vehicle frame, metres.
    pub(super) first: (f64, f64),
}

impl Pixels {
    /// Their centres, row by row.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the network is of single precision"
    )]
    fn centres(&self) -> impl Iterator<Item = (f32, f32)> {
        let (x_m, y_m) = self.first;
        (0..self.rows).flat_map(move |row| {
            let x = (x_m - row as f64 * self.side_m) as f32;
            (0..self.cols).map(move |col| (x, (y_m - col as f64 * self.side_m) as f32))
        })
    }
}

/// A pose of the open drive or of a disc's way.
#[derive(Debug, Clone, Copy)]
struct Station {
    x_m: f32,
    y_m: f32,
    cos: f32,
    sin: f32,
}

impl Station {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the network is of single precision"
    )]
    fn at(pose: &Pose2) -> Self {
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        Self {
            x_m: pose.x_m as f32,
            y_m: pose.y_m as f32,
            cos: cos as f32,
            sin: sin as f32,
        }
    }
}

/// Writes the features of a goal for a vehicle that turns no tighter than `radius_m`.
///
/// # Shapes
/// `features`: rows × cols × 27.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the network is of single precision"
)]
pub(super) fn write(
    pixels: &Pixels,
    ways: &DiscWays,
    goal: &Pose2,
    radius_m: f64,
    features: &mut [f32],
) {
    let drive = Course::new(open_drive(goal, radius_m));
    let way = ways.to(goal);
    let is_reached = f32::from(u8::from(way.is_some()));
    let way = Course::new(way.map_or_else(|| straight(goal), |corners| along(&corners)));
    let places: Vec<(f32, f32)> = pixels.centres().collect();
    let (mut driven, mut ways) = (Vec::new(), Vec::new());
    compiled_for(Isa::detect(), || {
        drive.nearest_to_each(&places, &mut driven);
        way.nearest_to_each(&places, &mut ways);
    });
    let (goal_x, goal_y) = (goal.x_m as f32, goal.y_m as f32);
    let (sin, cos) = libm::sincos(goal.yaw_rad);
    let (sin, cos) = (sin as f32, cos as f32);
    let reach = libm::hypotf(goal_x, goal_y).max(1.0);
    let detour = |course: &Course| {
        let length = course.stations.len() as f32 * DRIVE_STEP_M as f32;
        (length / reach - 1.0).clamp(0.0, 3.0)
    };
    let (drive_detour, way_detour) = (detour(&drive), detour(&way));
    let pixels = places.iter().zip(driven.iter().zip(&ways));
    for (to, (&(x, y), (driven, way))) in features.chunks_exact_mut(GOAL_FEATURES).zip(pixels) {
        let (dx, dy) = (x - goal_x, y - goal_y);
        let squared = dx * dx + dy * dy;
        let [drive_across, drive_bell, drive_cos, drive_sin, drive_at] = driven.features();
        let [way_across, way_bell, way_cos, way_sin, way_at] = way.features();
        to.copy_from_slice(&[
            (dx * cos + dy * sin) / LENGTH_SCALE_M,
            (dy * cos - dx * sin) / WIDTH_SCALE_M,
            squared.sqrt() / LENGTH_SCALE_M,
            bell(squared, GOAL_BELLS_M[0]),
            bell(squared, GOAL_BELLS_M[1]),
            cos,
            sin,
            x / LENGTH_SCALE_M,
            y / WIDTH_SCALE_M,
            bell(x * x + y * y, VEHICLE_BELL_M),
            goal_x / LENGTH_SCALE_M,
            goal_y / WIDTH_SCALE_M,
            // Beside and along the straight line from the vehicle to the goal.
            (goal_x * y - goal_y * x) / (reach * WIDTH_SCALE_M),
            ((goal_x * x + goal_y * y) / (reach * reach)).clamp(-1.0, 2.0),
            drive_across,
            drive_bell,
            drive_cos,
            drive_sin,
            drive_at,
            drive_detour,
            way_across,
            way_bell,
            way_cos,
            way_sin,
            way_at,
            way_detour,
            is_reached,
        ]);
    }
}

/// The course in the open, or the straight line where that winds too much. Never empty.
fn open_drive(goal: &Pose2, radius_m: f64) -> Vec<Station> {
    let origin = Pose2::default();
    let poses = shortest_path(&origin, goal, radius_m, DRIVE_STEP_M);
    if poses.is_empty() || poses.len() > MAX_DRIVE_POSES {
        return straight(goal);
    }
    poses.iter().map(Station::at).collect()
}

/// The straight line to the goal.
fn straight(goal: &Pose2) -> Vec<Station> {
    along(&[(0.0, 0.0), (goal.x_m, goal.y_m)])
}

/// Poses along the line through some corners, from the first to the last.
fn along(corners: &[(f64, f64)]) -> Vec<Station> {
    let mut stations = Vec::new();
    for pair in corners.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let yaw_rad = libm::atan2(dy, dx);
        let steps = (libm::hypot(dx, dy) / DRIVE_STEP_M)
            .ceil()
            .clamp(1.0, MAX_DRIVE_POSES as f64);
        let mut step = 0.0;
        while step < steps && stations.len() < MAX_DRIVE_POSES {
            let share = step / steps;
            let pose = Pose2::new(from.0 + dx * share, from.1 + dy * share, yaw_rad);
            stations.push(Station::at(&pose));
            step += 1.0;
        }
    }
    if let [.., from, to] = *corners {
        let yaw_rad = libm::atan2(to.1 - from.1, to.0 - from.0);
        stations.push(Station::at(&Pose2::new(to.0, to.1, yaw_rad)));
    }
    stations
}

/// The place of the open drive that is nearest to a pixel.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    station: Station,
    /// Square of the distance, m².
    squared: f32,
    /// To the left of the drive, metres.
    across_m: f32,
    /// Along the drive, metres.
    at_m: f32,
}

impl Nearest {
    /// Across, close by, the course's direction, and how far along.
    fn features(&self) -> [f32; 5] {
        [
            self.across_m.clamp(-DRIVE_REACH_M, DRIVE_REACH_M) / DRIVE_REACH_M,
            bell(self.squared, DRIVE_BELL_M),
            self.station.cos,
            self.station.sin,
            self.at_m / LENGTH_SCALE_M,
        ]
    }
}

/// Stations, and where they are, `LANES` at a time.
struct Course {
    stations: Vec<Station>,
    places: Vec<([f32; LANES], [f32; LANES])>,
}

impl Course {
    fn new(stations: Vec<Station>) -> Self {
        let places = stations.chunks(LANES).map(|stations| {
            let mut places = ([FAR_OFF_M; LANES], [FAR_OFF_M; LANES]);
            for (lane, station) in stations.iter().enumerate() {
                (places.0[lane], places.1[lane]) = (station.x_m, station.y_m);
            }
            places
        });
        Self {
            places: places.collect(),
            stations,
        }
    }

    /// The station that is nearest to each pixel, the first of several.
    #[inline(always)]
    fn nearest_to_each(&self, places: &[(f32, f32)], nearest: &mut Vec<Nearest>) {
        nearest.clear();
        for &(x, y) in places {
            let mut least = [f32::INFINITY; LANES];
            let mut at = [0_u32; LANES];
            for (first, (xs, ys)) in (0..).step_by(LANES).zip(&self.places) {
                for lane in 0..LANES {
                    let (dx, dy) = (x - xs[lane], y - ys[lane]);
                    let squared = dx * dx + dy * dy;
                    let is_nearer = squared < least[lane];
                    least[lane] = if is_nearer { squared } else { least[lane] };
                    at[lane] = if is_nearer { first } else { at[lane] };
                }
            }
            let squared = smallest(least, f32::min);
            // Of several, the one whose number is the smallest.
            let numbers = std::array::from_fn(|lane| {
                let number = at[lane] + NUMBERS[lane];
                if least[lane] == squared {
                    number
                } else {
                    u32::MAX
                }
            });
            let index = smallest(numbers, u32::min) as usize;
            let station = self.stations[index];
            let (dx, dy) = (x - station.x_m, y - station.y_m);
            nearest.push(Nearest {
                station,
                squared,
                across_m: dy * station.cos - dx * station.sin,
                at_m: index as f32,
            });
        }
    }
}

/// The smallest of all lanes, in halves.
#[inline(always)]
fn smallest<T: Copy>(mut values: [T; LANES], smaller: impl Fn(T, T) -> T) -> T {
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            values[lane] = smaller(values[lane], values[lane + width]);
        }
        width /= 2;
    }
    values[0]
}

fn bell(squared: f32, width_m: f32) -> f32 {
    let exponent = squared / (2.0 * width_m * width_m);
    if exponent > MAX_EXPONENT {
        0.0
    } else {
        libm::expf(-exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PIXELS: Pixels = Pixels {
        rows: 26,
        cols: 10,
        side_m: 3.2,
        first: (58.5, 13.5),
    };

    fn features(goal: &Pose2, radius_m: f64) -> Vec<f32> {
        let mut features = vec![f32::NAN; PIXELS.rows * PIXELS.cols * GOAL_FEATURES];
        write(&PIXELS, &DiscWays::default(), goal, radius_m, &mut features);
        features
    }

    #[test]
    fn straight_ahead_the_open_drive_is_the_line_to_the_goal() {
        let features = features(&Pose2::new(30.0, 0.0, 0.0), 5.5);
        for (index, of_pixel) in features.chunks_exact(GOAL_FEATURES).enumerate() {
            let y = 13.5 - 3.2 * (index % PIXELS.cols) as f32;
            assert!((of_pixel[12] - y / WIDTH_SCALE_M).abs() < 1e-5);
            assert!((of_pixel[14] - y.clamp(-10.0, 10.0) / 10.0).abs() < 1e-5);
            assert_eq!((of_pixel[16], of_pixel[17]), (1.0, 0.0));
        }
    }

    #[test]
    fn in_a_mirror_what_lies_across_changes_its_sign() {
        let mirrored = Pixels {
            first: (58.5, 3.2 * 9.0 - 13.5),
            ..PIXELS
        };
        let straight = features(&Pose2::new(25.0, 6.0, 0.3), 7.0);
        let mut other = vec![0.0; straight.len()];
        let goal = Pose2::new(25.0, -6.0, -0.3);
        write(&mirrored, &DiscWays::default(), &goal, 7.0, &mut other);
        let odd = [1, 6, 8, 11, 12, 14, 17, 20, 23];
        for (index, of_pixel) in straight.chunks_exact(GOAL_FEATURES).enumerate() {
            let (row, col) = (index / PIXELS.cols, index % PIXELS.cols);
            let at = (row * PIXELS.cols + PIXELS.cols - 1 - col) * GOAL_FEATURES;
            for (feature, &value) in of_pixel.iter().enumerate() {
                let sign = if odd.contains(&feature) { -1.0 } else { 1.0 };
                let off = (sign * other[at + feature] - value).abs();
                assert!(off < 1e-3, "feature {feature} at {row}, {col}: {off}");
            }
        }
    }

    proptest! {
        #[test]
        fn features_are_finite_and_of_the_order_of_one(
            x in -90.0..90.0f64, y in -40.0..40.0f64, yaw in -7.0..7.0f64, radius in 0.1..300.0f64,
        ) {
            let features = features(&Pose2::new(x, y, yaw), radius);
            prop_assert!(features.iter().all(|value| value.abs() <= 12.0));
        }
    }
}
