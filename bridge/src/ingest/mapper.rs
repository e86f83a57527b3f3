//! Sweeps in, occupancy grids out: the map that a vehicle has of its surroundings.

use super::beams::Beams;
use super::cloud::Point;
use super::config::IngestConfig;
use super::evidence::{Evidence, Limits, MAX_COORDINATE_M, Return};
use super::ground::Ground;
use super::polar::{BIN_M, Polar};
use super::scan::BeamEnd;
use crate::Error;
use crate::geometry::{Cell, Pose2};
use crate::occupancy::{FREE, OCCUPIED, Occupancy, UNKNOWN};

/// Sectors between two axes for the beams of a 3D sweep.
const SWEEP_SECTORS: usize = 200;
/// Sectors between two axes for the beams of a scan; there are fewer where its beams are sparse.
const SCAN_SECTORS: std::ops::RangeInclusive<usize> = 8..=200;
/// Farthest from the vehicle that anything is kept, metres.
const MAX_RADIUS_M: f64 = 250.0;
/// Cells of hits along the side of a cell of the grid.
const HITS_A_CELL: f64 = 2.0;
/// Height that hits of a planar scan are taken to have, metres: its beams are at height 0, so any of
/// them clears.
const SCAN_TOP_M: f32 = 1.0;
/// Returns that one of a scan counts for if its neighbours ended near by.
const JOINED_WEIGHT: u16 = 1000;
/// How far apart returns of neighbouring beams are joined, metres, and in widths of a beam besides.
const JOINED_M: f32 = 0.3;
/// See above.
const JOINED_BEAMS: f32 = 3.0;
/// Where the ground was not seen, returns this much of the least height apart, one above the other,
/// stand on it all the same.
const UPRIGHT_PART: f32 = 0.8;

/// Most sensors whose sweeps make one map.
pub const MAX_SENSORS: usize = 8;

/// The map that a vehicle has of its surroundings, from the sweeps of the last seconds of one sensor or
/// of several.
///
/// Poses are in any frame that does not move; a jump in it needs a [`Mapper::clear`].
#[derive(Debug)]
pub struct Mapper {
    config: IngestConfig,
    evidence: Evidence,
    radius_m: f64,
    /// What each sensor sees, by its number.
    views: Vec<View>,
    /// Number of the sensor whose sweeps are being added.
    sensor: usize,
    sweep: Sweep,
    returns: Vec<Return>,
}

/// What a sensor saw last.
#[derive(Debug, Default)]
struct View {
    own: Own,
    beams: Option<Beams>,
    ground: Option<Ground>,
    /// Sector and bin of each cell of the grid.
    cell_places: Vec<(u16, u16)>,
    /// Cells on which the newest sweep saw the ground.
    is_ground: Vec<bool>,
    /// Least slope of the beams that end in a bin.
    lowest_slope: Vec<f32>,
}

/// The rectangle in which returns are the vehicle's own.
#[derive(Debug, Clone, Copy, Default)]
#[expect(clippy::struct_field_names, reason = "the names end in their unit")]
struct Own {
    rear_m: f32,
    front_m: f32,
    half_width_m: f32,
}

impl Own {
    fn has(&self, x_m: f32, y_m: f32) -> bool {
        x_m >= -self.rear_m && x_m <= self.front_m && y_m.abs() <= self.half_width_m
    }
}

/// Working memory of one sweep, kept between sweeps.
#[derive(Debug, Default)]
struct Sweep {
    points: Vec<Point>,
    /// Sector and bin of each point.
    places: Vec<(u16, u16)>,
    /// Lowest and highest return of each cell of the grid below the greatest height.
    extents_m: Vec<(f32, f32)>,
}

impl Mapper {
    /// A map that nothing is known of yet.
    ///
    /// # Errors
    /// As [`IngestConfig::validate`].
    pub fn new(config: &IngestConfig) -> Result<Self, Error> {
        config.validate()?;
        let spec = &config.spec;
        let (far_x, far_y) = spec.centre_of(Cell::new(0, 0));
        let (near_x, near_y) = spec.centre_of(spec.cell_of_index(spec.len() - 1));
        let corner_m = libm::hypot(far_x.max(-near_x), far_y.max(-near_y));
        let radius_m = (corner_m + 2.0 * spec.resolution_m).min(MAX_RADIUS_M);
        let limits = Limits {
            travel_m: config.accumulate_m,
            radius_m,
            hit_cell_m: spec.resolution_m / HITS_A_CELL,
            free_cell_m: spec.resolution_m,
        };
        Ok(Self {
            config: config.clone(),
            evidence: Evidence::new(limits),
            radius_m,
            views: vec![View::default()],
            sensor: 0,
            sweep: Sweep::default(),
            returns: Vec::new(),
        })
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.evidence.clear();
        for view in &mut self.views {
            view.beams = None;
            view.ground = None;
        }
    }

    /// Says whose sweeps are added from now on: that of the sensor with this number. Numbers begin at 0,
    /// and those from [`MAX_SENSORS`] on share one place. Without this there is one sensor.
    pub fn select(&mut self, sensor: usize) {
        self.sensor = sensor.min(MAX_SENSORS - 1);
        if self.views.len() <= self.sensor {
            self.views.resize_with(self.sensor + 1, View::default);
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "at most MAX_SENSORS")]
    fn begin_sweep(&mut self, age_s: f64, odom_from_vehicle: &Pose2, stamp_nanos: u64) {
        self.evidence.set_sensor(self.sensor as u8, age_s);
        self.evidence.begin(odom_from_vehicle, stamp_nanos);
    }

    /// Adds a sweep of a 3D lidar: its points and the sensor's place in the vehicle frame, the
    /// vehicle's pose, and when that was.
    ///
    /// # Errors
    /// [`Error::InvalidPose`] if the pose is not finite or absurdly far from its origin.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "configured lengths are small"
    )]
    pub fn add_points(
        &mut self,
        points: &[Point],
        sensor: Point,
        odom_from_vehicle: &Pose2,
        stamp_nanos: u64,
    ) -> Result<(), Error> {
        check_pose(odom_from_vehicle)?;
        let margin_m = self.config.own_margin_m;
        self.views[self.sensor].own = Own {
            rear_m: (self.config.vehicle.rear_m + margin_m) as f32,
            front_m: (self.config.vehicle.front_m + margin_m) as f32,
            half_width_m: (self.config.vehicle.half_width_m + margin_m) as f32,
        };
        self.look_from((sensor[0], sensor[1]), SWEEP_SECTORS);
        self.begin_sweep(self.config.accumulate_s, odom_from_vehicle, stamp_nanos);
        self.locate(points, sensor);
        self.find_returns(sensor);
        self.finish_sweep();
        Ok(())
    }

    /// Adds a planar scan: where its beams ended and the sensor's place in the vehicle frame, the
    /// vehicle's pose, and when that was. The angle between two beams sets how sure it can be that
    /// nothing stands between them.
    ///
    /// # Errors
    /// [`Error::InvalidPose`] if the pose is not finite or absurdly far from its origin.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "configured lengths are small, and the number of sectors is clamped"
    )]
    pub fn add_scan(
        &mut self,
        (ends, step_rad): (&[BeamEnd], f32),
        sensor: (f32, f32),
        odom_from_vehicle: &Pose2,
        stamp_nanos: u64,
    ) -> Result<(), Error> {
        check_pose(odom_from_vehicle)?;
        let own_m = self.config.own_scan_m as f32;
        self.views[self.sensor].own = Own {
            rear_m: own_m,
            front_m: own_m,
            half_width_m: own_m,
        };
        // A sector is between two and four beams wide on average, so that each has at least one.
        let sectors = (std::f32::consts::FRAC_PI_4 / step_rad.abs().max(1e-6)) as usize;
        self.look_from(
            sensor,
            sectors.clamp(*SCAN_SECTORS.start(), *SCAN_SECTORS.end()),
        );
        self.begin_sweep(
            self.config.accumulate_scans_s,
            odom_from_vehicle,
            stamp_nanos,
        );
        self.returns.clear();
        let view = &mut self.views[self.sensor];
        view.is_ground.fill(false);
        if let Some(beams) = &mut view.beams {
            let apart_a_m = JOINED_BEAMS * step_rad.abs();
            let mut reach_m = vec![f32::INFINITY; beams.polar.sectors()];
            for (number, end) in ends.iter().enumerate() {
                if view.own.has(end.x_m, end.y_m) {
                    continue;
                }
                let (sector, _, range_m) = beams.polar.locate(end.x_m, end.y_m);
                reach_m[sector] = reach_m[sector].min(range_m);
                if end.is_hit {
                    self.returns.push(Return {
                        x_m: end.x_m,
                        y_m: end.y_m,
                        top_m: SCAN_TOP_M,
                        weight: if is_joined(ends, number, apart_a_m * range_m) {
                            JOINED_WEIGHT
                        } else {
                            1
                        },
                    });
                }
            }
            for reach_m in &mut reach_m {
                *reach_m = if reach_m.is_finite() { *reach_m } else { 0.0 };
            }
            beams.set_scan(&reach_m);
        }
        self.finish_sweep();
        Ok(())
    }

    /// The map as it is now, in the vehicle frame at the newest sweep.
    ///
    /// A cell is occupied where returns of the last seconds lie, free where beams passed or the
    /// vehicle stands, and unknown else.
    pub fn occupancy(&mut self) -> Occupancy {
        let spec = self.config.spec;
        let mut occupancy = Occupancy::filled(spec, UNKNOWN);
        if self.views[self.sensor].beams.is_none() {
            return occupancy;
        }
        self.pass_free(|index| occupancy.cells[index] = FREE);
        let mut returns = vec![0u32; spec.len()];
        let cells = CellFinder::of(&spec);
        self.evidence.each_hit(|x_m, y_m, count| {
            if let Some(index) = cells.index_of(x_m, y_m) {
                returns[index] = u32::saturating_add(returns[index], count);
            }
        });
        for index in (0..returns.len()).filter(|index| returns[*index] > 0) {
            let cell = spec.cell_of_index(index);
            let around: u32 = (cell.row - 1..=cell.row + 1)
                .flat_map(|row| (cell.col - 1..=cell.col + 1).map(move |col| Cell::new(row, col)))
                .filter_map(|cell| spec.index_of(cell))
                .map(|index| returns[index])
                .sum();
            if around >= self.config.min_returns {
                occupancy.cells[index] = OCCUPIED;
            }
        }
        occupancy
    }

    /// Notes what the newest sweep saw to be free, for maps to come. [`Mapper::occupancy`] does so by
    /// itself.
    pub fn note_free(&mut self) {
        self.pass_free(|_| ());
    }

    /// Notes which cells the newest sweep saw to be free, and calls with each cell that counts as free.
    fn pass_free(&mut self, mut take: impl FnMut(usize)) {
        let spec = self.config.spec;
        let view = &self.views[self.sensor];
        let Some(beams) = &view.beams else { return };
        #[expect(
            clippy::cast_possible_truncation,
            reason = "configured lengths are small"
        )]
        let max_height_m = self.config.max_height_m as f32;
        let mut free = self.evidence.free_space();
        for (index, &(sector, bin)) in view.cell_places.iter().enumerate() {
            let lowest_m = beams.height_m(usize::from(sector), usize::from(bin));
            let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
            #[expect(clippy::cast_possible_truncation, reason = "a cell of the grid")]
            let is_own = view.own.has(x_m as f32, y_m as f32);
            let is_seen = lowest_m < max_height_m || view.is_ground[index] || is_own;
            if free.note(x_m, y_m, is_seen) {
                take(index);
            }
        }
    }

    /// Makes ready for beams from a place; where it is the one of the last sweep this does nothing.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "radius and grid are limited"
    )]
    fn look_from(&mut self, origin_m: (f32, f32), sectors_a_quadrant: usize) {
        let offset_m = f64::from((origin_m.0 * origin_m.0 + origin_m.1 * origin_m.1).sqrt());
        let reach_m = (self.radius_m + offset_m).min(2.0 * MAX_RADIUS_M);
        let bins = (reach_m / f64::from(BIN_M)) as usize + 4;
        let polar = Polar {
            origin_m,
            sectors_a_quadrant,
            bins,
        };
        let view = &mut self.views[self.sensor];
        if view
            .beams
            .as_ref()
            .is_some_and(|beams| beams.polar == polar)
        {
            return;
        }
        let spec = &self.config.spec;
        view.is_ground.resize(spec.len(), false);
        view.cell_places = (0..spec.len())
            .map(|index| {
                let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
                let (sector, bin, _) = polar.locate(x_m as f32, y_m as f32);
                (sector as u16, bin as u16)
            })
            .collect();
        view.beams = Some(Beams::new(polar));
        view.ground = Some(Ground::new(&polar));
        view.lowest_slope = vec![f32::INFINITY; polar.len()];
    }

    /// Keeps the points that are not the vehicle's own, each with its sector and bin.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "sectors, bins and configured lengths are limited"
    )]
    fn locate(&mut self, points: &[Point], sensor: Point) {
        let view = &mut self.views[self.sensor];
        let Some(beams) = &view.beams else { return };
        let (polar, own, sweep) = (beams.polar, view.own, &mut self.sweep);
        sweep.points.clear();
        sweep.places.clear();
        view.lowest_slope.fill(f32::INFINITY);
        let own_range_m = self.config.own_range_m as f32;
        for point in points.iter().filter(|point| !own.has(point[0], point[1])) {
            let (sector, bin, range_m) = polar.locate(point[0], point[1]);
            let up_m = point[2] - sensor[2];
            if range_m * range_m + up_m * up_m < own_range_m * own_range_m {
                continue;
            }
            let slope = up_m / range_m.max(f32::EPSILON);
            let lowest = &mut view.lowest_slope[sector * polar.bins + bin];
            *lowest = lowest.min(slope);
            sweep.points.push(*point);
            sweep.places.push((sector as u16, bin as u16));
        }
    }

    /// Parts the sweep's points into ground, obstacles and what hangs above.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "configured lengths are small"
    )]
    fn find_returns(&mut self, sensor: Point) {
        let view = &mut self.views[self.sensor];
        let (Some(beams), Some(ground)) = (&mut view.beams, &mut view.ground) else {
            return;
        };
        let config = &self.config;
        let (min_m, max_m) = (config.min_height_m as f32, config.max_height_m as f32);
        let sweep = &mut self.sweep;
        ground.find(
            &sweep.points,
            &sweep.places,
            (sensor, config.max_slope as f32),
        );
        beams.set_sweep(&mut view.lowest_slope, sensor[2], |sector, bin| {
            ground.height_m(ground.index(sector, bin))
        });
        let cells = CellFinder::of(&config.spec);
        view.is_ground.fill(false);
        sweep.extents_m.clear();
        sweep
            .extents_m
            .resize(config.spec.len(), (f32::INFINITY, f32::NEG_INFINITY));
        let height_of = |point: &Point, place: &(u16, u16)| {
            let index = ground.index(usize::from(place.0), usize::from(place.1));
            (point[2] - ground.height_m(index), ground.doubt_m(index))
        };
        for (point, place) in sweep.points.iter().zip(&sweep.places) {
            let (height_m, doubt_m) = height_of(point, place);
            if height_m < max_m
                && let Some(index) = cells.index_of(point[0], point[1])
            {
                let (low_m, high_m) = &mut sweep.extents_m[index];
                (*low_m, *high_m) = (low_m.min(point[2]), high_m.max(point[2]));
                view.is_ground[index] |= doubt_m == 0.0 && height_m < min_m;
            }
        }
        self.returns.clear();
        for (point, place) in sweep.points.iter().zip(&sweep.places) {
            let (height_m, doubt_m) = height_of(point, place);
            if height_m < min_m || height_m >= max_m {
                continue;
            }
            let (low_m, high_m) = cells.extent_around(point, &sweep.extents_m);
            if height_m >= min_m + doubt_m || high_m - low_m >= UPRIGHT_PART * min_m {
                // The top of the whole thing: the lowest line alone would set a low one, which no
                // other beam passes below.
                let top_m = height_m + (high_m - point[2]).max(0.0);
                self.returns.push(Return {
                    x_m: point[0],
                    y_m: point[1],
                    top_m,
                    weight: 1,
                });
            }
        }
    }

    fn finish_sweep(&mut self) {
        self.evidence.add_returns(&self.returns);
        let view = &self.views[self.sensor];
        if let Some(beams) = &view.beams {
            let own = view.own;
            self.evidence
                .drop_stale(beams, |x_m, y_m| own.has(x_m, y_m));
        }
    }
}

/// Whether one of the two beams to either side ended near a beam's end: what is joined is no noise,
/// however sparse the beams are.
fn is_joined(ends: &[BeamEnd], number: usize, apart_m: f32) -> bool {
    let end = &ends[number];
    let most_m = JOINED_M + apart_m;
    let around = &ends[number.saturating_sub(2)..(number + 3).min(ends.len())];
    let near = around.iter().filter(|other| {
        let (dx, dy) = (other.x_m - end.x_m, other.y_m - end.y_m);
        other.is_hit && dx * dx + dy * dy <= most_m * most_m
    });
    // The beam itself is one of them.
    near.count() > 1
}

fn check_pose(pose: &Pose2) -> Result<(), Error> {
    let is_near = pose.x_m.abs() <= MAX_COORDINATE_M && pose.y_m.abs() <= MAX_COORDINATE_M;
    if pose.is_finite() && is_near {
        Ok(())
    } else {
        Err(Error::InvalidPose { pose: *pose })
    }
}

/// Cells of the grid by point, in single precision for the loop over all points.
struct CellFinder {
    cells_a_m: f32,
    ego: (f32, f32),
    rows: usize,
    cols: usize,
}

impl CellFinder {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 4096 cells a side"
    )]
    fn of(spec: &crate::GridSpec) -> Self {
        Self {
            cells_a_m: (1.0 / spec.resolution_m) as f32,
            ego: (spec.ego_row as f32 + 0.5, spec.ego_col as f32 + 0.5),
            rows: spec.rows as usize,
            cols: spec.cols as usize,
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "negative numbers are excluded, and the cast saturates"
    )]
    fn index_of(&self, x_m: f32, y_m: f32) -> Option<usize> {
        let row = self.ego.0 - x_m * self.cells_a_m;
        let col = self.ego.1 - y_m * self.cells_a_m;
        if !(row >= 0.0 && col >= 0.0) {
            return None;
        }
        let (row, col) = (row as usize, col as usize);
        (row < self.rows && col < self.cols).then(|| row * self.cols + col)
    }

    /// Lowest and highest return in the point's cell and the eight around it, metres.
    fn extent_around(&self, point: &Point, extents_m: &[(f32, f32)]) -> (f32, f32) {
        let (mut low_m, mut high_m) = (point[2], point[2]);
        let Some(index) = self.index_of(point[0], point[1]) else {
            return (low_m, high_m);
        };
        let (row, col) = (index / self.cols, index % self.cols);
        let cols = col.saturating_sub(1)..(col + 2).min(self.cols);
        for row in row.saturating_sub(1)..(row + 2).min(self.rows) {
            for (low, high) in &extents_m[row * self.cols..][cols.clone()] {
                (low_m, high_m) = (low_m.min(*low), high_m.max(*high));
            }
        }
        (low_m, high_m)
    }
}

#[cfg(test)]
mod tests;
