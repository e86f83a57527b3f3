//! One module a command.

pub(crate) mod bench;
pub(crate) mod bridge;
pub(crate) mod config;
pub(crate) mod demo;
pub(crate) mod evaluate;
pub(crate) mod export;
pub(crate) mod generate;
pub(crate) mod plan;
pub(crate) mod report;
pub(crate) mod train;
