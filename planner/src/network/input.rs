//! From planes to the network's input and from its logits back to planes.

use serde::{Deserialize, Serialize};

use super::engine::spatial::{FAR, NEAR, bilinear_lines};
use super::graph::{INPUT_PLANES, SIDE_MULTIPLE};
use crate::{Error, Plane};

/// At what resolution the network sees a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InputSize {
    /// Every cell is a pixel.
    Full,
    /// A pixel is the maximum of 2 × 2 cells; logits come back bilinearly.
    #[default]
    Half,
}

impl InputSize {
    /// The name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Half => "half",
        }
    }

    /// The size of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Full, Self::Half]
            .into_iter()
            .find(|size| size.name() == name)
    }
}

/// How grids of one size enter and leave the network.
///
/// The grid is padded with zeros below and on the right to multiples of
/// [`SIDE_MULTIPLE`]: 401 × 151 becomes 408 × 152, or 208 × 80 at half size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoding {
    rows: usize,
    cols: usize,
    size: InputSize,
}

impl Encoding {
    /// The encoding of grids of `rows` × `cols` cells.
    pub const fn new(rows: u32, cols: u32, size: InputSize) -> Self {
        Self {
            rows: rows as usize,
            cols: cols as usize,
            size,
        }
    }

    /// Rows and columns of the network's input.
    pub const fn input_size(&self) -> (usize, usize) {
        let (rows, cols) = self.pixels();
        (
            rows.next_multiple_of(SIDE_MULTIPLE),
            cols.next_multiple_of(SIDE_MULTIPLE),
        )
    }

    /// Number of floats of one input.
    pub const fn input_len(&self) -> usize {
        let (rows, cols) = self.input_size();
        rows * cols * INPUT_PLANES
    }

    /// Number of cells of the grid.
    pub const fn cells(&self) -> usize {
        self.rows * self.cols
    }

    /// Checks that a plane is of the grid's size.
    ///
    /// # Errors
    /// [`Error::Shape`] unless it is.
    pub fn check(&self, plane: &Plane) -> Result<(), Error> {
        if (plane.rows() as usize, plane.cols() as usize) == (self.rows, self.cols) {
            return Ok(());
        }
        let side = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
        Err(Error::Shape {
            what: "plane for the network",
            got: (plane.rows(), plane.cols()),
            wanted: (side(self.rows), side(self.cols)),
        })
    }

    /// Writes planes of the grid's size as an input: each becomes one of the innermost channels.
    ///
    /// # Shapes
    /// `input`: rows × cols × 3 of [`Self::input_size`].
    ///
    /// # Errors
    /// [`Error::Shape`] if a plane is of another size.
    pub fn encode(&self, planes: [&Plane; INPUT_PLANES], input: &mut [f32]) -> Result<(), Error> {
        input.fill(0.0);
        let (_, input_cols) = self.input_size();
        let shrink = self.shrink();
        for (channel, plane) in planes.into_iter().enumerate() {
            self.check(plane)?;
            for (byte, &bits) in plane.packed().iter().enumerate() {
                let mut bits = bits;
                while bits != 0 {
                    let bit = bits.leading_zeros() as usize;
                    bits &= !(0x80 >> bit);
                    let cell = byte * 8 + bit;
                    let (row, col) = (cell / self.cols / shrink, cell % self.cols / shrink);
                    input[(row * input_cols + col) * INPUT_PLANES + channel] = 1.0;
                }
            }
        }
        Ok(())
    }

    /// The logit of each cell of the grid.
    ///
    /// # Shapes
    /// `logits`: rows × cols of [`Self::input_size`]; `cells`: rows × cols of the grid.
    pub fn decode(&self, logits: &[f32], cells: &mut [f32]) {
        let (input_rows, input_cols) = self.input_size();
        match self.size {
            InputSize::Full => {
                for (cells, logits) in cells
                    .chunks_exact_mut(self.cols)
                    .zip(logits.chunks_exact(input_cols))
                {
                    cells.copy_from_slice(&logits[..self.cols]);
                }
            }
            InputSize::Half => {
                for (row, cells) in cells.chunks_exact_mut(self.cols).enumerate() {
                    let (near, far) = bilinear_lines(row, input_rows);
                    let near = &logits[near * input_cols..][..input_cols];
                    let far = &logits[far * input_cols..][..input_cols];
                    let mixed = |col: usize| NEAR * near[col] + FAR * far[col];
                    for (col, cell) in cells.iter_mut().enumerate() {
                        let (near, far) = bilinear_lines(col, input_cols);
                        *cell = NEAR * mixed(near) + FAR * mixed(far);
                    }
                }
            }
        }
    }

    /// The gradient at the logits, given that at the cells: the transpose of [`Self::decode`].
    ///
    /// # Shapes
    /// As [`Self::decode`].
    pub fn decode_backward(&self, cells: &[f32], logits: &mut [f32]) {
        logits.fill(0.0);
        let (input_rows, input_cols) = self.input_size();
        for (row, cells) in cells.chunks_exact(self.cols).enumerate() {
            match self.size {
                InputSize::Full => {
                    logits[row * input_cols..][..self.cols].copy_from_slice(cells);
                }
                InputSize::Half => {
                    let (near, far) = bilinear_lines(row, input_rows);
                    for (line, share) in [(near, NEAR), (far, FAR)] {
                        let line = &mut logits[line * input_cols..][..input_cols];
                        for (col, &cell) in cells.iter().enumerate() {
                            let (near, far) = bilinear_lines(col, input_cols);
                            line[near] += share * NEAR * cell;
                            line[far] += share * FAR * cell;
                        }
                    }
                }
            }
        }
    }

    /// The plane of the cells whose logit is above 0.
    pub fn region(&self, cells: &[f32]) -> Plane {
        let side = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
        let mut plane = Plane::empty(side(self.rows), side(self.cols));
        for (index, &logit) in cells.iter().enumerate() {
            if logit > 0.0 {
                plane.set_index(index);
            }
        }
        plane
    }

    const fn shrink(&self) -> usize {
        match self.size {
            InputSize::Full => 1,
            InputSize::Half => 2,
        }
    }

    const fn pixels(&self) -> (usize, usize) {
        let shrink = self.shrink();
        (self.rows.div_ceil(shrink), self.cols.div_ceil(shrink))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use swath_bridge::Cell;

    #[test]
    fn the_default_grid_is_padded_as_designed() {
        assert_eq!(
            Encoding::new(401, 151, InputSize::Full).input_size(),
            (408, 152)
        );
        assert_eq!(
            Encoding::new(401, 151, InputSize::Half).input_size(),
            (208, 80)
        );
    }

    #[test]
    fn a_pixel_of_half_size_is_set_if_any_of_its_cells_is() {
        let encoding = Encoding::new(5, 7, InputSize::Half);
        let mut plane = Plane::empty(5, 7);
        plane.set(Cell::new(4, 6));
        plane.set(Cell::new(1, 2));
        let empty = Plane::empty(5, 7);
        let mut input = vec![9.0; encoding.input_len()];
        encoding
            .encode([&empty, &plane, &empty], &mut input)
            .unwrap();
        let set: Vec<usize> = (0..input.len())
            .filter(|&index| input[index] != 0.0)
            .collect();
        let at = |row: usize, col: usize| (row * 8 + col) * INPUT_PLANES + 1;
        assert_eq!(set, [at(0, 1), at(2, 3)]);
    }

    #[test]
    fn a_plane_of_another_size_is_refused() {
        let encoding = Encoding::new(5, 7, InputSize::Full);
        let (right, wrong) = (Plane::empty(5, 7), Plane::empty(7, 5));
        let mut input = vec![0.0; encoding.input_len()];
        assert!(
            encoding
                .encode([&right, &wrong, &right], &mut input)
                .is_err()
        );
    }

    proptest! {
        #[test]
        fn the_gradient_of_decoding_is_its_transpose(
            rows in 1u32..30, cols in 1u32..30, half: bool, seed in 0u32..1000,
        ) {
            let size = if half { InputSize::Half } else { InputSize::Full };
            let encoding = Encoding::new(rows, cols, size);
            let logit_len = encoding.input_len() / INPUT_PLANES;
            let value = |index: usize| f32::from(u8::try_from((index * 37 + seed as usize * 11) % 19).unwrap()) - 9.0;
            let logits: Vec<f32> = (0..logit_len).map(value).collect();
            let weights: Vec<f32> = (0..encoding.cells()).map(|index| value(index + 5)).collect();
            let mut cells = vec![0.0; encoding.cells()];
            encoding.decode(&logits, &mut cells);
            let mut back = vec![0.0; logit_len];
            encoding.decode_backward(&weights, &mut back);
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let (forward, backward) = (dot(&cells, &weights), dot(&logits, &back));
            prop_assert!((forward - backward).abs() <= 1e-3 * (1.0 + forward.abs()));
        }
    }
}
