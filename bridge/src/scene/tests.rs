use super::*;
use crate::drawing::PictureFormat;
use crate::geometry::GridSpec;
use crate::occupancy::FREE;

fn pixels_of(drawing: &Drawing) -> (usize, Vec<Colour>) {
    let bytes = drawing.to_bytes(PictureFormat::Png).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let pixels = pixels
        .chunks_exact(3)
        .map(|pixel| [pixel[0], pixel[1], pixel[2]]);
    (info.width as usize, pixels.collect())
}

fn spec(rows: u32, cols: u32, resolution_m: f64) -> GridSpec {
    GridSpec {
        rows,
        cols,
        resolution_m,
        ego_row: rows / 2,
        ego_col: cols / 2,
    }
}

fn goal(number: usize, pose: Pose2, path: Vec<Pose2>) -> SceneGoal {
    SceneGoal {
        number,
        pose,
        named: pose,
        note: if path.is_empty() {
            "unreachable"
        } else {
            "3.0 m"
        }
        .to_owned(),
        path,
        is_chosen: number == 1,
    }
}

fn scene<'a>(
    occupancy: &'a Occupancy,
    top: Top,
    goals: &'a [SceneGoal],
    vehicle: &'a Vehicle,
) -> Scene<'a> {
    Scene {
        title: "swath: 1 of 2 solved",
        occupancy,
        top,
        region: None,
        region_name: "predicted region",
        near_reference: None,
        reference: &[],
        goals,
        start: Pose2::default(),
        start_named: Pose2::default(),
        vehicle,
    }
}

#[test]
fn the_map_has_its_own_orientation_at_any_size() {
    let robot = Vehicle {
        front_m: 0.01,
        rear_m: 0.01,
        half_width_m: 0.01,
        ..Vehicle::default()
    };
    for (rows, cols) in [(4, 3), (40, 30), (401, 151), (4096, 4096), (7, 4096)] {
        let mut occupancy = Occupancy::filled(spec(rows, cols, 0.1), FREE);
        // Farthest ahead and farthest left: upper left, or with y up, upper right.
        occupancy.set(Cell::new(0, 0), OCCUPIED);
        for top in [Top::X, Top::Y] {
            let scene = scene(&occupancy, top, &[], &robot);
            let place = Placement::of(&occupancy.spec, top);
            let (width, _) = place.size_px();
            let (line, pixels) = pixels_of(&scene.drawing());
            let at = |x: f64, y: f64| {
                let (x, y) = (
                    whole_px(MARGIN_PX + x) as usize,
                    whole_px(MARGIN_PX + y) as usize,
                );
                pixels[y * line + x]
            };
            let (left, right) = (at(0.5, 0.5), at(width - 0.5, 0.5));
            let (dark, light) = match top {
                Top::X => (left, right),
                Top::Y => (right, left),
            };
            assert_eq!((dark, light), (BLACK, WHITE), "{rows} x {cols} {top:?}");
        }
    }
}

#[test]
fn spots_are_where_cells_are_drawn() {
    for top in [Top::X, Top::Y] {
        for side in [5, 300, 3000] {
            let spec = spec(side, side / 2, 0.2);
            let place = Placement::of(&spec, top);
            let scale = f64::from(place.pixels_a_cell.max(1)) / f64::from(place.cells_a_pixel);
            for (right, down) in [(0, 0), (1, 0), (0, 1), (side / 3, side / 3)] {
                let (x_m, y_m) = spec.centre_of(place.cell(right, down));
                let spot = place.spot(&Pose2::new(x_m, y_m, 0.0));
                let wanted = |cells: u32| MARGIN_PX + (f64::from(cells) + 0.5) * scale;
                assert!((spot.x - wanted(right)).abs() < 1e-6, "{top:?} {side}");
                assert!((spot.y - wanted(down)).abs() < 1e-6, "{top:?} {side}");
            }
        }
    }
}

#[test]
fn lines_end_at_the_edge_of_the_map() {
    let place = Placement::of(&spec(100, 100, 0.1), Top::X);
    let (width, height) = place.size_px();
    let (right, bottom) = (MARGIN_PX + width, MARGIN_PX + height);
    let inside = Spot::new(right - 10.0, 100.0);
    let beyond = Spot::new(right + 10.0, 120.0);
    let (from, to) = place.clipped(inside, beyond).unwrap();
    assert_eq!(from, inside);
    assert!((to.x - right).abs() < 1e-9 && (to.y - 110.0).abs() < 1e-9);
    assert_eq!(place.clipped(beyond, Spot::new(right + 1.0, bottom)), None);
    assert_eq!(place.clipped(inside, inside), Some((inside, inside)));
    assert_eq!(place.clipped(Spot::default(), Spot::new(right, 0.0)), None);
}

#[test]
fn every_path_has_its_colour_and_goals_without_one_their_reason() {
    let occupancy = Occupancy::filled(spec(60, 60, 0.1), FREE);
    let path = |y_m: f64| {
        (0..30)
            .map(|step| Pose2::new(0.1 * f64::from(step), y_m, 0.0))
            .collect()
    };
    let goals = [
        goal(0, Pose2::new(2.9, 1.0, 0.0), path(1.0)),
        goal(1, Pose2::new(2.9, -1.0, 0.0), path(-1.0)),
        goal(2, Pose2::new(500.0, 0.0, 1.0), Vec::new()),
    ];
    let vehicle = Vehicle::default();
    let drawing = scene(&occupancy, Top::X, &goals, &vehicle).drawing();
    let (_, pixels) = pixels_of(&drawing);
    for colour in [PATHS[0], PATHS[1], RED, BLUE] {
        assert!(pixels.contains(&colour), "{colour:?} is not drawn");
    }
    let svg = String::from_utf8(drawing.to_bytes(PictureFormat::Svg).unwrap()).unwrap();
    for text in [
        "swath: 1 of 2 solved",
        "0 (2.9, 1.0) 0\u{b0} 3.0 m",
        "1 (2.9, -1.0) 0\u{b0} 3.0 m, chosen",
        "2 (500.0, 0.0) 57\u{b0} unreachable",
        ">1 m</text>",
    ] {
        assert!(svg.contains(text), "{text} is not in the legend");
    }
}

#[test]
fn places_are_short_and_headings_between_plus_and_minus_half_a_turn() {
    let text = |x_m, y_m, yaw_rad| place_text(&Pose2::new(x_m, y_m, yaw_rad));
    assert_eq!(text(1.04, -0.04, 3.5), "(1.0, 0.0) -159\u{b0}");
    assert_eq!(text(-0.06, 12.0, -0.001), "(-0.1, 12.0) 0\u{b0}");
}

#[test]
fn numbers_of_goals_at_one_place_do_not_hide_one_another() {
    let place = Placement::of(&spec(100, 100, 0.1), Top::X);
    let mut taken = Vec::new();
    let at: Vec<Spot> = (0..12)
        .map(|number: usize| {
            let mark = (Spot::new(300.0, 300.0), Spot::new(0.0, -1.0));
            label_place(&place, mark, &number.to_string(), &mut taken)
        })
        .collect();
    for (index, spot) in at.iter().enumerate() {
        assert!(at[..index].iter().all(|other| other != spot));
    }
}

#[test]
fn a_long_list_of_goals_is_cut_with_a_word() {
    let occupancy = Occupancy::filled(spec(60, 60, 0.1), FREE);
    let goals: Vec<SceneGoal> = (0..500)
        .map(|number| goal(number, Pose2::default(), Vec::new()))
        .collect();
    let vehicle = Vehicle::default();
    let drawing = scene(&occupancy, Top::X, &goals, &vehicle).drawing();
    let svg = String::from_utf8(drawing.to_bytes(PictureFormat::Svg).unwrap()).unwrap();
    assert!(svg.contains(" more</text>"));
    assert!(drawing.size_px().1 < 2100);
}
