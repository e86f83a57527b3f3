//! How sessions of one machine find each other without a router, multicast or any open interface.
//!
//! There is a small range of fixed ports on 127.0.0.1. A session listens on the lowest free one and
//! keeps trying to connect to every port below its own. So of any two sessions the one with the
//! higher port connects to the other, every pair has exactly one connection, and none of them is
//! special: whichever ends, the others stay connected, and a newcomer that takes its port is found
//! by those above within a second. Rejected: multicast scouting on the loopback interface (zenoh
//! binds its sockets to every interface), and one meeting port that the first session holds (the
//! others depend on it, and whoever takes it over is connected to twice).

use std::net::{Ipv4Addr, TcpListener};

use zenoh::Config;

use super::settings::{json, set};
use crate::Error;

/// Time between two attempts to connect to a port below, once it was found closed.
const RETRY_MS: u32 = 500;
const MOST_RETRY_MS: u32 = 1000;

/// A range of ports on 127.0.0.1 in which sessions meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ports {
    /// The lowest.
    pub first: u16,
    /// How many, which is also the most sessions that can meet; 1 to 256.
    pub count: u16,
}

impl Default for Ports {
    /// Thirty-two ports below the range that systems give out by themselves.
    fn default() -> Self {
        Self {
            first: 17_447,
            count: 32,
        }
    }
}

/// The port that a session is to listen on, and those around it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    port: u16,
    below: Vec<u16>,
    above: Vec<u16>,
}

/// Chooses the lowest free port.
pub(super) fn choose(ports: Ports) -> Result<Place, Error> {
    let last = ports.first.saturating_add(ports.count.clamp(1, 256) - 1);
    let port = (ports.first..=last).find(|&port| is_free(port));
    let Some(port) = port else {
        return Err(Error::NoFreePort {
            first: ports.first,
            last,
        });
    };
    Ok(Place {
        port,
        below: (ports.first..port).collect(),
        above: (port..=last).skip(1).collect(),
    })
}

fn endpoint(port: u16) -> String {
    format!("tcp/127.0.0.1:{port}")
}

/// Whether nobody listens on an endpoint of loopback.
pub(super) fn is_deserted(endpoint: &str) -> bool {
    let port = endpoint
        .rsplit(':')
        .next()
        .and_then(|port| port.parse().ok());
    port.is_some_and(is_free)
}

fn is_free(port: u16) -> bool {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
}

impl Place {
    /// Endpoints of all other ports.
    pub(super) fn others(&self) -> Vec<String> {
        let others = self.below.iter().chain(&self.above);
        others.copied().map(endpoint).collect()
    }

    /// Endpoints of the ports below.
    fn below(&self) -> Vec<String> {
        self.below.iter().copied().map(endpoint).collect()
    }

    pub(super) fn apply(&self, config: &mut Config) -> Result<(), Error> {
        set(config, "listen/endpoints", &json(&[endpoint(self.port)]))?;
        set(config, "connect/endpoints", &json(&self.below()))?;
        set(config, "connect/timeout_ms", "-1")?;
        set(config, "connect/exit_on_failure", "false")?;
        set(
            config,
            "connect/retry",
            &format!(
                "{{ period_init_ms: {RETRY_MS}, period_max_ms: {MOST_RETRY_MS}, \
                 period_increase_factor: 1.5 }}"
            ),
        )?;
        // Everyone is connected to everyone already; hearsay would only add second connections.
        set(config, "scouting/gossip/enabled", "false")
    }
}
