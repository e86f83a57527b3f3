//! What the generator draws from: every distribution with its unit, loadable from TOML.

mod scenes;

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Vehicle};

pub use scenes::{
    ClutterConfig, NarrowConfig, ParkingConfig, RoadConfig, RoadsideConfig, TrafficConfig,
    TurnConfig,
};

use crate::Error;
use crate::scene::SceneKind;

/// A uniform distribution, or the ends of an interval: lowest and highest value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Span(pub f64, pub f64);

/// Everything that decides what the samples of a seed are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GeneratorConfig {
    /// Kinds of scenes, which take turns; a kind that is named twice has twice the share.
    pub kinds: Vec<SceneKind>,
    /// Size of the planes.
    pub grid: GridSpec,
    /// Dimensions of the vehicle.
    pub vehicle: Vehicle,
    /// How the vehicle stands and moves on its lane.
    pub ego: EgoConfig,
    /// Roads: straight, curved and S-shaped, and the arms of intersections.
    pub road: RoadConfig,
    /// What stands beside roads.
    pub roadside: RoadsideConfig,
    /// Parked and moving vehicles.
    pub traffic: TrafficConfig,
    /// Intersections.
    pub turn: TurnConfig,
    /// Narrow passages.
    pub narrow: NarrowConfig,
    /// Parking lots.
    pub parking: ParkingConfig,
    /// Open ground with things on it.
    pub clutter: ClutterConfig,
    /// The simulated lidar.
    pub lidar: LidarConfig,
    /// Added vehicles and the shift of the reference.
    pub augment: AugmentConfig,
    /// Where targets are.
    pub targets: TargetConfig,
    /// The search that makes the labels, and the sizes of what is drawn.
    pub label: LabelConfig,
}

impl Default for GeneratorConfig {
    fn default() -> Self {
        Self {
            kinds: SceneKind::ALL.to_vec(),
            grid: GridSpec::default(),
            vehicle: Vehicle::default(),
            ego: EgoConfig::default(),
            road: RoadConfig::default(),
            roadside: RoadsideConfig::default(),
            traffic: TrafficConfig::default(),
            turn: TurnConfig::default(),
            narrow: NarrowConfig::default(),
            parking: ParkingConfig::default(),
            clutter: ClutterConfig::default(),
            lidar: LidarConfig::default(),
            augment: AugmentConfig::default(),
            targets: TargetConfig::default(),
            label: LabelConfig::default(),
        }
    }
}

/// How the vehicle stands and moves on its lane.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EgoConfig {
    /// Standard deviation of the distance from the lane's centre line, metres.
    pub offset_m: f64,
    /// Standard deviation of the heading against the lane, radians.
    pub heading_rad: f64,
    /// Room that is kept free around the footprint, metres.
    pub room_m: f64,
    /// Share of scenes at walking pace; the others are driven at up to what their bends allow.
    pub slow_share: f64,
    /// Walking pace, m/s.
    pub slow_m_per_s: f64,
    /// Highest speed of any scene, m/s.
    pub fastest_m_per_s: f64,
}

impl Default for EgoConfig {
    fn default() -> Self {
        Self {
            offset_m: 0.25,
            heading_rad: 0.03,
            room_m: 0.45,
            slow_share: 0.7,
            slow_m_per_s: 1.4,
            fastest_m_per_s: 4.5,
        }
    }
}

/// The simulated lidar and the accumulation of its sweeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarConfig {
    /// Rays of one sweep, around the whole circle.
    pub rays: u32,
    /// Ahead of the rear axle, metres.
    pub sensor_x_m: f64,
    /// Farthest return, metres.
    pub max_range_m: f64,
    /// Farthest return from things below the rays, such as kerbs, metres.
    pub low_range_m: f64,
    /// Standard deviation of a range, metres.
    pub noise_m: f64,
    /// Share of rays that give no return.
    pub dropout: f64,
    /// Share of the rays on low things that give no return.
    pub low_dropout: f64,
    /// How far back sweeps are accumulated, seconds.
    pub history_s: f64,
    /// Time between two sweeps, seconds.
    pub period_s: f64,
    /// An older return of something that moved is dropped once a newer ray has passed this far
    /// behind it, metres.
    pub clear_m: f64,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            rays: 1200,
            sensor_x_m: 1.2,
            max_range_m: 70.0,
            low_range_m: 32.0,
            noise_m: 0.03,
            dropout: 0.04,
            low_dropout: 0.35,
            history_s: 2.4,
            period_s: 0.1,
            clear_m: 0.5,
        }
    }
}

/// Added vehicles and the shift of the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AugmentConfig {
    /// Number of vehicles that are added along the reference path and its parallels.
    pub vehicles: Span,
    /// Where along the reference they are, metres from the vehicle.
    pub along_m: Span,
    /// Standard deviation of their distance from the line they stand on, metres.
    pub offset_m: f64,
    /// Standard deviation of their heading against it, radians.
    pub heading_rad: f64,
    /// Share of samples whose reference is cut off behind the vehicle, as that of a log is.
    pub cut_share: f64,
    /// Standard deviation of the reference's shift to a side, metres.
    pub shift_across_m: f64,
    /// Standard deviation of its shift along, metres.
    pub shift_along_m: f64,
    /// Standard deviation of its rotation about the vehicle, radians.
    pub shift_rad: f64,
}

impl Default for AugmentConfig {
    fn default() -> Self {
        Self {
            vehicles: Span(0.0, 4.0),
            along_m: Span(7.0, 58.0),
            offset_m: 0.4,
            heading_rad: 0.06,
            cut_share: 0.5,
            shift_across_m: 0.9,
            shift_along_m: 1.0,
            shift_rad: 0.03,
        }
    }
}

/// Where targets are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TargetConfig {
    /// Targets of one scene; five samples each.
    pub per_scene: u64,
    /// Distance along the reference, metres.
    pub along_m: Span,
    /// Distance between two rows of targets, metres.
    pub along_step_m: f64,
    /// Farthest target to either side of the reference, metres.
    pub across_m: f64,
    /// Distance between two columns of targets, metres.
    pub across_step_m: f64,
    /// Share of targets that may stand anywhere, on obstacles too.
    pub anywhere_share: f64,
}

impl Default for TargetConfig {
    fn default() -> Self {
        Self {
            per_scene: 1,
            along_m: Span(7.0, 55.0),
            along_step_m: 2.0,
            across_m: 7.0,
            across_step_m: 1.75,
            anywhere_share: 0.03,
        }
    }
}

/// The search that makes the labels, and the sizes of what is drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LabelConfig {
    /// Dilation of the path, metres.
    pub path_radius_m: f64,
    /// Dilation of the reference, metres.
    pub reference_radius_m: f64,
    /// Radius of the target's disc, metres.
    pub target_radius_m: f64,
    /// Most expansions of one search; beyond, the outcome is `budget_exhausted`.
    pub max_expansions: u64,
}

impl Default for LabelConfig {
    fn default() -> Self {
        Self {
            path_radius_m: 1.4,
            reference_radius_m: 1.0,
            target_radius_m: 1.0,
            max_expansions: 300_000,
        }
    }
}

/// Most entries of the list of kinds.
const MAX_KINDS: usize = 1024;
/// Most rays of a sweep.
const MAX_RAYS: u32 = 8192;
/// Most sweeps of an accumulation.
pub(crate) const MAX_SWEEPS: usize = 256;

/// Allowed distances, metres.
const DISTANCE: Span = Span(0.0, 1000.0);
/// Allowed shares.
const SHARE: Span = Span(0.0, 1.0);

impl GeneratorConfig {
    /// Checks that samples can be made.
    ///
    /// # Errors
    /// [`Error::Config`] names the first field that is out of range; [`Error::Bridge`] those of the
    /// grid and the vehicle.
    pub fn validate(&self) -> Result<(), Error> {
        self.grid.validate()?;
        self.vehicle.validate()?;
        if !(1..=MAX_KINDS).contains(&self.kinds.len()) {
            let count = self.kinds.len() as f64;
            return Err(out_of_range("kinds", count, Span(1.0, MAX_KINDS as f64)));
        }
        let lidar = &self.lidar;
        if !(16..=MAX_RAYS).contains(&lidar.rays) {
            return Err(out_of_range(
                "lidar.rays",
                f64::from(lidar.rays),
                Span(16.0, 8192.0),
            ));
        }
        for (field, value, allowed) in self
            .vehicle_ranges()
            .into_iter()
            .chain(self.sample_ranges())
        {
            if !(value >= allowed.0 && value <= allowed.1) {
                return Err(out_of_range(field, value, allowed));
            }
        }
        for (field, span, allowed) in self.spans() {
            if !(span.0 >= allowed.0 && span.0 <= span.1 && span.1 <= allowed.1) {
                return Err(Error::Config {
                    field,
                    what: format!(
                        "[{}, {}], expected two ascending numbers from {} to {}",
                        span.0, span.1, allowed.0, allowed.1
                    ),
                });
            }
        }
        Ok(())
    }

    /// Field, value and allowed values of what concerns the vehicle and its lidar.
    fn vehicle_ranges(&self) -> [(&'static str, f64, Span); 14] {
        let (ego, lidar) = (&self.ego, &self.lidar);
        [
            ("ego.offset_m", ego.offset_m, DISTANCE),
            ("ego.heading_rad", ego.heading_rad, Span(0.0, 1.0)),
            ("ego.room_m", ego.room_m, Span(0.0, 5.0)),
            ("ego.slow_share", ego.slow_share, SHARE),
            ("ego.slow_m_per_s", ego.slow_m_per_s, Span(0.0, 50.0)),
            ("ego.fastest_m_per_s", ego.fastest_m_per_s, Span(0.0, 50.0)),
            ("lidar.sensor_x_m", lidar.sensor_x_m, Span(-50.0, 50.0)),
            ("lidar.max_range_m", lidar.max_range_m, DISTANCE),
            ("lidar.low_range_m", lidar.low_range_m, DISTANCE),
            ("lidar.noise_m", lidar.noise_m, Span(0.0, 10.0)),
            ("lidar.dropout", lidar.dropout, SHARE),
            ("lidar.low_dropout", lidar.low_dropout, SHARE),
            ("lidar.history_s", lidar.history_s, Span(0.0, 60.0)),
            ("lidar.period_s", lidar.period_s, Span(0.01, 60.0)),
        ]
    }

    /// The same of what makes samples out of scenes.
    fn sample_ranges(&self) -> [(&'static str, f64, Span); 24] {
        let (augment, targets, label) = (&self.augment, &self.targets, &self.label);
        let (radius, angle, step) = (Span(0.0, 20.0), Span(0.0, 4.0), Span(0.1, 1000.0));
        let expansions = label.max_expansions as f64;
        [
            ("lidar.clear_m", self.lidar.clear_m, DISTANCE),
            ("road.strip_share", self.road.strip_share, SHARE),
            ("road.median_share", self.road.median_share, SHARE),
            ("roadside.tree_share", self.roadside.tree_share, SHARE),
            ("roadside.bush_share", self.roadside.bush_share, SHARE),
            ("turn.through_share", self.turn.through_share, SHARE),
            ("turn.three_arm_share", self.turn.three_arm_share, SHARE),
            ("parking.angled_share", self.parking.angled_share, SHARE),
            ("clutter.walled_share", self.clutter.walled_share, SHARE),
            ("augment.offset_m", augment.offset_m, DISTANCE),
            ("augment.heading_rad", augment.heading_rad, angle),
            ("augment.cut_share", augment.cut_share, SHARE),
            ("augment.shift_across_m", augment.shift_across_m, DISTANCE),
            ("augment.shift_along_m", augment.shift_along_m, DISTANCE),
            ("augment.shift_rad", augment.shift_rad, angle),
            (
                "targets.per_scene",
                targets.per_scene as f64,
                Span(1.0, 1e6),
            ),
            ("targets.along_step_m", targets.along_step_m, step),
            ("targets.across_m", targets.across_m, DISTANCE),
            ("targets.across_step_m", targets.across_step_m, step),
            ("targets.anywhere_share", targets.anywhere_share, SHARE),
            ("label.path_radius_m", label.path_radius_m, radius),
            ("label.reference_radius_m", label.reference_radius_m, radius),
            ("label.target_radius_m", label.target_radius_m, radius),
            ("label.max_expansions", expansions, Span(1.0, 1e12)),
        ]
    }

    /// Every span, with the name of its field and the values that it may hold.
    fn spans(&self) -> Vec<(&'static str, Span, Span)> {
        let mut spans = vec![
            ("augment.vehicles", self.augment.vehicles, Span(0.0, 200.0)),
            ("augment.along_m", self.augment.along_m, Span(-100.0, 100.0)),
            ("targets.along_m", self.targets.along_m, Span(0.0, 100.0)),
        ];
        spans.extend(self.road.spans());
        spans.extend(self.roadside.spans());
        spans.extend(self.traffic.spans());
        spans.extend(self.turn.spans());
        spans.extend(self.narrow.spans());
        spans.extend(self.parking.spans());
        spans.extend(self.clutter.spans());
        spans
    }
}

fn out_of_range(field: &'static str, value: f64, allowed: Span) -> Error {
    Error::Config {
        field,
        what: format!("{value}, expected {} to {}", allowed.0, allowed.1),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dice::{Dice, Purpose};

    #[test]
    fn the_default_configuration_is_valid_and_survives_toml() {
        let config = GeneratorConfig::default();
        config.validate().unwrap();
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<GeneratorConfig>(&text).unwrap(), config);
    }

    #[test]
    fn a_file_may_name_just_what_it_changes_but_nothing_unknown() {
        let config: GeneratorConfig = toml::from_str(
            "kinds = [\"s-shaped\"]\n[lidar]\nrays = 360\n[road]\nlane_m = [3.0, 3.0]\n",
        )
        .unwrap();
        assert_eq!(config.kinds, [SceneKind::SShaped]);
        assert_eq!(config.lidar.rays, 360);
        assert_eq!(config.road.lane_m, Span(3.0, 3.0));
        assert_eq!(config.targets, TargetConfig::default());
        assert!(toml::from_str::<GeneratorConfig>("[lidar]\nbeams = 360\n").is_err());
    }

    #[test]
    fn values_out_of_range_are_named() {
        let mut config = GeneratorConfig::default();
        config.lidar.dropout = f64::NAN;
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("lidar.dropout"), "{error}");
        let mut config = GeneratorConfig::default();
        config.kinds.clear();
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("kinds"), "{error}");
        let mut config = GeneratorConfig::default();
        config.road.lane_m = Span(4.0, 3.0);
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("road.lane_m"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn any_valid_configuration_makes_samples(seed: u64, index in 0..70u64, draws: u64) {
            let mut config = GeneratorConfig::default();
            let mut dice = Dice::new(draws, Purpose::Scene, 0, 0);
            let mut text = toml::Table::try_from(&config).unwrap();
            for (field, _, allowed) in config.spans() {
                // Mostly the default, so that one odd value is not hidden by another.
                if !dice.chance(0.2) {
                    continue;
                }
                let ends = [dice.within(allowed), dice.within(allowed)];
                let span = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                let (section, key) = field.split_once('.').unwrap();
                let section = text.get_mut(section).and_then(toml::Value::as_table_mut).unwrap();
                section.insert(key.to_owned(), toml::Value::try_from(span).unwrap());
            }
            config = text.try_into().unwrap();
            config.label.max_expansions = 500;
            let sample = crate::generate_sample(seed, index, &config).unwrap();
            prop_assert_eq!(sample.index, index);
        }
    }
}
