//! Which nodes there are: each declares a token that vanishes with it.
//!
//! A killed process is noticed at once, a stopped one only when its lease ends (ten seconds).

use zenoh::handlers::FifoChannelHandler;
use zenoh::liveliness::LivelinessToken;
use zenoh::sample::{Sample, SampleKind};

use crate::Error;
use crate::keys;
use crate::session::{Session, network};

/// A node's presence, until it is dropped.
#[derive(Debug)]
pub struct NodeToken {
    key: String,
    _token: LivelinessToken,
}

impl NodeToken {
    /// The token's key.
    pub fn key(&self) -> &str {
        &self.key
    }
}

/// A node that came or went.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeChange {
    /// What it does: `generator`, `trainer`, `planner`, `recorder`, ...
    pub kind: String,
    /// Which of these it is.
    pub id: String,
    /// Whether it is there now.
    pub is_alive: bool,
}

/// Tells of the nodes that are there and of every change.
#[derive(Debug)]
pub struct NodeWatcher {
    changes: zenoh::pubsub::Subscriber<FifoChannelHandler<Sample>>,
}

impl Session {
    /// Declares that this process is a node.
    ///
    /// # Errors
    /// [`Error::Network`] if kind or id cannot be part of a key or the session is closed.
    pub async fn declare_node(&self, kind: &str, id: &str) -> Result<NodeToken, Error> {
        let key = keys::node(kind, id);
        match self.zenoh.liveliness().declare_token(key.clone()).await {
            Ok(token) => Ok(NodeToken { key, _token: token }),
            Err(error) => Err(network(&format!("{key}: no token"), error)),
        }
    }

    /// Watches the nodes; those that are there already come first.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn watch_nodes(&self) -> Result<NodeWatcher, Error> {
        let declared = self
            .zenoh
            .liveliness()
            .declare_subscriber(keys::NODES)
            .history(true)
            .await;
        match declared {
            Ok(changes) => Ok(NodeWatcher { changes }),
            Err(error) => Err(network("nodes cannot be watched", error)),
        }
    }
}

impl NodeWatcher {
    /// The next change, or `None` when the session is closed. It may be cancelled without loss.
    pub async fn recv(&mut self) -> Option<NodeChange> {
        loop {
            let sample = self.changes.recv_async().await.ok()?;
            let parts: Vec<&str> = sample.key_expr().split('/').collect();
            if let ["swath", "node", kind, id] = parts[..] {
                return Some(NodeChange {
                    kind: kind.to_owned(),
                    id: id.to_owned(),
                    is_alive: sample.kind() == SampleKind::Put,
                });
            }
        }
    }
}
