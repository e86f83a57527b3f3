use super::*;
use crate::geometry::Pose2;

const SECOND: u64 = 1_000_000_000;
const NOW: u64 = 1_700_000_000 * SECOND;

fn mark(nanos: u64, log_nanos: u64, position: u64) -> Mark {
    Mark {
        nanos,
        log_nanos,
        position,
    }
}

/// Ten messages a second for so many seconds, from a stamp, a time of recording and a place on.
fn marks(seconds: u64, stamp_s: u64, log: u64, position: u64) -> Vec<Mark> {
    (0..seconds * 10)
        .map(|step| {
            let after = step * SECOND / 10;
            let log_nanos = if log == 0 { 0 } else { log + after };
            mark(stamp_s * SECOND + after, log_nanos, position + 2 * step)
        })
        .collect()
}

/// Odometry whose x says which drive it is of.
fn odometry(x_m: f64, marks: &[Mark]) -> Vec<(Fix, Mark)> {
    marks
        .iter()
        .map(|mark| {
            let fix = Fix {
                nanos: mark.nanos,
                odom_from_vehicle: Pose2::new(x_m, 0.0, 0.0),
                speed_m_per_s: 0.0,
            };
            (fix, *mark)
        })
        .collect()
}

fn found_at(drives: &[Drive], marks: &[Mark]) -> Vec<Option<f64>> {
    let matches = match_marks(drives, marks);
    let found = matches.drives.iter().zip(marks);
    found
        .map(|(drive, mark)| {
            let moment = drives[(*drive)? as usize].track.at(mark.nanos)?;
            Some(moment.odom_from_vehicle.x_m)
        })
        .collect()
}

#[test]
fn a_clock_that_begins_again_makes_a_drive_of_its_own() {
    let [a, b, c] = [
        marks(6, 10, NOW, 0),
        marks(6, 10, NOW + 20 * SECOND, 200),
        marks(4, 9, NOW + 40 * SECOND, 400),
    ];
    let odometry = [odometry(1.0, &a), odometry(2.0, &b), odometry(3.0, &c)].concat();
    let drives = drives_of(odometry).unwrap();
    assert_eq!(drives.len(), 3);
    let sweeps = [&a[..], &b, &c].concat();
    let found = found_at(&drives, &sweeps);
    for (place, found) in found.iter().enumerate() {
        let expected = [1.0, 2.0, 3.0][usize::from(place >= 60) + usize::from(place >= 120)];
        assert_eq!(*found, Some(expected), "{place}");
    }
}

#[test]
fn where_the_log_times_begin_again_too_the_order_of_the_log_tells() {
    for log in [10 * SECOND, 0] {
        let (a, b) = (marks(6, 10, log, 0), marks(6, 10, log, 200));
        let drives = drives_of([odometry(1.0, &a), odometry(2.0, &b)].concat()).unwrap();
        assert_eq!(drives.len(), 2, "{log}");
        let sweeps = [&a[..], &b].concat();
        let found = found_at(&drives, &sweeps);
        assert!(found[..60].iter().all(|x_m| *x_m == Some(1.0)), "{found:?}");
        assert!(found[60..].iter().all(|x_m| *x_m == Some(2.0)), "{found:?}");
        // The same, stored topic by topic.
        let far = |mark: &Mark| Mark {
            position: mark.position + 10_000,
            ..*mark
        };
        let apart: Vec<Mark> = sweeps.iter().map(far).collect();
        assert_eq!(found_at(&drives, &apart), found);
    }
}

#[test]
fn halves_that_were_merged_in_the_wrong_order_are_one_drive() {
    let (early, late) = (marks(3, 10, NOW, 500), marks(3, 13, NOW + 3 * SECOND, 0));
    let drives = drives_of([odometry(2.0, &late), odometry(1.0, &early)].concat()).unwrap();
    assert_eq!(drives.len(), 1);
    assert_eq!(drives[0].track.len(), 60);
    let found = found_at(&drives, &[&late[..], &early].concat());
    assert_eq!((found[0], found[59]), (Some(2.0), Some(1.0)));
}

#[test]
fn where_only_one_of_the_clocks_begins_again_no_pose_is_made_up() {
    // The sensor's clock begins again, that of the odometry goes on.
    let drives = drives_of(odometry(1.0, &marks(12, 10, NOW, 0))).unwrap();
    let sweeps = [marks(6, 10, NOW, 1), marks(6, 10, NOW + 6 * SECOND, 121)].concat();
    let matches = match_marks(&drives, &sweeps);
    assert_eq!(matches.shifted, 60);
    assert!(matches.drives[..60].iter().all(Option::is_some));
    assert!(matches.drives[60..].iter().all(Option::is_none));
    // The clock of the odometry begins again, that of the sensor goes on.
    let (a, b) = (marks(3, 10, NOW, 0), marks(9, 10, NOW + 3 * SECOND, 60));
    let drives = drives_of([odometry(1.0, &a), odometry(2.0, &b)].concat()).unwrap();
    let found = found_at(&drives, &marks(12, 10, NOW, 1));
    assert!(found[..30].iter().all(|x_m| *x_m == Some(1.0)), "{found:?}");
    assert!(found[31..].iter().all(Option::is_none), "{found:?}");
}

#[test]
fn a_log_that_was_written_much_later_than_it_was_driven_is_one_drive() {
    let drives = drives_of(odometry(1.0, &marks(6, 10, NOW, 0))).unwrap();
    let found = found_at(&drives, &marks(6, 10, NOW + 3600 * SECOND, 1));
    assert!(found.iter().all(Option::is_some));
}

#[test]
fn clocks_that_jump_about_are_refused() {
    let mut jumping = Vec::new();
    for step in 0..3000 {
        jumping.push(mark((step % 2) * 5 * SECOND, NOW + step, step));
    }
    assert_eq!(drives_of(odometry(0.0, &jumping)).unwrap_err(), 1500);
}
