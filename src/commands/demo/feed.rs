//! Live grids for a demo's planner: a simulated drive, or the frames of logs again and again.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::poses::{odometry_message, path_message};
use swath_bridge::{Frame, Publisher, Session, clock, ingest, keys};
use swath_generator::{Drive, Generator, Scenes};
use tokio::time::MissedTickBehavior;

use crate::config::Config;

/// Seed of the simulated drive.
const SEED: u64 = 2026;
/// Name of the vehicle in the keys.
pub(super) const VEHICLE: &str = "v0";
/// The same vehicle for the paper's planner, which plans in the regions of the newest weights.
pub(super) const GUIDED: &str = "v0-fcn";
/// Of so many frames it gets one: it takes longer.
const GUIDED_EVERY: u64 = 5;

/// Where frames come from.
#[derive(Debug)]
pub(super) enum Feed {
    /// A simulated drive.
    Drive(Box<Drive>),
    /// Logs, one after the other.
    Logs {
        logs: Vec<PathBuf>,
        config: Box<ingest::IngestConfig>,
    },
}

impl Feed {
    /// Frames of logs, or of a simulated drive without any.
    pub(super) fn open(logs: &[PathBuf], config: &Config) -> anyhow::Result<Self> {
        if logs.is_empty() {
            let generator = Generator::new(config.generator(), Scenes::Procedural)?;
            return Ok(Self::Drive(Box::new(Drive::new(Arc::new(generator), SEED))));
        }
        let config = config.ingest();
        // A log that cannot be read is an error now, not when its turn comes.
        for log in logs {
            drop(ingest::frames(log, &config)?);
        }
        Ok(Self::Logs {
            logs: logs.to_vec(),
            config: Box::new(config),
        })
    }

    fn frames(self) -> Box<dyn Iterator<Item = anyhow::Result<Frame>> + Send> {
        match self {
            Self::Drive(drive) => Box::new(drive.map(|(_, frame)| Ok(frame))),
            Self::Logs { logs, config } => {
                let endless = (0..logs.len()).cycle().flat_map(move |index| {
                    let frames = ingest::frames(&logs[index], &config);
                    let (frames, error) = match frames {
                        Ok(frames) => (Some(frames), None),
                        Err(error) => (None, Some(Err(error))),
                    };
                    frames.into_iter().flatten().chain(error)
                });
                Box::new(endless.map(|frame| Ok(frame?)))
            }
        }
    }
}

/// What a vehicle publishes.
struct Vehicle {
    grids: Publisher<OccupancyGrid>,
    odometry: Publisher<Odometry>,
    references: Publisher<Path>,
}

impl Vehicle {
    async fn new(session: &Session, name: &str) -> anyhow::Result<Self> {
        Ok(Self {
            grids: session.publisher(&keys::grid(name)).await?,
            odometry: session.publisher(&keys::odom(name)).await?,
            references: session.publisher(&keys::reference(name)).await?,
        })
    }

    async fn publish(&self, frame: &Frame) -> anyhow::Result<()> {
        let header = Header::at(clock::now_nanos(), "base_link");
        let reference = path_message(&header, &frame.reference);
        self.references.put(&reference).await?;
        self.odometry.put(&odometry_message(&header, frame)).await?;
        self.grids.put(&frame.occupancy.to_message(header)).await?;
        Ok(())
    }
}

/// Publishes a frame every `period` until it is dropped.
pub(super) async fn run(session: Session, feed: Feed, period: Duration) -> anyhow::Result<()> {
    let vehicle = Vehicle::new(&session, VEHICLE).await?;
    let guided = Vehicle::new(&session, GUIDED).await?;
    let mut ticks = tokio::time::interval(period);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut frames = feed.frames();
    let mut number = 0u64;
    loop {
        // Simulating or reading a frame takes milliseconds, which other tasks are not to wait for.
        let made = tokio::task::spawn_blocking(move || {
            let frame = frames.next();
            (frames, frame)
        });
        let (rest, frame) = made.await?;
        frames = rest;
        let Some(frame) = frame.transpose()? else {
            return Ok(());
        };
        ticks.tick().await;
        vehicle.publish(&frame).await?;
        if number.is_multiple_of(GUIDED_EVERY) {
            guided.publish(&frame).await?;
        }
        number += 1;
    }
}
