//! How fast a scene may be driven.

use swath_bridge::Vehicle;

use crate::config::GeneratorConfig;
use crate::dice::Dice;

/// The highest speed up to `most_m_per_s` at which a curvature can still be driven, m/s.
fn fastest_m_per_s(vehicle: &Vehicle, curvature_per_m: f64, most_m_per_s: f64) -> f64 {
    const HALVINGS: u32 = 24;
    let (mut slow, mut fast) = (0.0, most_m_per_s);
    if vehicle.curvature_at_speed_per_m(fast) >= curvature_per_m {
        return fast;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (slow + fast);
        if vehicle.curvature_at_speed_per_m(middle) >= curvature_per_m {
            slow = middle;
        } else {
            fast = middle;
        }
    }
    slow
}

/// A speed for a scene in which curvatures up to `curvature_per_m` are needed, m/s. Speeds come in
/// steps of a quarter, so that their turning limits can be kept between samples.
pub(super) fn draw(dice: &mut Dice, config: &GeneratorConfig, curvature_per_m: f64) -> f64 {
    const STEPS_PER_M_PER_S: f64 = 4.0;
    let ego = &config.ego;
    let share = dice.unit();
    if dice.chance(ego.slow_share) {
        return ego.slow_m_per_s;
    }
    let fastest = fastest_m_per_s(&config.vehicle, curvature_per_m, ego.fastest_m_per_s);
    let speed = ego.slow_m_per_s + share * (fastest - ego.slow_m_per_s).max(0.0);
    let stepped = libm::floor(speed * STEPS_PER_M_PER_S) / STEPS_PER_M_PER_S;
    stepped.max(ego.slow_m_per_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bends_are_driven_at_a_speed_whose_curvature_reaches_them() {
        let vehicle = Vehicle::default();
        for curvature in [0.01, 0.03, 0.05, 0.1, 0.15] {
            let fastest = fastest_m_per_s(&vehicle, curvature, 20.0);
            assert!(vehicle.curvature_at_speed_per_m(fastest) >= curvature);
            assert!(vehicle.curvature_at_speed_per_m(fastest + 0.01) < curvature);
        }
        assert!((fastest_m_per_s(&vehicle, 0.05, 2.0) - 2.0).abs() < 1e-12);
        assert!(fastest_m_per_s(&vehicle, 0.5, 20.0).abs() < 1e-3);
    }
}
