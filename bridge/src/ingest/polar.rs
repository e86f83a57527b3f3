//! Sectors and distance bins around a sensor, for what its beams say.
//!
//! Sectors divide the diamond |x| + |y| = 1 rather than the circle. That takes no trigonometry, so it
//! is quick and the same on every machine; sectors are up to twice as wide on the axes as on the
//! diagonals.

/// Depth of a bin, metres.
pub(crate) const BIN_M: f32 = 0.25;

/// A division of the plane around a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Polar {
    /// The point: x and y in the vehicle frame, metres.
    pub(crate) origin_m: (f32, f32),
    /// Sectors between two axes.
    pub(crate) sectors_a_quadrant: usize,
    /// Bins of a sector; the last one holds all that lies beyond.
    pub(crate) bins: usize,
}

impl Polar {
    /// Number of sectors.
    pub(crate) const fn sectors(&self) -> usize {
        4 * self.sectors_a_quadrant
    }

    /// Number of bins of all sectors.
    pub(crate) const fn len(&self) -> usize {
        self.sectors() * self.bins
    }

    /// Sector, bin and distance of a point of the vehicle frame.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "both values are positive and capped"
    )]
    pub(crate) fn locate(&self, x_m: f32, y_m: f32) -> (usize, usize, f32) {
        let (dx, dy) = (x_m - self.origin_m.0, y_m - self.origin_m.1);
        let range_m = (dx * dx + dy * dy).sqrt();
        let (quadrant, part) = match (dx >= 0.0, dy >= 0.0) {
            (true, true) => (0, dy / (dx + dy)),
            (false, true) => (1, dx / (dx - dy)),
            (false, false) => (2, dy / (dx + dy)),
            (true, false) => (3, dx / (dx - dy)),
        };
        // At the origin itself the part is NaN, which becomes 0.
        let sector = (part * self.sectors_a_quadrant as f32) as usize;
        let sector = quadrant * self.sectors_a_quadrant + sector.min(self.sectors_a_quadrant - 1);
        let bin = ((range_m * (1.0 / BIN_M)) as usize).min(self.bins - 1);
        (sector, bin, range_m)
    }

    /// The sector to the left or right of another.
    pub(crate) const fn beside(&self, sector: usize, is_left: bool) -> usize {
        let sectors = self.sectors();
        let step = if is_left { 1 } else { sectors - 1 };
        (sector + step) % sectors
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const POLAR: Polar = Polar {
        origin_m: (1.0, -2.0),
        sectors_a_quadrant: 50,
        bins: 100,
    };

    #[test]
    fn sectors_run_counter_clockwise_and_each_direction_has_one() {
        let mut seen = vec![false; POLAR.sectors()];
        let mut last = 0;
        for step in 0..3600 {
            let angle_rad = f64::from(step) * std::f64::consts::TAU / 3600.0 + 1e-6;
            #[expect(clippy::cast_possible_truncation, reason = "a unit vector")]
            let (dx, dy) = (libm::cos(angle_rad) as f32, libm::sin(angle_rad) as f32);
            let (sector, bin, range_m) = POLAR.locate(1.0 + 7.1 * dx, -2.0 + 7.1 * dy);
            assert!(sector == last || sector == last + 1, "{last} then {sector}");
            assert_eq!(bin, 28);
            assert!((range_m - 7.1).abs() < 1e-4);
            seen[sector] = true;
            last = sector;
        }
        assert!(seen.iter().all(|seen| *seen));
        assert_eq!(POLAR.beside(0, false), 199);
        assert_eq!(POLAR.beside(199, true), 0);
    }

    proptest! {
        #[test]
        fn every_point_has_a_place(x_m in any::<f32>(), y_m in any::<f32>()) {
            let (sector, bin, _) = POLAR.locate(x_m, y_m);
            prop_assert!(sector < POLAR.sectors() && bin < POLAR.bins);
        }
    }
}
