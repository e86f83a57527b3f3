use super::*;
use crate::msg::header::Header;
use proptest::prelude::*;

/// How a synthetic cloud is laid out.
#[derive(Debug, Clone, Copy)]
struct Form {
    datatype: u8,
    is_bigendian: bool,
    first_offset: u32,
    gap: u32,
    rows: u32,
    row_padding: u32,
}

const PLAIN: Form = Form {
    datatype: PointField::FLOAT32,
    is_bigendian: false,
    first_offset: 0,
    gap: 0,
    rows: 1,
    row_padding: 0,
};

fn encode(number: f64, datatype: u8, is_bigendian: bool) -> Vec<u8> {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the tests use small numbers"
    )]
    let mut bytes = match datatype {
        PointField::FLOAT64 => number.to_le_bytes().to_vec(),
        PointField::FLOAT32 => (number as f32).to_le_bytes().to_vec(),
        PointField::INT32 => (number as i32).to_le_bytes().to_vec(),
        PointField::INT16 => (number as i16).to_le_bytes().to_vec(),
        PointField::INT8 => (number as i8).to_le_bytes().to_vec(),
        other => panic!("no encoder for {other}"),
    };
    if is_bigendian {
        bytes.reverse();
    }
    bytes
}

fn field(name: &str, offset: u32, datatype: u8) -> PointField {
    PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    }
}

/// The points as a cloud of this form, with an intensity behind and a ring before the coordinates.
fn cloud(points: &[[f64; 3]], form: Form) -> PointCloud2 {
    let len = u32::try_from(encode(0.0, form.datatype, false).len()).unwrap();
    let pitch = len + form.gap;
    let point_step = form.first_offset + 3 * pitch + 4;
    let width = u32::try_from(points.len()).unwrap() / form.rows;
    let mut data = Vec::new();
    for row in points.chunks(width as usize) {
        for point in row {
            data.extend(vec![0xAA; form.first_offset as usize]);
            for number in point {
                data.extend(encode(*number, form.datatype, form.is_bigendian));
                data.extend(vec![0xBB; form.gap as usize]);
            }
            data.extend([0xCC; 4]);
        }
        data.extend(vec![0xDD; form.row_padding as usize]);
    }
    let at = |axis: u32| form.first_offset + axis * pitch;
    PointCloud2 {
        header: Header::at(0, "lidar"),
        height: form.rows,
        width,
        fields: vec![
            field(
                "intensity",
                3 * pitch + form.first_offset,
                PointField::FLOAT32,
            ),
            field("z", at(2), form.datatype),
            field("x", at(0), form.datatype),
            field("y", at(1), form.datatype),
        ],
        is_bigendian: form.is_bigendian,
        point_step,
        row_step: width * point_step + form.row_padding,
        data,
        is_dense: false,
    }
}

fn read(cloud: &PointCloud2) -> Result<Vec<Point>, Error> {
    points_of(cloud, &Isometry3::identity())
}

const POINTS: [[f64; 3]; 4] = [
    [1.0, 2.0, 3.0],
    [-4.0, 5.0, -6.0],
    [7.0, 0.0, 0.0],
    [0.0, -9.0, 1.0],
];
const READ: [Point; 4] = [
    [1.0, 2.0, 3.0],
    [-4.0, 5.0, -6.0],
    [7.0, 0.0, 0.0],
    [0.0, -9.0, 1.0],
];

#[test]
fn every_type_byte_order_and_layout_gives_the_same_points() {
    for datatype in [
        PointField::FLOAT32,
        PointField::FLOAT64,
        PointField::INT32,
        PointField::INT16,
        PointField::INT8,
    ] {
        for is_bigendian in [false, true] {
            for (first_offset, gap, rows, row_padding) in [(0, 0, 1, 0), (6, 3, 2, 5), (1, 0, 4, 0)]
            {
                let form = Form {
                    datatype,
                    is_bigendian,
                    first_offset,
                    gap,
                    rows,
                    row_padding,
                };
                assert_eq!(read(&cloud(&POINTS, form)).unwrap(), READ, "{form:?}");
            }
        }
    }
}

#[test]
fn points_that_are_none_are_left_out() {
    let points = [
        [f64::NAN, 1.0, 1.0],
        [1.0, f64::INFINITY, 0.0],
        [0.0; 3],
        [1e9, 0.0, 0.0],
        [5.0, 0.0, 0.0],
    ];
    assert_eq!(read(&cloud(&points, PLAIN)).unwrap(), [[5.0, 0.0, 0.0]]);
}

#[test]
fn a_mounting_turned_every_way_puts_points_where_they_are() {
    use nalgebra::{Point3, Translation3, UnitQuaternion};
    let frame_from_sensor = Isometry3::from_parts(
        Translation3::new(1.2, -0.3, 1.9),
        UnitQuaternion::from_euler_angles(0.1, -0.4, 2.0),
    );
    let found = points_of(&cloud(&POINTS, PLAIN), &frame_from_sensor).unwrap();
    for (found, [x, y, z]) in found.iter().zip(POINTS) {
        let wanted = frame_from_sensor * Point3::new(x, y, z);
        for axis in 0..3 {
            assert!((f64::from(found[axis]) - wanted[axis]).abs() < 1e-5);
        }
    }
}

#[test]
fn what_does_not_fit_is_named() {
    let good = cloud(&POINTS, Form { rows: 2, ..PLAIN });
    let spoilt = |spoil: &dyn Fn(&mut PointCloud2)| {
        let mut cloud = good.clone();
        spoil(&mut cloud);
        read(&cloud).unwrap_err().to_string()
    };
    assert!(spoilt(&|c| c.fields[2].name = "u".into()).contains("no field \"x\""));
    assert!(spoilt(&|c| c.fields[1].datatype = 9).contains("datatype 9"));
    assert!(spoilt(&|c| c.fields[1].offset = u32::MAX).contains("ends at byte 4294967299"));
    assert!(spoilt(&|c| c.point_step = 3).contains("of a point of 3 bytes"));
    assert!(spoilt(&|c| c.data.truncate(40)).contains("need 64 bytes, found 40"));
    assert!(spoilt(&|c| (c.width, c.height) = (u32::MAX, u32::MAX)).contains("at most"));
    assert!(spoilt(&|c| c.width = 1_000_000).contains("need 32000000 bytes, found 64"));
}

#[test]
fn the_length_of_the_data_decides_where_row_step_is_wrong() {
    let good = cloud(&POINTS, Form { rows: 2, ..PLAIN });
    assert_eq!(oddity_of(&good), None);
    let whole = u32::try_from(good.data.len()).unwrap();
    for row_step in [0, 1, 7, whole, whole + 1, u32::MAX] {
        let mut odd = good.clone();
        odd.row_step = row_step;
        assert_eq!(read(&odd).unwrap(), READ, "{row_step}");
        let said = oddity_of(&odd).unwrap();
        assert!(
            said.contains(&format!("row_step is {row_step}, expected")),
            "{said}"
        );
    }
    // Rows that are padded say so, or their number tells.
    let padded = Form {
        rows: 2,
        row_padding: 6,
        ..PLAIN
    };
    let mut odd = cloud(&POINTS, padded);
    assert_eq!(
        (read(&odd).unwrap(), oddity_of(&odd)),
        (READ.to_vec(), None)
    );
    for row_step in [0, u32::MAX] {
        odd.row_step = row_step;
        assert_eq!(read(&odd).unwrap(), READ);
        assert!(oddity_of(&odd).is_some());
    }
}

#[test]
fn a_cloud_without_points_is_no_error() {
    let mut empty = cloud(&POINTS, PLAIN);
    empty.width = 0;
    empty.row_step = 0;
    empty.data.clear();
    assert_eq!(read(&empty).unwrap(), Vec::<Point>::new());
    empty.height = 0;
    assert_eq!(read(&empty).unwrap(), Vec::<Point>::new());
}

proptest! {
    #[test]
    fn no_sizes_or_bytes_panic(
        (height, width) in (0u32..9, 0u32..9),
        (point_step, row_step) in (0u32..40, 0u32..300),
        fields in proptest::collection::vec((0usize..4, any::<u32>(), 0u32..40, any::<u8>()), 0..6),
        is_bigendian in any::<bool>(),
        data in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let fields = fields
            .iter()
            .map(|(name, far, near, datatype)| {
                let offset = if far % 7 == 0 { *far } else { *near };
                field(["x", "y", "z", "ring"][*name], offset, datatype % 10)
            })
            .collect();
        let cloud = PointCloud2 {
            header: Header::at(0, "lidar"),
            height, width, fields, is_bigendian, point_step, row_step, data,
            is_dense: true,
        };
        if let Ok(points) = read(&cloud) {
            prop_assert!(points.len() <= (height * width) as usize);
        }
    }
}
