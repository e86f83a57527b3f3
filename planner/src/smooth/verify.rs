//! Whether a path of clothoids hits nothing, without gaps between tested poses.

use super::clothoid::State;
use super::footprint::Footprint;
use super::obstacles::ScaledCells;

/// Least gap that is kept everywhere, metres. It is also what makes the steps below finite.
pub(crate) const LEAST_GAP_M: f64 = 1e-3;
/// Longest piece of path over which one gap is trusted, metres.
const LONGEST_M: f64 = 0.1;

/// Where a path first comes nearer than the least gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contact {
    /// Number of the step.
    pub(crate) step: usize,
    /// The gap there, metres; negative for an overlap.
    pub(crate) gap_m: f64,
}

/// Tests a path for contact.
///
/// No point of the rectangle moves farther than (1 + |curvature| · reach) times the length driven, so
/// a gap holds for a piece of path, and the next pose to test follows from it: nothing between two
/// tested poses goes unseen.
pub(crate) fn first_contact(
    cells: &ScaledCells<'_>,
    footprint: &Footprint,
    (states, rates): (&[State], &[f64]),
    length_m: f64,
    near: &mut Vec<(f64, f64)>,
) -> Option<Contact> {
    let start = states.first()?;
    let placed = footprint.placed(&start.pose());
    if !cells.is_clear(&placed, LEAST_GAP_M) {
        return Some(Contact {
            step: 0,
            gap_m: 0.0,
        });
    }
    for (step, (state, &rate)) in states.iter().zip(rates).enumerate() {
        let motion = (state, rate, length_m);
        if let Some(gap_m) = contact_gap_m(cells, footprint, motion, near) {
            return Some(Contact { step, gap_m });
        }
    }
    let last = states.last()?;
    let placed = footprint.placed(&last.pose());
    (!cells.is_clear(&placed, LEAST_GAP_M)).then_some(Contact {
        step: rates.len(),
        gap_m: 0.0,
    })
}

/// The first gap on one step that is below the least, if there is one: what moves by `length_m` from a
/// state, its curvature changing at a rate.
///
/// Only cells that have a free neighbour are looked at, so the first pose must be known to be free.
pub(crate) fn contact_gap_m(
    cells: &ScaledCells<'_>,
    footprint: &Footprint,
    (state, rate, length_m): (&State, f64, f64),
    near: &mut Vec<(f64, f64)>,
) -> Option<f64> {
    let bend = state
        .curvature_per_m
        .abs()
        .max((state.curvature_per_m + rate * length_m).abs());
    let speed = 1.0 + bend * footprint.reach_m;
    let placed = footprint.placed(&state.pose());
    near.clear();
    let mut gap_m = f64::INFINITY;
    cells.each_near(&placed, length_m * speed + LEAST_GAP_M, |centre| {
        gap_m = gap_m.min(placed.gap_m(centre));
        near.push(centre);
    });
    let mut at_m = 0.0;
    while gap_m.is_finite() {
        if gap_m < LEAST_GAP_M {
            return Some(gap_m);
        }
        at_m += (gap_m / speed).min(LONGEST_M);
        if at_m >= length_m {
            break;
        }
        let placed = footprint.placed(&state.after(at_m, rate).pose());
        gap_m = near
            .iter()
            .map(|&centre| placed.gap_m(centre))
            .fold(f64::INFINITY, f64::min);
    }
    None
}
