//! What planners ask of a predicted region.
//!
//! The paper puts its region into one search as a factor on cost and heuristic (Algorithm 1). Other
//! planners take the same region in their own way: a search asks for the factor at a cell, a sampler for
//! points inside. Without a region the factor is 1 everywhere and there is nothing to draw from. Nothing
//! is ever forbidden outside: a region that is wrong costs time, not completeness.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use swath_bridge::{GridSpec, Pose2};

use crate::{Error, Plane};

/// Where a path is expected, if anything is known of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Guidance<'a> {
    region: Option<(&'a Plane, f64)>,
}

impl<'a> Guidance<'a> {
    /// Nothing is expected.
    pub const NONE: Self = Self { region: None };

    /// A path is expected inside `cells`; `weight`, in (0, 1], is the factor there, 0.15 in the paper.
    pub const fn inside(cells: &'a Plane, weight: f64) -> Self {
        Self {
            region: Some((cells, weight)),
        }
    }

    /// Checks that the region fits a grid.
    ///
    /// # Errors
    /// [`Error::Shape`] if it is of another size, [`Error::RegionWeight`] if its weight is out of range.
    pub fn check(&self, spec: &GridSpec) -> Result<(), Error> {
        let Some((cells, weight)) = self.region else {
            return Ok(());
        };
        cells.check_size("region", spec)?;
        if weight > 0.0 && weight <= 1.0 {
            Ok(())
        } else {
            Err(Error::RegionWeight { weight })
        }
    }

    /// The factor inside, if there is a region.
    #[inline]
    pub fn weight(&self) -> Option<f64> {
        self.region.map(|(_, weight)| weight)
    }

    /// Whether the cell of a row-major index is inside. Indices beyond the grid panic.
    #[inline]
    pub fn holds(&self, index: usize) -> bool {
        self.region.is_some_and(|(cells, _)| cells.get_index(index))
    }

    /// The factor on costs and lower bounds at a cell: the weight inside, else 1. Indices beyond the
    /// grid panic.
    #[inline]
    pub fn factor(&self, index: usize) -> f64 {
        match self.region {
            Some((cells, weight)) if cells.get_index(index) => weight,
            _ => 1.0,
        }
    }

    /// The factor at a pose; 1 off the grid.
    pub fn factor_at(&self, spec: &GridSpec, pose: &Pose2) -> f64 {
        let cell = spec.cell_at(pose.x_m, pose.y_m);
        spec.index_of(cell).map_or(1.0, |index| self.factor(index))
    }
}

/// Draws points from a region, each place in it being as likely; its memory is kept from plan to plan.
#[derive(Debug, Default)]
pub(crate) struct RegionSampler {
    cells: Vec<usize>,
}

impl RegionSampler {
    /// Makes ready to draw from a region.
    pub(crate) fn prepare(&mut self, guidance: Guidance<'_>) {
        self.cells.clear();
        if let Some((cells, _)) = guidance.region {
            cells.each_set(|index| self.cells.push(index));
        }
    }

    /// A point (x, y) in metres, vehicle frame; none if there is no region or nothing in it.
    pub(crate) fn draw(&self, spec: &GridSpec, random: &mut ChaCha8Rng) -> Option<(f64, f64)> {
        let index = below(self.cells.len(), random)?;
        let (x_m, y_m) = spec.centre_of(spec.cell_of_index(self.cells[index]));
        let mut aside = || spec.resolution_m * (unit(random) - 0.5);
        Some((x_m + aside(), y_m + aside()))
    }
}

/// A number in [0, 1).
pub(crate) fn unit(random: &mut ChaCha8Rng) -> f64 {
    const STEP: f64 = 1.0 / (1u64 << 53) as f64;
    (random.next_u64() >> 11) as f64 * STEP
}

/// A number below `end`; none below 0.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the product is not negative and less than a length"
)]
fn below(end: usize, random: &mut ChaCha8Rng) -> Option<usize> {
    let last = end.checked_sub(1)?;
    Some(((unit(random) * end as f64) as usize).min(last))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;
    use swath_bridge::Cell;

    #[test]
    fn without_a_region_nothing_is_scaled_and_nothing_drawn() {
        let spec = GridSpec::default();
        assert!(Guidance::NONE.check(&spec).is_ok());
        assert_eq!(Guidance::NONE.factor(0), 1.0);
        assert!(!Guidance::NONE.holds(0));
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut sampler = RegionSampler::default();
        sampler.prepare(Guidance::NONE);
        assert_eq!(sampler.draw(&spec, &mut random), None);
    }

    #[test]
    fn costs_are_scaled_inside_only_and_every_cell_inside_is_drawn() {
        let spec = GridSpec::default();
        let mut cells = Plane::empty(spec.rows, spec.cols);
        for cell in [Cell::new(0, 0), Cell::new(17, 150), Cell::new(400, 3)] {
            cells.set(cell);
        }
        let guidance = Guidance::inside(&cells, 0.15);
        guidance.check(&spec).unwrap();
        assert_eq!((guidance.factor(0), guidance.factor(1)), (0.15, 1.0));
        assert_eq!(guidance.factor_at(&spec, &Pose2::new(1e6, 0.0, 0.0)), 1.0);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut sampler = RegionSampler::default();
        sampler.prepare(guidance);
        let mut drawn = Plane::empty(spec.rows, spec.cols);
        for _ in 0..100 {
            let (x_m, y_m) = sampler.draw(&spec, &mut random).unwrap();
            assert_eq!(guidance.factor_at(&spec, &Pose2::new(x_m, y_m, 0.0)), 0.15);
            drawn.set(spec.cell_at(x_m, y_m));
        }
        assert_eq!(drawn, cells);
    }

    #[test]
    fn regions_of_other_sizes_and_senseless_weights_are_refused() {
        let spec = GridSpec::default();
        let cells = Plane::empty(spec.rows, spec.cols);
        for weight in [0.0, -1.0, 1.01, f64::NAN] {
            assert!(Guidance::inside(&cells, weight).check(&spec).is_err());
        }
        let small = Plane::empty(2, 2);
        assert!(Guidance::inside(&small, 0.5).check(&spec).is_err());
    }
}
