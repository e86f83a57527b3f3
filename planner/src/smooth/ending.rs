//! Chords brought to where the goal is.
//!
//! A search ends anywhere within the goal's tolerance, mostly before the goal. The path that is to end at
//! the goal itself is longer by that, or shorter.

use swath_bridge::Pose2;

/// Chords keep at least this length, in units of the smoother.
const LEAST_LENGTH: f64 = 0.2;
/// What is less than this need not be changed.
const NEGLIGIBLE: f64 = 1e-3;

/// Makes chords end beside the goal, by a straight piece in the goal's heading or by less of the last one.
pub(super) fn bring_to(goal: &Pose2, chords: &mut Vec<Pose2>) {
    let Some(last) = chords.last().copied() else {
        return;
    };
    let (sin, cos) = libm::sincos(goal.yaw_rad);
    let left = (goal.x_m - last.x_m) * cos + (goal.y_m - last.y_m) * sin;
    if left > NEGLIGIBLE {
        chords.push(Pose2::new(
            last.x_m + left * cos,
            last.y_m + left * sin,
            goal.yaw_rad,
        ));
    } else if left < -NEGLIGIBLE {
        shorten(chords, -left);
    }
}

/// Takes so much off the end, as far as something is left.
fn shorten(chords: &mut Vec<Pose2>, mut by: f64) {
    let length: f64 = chords
        .windows(2)
        .map(|pair| pair[0].distance_m(&pair[1]))
        .sum();
    by = by.min(length - LEAST_LENGTH);
    while by > 0.0
        && let [.., before, last] = chords[..]
    {
        let piece = before.distance_m(&last);
        chords.pop();
        if piece > by {
            let share = 1.0 - by / piece;
            chords.push(Pose2::new(
                before.x_m + share * (last.x_m - before.x_m),
                before.y_m + share * (last.y_m - before.y_m),
                last.yaw_rad,
            ));
            return;
        }
        by -= piece;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(to_m: f64) -> Vec<Pose2> {
        [0.0, 1.0, to_m]
            .map(|x_m| Pose2::new(x_m, 0.0, 0.0))
            .to_vec()
    }

    #[test]
    fn chords_end_beside_the_goal() {
        let mut chords = straight(2.0);
        bring_to(&Pose2::new(2.4, 0.3, 0.0), &mut chords);
        assert_eq!(chords.last(), Some(&Pose2::new(2.4, 0.0, 0.0)));
        let mut chords = straight(2.0);
        bring_to(&Pose2::new(0.7, 0.3, 0.0), &mut chords);
        let last = chords.last().unwrap();
        assert!((last.x_m - 0.7).abs() < 1e-12 && chords.len() == 2);
        let mut chords = straight(2.0);
        bring_to(&Pose2::new(-9.0, 0.0, 0.0), &mut chords);
        assert!((chords.last().unwrap().x_m - LEAST_LENGTH).abs() < 1e-12);
    }
}
