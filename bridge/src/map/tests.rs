use super::*;
use crate::geometry::Cell;
use crate::occupancy::{FREE, OCCUPIED};

fn sketch() -> Occupancy {
    let spec = GridSpec {
        rows: 30,
        cols: 20,
        resolution_m: 0.5,
        ego_row: 22,
        ego_col: 9,
    };
    let mut occupancy = Occupancy::filled(spec, FREE);
    occupancy.set(Cell::new(0, 0), OCCUPIED);
    occupancy.set(Cell::new(3, 17), OCCUPIED);
    occupancy.set(Cell::new(29, 19), UNKNOWN);
    occupancy
}

#[test]
fn a_written_map_is_read_back_by_either_of_its_files() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.pgm");
    write_map(&path, &sketch()).unwrap();
    assert_eq!(read_map(&path, &GridSpec::default()).unwrap(), sketch());
    assert_eq!(
        read_map(&path.with_extension("yaml"), &GridSpec::default()).unwrap(),
        sketch()
    );
}

#[test]
fn a_picture_alone_has_the_vehicle_heading_up() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.pgm");
    let spec = GridSpec {
        rows: 2,
        cols: 3,
        resolution_m: 0.2,
        ego_row: 1,
        ego_col: 1,
    };
    std::fs::write(&path, b"P5 3 2 255\n\x00\xfe\xff\xfe\xfe\xcd").unwrap();
    let occupancy = read_map(&path, &spec).unwrap();
    assert_eq!(occupancy.cells, [OCCUPIED, FREE, FREE, FREE, FREE, UNKNOWN]);
    let error = read_map(&path, &GridSpec::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("3 x 2 pixels, expected 151 x 401"),
        "{error}"
    );
}

#[test]
fn a_map_whose_origin_is_elsewhere_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.yaml");
    std::fs::write(directory.path().join("m.pgm"), b"P2 1 1 255 0").unwrap();
    std::fs::write(
        &path,
        "image: m.pgm\nresolution: 0.1\norigin: [5.0, 0.0, 0.0]\n",
    )
    .unwrap();
    let error = read_map(&path, &GridSpec::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("map.yaml") && error.contains("off the grid"),
        "{error}"
    );
}

/// A map of 4 x 3 pixels of 0.5 m, free but for the second pixel of its lowest row.
fn small(folder: &Path, image: &str, origin: &str) -> Map {
    let pgm = Pgm {
        width: 4,
        height: 3,
        pixels: vec![254, 254, 254, 254, 254, 254, 254, 254, 254, 0, 254, 254],
    };
    std::fs::write(folder.join("m.pgm"), pgm.to_bytes()).unwrap();
    let text = format!("image: {image}\nresolution: 0.5\norigin: {origin}\n");
    std::fs::write(folder.join("map.yml"), text).unwrap();
    Map::read(&folder.join("map.yml"), &GridSpec::default()).unwrap()
}

fn occupied_in_map(around: &Around) -> Vec<Pose2> {
    let spec = &around.occupancy.spec;
    let cells = (0..spec.len()).filter(|&index| around.occupancy.cells[index] == OCCUPIED);
    let centres = cells.map(|index| spec.centre_of(spec.cell_of_index(index)));
    let in_map = |(x_m, y_m)| around.map_from_grid.then(&Pose2::new(x_m, y_m, 0.0));
    centres.map(in_map).collect()
}

#[test]
fn a_turned_map_keeps_its_cells_where_its_origin_puts_them() {
    let folder = tempfile::tempdir().unwrap();
    let map = small(folder.path(), "m.pgm", "[10, 20, 0.5]");
    // The pixel's centre is 0.75 m along the turned x and 0.25 m along the turned y.
    let (sin, cos) = libm::sincos(0.5);
    let wanted = Pose2::new(
        10.0 + 0.75 * cos - 0.25 * sin,
        20.0 + 0.75 * sin + 0.25 * cos,
        0.0,
    );
    let start = Pose2::new(10.5, 21.0, -2.0);
    let around = map.around(&start).unwrap();
    let found = occupied_in_map(&around);
    assert_eq!(found.len(), 1);
    assert!(found[0].distance_m(&wanted) < 1e-9, "{:?}", found[0]);
    assert_eq!(around.top, Top::Y);
    let back = around.map_from_grid.then(&around.pose);
    assert!(back.distance_m(&start) < 1e-9 && (back.yaw_rad - start.yaw_rad).abs() < 1e-9);
    assert!(around.pose.x_m.abs() <= 0.25 && around.pose.y_m.abs() <= 0.25);
    let error = map.at_origin().unwrap_err().to_string();
    assert!(error.contains("map.yml: the map is turned"), "{error}");
}

#[test]
fn a_start_off_the_map_is_told_what_the_map_covers() {
    let folder = tempfile::tempdir().unwrap();
    let map = small(folder.path(), "m.pgm", "[-1, 3, 0]");
    assert!(map.around(&Pose2::new(0.99, 4.49, 0.0)).is_ok());
    for (x_m, y_m) in [
        (1.01, 4.0),
        (-1.01, 4.0),
        (0.0, 2.99),
        (0.0, 4.51),
        (1e300, 0.0),
    ] {
        let error = map
            .around(&Pose2::new(x_m, y_m, 0.0))
            .unwrap_err()
            .to_string();
        let said = "off the map, expected x from -1.00 to 1.00 m and y from 3.00 to 4.50 m";
        assert!(error.contains("map.yml") && error.contains(said), "{error}");
    }
}

#[test]
fn the_cells_around_a_pose_are_those_around_the_origin() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.pgm");
    write_map(&path, &sketch()).unwrap();
    let map = Map::read(&path, &GridSpec::default()).unwrap();
    let around = map.around(&Pose2::default()).unwrap();
    assert_eq!(around.occupancy, map.at_origin().unwrap());
    assert!(around.map_from_grid.distance_m(&Pose2::default()) < 1e-9);
}

#[test]
fn a_picture_alone_has_its_frame_at_the_vehicles_cell() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("map.pgm");
    let spec = GridSpec {
        rows: 2,
        cols: 3,
        resolution_m: 0.2,
        ego_row: 1,
        ego_col: 1,
    };
    std::fs::write(&path, b"P5 3 2 255\n\x00\xfe\xff\xfe\xfe\xcd").unwrap();
    let around = Map::read(&path, &spec)
        .unwrap()
        .around(&Pose2::new(0.2, -0.2, 0.1))
        .unwrap();
    assert_eq!(
        (around.occupancy.spec.ego_row, around.occupancy.spec.ego_col),
        (0, 2)
    );
    assert_eq!(around.top, Top::X);
    let occupied = occupied_in_map(&around);
    assert!(occupied[0].distance_m(&Pose2::new(0.2, 0.2, 0.0)) < 1e-9);
}

#[test]
fn a_picture_is_found_by_relative_absolute_and_quoted_paths() {
    let folder = tempfile::tempdir().unwrap();
    let absolute = folder.path().join("m.pgm").display().to_string();
    for image in [
        "m.pgm",
        "./m.pgm",
        "'m.pgm'",
        &absolute,
        &format!("\"{absolute}\""),
    ] {
        small(folder.path(), image, "[0, 0, 0]");
    }
    let text = "\u{feff}image: m.pgm\nresolution: 0.5\norigin: [0, 0, 0]\n";
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let path = folder.path().join("map.yaml");
    std::fs::write(&path, units).unwrap();
    Map::read(&path, &GridSpec::default()).unwrap();
    std::fs::write(&path, b"image: \xff\xff\n").unwrap();
    let error = Map::read(&path, &GridSpec::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("byte 7: not UTF-8"), "{error}");
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let error = read_map(Path::new("nowhere/none.pgm"), &GridSpec::default()).unwrap_err();
    assert!(error.to_string().contains("none.pgm"));
}
