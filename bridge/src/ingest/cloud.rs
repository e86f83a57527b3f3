//! `sensor_msgs/PointCloud2` by its declared fields.

use nalgebra::Isometry3;

use crate::Error;
use crate::msg::Message;
use crate::msg::sensor::{PointCloud2, PointField};

/// Most points of a cloud.
pub const MAX_POINTS: usize = 4_000_000;
/// Points nearer to the sensor are its housing, or the zeros that stand for no return, metres.
const MIN_RANGE_M: f32 = 0.3;
/// Points farther from the sensor are not taken for points, metres.
const MAX_RANGE_M: f32 = 1000.0;

/// A point, metres.
pub type Point = [f32; 3];

/// The cloud's points in another frame. Points that are not finite, at the sensor or absurdly far
/// are left out.
///
/// The layout is taken from the fields, whatever their offsets, types, order and company; x, y and z
/// may be of any of the eight types, in either byte order. Where the data are as long as all points
/// together, they lie one behind the other, whatever `row_step` says; [`oddity_of`] tells of that.
///
/// # Errors
/// [`Error::InvalidMessage`] says which field is missing or reaches beyond its point, or how many
/// bytes the sizes need and how many there are.
pub fn points_of(
    cloud: &PointCloud2,
    frame_from_sensor: &Isometry3<f64>,
) -> Result<Vec<Point>, Error> {
    let layout = Layout::of(cloud)?;
    let place = Place::of(frame_from_sensor);
    let mut points = Vec::with_capacity(layout.count());
    let step = cloud.point_step as usize;
    for row in 0..layout.rows {
        let from = row * layout.row_bytes;
        let bytes = &cloud.data[from..from + layout.points_a_row * step];
        if layout.is_plain(cloud.is_bigendian) {
            let [x, y, z] = layout.offsets;
            points.extend(bytes.chunks_exact(step).filter_map(|point| {
                place.put([float_at(point, x), float_at(point, y), float_at(point, z)])
            }));
        } else {
            points.extend(bytes.chunks_exact(step).filter_map(|point| {
                let number = |axis: usize| {
                    let (offset, kind) = (layout.offsets[axis], layout.kinds[axis]);
                    kind.read(&point[offset..offset + kind.len()], cloud.is_bigendian)
                };
                place.put([number(0), number(1), number(2)])
            }));
        }
    }
    Ok(points)
}

/// A rigid transform as plain numbers, for the loop over all points.
struct Place {
    rotation: [[f32; 3]; 3],
    translation: Point,
}

impl Place {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "f32 holds 60 m to within 4 micrometres"
    )]
    fn of(transform: &Isometry3<f64>) -> Self {
        let matrix = transform.rotation.to_rotation_matrix();
        let row = |r: usize| [0, 1, 2].map(|c| matrix[(r, c)] as f32);
        let shift = transform.translation.vector;
        Self {
            rotation: [row(0), row(1), row(2)],
            translation: [shift.x as f32, shift.y as f32, shift.z as f32],
        }
    }

    fn put(&self, [x, y, z]: Point) -> Option<Point> {
        let squared = x * x + y * y + z * z;
        // NaN is in no range.
        if !(MIN_RANGE_M * MIN_RANGE_M..=MAX_RANGE_M * MAX_RANGE_M).contains(&squared) {
            return None;
        }
        let along = |axis: usize| {
            let [a, b, c] = self.rotation[axis];
            a * x + b * y + c * z + self.translation[axis]
        };
        Some([along(0), along(1), along(2)])
    }
}

/// Where the coordinates lie in a cloud's bytes, checked against their number.
struct Layout {
    offsets: [usize; 3],
    kinds: [Kind; 3],
    rows: usize,
    points_a_row: usize,
    row_bytes: usize,
}

impl Layout {
    fn of(cloud: &PointCloud2) -> Result<Self, Error> {
        let (x, y, z) = (
            Self::field(cloud, "x")?,
            Self::field(cloud, "y")?,
            Self::field(cloud, "z")?,
        );
        let (rows, points_a_row) = (cloud.height as usize, cloud.width as usize);
        let count = rows
            .checked_mul(points_a_row)
            .filter(|count| *count <= MAX_POINTS);
        let Some(count) = count else {
            return Err(invalid(format!(
                "{rows} x {points_a_row} points, expected at most {MAX_POINTS}"
            )));
        };
        let row_bytes = row_bytes_of(cloud).ok_or_else(|| {
            invalid(format!(
                "{rows} x {points_a_row} points of {} bytes need {} bytes, found {} in rows of {}",
                cloud.point_step,
                count * cloud.point_step as usize,
                cloud.data.len(),
                cloud.row_step
            ))
        })?;
        Ok(Self {
            offsets: [x.0, y.0, z.0],
            kinds: [x.1, y.1, z.1],
            rows: if count == 0 { 0 } else { rows },
            points_a_row,
            row_bytes,
        })
    }

    fn field(cloud: &PointCloud2, name: &str) -> Result<(usize, Kind), Error> {
        let Some(field) = cloud.fields.iter().find(|field| field.name == name) else {
            let found: Vec<&str> = cloud
                .fields
                .iter()
                .take(32)
                .map(|f| f.name.as_str())
                .collect();
            return Err(invalid(format!("no field {name:?} among {found:?}")));
        };
        let Some(kind) = Kind::of(field.datatype) else {
            return Err(invalid(format!(
                "field {name:?} has datatype {}, expected 1 to 8",
                field.datatype
            )));
        };
        let end = field.offset as usize + kind.len();
        if end > cloud.point_step as usize {
            return Err(invalid(format!(
                "field {name:?} ends at byte {end} of a point of {} bytes",
                cloud.point_step
            )));
        }
        Ok((field.offset as usize, kind))
    }

    const fn count(&self) -> usize {
        self.rows * self.points_a_row
    }

    fn is_plain(&self, is_bigendian: bool) -> bool {
        !is_bigendian && self.kinds == [Kind::F32; 3]
    }
}

/// Bytes from the beginning of a row of points to that of the next one; `None` if there are too few for
/// all points.
fn row_bytes_of(cloud: &PointCloud2) -> Option<usize> {
    let (rows, len) = (cloud.height as usize, cloud.data.len());
    let packed = (cloud.width as usize).checked_mul(cloud.point_step as usize)?;
    let all = packed.checked_mul(rows)?;
    let claimed = cloud.row_step as usize;
    if all == 0 || all == len || rows <= 1 {
        return (all <= len).then_some(packed);
    }
    let reaches = |row_bytes: usize| {
        let needed = row_bytes.checked_mul(rows - 1)?.checked_add(packed)?;
        (row_bytes >= packed && needed <= len).then_some(row_bytes)
    };
    // Rows may be padded. Where they say so wrongly, the data's length tells.
    reaches(claimed).or_else(|| len.is_multiple_of(rows).then(|| reaches(len / rows))?)
}

/// What is odd about a cloud that can be read all the same.
pub fn oddity_of(cloud: &PointCloud2) -> Option<String> {
    let row_bytes = row_bytes_of(cloud)?;
    let is_odd = cloud.height > 1 && row_bytes != cloud.row_step as usize;
    is_odd.then(|| {
        format!(
            "row_step is {}, expected {row_bytes}: the length of the data decides",
            cloud.row_step
        )
    })
}

fn invalid(what: String) -> Error {
    Error::InvalidMessage {
        type_name: PointCloud2::TYPE_NAME,
        what,
    }
}

fn float_at(point: &[u8], offset: usize) -> f32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&point[offset..offset + 4]);
    f32::from_le_bytes(bytes)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn of(datatype: u8) -> Option<Self> {
        Some(match datatype {
            PointField::INT8 => Self::I8,
            PointField::UINT8 => Self::U8,
            PointField::INT16 => Self::I16,
            PointField::UINT16 => Self::U16,
            PointField::INT32 => Self::I32,
            PointField::UINT32 => Self::U32,
            PointField::FLOAT32 => Self::F32,
            PointField::FLOAT64 => Self::F64,
            _ => return None,
        })
    }

    const fn len(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in a field's bytes.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "coordinates that f32 cannot hold exactly are farther off than any lidar sees"
    )]
    fn read(self, field: &[u8], is_bigendian: bool) -> f32 {
        let mut bytes = [0; 8];
        bytes[..field.len()].copy_from_slice(field);
        if is_bigendian {
            bytes[..field.len()].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => f32::from(i8::from_le_bytes([a])),
            Self::U8 => f32::from(a),
            Self::I16 => f32::from(i16::from_le_bytes([a, b])),
            Self::U16 => f32::from(u16::from_le_bytes([a, b])),
            Self::I32 => i32::from_le_bytes([a, b, c, d]) as f32,
            Self::U32 => u32::from_le_bytes([a, b, c, d]) as f32,
            Self::F32 => f32::from_le_bytes([a, b, c, d]),
            Self::F64 => f64::from_le_bytes(bytes) as f32,
        }
    }
}

#[cfg(test)]
mod tests;
