//! The chord path, resampled: what the smooth path starts from and stays near.

use swath_bridge::Pose2;
use swath_bridge::geometry::wrap_angle_rad;

use super::clothoid::State;

/// How far before and behind a place headings are averaged, metres: half a long chord.
const AVERAGED_M: f64 = 1.2;
/// How fast the first guess returns to the chords: it is as a spring of this frequency, 1/m, with
/// this damping.
const TRACKING_PER_M: f64 = 0.6;
const TRACKING_DAMPING: f64 = 0.9;
/// The first guess may be longer than the chords by this factor.
const MAX_DETOUR: f64 = 1.5;

/// A place on the chord path, with the chord's heading averaged over its neighbourhood.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Place {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    /// Not wrapped.
    pub(super) yaw_rad: f64,
    pub(super) sin: f64,
    pub(super) cos: f64,
}

/// The chord path at equal distances.
#[derive(Debug, Default)]
pub(super) struct Reference {
    pub(super) places: Vec<Place>,
    /// Distance between two places, metres.
    pub(super) step_m: f64,
    /// Heading of the chord behind each place, and their running sum.
    headings_rad: Vec<f64>,
    sums_rad: Vec<f64>,
}

impl Reference {
    /// Resamples a chord path at steps of at most `most_step_m`; false if it has no length, is not
    /// finite or needs more than `most_places`.
    pub(super) fn fit(&mut self, chords: &[Pose2], most_step_m: f64, most_places: usize) -> bool {
        self.places.clear();
        self.headings_rad.clear();
        let length_m: f64 = chords.windows(2).map(|p| p[0].distance_m(&p[1])).sum();
        let steps = libm::ceil(length_m / most_step_m - 1e-9);
        if !(length_m > 1e-3 && steps < most_places as f64) {
            return false;
        }
        self.step_m = length_m / steps.max(1.0);
        self.sample(chords, steps);
        self.average();
        true
    }

    fn sample(&mut self, chords: &[Pose2], steps: f64) {
        let mut before_m = 0.0;
        let mut yaw_rad = chords[0].yaw_rad;
        let mut index = 0.0;
        for pair in chords.windows(2) {
            let piece_m = pair[0].distance_m(&pair[1]);
            yaw_rad += wrap_angle_rad(pair[1].yaw_rad - yaw_rad);
            // A place on a joint belongs to the chord behind it; the last one to the last chord.
            while index <= steps && index * self.step_m < before_m + piece_m - 1e-9 {
                let share = (index * self.step_m - before_m) / piece_m;
                self.push(pair, share, yaw_rad);
                index += 1.0;
            }
            before_m += piece_m;
        }
        if let [.., before, last] = chords {
            while index <= steps {
                self.push(&[*before, *last], 1.0, yaw_rad);
                index += 1.0;
            }
        }
    }

    fn push(&mut self, pair: &[Pose2], share: f64, yaw_rad: f64) {
        self.headings_rad.push(yaw_rad);
        self.places.push(Place {
            x_m: pair[0].x_m + share * (pair[1].x_m - pair[0].x_m),
            y_m: pair[0].y_m + share * (pair[1].y_m - pair[0].y_m),
            ..Place::default()
        });
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small positive count"
    )]
    fn average(&mut self) {
        self.sums_rad.clear();
        self.sums_rad.push(0.0);
        let mut sum_rad = 0.0;
        for heading_rad in &self.headings_rad {
            sum_rad += heading_rad;
            self.sums_rad.push(sum_rad);
        }
        let reach = (AVERAGED_M / self.step_m).min(1e6) as usize;
        let last = self.places.len() - 1;
        for (index, place) in self.places.iter_mut().enumerate() {
            // The window shrinks towards both ends, so that it stays around its place.
            let reach = reach.min(index).min(last - index);
            let (from, to) = (index - reach, index + reach + 1);
            place.yaw_rad = (self.sums_rad[to] - self.sums_rad[from]) / (to - from) as f64;
            (place.sin, place.cos) = libm::sincos(place.yaw_rad);
        }
    }

    /// A path within the limits that follows the chords as a driver would: its states, the rates
    /// between them, and for each state the place that it belongs to.
    pub(super) fn follow(
        &self,
        start: State,
        (most_curvature, most_rate): (f64, f64),
        guess: &mut Guess,
    ) {
        guess.clear();
        let step_m = self.step_m;
        let last = self.places.len() - 1;
        let most_steps = (self.places.len() as f64 * MAX_DETOUR) + 10.0;
        let mut state = start;
        let mut index = 0;
        guess.push(state, index);
        while index < last && (guess.rates_per_m2.len() as f64) < most_steps {
            let place = &self.places[index];
            let (dx, dy) = (state.x_m - place.x_m, state.y_m - place.y_m);
            let aside_m = place.cos * dy - place.sin * dx;
            let turned_rad = state.yaw_rad - place.yaw_rad;
            // The curvature that is due by the time that steering has brought it about.
            let (ahead, behind) = ((index + 3).min(last), (index + 1).min(last - 1));
            let turn_rad = self.places[ahead].yaw_rad - self.places[behind].yaw_rad;
            let due = turn_rad / (step_m * (ahead - behind) as f64);
            let spring = TRACKING_PER_M * TRACKING_PER_M * aside_m
                + 2.0 * TRACKING_DAMPING * TRACKING_PER_M * turned_rad;
            let wanted = (due - spring).clamp(-most_curvature, most_curvature);
            let rate = ((wanted - state.curvature_per_m) / step_m).clamp(-most_rate, most_rate);
            state = state.after(step_m, rate);
            while index < last {
                let place = &self.places[index];
                let along_m =
                    place.cos * (state.x_m - place.x_m) + place.sin * (state.y_m - place.y_m);
                if along_m < 0.5 * step_m {
                    break;
                }
                index += 1;
            }
            guess.rates_per_m2.push(rate);
            guess.push(state, index);
        }
    }
}

/// A path to start from.
#[derive(Debug, Default)]
pub(super) struct Guess {
    pub(super) states: Vec<State>,
    /// One less than states, 1/m².
    pub(super) rates_per_m2: Vec<f64>,
    /// For each state the number of its place on the reference.
    pub(super) places: Vec<usize>,
}

impl Guess {
    fn clear(&mut self) {
        self.states.clear();
        self.rates_per_m2.clear();
        self.places.clear();
    }

    fn push(&mut self, state: State, place: usize) {
        self.states.push(state);
        self.places.push(place);
    }
}
