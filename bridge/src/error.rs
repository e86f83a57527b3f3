//! What can go wrong between a process and the world outside.

use std::path::PathBuf;

use crate::cdr::CdrError;

/// Errors of this crate, each with the evidence.
///
/// The text of an error holds that of its cause, so causes are no sources: whoever prints the chain of
/// sources would say them twice. Hence the raw names of those fields.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A grid's size or place cannot be worked with.
    #[error("invalid grid: {what}")]
    InvalidGrid {
        /// Which field, its value and what was expected.
        what: String,
    },
    /// A grid's message cannot be worked with.
    #[error("invalid grid: {what}")]
    UnusableGrid {
        /// What about it, in words that are the same for all grids.
        fault: crate::GridFault,
        /// Which field, its value and what was expected.
        what: String,
    },
    /// A dimension of the vehicle is out of range.
    #[error("invalid vehicle: {field} is {value}, expected {least} to {most}")]
    InvalidVehicle {
        /// Field of the configuration.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Least it may be.
        least: f64,
        /// Most it may be.
        most: f64,
    },
    /// A vehicle's table of curvatures cannot be meant.
    #[error("invalid vehicle: curvature_by_speed: {what}")]
    CurvatureBySpeed {
        /// Which row, and what was expected.
        what: String,
    },
    /// A message did not decode.
    #[error("{topic}: not a {type_name}: {source}")]
    Decode {
        /// Key expression or topic it came on.
        topic: String,
        /// Type that was expected.
        type_name: &'static str,
        /// What is wrong, and where.
        r#source: CdrError,
    },
    /// A value of a configuration is out of range.
    #[error("{field} is {value}, expected {least} to {most}")]
    InvalidConfig {
        /// Field of the configuration.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Least it may be.
        least: f64,
        /// Most it may be.
        most: f64,
    },
    /// A pose is not finite, or absurdly far from its frame's origin.
    #[error("pose ({}, {}, {}) cannot be worked with", pose.x_m, pose.y_m, pose.yaw_rad)]
    InvalidPose {
        /// The pose.
        pose: crate::Pose2,
    },
    /// A log lacks what is needed from it.
    #[error("{}: no {wanted}; the file has {found}", path.display())]
    MissingTopic {
        /// Path as it was given.
        path: PathBuf,
        /// What was looked for.
        wanted: String,
        /// Topics of the file with their types and numbers of messages.
        found: String,
    },
    /// Nobody says where a sensor is on the vehicle.
    #[error(
        "{}: no transform from {sensor_frame:?} ({topic}) to {vehicle_frame:?}, known are {known}: say \
         where the sensor is with --mount {topic}=x,y,z,roll,pitch,yaw (metres, radians)",
        path.display()
    )]
    MissingTransform {
        /// Path as it was given.
        path: PathBuf,
        /// Topic of the sensor.
        topic: Box<str>,
        /// Frame of the sensor.
        sensor_frame: Box<str>,
        /// Frame of the vehicle.
        vehicle_frame: Box<str>,
        /// The frames that have transforms.
        known: Box<str>,
    },
    /// A message decodes, but what it says cannot be.
    #[error("not a usable {type_name}: {what}")]
    InvalidMessage {
        /// Type of the message.
        type_name: &'static str,
        /// What was found in which field, and what was expected.
        what: String,
    },
    /// A message could not be encoded.
    #[error("{topic}: {type_name} cannot be encoded: {source}")]
    Encode {
        /// Key expression or topic it was for.
        topic: String,
        /// Its type.
        type_name: &'static str,
        /// What is wrong with it.
        r#source: CdrError,
    },
    /// The network, or zenoh, did not do what it was asked to.
    #[error("{what}: {source}")]
    Network {
        /// What was being done.
        what: String,
        /// Zenoh's word.
        r#source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Another node has the name of one that must be alone.
    #[error("a {kind} {id} runs already")]
    NodeTaken {
        /// What the node does, for example `planner`.
        kind: String,
        /// Its name.
        id: String,
    },
    /// Every port at which the sessions of a machine meet is taken.
    #[error(
        "every port from {first} to {last} on 127.0.0.1 is taken: give an endpoint to listen on"
    )]
    NoFreePort {
        /// The lowest.
        first: u16,
        /// The highest.
        last: u16,
    },
    /// A key is not one that messages of the type can be on.
    #[error("{key:?} is not a key of swath: {what}")]
    BadKey {
        /// The key.
        key: String,
        /// What was expected.
        what: &'static str,
    },
    /// Weights that must not be used.
    #[error("weights {run:?} version {version}: {what}")]
    BadWeights {
        /// The run they say they are from.
        run: String,
        /// The version they say they are.
        version: u64,
        /// What is wrong with them.
        what: String,
    },
    /// A setting that cannot be worked with.
    #[error("{name} is {value}, expected {expected}")]
    BadSetting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// The system gives no randomness to make a key of.
    #[error("{}: no key can be made: {what}", path.display())]
    NoRandomness {
        /// Where the key was to be.
        path: PathBuf,
        /// The system's word.
        what: String,
    },
    /// A recording is damaged, not one, or has something else in it than expected.
    #[error("{}: at byte {offset}: {what}", path.display())]
    BadRecording {
        /// Path as it was given.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What was found there, and what was expected.
        what: String,
    },
    /// A file that was to be written is there already.
    #[error("{} exists already: {what}", path.display())]
    Exists {
        /// Path as it was given.
        path: PathBuf,
        /// What is known of it, and what to do.
        what: String,
    },
    /// A choice of topics that a recording has none of.
    #[error("{}: no topic matches {pattern:?}; the recording has {found}", path.display())]
    NoTopicMatches {
        /// Path as it was given.
        path: PathBuf,
        /// The pattern.
        pattern: String,
        /// The topics that there are.
        found: String,
    },
    /// A file could not be opened, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Path as it was given.
        path: PathBuf,
        /// The system's word.
        r#source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("{}: {what}", path.display())]
    BadFile {
        /// Path as it was given.
        path: PathBuf,
        /// What was found at which byte or line, and what was expected.
        what: String,
    },
}
