//! From the network's logits back to the cells of a grid.

#![expect(
    clippy::inline_always,
    reason = "a loop must be compiled within the function that enables its instructions"
)]

use super::engine::kernel::{Isa, compiled_for};
use super::engine::spatial::{FAR, NEAR, bilinear_lines};
use super::input::{Encoding, InputSize};
use crate::Plane;

impl Encoding {
    /// The logit of each cell of the grid.
    ///
    /// # Shapes
    /// `logits`: rows × cols of [`Self::input_size`]; `cells`: rows × cols of the grid.
    pub fn decode(&self, logits: &[f32], cells: &mut [f32]) {
        compiled_for(Isa::detect(), || {
            let mut lines = Lines::new(self, logits);
            for (row, cells) in cells.chunks_exact_mut(self.cols()).enumerate() {
                cells.copy_from_slice(lines.line(row));
            }
        });
    }

    /// The plane of the cells whose logit is above 0.
    ///
    /// # Shapes
    /// `logits`: rows × cols of [`Self::input_size`].
    pub fn region(&self, logits: &[f32]) -> Plane {
        let mut bits = BitWriter::with_capacity(self.cells());
        compiled_for(Isa::detect(), || self.each_above_zero(logits, &mut bits));
        let empty = || Plane::empty(self.spec.rows, self.spec.cols);
        let plane = Plane::from_packed(self.spec.rows, self.spec.cols, bits.into_bytes());
        debug_assert!(plane.is_ok(), "as many bits as cells were written");
        plane.unwrap_or_else(|_| empty())
    }

    #[inline(always)]
    fn each_above_zero(&self, logits: &[f32], bits: &mut BitWriter) {
        let mut lines = Lines::new(self, logits);
        for row in 0..self.rows() {
            let (whole, rest) = lines.line(row).as_chunks::<32>();
            for cells in whole {
                bits.push(above_zero(cells), 32);
            }
            if !rest.is_empty() {
                bits.push(above_zero(rest), rest.len());
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
        for (row, cells) in cells.chunks_exact(self.cols()).enumerate() {
            match self.size {
                InputSize::Full => {
                    logits[row * input_cols..][..self.cols()].copy_from_slice(cells);
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
}

/// Most columns of a line, with one more on each side.
const MAX_LINE: usize = 1026;

/// Lines of the grid's logits, one after the other.
struct Lines<'a> {
    logits: &'a [f32],
    encoding: &'a Encoding,
    size: (usize, usize),
    /// A line of the input's width between the two that it lies between, its ends repeated.
    mixed: [f32; MAX_LINE],
    /// Twice as wide.
    line: [f32; 2 * MAX_LINE],
}

impl<'a> Lines<'a> {
    #[inline(always)]
    fn new(encoding: &'a Encoding, logits: &'a [f32]) -> Self {
        Self {
            logits,
            encoding,
            size: encoding.input_size(),
            mixed: [0.0; MAX_LINE],
            line: [0.0; 2 * MAX_LINE],
        }
    }

    #[inline(always)]
    fn line(&mut self, row: usize) -> &[f32] {
        let (rows, cols) = self.size;
        let input = |row: usize| &self.logits[row * cols..][..cols];
        match self.encoding.size {
            InputSize::Full => &input(row)[..self.encoding.cols()],
            InputSize::Half => {
                let (near, far) = bilinear_lines(row, rows);
                let (near, far) = (input(near), input(far));
                let mixed = &mut self.mixed[..cols + 2];
                for ((mixed, near), far) in mixed[1..=cols].iter_mut().zip(near).zip(far) {
                    *mixed = NEAR * near + FAR * far;
                }
                mixed[0] = mixed[1];
                mixed[cols + 1] = mixed[cols];
                let line = &mut self.line[..2 * cols];
                let neighbours = mixed.iter().zip(&mixed[1..]).zip(&mixed[2..]);
                for (pair, ((left, here), right)) in line.chunks_exact_mut(2).zip(neighbours) {
                    pair[0] = NEAR * here + FAR * left;
                    pair[1] = NEAR * here + FAR * right;
                }
                &line[..self.encoding.cols()]
            }
        }
    }
}

/// A bit for each of up to 32 cells, the first one the highest of them.
#[inline(always)]
fn above_zero(cells: &[f32]) -> u32 {
    let mut bits = 0;
    for (index, &cell) in cells.iter().enumerate() {
        bits |= u32::from(cell > 0.0) << index;
    }
    bits.reverse_bits() >> (32 - cells.len())
}

/// Packs bits, the most significant first.
struct BitWriter {
    bytes: Vec<u8>,
    held: u64,
    count: usize,
}

impl BitWriter {
    fn with_capacity(bits: usize) -> Self {
        Self {
            bytes: Vec::with_capacity(bits.div_ceil(8)),
            held: 0,
            count: 0,
        }
    }

    /// Adds the lowest `count` bits, at most 32.
    #[inline(always)]
    fn push(&mut self, bits: u32, count: usize) {
        self.held = self.held << count | u64::from(bits);
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            self.bytes.push((self.held >> self.count & 0xff) as u8);
        }
    }

    fn into_bytes(mut self) -> Vec<u8> {
        if self.count > 0 {
            let spare = 8 - self.count;
            self.bytes.push((self.held << spare & 0xff) as u8);
        }
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::input::tests::encoding;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_region_is_where_decoded_logits_are_above_zero(
            rows in 1u32..40, cols in 1u32..90, half: bool, seed in 0u32..1000,
        ) {
            let size = if half { InputSize::Half } else { InputSize::Full };
            let encoding = encoding(rows, cols, size);
            let logits: Vec<f32> = (0..encoding.output_len())
                .map(|index| f32::from(u8::try_from((index * 37 + seed as usize * 11) % 19).unwrap()) - 9.0)
                .collect();
            let (_, input_cols) = encoding.input_size();
            let region = encoding.region(&logits);
            let mut cells = vec![0.0; encoding.cells()];
            encoding.decode(&logits, &mut cells);
            for (index, &cell) in cells.iter().enumerate() {
                prop_assert_eq!(region.get_index(index), cell > 0.0);
                let (row, col) = (index / cols as usize, index % cols as usize);
                if !half {
                    prop_assert_eq!(cell, logits[row * input_cols + col]);
                }
            }
        }

        #[test]
        fn the_gradient_of_decoding_is_its_transpose(
            rows in 1u32..30, cols in 1u32..30, half: bool, seed in 0u32..1000,
        ) {
            let size = if half { InputSize::Half } else { InputSize::Full };
            let encoding = encoding(rows, cols, size);
            let logit_len = encoding.output_len();
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
