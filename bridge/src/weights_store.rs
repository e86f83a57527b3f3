//! Keeping the newest weights of every run on disk for planners that come when the trainer is gone.
//!
//! What a publisher caches dies with it. A store listens to all weights, keeps the newest of each run
//! in a file, and answers queries for them. Any process may have one, and several may run: whoever
//! asks takes the newest answer that verifies.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::{JoinHandle, spawn_blocking};
use zenoh::bytes::Encoding;
use zenoh::query::{ConsolidationMode, Query, QueryTarget, Queryable};

use crate::Error;
use crate::atomic_file::{self, Access};
use crate::cdr;
use crate::clock;
use crate::keys;
use crate::liveliness::NodeToken;
use crate::msg::swath::Weights;
use crate::session::{Session, network};
use crate::signature::{self, MOST_WEIGHTS_BYTES, VerifyingKey};
use crate::subscriber::{Received, Subscriber};

/// Most runs that are kept.
const MOST_RUNS: usize = 256;
/// Most bytes of a file: the tensors, and plenty for the other fields.
const MOST_FILE_BYTES: usize = MOST_WEIGHTS_BYTES + 1024 * 1024;
/// Longest name of a run that is kept.
const MOST_NAME_BYTES: usize = 128;
/// Most queries that wait for an answer; who asks beyond gets none.
const MOST_QUERIES: usize = 64;
/// Most messages of weights that wait to be stored.
const MOST_WAITING: usize = 16;
/// How long a query waits for answers.
const PATIENCE: Duration = Duration::from_secs(2);
/// What a store is among nodes. Its token tells subscribers that there is one to ask.
pub(crate) const STORE_KIND: &str = "store";
/// Ending of the files.
const EXTENSION: &str = "weights";

/// What makes weights newer than others of their run: when they were made, then their number.
type Age = (u64, u64);

fn age(weights: &Weights) -> Age {
    (weights.header.stamp.nanos(), weights.version)
}

/// Stores and answers until it is dropped.
#[derive(Debug)]
pub struct WeightsStore {
    _queryable: Queryable<()>,
    _token: NodeToken,
    task: JoinHandle<()>,
}

impl Drop for WeightsStore {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl WeightsStore {
    /// Opens the store in a directory, which is made if need be. Weights that none of the trusted
    /// keys signed are not kept; without any key, all that are intact.
    ///
    /// # Errors
    /// [`Error::Io`] if the directory cannot be read, [`Error::Network`] if the session is closed.
    pub async fn open(
        session: &Session,
        directory: impl Into<PathBuf>,
        trusted: &[VerifyingKey],
    ) -> Result<Self, Error> {
        let directory = directory.into();
        let trusted = trusted.to_vec();
        let opened = spawn_blocking(move || Shelf::open(directory, trusted)).await;
        let shelf = opened.unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic()))?;
        let topic = keys::weights("*");
        let subscriber = session.subscriber(&topic, MOST_WAITING).await?;
        let (sender, queries) = mpsc::channel(MOST_QUERIES);
        let queryable = session
            .zenoh
            .declare_queryable(topic.key().to_owned())
            .callback(move |query| {
                // A query that finds no room is dropped, which tells the asker that there is no more.
                let _ = sender.try_send(query);
            })
            .await
            .map_err(|error| network("stored weights cannot be offered", error))?;
        // Declared last, so that who sees it finds the queryable.
        let token = session
            .declare_node(STORE_KIND, &session.zenoh.zid().to_string())
            .await?;
        Ok(Self {
            _queryable: queryable,
            _token: token,
            task: tokio::spawn(serve(shelf, subscriber, queries)),
        })
    }
}

async fn serve(
    mut shelf: Shelf,
    mut subscriber: Subscriber<Weights>,
    mut queries: mpsc::Receiver<Query>,
) {
    loop {
        tokio::select! {
            received = subscriber.recv() => {
                let Some(received) = received else { return };
                let stored = spawn_blocking(move || {
                    let put = shelf.put(&received.message);
                    (shelf, put)
                });
                let Ok((back, put)) = stored.await else { return };
                shelf = back;
                if let Err(error) = put {
                    tracing::warn!("{}: not stored: {error}", received.key);
                }
            }
            query = queries.recv() => {
                let Some(query) = query else { return };
                answer(&shelf, &query).await;
            }
        }
    }
}

async fn answer(shelf: &Shelf, query: &Query) {
    for run in shelf.newest.keys() {
        let key = keys::weights(run).key().to_owned();
        let Ok(expression) = zenoh::key_expr::KeyExpr::try_from(key.clone()) else {
            continue;
        };
        if !query.key_expr().intersects(&expression) {
            continue;
        }
        let path = shelf.path_of(run);
        let read = spawn_blocking(move || read_bounded(&path)).await;
        let payload = match read {
            Ok(Ok(payload)) => payload,
            Ok(Err(error)) => {
                tracing::warn!("{key}: not answered: {error}");
                continue;
            }
            Err(_) => return,
        };
        let reply = query.reply(expression, payload);
        if let Err(error) = reply.encoding(Encoding::APPLICATION_CDR).await {
            tracing::warn!("{key}: not answered: {error}");
        }
    }
}

/// The directory with the newest weights of each run.
#[derive(Debug)]
struct Shelf {
    directory: PathBuf,
    trusted: Vec<VerifyingKey>,
    newest: BTreeMap<String, Age>,
}

impl Shelf {
    fn open(directory: PathBuf, trusted: Vec<VerifyingKey>) -> Result<Self, Error> {
        let io = |source| Error::Io {
            path: directory.clone(),
            source,
        };
        std::fs::create_dir_all(&directory).map_err(io)?;
        let mut paths = BTreeSet::new();
        for entry in std::fs::read_dir(&directory).map_err(io)? {
            let path = entry.map_err(io)?.path();
            if path
                .extension()
                .is_some_and(|extension| extension == EXTENSION)
            {
                paths.insert(path);
            }
        }
        let mut shelf = Self {
            directory,
            trusted,
            newest: BTreeMap::new(),
        };
        for path in paths {
            match shelf.load(&path) {
                Ok((run, age)) if path == shelf.path_of(&run) => {
                    shelf.newest.insert(run, age);
                }
                Ok((run, _)) => {
                    tracing::warn!("{}: left out: weights of {run:?}", path.display());
                }
                Err(error) => tracing::warn!("left out: {error}"),
            }
        }
        Ok(shelf)
    }

    fn load(&self, path: &Path) -> Result<(String, Age), Error> {
        let payload = read_bounded(path)?;
        let weights: Weights = cdr::from_slice(&payload).map_err(|error| Error::BadFile {
            path: path.to_owned(),
            what: error.to_string(),
        })?;
        signature::verify(&weights, &self.trusted)?;
        let age = age(&weights);
        Ok((weights.run, age))
    }

    fn path_of(&self, run: &str) -> PathBuf {
        self.directory.join(format!("{run}.{EXTENSION}"))
    }

    /// Keeps weights if they are newer than what is kept of their run.
    fn put(&mut self, weights: &Weights) -> Result<(), Error> {
        let age = age(weights);
        let run = &weights.run;
        let bad = |what: String| Error::BadWeights {
            run: run.clone(),
            version: weights.version,
            what,
        };
        match self.newest.get(run) {
            Some(&newest) if newest >= age => return Ok(()),
            None if self.newest.len() >= MOST_RUNS => {
                return Err(bad(format!("{MOST_RUNS} runs are kept already")));
            }
            None if !is_file_name(run) => {
                return Err(bad("a name of letters, digits, - _ . expected".to_owned()));
            }
            Some(_) | None => {}
        }
        signature::verify(weights, &self.trusted)?;
        let payload = cdr::to_vec(weights).map_err(|error| bad(error.to_string()))?;
        atomic_file::write(&self.path_of(run), &payload, Access::Usual)?;
        self.newest.insert(run.clone(), age);
        Ok(())
    }
}

fn is_file_name(run: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    !run.is_empty()
        && run.len() <= MOST_NAME_BYTES
        && !run.starts_with('.')
        && run.chars().all(is_plain)
}

fn read_bounded(path: &Path) -> Result<Vec<u8>, Error> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let most = u64::try_from(MOST_FILE_BYTES).unwrap_or(u64::MAX);
    let mut payload = Vec::new();
    let file = File::open(path).map_err(io)?;
    file.take(most + 1).read_to_end(&mut payload).map_err(io)?;
    if payload.len() > MOST_FILE_BYTES {
        return Err(Error::BadFile {
            path: path.to_owned(),
            what: format!("more than {MOST_FILE_BYTES} bytes"),
        });
    }
    Ok(payload)
}

impl Session {
    /// Asks every store for the weights of a run, or of `*`. The newest come last.
    ///
    /// What does not decode or does not verify is logged and left out.
    ///
    /// # Errors
    /// [`Error::Network`] if the run cannot be part of a key or the session is closed.
    pub async fn stored_weights(
        &self,
        run: &str,
        trusted: &[VerifyingKey],
    ) -> Result<Vec<Received<Weights>>, Error> {
        let key = keys::weights(run).key().to_owned();
        let replies = self
            .zenoh
            .get(key.clone())
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .timeout(PATIENCE)
            .await
            .map_err(|error| network(&format!("{key}: no query"), error))?;
        let mut found: BTreeMap<(Age, String), Received<Weights>> = BTreeMap::new();
        while let Ok(reply) = replies.recv_async().await {
            let Ok(sample) = reply.result() else {
                continue;
            };
            match decode(sample, trusted) {
                Ok(received) => {
                    let place = (age(&received.message), received.message.run.clone());
                    found.insert(place, received);
                    while found.len() > MOST_RUNS {
                        found.pop_first();
                    }
                }
                Err(error) => tracing::warn!("stored weights are not used: {error}"),
            }
        }
        Ok(found.into_values().collect())
    }
}

fn decode(
    sample: &zenoh::sample::Sample,
    trusted: &[VerifyingKey],
) -> Result<Received<Weights>, Error> {
    let key = sample.key_expr().to_string();
    let message = cdr::from_slice(&sample.payload().to_bytes());
    let message: Weights = message.map_err(|source| Error::Decode {
        topic: key.clone(),
        type_name: <Weights as crate::msg::Message>::TYPE_NAME,
        source,
    })?;
    signature::verify(&message, trusted)?;
    Ok(Received {
        key,
        message,
        received_nanos: clock::now_nanos(),
        sent_nanos: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_names_become_files() {
        for name in ["run-1", "A_b.c", "0"] {
            assert!(is_file_name(name), "{name}");
        }
        let long = "a".repeat(MOST_NAME_BYTES + 1);
        for name in ["", ".", "..", ".hidden", "a/b", "a b", "a\0", "ä", &long] {
            assert!(!is_file_name(name), "{name}");
        }
    }
}
