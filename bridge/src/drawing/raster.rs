//! A drawing as pixels, with soft edges.

use super::{Drawing, GLYPH_PX, Image, Item, Spot, Text, dots_of};
use crate::picture::{Colour, mixed};

/// Places beyond the drawing are kept within so many of its sides, so that no loop grows with them.
const BEYOND: f64 = 4.0;

/// The drawing's pixels, row by row from the top.
pub(super) fn pixels_of(drawing: &Drawing) -> Vec<Colour> {
    let (width, height) = drawing.size_px();
    let mut canvas = Canvas {
        width: i64::from(width),
        height: i64::from(height),
        pixels: vec![drawing.ground; width as usize * height as usize],
    };
    for item in &drawing.items {
        match item {
            Item::Image { image, at, scale } => canvas.image(image, *at, *scale),
            Item::Line {
                spots,
                colour,
                width_px,
            } => {
                for pair in spots.windows(2) {
                    canvas.segment((pair[0], pair[1]), *colour, width_px / 2.0);
                }
            }
            Item::Disc {
                centre,
                radius_px,
                colour,
            } => canvas.segment((*centre, *centre), *colour, *radius_px),
            Item::Rectangle { from, to, colour } => canvas.rectangle(*from, *to, *colour),
            Item::Text(text) => canvas.text(text),
        }
    }
    canvas.pixels
}

struct Canvas {
    width: i64,
    height: i64,
    pixels: Vec<Colour>,
}

impl Canvas {
    fn image(&mut self, image: &Image, (left, top): (u32, u32), scale: u32) {
        let (left, top, scale) = (i64::from(left), i64::from(top), i64::from(scale.max(1)));
        let right = (left + i64::from(image.width) * scale).min(self.width);
        let bottom = (top + i64::from(image.height()) * scale).min(self.height);
        for y in top..bottom {
            for x in left..right {
                let (row, col) = ((y - top) / scale, (x - left) / scale);
                let index = row * i64::from(image.width) + col;
                if let Some(colour) = usize::try_from(index)
                    .ok()
                    .and_then(|at| image.pixels.get(at))
                {
                    self.blend(x, y, *colour, 1.0);
                }
            }
        }
    }

    /// Fills what is within a distance of a segment.
    fn segment(&mut self, (from, to): (Spot, Spot), colour: Colour, half_px: f64) {
        let (from, to) = (self.within_reach(from), self.within_reach(to));
        let half_px = half_px.clamp(0.5, (self.width + self.height) as f64);
        let (along_x, along_y) = (to.x - from.x, to.y - from.y);
        let squared = along_x * along_x + along_y * along_y;
        let rows = bounds(from.y, to.y, half_px, self.height);
        for y in rows {
            // Of a steep or flat line only the part of the row that is near it.
            let columns = if along_y.abs() > 1e-9 {
                let at = |row: f64| {
                    let part = ((row - from.y) / along_y).clamp(0.0, 1.0);
                    from.x + part * along_x
                };
                let slack = half_px + 1.0;
                bounds(
                    at(y as f64 - slack),
                    at(y as f64 + 1.0 + slack),
                    slack,
                    self.width,
                )
            } else {
                bounds(from.x, to.x, half_px, self.width)
            };
            for x in columns {
                let (dx, dy) = (x as f64 + 0.5 - from.x, y as f64 + 0.5 - from.y);
                let part = if squared > 0.0 {
                    ((dx * along_x + dy * along_y) / squared).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let off_px = libm::hypot(dx - part * along_x, dy - part * along_y);
                self.blend(x, y, colour, half_px + 0.5 - off_px);
            }
        }
    }

    fn rectangle(&mut self, from: Spot, to: Spot, colour: Colour) {
        let (from, to) = (self.within_reach(from), self.within_reach(to));
        for y in bounds(from.y, to.y - 1.0, 0.0, self.height) {
            for x in bounds(from.x, to.x - 1.0, 0.0, self.width) {
                self.blend(x, y, colour, 1.0);
            }
        }
    }

    fn text(&mut self, text: &Text) {
        if let Some(halo) = text.halo {
            for dx in -2..=2 {
                for dy in -2..=2 {
                    self.letters(text, halo, (dx, dy));
                }
            }
        }
        self.letters(text, text.colour, (0, 0));
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "float to integer casts saturate"
    )]
    fn letters(&mut self, text: &Text, colour: Colour, (dx, dy): (i64, i64)) {
        let scale = i64::from(text.scale.max(1));
        let spot = self.within_reach(text.at);
        let (mut left, top) = (spot.x as i64 + dx, spot.y as i64 + dy);
        for character in text.text.chars() {
            if left > self.width {
                return;
            }
            for (x, y) in dots_of(character) {
                for right in 0..scale {
                    for down in 0..scale {
                        self.blend(
                            left + x * scale + right,
                            top + y * scale + down,
                            colour,
                            1.0,
                        );
                    }
                }
            }
            left += i64::from(GLYPH_PX) * scale;
        }
    }

    fn within_reach(&self, spot: Spot) -> Spot {
        let (x_px, y_px) = (BEYOND * self.width as f64, BEYOND * self.height as f64);
        Spot::new(spot.x.clamp(-x_px, x_px), spot.y.clamp(-y_px, y_px))
    }

    fn blend(&mut self, x: i64, y: i64, colour: Colour, opacity: f64) {
        if opacity <= 0.0 || !(0..self.width).contains(&x) || !(0..self.height).contains(&y) {
            return;
        }
        if let Ok(index) = usize::try_from(y * self.width + x) {
            self.pixels[index] = mixed(self.pixels[index], colour, opacity);
        }
    }
}

/// Pixels that are within a distance of what lies between two coordinates.
#[expect(clippy::cast_possible_truncation, reason = "clamped to the drawing")]
fn bounds(a: f64, b: f64, half_px: f64, most: i64) -> std::ops::Range<i64> {
    let most = most as f64;
    let from = (a.min(b) - half_px - 0.5).clamp(0.0, most);
    let to = (a.max(b) + half_px + 1.0).clamp(0.0, most);
    from as i64..to as i64
}
