//! A planned frame as a drawing: map, regions, reference, paths and goals, with a legend and a scale.

use crate::drawing::{Drawing, GLYPH_PX, Image, Spot, Text};
use crate::geometry::{Cell, GridSpec, Pose2};
use crate::map::Top;
use crate::occupancy::{OCCUPIED, OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
use crate::picture::{BLACK, BLUE, Colour, GREEN, GREY, RED, WHITE, mixed};
use crate::vehicle::Vehicle;

/// Pixels that the longer side of a map of few cells is enlarged to.
const SMALL_MAP_PX: u32 = 1640;
/// Most pixels of the longer side of a map.
const LARGE_MAP_PX: u32 = 2048;
/// Room around everything.
const MARGIN_PX: f64 = 16.0;
/// Height of the strip under the map, which the scale is in.
const FOOT_PX: f64 = 56.0;
/// Width of the legend.
const LEGEND_PX: f64 = 660.0;
/// Distance of the legend's lines.
const LINE_PX: f64 = 26.0;
/// Lines of goals in a legend beside a small map.
const LEAST_LINES: f64 = 76.0;
/// Enlargement of all text.
const TEXT: u32 = 2;
/// How much of the ground a region hides.
const REGION_OPACITY: f64 = 0.45;
/// How much of the ground the surroundings of the reference hide.
const NEAR_OPACITY: f64 = 0.25;
/// Colour of regions.
const REGION: Colour = [250, 190, 60];
/// Colours of paths, one after the other; none is like that of another thing.
const PATHS: [Colour; 9] = [
    [222, 110, 10],
    [126, 66, 190],
    [0, 156, 190],
    [218, 70, 160],
    [128, 118, 0],
    [130, 78, 46],
    [60, 190, 60],
    [90, 96, 220],
    [0, 100, 100],
];

/// A goal, and the path to it if there is one.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneGoal {
    /// The number that it is called by.
    pub number: usize,
    /// Where it is, in the frame of the cells.
    pub pose: Pose2,
    /// What the legend calls its place: x and y in metres and the heading in radians.
    pub named: Pose2,
    /// The path; empty where there is none.
    pub path: Vec<Pose2>,
    /// Why there is none, or how long the path is.
    pub note: String,
    /// Whether it is the one that is followed.
    pub is_chosen: bool,
}

/// What is drawn of a frame. All poses are in the frame of the cells.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// What the legend begins with.
    pub title: &'a str,
    /// The map.
    pub occupancy: &'a Occupancy,
    /// Where the picture's top points.
    pub top: Top,
    /// Whether a cell of the map is in a region; `None` without regions.
    pub region: Option<&'a dyn Fn(Cell) -> bool>,
    /// What the legend calls regions.
    pub region_name: &'a str,
    /// Whether a cell is near the rough path; `None` where that is given as poses.
    pub near_reference: Option<&'a dyn Fn(Cell) -> bool>,
    /// The rough path; may be empty.
    pub reference: &'a [Pose2],
    /// Goals with their paths.
    pub goals: &'a [SceneGoal],
    /// Where paths begin.
    pub start: Pose2,
    /// What the legend calls that place.
    pub start_named: Pose2,
    /// The vehicle's outline.
    pub vehicle: &'a Vehicle,
}

impl std::fmt::Debug for Scene<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Scene")
            .field("title", &self.title)
            .field("goals", &self.goals)
            .finish_non_exhaustive()
    }
}

impl Scene<'_> {
    /// The drawing. Small maps are enlarged, and giant ones reduced without losing an obstacle.
    pub fn drawing(&self) -> Drawing {
        let place = Placement::of(&self.occupancy.spec, self.top);
        let (map_width, map_height) = place.size_px();
        let lines = 10.0 + self.goals.len() as f64;
        let least_px = lines.min(LEAST_LINES) * LINE_PX;
        let height_px = (map_height + FOOT_PX).max(least_px) + 2.0 * MARGIN_PX;
        let width_px = map_width + LEGEND_PX + 3.0 * MARGIN_PX;
        let mut drawing = Drawing::new(whole_px(width_px), whole_px(height_px), WHITE);
        self.frame(&mut drawing, &place);
        let scale = place.pixels_a_cell.max(1);
        let margin = whole_px(MARGIN_PX);
        drawing.image(self.image(&place), (margin, margin), scale);
        place.line(&mut drawing, self.reference, (GREEN, 3.0));
        self.paths(&mut drawing, &place);
        outline(&mut drawing, &place, (&self.start, self.vehicle));
        self.marks(&mut drawing, &place);
        scale_bar(&mut drawing, &place);
        self.legend(&mut drawing, MARGIN_PX * 2.0 + map_width);
        drawing
    }

    /// A line around the map, which may be as white as the ground.
    fn frame(&self, drawing: &mut Drawing, place: &Placement) {
        let (width, height) = place.size_px();
        let (from, to) = (MARGIN_PX - 2.0, MARGIN_PX + 2.0);
        drawing.rectangle(
            Spot::new(from, from),
            Spot::new(to + width, to + height),
            GREY,
        );
    }

    /// The cells as an image, one pixel each, or one for several.
    fn image(&self, place: &Placement) -> Image {
        let (width, height) = place.image_cells();
        let side = place.cells_a_pixel;
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                let mut most = UNKNOWN;
                let (mut any_unknown, mut any_region, mut any_near) = (false, false, false);
                for (dx, dy) in (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy))) {
                    let cell = place.cell(x * side + dx, y * side + dy);
                    let Some(value) = self.occupancy.get(cell) else {
                        continue;
                    };
                    most = most.max(value);
                    any_unknown |= value < 0;
                    any_region |= self.region.is_some_and(|is_in| is_in(cell));
                    any_near |= self.near_reference.is_some_and(|is_near| is_near(cell));
                }
                let colour = if any_unknown && most < OCCUPIED_THRESHOLD {
                    GREY
                } else {
                    mixed(WHITE, BLACK, f64::from(most.max(0)) / f64::from(OCCUPIED))
                };
                let near = if any_near { NEAR_OPACITY } else { 0.0 };
                let region = if any_region { REGION_OPACITY } else { 0.0 };
                pixels.push(mixed(mixed(colour, GREEN, near), REGION, region));
            }
        }
        Image { width, pixels }
    }

    fn paths(&self, drawing: &mut Drawing, place: &Placement) {
        // The chosen path lies over the others.
        for is_chosen in [false, true] {
            let goals = self.goals.iter().enumerate();
            for (index, goal) in goals.filter(|(_, goal)| goal.is_chosen == is_chosen) {
                let width_px = if is_chosen { 7.0 } else { 3.0 };
                place.line(drawing, &goal.path, (colour_of(index, goal), width_px));
            }
        }
    }

    /// Numbers and headings of the goals. What lies off the map is drawn at its edge.
    fn marks(&self, drawing: &mut Drawing, place: &Placement) {
        let mut taken: Vec<(Spot, Spot)> = Vec::new();
        for (index, goal) in self.goals.iter().enumerate() {
            let colour = colour_of(index, goal);
            let spot = place.kept(place.spot(&goal.pose));
            let ahead = place.direction(goal.pose.yaw_rad);
            if goal.path.is_empty() {
                for (dx, dy) in [(7.0, 7.0), (7.0, -7.0)] {
                    let (from, to) = (offset(spot, (dx, dy), 1.0), offset(spot, (dx, dy), -1.0));
                    drawing.line(vec![from, to], WHITE, 7.0);
                    drawing.line(vec![from, to], colour, 4.0);
                }
            } else {
                drawing.disc(spot, 7.0, WHITE);
                drawing.disc(spot, 5.5, colour);
            }
            arrow(drawing, (spot, ahead), colour);
        }
        for (index, goal) in self.goals.iter().enumerate() {
            let spot = place.kept(place.spot(&goal.pose));
            let ahead = place.direction(goal.pose.yaw_rad);
            let text = goal.number.to_string();
            let at = label_place(place, (spot, ahead), &text, &mut taken);
            drawing.text(Text {
                text,
                at,
                scale: TEXT,
                colour: colour_of(index, goal),
                halo: Some(WHITE),
            });
        }
    }

    fn legend(&self, drawing: &mut Drawing, left: f64) {
        let mut lines = Lines {
            drawing,
            left,
            top: MARGIN_PX,
        };
        lines.write(0.0, BLACK, self.title.to_owned());
        lines.top += LINE_PX / 2.0;
        lines.stroke(BLUE);
        lines.write(
            48.0,
            BLACK,
            format!("start {}", place_text(&self.start_named)),
        );
        if self.reference.len() > 1 {
            lines.stroke(GREEN);
            lines.write(48.0, BLACK, "reference".to_owned());
        }
        if self.near_reference.is_some() {
            lines.swatch(mixed(WHITE, GREEN, NEAR_OPACITY));
            lines.write(48.0, BLACK, "around the reference".to_owned());
        }
        lines.swatch(BLACK);
        lines.write(48.0, BLACK, "obstacle".to_owned());
        if self.occupancy.cells.iter().any(|&value| value < 0) {
            lines.swatch(GREY);
            lines.write(48.0, BLACK, "unknown".to_owned());
        }
        if self.region.is_some() {
            lines.swatch(mixed(WHITE, REGION, REGION_OPACITY));
            lines.write(48.0, BLACK, self.region_name.to_owned());
        }
        if self.goals.is_empty() {
            return;
        }
        lines.top += LINE_PX / 2.0;
        lines.write(0.0, BLACK, "goals (x m, y m, heading)".to_owned());
        let (_, height) = lines.drawing.size_px();
        for (index, goal) in self.goals.iter().enumerate() {
            let left = self.goals.len() - index;
            if left > 1 && lines.top + 2.0 * LINE_PX > f64::from(height) {
                lines.write(48.0, BLACK, format!("and {left} more"));
                return;
            }
            let colour = colour_of(index, goal);
            if goal.path.is_empty() {
                lines.cross(colour);
            } else {
                lines.stroke(colour);
            }
            let chosen = if goal.is_chosen { ", chosen" } else { "" };
            let (number, named) = (goal.number, place_text(&goal.named));
            lines.write(
                48.0,
                BLACK,
                format!("{number} {named} {}{chosen}", goal.note),
            );
        }
    }
}

/// The text of a place for a legend.
fn place_text(pose: &Pose2) -> String {
    let degrees = pose.yaw_rad.to_degrees();
    format!(
        "({:.1}, {:.1}) {:.0}\u{b0}",
        pose.x_m,
        pose.y_m,
        degrees + 0.0
    )
}

fn colour_of(index: usize, goal: &SceneGoal) -> Colour {
    if goal.path.is_empty() {
        RED
    } else {
        PATHS[index % PATHS.len()]
    }
}

/// Lines of a legend, from the top down.
struct Lines<'a> {
    drawing: &'a mut Drawing,
    left: f64,
    top: f64,
}

impl Lines<'_> {
    fn write(&mut self, indent: f64, colour: Colour, text: String) {
        let room = (LEGEND_PX - indent) / f64::from(GLYPH_PX * TEXT);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a few dozen letters"
        )]
        let text: String = text.chars().take(room as usize).collect();
        self.drawing.text(Text {
            text,
            at: Spot::new(self.left + indent, self.top),
            scale: TEXT,
            colour,
            halo: None,
        });
        self.top += LINE_PX;
    }

    fn stroke(&mut self, colour: Colour) {
        let y = self.top + 8.0;
        let (from, to) = (
            Spot::new(self.left + 4.0, y),
            Spot::new(self.left + 34.0, y),
        );
        self.drawing.line(vec![from, to], colour, 5.0);
    }

    fn cross(&mut self, colour: Colour) {
        let middle = Spot::new(self.left + 19.0, self.top + 8.0);
        for across in [(7.0, 7.0), (7.0, -7.0)] {
            let ends = vec![offset(middle, across, 1.0), offset(middle, across, -1.0)];
            self.drawing.line(ends, colour, 4.0);
        }
    }

    fn swatch(&mut self, colour: Colour) {
        let (left, top) = (self.left + 4.0, self.top);
        self.drawing.rectangle(
            Spot::new(left, top),
            Spot::new(left + 30.0, top + 16.0),
            GREY,
        );
        self.drawing.rectangle(
            Spot::new(left + 1.0, top + 1.0),
            Spot::new(left + 29.0, top + 15.0),
            colour,
        );
    }
}

/// Where cells and metres lie in the drawing.
#[derive(Debug, Clone, Copy)]
struct Placement {
    spec: GridSpec,
    top: Top,
    /// 0 where several cells share a pixel.
    pixels_a_cell: u32,
    cells_a_pixel: u32,
}

impl Placement {
    fn of(spec: &GridSpec, top: Top) -> Self {
        let side = spec.rows.max(spec.cols).max(1);
        Self {
            spec: *spec,
            top,
            pixels_a_cell: if side <= LARGE_MAP_PX {
                (SMALL_MAP_PX / side).max(1)
            } else {
                0
            },
            cells_a_pixel: side.div_ceil(LARGE_MAP_PX),
        }
    }

    /// Cells to the right and down.
    const fn cells(&self) -> (u32, u32) {
        match self.top {
            Top::X => (self.spec.cols, self.spec.rows),
            Top::Y => (self.spec.rows, self.spec.cols),
        }
    }

    const fn image_cells(&self) -> (u32, u32) {
        let (width, height) = self.cells();
        (
            width.div_ceil(self.cells_a_pixel),
            height.div_ceil(self.cells_a_pixel),
        )
    }

    fn size_px(&self) -> (f64, f64) {
        let (width, height) = self.image_cells();
        let scale = self.pixels_a_cell.max(1);
        (f64::from(width * scale), f64::from(height * scale))
    }

    /// Pixels of a metre.
    fn px_a_m(&self) -> f64 {
        let px_a_cell = f64::from(self.pixels_a_cell.max(1)) / f64::from(self.cells_a_pixel);
        px_a_cell / self.spec.resolution_m
    }

    /// The cell so many cells to the right and down.
    fn cell(&self, right: u32, down: u32) -> Cell {
        let at = |cells: u32| i32::try_from(cells).unwrap_or(i32::MAX);
        match self.top {
            Top::X => Cell::new(at(down), at(right)),
            Top::Y => Cell::new(at(self.spec.rows) - 1 - at(right), at(down)),
        }
    }

    fn spot(&self, pose: &Pose2) -> Spot {
        let (px_a_m, resolution_m) = (self.px_a_m(), self.spec.resolution_m);
        let front_m = (f64::from(self.spec.ego_row) + 0.5) * resolution_m;
        let left_m = (f64::from(self.spec.ego_col) + 0.5) * resolution_m;
        let rear_m = f64::from(self.spec.rows) * resolution_m - front_m;
        let (right_m, down_m) = match self.top {
            Top::X => (left_m - pose.y_m, front_m - pose.x_m),
            Top::Y => (rear_m + pose.x_m, left_m - pose.y_m),
        };
        Spot::new(MARGIN_PX + right_m * px_a_m, MARGIN_PX + down_m * px_a_m)
    }

    /// The direction of a heading, of length 1.
    fn direction(&self, yaw_rad: f64) -> Spot {
        let (sin, cos) = libm::sincos(yaw_rad);
        match self.top {
            Top::X => Spot::new(-sin, -cos),
            Top::Y => Spot::new(cos, -sin),
        }
    }

    /// Draws a line through poses, as far as it is on the map.
    fn line(&self, drawing: &mut Drawing, poses: &[Pose2], (colour, width_px): (Colour, f64)) {
        let spots: Vec<Spot> = poses.iter().map(|pose| self.spot(pose)).collect();
        let mut run: Vec<Spot> = Vec::new();
        for pair in spots.windows(2) {
            let Some((from, to)) = self.clipped(pair[0], pair[1]) else {
                continue;
            };
            if run.last() != Some(&from) {
                drawing.line(std::mem::take(&mut run), colour, width_px);
                run.push(from);
            }
            run.push(to);
        }
        drawing.line(run, colour, width_px);
    }

    /// The part of a segment that is on the map (Y. Liang and B. Barsky).
    fn clipped(&self, from: Spot, to: Spot) -> Option<(Spot, Spot)> {
        let (width, height) = self.size_px();
        let along = Spot::new(to.x - from.x, to.y - from.y);
        let (mut first, mut last) = (0.0f64, 1.0f64);
        for (step, room) in [
            (-along.x, from.x - MARGIN_PX),
            (along.x, MARGIN_PX + width - from.x),
            (-along.y, from.y - MARGIN_PX),
            (along.y, MARGIN_PX + height - from.y),
        ] {
            if step == 0.0 && room < 0.0 {
                return None;
            }
            if step < 0.0 {
                first = first.max(room / step);
            } else if step > 0.0 {
                last = last.min(room / step);
            }
        }
        let at = |part: f64| match part {
            0.0 => from,
            1.0 => to,
            part => Spot::new(from.x + part * along.x, from.y + part * along.y),
        };
        (first <= last).then(|| (at(first), at(last)))
    }

    /// The nearest spot on the map.
    fn kept(&self, spot: Spot) -> Spot {
        let (width, height) = self.size_px();
        let kept =
            |at: f64, most: f64| at.clamp(MARGIN_PX + 8.0, (MARGIN_PX + most - 8.0).max(24.0));
        Spot::new(kept(spot.x, width), kept(spot.y, height))
    }
}

fn offset(spot: Spot, (dx, dy): (f64, f64), times: f64) -> Spot {
    Spot::new(spot.x + times * dx, spot.y + times * dy)
}

fn arrow(drawing: &mut Drawing, (spot, ahead): (Spot, Spot), colour: Colour) {
    let tip = offset(spot, (ahead.x, ahead.y), 26.0);
    let aside = (-ahead.y, ahead.x);
    let barb = offset(spot, (ahead.x, ahead.y), 18.0);
    let shaft = vec![spot, tip];
    let head = vec![offset(barb, aside, 6.0), tip, offset(barb, aside, -6.0)];
    for (ground, width_px) in [(WHITE, 6.0), (colour, 3.0)] {
        drawing.line(shaft.clone(), ground, width_px);
        drawing.line(head.clone(), ground, width_px);
    }
}

/// A place for a goal's number beside its mark, on the map and on no other number if there is one.
fn label_place(
    place: &Placement,
    (spot, ahead): (Spot, Spot),
    text: &str,
    taken: &mut Vec<(Spot, Spot)>,
) -> Spot {
    let (width, height) = (Text::width_px(text, TEXT), f64::from(GLYPH_PX * TEXT));
    let (map_width, map_height) = place.size_px();
    let box_at = |angle: f64, away: f64| {
        let (sin, cos) = libm::sincos(angle);
        let (x, y) = (
            -ahead.x * cos + ahead.y * sin,
            -ahead.y * cos - ahead.x * sin,
        );
        let middle = offset(spot, (x, y), away + width / 2.0 * x.abs());
        let from = Spot::new(middle.x - width / 2.0, middle.y - height / 2.0);
        (from, offset(from, (width, height), 1.0))
    };
    let is_on_map = |(from, to): &(Spot, Spot)| {
        from.x >= MARGIN_PX
            && from.y >= MARGIN_PX
            && to.x <= MARGIN_PX + map_width
            && to.y <= MARGIN_PX + map_height
    };
    let meets = |a: &(Spot, Spot), b: &(Spot, Spot)| {
        a.0.x < b.1.x && b.0.x < a.1.x && a.0.y < b.1.y && b.0.y < a.1.y
    };
    // Behind the goal first, then to its sides, nearer before farther.
    const EIGHTH: f64 = std::f64::consts::FRAC_PI_4;
    let tries = [18.0, 34.0, 50.0].into_iter().flat_map(|away| {
        let turns = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0];
        turns.into_iter().map(move |turn| (turn * EIGHTH, away))
    });
    let found = tries
        .map(|(angle, away)| box_at(angle, away))
        .find(|found| is_on_map(found) && !taken.iter().any(|other| meets(found, other)))
        .unwrap_or_else(|| box_at(0.0, 18.0));
    taken.push(found);
    found.0
}

/// The vehicle's outline, and a line to its front.
fn outline(drawing: &mut Drawing, place: &Placement, (pose, vehicle): (&Pose2, &Vehicle)) {
    let spot = |x_m, y_m| place.spot(&pose.then(&Pose2::new(x_m, y_m, 0.0)));
    let (front_m, rear_m, side_m) = (vehicle.front_m, -vehicle.rear_m, vehicle.half_width_m);
    let around = vec![
        spot(front_m, side_m),
        spot(front_m, -side_m),
        spot(rear_m, -side_m),
        spot(rear_m, side_m),
        spot(front_m, side_m),
    ];
    let ahead = vec![spot(0.0, 0.0), spot(front_m, 0.0)];
    for (colour, width_px) in [(WHITE, 6.0), (BLUE, 3.0)] {
        drawing.line(around.clone(), colour, width_px);
        drawing.line(ahead.clone(), colour, width_px);
    }
}

/// A bar of a round number of metres under the map.
fn scale_bar(drawing: &mut Drawing, place: &Placement) {
    let (width, height) = place.size_px();
    let px_a_m = place.px_a_m();
    let most_px = (width / 2.0).clamp(60.0, 320.0);
    let lengths = [
        500.0, 200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1,
    ];
    let fits = |metres: &f64| metres * px_a_m <= most_px;
    let metres = lengths.into_iter().find(fits).unwrap_or(0.05);
    let (left, top) = (MARGIN_PX, MARGIN_PX + height + 16.0);
    let right = left + metres * px_a_m;
    drawing.rectangle(Spot::new(left, top), Spot::new(right, top + 10.0), BLACK);
    drawing.rectangle(
        Spot::new(f64::midpoint(left, right), top + 2.0),
        Spot::new(right - 2.0, top + 8.0),
        WHITE,
    );
    let axes = match place.top {
        Top::X => "x up",
        Top::Y => "x right",
    };
    for (text, x, y) in [
        (format!("{metres} m"), left, top + 16.0),
        (
            axes.to_owned(),
            left + width - Text::width_px(axes, TEXT),
            top,
        ),
    ] {
        drawing.text(Text {
            text,
            at: Spot::new(x.max(left), y),
            scale: TEXT,
            colour: BLACK,
            halo: None,
        });
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float to integer casts saturate"
)]
fn whole_px(px: f64) -> u32 {
    px as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::PictureFormat;
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
            ">2 m</text>",
        ] {
            assert!(svg.contains(text), "{text} is not in the legend");
        }
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
}
