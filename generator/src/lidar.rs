//! What a lidar on the vehicle sees of a scene: first returns, occlusion, range noise, drop-outs,
//! the accumulation of the last seconds.
//!
//! Every sweep is a depth buffer over angles: each piece of an outline is drawn into the rays that
//! it covers, and a ray keeps the nearest. Low things are seen from near only and hide nothing. The
//! returns of what moved are dropped where a newer ray has passed, as an accumulation with ray casting does;
//! returns of what stands still never are.

use swath_bridge::{FREE, GridSpec, OCCUPIED, Occupancy, Pose2, UNKNOWN, Vehicle};

use crate::config::LidarConfig;
use crate::dice::{Dice, bell_of};
use crate::scene::{Moment, Mover, footprint};
use crate::shape::{Height, Segment, Solid};

/// Returns closer to the sensor than this are the vehicle's own, metres.
const NEAREST_M: f64 = 0.3;
/// A cell counts as seen free when a ray has passed at least this far beyond its centre, metres.
const BEYOND_M: f64 = 0.3;
/// Ground is known to be free no farther than this, metres: beyond, rings lie too far apart.
const FREE_RANGE_M: f64 = 40.0;

/// What a lidar looks at, all in the vehicle's frame of now.
#[derive(Debug, Clone, Copy)]
pub struct World<'a> {
    /// What stands still.
    pub solids: &'a [Solid],
    /// What moves.
    pub movers: &'a [Mover],
    /// Centres of cells that are known to be occupied, such as those of a log's grid. They hide
    /// what is behind them and are not seen again.
    pub blockers: &'a [[f64; 2]],
    /// The vehicle's way, oldest first; the last moment is now.
    pub trail: &'a [Moment],
}

/// A lidar of one configuration.
#[derive(Debug)]
pub struct Lidar {
    config: LidarConfig,
    spec: GridSpec,
    vehicle: Vehicle,
    step_rad: f64,
    /// Cosine and sine of each ray against the first one.
    rays: Vec<[f64; 2]>,
}

/// What a ray hit first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hit {
    Nothing,
    Still,
    Moving,
    Blocker,
}

/// A piece of an outline with what it belongs to.
#[derive(Debug, Clone, Copy)]
struct Piece {
    segment: Segment,
    height: Height,
}

/// One sweep's depth buffer.
struct Sweep {
    sensor: [f64; 2],
    /// Angle of the first ray.
    phase_rad: f64,
    /// Cosine and sine of the first ray.
    turn: [f64; 2],
    range_m: Vec<f64>,
    hit: Vec<Hit>,
    /// The nearest low thing on each ray.
    low_m: Vec<f64>,
    /// How far each ray is known to have passed; negative when it gave no return.
    seen_m: Vec<f64>,
}

impl Lidar {
    /// A lidar on a vehicle whose map has the given grid.
    pub fn new(config: &LidarConfig, spec: &GridSpec, vehicle: &Vehicle) -> Self {
        let step_rad = std::f64::consts::TAU / f64::from(config.rays);
        let rays = (0..config.rays)
            .map(|ray| libm::sincos(f64::from(ray) * step_rad))
            .map(|(sin, cos)| [cos, sin])
            .collect();
        Self {
            config: config.clone(),
            spec: *spec,
            vehicle: *vehicle,
            step_rad,
            rays,
        }
    }

    /// The map that the sweeps along a trail add up to: occupied cells over cells that are not
    /// known. [`Self::look_around`] adds those that are known to be free.
    pub(crate) fn look(&self, world: &World<'_>, dice: &mut Dice) -> Occupancy {
        self.accumulate(world, dice).0
    }

    /// The same with the cells that rays of the sweeps have passed marked free.
    pub(crate) fn look_around(&self, world: &World<'_>, dice: &mut Dice) -> Occupancy {
        let (mut map, sweeps) = self.accumulate(world, dice);
        // The way that the vehicle came lies under it, where no ray goes.
        for index in 0..map.cells.len() {
            if map.cells[index] != UNKNOWN {
                continue;
            }
            let (x_m, y_m) = self.spec.centre_of(self.spec.cell_of_index(index));
            let was_passed = sweeps
                .iter()
                .rev()
                .any(|sweep| self.passes(sweep, [x_m, y_m], BEYOND_M, FREE_RANGE_M));
            let was_driven_on = world
                .trail
                .iter()
                .any(|moment| footprint(&self.vehicle, &moment.pose).holds([x_m, y_m]));
            if was_passed || was_driven_on {
                map.cells[index] = FREE;
            }
        }
        map
    }

    fn accumulate(&self, world: &World<'_>, dice: &mut Dice) -> (Occupancy, Vec<Sweep>) {
        let pieces = self.pieces_in_view(world.solids);
        let mut map = Occupancy::filled(self.spec, UNKNOWN);
        let mut sweeps = Vec::with_capacity(world.trail.len());
        let mut moving: Vec<(usize, [f64; 2])> = Vec::new();
        for (index, moment) in world.trail.iter().enumerate() {
            let mut sweep = self.sweep_at(&moment.pose, dice);
            for piece in &pieces {
                self.cast(&mut sweep, &piece.segment, piece.height, Hit::Still);
            }
            for mover in world.movers {
                mover.shape_at(moment.time_s).outline(|segment| {
                    self.cast(&mut sweep, &segment, Height::Tall, Hit::Moving);
                });
            }
            for &point in world.blockers {
                self.block(&mut sweep, point);
            }
            self.collect(&mut sweep, dice, |hit, point| match hit {
                Hit::Moving => moving.push((index, point)),
                _ => map.set(self.spec.cell_at(point[0], point[1]), OCCUPIED),
            });
            sweeps.push(sweep);
        }
        for (index, point) in moving {
            let is_gone = sweeps[index + 1..]
                .iter()
                .rev()
                .any(|newer| self.passes(newer, point, self.config.clear_m, f64::INFINITY));
            if !is_gone {
                map.set(self.spec.cell_at(point[0], point[1]), OCCUPIED);
            }
        }
        self.clear_own_footprint(&mut map);
        (map, sweeps)
    }

    /// The outlines' pieces that may lie on the map. The sensor stands on it and the map is convex,
    /// so nothing beyond it can hide a part of it.
    fn pieces_in_view(&self, solids: &[Solid]) -> Vec<Piece> {
        const MARGIN_M: f64 = 1.0;
        let last = self.spec.cell_of_index(self.spec.len() - 1);
        let (front_m, left_m) = self.spec.centre_of(swath_bridge::Cell::new(0, 0));
        let (rear_m, right_m) = self.spec.centre_of(last);
        let mut pieces = Vec::new();
        for solid in solids {
            solid.shape.outline(|segment| {
                let ([ax, ay], [bx, by]) = (segment.from, segment.to);
                let misses = ax.max(bx) < rear_m - MARGIN_M
                    || ax.min(bx) > front_m + MARGIN_M
                    || ay.max(by) < right_m - MARGIN_M
                    || ay.min(by) > left_m + MARGIN_M;
                if !misses {
                    pieces.push(Piece {
                        segment,
                        height: solid.height,
                    });
                }
            });
        }
        pieces
    }

    fn sweep_at(&self, vehicle: &Pose2, dice: &mut Dice) -> Sweep {
        let sensor = vehicle.then(&Pose2::new(self.config.sensor_x_m, 0.0, 0.0));
        // The phase is arbitrary, so that sweeps from a standstill do not repeat one another.
        let phase_rad = dice.unit() * self.step_rad;
        let (sin, cos) = libm::sincos(phase_rad);
        let count = self.rays.len();
        Sweep {
            sensor: [sensor.x_m, sensor.y_m],
            phase_rad,
            turn: [cos, sin],
            range_m: vec![f64::INFINITY; count],
            hit: vec![Hit::Nothing; count],
            low_m: vec![f64::INFINITY; count],
            seen_m: Vec::new(),
        }
    }

    /// The direction of a ray of a sweep.
    fn direction(&self, sweep: &Sweep, ray: usize) -> [f64; 2] {
        let ([cos, sin], [x, y]) = (sweep.turn, self.rays[ray]);
        [cos * x - sin * y, sin * x + cos * y]
    }

    /// The number of the first ray at or behind an angle, counted on over full circles.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "angles come from atan2, so the number is at most a few circles of rays"
    )]
    fn first_ray(&self, sweep: &Sweep, angle_rad: f64) -> i64 {
        libm::ceil((angle_rad - sweep.phase_rad) / self.step_rad) as i64
    }

    /// Draws a piece of an outline into a sweep.
    fn cast(&self, sweep: &mut Sweep, segment: &Segment, height: Height, hit: Hit) {
        let [sx, sy] = sweep.sensor;
        let a = [segment.from[0] - sx, segment.from[1] - sy];
        let b = [segment.to[0] - sx, segment.to[1] - sy];
        // Positive when the piece runs counter-clockwise around the sensor.
        let cross = a[0] * b[1] - a[1] * b[0];
        if cross == 0.0 || (segment.one_sided && cross > 0.0) {
            return;
        }
        let (first, last) = if cross > 0.0 { (a, b) } else { (b, a) };
        let begin_rad = libm::atan2(first[1], first[0]);
        let mut end_rad = libm::atan2(last[1], last[0]);
        if end_rad < begin_rad {
            end_rad += std::f64::consts::TAU;
        }
        let along = [last[0] - first[0], last[1] - first[1]];
        let size = cross.abs();
        let count = i64::try_from(self.rays.len()).unwrap_or(i64::MAX);
        for number in self.first_ray(sweep, begin_rad)..self.first_ray(sweep, end_rad) {
            let ray = usize::try_from(number.rem_euclid(count)).unwrap_or(0);
            let [dx, dy] = self.direction(sweep, ray);
            let across = dx * along[1] - dy * along[0];
            let range_m = size / across;
            if !(range_m >= NEAREST_M && range_m <= self.config.max_range_m) {
                continue;
            }
            if height == Height::Low {
                sweep.low_m[ray] = sweep.low_m[ray].min(range_m);
            } else if range_m < sweep.range_m[ray] {
                sweep.range_m[ray] = range_m;
                sweep.hit[ray] = hit;
            }
        }
    }

    /// Draws a cell that is known to be occupied into a sweep.
    fn block(&self, sweep: &mut Sweep, point: [f64; 2]) {
        let (dx, dy) = (point[0] - sweep.sensor[0], point[1] - sweep.sensor[1]);
        let range_m = libm::hypot(dx, dy);
        if range_m < NEAREST_M {
            return;
        }
        let angle_rad = libm::atan2(dy, dx);
        let half_rad = 0.5 * self.spec.resolution_m / range_m;
        let count = i64::try_from(self.rays.len()).unwrap_or(i64::MAX);
        let begin = self.first_ray(sweep, angle_rad - half_rad);
        for number in begin..self.first_ray(sweep, angle_rad + half_rad) {
            let ray = usize::try_from(number.rem_euclid(count)).unwrap_or(0);
            if range_m < sweep.range_m[ray] {
                sweep.range_m[ray] = range_m;
                sweep.hit[ray] = Hit::Blocker;
            }
        }
    }

    /// Turns a sweep's depths into returns, and notes how far each ray has passed.
    fn collect(&self, sweep: &mut Sweep, dice: &mut Dice, mut found: impl FnMut(Hit, [f64; 2])) {
        let config = &self.config;
        let mut seen_m = Vec::with_capacity(self.rays.len());
        for ray in 0..self.rays.len() {
            let bits = dice.bits();
            // The low 48 bits make the noise; 16 bits are enough to decide on a drop-out.
            let noise_m = bell_of(bits) * config.noise_m;
            let lot = (bits >> 48) as f64 / 65_536.0;
            if lot < config.dropout {
                seen_m.push(-1.0);
                continue;
            }
            let [dx, dy] = self.direction(sweep, ray);
            let at = |range_m: f64| {
                [
                    sweep.sensor[0] + range_m * dx,
                    sweep.sensor[1] + range_m * dy,
                ]
            };
            let (range_m, low_m) = (sweep.range_m[ray], sweep.low_m[ray]);
            if low_m < range_m.min(config.low_range_m)
                && lot >= config.dropout + (1.0 - config.dropout) * config.low_dropout
            {
                found(Hit::Still, at(low_m + noise_m));
            }
            match sweep.hit[ray] {
                Hit::Nothing => seen_m.push(config.max_range_m),
                Hit::Blocker => seen_m.push(range_m),
                hit => {
                    found(hit, at(range_m + noise_m));
                    seen_m.push(range_m);
                }
            }
        }
        sweep.seen_m = seen_m;
    }

    /// Whether a ray of a sweep has passed a point by a margin.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "angles come from atan2, so the number is at most a circle of rays"
    )]
    fn passes(&self, sweep: &Sweep, point: [f64; 2], margin_m: f64, within_m: f64) -> bool {
        let (dx, dy) = (point[0] - sweep.sensor[0], point[1] - sweep.sensor[1]);
        let range_m = libm::hypot(dx, dy);
        if range_m > within_m {
            return false;
        }
        let turned = (libm::atan2(dy, dx) - sweep.phase_rad) / self.step_rad;
        let count = i64::try_from(self.rays.len()).unwrap_or(i64::MAX);
        let ray = (libm::floor(turned + 0.5) as i64).rem_euclid(count);
        let ray = usize::try_from(ray).unwrap_or(0);
        sweep.seen_m[ray] > range_m + margin_m
    }

    /// Frees the cells that the vehicle stands on: whatever was returned from there was the vehicle
    /// itself, or it could not have got here.
    fn clear_own_footprint(&self, map: &mut Occupancy) {
        let own = footprint(&self.vehicle, &Pose2::default()).grown(1.5 * self.spec.resolution_m);
        let far = self.spec.cell_at(own.front_m, own.half_width_m);
        let near = self.spec.cell_at(-own.rear_m, -own.half_width_m);
        for row in far.row..=near.row {
            for col in far.col..=near.col {
                map.set(swath_bridge::Cell::new(row, col), FREE);
            }
        }
    }
}

#[cfg(test)]
mod tests;
