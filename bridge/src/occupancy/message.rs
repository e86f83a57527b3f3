//! Occupancy to and from `nav_msgs/OccupancyGrid`.
//!
//! A message's index runs along x first and its origin is the corner of cell (0, 0), so its last
//! cell is row 0, column 0 of the vehicle's grid.

use super::resample::Source;
use super::{OCCUPIED, Occupancy, UNKNOWN};
use crate::Error;
use crate::geometry::{GridSpec, MAX_GRID_SIDE_CELLS};
use crate::msg::geometry::{Point, Pose, Quaternion};
use crate::msg::header::Header;
use crate::msg::nav::{MapMetaData, OccupancyGrid};

/// Most that an origin may be turned, as the length of its quaternion's vector part.
const MAX_TURN: f64 = 1e-4;

impl Occupancy {
    /// The message that says the same.
    pub fn to_message(&self, header: Header) -> OccupancyGrid {
        let spec = &self.spec;
        let (rows, cols) = (spec.rows as usize, spec.cols as usize);
        let mut data = Vec::with_capacity(spec.len());
        for col in (0..cols).rev() {
            data.extend((0..rows).rev().map(|row| self.cells[row * cols + col]));
        }
        let corner_m =
            |ego: u32, cells: u32| (f64::from(ego) - f64::from(cells) + 0.5) * spec.resolution_m;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the message type holds the resolution as f32"
        )]
        let resolution = spec.resolution_m as f32;
        OccupancyGrid {
            info: MapMetaData {
                map_load_time: header.stamp.clone(),
                resolution,
                width: spec.rows,
                height: spec.cols,
                origin: Pose {
                    position: Point {
                        x: corner_m(spec.ego_row, spec.rows),
                        y: corner_m(spec.ego_col, spec.cols),
                        z: 0.0,
                    },
                    orientation: Quaternion {
                        x: 0.0,
                        y: 0.0,
                        z: 0.0,
                        w: 1.0,
                    },
                },
            },
            header,
            data,
        }
    }

    /// What a message says on the grid of `spec`.
    ///
    /// Where the message's cells are those of `spec` this is exact. Else a cell is as occupied as the
    /// most occupied of the message's cells that it overlaps, and unknown if one of them is unknown
    /// and none is occupied. Cells that the message does not cover are unknown.
    ///
    /// # Errors
    /// [`Error::InvalidGrid`] says what about the message cannot be worked with: sizes that are zero,
    /// too large or do not fit the data, a resolution or origin that is not finite, a turned origin,
    /// values above 100.
    pub fn from_message(message: &OccupancyGrid, spec: &GridSpec) -> Result<Self, Error> {
        spec.validate()?;
        Ok(checked(message)?.resampled(spec))
    }

    /// What a message says on a grid of the message's own size and resolution.
    ///
    /// # Errors
    /// As [`Occupancy::from_message`], and where the vehicle's origin is off the grid.
    pub fn from_message_as_is(message: &OccupancyGrid) -> Result<Self, Error> {
        let source = checked(message)?;
        Ok(source.resampled(&source.own_spec()?))
    }
}

fn checked(message: &OccupancyGrid) -> Result<Source<'_>, Error> {
    let info = &message.info;
    let invalid = |what: String| Err(Error::InvalidGrid { what });
    let sides = 1..=MAX_GRID_SIDE_CELLS;
    if !sides.contains(&info.width) || !sides.contains(&info.height) {
        return invalid(format!(
            "{} x {} cells, expected 1 to {MAX_GRID_SIDE_CELLS} a side",
            info.width, info.height
        ));
    }
    let wanted = info.width as usize * info.height as usize;
    if message.data.len() != wanted {
        return invalid(format!(
            "{} x {} cells need {wanted} values, found {}",
            info.width,
            info.height,
            message.data.len()
        ));
    }
    if !(info.resolution >= 0.001 && info.resolution <= 100.0) {
        return invalid(format!(
            "resolution {} m, expected 0.001 to 100 m a cell",
            info.resolution
        ));
    }
    let Pose {
        position,
        orientation,
    } = &info.origin;
    if !(position.x.is_finite() && position.y.is_finite()) {
        return invalid(format!(
            "origin ({}, {}) is not finite",
            position.x, position.y
        ));
    }
    if !is_unturned(orientation) {
        return invalid(format!(
            "origin is turned (quaternion {} {} {} {}), expected axes along the vehicle's",
            orientation.x, orientation.y, orientation.z, orientation.w
        ));
    }
    if let Some(index) = message
        .data
        .iter()
        .position(|value| !(UNKNOWN..=OCCUPIED).contains(value))
    {
        return invalid(format!(
            "value {} at index {index}, expected -1 to 100",
            message.data[index]
        ));
    }
    Ok(Source {
        cells: &message.data,
        width: info.width,
        height: info.height,
        resolution_m: shortest_decimal(info.resolution),
        origin_m: (position.x, position.y),
    })
}

/// All zeros, which many publishers leave there, count as no turn.
fn is_unturned(orientation: &Quaternion) -> bool {
    let Quaternion { x, y, z, w } = orientation;
    let vector = [x, y, z].map(|part| part.abs());
    let all_zero = w.abs() == 0.0 && vector == [0.0; 3];
    all_zero
        || (w.is_finite() && w.abs() > 0.5 && vector.iter().all(|part| *part < MAX_TURN * w.abs()))
}

/// The number that was meant: 0.2 rather than the nearest f32 to it, 0.20000000298, whose error adds
/// up along a wide grid.
fn shortest_decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::super::FREE;
    use super::*;
    use crate::geometry::Cell;
    use proptest::prelude::*;

    fn grid() -> impl Strategy<Value = Occupancy> {
        (1u32..30, 1u32..30, 1u32..200)
            .prop_flat_map(|(rows, cols, centimetres)| {
                let cells = proptest::collection::vec(-1i8..=100, (rows * cols) as usize);
                (Just((rows, cols, centimetres)), 0..rows, 0..cols, cells)
            })
            .prop_map(
                |((rows, cols, centimetres), ego_row, ego_col, cells)| Occupancy {
                    spec: GridSpec {
                        rows,
                        cols,
                        resolution_m: f64::from(centimetres) / 100.0,
                        ego_row,
                        ego_col,
                    },
                    cells,
                },
            )
    }

    #[test]
    fn the_cell_ahead_and_to_the_left_is_the_messages_last() {
        let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
        occupancy.set(Cell::new(0, 0), OCCUPIED);
        let message = occupancy.to_message(Header::at(0, "base_link"));
        assert_eq!((message.info.width, message.info.height), (401, 151));
        assert_eq!(message.data.last(), Some(&OCCUPIED));
        assert_eq!(
            message
                .data
                .iter()
                .filter(|value| **value == OCCUPIED)
                .count(),
            1
        );
        assert!((message.info.origin.position.x - -20.1).abs() < 1e-9);
        assert!((message.info.origin.position.y - -15.1).abs() < 1e-9);
    }

    #[test]
    fn a_message_shifted_by_half_a_cell_keeps_every_obstacle() {
        let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
        occupancy.set(Cell::new(200, 75), OCCUPIED);
        let mut message = occupancy.to_message(Header::at(0, "base_link"));
        message.info.origin.position.x += 0.1;
        let shifted = Occupancy::from_message(&message, &GridSpec::default()).unwrap();
        let occupied: Vec<i32> = (0..401)
            .filter(|row| shifted.get(Cell::new(*row, 75)) == Some(OCCUPIED))
            .collect();
        assert_eq!(occupied, [199, 200]);
        assert_eq!(shifted.get(Cell::new(400, 0)), Some(FREE));
    }

    #[test]
    fn what_cannot_be_worked_with_is_named() {
        let good = Occupancy::filled(GridSpec::default(), FREE).to_message(Header::at(0, "b"));
        let spoilt = |spoil: &dyn Fn(&mut OccupancyGrid)| {
            let mut message = good.clone();
            spoil(&mut message);
            Occupancy::from_message(&message, &GridSpec::default())
                .unwrap_err()
                .to_string()
        };
        assert!(spoilt(&|m| m.data.truncate(7)).contains("found 7"));
        assert!(spoilt(&|m| m.info.width = u32::MAX).contains("a side"));
        assert!(spoilt(&|m| m.info.height = 0).contains("a side"));
        assert!(spoilt(&|m| m.info.resolution = f32::NAN).contains("resolution"));
        assert!(spoilt(&|m| m.info.origin.position.y = f64::INFINITY).contains("finite"));
        assert!(spoilt(&|m| m.info.origin.orientation.z = 0.2).contains("turned"));
        assert!(spoilt(&|m| m.data[3] = 101).contains("index 3"));
    }

    proptest! {
        #[test]
        fn a_message_says_the_same_again(occupancy in grid()) {
            let message = occupancy.to_message(Header::at(7, "base_link"));
            prop_assert_eq!(&Occupancy::from_message(&message, &occupancy.spec).unwrap(), &occupancy);
            prop_assert_eq!(Occupancy::from_message_as_is(&message).unwrap(), occupancy);
        }

        #[test]
        fn no_obstacle_is_lost_on_any_other_grid(
            occupancy in grid(),
            resolution_m in 0.05..3.0f64,
            (dx, dy) in (-2.0..2.0f64, -2.0..2.0f64),
        ) {
            let mut message = occupancy.to_message(Header::at(0, "base_link"));
            message.info.origin.position.x += dx;
            message.info.origin.position.y += dy;
            let spec = GridSpec { rows: 60, cols: 60, resolution_m, ego_row: 30, ego_col: 30 };
            let there = Occupancy::from_message(&message, &spec).unwrap();
            for (index, value) in occupancy.cells.iter().enumerate() {
                let (x_m, y_m) = occupancy.spec.centre_of(occupancy.spec.cell_of_index(index));
                if let Some(found) = there.get(spec.cell_at(x_m + dx, y_m + dy)) {
                    prop_assert!(*value < super::super::OCCUPIED_THRESHOLD || found >= *value);
                }
            }
        }
    }
}
