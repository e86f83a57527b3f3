//! Training of the network that predicts path regions: samples from recordings or the live stream,
//! the loss, the optimiser, the loop, evaluation, checkpoints and the trainer node.

mod batch;
mod checkpoint;
mod config;
mod dataset;
mod error;
mod evaluate;
mod example;
mod guided;
mod limits;
mod loss;
mod mining;
pub mod node;
mod optimiser;
mod random;
mod reach;
mod report;
mod run;
mod schedule;
mod score;
mod shipped;
mod source;
mod split;
mod train;

pub use batch::{Batch, Preparation};
pub use checkpoint::{Checkpoint, Progress, write_atomically};
pub use config::{DEFAULT_LABEL_DILATION_M, DrawnRadii, MAX_BATCH, MAX_EPOCHS, TrainConfig};
pub use dataset::{Dataset, MAX_EXAMPLES};
pub use error::Error;
pub use evaluate::{Predictor, Report, evaluate, ranked};
pub use example::Example;
pub use limits::{IOU_GROUPS, IouGroup, Limits, limits};
pub use loss::{LossConfig, loss_and_gradient};
pub use mining::Miner;
pub use optimiser::{Adam, AdamConfig, AdamState, Decay};
pub use reach::{Ranking, Reached, ranking};
pub use report::{Evaluated, evaluations};
pub use run::{
    BEST_FILE, CHECKPOINT_FILE, Observer, Run, ScoreReport, StepReport, Summary, Unobserved,
    Validation, WEIGHTS_FILE,
};
pub use schedule::Schedule;
pub use score::{Counts, DISTANCE_GROUPS_M, Scores};
pub use shipped::{SHIPPED_WEIGHTS, shipped};
pub use source::{Counts as StreamCounts, Live, Recorded, Replay, Shown, Source};
pub use split::{Split, split};
pub use train::{Learner, network_info, score};
