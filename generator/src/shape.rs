//! Solid things: their outlines, and what they touch.

use swath_bridge::Pose2;

/// Lines thinner than this are cast as one line, thicker ones as the outline of their strip.
const THIN_M: f64 = 0.15;
/// Corners of the polygon that stands for a disc.
const DISC_CORNERS: u32 = 10;

/// How high something stands, as far as a lidar on the roof cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Height {
    /// Below the rays at a distance: seen from near only, and hides nothing.
    Low,
    /// Hides what is behind it.
    Tall,
}

/// The outline of something on the ground.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A rectangle around its centre's pose.
    Rectangle {
        /// Centre and direction of the length.
        centre: Pose2,
        /// Along the heading.
        length_m: f64,
        /// Across the heading.
        width_m: f64,
    },
    /// A disc.
    Disc {
        /// Centre.
        centre: [f64; 2],
        /// Radius.
        radius_m: f64,
    },
    /// A line through points.
    Line {
        /// At least two points.
        points: Vec<[f64; 2]>,
        /// Half of it lies to each side.
        thickness_m: f64,
    },
}

/// A shape that stands still.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Where.
    pub shape: Shape,
    /// How high.
    pub height: Height,
}

/// A piece of an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// One end.
    pub from: [f64; 2],
    /// The other end.
    pub to: [f64; 2],
    /// Whether it is seen from its right only: outlines run counter-clockwise.
    pub one_sided: bool,
}

/// A rectangle in its own frame, for tests of touching.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Frame in which the other fields are.
    pub pose: Pose2,
    /// Ahead of the pose.
    pub front_m: f64,
    /// Behind the pose.
    pub rear_m: f64,
    /// To either side.
    pub half_width_m: f64,
}

impl Footprint {
    /// The same with `margin_m` more on every side.
    #[must_use]
    pub fn grown(&self, margin_m: f64) -> Self {
        Self {
            pose: self.pose,
            front_m: self.front_m + margin_m,
            rear_m: self.rear_m + margin_m,
            half_width_m: self.half_width_m + margin_m,
        }
    }

    /// Whether a point lies inside.
    pub fn holds(&self, point: [f64; 2]) -> bool {
        let [x, y] = self.local(point);
        x >= -self.rear_m && x <= self.front_m && y.abs() <= self.half_width_m
    }

    /// Whether any point of a segment lies inside.
    pub fn cuts(&self, segment: &Segment) -> bool {
        let (a, b) = (self.local(segment.from), self.local(segment.to));
        let (low, high) = (
            [-self.rear_m, -self.half_width_m],
            [self.front_m, self.half_width_m],
        );
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let step = b[axis] - a[axis];
            if step.abs() < 1e-12 {
                if a[axis] < low[axis] || a[axis] > high[axis] {
                    return false;
                }
                continue;
            }
            let (s, t) = ((low[axis] - a[axis]) / step, (high[axis] - a[axis]) / step);
            enter = enter.max(s.min(t));
            leave = leave.min(s.max(t));
        }
        enter <= leave
    }

    fn local(&self, point: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.pose.yaw_rad);
        let (dx, dy) = (point[0] - self.pose.x_m, point[1] - self.pose.y_m);
        [cos * dx + sin * dy, cos * dy - sin * dx]
    }
}

impl Shape {
    /// Calls `visit` with every piece of the outline.
    pub fn outline(&self, mut visit: impl FnMut(Segment)) {
        match self {
            Self::Rectangle {
                centre,
                length_m,
                width_m,
            } => polygon(&corners(centre, 0.5 * length_m, 0.5 * width_m), visit),
            Self::Disc { centre, radius_m } => {
                let corner = |index: u32| {
                    let angle = f64::from(index) * std::f64::consts::TAU / f64::from(DISC_CORNERS);
                    let (sin, cos) = libm::sincos(angle);
                    [centre[0] + radius_m * cos, centre[1] + radius_m * sin]
                };
                for index in 0..DISC_CORNERS {
                    visit(Segment {
                        from: corner(index),
                        to: corner((index + 1) % DISC_CORNERS),
                        one_sided: true,
                    });
                }
            }
            Self::Line {
                points,
                thickness_m,
            } => {
                for pair in points.windows(2) {
                    strip(pair[0], pair[1], *thickness_m, &mut visit);
                }
            }
        }
    }

    /// Whether the shape, its inside included, and a footprint share a point.
    pub fn touches(&self, footprint: &Footprint) -> bool {
        let mut touches = self.holds([footprint.pose.x_m, footprint.pose.y_m]);
        self.outline(|segment| touches |= footprint.cuts(&segment));
        touches
    }

    /// Whether a point lies inside. Lines have no inside to speak of.
    fn holds(&self, point: [f64; 2]) -> bool {
        match self {
            Self::Rectangle {
                centre,
                length_m,
                width_m,
            } => Footprint {
                pose: *centre,
                front_m: 0.5 * length_m,
                rear_m: 0.5 * length_m,
                half_width_m: 0.5 * width_m,
            }
            .holds(point),
            Self::Disc { centre, radius_m } => {
                libm::hypot(point[0] - centre[0], point[1] - centre[1]) <= *radius_m
            }
            Self::Line { .. } => false,
        }
    }

    /// Distance of a point from the outline, metres.
    pub fn distance_m(&self, point: [f64; 2]) -> f64 {
        let mut nearest = f64::INFINITY;
        self.outline(|segment| nearest = nearest.min(segment.distance_m(point)));
        nearest
    }

    /// The same shape in another frame.
    #[must_use]
    pub fn seen_from(&self, here_from_there: &Pose2) -> Self {
        let (sin, cos) = libm::sincos(here_from_there.yaw_rad);
        let map = |p: &[f64; 2]| {
            [
                here_from_there.x_m + cos * p[0] - sin * p[1],
                here_from_there.y_m + sin * p[0] + cos * p[1],
            ]
        };
        match self {
            Self::Rectangle {
                centre,
                length_m,
                width_m,
            } => Self::Rectangle {
                centre: here_from_there.then(centre),
                length_m: *length_m,
                width_m: *width_m,
            },
            Self::Disc { centre, radius_m } => Self::Disc {
                centre: map(centre),
                radius_m: *radius_m,
            },
            Self::Line {
                points,
                thickness_m,
            } => Self::Line {
                points: points.iter().map(map).collect(),
                thickness_m: *thickness_m,
            },
        }
    }
}

impl Segment {
    /// Distance of a point, metres.
    pub fn distance_m(&self, point: [f64; 2]) -> f64 {
        let along = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let off = [point[0] - self.from[0], point[1] - self.from[1]];
        let length_squared = along[0] * along[0] + along[1] * along[1];
        let share = if length_squared > 0.0 {
            ((off[0] * along[0] + off[1] * along[1]) / length_squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        libm::hypot(off[0] - share * along[0], off[1] - share * along[1])
    }
}

/// The corners of a rectangle, counter-clockwise.
pub(crate) fn corners(centre: &Pose2, half_length_m: f64, half_width_m: f64) -> [[f64; 2]; 4] {
    let (sin, cos) = libm::sincos(centre.yaw_rad);
    let corner = |x: f64, y: f64| {
        [
            centre.x_m + cos * x - sin * y,
            centre.y_m + sin * x + cos * y,
        ]
    };
    [
        corner(half_length_m, half_width_m),
        corner(-half_length_m, half_width_m),
        corner(-half_length_m, -half_width_m),
        corner(half_length_m, -half_width_m),
    ]
}

fn polygon(corners: &[[f64; 2]], mut visit: impl FnMut(Segment)) {
    for (index, &from) in corners.iter().enumerate() {
        visit(Segment {
            from,
            to: corners[(index + 1) % corners.len()],
            one_sided: true,
        });
    }
}

/// A piece of a line: itself when thin, else the outline of its strip.
fn strip(from: [f64; 2], to: [f64; 2], thickness_m: f64, visit: &mut impl FnMut(Segment)) {
    if thickness_m < THIN_M {
        visit(Segment {
            from,
            to,
            one_sided: false,
        });
        return;
    }
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length_m = libm::hypot(dx, dy);
    if length_m <= 0.0 {
        return;
    }
    let half = 0.5 * thickness_m / length_m;
    let (nx, ny) = (-dy * half, dx * half);
    polygon(
        &[
            [to[0] + nx, to[1] + ny],
            [from[0] + nx, from[1] + ny],
            [from[0] - nx, from[1] - ny],
            [to[0] - nx, to[1] - ny],
        ],
        visit,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn footprint(x: f64, y: f64, yaw: f64) -> Footprint {
        Footprint {
            pose: Pose2::new(x, y, yaw),
            front_m: 3.6,
            rear_m: 0.6,
            half_width_m: 0.9,
        }
    }

    proptest! {
        #[test]
        fn touching_agrees_with_sampled_points(
            x in -6.0..6.0f64, y in -6.0..6.0f64, yaw in -3.0..3.0f64, angle in -3.0..3.0f64,
            length in 0.5..8.0f64, width in 0.3..4.0f64,
        ) {
            let shape = Shape::Rectangle {
                centre: Pose2::new(0.5, -0.5, angle), length_m: length, width_m: width,
            };
            let near = footprint(x, y, yaw);
            let sampled = |grown: f64| {
                let near = near.grown(grown);
                (0..=60).any(|i| (0..=60).any(|k| {
                    let local = Pose2::new(
                        (f64::from(i) / 60.0 - 0.5) * length, (f64::from(k) / 60.0 - 0.5) * width, 0.0,
                    );
                    let at = Pose2::new(0.5, -0.5, angle).then(&local);
                    near.holds([at.x_m, at.y_m])
                }))
            };
            // Sampling finds a little less than there is; with a margin it finds a little more.
            if sampled(0.0) {
                prop_assert!(shape.touches(&near));
            }
            if shape.touches(&near) {
                prop_assert!(sampled(0.15));
            }
        }

        #[test]
        fn outlines_keep_their_distances_in_another_frame(
            x in -6.0..6.0f64, y in -6.0..6.0f64, yaw in -3.0..3.0f64, kind in 0..3usize,
        ) {
            let shape = [
                Shape::Rectangle { centre: Pose2::new(1.0, 2.0, 0.3), length_m: 4.0, width_m: 2.0 },
                Shape::Disc { centre: [1.0, -1.0], radius_m: 0.7 },
                Shape::Line { points: vec![[0.0, 0.0], [3.0, 1.0], [4.0, 4.0]], thickness_m: 0.4 },
            ][kind].clone();
            let frame = Pose2::new(x, y, yaw);
            let point = frame.then(&Pose2::new(2.5, 2.5, 0.0));
            let (before, after) = (
                shape.distance_m([2.5, 2.5]), shape.seen_from(&frame).distance_m([point.x_m, point.y_m]),
            );
            // A disc's polygon does not turn with the frame.
            let tolerance = if kind == 1 { 0.1 } else { 1e-9 };
            prop_assert!((before - after).abs() < tolerance);
        }
    }

    #[test]
    fn outlines_run_counter_clockwise_so_that_their_outside_is_on_the_right() {
        let shape = Shape::Rectangle {
            centre: Pose2::new(3.0, 1.0, 0.7),
            length_m: 4.0,
            width_m: 2.0,
        };
        shape.outline(|s| {
            let cross = (s.to[0] - s.from[0]) * (1.0 - s.from[1])
                - (s.to[1] - s.from[1]) * (3.0 - s.from[0]);
            assert!(cross > 0.0, "the centre is to the left of {s:?}");
        });
    }
}
