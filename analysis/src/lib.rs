//! Recordings to tables, plots and the report.
//!
//! A recording's messages become tables (one row a message, scalars only); from them come the
//! comparison of methods, the agreement of predicted regions with labels and the health of the
//! pipeline; and from those a page of Markdown, the paper's tables in LaTeX, plots, and every table
//! as CSV and Parquet. Nothing but the recordings enters, so the same recordings give the same report.

mod agreement;
mod comparison;
mod config;
mod error;
mod format;
mod frames;
mod grid;
mod health;
mod interval;
mod methods;
mod pairwise;
pub mod paper;
mod plots;
mod read;
mod report;
mod results;
mod sections;
mod sequence;
mod spread;
mod summary;
mod tables;

pub use config::ReportOptions;
pub use error::Error;
pub use interval::{Interval, MIN_COMPARED_SAMPLES};
pub use read::Progress;
pub use report::report;
pub use spread::Spread;
pub use summary::{MethodSummary, PlannerSummary, PredictorSummary, Summary, TrainerSummary};
