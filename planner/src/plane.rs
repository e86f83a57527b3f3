//! One bit a cell: obstacles, references, targets, labels and regions.

use swath_bridge::{Cell, GridSpec, Occupancy, Pose2};

use crate::Error;
use crate::collision::WORD;

/// A bit for each cell of a grid, row-major over all cells, most significant bit first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plane {
    rows: u32,
    cols: u32,
    bits: Vec<u8>,
}

impl Plane {
    /// A plane with no cell set.
    pub fn empty(rows: u32, cols: u32) -> Self {
        let len = rows as usize * cols as usize;
        Self {
            rows,
            cols,
            bits: vec![0; len.div_ceil(8)],
        }
    }

    /// The plane of packed bytes.
    ///
    /// # Errors
    /// [`Error::Plane`] unless there are as many bytes as the cells need and the bits behind the
    /// last cell are 0.
    pub fn from_packed(rows: u32, cols: u32, bits: Vec<u8>) -> Result<Self, Error> {
        let len = rows as usize * cols as usize;
        if bits.len() != len.div_ceil(8) {
            return Err(Error::Plane {
                rows,
                cols,
                bytes: bits.len(),
                wanted: len.div_ceil(8),
            });
        }
        let spare_bits = bits.len() * 8 - len;
        if bits
            .last()
            .is_some_and(|last| u32::from(*last) & ((1 << spare_bits) - 1) != 0)
        {
            return Err(Error::PlanePadding { rows, cols });
        }
        Ok(Self { rows, cols, bits })
    }

    /// The cells of an occupancy grid at or above `threshold`; unknown cells if `unknown` says so.
    pub fn from_occupancy(occupancy: &Occupancy, threshold: i8, unknown: bool) -> Self {
        let mut plane = Self::empty(occupancy.spec.rows, occupancy.spec.cols);
        for (index, &value) in occupancy.cells.iter().enumerate() {
            if value >= threshold || (value < 0 && unknown) {
                plane.set_index(index);
            }
        }
        plane
    }

    /// Checks that a plane, `what` in the error, is of a grid's size.
    ///
    /// # Errors
    /// [`Error::Shape`] unless it is.
    pub(crate) fn check_size(&self, what: &'static str, spec: &GridSpec) -> Result<(), Error> {
        let (got, wanted) = ((self.rows, self.cols), (spec.rows, spec.cols));
        if got == wanted {
            return Ok(());
        }
        Err(Error::Shape { what, got, wanted })
    }

    /// Number of rows.
    pub const fn rows(&self) -> u32 {
        self.rows
    }

    /// Number of columns.
    pub const fn cols(&self) -> u32 {
        self.cols
    }

    /// Number of cells.
    pub const fn len(&self) -> usize {
        self.rows as usize * self.cols as usize
    }

    /// Whether there are no cells.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The packed bytes.
    pub fn packed(&self) -> &[u8] {
        &self.bits
    }

    /// The packed bytes, given away.
    pub fn into_packed(self) -> Vec<u8> {
        self.bits
    }

    /// Whether the cell of a row-major index is set. Indices beyond the grid panic.
    pub fn get_index(&self, index: usize) -> bool {
        self.bits[index / 8] & (0x80 >> (index % 8)) != 0
    }

    /// Sets the cell of a row-major index. Indices beyond the grid panic.
    pub fn set_index(&mut self, index: usize) {
        self.bits[index / 8] |= 0x80 >> (index % 8);
    }

    /// The cells as rows of whole words, column 0 in the least significant bit.
    pub(crate) fn row_words(&self) -> Vec<u64> {
        let (rows, cols) = (self.rows as usize, self.cols as usize);
        let word_at = |row: usize, col: usize| {
            let word = self.word_at(row * cols + col);
            let beyond = (col + WORD).saturating_sub(cols);
            word << beyond >> beyond
        };
        (0..rows)
            .flat_map(|row| (0..cols).step_by(WORD).map(move |col| word_at(row, col)))
            .collect()
    }

    /// The cells from a row-major index on, the first in the least significant bit.
    fn word_at(&self, index: usize) -> u64 {
        let (first, skip) = (index / 8, index % 8);
        let mut bytes = [0; 16];
        let known = &self.bits[first..self.bits.len().min(first + 9)];
        for (to, byte) in bytes.iter_mut().zip(known) {
            *to = byte.reverse_bits();
        }
        let [low, high] = [&bytes[..8], &bytes[8..]].map(|half| {
            half.iter()
                .rev()
                .fold(0u64, |word, &byte| word << 8 | u64::from(byte))
        });
        // Shifting by 1 first keeps a shift of 0 from becoming one of 64.
        low >> skip | high << 1 << (WORD - 1 - skip)
    }

    /// Whether a cell is set; cells off the grid are not.
    pub fn get(&self, cell: Cell) -> bool {
        self.index_of(cell)
            .is_some_and(|index| self.get_index(index))
    }

    /// Sets a cell; off the grid this does nothing.
    pub fn set(&mut self, cell: Cell) {
        if let Some(index) = self.index_of(cell) {
            self.set_index(index);
        }
    }

    /// Clears a cell; off the grid this does nothing.
    pub(crate) fn clear(&mut self, cell: Cell) {
        if let Some(index) = self.index_of(cell) {
            self.bits[index / 8] &= !(0x80 >> (index % 8));
        }
    }

    /// The cells around which a square of `2 cells + 1` a side is set, as far as it is on the grid.
    #[must_use]
    pub fn shrunk(&self, cells: u32) -> Self {
        let (rows, cols) = (self.rows as usize, self.cols as usize);
        let mut set = vec![false; rows * cols];
        self.each_set(|index| set[index] = true);
        for (lines, along, across) in [(rows, 1, cols), (cols, cols, 1)] {
            let len = rows * cols / lines.max(1);
            for line in 0..lines {
                shrink_line(&mut set, (line * across, along, len), cells as usize);
            }
        }
        let mut shrunk = Self::empty(self.rows, self.cols);
        let kept = set.iter().enumerate().filter(|(_, is_set)| **is_set);
        kept.for_each(|(index, _)| shrunk.set_index(index));
        shrunk
    }

    /// Calls `each` with the row-major index of every set cell, in order.
    pub fn each_set(&self, mut each: impl FnMut(usize)) {
        for (byte, &bits) in self.bits.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let bit = bits.leading_zeros() as usize;
                bits &= !(0x80 >> bit);
                each(byte * 8 + bit);
            }
        }
    }

    /// Number of set cells.
    pub fn count(&self) -> usize {
        self.bits
            .iter()
            .map(|byte| byte.count_ones() as usize)
            .sum()
    }

    /// Sets every cell that `other`, a plane of the same size, has set.
    pub fn add(&mut self, other: &Self) {
        debug_assert_eq!((self.rows, self.cols), (other.rows, other.cols));
        for (byte, more) in self.bits.iter_mut().zip(&other.bits) {
            *byte |= more;
        }
    }

    /// Sets every cell whose centre lies within `radius_m` of the line through the poses; a single
    /// pose is a disc. Poses are in the vehicle frame of `spec`, whose size must be the plane's.
    pub fn draw_line(&mut self, spec: &GridSpec, poses: &[Pose2], radius_m: f64) {
        if let [only] = poses {
            self.draw_segment(spec, (only, only), radius_m);
        }
        for pair in poses.windows(2) {
            self.draw_segment(spec, (&pair[0], &pair[1]), radius_m);
        }
    }

    fn draw_segment(&mut self, spec: &GridSpec, segment: (&Pose2, &Pose2), radius_m: f64) {
        each_cell_near(spec, segment, radius_m, |cell| self.set(cell));
    }

    #[expect(clippy::cast_sign_loss, reason = "negative numbers are excluded first")]
    fn index_of(&self, cell: Cell) -> Option<usize> {
        if cell.row < 0 || cell.col < 0 {
            return None;
        }
        let (row, col) = (cell.row as u32, cell.col as u32);
        (row < self.rows && col < self.cols)
            .then(|| row as usize * self.cols as usize + col as usize)
    }
}

/// Clears what is within so many cells of a cleared cell of a line: a first index, a stride, a length.
fn shrink_line(set: &mut [bool], (first, stride, len): (usize, usize, usize), cells: usize) {
    let mut run = 0;
    for place in 0..=len {
        if place < len && set[first + place * stride] {
            run += 1;
            continue;
        }
        // A run that ends at the grid's edge keeps that end.
        let begin = place - run;
        let low = if begin == 0 { 0 } else { begin + cells };
        let high = if place == len {
            len
        } else {
            place.saturating_sub(cells)
        };
        for inner in (begin..place).filter(|inner| !(low..high).contains(inner)) {
            set[first + inner * stride] = false;
        }
        run = 0;
    }
}

/// Calls `mark` with every cell of a grid whose centre lies within `radius_m` of a segment.
pub(crate) fn each_cell_near(
    spec: &GridSpec,
    (from, to): (&Pose2, &Pose2),
    radius_m: f64,
    mut mark: impl FnMut(Cell),
) {
    if !(from.is_finite() && to.is_finite()) {
        return;
    }
    let far = spec.cell_at(
        from.x_m.max(to.x_m) + radius_m,
        from.y_m.max(to.y_m) + radius_m,
    );
    let near = spec.cell_at(
        from.x_m.min(to.x_m) - radius_m,
        from.y_m.min(to.y_m) - radius_m,
    );
    let (along_x, along_y) = (to.x_m - from.x_m, to.y_m - from.y_m);
    let length_squared = along_x * along_x + along_y * along_y;
    let last = spec.cell_of_index(spec.len() - 1);
    for row in far.row.max(0)..=near.row.min(last.row) {
        for col in far.col.max(0)..=near.col.min(last.col) {
            let (x_m, y_m) = spec.centre_of(Cell::new(row, col));
            let (dx, dy) = (x_m - from.x_m, y_m - from.y_m);
            let share = if length_squared > 0.0 {
                ((dx * along_x + dy * along_y) / length_squared).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let (off_x, off_y) = (dx - share * along_x, dy - share * along_y);
            if off_x * off_x + off_y * off_y <= radius_m * radius_m {
                mark(Cell::new(row, col));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn packed_bits_are_row_major_and_most_significant_first() {
        let mut plane = Plane::empty(2, 5);
        plane.set(Cell::new(0, 0));
        plane.set(Cell::new(1, 4));
        assert_eq!(plane.packed(), [0b1000_0000, 0b0100_0000]);
        let mut set = Vec::new();
        plane.each_set(|index| set.push(index));
        assert_eq!(set, [0, 9]);
        assert_eq!(
            Plane::from_packed(2, 5, plane.packed().to_vec()).unwrap(),
            plane
        );
    }

    #[test]
    fn packed_bytes_of_the_wrong_size_or_with_stray_bits_are_refused() {
        assert!(Plane::from_packed(2, 5, vec![0; 1]).is_err());
        assert!(Plane::from_packed(2, 5, vec![0, 1]).is_err());
        assert!(Plane::from_packed(4096, 4096, Vec::new()).is_err());
    }

    proptest! {
        #[test]
        fn a_cell_survives_shrinking_if_all_cells_around_it_are_set(
            rows in 1u32..9, cols in 1u32..9, by in 0u32..4, seed: u64,
        ) {
            let mut plane = Plane::empty(rows, cols);
            for index in 0..plane.len() {
                // Three cells of four are set.
                if seed.rotate_left(u32::try_from(index * 5 % 64).unwrap()) & 3 != 0 {
                    plane.set_index(index);
                }
            }
            let shrunk = plane.shrunk(by);
            let by = i32::try_from(by).unwrap();
            let (rows, cols) = (i32::try_from(rows).unwrap(), i32::try_from(cols).unwrap());
            for (row, col) in (0..rows).flat_map(|row| (0..cols).map(move |col| (row, col))) {
                let around = (row - by..=row + by).flat_map(|r| (col - by..=col + by).map(move |c| (r, c)));
                let mut on_grid = around.filter(|&(r, c)| (0..rows).contains(&r) && (0..cols).contains(&c));
                let is_kept = on_grid.all(|(r, c)| plane.get(Cell::new(r, c)));
                prop_assert_eq!(shrunk.get(Cell::new(row, col)), is_kept);
            }
        }

        #[test]
        fn a_drawn_line_holds_just_the_cells_within_its_radius(
            x0 in -10.0..50.0f64, y0 in -15.0..15.0f64,
            x1 in -10.0..50.0f64, y1 in -15.0..15.0f64, radius in 0.3..3.0f64,
        ) {
            let spec = GridSpec::default();
            let line = [Pose2::new(x0, y0, 0.0), Pose2::new(x1, y1, 0.0)];
            let mut plane = Plane::empty(spec.rows, spec.cols);
            plane.draw_line(&spec, &line, radius);
            for index in (0..spec.len()).step_by(97) {
                let (x, y) = spec.centre_of(spec.cell_of_index(index));
                let nearest = (0..=500)
                    .map(|k| f64::from(k) / 500.0)
                    .map(|t| (x - x0 - t * (x1 - x0), y - y0 - t * (y1 - y0)))
                    .map(|(dx, dy)| dx * dx + dy * dy)
                    .fold(f64::INFINITY, f64::min)
                    .sqrt();
                if (nearest - radius).abs() > 0.1 {
                    prop_assert_eq!(plane.get_index(index), nearest <= radius);
                }
            }
        }
    }
}
