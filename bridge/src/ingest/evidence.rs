//! What the last seconds of sweeps say about the world, in the odometry frame.
//!
//! Two maps lie under the vehicle and wrap around as it moves: cells that were hit, as a list with an
//! index by place, and cells that were seen to be free, as stamps. A hit loses its score as newer
//! beams pass below its top, so what has moved leaves no trail.

use super::beams::Beams;
use crate::geometry::Pose2;

/// Most cells that may be hit at a time; further ones are passed over.
pub(crate) const MAX_HITS: usize = 400_000;
/// Largest coordinate in the odometry frame, metres.
pub(crate) const MAX_COORDINATE_M: f64 = 1e8;
/// Score of a cell that was hit once.
const HIT_SCORE: u8 = 2;
/// Most score of a cell.
const MAX_SCORE: u8 = 3;
/// How far below the top of a hit a beam has to pass to speak against it, metres.
const BELOW_TOP_M: f32 = 0.1;
/// A beam below this part of the height of a hit proves that it is gone.
const WELL_BELOW: f32 = 0.6;

/// A return from an obstacle, in the vehicle frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Return {
    pub(crate) x_m: f32,
    pub(crate) y_m: f32,
    /// Height over the ground of what it came from, as far as it was seen.
    pub(crate) top_m: f32,
    /// Returns it counts for.
    pub(crate) weight: u16,
}

/// A cell that was hit.
#[derive(Debug, Clone, Copy)]
struct Hit {
    /// Number of the sensor that hit it last. Its beams alone can prove it gone: those of another one may
    /// pass above or below.
    sensor: u8,
    cell: (i64, i64),
    /// Where the newest return came from, odometry frame.
    position_m: (f64, f64),
    top_m: f32,
    score: u8,
    returns: u16,
    sweep: u32,
    nanos: u64,
    travelled_m: f64,
}

/// The time of a sweep, and the age from which on evidence is too old.
#[derive(Debug, Clone, Copy)]
struct Now {
    nanos: u64,
    age_nanos: u64,
}

/// How long evidence counts and how much of the world it covers.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "the names end in their unit")]
pub(crate) struct Limits {
    /// Distance driven after which evidence is forgotten, metres.
    pub(crate) travel_m: f64,
    /// Distance from the vehicle beyond which nothing is kept, metres.
    pub(crate) radius_m: f64,
    /// Side of a cell of hits, metres.
    pub(crate) hit_cell_m: f64,
    /// Side of a cell of free space, metres.
    pub(crate) free_cell_m: f64,
}

/// Evidence about the world around a moving vehicle.
#[derive(Debug)]
pub(crate) struct Evidence {
    limits: Limits,
    /// Ages at which evidence is forgotten, nanoseconds, by sensor.
    ages_nanos: Vec<u64>,
    /// The sensor of the sweep that has begun.
    sensor: u8,
    hits: Vec<Hit>,
    /// Place in `hits` plus one, 0 for none, by wrapped cell.
    index: Wrapped,
    /// Sweep in which a cell was last seen free, 0 for never, by wrapped cell.
    free: Wrapped,
    sweep: u32,
    /// First sweep that still counts.
    first_sweep: u32,
    /// Stamps and distances of the sweeps that still count.
    sweeps: std::collections::VecDeque<(u64, f64)>,
    travelled_m: f64,
    pose: Option<Pose2>,
}

/// Numbers by cell of an endless plane of which a square is kept.
#[derive(Debug)]
struct Wrapped {
    cell_m: f64,
    side: i64,
    values: Vec<u32>,
}

/// The greatest whole number that is not above a value; several times quicker than the library's.
#[expect(clippy::cast_possible_truncation, reason = "coordinates are limited")]
fn floor(value: f64) -> i64 {
    let towards_zero = value as i64;
    towards_zero - i64::from(value < towards_zero as f64)
}

/// Most cells along a side of a wrapped map.
const MAX_SIDE: i64 = 4096;

impl Wrapped {
    fn new(wanted_cell_m: f64, side_m: f64) -> Self {
        let cell_m = wanted_cell_m.max(side_m / MAX_SIDE as f64);
        #[expect(clippy::cast_possible_truncation, reason = "at most MAX_SIDE")]
        let side = (libm::ceil(side_m / cell_m) as i64).clamp(1, MAX_SIDE);
        let len = usize::try_from(side * side).unwrap_or(0);
        Self {
            cell_m,
            side,
            values: vec![0; len],
        }
    }

    fn cell(&self, (x_m, y_m): (f64, f64)) -> (i64, i64) {
        (floor(x_m / self.cell_m), floor(y_m / self.cell_m))
    }

    fn slot(&self, (x, y): (i64, i64)) -> usize {
        self.slot_of_wrapped((x.rem_euclid(self.side), y.rem_euclid(self.side)))
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "both are between 0 and the side"
    )]
    const fn slot_of_wrapped(&self, (x, y): (i64, i64)) -> usize {
        (x * self.side + y) as usize
    }
}

impl Evidence {
    pub(crate) fn new(limits: Limits) -> Self {
        let side_m = 2.0 * limits.radius_m + limits.travel_m + 1.0;
        Self {
            limits,
            ages_nanos: Vec::new(),
            sensor: 0,
            hits: Vec::new(),
            index: Wrapped::new(limits.hit_cell_m, side_m),
            free: Wrapped::new(limits.free_cell_m, side_m),
            sweep: 0,
            first_sweep: 1,
            sweeps: std::collections::VecDeque::new(),
            travelled_m: 0.0,
            pose: None,
        }
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.hits.clear();
        self.index.values.fill(0);
        self.sweeps.clear();
        self.first_sweep = self.sweep + 1;
        self.pose = None;
    }

    /// Says whose sweep comes next, and the age at which what it sees is forgotten, seconds.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "ages are a minute at most"
    )]
    pub(crate) fn set_sensor(&mut self, sensor: u8, age_s: f64) {
        let place = usize::from(sensor);
        if self.ages_nanos.len() <= place {
            self.ages_nanos.resize(place + 1, u64::MAX);
        }
        self.ages_nanos[place] = (age_s * 1e9) as u64;
        self.sensor = sensor;
    }

    /// Begins a sweep taken at a pose, and forgets what is too old.
    pub(crate) fn begin(&mut self, odom_from_vehicle: &Pose2, nanos: u64) {
        if self.sweep == u32::MAX {
            self.clear();
            self.free.values.fill(0);
            (self.sweep, self.first_sweep) = (0, 1);
        }
        self.sweep += 1;
        if let Some(before) = self.pose.replace(*odom_from_vehicle) {
            self.travelled_m += before.distance_m(odom_from_vehicle);
        }
        self.sweeps.push_back((nanos, self.travelled_m));
        // Free space does not tell who saw it, so the shortest age counts.
        let age_nanos = self.ages_nanos.iter().copied().min().unwrap_or(0);
        while let Some(&(then_nanos, then_m)) = self.sweeps.front()
            && self.is_old(then_nanos, then_m, Now { nanos, age_nanos })
        {
            self.sweeps.pop_front();
            self.first_sweep += 1;
        }
    }

    fn is_old(&self, then_nanos: u64, then_m: f64, now: Now) -> bool {
        // A stamp from the future comes from a clock that was set back.
        then_nanos > now.nanos
            || now.nanos - then_nanos > now.age_nanos
            || self.travelled_m - then_m > self.limits.travel_m
    }

    /// Takes the returns of the sweep that has begun.
    pub(crate) fn add_returns(&mut self, returns: &[Return]) {
        let Some((pose, &(nanos, travelled_m))) = self.pose.zip(self.sweeps.back()) else {
            return;
        };
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        for found in returns {
            let (x, y) = (f64::from(found.x_m), f64::from(found.y_m));
            if x * x + y * y > self.limits.radius_m * self.limits.radius_m {
                continue;
            }
            let position_m = (pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y);
            let cell = self.index.cell(position_m);
            let slot = self.index.slot(cell);
            let fresh = Hit {
                sensor: self.sensor,
                cell,
                position_m,
                top_m: found.top_m,
                score: HIT_SCORE,
                returns: found.weight,
                sweep: self.sweep,
                nanos,
                travelled_m,
            };
            let place = self.index.values[slot] as usize;
            let Some(hit) = place.checked_sub(1).map(|place| &mut self.hits[place]) else {
                if self.hits.len() < MAX_HITS {
                    self.hits.push(fresh);
                    self.index.values[slot] = u32::try_from(self.hits.len()).unwrap_or(0);
                }
                continue;
            };
            if hit.cell != cell {
                *hit = fresh;
            } else if hit.sweep == self.sweep {
                hit.returns = hit.returns.saturating_add(found.weight);
                hit.top_m = hit.top_m.max(found.top_m);
            } else {
                *hit = Hit {
                    score: (hit.score + HIT_SCORE).min(MAX_SCORE),
                    returns: hit.returns.saturating_add(found.weight),
                    ..fresh
                };
            }
        }
    }

    /// Drops hits that are old, far, where the vehicle is, or proved gone by the sweep's beams.
    pub(crate) fn drop_stale(&mut self, beams: &Beams, is_own: impl Fn(f32, f32) -> bool) {
        let Some((pose, &(nanos, _))) = self.pose.zip(self.sweeps.back()) else {
            return;
        };
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        let radius_m = self.limits.radius_m;
        let mut kept = 0;
        for place in 0..self.hits.len() {
            let mut hit = self.hits[place];
            let slot = self.index.slot(hit.cell);
            let (dx, dy) = (hit.position_m.0 - pose.x_m, hit.position_m.1 - pose.y_m);
            #[expect(
                clippy::cast_possible_truncation,
                reason = "within the radius of the vehicle"
            )]
            let (x_m, y_m) = ((cos * dx + sin * dy) as f32, (cos * dy - sin * dx) as f32);
            let is_far = dx * dx + dy * dy > radius_m * radius_m;
            let is_of_sweep = hit.sensor == self.sensor;
            let age_nanos = self.ages_nanos[usize::from(hit.sensor)];
            let now = Now { nanos, age_nanos };
            let is_covered = is_of_sweep && is_own(x_m, y_m);
            if is_far || is_covered || self.is_old(hit.nanos, hit.travelled_m, now) {
                self.index.values[slot] = 0;
                continue;
            }
            if is_of_sweep && hit.sweep != self.sweep {
                hit.score = hit
                    .score
                    .saturating_sub(misses(&hit, beams.cleared_above_m(x_m, y_m)));
                if hit.score == 0 {
                    self.index.values[slot] = 0;
                    continue;
                }
            }
            self.hits[kept] = hit;
            kept += 1;
            self.index.values[slot] = u32::try_from(kept).unwrap_or(0);
        }
        self.hits.truncate(kept);
    }

    /// Calls with the place (vehicle frame, metres) and number of returns of every hit.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "within the radius of the vehicle"
    )]
    pub(crate) fn each_hit(&self, mut take: impl FnMut(f32, f32, u32)) {
        let Some(pose) = self.pose else { return };
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        for hit in &self.hits {
            let (dx, dy) = (hit.position_m.0 - pose.x_m, hit.position_m.1 - pose.y_m);
            let (x_m, y_m) = (cos * dx + sin * dy, cos * dy - sin * dx);
            take(x_m as f32, y_m as f32, u32::from(hit.returns));
        }
    }

    /// Free space by place, for a pass over the vehicle's cells.
    pub(crate) fn free_space(&mut self) -> FreeSpace<'_> {
        let pose = self.pose.unwrap_or_default();
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        let side = self.free.side;
        let (x, y) = self.free.cell((pose.x_m, pose.y_m));
        let first = (x.rem_euclid(side), y.rem_euclid(side));
        let cells_a_m = 1.0 / self.free.cell_m;
        FreeSpace {
            // The fraction within the vehicle's own cell, plus that cell's wrapped place.
            place: (
                pose.x_m * cells_a_m - x as f64 + first.0 as f64,
                pose.y_m * cells_a_m - y as f64 + first.1 as f64,
            ),
            along: (cos * cells_a_m, sin * cells_a_m),
            sweep: self.sweep,
            first_sweep: self.first_sweep,
            map: &mut self.free,
        }
    }
}

/// How often the lowest beam over a hit speaks against it.
fn misses(hit: &Hit, cleared_above_m: f32) -> u8 {
    if cleared_above_m < hit.top_m * WELL_BELOW {
        MAX_SCORE
    } else {
        u8::from(cleared_above_m < hit.top_m - BELOW_TOP_M)
    }
}

/// Free space around the vehicle.
#[derive(Debug)]
pub(crate) struct FreeSpace<'a> {
    /// Where the vehicle is on the wrapped map, cells.
    place: (f64, f64),
    /// A metre forward, cells.
    along: (f64, f64),
    sweep: u32,
    first_sweep: u32,
    map: &'a mut Wrapped,
}

impl FreeSpace<'_> {
    /// Notes that a place is free if it is seen now, and says whether it counts as free: seen now or
    /// not long ago.
    pub(crate) fn note(&mut self, x_m: f64, y_m: f64, is_seen: bool) -> bool {
        let side = self.map.side;
        let wrapped = |place: f64| {
            let cell = floor(place);
            // One turn is enough for all but grids that are wider than the map.
            let cell = if cell < 0 {
                cell + side
            } else if cell >= side {
                cell - side
            } else {
                cell
            };
            if (0..side).contains(&cell) {
                cell
            } else {
                cell.rem_euclid(side)
            }
        };
        let slot = self.map.slot_of_wrapped((
            wrapped(self.place.0 + self.along.0 * x_m - self.along.1 * y_m),
            wrapped(self.place.1 + self.along.1 * x_m + self.along.0 * y_m),
        ));
        if is_seen {
            self.map.values[slot] = self.sweep;
        }
        is_seen || self.map.values[slot] >= self.first_sweep
    }
}
