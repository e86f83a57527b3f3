//! Opening zenoh sessions: what a process listens on, whom it finds, and how it closes.
//!
//! Without configuration a session stays on the loopback interface and finds the other sessions of
//! this machine through a small range of fixed ports (see [`loopback`]); a network is opened only by
//! explicit endpoints, a configuration file, or `ZENOH_CONFIG`.

mod loopback;

use std::path::PathBuf;

use zenoh::Config;

use crate::Error;
pub use loopback::Ports;

/// How many times a port is chosen anew because another process was quicker.
const MOST_PORT_ATTEMPTS: u32 = 8;

/// Batches of 64 KiB that wait to be sent to one peer, by priority. Zenoh's own two each are full
/// after two messages, and what may be dropped then is while training keeps every core busy.
const QUEUES: &str = "{ control: 2, real_time: 4, interactive_high: 8, interactive_low: 2, \
                      data_high: 4, data: 4, data_low: 8, background: 2 }";
/// How long a message that may be dropped waits for room, microseconds.
const WAIT_BEFORE_DROP_US: u32 = 5000;

/// How a session is opened.
///
/// Later fields override earlier ones: `file`, or else what `ZENOH_CONFIG` names, or else loopback.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionConfig {
    /// A zenoh configuration file in JSON5.
    pub file: Option<PathBuf>,
    /// Endpoints to listen on, for example `tcp/192.168.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// Prefix of every key; sessions of different namespaces do not hear each other.
    pub namespace: Option<String>,
    /// Where sessions of this machine meet when no endpoint is given.
    pub ports: Ports,
}

/// A zenoh session. Clones share it; it closes when the last one is dropped.
#[derive(Debug, Clone)]
pub struct Session {
    pub(crate) zenoh: zenoh::Session,
}

impl Session {
    /// Opens a session.
    ///
    /// # Errors
    /// [`Error::Network`] if the configuration is not one of zenoh's, or an endpoint cannot be opened.
    pub async fn open(config: &SessionConfig) -> Result<Self, Error> {
        let has_endpoints = !config.listen.is_empty() || !config.connect.is_empty();
        let base = base_config(config)?;
        if let Some(mut zenoh_config) = base {
            if has_endpoints {
                set_endpoints(&mut zenoh_config, &config.listen, &config.connect)?;
            }
            return open(zenoh_config).await;
        }
        let mut zenoh_config = quiet_config(config)?;
        if has_endpoints {
            set_endpoints(&mut zenoh_config, &config.listen, &config.connect)?;
            return open(zenoh_config).await;
        }
        let mut attempt = 0;
        loop {
            let place = loopback::choose(config.ports)?;
            let mut zenoh_config = zenoh_config.clone();
            place.apply(&mut zenoh_config)?;
            attempt += 1;
            match open(zenoh_config).await {
                Err(_) if attempt < MOST_PORT_ATTEMPTS && !place.is_free() => {}
                opened => return opened,
            }
        }
    }

    /// Closes the session for all its clones.
    ///
    /// # Errors
    /// [`Error::Network`] if zenoh could not say goodbye to its peers.
    pub async fn close(&self) -> Result<(), Error> {
        self.zenoh
            .close()
            .await
            .map_err(|error| network("the session could not be closed", error))
    }

    /// Identifiers of the sessions that this one is connected to.
    pub async fn peers(&self) -> Vec<String> {
        let mut peers: Vec<String> = self
            .zenoh
            .info()
            .peers_zid()
            .await
            .chain(self.zenoh.info().routers_zid().await)
            .map(|zid| zid.to_string())
            .collect();
        peers.sort_unstable();
        peers
    }

    /// Endpoints that this session can be reached at.
    pub async fn endpoints(&self) -> Vec<String> {
        let locators = self.zenoh.info().locators().await;
        locators.iter().map(ToString::to_string).collect()
    }
}

async fn open(config: Config) -> Result<Session, Error> {
    match zenoh::open(config).await {
        Ok(zenoh) => Ok(Session { zenoh }),
        Err(error) => Err(network("no session could be opened", error)),
    }
}

/// What the user's own configuration says, if there is one.
fn base_config(config: &SessionConfig) -> Result<Option<Config>, Error> {
    let loaded = match (
        &config.file,
        std::env::var_os(Config::DEFAULT_CONFIG_PATH_ENV),
    ) {
        (Some(path), _) => Config::from_file(path)
            .map_err(|error| network(&format!("configuration {}", path.display()), error))?,
        (None, Some(_)) => Config::from_env()
            .map_err(|error| network("configuration named by ZENOH_CONFIG", error))?,
        (None, None) => return Ok(None),
    };
    let mut loaded = loaded;
    if let Some(namespace) = &config.namespace {
        set(&mut loaded, "namespace", &json_list(namespace))?;
    }
    Ok(Some(loaded))
}

/// A peer that opens nothing by itself.
fn quiet_config(config: &SessionConfig) -> Result<Config, Error> {
    let mut quiet = Config::default();
    set(&mut quiet, "mode", "\"peer\"")?;
    set(&mut quiet, "scouting/multicast/enabled", "false")?;
    set(&mut quiet, "listen/endpoints", "[]")?;
    // The recorder takes the time at which a message was sent from its timestamp.
    set(&mut quiet, "timestamping/enabled", "true")?;
    set(&mut quiet, "transport/link/tx/queue/size", QUEUES)?;
    set(
        &mut quiet,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
        &WAIT_BEFORE_DROP_US.to_string(),
    )?;
    if let Some(namespace) = &config.namespace {
        set(&mut quiet, "namespace", &json_list(namespace))?;
    }
    Ok(quiet)
}

fn set_endpoints(config: &mut Config, listen: &[String], connect: &[String]) -> Result<(), Error> {
    set(config, "listen/endpoints", &json_list(listen))?;
    set(config, "connect/endpoints", &json_list(connect))
}

fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config
        .insert_json5(key, value)
        .map_err(|error| network(&format!("{key} = {value}"), error))
}

fn json_list<T: serde::Serialize + ?Sized>(value: &T) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// Zenoh's errors are boxed without a type; what was being done is the evidence that we have.
pub(crate) fn network(what: &str, source: zenoh::Error) -> Error {
    Error::Network {
        what: what.to_owned(),
        source,
    }
}
