//! Whatever ends a planner node, nobody drives on along the path that it published last.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Path};
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::poses::path_message;
use swath_bridge::{
    Error as BridgeError, FREE, GridSpec, Occupancy, Pose2, Publisher, Session, SessionConfig,
    Subscriber, Vehicle, keys,
};
use swath_planner::node::{self, FollowConfig, FramesConfig, NodeConfig};
use swath_planner::{Error, ObstacleConfig, PlanConfig, TargetConfig};

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(2);
/// Time between two grids.
const PERIOD: Duration = Duration::from_millis(200);
const VEHICLE: &str = "v0";

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

/// Two sessions that are connected to each other and to nobody else.
async fn pair() -> (Session, Session) {
    let listening = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    let a = Session::open(&listening).await.unwrap();
    let connecting = SessionConfig {
        connect: a.endpoints().await,
        ..SessionConfig::default()
    };
    let b = Session::open(&connecting).await.unwrap();
    (a, b)
}

fn config() -> NodeConfig {
    NodeConfig {
        vehicle_id: VEHICLE.to_owned(),
        vehicle: Vehicle::default(),
        grid: GridSpec::default(),
        obstacles: ObstacleConfig::default(),
        targets: TargetConfig {
            count: 3,
            ..TargetConfig::default()
        },
        plan: PlanConfig::default(),
        // So long that no path is withdrawn because its grid has become old.
        follow: FollowConfig {
            expires_s: 10.0,
            ..FollowConfig::default()
        },
        run: "*".to_owned(),
        frames: FramesConfig::default(),
        trusted: Vec::new(),
        shares_vehicle: false,
    }
}

/// A vehicle on an open field.
struct Field {
    grids: Publisher<OccupancyGrid>,
    references: Publisher<Path>,
    paths: Subscriber<Path>,
    stamp: u64,
}

impl Field {
    async fn new(session: &Session) -> Self {
        Self {
            grids: session.publisher(&keys::grid(VEHICLE)).await.unwrap(),
            references: session.publisher(&keys::reference(VEHICLE)).await.unwrap(),
            paths: session.subscriber(&keys::path(VEHICLE), 64).await.unwrap(),
            stamp: 0,
        }
    }

    /// Sends grids until a path comes that is as it should be, then returns that.
    async fn path(&mut self, is_wanted: impl Fn(&Path) -> bool) -> Path {
        let open = Occupancy::filled(GridSpec::default(), FREE);
        let road: Vec<Pose2> = (0..60)
            .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
            .collect();
        loop {
            self.stamp += 1;
            let header = Header::at(self.stamp, "base_link");
            let reference = path_message(&header, &road);
            self.references.put(&reference).await.unwrap();
            self.grids.put(&open.to_message(header)).await.unwrap();
            let came = tokio::time::timeout(PERIOD, self.paths.recv()).await;
            if let Ok(Some(came)) = came
                && is_wanted(&came.message)
            {
                return came.message;
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_that_panics_withdraws_its_path_and_fails() {
    let (session, node_session) = pair().await;
    let mut field = Field::new(&session).await;
    let panics = |report: &PlanReport| assert!(report.chosen < 0, "panics on purpose");
    let node = tokio::spawn(async move {
        node::run(
            &node_session,
            config(),
            None,
            std::future::pending(),
            panics,
        )
        .await
    });
    let driven = soon(field.path(|path| !path.poses.is_empty())).await;
    let withdrawn = soon(field.path(|path| path.poses.is_empty())).await;
    assert_eq!(withdrawn.header.frame_id, driven.header.frame_id);
    let error = soon(node).await.unwrap().unwrap_err();
    let said = matches!(&error, Error::Panicked { what } if what.contains("panics on purpose"));
    assert!(said, "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_planner_for_a_vehicle_is_refused_and_the_first_goes_on() {
    let (session, node_session) = pair().await;
    let mut field = Field::new(&session).await;
    let nothing = |_: &PlanReport| ();
    let first = tokio::spawn(async move {
        node::run(
            &node_session,
            config(),
            None,
            std::future::pending(),
            nothing,
        )
        .await
    });
    soon(field.path(|path| !path.poses.is_empty())).await;
    let second = node::run(&session, config(), None, std::future::pending(), nothing);
    let error = soon(Box::pin(second)).await.unwrap_err();
    let is_taken =
        matches!(&error, Error::Bridge(BridgeError::NodeTaken { id, .. }) if id == VEHICLE);
    assert!(is_taken, "{error}");
    soon(field.path(|path| !path.poses.is_empty())).await;

    // One that is told to share the vehicle runs beside it.
    let shares = NodeConfig {
        shares_vehicle: true,
        ..config()
    };
    let mut nodes = session.watch_nodes().await.unwrap();
    let both_run = async move {
        for _ in 0..2 {
            assert!(nodes.recv().await.unwrap().is_alive);
        }
    };
    soon(Box::pin(node::run(
        &session, shares, None, both_run, nothing,
    )))
    .await
    .unwrap();

    // One that waits for the first to end stops when it is told to.
    let waits = node::run(&session, config(), None, async {}, nothing);
    assert_eq!(soon(Box::pin(waits)).await.unwrap().frames, 0);
    first.abort();
}
