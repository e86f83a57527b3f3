//! Motion with linearly changing curvature: exact poses, and their derivatives.

use swath_bridge::Pose2;
use swath_bridge::geometry::wrap_angle_rad;

/// Pose and curvature; the heading is not wrapped, so that differences are turns.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct State {
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    pub(crate) yaw_rad: f64,
    pub(crate) curvature_per_m: f64,
}

/// How the end of a step depends on its start, its rate and its length, where that is not the identity.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct StepRates {
    /// Derivatives of x and y by heading, curvature, rate and length.
    pub(crate) x: [f64; 4],
    pub(crate) y: [f64; 4],
    /// Derivatives of the heading by curvature, rate and length.
    pub(crate) yaw: [f64; 3],
    /// Derivatives of the curvature by rate and length.
    pub(crate) curvature: [f64; 2],
}

impl State {
    pub(crate) fn pose(&self) -> Pose2 {
        Pose2::new(self.x_m, self.y_m, wrap_angle_rad(self.yaw_rad))
    }

    /// The state after `length_m` during which the curvature changes at a rate, 1/m².
    ///
    /// The position is integrated after Simpson: its error on 0.2 m is below a micrometre.
    pub(crate) fn after(&self, length_m: f64, rate_per_m2: f64) -> Self {
        let sincos_at = |share: f64| {
            let s = share * length_m;
            libm::sincos(self.yaw_rad + s * (self.curvature_per_m + 0.5 * s * rate_per_m2))
        };
        let (sin_0, cos_0) = sincos_at(0.0);
        let (sin_1, cos_1) = sincos_at(0.5);
        let (sin_2, cos_2) = sincos_at(1.0);
        Self {
            x_m: self.x_m + length_m / 6.0 * (cos_0 + 4.0 * cos_1 + cos_2),
            y_m: self.y_m + length_m / 6.0 * (sin_0 + 4.0 * sin_1 + sin_2),
            yaw_rad: self.yaw_rad
                + length_m * (self.curvature_per_m + 0.5 * length_m * rate_per_m2),
            curvature_per_m: self.curvature_per_m + length_m * rate_per_m2,
        }
    }

    /// Derivatives of [`Self::after`], whose result is `end`.
    pub(crate) fn rates(&self, end: &Self, length_m: f64, rate_per_m2: f64) -> StepRates {
        let middle_rad =
            self.yaw_rad + length_m / 2.0 * (self.curvature_per_m + 0.25 * length_m * rate_per_m2);
        let (sin_1, cos_1) = libm::sincos(middle_rad);
        let (sin_2, cos_2) = libm::sincos(end.yaw_rad);
        // Simpson again: the heading at share t changes by t·length with the curvature, and by half
        // its square with the rate.
        let by_curvature = |middle: f64, end: f64| length_m * length_m / 6.0 * (2.0 * middle + end);
        let by_rate = |middle: f64, end: f64| length_m.powi(3) / 12.0 * (middle + end);
        StepRates {
            x: [
                -(end.y_m - self.y_m),
                -by_curvature(sin_1, sin_2),
                -by_rate(sin_1, sin_2),
                cos_2,
            ],
            y: [
                end.x_m - self.x_m,
                by_curvature(cos_1, cos_2),
                by_rate(cos_1, cos_2),
                sin_2,
            ],
            yaw: [length_m, 0.5 * length_m * length_m, end.curvature_per_m],
            curvature: [length_m, rate_per_m2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn steps_compose_and_have_the_derivatives_that_differences_show(
            yaw in -3.0..3.0f64, curvature in -0.2..0.2f64, rate in -0.3..0.3f64,
            length in 0.05..0.25f64,
        ) {
            let start = State { x_m: 1.0, y_m: -2.0, yaw_rad: yaw, curvature_per_m: curvature };
            let end = start.after(length, rate);
            let twice = start.after(length / 2.0, rate).after(length / 2.0, rate);
            prop_assert!(libm::hypot(end.x_m - twice.x_m, end.y_m - twice.y_m) < 1e-7);
            prop_assert!((end.yaw_rad - twice.yaw_rad).abs() < 1e-12);
            let rates = start.rates(&end, length, rate);
            let step = 1e-6;
            let turned = State { yaw_rad: yaw + step, ..start }.after(length, rate);
            let bent = State { curvature_per_m: curvature + step, ..start }.after(length, rate);
            let steered = start.after(length, rate + step);
            let longer = start.after(length + step, rate);
            for (index, other) in [turned, bent, steered, longer].into_iter().enumerate() {
                prop_assert!(((other.x_m - end.x_m) / step - rates.x[index]).abs() < 1e-5);
                prop_assert!(((other.y_m - end.y_m) / step - rates.y[index]).abs() < 1e-5);
                if index > 0 {
                    let by = (other.yaw_rad - end.yaw_rad) / step;
                    prop_assert!((by - rates.yaw[index - 1]).abs() < 1e-5);
                }
                if index > 1 {
                    let by = (other.curvature_per_m - end.curvature_per_m) / step;
                    prop_assert!((by - rates.curvature[index - 2]).abs() < 1e-5);
                }
            }
        }
    }
}
