//! Pictures of grids, with the vehicle heading up: PNG files that look the same on every machine.

use std::path::Path;

use crate::Error;
use crate::drawing::{GLYPH_PX, dots_of, png_of};
use crate::geometry::{Cell, GridSpec, Pose2};
use crate::occupancy::{OCCUPIED, Occupancy};
use crate::vehicle::Vehicle;

/// Most pixels along a side; larger pictures get fewer pixels a cell.
pub const MAX_SIDE_PX: u32 = 8192;

/// Red, green and blue.
pub type Colour = [u8; 3];

/// Something unknown.
pub const GREY: Colour = [205, 205, 210];
/// Free ground.
pub const WHITE: Colour = [252, 252, 252];
/// Obstacles and writing.
pub const BLACK: Colour = [28, 30, 38];
/// The vehicle.
pub const BLUE: Colour = [31, 98, 196];
/// References.
pub const GREEN: Colour = [26, 150, 84];
/// Paths.
pub const RED: Colour = [212, 52, 44];
/// Regions and targets.
pub const ORANGE: Colour = [240, 150, 30];

/// A picture of a grid that can be drawn upon in metres of the vehicle frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    spec: GridSpec,
    pixels_a_cell: u32,
    pixels: Vec<Colour>,
}

impl Picture {
    /// A white picture of a grid.
    pub fn blank(spec: &GridSpec, pixels_a_cell: u32) -> Self {
        let most = MAX_SIDE_PX / spec.rows.max(spec.cols).max(1);
        let pixels_a_cell = pixels_a_cell.clamp(1, most.max(1));
        let len = spec.len() * (pixels_a_cell as usize).pow(2);
        Self {
            spec: *spec,
            pixels_a_cell,
            pixels: vec![WHITE; len],
        }
    }

    /// Occupied cells black, free ones white, unknown ones grey.
    pub fn of(occupancy: &Occupancy, pixels_a_cell: u32) -> Self {
        let mut picture = Self::blank(&occupancy.spec, pixels_a_cell);
        picture.paint_cells(|cell, _| {
            let value = occupancy.get(cell).unwrap_or_default();
            if value < 0 {
                GREY
            } else {
                mixed(WHITE, BLACK, f64::from(value) / f64::from(OCCUPIED))
            }
        });
        picture
    }

    /// Pictures of the same number of pixels a cell in a row, their upper edges aligned.
    pub fn side_by_side(pictures: &[Self]) -> Self {
        const GAP_CELLS: u32 = 4;
        let Some(first) = pictures.first() else {
            return Self::blank(&GridSpec::default(), 1);
        };
        let cols = pictures.iter().map(|picture| picture.spec.cols + GAP_CELLS);
        let rows = pictures.iter().map(|picture| picture.spec.rows);
        let spec = GridSpec {
            rows: rows.max().unwrap_or_default(),
            cols: cols.sum::<u32>() - GAP_CELLS,
            ..first.spec
        };
        let side = first.pixels_a_cell;
        let width = (spec.cols * side) as usize;
        let mut row = Self {
            spec,
            pixels_a_cell: side,
            pixels: vec![GREY; width * (spec.rows * side) as usize],
        };
        let mut left = 0;
        for picture in pictures {
            let (own_width, _) = picture.size_px();
            let own_width = (own_width as usize).min(width - left);
            let lines = picture.pixels.chunks_exact(own_width.max(1));
            for (to, from) in row.pixels.chunks_exact_mut(width).zip(lines) {
                to[left..left + own_width].copy_from_slice(from);
            }
            left = width.min(left + own_width + (GAP_CELLS * side) as usize);
        }
        row
    }

    /// Width and height, pixels.
    pub const fn size_px(&self) -> (u32, u32) {
        (
            self.spec.cols * self.pixels_a_cell,
            self.spec.rows * self.pixels_a_cell,
        )
    }

    /// Lays a colour over some cells; `opacity` is 1 for nothing to be seen through it.
    pub fn overlay(&mut self, colour: Colour, opacity: f64, is_set: impl Fn(Cell) -> bool) {
        self.paint_cells(|cell, below| {
            if is_set(cell) {
                mixed(below, colour, opacity)
            } else {
                below
            }
        });
    }

    /// Draws a line through poses.
    pub fn line(&mut self, poses: &[Pose2], colour: Colour, width_px: f64) {
        let points: Vec<(f64, f64)> = poses.iter().map(|pose| self.pixel_of(pose)).collect();
        for pair in points.windows(2) {
            self.segment((pair[0], pair[1]), colour, width_px);
        }
    }

    /// Draws the outline of the vehicle at a pose, with a line to its front.
    pub fn vehicle(&mut self, pose: &Pose2, vehicle: &Vehicle, colour: Colour) {
        let corner = |x_m, y_m| pose.then(&Pose2::new(x_m, y_m, 0.0));
        let (front_m, rear_m, side_m) = (vehicle.front_m, -vehicle.rear_m, vehicle.half_width_m);
        let outline = [
            corner(front_m, side_m),
            corner(front_m, -side_m),
            corner(rear_m, -side_m),
            corner(rear_m, side_m),
            corner(front_m, side_m),
        ];
        self.line(&outline, colour, 2.0);
        self.line(&[*pose, corner(front_m, 0.0)], colour, 2.0);
    }

    /// Fills a disc around a pose.
    pub fn disc(&mut self, centre: &Pose2, radius_m: f64, colour: Colour) {
        let at = self.pixel_of(centre);
        let diameter_px = 2.0 * radius_m / self.spec.resolution_m * f64::from(self.pixels_a_cell);
        self.segment((at, at), colour, diameter_px);
    }

    /// Draws a bar of a round number of metres, with that number, at the lower left.
    pub fn scale_bar(&mut self) {
        let (width_px, height_px) = self.size_px();
        let px_a_m = f64::from(self.pixels_a_cell) / self.spec.resolution_m;
        let fits = |metres: &&u32| f64::from(**metres) * px_a_m <= f64::from(width_px) / 2.0;
        let metres = [1000, 500, 200, 100, 50, 20, 10, 5, 2, 1]
            .iter()
            .find(fits)
            .unwrap_or(&1);
        let (left, base) = (8.0, f64::from(height_px) - 8.0);
        let right = left + f64::from(*metres) * px_a_m;
        for (from, to) in [
            ((left, base), (right, base)),
            ((left, base - 5.0), (left, base)),
            ((right, base - 5.0), (right, base)),
        ] {
            self.segment((from, to), BLACK, 2.0);
        }
        self.text(&format!("{metres} m"), (left + 4.0, base - 22.0), BLACK);
    }

    /// Writes at a pixel, the upper left of the text. Letters without a glyph are left blank.
    pub fn text(&mut self, text: &str, at_px: (f64, f64), colour: Colour) {
        const DOT_PX: i64 = 2;
        let advance_px = i64::from(GLYPH_PX) * DOT_PX;
        #[expect(clippy::cast_possible_truncation, reason = "places in a picture")]
        let (mut left, top) = (at_px.0 as i64, at_px.1 as i64);
        for character in text.chars() {
            for (x, y) in dots_of(character) {
                for dy in 0..DOT_PX {
                    for dx in 0..DOT_PX {
                        self.set(left + x * DOT_PX + dx, top + y * DOT_PX + dy, colour);
                    }
                }
            }
            left += advance_px;
        }
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// [`Error::Io`], of no path, if it cannot be encoded.
    pub fn to_png(&self) -> Result<Vec<u8>, Error> {
        let (width_px, height_px) = self.size_px();
        png_of(width_px, height_px, &self.pixels)
    }

    /// Writes the picture as a PNG file.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn write_png(&self, path: &Path) -> Result<(), Error> {
        let bytes = self.to_png()?;
        std::fs::write(path, bytes).map_err(|source| Error::Io {
            path: path.to_owned(),
            source,
        })
    }

    fn paint_cells(&mut self, colour_of: impl Fn(Cell, Colour) -> Colour) {
        let side = self.pixels_a_cell as usize;
        let width = self.spec.cols as usize * side;
        for index in 0..self.spec.len() {
            let cell = self.spec.cell_of_index(index);
            let cols = self.spec.cols as usize;
            let corner = index / cols * side * width + index % cols * side;
            for row in 0..side {
                for pixel in &mut self.pixels[corner + row * width..][..side] {
                    *pixel = colour_of(cell, *pixel);
                }
            }
        }
    }

    /// The place of a pose in pixels from the upper left: x to the right, y down.
    fn pixel_of(&self, pose: &Pose2) -> (f64, f64) {
        let side = f64::from(self.pixels_a_cell);
        (
            (f64::from(self.spec.ego_col) + 0.5 - pose.y_m / self.spec.resolution_m) * side,
            (f64::from(self.spec.ego_row) + 0.5 - pose.x_m / self.spec.resolution_m) * side,
        )
    }

    /// Fills the pixels whose centres are within half the width of a segment.
    #[expect(clippy::cast_possible_truncation, reason = "clamped to the picture")]
    fn segment(&mut self, (from, to): ((f64, f64), (f64, f64)), colour: Colour, width_px: f64) {
        if ![from.0, from.1, to.0, to.1]
            .iter()
            .all(|number| number.is_finite())
        {
            return;
        }
        let half_px = (width_px / 2.0).max(0.5);
        let (width, height) = self.size_px();
        let bounds = |a: f64, b: f64, most: u32| {
            let from = (a.min(b) - half_px).clamp(0.0, f64::from(most)) as i64;
            from..(a.max(b) + half_px + 1.0).clamp(0.0, f64::from(most)) as i64
        };
        let (along_x, along_y) = (to.0 - from.0, to.1 - from.1);
        let squared = along_x * along_x + along_y * along_y;
        for y in bounds(from.1, to.1, height) {
            for x in bounds(from.0, to.0, width) {
                let (dx, dy) = (x as f64 + 0.5 - from.0, y as f64 + 0.5 - from.1);
                let along = if squared > 0.0 {
                    (dx * along_x + dy * along_y) / squared
                } else {
                    0.0
                };
                let along = along.clamp(0.0, 1.0);
                let (off_x, off_y) = (dx - along * along_x, dy - along * along_y);
                if off_x * off_x + off_y * off_y <= half_px * half_px {
                    self.set(x, y, colour);
                }
            }
        }
    }

    fn set(&mut self, x: i64, y: i64, colour: Colour) {
        let (width, height) = self.size_px();
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
            return;
        };
        if x < width && y < height {
            self.pixels[y as usize * width as usize + x as usize] = colour;
        }
    }
}

pub(crate) fn mixed(below: Colour, above: Colour, opacity: f64) -> Colour {
    let opacity = opacity.clamp(0.0, 1.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between two colours"
    )]
    std::array::from_fn(|part| {
        let (below, above) = (f64::from(below[part]), f64::from(above[part]));
        (below + opacity * (above - below) + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::occupancy::{FREE, UNKNOWN};

    const SPEC: GridSpec = GridSpec {
        rows: 40,
        cols: 30,
        resolution_m: 0.5,
        ego_row: 30,
        ego_col: 15,
    };

    fn at(picture: &Picture, cell: Cell) -> Colour {
        let side = picture.pixels_a_cell;
        let (x, y) = (
            u32::try_from(cell.col).unwrap(),
            u32::try_from(cell.row).unwrap(),
        );
        let (width, _) = picture.size_px();
        picture.pixels[((y * side + side / 2) * width + x * side + side / 2) as usize]
    }

    #[test]
    fn cells_have_the_colour_of_what_is_known() {
        let mut occupancy = Occupancy::filled(SPEC, FREE);
        occupancy.set(Cell::new(3, 4), OCCUPIED);
        occupancy.set(Cell::new(5, 6), UNKNOWN);
        let picture = Picture::of(&occupancy, 3);
        assert_eq!(picture.size_px(), (90, 120));
        assert_eq!(at(&picture, Cell::new(3, 4)), BLACK);
        assert_eq!(at(&picture, Cell::new(5, 6)), GREY);
        assert_eq!(at(&picture, Cell::new(4, 3)), WHITE);
    }

    #[test]
    fn what_is_drawn_lies_where_its_metres_say() {
        let mut picture = Picture::blank(&SPEC, 4);
        picture.line(&[Pose2::default(), Pose2::new(10.0, 0.0, 0.0)], GREEN, 2.0);
        picture.disc(&Pose2::new(5.0, 5.0, 0.0), 0.6, ORANGE);
        picture.overlay(RED, 1.0, |cell| cell == Cell::new(0, 29));
        assert_eq!(at(&picture, SPEC.cell_at(10.0, 0.0)), GREEN);
        assert_eq!(at(&picture, SPEC.cell_at(11.0, 0.0)), WHITE);
        assert_eq!(at(&picture, SPEC.cell_at(5.5, 5.0)), ORANGE);
        assert_eq!(at(&picture, SPEC.cell_at(5.0, 4.0)), WHITE);
        assert_eq!(at(&picture, Cell::new(0, 29)), RED);
    }

    #[test]
    fn nothing_that_is_drawn_off_the_picture_panics() {
        let mut picture = Picture::blank(&SPEC, 2);
        let far = Pose2::new(1e300, -1e300, 0.0);
        picture.line(
            &[far, Pose2::new(f64::NAN, 0.0, 0.0), Pose2::default(), far],
            RED,
            3.0,
        );
        picture.vehicle(&Pose2::new(9.9, 7.0, 1.0), &Vehicle::default(), BLUE);
        picture.text("10 m", (-5.0, 78.0), BLACK);
        picture.scale_bar();
        assert!(picture.pixels.contains(&BLUE) && picture.pixels.contains(&BLACK));
    }

    #[test]
    fn the_png_decodes_to_the_same_pixels() {
        let mut picture = Picture::blank(&SPEC, 3);
        picture.scale_bar();
        let bytes = picture.to_png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, picture.pixels.as_flattened());
        assert_eq!(bytes, picture.clone().to_png().unwrap());
    }

    #[test]
    fn huge_grids_get_fewer_pixels_a_cell() {
        let spec = GridSpec {
            rows: 4096,
            cols: 2,
            resolution_m: 1.0,
            ego_row: 0,
            ego_col: 0,
        };
        assert_eq!(Picture::blank(&spec, 100).size_px(), (4, 8192));
    }

    #[test]
    fn pictures_in_a_row_keep_their_cells_and_leave_gaps() {
        let mut dark = Picture::blank(&SPEC, 2);
        dark.overlay(BLACK, 1.0, |_| true);
        let row = Picture::side_by_side(&[Picture::blank(&SPEC, 2), dark]);
        assert_eq!(row.size_px(), (2 * (30 + 4 + 30), 80));
        assert_eq!(at(&row, Cell::new(5, 29)), WHITE);
        assert_eq!(at(&row, Cell::new(5, 31)), GREY);
        assert_eq!(at(&row, Cell::new(5, 34)), BLACK);
        assert_eq!(at(&row, Cell::new(39, 63)), BLACK);
    }
}
