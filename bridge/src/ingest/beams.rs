//! What a sweep's beams passed through: free space, and proof that something seen before is gone.

use super::polar::Polar;

/// Bins before the end of a beam that it is not said to have passed, so that noise in range does not
/// clear what it hit.
const END_BINS: usize = 2;

/// The lowest beam over each place around the sensor.
#[derive(Debug)]
pub(crate) struct Beams {
    pub(crate) polar: Polar,
    /// By sector and bin: height of the lowest beam over the ground, metres; infinite where none
    /// passed. In a planar scan, which has no heights, 0 where every beam of the sector passed.
    height_m: Vec<f32>,
}

impl Beams {
    pub(crate) fn new(polar: Polar) -> Self {
        Self {
            polar,
            height_m: vec![f32::INFINITY; polar.len()],
        }
    }

    /// Takes the beams of a 3D sweep. `lowest_slope` holds for each bin the least slope of the beams
    /// that end in it, infinite if none does; it is changed. `ground_m` gives the ground's height.
    pub(crate) fn set_sweep(
        &mut self,
        lowest_slope: &mut [f32],
        sensor_height_m: f32,
        ground_m: impl Fn(usize, usize) -> f32,
    ) {
        let bins = self.polar.bins;
        for (sector, slopes) in lowest_slope.chunks_exact_mut(bins).enumerate() {
            for bin in (1..bins).rev() {
                slopes[bin - 1] = slopes[bin - 1].min(slopes[bin]);
            }
            let heights = &mut self.height_m[sector * bins..(sector + 1) * bins];
            for (bin, height_m) in heights.iter_mut().enumerate() {
                let range_m = (bin as f32 + 0.5) * super::polar::BIN_M;
                let slope = slopes.get(bin + END_BINS).copied().unwrap_or(f32::INFINITY);
                *height_m = sensor_height_m + slope * range_m - ground_m(sector, bin);
            }
        }
        self.close_gaps(lowest_slope);
    }

    /// A sector without any beam between two that have some was passed where both were.
    fn close_gaps(&mut self, lowest_slope: &[f32]) {
        let bins = self.polar.bins;
        let is_empty = |sector: usize| lowest_slope[sector * bins].is_infinite();
        for sector in 0..self.polar.sectors() {
            let left = self.polar.beside(sector, true);
            let right = self.polar.beside(sector, false);
            if is_empty(sector) && !is_empty(left) && !is_empty(right) {
                for bin in 0..bins {
                    let height_m = self.height_m(left, bin).max(self.height_m(right, bin));
                    self.height_m[sector * bins + bin] = height_m;
                }
            }
        }
    }

    /// Takes the beams of a planar scan: for each sector the distance to the nearest end of a beam,
    /// metres; 0 where there was no beam.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "reaches are positive and the cast saturates"
    )]
    pub(crate) fn set_scan(&mut self, reach_m: &[f32]) {
        let bins = self.polar.bins;
        for (heights, reach_m) in self.height_m.chunks_exact_mut(bins).zip(reach_m) {
            let reached = (reach_m / super::polar::BIN_M) as usize;
            let passed = reached.saturating_sub(END_BINS - 1).min(bins);
            heights[..passed].fill(0.0);
            heights[passed..].fill(f32::INFINITY);
        }
    }

    /// Height over the ground of the lowest beam over a place, or infinity.
    pub(crate) fn height_m(&self, sector: usize, bin: usize) -> f32 {
        self.height_m[sector * self.polar.bins + bin]
    }

    /// Height over the ground under which something at a place cannot stand any more, or infinity:
    /// the beams of the sectors beside it have to pass as well. A wall seen at a grazing angle has
    /// beams ending all along it, and those of its own sector alone would clear it.
    pub(crate) fn cleared_above_m(&self, x_m: f32, y_m: f32) -> f32 {
        let (sector, bin, _) = self.polar.locate(x_m, y_m);
        let left = self.polar.beside(sector, true);
        let right = self.polar.beside(sector, false);
        self.height_m(sector, bin)
            .max(self.height_m(left, bin))
            .max(self.height_m(right, bin))
    }
}
