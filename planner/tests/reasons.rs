//! Why a path is empty, between real sessions: every empty path has a report that says why.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use surroundings::{Moment, Surroundings, config, soon};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::OccupancyGrid;
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::{Cell, FREE, GridSpec, OCCUPIED, Occupancy, Pose2, keys};
use swath_planner::Method;
use swath_planner::network::{Network, NetworkInfo, Parameters};
use swath_planner::node::ServedNetwork;

mod surroundings;

const TARGET: Pose2 = Pose2::new(30.0, 0.0, 0.0);

fn open() -> Occupancy {
    Occupancy::filled(GridSpec::default(), FREE)
}

fn message(occupancy: &Occupancy) -> OccupancyGrid {
    occupancy.to_message(Header::at(0, "base_link"))
}

fn to_target(occupancy: &Occupancy) -> Moment {
    Moment {
        grid: Some(message(occupancy)),
        targets: Some(("base_link", vec![TARGET])),
        ..Moment::default()
    }
}

/// Checks a report of a stop, and gives what it says.
fn said(report: &PlanReport) -> (&str, &str) {
    assert_eq!(report.chosen, -1);
    assert!(!report.reason.is_empty());
    (&report.reason, &report.detail)
}

#[tokio::test(flavor = "multi_thread")]
async fn without_any_grid_a_planner_says_so() {
    let mut node = Surroundings::start(config(), None).await;
    let report = node.next_report(|_| true).await;
    assert_eq!(said(&report), ("no grid yet", ""));
    // It keeps saying so, and the path is empty each time.
    let topic = keys::path(surroundings::VEHICLE);
    let mut paths = node.session.subscriber(&topic, 4).await.unwrap();
    let path = soon(paths.recv()).await.unwrap().message;
    assert!(path.poses.is_empty());
    assert_eq!((report.frame, report.method.as_str()), (0, ""));
    assert_eq!(node.end().await.frames, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planned_frame_without_a_path_says_why() {
    let mut node = Surroundings::start(config(), None).await;
    let nowhere = Moment {
        grid: Some(message(&open())),
        ..Moment::default()
    };
    let (report, path) = node.plan(&nowhere, |_| true).await;
    assert_eq!(said(&report).0, "no reference or targets");
    assert!(report.frame > 0 && path.poses.is_empty());
    let behind = Moment {
        reference: Some((
            "base_link",
            vec![Pose2::new(-9.0, 0.0, 0.0), Pose2::new(-8.0, 0.0, 0.0)],
        )),
        ..nowhere
    };
    let has_reference = |report: &PlanReport| report.detail.contains("along the reference");
    let (report, _) = node.plan(&behind, has_reference).await;
    assert_eq!(said(&report).0, "no reference or targets");

    let mut in_obstacle = open();
    in_obstacle.set(in_obstacle.spec.ego(), OCCUPIED);
    let has_target = |report: &PlanReport| !report.targets.is_empty();
    let (report, _) = node.plan(&to_target(&in_obstacle), has_target).await;
    assert_eq!(said(&report).0, "start occupied");

    let mut goal_blocked = open();
    for row in 130..170 {
        for col in 60..90 {
            goal_blocked.set(Cell::new(row, col), OCCUPIED);
        }
    }
    let (report, path) = node.plan(&to_target(&goal_blocked), has_target).await;
    let expected = "none of 1 targets reached (1 goal_occupied)";
    assert_eq!(said(&report), ("blocked", expected));
    assert!(path.poses.is_empty());

    let (report, path) = node.plan(&to_target(&open()), has_target).await;
    assert_eq!((report.reason.as_str(), report.chosen), ("", 0));
    assert!(!path.poses.is_empty());
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn when_grids_stop_or_cannot_be_used_the_report_says_which() {
    let mut node = Surroundings::start(config(), None).await;
    let good = to_target(&open());
    node.plan(&good, |report| report.chosen == 0).await;
    let report = node.next_report(|report| report.chosen < 0).await;
    let (reason, detail) = said(&report);
    assert_eq!(reason, "stale grid");
    assert!(detail.starts_with("the newest one came "), "{detail}");
    assert_eq!(report.header.frame_id, "base_link");

    // Damaged ones leave the path as it is, until it expires.
    node.plan(&good, |report| report.chosen == 0).await;
    let mut damaged = message(&open());
    damaged.data[7] = 101;
    let report = soon(async {
        loop {
            node.grids.put(&damaged).await.unwrap();
            let report = node.next_report(|_| true).await;
            if report.chosen < 0 {
                return report;
            }
        }
    })
    .await;
    let (reason, detail) = said(&report);
    // The grid may have been lost, and arrived when the path had expired.
    assert!(["stale grid", "bad input"].contains(&reason), "{reason}");
    let wanted = "value 101 at index 7";
    assert!(
        reason == "stale grid" || detail.contains(wanted),
        "{detail}"
    );
    node.end().await;
}

/// A network for a grid and a vehicle.
fn network(info: &NetworkInfo) -> ServedNetwork {
    let parameters = Parameters::initial(info.architecture, 1);
    ServedNetwork {
        network: Network::load(&Network::save(info, &parameters)).unwrap(),
        run: String::new(),
        version: 0,
        stamp_nanos: 0,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_network_for_another_grid_is_not_used_and_one_for_another_vehicle_is() {
    let mut in_regions = config();
    in_regions.plan.method = Method::TievFcn;
    let other_grid = NetworkInfo {
        spec: GridSpec {
            rows: 400,
            ..GridSpec::default()
        },
        ..NetworkInfo::default()
    };
    let other_vehicle = NetworkInfo {
        vehicle: "0123456789abcdef".to_owned(),
        ..NetworkInfo::default()
    };
    let has_target = |report: &PlanReport| !report.targets.is_empty();
    for (info, method) in [(other_grid, "tiev"), (other_vehicle, "tiev-fcn")] {
        let mut node = Surroundings::start(in_regions.clone(), Some(network(&info))).await;
        let (report, _) = node.plan(&to_target(&open()), has_target).await;
        assert_eq!(report.method, method);
        node.end().await;
    }
}
