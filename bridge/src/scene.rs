//! A planned frame as a drawing: map, regions, reference, paths and goals, with a legend and a scale.

mod placement;

use std::f64::consts::FRAC_PI_4;
use std::ops::RangeInclusive;

use crate::drawing::{Drawing, GLYPH_PX, Image, Spot, Text};
use crate::geometry::{Cell, Pose2, wrap_angle_rad};
use crate::map::Top;
use crate::occupancy::{OCCUPIED, OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
use crate::picture::{BLACK, BLUE, Colour, GREEN, GREY, RED, WHITE, mixed};
use crate::vehicle::Vehicle;

use placement::Placement;

/// Room around everything.
const MARGIN_PX: f64 = 16.0;
/// Height of the strip under the map, which the scale is in.
const FOOT_PX: f64 = 56.0;
/// Least and greatest width of the legend.
const LEGEND_PX: RangeInclusive<f64> = 480.0..=860.0;
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
        let width_px = map_width + self.legend_px() + 3.0 * MARGIN_PX;
        let mut drawing = Drawing::new(whole_px(width_px), whole_px(height_px), WHITE);
        frame(&mut drawing, &place);
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

    /// Width of the legend, pixels.
    fn legend_px(&self) -> f64 {
        let goals = self
            .goals
            .iter()
            .map(|goal| goal_text(goal).chars().count() + 3);
        let longest = goals.chain([self.title.chars().count()]).max();
        let width_px = longest.unwrap_or_default() as f64 * f64::from(GLYPH_PX * TEXT);
        width_px.clamp(*LEGEND_PX.start(), *LEGEND_PX.end())
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
        lines.write(0.0, BLACK, self.title);
        lines.top += LINE_PX / 2.0;
        lines.stroke(BLUE);
        lines.write(
            48.0,
            BLACK,
            &format!("start {}", place_text(&self.start_named)),
        );
        if self.reference.len() > 1 {
            lines.stroke(GREEN);
            lines.write(48.0, BLACK, "reference");
        }
        if self.near_reference.is_some() {
            lines.swatch(mixed(WHITE, GREEN, NEAR_OPACITY));
            lines.write(48.0, BLACK, "around the reference");
        }
        lines.swatch(BLACK);
        lines.write(48.0, BLACK, "obstacle");
        if self.occupancy.cells.iter().any(|&value| value < 0) {
            lines.swatch(GREY);
            lines.write(48.0, BLACK, "unknown");
        }
        if self.region.is_some() {
            lines.swatch(mixed(WHITE, REGION, REGION_OPACITY));
            lines.write(48.0, BLACK, self.region_name);
        }
        if self.goals.is_empty() {
            return;
        }
        lines.top += LINE_PX / 2.0;
        lines.write(0.0, BLACK, "goals (x m, y m, heading)");
        let (_, height) = lines.drawing.size_px();
        for (index, goal) in self.goals.iter().enumerate() {
            let left = self.goals.len() - index;
            if left > 1 && lines.top + 2.0 * LINE_PX > f64::from(height) {
                lines.write(48.0, BLACK, &format!("and {left} more"));
                return;
            }
            let colour = colour_of(index, goal);
            if goal.path.is_empty() {
                lines.cross(colour);
            } else {
                lines.stroke(colour);
            }
            lines.write(48.0, BLACK, &goal_text(goal));
        }
    }
}

/// A line around the map, which may be as white as the ground.
fn frame(drawing: &mut Drawing, place: &Placement) {
    let (width, height) = place.size_px();
    let (from, to) = (MARGIN_PX - 2.0, MARGIN_PX + 2.0);
    drawing.rectangle(
        Spot::new(from, from),
        Spot::new(to + width, to + height),
        GREY,
    );
}

/// A goal's line of a legend.
fn goal_text(goal: &SceneGoal) -> String {
    let chosen = if goal.is_chosen { ", chosen" } else { "" };
    let (number, named) = (goal.number, place_text(&goal.named));
    format!("{number} {named} {}{chosen}", goal.note)
}

/// The text of a place for a legend.
fn place_text(pose: &Pose2) -> String {
    // Adding zero turns a negative zero into zero.
    let tenths = |metres: f64| libm::rint(metres * 10.0) / 10.0 + 0.0;
    let degrees = libm::rint(wrap_angle_rad(pose.yaw_rad).to_degrees()) + 0.0;
    let (x_m, y_m) = (tenths(pose.x_m), tenths(pose.y_m));
    format!("({x_m:.1}, {y_m:.1}) {degrees:.0}\u{b0}")
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
    fn write(&mut self, indent: f64, colour: Colour, text: &str) {
        let room = (LEGEND_PX.end() - indent) / f64::from(GLYPH_PX * TEXT);
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
    let tries = [18.0, 34.0, 50.0].into_iter().flat_map(|away| {
        let turns = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0];
        turns.into_iter().map(move |turn| (turn * FRAC_PI_4, away))
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
mod tests;
