//! The learning rate over a run: linear warm-up, then the paper's cosine.

use serde::{Deserialize, Serialize};

/// The learning rate at each step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    base_rate: f64,
    warm_up_steps: u64,
    /// `None`: the rate stays where the warm-up ends, for training without an end.
    cosine_steps: Option<u64>,
}

impl Schedule {
    /// `warm_up_steps` of rising linearly to `base_rate`, then `cosine_steps` of
    /// lᵢ = ½ (1 + cos(iπ/T)) · `base_rate` with T = `cosine_steps` and i counted from the end of the
    /// warm-up, as T. He et al. (2019), whom the paper follows, count it.
    pub const fn cosine(base_rate: f64, warm_up_steps: u64, cosine_steps: u64) -> Self {
        Self {
            base_rate,
            warm_up_steps,
            cosine_steps: Some(cosine_steps),
        }
    }

    /// `warm_up_steps` of rising linearly to `base_rate`, which then stays.
    pub const fn constant(base_rate: f64, warm_up_steps: u64) -> Self {
        Self {
            base_rate,
            warm_up_steps,
            cosine_steps: None,
        }
    }

    /// The rate of a step, counted from 0.
    pub fn rate(&self, step: u64) -> f64 {
        let warm_up = self.warm_up_steps;
        if step < warm_up {
            return self.base_rate * (step + 1) as f64 / warm_up as f64;
        }
        let Some(total) = self.cosine_steps else {
            return self.base_rate;
        };
        let share = (step - warm_up).min(total) as f64 / total.max(1) as f64;
        0.5 * (1.0 + libm::cos(share * std::f64::consts::PI)) * self.base_rate
    }

    /// Number of steps, if there is an end.
    pub fn steps(&self) -> Option<u64> {
        self.cosine_steps.map(|steps| steps + self.warm_up_steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_the_warm_up_the_rate_is_the_papers_formula() {
        let (base, warm_up, total) = (5e-4, 10, 300 * 114);
        let schedule = Schedule::cosine(base, warm_up, total);
        for i in 0..=total {
            let cosine = (i as f64 * std::f64::consts::PI / total as f64).cos();
            let formula = 0.5 * (1.0 + cosine) * base;
            assert!((schedule.rate(warm_up + i) - formula).abs() <= 1e-15);
        }
        assert_eq!(schedule.rate(warm_up), base);
        assert!(schedule.rate(warm_up + total) < 1e-15);
        assert_eq!(schedule.rate(u64::MAX), schedule.rate(warm_up + total));
    }

    #[test]
    fn the_warm_up_rises_evenly_to_the_base_rate() {
        let schedule = Schedule::cosine(1.0, 4, 100);
        let rates: Vec<f64> = (0..5).map(|step| schedule.rate(step)).collect();
        assert_eq!(rates, [0.25, 0.5, 0.75, 1.0, 1.0]);
        assert_eq!(Schedule::constant(1.0, 2).rate(1_000_000), 1.0);
    }
}
