//! One frame: its parent, and where it was in it.

use std::collections::VecDeque;
use std::sync::Arc;

use nalgebra::Isometry3;

/// Maximum number of samples of a frame.
pub(super) const MAX_SAMPLES: usize = 128;
/// Samples that come closer together are thinned out, nanoseconds: so the history is more than two seconds.
const SPACING_NANOS: u64 = 20_000_000;
/// Maximum time between two samples for which a transform between them is interpolated, nanoseconds.
const MAX_GAP_NANOS: u64 = 5_000_000_000;
/// A sample that is older than the newest by more is not late: time has begun anew, nanoseconds.
const ANEW_NANOS: u64 = 10_000_000_000;
/// Rotations nearer to half a turn apart than this are not interpolated.
const EPSILON: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
struct Sample {
    stamp_nanos: u64,
    parent_from_frame: Isometry3<f64>,
}

/// A frame and its newest transforms from its parent.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) parent: Arc<str>,
    /// Whether a lookup went through it.
    pub(super) is_used: bool,
    /// The transform that holds at any time, if the newest that came is such a one.
    fixed: Option<Isometry3<f64>>,
    /// In the order of their stamps, which all differ.
    samples: VecDeque<Sample>,
}

impl Frame {
    pub(super) fn new(parent: &str) -> Self {
        Self {
            parent: parent.into(),
            is_used: false,
            fixed: None,
            samples: VecDeque::new(),
        }
    }

    /// Takes a transform; without a stamp it is fixed. A sample that came before changes nothing.
    pub(super) fn insert(
        &mut self,
        parent: &str,
        stamp_nanos: Option<u64>,
        parent_from_frame: Isometry3<f64>,
    ) {
        if *self.parent != *parent {
            self.parent = parent.into();
            self.fixed = None;
            self.samples.clear();
        }
        let Some(stamp_nanos) = stamp_nanos else {
            self.samples.clear();
            self.fixed = Some(parent_from_frame);
            return;
        };
        self.fixed = None;
        let is_anew = self
            .samples
            .back()
            .is_some_and(|newest| newest.stamp_nanos.saturating_sub(stamp_nanos) > ANEW_NANOS);
        if is_anew {
            self.samples.clear();
        }
        let index = self
            .samples
            .partition_point(|sample| sample.stamp_nanos < stamp_nanos);
        let is_known = self
            .samples
            .get(index)
            .is_some_and(|sample| sample.stamp_nanos == stamp_nanos);
        if is_known {
            return;
        }
        let sample = Sample {
            stamp_nanos,
            parent_from_frame,
        };
        if index == self.samples.len() {
            self.thin_out();
        }
        let index = index.min(self.samples.len());
        self.samples.insert(index, sample);
        if self.samples.len() > MAX_SAMPLES {
            self.samples.pop_front();
        }
    }

    /// Drops the newest sample if it came close behind the one before it.
    fn thin_out(&mut self) {
        let mut newest = self.samples.iter().rev();
        if let (Some(last), Some(before)) = (newest.next(), newest.next())
            && last.stamp_nanos - before.stamp_nanos < SPACING_NANOS
        {
            self.samples.pop_back();
        }
    }

    /// `parent_from_frame` at a time, at 0 the newest; else how far off the nearest sample is,
    /// nanoseconds.
    pub(super) fn at(&self, at_nanos: u64, max_age_nanos: u64) -> Result<Isometry3<f64>, u64> {
        if let Some(fixed) = self.fixed {
            return Ok(fixed);
        }
        let after = self
            .samples
            .partition_point(|sample| sample.stamp_nanos <= at_nanos);
        let (before, after) = match (after.checked_sub(1), at_nanos) {
            (_, 0) => (self.samples.back(), None),
            (Some(before), _) => (self.samples.get(before), self.samples.get(after)),
            (None, _) => (None, self.samples.get(after)),
        };
        match (before, after) {
            (Some(before), Some(after)) => between(before, after, at_nanos, max_age_nanos),
            (Some(one), None) if at_nanos == 0 => Ok(one.parent_from_frame),
            (Some(one), None) | (None, Some(one)) => near(one, at_nanos, max_age_nanos),
            (None, None) => Err(u64::MAX),
        }
    }

    #[cfg(test)]
    pub(super) fn samples(&self) -> usize {
        self.samples.len()
    }
}

fn near(sample: &Sample, at_nanos: u64, max_age_nanos: u64) -> Result<Isometry3<f64>, u64> {
    let off_nanos = sample.stamp_nanos.abs_diff(at_nanos);
    if off_nanos <= max_age_nanos {
        Ok(sample.parent_from_frame)
    } else {
        Err(off_nanos)
    }
}

/// Between two samples; the nearer one where they are too far apart.
fn between(
    before: &Sample,
    after: &Sample,
    at_nanos: u64,
    max_age_nanos: u64,
) -> Result<Isometry3<f64>, u64> {
    let gap_nanos = after.stamp_nanos - before.stamp_nanos;
    let since_nanos = at_nanos - before.stamp_nanos;
    let nearer = if 2 * since_nanos <= gap_nanos {
        before
    } else {
        after
    };
    if gap_nanos > MAX_GAP_NANOS {
        return near(nearer, at_nanos, max_age_nanos);
    }
    let part = since_nanos as f64 / gap_nanos as f64;
    let (from, to) = (&before.parent_from_frame, &after.parent_from_frame);
    let interpolated = from.try_lerp_slerp(to, part, EPSILON);
    Ok(interpolated.unwrap_or(nearer.parent_from_frame))
}
