//! From planes to the network's input.

use serde::{Deserialize, Serialize};
use swath_bridge::{Cell, GridSpec, Pose2, SpeedLimits};

use super::disc_ways::{Disc, DiscWays};
use super::goal_features::{self, Pixels};
use super::graph::{Architecture, GOAL_FEATURES, INPUT_PLANES, SIDE_MULTIPLE};
use crate::plane::each_cell_near;
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

/// What a network sees of a frame, whatever the goal.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Obstacles.
    pub obstacles: &'a Plane,
    /// The reference, dilated as the network was trained with.
    pub reference: &'a Plane,
    /// Speed of the vehicle, which decides how tightly it turns, m/s.
    pub speed_m_per_s: f64,
}

/// How grids of one size enter and leave the network.
///
/// The grid is padded with zeros below and on the right to multiples of
/// [`SIDE_MULTIPLE`]: 401 × 151 becomes 408 × 152, or 208 × 80 at half size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoding {
    /// What takes the input.
    pub architecture: Architecture,
    /// The grid.
    pub spec: GridSpec,
    /// Resolution of the input.
    pub size: InputSize,
    /// Radius of the disc around the target, or around the vehicle, metres.
    pub disc_m: f64,
    /// Smallest turning radius of the vehicle, metres.
    pub min_turning_radius_m: f64,
    /// How the vehicle's speed limits its turns.
    pub speed_limits: SpeedLimits,
    /// Half of the vehicle's width, metres.
    pub half_width_m: f64,
}

impl Encoding {
    /// Rows and columns of the network's input.
    pub const fn input_size(&self) -> (usize, usize) {
        let (rows, cols) = self.pixels();
        (
            rows.next_multiple_of(SIDE_MULTIPLE),
            cols.next_multiple_of(SIDE_MULTIPLE),
        )
    }

    /// Number of floats of the input's planes.
    pub const fn planes_len(&self) -> usize {
        let (rows, cols) = self.input_size();
        rows * cols * INPUT_PLANES
    }

    /// Number of floats that describe a goal beside the planes.
    pub const fn features_len(&self) -> usize {
        let (rows, cols) = self.input_size();
        match self.architecture {
            Architecture::Enet => 0,
            Architecture::EnetShared => {
                rows / SIDE_MULTIPLE * (cols / SIDE_MULTIPLE) * GOAL_FEATURES
            }
        }
    }

    /// Number of floats of a whole input.
    pub const fn input_len(&self) -> usize {
        self.planes_len() + self.features_len()
    }

    /// Number of logits.
    pub const fn output_len(&self) -> usize {
        self.planes_len() / INPUT_PLANES
    }

    /// Number of cells of the grid.
    pub const fn cells(&self) -> usize {
        self.spec.len()
    }

    /// Checks that a plane is of the grid's size.
    ///
    /// # Errors
    /// [`Error::Shape`] unless it is.
    pub fn check(&self, plane: &Plane) -> Result<(), Error> {
        plane.check_size("plane for the network", &self.spec)
    }

    /// Writes one input: the planes, channels innermost, then what describes the goal.
    ///
    /// # Shapes
    /// `input`: [`Self::input_len`].
    ///
    /// # Errors
    /// [`Error::Shape`] if a plane is of another size.
    pub fn encode(
        &self,
        surroundings: &Surroundings<'_>,
        goal: &Pose2,
        input: &mut [f32],
    ) -> Result<(), Error> {
        let (planes, features) = input.split_at_mut(self.planes_len());
        self.encode_planes(surroundings, Some(goal), planes)?;
        if !features.is_empty() {
            let mut ways = DiscWays::default();
            self.survey(surroundings, &mut ways);
            self.encode_goal(surroundings, &ways, goal, features);
        }
        Ok(())
    }

    /// Writes the input planes: obstacles, reference and a disc. For `enet` the disc lies around the
    /// goal, which has to be given, else around the vehicle.
    ///
    /// # Errors
    /// As [`Self::encode`].
    pub(super) fn encode_planes(
        &self,
        surroundings: &Surroundings<'_>,
        goal: Option<&Pose2>,
        input: &mut [f32],
    ) -> Result<(), Error> {
        input.fill(0.0);
        let (_, input_cols) = self.input_size();
        let (shrink, cols) = (self.shrink(), self.spec.cols as usize);
        let mut set = |cell: usize, channel: usize| {
            let (row, col) = (cell / cols / shrink, cell % cols / shrink);
            input[(row * input_cols + col) * INPUT_PLANES + channel] = 1.0;
        };
        for (channel, plane) in [surroundings.obstacles, surroundings.reference]
            .into_iter()
            .enumerate()
        {
            self.check(plane)?;
            plane.each_set(|cell| set(cell, channel));
        }
        let vehicle = Pose2::default();
        let middle = match self.architecture {
            Architecture::Enet => goal.unwrap_or(&vehicle),
            Architecture::EnetShared => &vehicle,
        };
        each_cell_near(&self.spec, (middle, middle), self.disc_m, |cell| {
            if let Some(index) = self.spec.index_of(cell) {
                set(index, INPUT_PLANES - 1);
            }
        });
        Ok(())
    }

    /// Finds the ways that the features of goals tell of.
    pub(super) fn survey(&self, surroundings: &Surroundings<'_>, ways: &mut DiscWays) {
        let disc = Disc {
            radius_m: self.half_width_m,
            turning_radius_m: self.turning_radius_m(surroundings),
        };
        ways.survey(surroundings.obstacles, &self.spec, disc);
    }

    /// The tightest circle at the vehicle's speed, metres.
    fn turning_radius_m(&self, surroundings: &Surroundings<'_>) -> f64 {
        let curvature_per_m = self
            .speed_limits
            .curvature_per_m(surroundings.speed_m_per_s);
        self.min_turning_radius_m.max(1.0 / curvature_per_m)
    }

    /// Writes what describes the goal beside the planes, of an architecture that asks for it.
    ///
    /// # Shapes
    /// `features`: [`Self::features_len`].
    pub(super) fn encode_goal(
        &self,
        surroundings: &Surroundings<'_>,
        ways: &DiscWays,
        goal: &Pose2,
        features: &mut [f32],
    ) {
        let radius_m = self.turning_radius_m(surroundings);
        let (rows, cols) = self.input_size();
        let cells = SIDE_MULTIPLE * self.shrink();
        let side_m = cells as f64 * self.spec.resolution_m;
        // The centre of the first pixel lies half a pixel less half a cell behind the first cell's.
        let (x_m, y_m) = self.spec.centre_of(Cell::new(0, 0));
        let inset_m = 0.5 * (side_m - self.spec.resolution_m);
        let pixels = Pixels {
            rows: rows / SIDE_MULTIPLE,
            cols: cols / SIDE_MULTIPLE,
            side_m,
            first: (x_m - inset_m, y_m - inset_m),
        };
        goal_features::write(&pixels, ways, goal, radius_m, features);
    }

    const fn shrink(&self) -> usize {
        match self.size {
            InputSize::Full => 1,
            InputSize::Half => 2,
        }
    }

    const fn pixels(&self) -> (usize, usize) {
        let shrink = self.shrink();
        (self.rows().div_ceil(shrink), self.cols().div_ceil(shrink))
    }

    pub(super) const fn rows(&self) -> usize {
        self.spec.rows as usize
    }

    pub(super) const fn cols(&self) -> usize {
        self.spec.cols as usize
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::network) fn encoding(rows: u32, cols: u32, size: InputSize) -> Encoding {
        Encoding {
            architecture: Architecture::Enet,
            spec: GridSpec {
                rows,
                cols,
                resolution_m: 0.2,
                ego_row: 0,
                ego_col: 0,
            },
            size,
            disc_m: 0.1,
            min_turning_radius_m: 5.5,
            speed_limits: swath_bridge::Vehicle::default().speed_limits(),
            half_width_m: 0.885,
        }
    }

    fn surroundings<'a>(obstacles: &'a Plane, reference: &'a Plane) -> Surroundings<'a> {
        Surroundings {
            obstacles,
            reference,
            speed_m_per_s: 1.4,
        }
    }

    #[test]
    fn the_default_grid_is_padded_as_designed() {
        assert_eq!(encoding(401, 151, InputSize::Full).input_size(), (408, 152));
        assert_eq!(encoding(401, 151, InputSize::Half).input_size(), (208, 80));
    }

    #[test]
    fn a_pixel_of_half_size_is_set_if_any_of_its_cells_is() {
        let encoding = encoding(5, 7, InputSize::Half);
        let mut plane = Plane::empty(5, 7);
        plane.set(Cell::new(4, 6));
        plane.set(Cell::new(1, 2));
        let empty = Plane::empty(5, 7);
        let mut input = vec![9.0; encoding.input_len()];
        let goal = Pose2::new(-0.8, -0.2, 0.0);
        encoding
            .encode(&surroundings(&empty, &plane), &goal, &mut input)
            .unwrap();
        let set: Vec<usize> = (0..input.len())
            .filter(|&index| input[index] != 0.0)
            .collect();
        let at = |row: usize, col: usize, plane: usize| (row * 8 + col) * INPUT_PLANES + plane;
        assert_eq!(set, [at(0, 1, 1), at(2, 0, 2), at(2, 3, 1)]);
    }

    #[test]
    fn only_the_shared_network_sees_the_vehicle_instead_of_the_goal() {
        let enet = Encoding {
            spec: GridSpec::default(),
            ..encoding(1, 1, InputSize::Half)
        };
        let shared = Encoding {
            architecture: Architecture::EnetShared,
            ..enet
        };
        let empty = Plane::empty(401, 151);
        let mut input = vec![0.0; shared.input_len()];
        let goal = Pose2::new(20.0, 0.0, 0.0);
        let surroundings = surroundings(&empty, &empty);
        shared.encode(&surroundings, &goal, &mut input).unwrap();
        let (planes, features) = input.split_at(shared.planes_len());
        let pixel = |row: usize, col: usize| planes[(row * 80 + col) * INPUT_PLANES + 2];
        assert_eq!((pixel(150, 37), pixel(100, 37)), (1.0, 0.0));
        assert_eq!(features.len(), 26 * 10 * GOAL_FEATURES);
        // The pixel around x = 59.9 − 3.2 · 12, y = 14.9 − 3.2 · 4 less half of 3.0 m.
        let feature = features[(12 * 10 + 4) * GOAL_FEATURES + 7] * 40.0;
        assert!(
            (f64::from(feature) - (60.0 - 1.5 - 38.4)).abs() < 1e-4,
            "{feature}"
        );
        let mut input = vec![0.0; enet.input_len()];
        enet.encode(&surroundings, &goal, &mut input).unwrap();
        assert_eq!(input[(100 * 80 + 37) * INPUT_PLANES + 2], 1.0);
    }

    #[test]
    fn a_plane_of_another_size_is_refused() {
        let encoding = encoding(5, 7, InputSize::Full);
        let (right, wrong) = (Plane::empty(5, 7), Plane::empty(7, 5));
        let mut input = vec![0.0; encoding.input_len()];
        let goal = Pose2::default();
        assert!(
            encoding
                .encode(&surroundings(&right, &wrong), &goal, &mut input)
                .is_err()
        );
    }
}
