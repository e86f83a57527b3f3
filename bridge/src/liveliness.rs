//! Which nodes there are: each declares a token that vanishes with it.
//!
//! A killed process is noticed at once, a stopped one only when its lease ends (ten seconds). The last
//! part of a token's key is its own, so that two nodes of one name can be told apart: both are warned,
//! and a node that must be alone is refused.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::time::{Instant, timeout_at};
use zenoh::handlers::FifoChannelHandler;
use zenoh::liveliness::LivelinessToken;
use zenoh::sample::{Sample, SampleKind};

use crate::Error;
use crate::keys;
use crate::session::{Session, network};

/// Kinds of which one is enough for a system, whatever its name.
const ALONE: [&str; 1] = ["recorder"];
/// How long a node that must be alone waits for the one before it to vanish.
const PATIENCE: Duration = Duration::from_secs(5);
/// How many times a node that must be alone tries, since others may come at the same moment.
const MOST_CLAIMS: u32 = 2;
/// How long the other sessions have to say which tokens there are.
const ANSWERED_WITHIN: Duration = Duration::from_secs(2);

/// Number of the next token of this process.
static NEXT_TOKEN: AtomicU64 = AtomicU64::new(0);

/// A node's presence, until it is dropped.
#[derive(Debug)]
pub struct NodeToken {
    key: String,
    _token: LivelinessToken,
    _rivals: zenoh::pubsub::Subscriber<()>,
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
    /// Whether it is a node of the session that watches.
    pub is_own: bool,
}

/// Tells of the nodes that are there and of every change.
#[derive(Debug)]
pub struct NodeWatcher {
    own: String,
    changes: zenoh::pubsub::Subscriber<FifoChannelHandler<Sample>>,
}

impl Session {
    /// Declares that this process is a node. If there is another one of that name, now or later, both
    /// log a warning.
    ///
    /// # Errors
    /// [`Error::Network`] if kind or id cannot be part of a key or the session is closed.
    pub async fn declare_node(&self, kind: &str, id: &str) -> Result<NodeToken, Error> {
        let key = self.token_key(kind, id);
        let rivals = self.warn_of_rivals(&key, kind, id).await?;
        match self.zenoh.liveliness().declare_token(key.clone()).await {
            Ok(token) => Ok(NodeToken {
                key,
                _token: token,
                _rivals: rivals,
            }),
            Err(error) => Err(network(&format!("{key}: no token"), error)),
        }
    }

    /// Declares that this process is the only node of that name. It waits some seconds for one that
    /// was killed to vanish.
    ///
    /// # Errors
    /// [`Error::NodeTaken`] if there is another one; as [`declare_node`](Self::declare_node) else.
    pub async fn claim_node(&self, kind: &str, id: &str) -> Result<NodeToken, Error> {
        let taken = || Error::NodeTaken {
            kind: kind.to_owned(),
            id: id.to_owned(),
        };
        for _ in 0..MOST_CLAIMS {
            // Who is not connected yet is not heard of.
            self.settle().await;
            if !self.rivals(kind, id).await?.is_empty() {
                tracing::warn!(
                    "{kind} {id} runs already: waiting {} s for it to end",
                    PATIENCE.as_secs()
                );
                if !self.rivals_vanish(kind, id).await? {
                    return Err(taken());
                }
            }
            let token = self.declare_node(kind, id).await?;
            // Of two that begin at the same moment, one gives way.
            self.settle().await;
            let rivals = self.rivals(kind, id).await?;
            if rivals.iter().all(|rival| *rival >= token.key) {
                return Ok(token);
            }
        }
        Err(taken())
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
            Ok(changes) => Ok(NodeWatcher {
                own: self.own_tokens(),
                changes,
            }),
            Err(error) => Err(network("nodes cannot be watched", error)),
        }
    }

    /// What the last part of this session's tokens begins with.
    fn own_tokens(&self) -> String {
        format!("{}-", self.zenoh.zid())
    }

    fn token_key(&self, kind: &str, id: &str) -> String {
        let number = NEXT_TOKEN.fetch_add(1, Ordering::Relaxed);
        format!("{}/{}{number}", keys::node(kind, id), self.own_tokens())
    }

    /// Keys of the tokens that others hold under a name.
    async fn rivals(&self, kind: &str, id: &str) -> Result<BTreeSet<String>, Error> {
        let tokens = keys::node_tokens(kind, id);
        let replies = self.zenoh.liveliness().get(tokens.clone());
        let replies = replies.timeout(ANSWERED_WITHIN).await;
        let replies = replies.map_err(|error| network(&format!("{tokens}: no query"), error))?;
        let mut found = BTreeSet::new();
        while let Ok(reply) = replies.recv_async().await {
            if let Ok(sample) = reply.result() {
                found.insert(sample.key_expr().to_string());
            }
        }
        Ok(found)
    }

    /// Waits until no token is left under a name; whether that came about in time.
    async fn rivals_vanish(&self, kind: &str, id: &str) -> Result<bool, Error> {
        let end = Instant::now() + PATIENCE;
        loop {
            let tokens = keys::node_tokens(kind, id);
            let changes = self.zenoh.liveliness().declare_subscriber(tokens.clone());
            let changes = changes.await;
            let changes =
                changes.map_err(|error| network(&format!("{tokens}: not watched"), error))?;
            if self.rivals(kind, id).await?.is_empty() {
                return Ok(true);
            }
            if timeout_at(end, changes.recv_async()).await.is_err() {
                return Ok(false);
            }
        }
    }

    async fn warn_of_rivals(
        &self,
        own: &str,
        kind: &str,
        id: &str,
    ) -> Result<zenoh::pubsub::Subscriber<()>, Error> {
        let (alone, watched) = if ALONE.contains(&kind) {
            (true, keys::node_tokens(kind, "*"))
        } else {
            (false, keys::node_tokens(kind, id))
        };
        let (own, kind, id) = (own.to_owned(), kind.to_owned(), id.to_owned());
        let declared = self
            .zenoh
            .liveliness()
            .declare_subscriber(watched.clone())
            .history(true)
            .callback(move |sample| {
                if sample.kind() != SampleKind::Put || sample.key_expr().as_str() == own {
                    return;
                }
                if alone {
                    tracing::warn!("a second {kind} runs: both keep the same messages");
                } else {
                    tracing::warn!("a second {kind} {id} runs: stop it, or give it another name");
                }
            })
            .await;
        declared.map_err(|error| network(&format!("{watched}: not watched"), error))
    }
}

impl NodeWatcher {
    /// The next change, or `None` when the session is closed. It may be cancelled without loss.
    pub async fn recv(&mut self) -> Option<NodeChange> {
        loop {
            let sample = self.changes.recv_async().await.ok()?;
            let parts: Vec<&str> = sample.key_expr().split('/').collect();
            if let ["swath", "node", kind, id, token] = parts[..] {
                return Some(NodeChange {
                    kind: kind.to_owned(),
                    id: id.to_owned(),
                    is_alive: sample.kind() == SampleKind::Put,
                    is_own: token.starts_with(&self.own),
                });
            }
        }
    }
}
