//! The drives of a log: odometry whose clock runs on, and which of them a sweep belongs to.
//!
//! A simulation that is started again lets its clock begin again, so that one stamp means several moments
//! of a log. What was recorded together belongs together: a sweep gets the pose of the drive that was
//! being recorded when it was. Where the stamps of sensor and odometry do not begin again together, one
//! of them means other moments than before, and those sweeps have no pose.

use std::collections::BTreeMap;

use super::odometry::{Fix, Track};

/// Most drives of a log.
pub(crate) const MAX_DRIVES: usize = 1000;
/// A clock that goes back by more than this has begun again; by less, messages came out of order.
const BACK_NANOS: u64 = 1_000_000_000;
/// Parts with fewer messages than this on average mean that the log is in no order at all.
const FEWEST_A_PART: usize = 8;
/// Parts of a log that are further apart than this are drives of their own.
const APART_NANOS: u64 = 1_000_000_000;
/// How much the time from stamp to recording may differ between parts of one log, nanoseconds.
const SHIFT_NANOS: u64 = 500_000_000;

/// When a message was sent and recorded, and where it is in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mark {
    /// By the clock that is used, nanoseconds.
    pub(crate) nanos: u64,
    /// By the recorder's clock, nanoseconds; 0 if it had none.
    pub(crate) log_nanos: u64,
    /// Number of the message in the log.
    pub(crate) position: u64,
}

/// Odometry that was recorded in one go.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub(crate) track: Track,
    /// Stamps and times of recording of all messages, by stamp.
    times: Vec<(u64, u64)>,
    first_position: u64,
    last_position: u64,
    first_log_nanos: u64,
}

/// Parts of a topic in the order of the log, within each of which no clock goes back: the number of each
/// mark's part.
fn parts_of(marks: impl Iterator<Item = Mark>) -> impl Iterator<Item = usize> {
    let (mut part, mut latest) = (0, (0u64, 0u64));
    marks.map(move |mark| {
        let has_gone_back = |then: u64, now: u64| now.saturating_add(BACK_NANOS) < then;
        let is_back = has_gone_back(latest.0, mark.nanos)
            || (mark.log_nanos > 0 && has_gone_back(latest.1, mark.log_nanos));
        if is_back {
            part += 1;
            latest = (0, 0);
        }
        latest = (latest.0.max(mark.nanos), latest.1.max(mark.log_nanos));
        part
    })
}

/// Parts the odometry of a log into drives. Parts of one drive whose order in the log is another one, as
/// in files that were merged, are put together.
///
/// The error is the number of parts if there are more than [`MAX_DRIVES`].
pub(crate) fn drives_of(mut fixes: Vec<(Fix, Mark)>) -> Result<Vec<Drive>, usize> {
    let number = |fixes: &[(Fix, Mark)]| -> Vec<usize> {
        parts_of(fixes.iter().map(|(_, mark)| *mark)).collect()
    };
    let count_of = |numbers: &[usize]| numbers.last().map_or(0, |last| last + 1);
    let mut numbers = number(&fixes);
    let has_log_times = fixes.iter().all(|(_, mark)| mark.log_nanos > 0);
    if has_log_times && count_of(&numbers) * FEWEST_A_PART > fixes.len() {
        fixes.sort_by_key(|(_, mark)| mark.log_nanos);
        numbers = number(&fixes);
    }
    let count = count_of(&numbers);
    if count > MAX_DRIVES {
        return Err(count);
    }
    let mut parts: Vec<Vec<(Fix, Mark)>> = vec![Vec::new(); count];
    for (number, fix) in numbers.into_iter().zip(fixes) {
        parts[number].push(fix);
    }
    for part in &mut parts {
        part.sort_by_key(|(_, mark)| mark.nanos);
    }
    parts.sort_by_key(|part| part.first().map_or(0, |(_, mark)| mark.nanos));
    let mut joined: Vec<Vec<(Fix, Mark)>> = Vec::new();
    for part in parts {
        let before = joined.iter_mut().find(|before| is_continued(before, &part));
        match before {
            Some(before) => before.extend(part),
            None => joined.push(part),
        }
    }
    let mut drives: Vec<Drive> = joined.into_iter().map(Drive::new).collect();
    let has_log_times = drives.iter().all(|drive| drive.first_log_nanos > 0);
    drives.sort_by_key(|drive| {
        let log_nanos = if has_log_times {
            drive.first_log_nanos
        } else {
            0
        };
        (log_nanos, drive.first_position)
    });
    Ok(drives)
}

/// Whether one part goes on where another ends, by both clocks.
fn is_continued(before: &[(Fix, Mark)], part: &[(Fix, Mark)]) -> bool {
    let (Some((_, last)), Some((_, first))) = (before.last(), part.first()) else {
        return false;
    };
    let is_near = |from: u64, to: u64| from.abs_diff(to) <= APART_NANOS;
    let has_log_times = last.log_nanos > 0 && first.log_nanos > 0;
    is_near(last.nanos, first.nanos) && (!has_log_times || is_near(last.log_nanos, first.log_nanos))
}

impl Drive {
    fn new(fixes: Vec<(Fix, Mark)>) -> Self {
        let positions = || fixes.iter().map(|(_, mark)| mark.position);
        let log_times = fixes.iter().map(|(_, mark)| mark.log_nanos);
        Self {
            first_position: positions().min().unwrap_or(0),
            last_position: positions().max().unwrap_or(0),
            first_log_nanos: log_times.min().unwrap_or(0),
            times: fixes
                .iter()
                .map(|(_, mark)| (mark.nanos, mark.log_nanos))
                .collect(),
            track: Track::new(fixes.into_iter().map(|(fix, _)| fix).collect()),
        }
    }

    /// When the odometry nearest to a stamp was recorded; `None` if that is not known.
    fn log_nanos_at(&self, nanos: u64) -> Option<u64> {
        let next = self.times.partition_point(|(stamp, _)| *stamp < nanos);
        let around = [next.checked_sub(1), Some(next)];
        let near = around
            .into_iter()
            .flatten()
            .filter_map(|place| self.times.get(place))
            .min_by_key(|(stamp, _)| stamp.abs_diff(nanos));
        near.map(|(_, log_nanos)| *log_nanos)
            .filter(|log_nanos| *log_nanos > 0)
    }

    /// Messages between a place in the log and the drive.
    fn distance(&self, position: u64) -> u64 {
        if position < self.first_position {
            self.first_position - position
        } else {
            position.saturating_sub(self.last_position)
        }
    }
}

/// Which drive each message of a topic belongs to.
#[derive(Debug, Default)]
pub(crate) struct Matches {
    /// By message: the number of the drive that has a pose for it.
    pub(crate) drives: Vec<Option<u32>>,
    /// Messages left out since sensor and odometry do not mean the same moments by their stamps.
    pub(crate) shifted: u64,
}

/// A drive that has a pose for a message, and how long after its odometry the message was recorded.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    drive: usize,
    delay_nanos: Option<i64>,
}

/// Finds the drive of each message of a topic.
pub(crate) fn match_marks(drives: &[Drive], marks: &[Mark]) -> Matches {
    let parts: Vec<usize> = parts_of(marks.iter().copied()).collect();
    let count = parts.last().map_or(0, |last| last + 1);
    let is_apart = is_apart(drives, marks);
    let mut groups: BTreeMap<(usize, usize), Vec<i64>> = BTreeMap::new();
    let mut found: Vec<Option<usize>> = Vec::with_capacity(marks.len());
    for (mark, &part) in marks.iter().zip(&parts) {
        let of_part = (is_apart && count == drives.len()).then_some(part);
        let best = best_of(drives, mark, of_part);
        if let Some(best) = best {
            let group = groups.entry((part, best.drive)).or_default();
            group.extend(best.delay_nanos);
        }
        found.push(best.map(|best| best.drive));
    }
    let wrong = wrong_groups(&mut groups);
    let mut shifted = 0;
    let matched = found.into_iter().zip(&parts).map(|(drive, &part)| {
        let is_wrong = drive.is_some_and(|drive| wrong.contains(&(part, drive)));
        shifted += u64::from(is_wrong);
        drive
            .filter(|_| !is_wrong)
            .and_then(|drive| u32::try_from(drive).ok())
    });
    Matches {
        drives: matched.collect(),
        shifted,
    }
}

/// Whether a topic lies in the log before or behind all odometry, as in files stored topic by topic.
fn is_apart(drives: &[Drive], marks: &[Mark]) -> bool {
    let (Some(first), Some(last)) = (marks.first(), marks.last()) else {
        return false;
    };
    let begin = drives.iter().map(|drive| drive.first_position).min();
    let end = drives.iter().map(|drive| drive.last_position).max();
    begin.is_some_and(|begin| last.position < begin) || end.is_some_and(|end| first.position > end)
}

fn best_of(drives: &[Drive], mark: &Mark, of_part: Option<usize>) -> Option<Candidate> {
    let mut candidates: Vec<Candidate> = Vec::new();
    for (number, drive) in drives.iter().enumerate() {
        if drive.track.at(mark.nanos).is_none() {
            continue;
        }
        let delay_nanos = drive
            .log_nanos_at(mark.nanos)
            .filter(|_| mark.log_nanos > 0)
            .map(|log_nanos| {
                let delay_nanos = i128::from(mark.log_nanos) - i128::from(log_nanos);
                i64::try_from(delay_nanos).unwrap_or(i64::MAX)
            });
        candidates.push(Candidate {
            drive: number,
            delay_nanos,
        });
    }
    let delay = |candidate: &Candidate| candidate.delay_nanos.map_or(0, i64::unsigned_abs);
    let least = candidates.iter().map(delay).min()?;
    candidates.retain(|candidate| delay(candidate) <= least.saturating_add(BACK_NANOS));
    // Where times do not tell drives apart, the order of the log does.
    candidates
        .into_iter()
        .min_by_key(|candidate| match of_part {
            Some(part) => part.abs_diff(candidate.drive) as u64,
            None => drives[candidate.drive].distance(mark.position),
        })
}

/// The groups of messages, by part and drive, whose stamps mean other moments than those of the others:
/// they were recorded later or earlier than the odometry of the same stamps.
fn wrong_groups(groups: &mut BTreeMap<(usize, usize), Vec<i64>>) -> Vec<(usize, usize)> {
    let mut middles: Vec<((usize, usize), i64)> = Vec::new();
    for (group, delays_nanos) in groups.iter_mut().filter(|(_, delays)| !delays.is_empty()) {
        delays_nanos.sort_unstable();
        middles.push((*group, delays_nanos[delays_nanos.len() / 2]));
    }
    let Some(&(_, right)) = middles
        .iter()
        .min_by_key(|(_, middle)| middle.unsigned_abs())
    else {
        return Vec::new();
    };
    middles.retain(|(_, middle)| middle.abs_diff(right) > SHIFT_NANOS);
    middles.into_iter().map(|(group, _)| group).collect()
}

#[cfg(test)]
mod tests;
