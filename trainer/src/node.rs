//! The trainer node: learns from the samples that generators publish, for as long as it runs, and
//! publishes weights and how it goes.
//!
//! It is one task that owns everything it knows. A step runs on a thread of its own while samples
//! keep coming in. Every so many steps the network is scored on samples of scenes that were set
//! aside, written to the disk and published; a planner that joins later gets the newest from the
//! publisher's cache, and a trainer that starts again publishes what it finds on the disk first.

use std::future::Future;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swath_bridge::msg::swath::{Evaluation, Sample, TrainStatus, Weights};
use swath_bridge::signature::{self, SigningKey};
use swath_bridge::{GridSpec, NodeToken, Publisher, Session, Subscriber, Vehicle, clock, keys};
use swath_planner::network::Parameters;
use tokio::task::{JoinHandle, spawn_blocking};

use crate::checkpoint::{Checkpoint, write_atomically};
use crate::mining::CANDIDATES;
use crate::run::{CHECKPOINT_FILE, WEIGHTS_FILE};
use crate::source::{Live, Replay, Source};
use crate::train::{Learner, network_info, score};
use crate::{Error, Example, Miner, Report, Schedule, TrainConfig};

mod messages;

/// Samples that wait while a step is prepared.
const QUEUE: usize = 256;
/// One scene in so many is set aside for scoring.
const ASIDE_EVERY: u64 = 12;
/// Shortest time between two messages of status.
const STATUS_PERIOD: Duration = Duration::from_millis(500);
/// Steps of the warm-up.
const WARM_UP_STEPS: u64 = 20;

/// What a trainer node is told.
#[derive(Debug, Clone)]
pub struct NodeConfig {
    /// Name of the run in the keys.
    pub run: String,
    /// How to train; `epochs` does not count.
    pub train: TrainConfig,
    /// Grid of the samples; others are rejected.
    pub grid: GridSpec,
    /// Vehicle that the weights are for.
    pub vehicle: Vehicle,
    /// Weights to start from, unless there is a checkpoint.
    pub initial: Option<Parameters>,
    /// Where checkpoint and weights are kept, if anywhere. A checkpoint that is there is continued.
    pub directory: Option<PathBuf>,
    /// Signs the weights.
    pub key: SigningKey,
    /// Most samples that are kept for training.
    pub replay_capacity: usize,
    /// Samples to wait for before the first step.
    pub first_samples: usize,
    /// Steps from one publication of weights to the next.
    pub publish_every_steps: u64,
    /// Most samples that are set aside for scoring.
    pub validation_samples: usize,
    /// Steps over which the rate falls to 0 as in the paper; `None` keeps it.
    pub steps: Option<u64>,
}

impl NodeConfig {
    /// A node with the customary settings.
    pub fn new(run: &str, key: SigningKey) -> Self {
        Self {
            run: run.to_owned(),
            train: TrainConfig::default(),
            grid: GridSpec::default(),
            vehicle: Vehicle::default(),
            initial: None,
            directory: None,
            key,
            replay_capacity: 20_000,
            first_samples: 32,
            publish_every_steps: 25,
            validation_samples: 64,
            steps: None,
        }
    }

    fn schedule(&self) -> Schedule {
        let rate = self.train.base_rate;
        self.steps.map_or_else(
            || Schedule::constant(rate, WARM_UP_STEPS),
            |steps| {
                Schedule::cosine(
                    rate,
                    WARM_UP_STEPS.min(steps),
                    steps.saturating_sub(WARM_UP_STEPS),
                )
            },
        )
    }
}

/// What a node did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodeSummary {
    /// Steps in all, those before a restart included.
    pub steps: u64,
    /// Number of the newest weights.
    pub version: u64,
    /// mIoU of the newest weights on the samples set aside.
    pub miou: Option<f64>,
}

/// Runs a trainer node until `stop` is done or the last step is taken. `observe` sees every status
/// that is published.
///
/// # Errors
/// [`Error::Bridge`] when the session fails, [`Error::Diverged`], [`Error::Checkpoint`] and
/// [`Error::Io`].
pub async fn run(
    session: &Session,
    config: NodeConfig,
    stop: impl Future<Output = ()>,
    mut observe: impl FnMut(&TrainStatus),
) -> Result<NodeSummary, Error> {
    let mut node = Node::new(session, config).await?;
    let mut stop = pin!(stop);
    let mut training = None;
    loop {
        if training.is_none() {
            training = node.start_step();
            if node.is_done() {
                break;
            }
        }
        tokio::select! {
            biased;
            () = &mut stop => break,
            stepped = finished(&mut training) => {
                if let Some(status) = node.take_step(stepped?).await? {
                    observe(&status);
                }
            }
            sample = node.samples.recv() => match sample {
                Some(sample) => node.take_sample(sample.message),
                None => break,
            },
        }
    }
    if let Some(training) = training {
        let stepped = join(training).await?;
        node.take_step(stepped).await?;
    }
    node.end().await
}

/// The step that is under way, when it is finished; never, if there is none.
async fn finished(
    training: &mut Option<JoinHandle<Result<Stepped, Error>>>,
) -> Result<Stepped, Error> {
    let Some(handle) = training else {
        return std::future::pending().await;
    };
    let stepped = handle.await;
    *training = None;
    flatten(stepped)
}

async fn join(training: JoinHandle<Result<Stepped, Error>>) -> Result<Stepped, Error> {
    flatten(training.await)
}

fn flatten(
    stepped: Result<Result<Stepped, Error>, tokio::task::JoinError>,
) -> Result<Stepped, Error> {
    stepped.unwrap_or_else(|error| {
        Err(Error::Lost {
            what: error.to_string(),
        })
    })
}

/// A step that was taken, or a publication that was prepared.
struct Stepped {
    learner: Box<Learner>,
    loss: f64,
    rate: f64,
    shown: usize,
    edition: Option<Edition>,
    /// Numbers of the samples that are hard, if that was found out anew.
    hard: Option<Vec<u64>>,
}

/// Weights that are ready to be published.
struct Edition {
    weights: Weights,
    report: Option<Report>,
}

struct Node {
    config: NodeConfig,
    samples: Subscriber<Sample>,
    status: Publisher<TrainStatus>,
    weights: Publisher<Weights>,
    evaluations: Publisher<Evaluation>,
    /// Away while a step is under way.
    learner: Option<Box<Learner>>,
    live: Live,
    miner: Option<Arc<Miner>>,
    validation: Vec<Example>,
    schedule: Schedule,
    progress: messages::Standing,
    last_status: Option<Instant>,
    pace: (Instant, u64),
    summary: NodeSummary,
    _token: NodeToken,
}

impl Node {
    async fn new(session: &Session, config: NodeConfig) -> Result<Self, Error> {
        let learner = learner(&config)?;
        let steps_done = learner.progress().step;
        let has_weights = steps_done > 0 || config.initial.is_some();
        let replay = Replay::on_grid(config.replay_capacity, config.grid);
        let chance = (config.train.seed, config.train.mirror);
        let mut node = Self {
            samples: session.subscriber(&keys::sample("*"), QUEUE).await?,
            status: session.publisher(&keys::train_status(&config.run)).await?,
            weights: session.publisher(&keys::weights(&config.run)).await?,
            evaluations: session.publisher(&keys::evaluation(&config.run)).await?,
            live: Live::new(replay, config.publish_every_steps, chance),
            miner: miner(&config)?,
            learner: None,
            validation: Vec::new(),
            schedule: config.schedule(),
            progress: messages::Standing::default(),
            last_status: None,
            pace: (Instant::now(), 0),
            summary: NodeSummary {
                steps: steps_done,
                version: learner.progress().version,
                miou: None,
            },
            _token: session.declare_node("trainer", &config.run).await?,
            config,
        };
        let mut learner = Box::new(learner);
        if has_weights {
            let edition = edition(&node.config, &mut learner, &[])?;
            node.publish(edition).await?;
        }
        node.learner = Some(learner);
        Ok(node)
    }

    /// Takes a sample in: one scene in [`ASIDE_EVERY`] is set aside for scoring.
    fn take_sample(&mut self, sample: Sample) {
        let Some(example) = self.live.replay.admit(sample) else {
            return;
        };
        let aside = example.scene_id.is_multiple_of(ASIDE_EVERY);
        if !aside {
            self.live.replay.push(example);
        } else if self.validation.len() < self.config.validation_samples {
            self.validation.push(example);
        }
    }

    fn is_done(&self) -> bool {
        let done = |learner: &Learner| {
            let end = self.config.steps;
            end.is_some_and(|end| learner.progress().step >= end)
        };
        self.learner.as_deref().is_some_and(done)
    }

    /// Starts a step if there are samples enough.
    fn start_step(&mut self) -> Option<JoinHandle<Result<Stepped, Error>>> {
        if self.is_done() || self.live.replay.examples().len() < self.config.first_samples.max(1) {
            return None;
        }
        let mut learner = self.learner.take()?;
        let step = learner.progress().step;
        let shown = self.live.draw(step, self.config.train.batch);
        let rate = self.schedule.rate(step);
        let publish = (step + 1).is_multiple_of(self.config.publish_every_steps.max(1));
        let edition_for = publish.then(|| (self.config.clone(), self.validation.clone()));
        let miner = self.miner.clone().filter(|_| publish);
        let candidates = miner
            .as_ref()
            .map(|_| self.live.candidates(step, CANDIDATES));
        Some(spawn_blocking(move || {
            let batch = learner.preparation().batch(&shown)?;
            let loss = learner.step(&batch, rate)?;
            let edition = edition_for
                .map(|(config, validation)| edition(&config, &mut learner, &validation))
                .transpose()?;
            let hard = miner
                .zip(candidates)
                .map(|(miner, candidates)| miner.hardest(&learner.network(), &candidates));
            Ok(Stepped {
                learner,
                loss,
                rate,
                shown: shown.len(),
                edition,
                hard: hard.transpose()?,
            })
        }))
    }

    /// Takes the learner back and publishes what is due.
    async fn take_step(&mut self, stepped: Stepped) -> Result<Option<TrainStatus>, Error> {
        self.summary.steps = stepped.learner.progress().step;
        self.progress.loss = stepped.loss;
        self.progress.rate = stepped.rate;
        self.progress.samples = stepped.learner.progress().samples;
        self.pace.1 += stepped.shown as u64;
        if let Some(hard) = stepped.hard {
            let share = stepped.learner.config().hard_share;
            self.live.bring_back(&hard, share);
        }
        self.learner = Some(stepped.learner);
        let published = stepped.edition.is_some();
        if let Some(edition) = stepped.edition {
            self.publish(edition).await?;
        }
        let recent = self
            .last_status
            .is_some_and(|last| last.elapsed() < STATUS_PERIOD);
        if recent && !published {
            return Ok(None);
        }
        let elapsed_s = self.pace.0.elapsed().as_secs_f64();
        self.progress.samples_per_s = self.pace.1 as f64 / elapsed_s.max(1e-9);
        self.pace = (Instant::now(), 0);
        self.last_status = Some(Instant::now());
        let status = messages::status(&self.config, &self.summary, &self.progress, &self.live);
        self.status.put(&status).await?;
        Ok(Some(status))
    }

    async fn publish(&mut self, edition: Edition) -> Result<(), Error> {
        self.summary.version = edition.weights.version;
        if let Some(report) = &edition.report {
            self.summary.miou = Some(report.scores.total.miou());
            for message in messages::evaluations(&edition.weights, report) {
                self.evaluations.put(&message).await?;
            }
        }
        Ok(self.weights.put(&edition.weights).await?)
    }

    /// Publishes and keeps what was learnt since the last time.
    async fn end(mut self) -> Result<NodeSummary, Error> {
        let every = self.config.publish_every_steps.max(1);
        let unpublished = !self.summary.steps.is_multiple_of(every);
        if let Some(mut learner) = self.learner.take().filter(|_| unpublished) {
            let config = self.config.clone();
            let validation = std::mem::take(&mut self.validation);
            let edition = spawn_blocking(move || edition(&config, &mut learner, &validation));
            let edition = edition.await.unwrap_or_else(|error| {
                Err(Error::Lost {
                    what: error.to_string(),
                })
            })?;
            self.publish(edition).await?;
        }
        Ok(self.summary)
    }
}

/// What finds hard samples, if they are wanted.
fn miner(config: &NodeConfig) -> Result<Option<Arc<Miner>>, Error> {
    let wanted = config.train.hard_share > 0.0;
    let miner = wanted.then(|| Miner::new(&config.vehicle, &config.grid).map(Arc::new));
    miner.transpose()
}

/// The learner to begin with: from the checkpoint in the directory, from the given weights, or new.
fn learner(config: &NodeConfig) -> Result<Learner, Error> {
    let info = network_info(&config.train, &config.grid, &config.vehicle);
    let path = config
        .directory
        .as_ref()
        .map(|directory| directory.join(CHECKPOINT_FILE));
    if let Some(path) = path.filter(|path| path.exists()) {
        return Learner::resume(Checkpoint::load(&path)?, &path, &config.train, info);
    }
    let mut learner = Learner::new(config.train.clone(), info)?;
    if let Some(parameters) = &config.initial {
        learner.start_from(parameters.clone());
    }
    Ok(learner)
}

/// Scores the network, writes it to the disk and signs it.
fn edition(
    config: &NodeConfig,
    learner: &mut Learner,
    validation: &[Example],
) -> Result<Edition, Error> {
    let report = score(learner, validation)?;
    let version = learner.next_version();
    let loss = learner.take_loss();
    let safetensors = learner.weights();
    if let Some(directory) = &config.directory {
        std::fs::create_dir_all(directory).map_err(|source| Error::Io {
            path: directory.clone(),
            source,
        })?;
        write_atomically(&directory.join(WEIGHTS_FILE), &safetensors)?;
        learner
            .checkpoint()
            .save(&directory.join(CHECKPOINT_FILE))?;
    }
    let mut weights = messages::weights(config, learner, (version, loss), report.as_ref());
    weights.safetensors = safetensors;
    weights.header.stamp = swath_bridge::msg::header::Time::from_nanos(clock::now_nanos());
    signature::sign(&mut weights, &config.key)?;
    Ok(Edition { weights, report })
}

#[cfg(test)]
mod tests;
