//! From what a user asks for to a configuration of zenoh.
//!
//! A value of the user's own file is kept. Where the file is silent, a session gets what swath needs:
//! it opens nothing that nobody named, it relays where it is on a network, and it stamps messages. A
//! value that equals zenoh's own default counts as silence.

use zenoh::Config;
use zenoh::config::EndPoint;

use super::{SessionConfig, network};
use crate::Error;

/// Batches of 64 KiB that wait to be sent to one peer, by priority. Zenoh's own two each are full
/// after two messages, and what may be dropped then is while training keeps every core busy.
const QUEUES: &str = "{ control: 2, real_time: 4, interactive_high: 8, interactive_low: 2, \
                      data_high: 4, data: 4, data_low: 8, background: 2 }";
/// How long a message that may be dropped waits for room, microseconds.
const WAIT_BEFORE_DROP_US: &str = "5000";
/// Time between two attempts to connect to an endpoint of a network.
const RETRY: &str = "{ period_init_ms: 500, period_max_ms: 2000, period_increase_factor: 1.5 }";

/// Where a session meets others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    /// At a range of ports on 127.0.0.1: nobody said anything else.
    Loopback,
    /// At endpoints that the user named, or by what the user's file says.
    Network,
}

/// A configuration of zenoh, where it makes the session meet others, and under which namespace.
#[derive(Debug)]
pub(super) struct Settings {
    pub(super) zenoh: Config,
    pub(super) meeting: Meeting,
    pub(super) namespace: Option<String>,
}

impl Settings {
    pub(super) fn new(config: &SessionConfig) -> Result<Self, Error> {
        let mut zenoh = own_file(config)?.unwrap_or_default();
        if !config.listen.is_empty() || !config.connect.is_empty() {
            for endpoint in config.listen.iter().chain(&config.connect) {
                check_endpoint(endpoint)?;
            }
            set(&mut zenoh, "listen/endpoints", &json(&config.listen))?;
            set(&mut zenoh, "connect/endpoints", &json(&config.connect))?;
        }
        let meeting = meeting_of(&zenoh, config);
        fill_silence(&mut zenoh, meeting)?;
        let namespace = namespace_of(&zenoh, meeting, config)?;
        if let Some(namespace) = &namespace {
            set(&mut zenoh, "namespace", &json(namespace))?;
        }
        Ok(Self {
            zenoh,
            meeting,
            namespace,
        })
    }

    /// Endpoints that the session is to listen on, as they were given.
    pub(super) fn listen(&self) -> Vec<String> {
        self.endpoints("listen/endpoints")
    }

    /// Endpoints that the session is to connect to, as they were given.
    pub(super) fn connect(&self) -> Vec<String> {
        self.endpoints("connect/endpoints")
    }

    fn endpoints(&self, key: &str) -> Vec<String> {
        let text = self.zenoh.get_json(key).unwrap_or_default();
        let value = serde_json::from_str(&text).unwrap_or_default();
        let mut found = Vec::new();
        collect_endpoints(&value, &mut found);
        found
    }
}

/// Endpoints are a list, or a list for each mode, and an element may be a group of locators.
fn collect_endpoints(value: &serde_json::Value, found: &mut Vec<String>) {
    match value {
        serde_json::Value::String(endpoint) if endpoint.contains('/') => {
            found.push(endpoint.clone());
        }
        serde_json::Value::Array(values) => {
            for value in values {
                collect_endpoints(value, found);
            }
        }
        serde_json::Value::Object(fields) => {
            for value in fields.values() {
                collect_endpoints(value, found);
            }
        }
        _ => {}
    }
}

/// The user's own configuration, if there is one.
fn own_file(config: &SessionConfig) -> Result<Option<Config>, Error> {
    let named = std::env::var_os(Config::DEFAULT_CONFIG_PATH_ENV);
    let (path, what) = match (&config.file, named) {
        (Some(path), _) => (path.clone(), "zenoh configuration"),
        (None, Some(path)) => (path.into(), "configuration named by ZENOH_CONFIG"),
        (None, None) => return Ok(None),
    };
    // Zenoh's own word for a file that cannot be opened names it once more.
    std::fs::metadata(&path).map_err(|source| Error::Io {
        path: path.clone(),
        source,
    })?;
    match Config::from_file(&path) {
        Ok(loaded) => Ok(Some(loaded)),
        Err(error) => Err(network(&format!("{what} {}", path.display()), error)),
    }
}

/// Whether the file that a configuration came from says nothing about a key.
fn is_silent(config: &Config, key: &str) -> bool {
    let said = config.get_json(key).ok();
    said == Config::default().get_json(key).ok()
}

fn is(config: &Config, key: &str, value: &str) -> bool {
    config.get_json(key).is_ok_and(|said| said == value)
}

fn meeting_of(zenoh: &Config, config: &SessionConfig) -> Meeting {
    let has_endpoints = !config.listen.is_empty() || !config.connect.is_empty();
    let says_where = ["listen/endpoints", "connect/endpoints"]
        .iter()
        .any(|key| !is_silent(zenoh, key));
    let scouts = is(zenoh, "scouting/multicast/enabled", "true");
    let other_mode = ["\"router\"", "\"client\""]
        .iter()
        .any(|mode| is(zenoh, "mode", mode));
    if has_endpoints || says_where || scouts || other_mode {
        Meeting::Network
    } else {
        Meeting::Loopback
    }
}

/// Sets what swath needs where nobody said anything.
fn fill_silence(zenoh: &mut Config, meeting: Meeting) -> Result<(), Error> {
    let scouts = is(zenoh, "scouting/multicast/enabled", "true");
    // Peers pass nothing on from one to another. A router does, and it can be connected to any
    // number of others in any shape: what is sent takes one way through it, also around a circle.
    let mode = match meeting {
        Meeting::Network if !scouts => "\"router\"",
        _ => "\"peer\"",
    };
    for (key, value) in [
        ("mode", mode),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", "[]"),
        // The recorder takes the time at which a message was sent from its timestamp.
        ("timestamping/enabled", "true"),
        ("transport/link/tx/queue/size", QUEUES),
        (
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop",
            WAIT_BEFORE_DROP_US,
        ),
        ("connect/retry", RETRY),
    ] {
        if is_silent(zenoh, key) {
            set(zenoh, key, value)?;
        }
    }
    // Who scouts needs what others tell of their neighbours. All others are connected as they were
    // told to be, and hearsay would add connections that nobody asked for.
    if !scouts && is_silent(zenoh, "scouting/gossip/enabled") {
        set(zenoh, "scouting/gossip/enabled", "false")?;
    }
    Ok(())
}

/// The namespace: the one asked for, or that of the file, or on loopback the user's own.
fn namespace_of(
    zenoh: &Config,
    meeting: Meeting,
    config: &SessionConfig,
) -> Result<Option<String>, Error> {
    match &config.namespace {
        Some(name) if name.is_empty() => return Ok(None),
        Some(name) => return check_namespace(name).map(|()| Some(name.clone())),
        None => {}
    }
    let of_file = zenoh.get_json("namespace").unwrap_or_default();
    if let Ok(Some(name)) = serde_json::from_str::<Option<String>>(&of_file) {
        return Ok(Some(name));
    }
    Ok((meeting == Meeting::Loopback).then(default_namespace))
}

/// The namespace of sessions that meet on loopback when nobody names one: the user's own, so that
/// two users of a machine do not drive each other's vehicles.
pub fn default_namespace() -> String {
    format!("user-{}", rustix::process::getuid().as_raw())
}

fn check_endpoint(endpoint: &str) -> Result<(), Error> {
    if endpoint.parse::<EndPoint>().is_ok() {
        return Ok(());
    }
    Err(Error::BadSetting {
        name: "endpoint",
        value: format!("{endpoint:?}"),
        expected: "a protocol and an address, as in tcp/192.168.0.1:7447",
    })
}

fn check_namespace(name: &str) -> Result<(), Error> {
    let is_bad = name.contains(['*', '$', '?', '#']) || name.split('/').any(str::is_empty);
    if is_bad {
        return Err(Error::BadSetting {
            name: "namespace",
            value: format!("{name:?}"),
            expected: "a name without * $ ? #, or several with a slash between every two",
        });
    }
    Ok(())
}

pub(super) fn set(config: &mut Config, key: &str, value: &str) -> Result<(), Error> {
    config
        .insert_json5(key, value)
        .map_err(|error| network(&format!("{key} = {value}"), error))
}

pub(super) fn json<T: serde::Serialize + ?Sized>(value: &T) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(text: &str, config: SessionConfig) -> Settings {
        let dir = tempfile::TempDir::new().unwrap();
        let file = dir.path().join("zenoh.json5");
        std::fs::write(&file, text).unwrap();
        Settings::new(&SessionConfig {
            file: Some(file),
            ..config
        })
        .unwrap()
    }

    fn said(settings: &Settings, key: &str) -> String {
        settings.zenoh.get_json(key).unwrap()
    }

    #[test]
    fn endpoints_make_a_session_that_relays_and_has_no_namespace() {
        for config in [
            SessionConfig {
                listen: vec!["tcp/127.0.0.1:0".to_owned()],
                ..SessionConfig::default()
            },
            SessionConfig {
                connect: vec!["tcp/host:7447".to_owned()],
                ..SessionConfig::default()
            },
        ] {
            let settings = Settings::new(&config).unwrap();
            assert_eq!(said(&settings, "mode"), "\"router\"");
            assert_eq!(said(&settings, "scouting/multicast/enabled"), "false");
            assert_eq!(settings.connect(), config.connect);
            assert_eq!(settings.namespace, None);
        }
    }

    #[test]
    fn without_endpoints_a_session_is_a_peer_in_the_users_namespace() {
        let settings = Settings::new(&SessionConfig::default()).unwrap();
        assert_eq!(settings.meeting, Meeting::Loopback);
        assert_eq!(said(&settings, "mode"), "\"peer\"");
        assert_eq!(settings.namespace, Some(default_namespace()));
        for (given, expected) in [("", None), ("a/b", Some("a/b".to_owned()))] {
            let config = SessionConfig {
                namespace: Some(given.to_owned()),
                ..SessionConfig::default()
            };
            assert_eq!(Settings::new(&config).unwrap().namespace, expected);
        }
    }

    #[test]
    fn a_file_keeps_what_it_says_and_gets_the_rest() {
        let file = r#"{
            mode: "client",
            connect: { endpoints: ["tcp/host:1"] },
            timestamping: { enabled: false },
            transport: { link: { tx: { queue: { size: { data: 3 } } } } },
            namespace: "of/file",
        }"#;
        let kept = settings(file, SessionConfig::default());
        assert_eq!(said(&kept, "mode"), "\"client\"");
        assert_eq!(said(&kept, "timestamping/enabled"), "false");
        assert_eq!(said(&kept, "transport/link/tx/queue/size/data"), "3");
        assert_eq!(said(&kept, "scouting/multicast/enabled"), "false");
        assert_eq!(kept.namespace.as_deref(), Some("of/file"));
        assert_eq!(kept.connect(), ["tcp/host:1"]);

        let given = SessionConfig {
            connect: vec!["tcp/other:2".to_owned()],
            namespace: Some("given".to_owned()),
            ..SessionConfig::default()
        };
        let overridden = settings(file, given);
        assert_eq!(said(&overridden, "mode"), "\"client\"");
        assert_eq!(overridden.connect(), ["tcp/other:2"]);
        assert_eq!(overridden.namespace.as_deref(), Some("given"));

        // A file that says nothing of where to meet leaves a session on loopback.
        let quiet = settings(
            "{ queries_default_timeout: 5000 }",
            SessionConfig::default(),
        );
        assert_eq!(quiet.meeting, Meeting::Loopback);
        assert_eq!(quiet.namespace, Some(default_namespace()));

        // One that scouts gets peers, as zenoh has them.
        let scouting = r"{ scouting: { multicast: { enabled: true } } }";
        let scouting = settings(scouting, SessionConfig::default());
        assert_eq!(scouting.meeting, Meeting::Network);
        assert_eq!(said(&scouting, "mode"), "\"peer\"");
    }

    #[test]
    fn a_namespace_with_wildcards_or_holes_is_refused() {
        for name in ["a*", "/a", "a/", "a//b", "a?b", "$*"] {
            let config = SessionConfig {
                namespace: Some(name.to_owned()),
                ..SessionConfig::default()
            };
            let error = Settings::new(&config).unwrap_err().to_string();
            assert!(error.contains("namespace is"), "{error}");
        }
    }
}
