//! Where the ground is around a 3D lidar, from a single sweep.
//!
//! The ground's height at the sensor is the most frequent height below it. From there the ground is
//! followed outward, bin by bin in each sector: the lowest return of a bin is ground if it continues
//! what was ground before at no more than a slope. Where there is no such return, because something
//! hides it or no ring falls there, height and rise are carried on, the rise ever less, and
//! neighbouring sectors repair both as soon as one of them sees the ground again. Nothing here needs
//! the lidar's height or rings.

use super::cloud::Point;
use super::polar::{BIN_M, Polar};

/// Beam sectors that share a sector of ground.
const SECTORS_MERGED: usize = 4;
/// Beam bins that share a bin of ground.
const BINS_MERGED: usize = 2;
/// Roughness and noise of what still counts as one ground, metres.
const ROUGHNESS_M: f32 = 0.08;
/// Most that ground may rise over a stretch that was not seen, metres.
const MAX_UNSEEN_RISE_M: f32 = 0.25;
/// Most that ground may fall over a stretch that was not seen, metres.
const MAX_UNSEEN_FALL_M: f32 = 1.0;
/// How far from seen ground its height is trusted, metres.
const TRUSTED_M: f32 = 3.0;
/// How much a metre of unseen ground may rise or fall otherwise than it was carried on.
const UNSEEN_GRADE: f32 = 0.04;
/// Distance over which a new rise replaces the old one, metres.
const RISE_M: f32 = 4.0;
/// What is left of a carried rise after each bin.
const RISE_LEFT: f32 = 0.96;
/// Around the sensor, where its height above ground is taken from, metres.
const NEAR_M: std::ops::Range<f32> = 1.0..15.0;
/// Ground is at least this far below the sensor, metres.
const MIN_SENSOR_HEIGHT_M: f32 = 0.15;
/// A sensor this near to the height of the vehicle's frame may be that frame itself, which often lies
/// on the ground: then the ground may be this far above it too, metres.
const FRAME_HEIGHT_M: f32 = 0.3;
/// Height of a histogram's step, metres.
const STEP_M: f32 = 0.1;
/// Steps downward that the histogram covers.
const STEPS: usize = 60;
/// Fewest returns that make a height.
const MIN_RETURNS: u32 = 30;

/// Depth of a bin of ground, metres.
const DEPTH_M: f32 = BIN_M * BINS_MERGED as f32;

/// Ground carried on from the bins before.
struct Carried {
    height_m: f32,
    rise: f32,
    unseen_m: f32,
}

/// The ground around a sensor.
#[derive(Debug)]
pub(crate) struct Ground {
    bins: usize,
    /// Height in the vehicle frame, metres, by sector and bin.
    height_m: Vec<f32>,
    /// Distance since ground was seen, metres, by sector and bin.
    unseen_m: Vec<f32>,
    /// Rise over run, outward, by sector and bin.
    rise: Vec<f32>,
    /// Lowest return of each bin.
    low_m: Vec<f32>,
    /// Height below the sensor; kept for sweeps with too few returns.
    at_sensor_m: Option<f32>,
}

impl Ground {
    pub(crate) fn new(polar: &Polar) -> Self {
        let bins = polar.bins.div_ceil(BINS_MERGED);
        let len = polar.sectors().div_ceil(SECTORS_MERGED) * bins;
        Self {
            bins,
            height_m: vec![0.0; len],
            unseen_m: vec![0.0; len],
            rise: vec![0.0; len],
            low_m: vec![f32::INFINITY; len],
            at_sensor_m: None,
        }
    }

    /// Index of the bin of ground below a beam's bin.
    pub(crate) const fn index(&self, sector: usize, bin: usize) -> usize {
        sector / SECTORS_MERGED * self.bins + bin / BINS_MERGED
    }

    /// Height of the ground, metres in the vehicle frame.
    pub(crate) fn height_m(&self, index: usize) -> f32 {
        self.height_m[index]
    }

    /// How far off the height may be, metres: 0 where ground was seen here or near by.
    pub(crate) fn doubt_m(&self, index: usize) -> f32 {
        let unseen_m = self.unseen_m[index];
        if unseen_m <= TRUSTED_M {
            0.0
        } else {
            unseen_m * UNSEEN_GRADE
        }
    }

    /// Finds the ground of a sweep. `places` are the sector and bin of each point.
    pub(crate) fn find(
        &mut self,
        points: &[Point],
        places: &[(u16, u16)],
        (sensor, max_slope): (Point, f32),
    ) {
        let at_sensor_m = height_at_sensor(points, places, sensor)
            .or(self.at_sensor_m)
            .unwrap_or_else(|| sensor[2].min(0.0));
        self.at_sensor_m = Some(at_sensor_m);
        self.low_m.fill(f32::INFINITY);
        for (point, &(sector, bin)) in points.iter().zip(places) {
            let index = self.index(usize::from(sector), usize::from(bin));
            // Reflections that seem to come from below the ground are left out.
            let range_m = f32::from(bin) * BIN_M;
            let lowest_m = at_sensor_m - MAX_UNSEEN_FALL_M - max_slope * range_m;
            if point[2] >= lowest_m && point[2] < self.low_m[index] {
                self.low_m[index] = point[2];
            }
        }
        self.follow_outward(at_sensor_m, max_slope);
    }

    fn follow_outward(&mut self, at_sensor_m: f32, max_slope: f32) {
        let sectors = self.height_m.len() / self.bins;
        for bin in 0..self.bins {
            for sector in 0..sectors {
                let index = sector * self.bins + bin;
                let carried = if bin == 0 {
                    Carried {
                        height_m: at_sensor_m,
                        rise: 0.0,
                        unseen_m: DEPTH_M,
                    }
                } else {
                    let left = (sector + 1) % sectors * self.bins + bin - 1;
                    let right = (sector + sectors - 1) % sectors * self.bins + bin - 1;
                    self.carried([left, index - 1, right])
                };
                let step_m = self.low_m[index] - carried.height_m;
                let slack_m = max_slope * carried.unseen_m;
                let is_ground = step_m <= ROUGHNESS_M + slack_m.min(MAX_UNSEEN_RISE_M)
                    && step_m >= -ROUGHNESS_M - slack_m.min(MAX_UNSEEN_FALL_M);
                if is_ground {
                    let rise = carried.rise + step_m / carried.unseen_m.max(RISE_M);
                    self.rise[index] = rise.clamp(-max_slope, max_slope);
                    self.height_m[index] = self.low_m[index];
                    self.unseen_m[index] = 0.0;
                } else {
                    self.rise[index] = carried.rise * RISE_LEFT;
                    self.height_m[index] = carried.height_m;
                    self.unseen_m[index] = carried.unseen_m;
                }
            }
        }
    }

    /// What the bins before say about the next one.
    fn carried(&self, before: [usize; 3]) -> Carried {
        let rise = middle(before.map(|index| self.rise[index]));
        Carried {
            height_m: middle(before.map(|index| self.height_m[index])) + rise * DEPTH_M,
            rise,
            unseen_m: before
                .map(|index| self.unseen_m[index])
                .into_iter()
                .fold(f32::MAX, f32::min)
                + DEPTH_M,
        }
    }
}

/// The most frequent height below the sensor and near it; between equal ones the lowest.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "only steps within the histogram are cast"
)]
fn height_at_sensor(points: &[Point], places: &[(u16, u16)], sensor: Point) -> Option<f32> {
    let is_frame = sensor[2].abs() < FRAME_HEIGHT_M;
    let top_m = sensor[2]
        + if is_frame {
            FRAME_HEIGHT_M
        } else {
            -MIN_SENSOR_HEIGHT_M
        };
    let mut counts = [0u32; STEPS];
    let near = (NEAR_M.start / BIN_M) as u16..(NEAR_M.end / BIN_M) as u16;
    for (point, (_, bin)) in points.iter().zip(places) {
        let below = (top_m - point[2]) / STEP_M;
        if near.contains(bin) && below >= 0.0 && below < STEPS as f32 {
            counts[below as usize] += 1;
        }
    }
    // Two steps together, so that ground on the border between two is not split.
    let pairs = counts.windows(2).map(|pair| pair[0] + pair[1]).enumerate();
    let (step, count) = pairs.max_by_key(|(step, count)| (*count, *step))?;
    let upper_part = counts[step] as f32 / count.max(1) as f32;
    (count >= MIN_RETURNS).then_some(top_m - STEP_M * (step as f32 + 1.5 - upper_part))
}

fn middle([a, b, c]: [f32; 3]) -> f32 {
    a.max(b).min(a.min(b).max(c))
}
