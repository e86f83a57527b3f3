//! Opening zenoh sessions: what a process listens on, whom it finds, and how it closes.
//!
//! Without configuration a session stays on the loopback interface, finds the other sessions of this
//! machine through a small range of fixed ports (see [`loopback`]) and has the namespace of its user.
//! A network is opened only by explicit endpoints, a configuration file, or `ZENOH_CONFIG`. On a
//! network sessions relay: whoever is connected, directly or by way of others, hears all others.

mod loopback;
mod reach;
mod settings;
mod words;

use std::path::PathBuf;
use std::sync::Arc;

use crate::Error;
pub use loopback::Ports;
pub use settings::default_namespace;
use settings::{Meeting, Settings};
pub use words::plain_words;
use words::system_cause;

/// How many times a port is chosen anew because another process was quicker.
const MOST_PORT_ATTEMPTS: u32 = 8;

/// How a session is opened.
///
/// Later fields override earlier ones: `file`, or else what `ZENOH_CONFIG` names, or else loopback.
/// What a file does not say is chosen as without one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionConfig {
    /// A zenoh configuration file in JSON5.
    pub file: Option<PathBuf>,
    /// Endpoints to listen on, for example `tcp/192.168.0.1:7447`.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// Prefix of every key; sessions of different namespaces do not hear each other. Empty for none.
    /// By default it is that of the file, and [`default_namespace`] on loopback.
    pub namespace: Option<String>,
    /// Where sessions of this machine meet when no endpoint is given.
    pub ports: Ports,
}

/// A zenoh session. Clones share it; it closes when the last one is dropped.
#[derive(Debug, Clone)]
pub struct Session {
    pub(crate) zenoh: zenoh::Session,
    namespace: Option<String>,
    /// Endpoints that it was told to connect to; none on loopback.
    connect: Arc<[String]>,
    /// Endpoints of loopback that others may listen on.
    neighbours: Arc<[String]>,
}

impl Session {
    /// Opens a session.
    ///
    /// # Errors
    /// [`Error::Network`] if the configuration is not one of zenoh's, or an endpoint cannot be opened,
    /// [`Error::Io`] if there is no such file, [`Error::BadSetting`] for a namespace that is none.
    pub async fn open(config: &SessionConfig) -> Result<Self, Error> {
        let settings = Settings::new(config)?;
        if settings.meeting == Meeting::Network {
            let (listen, connect) = (settings.listen(), settings.connect());
            let opened = zenoh::open(settings.zenoh).await;
            let zenoh = opened.map_err(|error| not_opened(&listen, &connect, &error))?;
            return Ok(Self {
                zenoh,
                namespace: settings.namespace,
                connect: connect.into(),
                neighbours: Arc::default(),
            });
        }
        let mut attempt = 0;
        loop {
            let place = loopback::choose(config.ports)?;
            let mut zenoh_config = settings.zenoh.clone();
            place.apply(&mut zenoh_config)?;
            attempt += 1;
            match zenoh::open(zenoh_config).await {
                Ok(zenoh) => {
                    return Ok(Self {
                        zenoh,
                        namespace: settings.namespace,
                        connect: Arc::default(),
                        neighbours: place.others().into(),
                    });
                }
                // Another process was quicker, or looked at the port at the wrong moment.
                Err(_) if attempt < MOST_PORT_ATTEMPTS => {}
                Err(error) => return Err(network("no session could be opened", error)),
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

    /// Prefix of all its keys, if there is one.
    pub fn namespace(&self) -> Option<&str> {
        self.namespace.as_deref()
    }

    /// Endpoints that it was told to connect to; none on loopback.
    pub fn connects_to(&self) -> &[String] {
        &self.connect
    }

    /// Endpoints that this session can be reached at.
    pub async fn endpoints(&self) -> Vec<String> {
        let locators = self.zenoh.info().locators().await;
        locators.iter().map(ToString::to_string).collect()
    }
}

/// Why a session on a network could not be opened, with the endpoint that is to blame.
fn not_opened(listen: &[String], connect: &[String], error: &zenoh::Error) -> Error {
    let text = plain_words(&error.to_string());
    let is_named = |endpoint: &&String| {
        let address = endpoint.split_once('/').map_or("", |(_, address)| address);
        !address.is_empty() && text.contains(address)
    };
    let named: Vec<&str> = listen.iter().filter(is_named).map(String::as_str).collect();
    let what = if !named.is_empty() {
        format!("cannot listen on {}", named.join(", "))
    } else if !listen.is_empty() {
        format!("cannot listen on {}", listen.join(", "))
    } else if !connect.is_empty() {
        format!("cannot connect to {}", connect.join(", "))
    } else {
        "no session could be opened".to_owned()
    };
    Error::Network {
        what,
        source: system_cause(&text).into(),
    }
}

/// Zenoh's errors are boxed without a type; what was being done is the evidence that we have.
#[expect(
    clippy::needless_pass_by_value,
    reason = "errors are handed over, and what is kept of them is their text"
)]
pub(crate) fn network(what: &str, source: zenoh::Error) -> Error {
    Error::Network {
        what: what.to_owned(),
        source: plain_words(&source.to_string()).into(),
    }
}
