//! What a node says of its place among others: where it listens, whom it joined, who came and went, and
//! which endpoint it cannot reach.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use swath_bridge::{NodeChange, Session};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout_at};

use crate::output::shortened;
use crate::reporter::MOST_CHARS;

/// Time in which those that are there already are found; they are said together.
const FOUND_WITHIN: Duration = Duration::from_secs(1);
/// Time without a connection after which that is said, and again after each longer time.
const SAID_AFTER: Duration = Duration::from_secs(3);
const SAID_EVERY: Duration = Duration::from_secs(30);
/// Time between two looks at the connections.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Nodes that serve others and that nobody started by itself.
const SERVANTS: [&str; 1] = ["store"];

/// Says all this until it is dropped.
pub(super) async fn tell(session: Session) {
    say_where(&session).await;
    tokio::join!(tell_nodes(&session), tell_connections(&session));
}

fn say(words: &str) {
    tracing::info!("{}", shortened(words, MOST_CHARS));
}

async fn say_where(session: &Session) {
    let endpoints = session.endpoints().await;
    let connects = session.connects_to();
    match (endpoints.is_empty(), connects.is_empty()) {
        (false, _) => say(&listed("listens on", &endpoints)),
        (true, false) => say(&listed("does not listen, connects to", connects)),
        (true, true) => say("does not listen"),
    }
}

/// As many words as there is room for, and how many were left out.
fn listed(what: &str, words: &[String]) -> String {
    let mut line = what.to_owned();
    for (number, word) in words.iter().enumerate() {
        let left = words.len() - number;
        let sign = if number == 0 { " " } else { ", " };
        let room = MOST_CHARS.saturating_sub(if left > 1 { " and 999 more".len() } else { 0 });
        if number > 0 && line.chars().count() + sign.len() + word.chars().count() > room {
            return format!("{line} and {left} more");
        }
        line += sign;
        line += word;
    }
    line
}

async fn tell_nodes(session: &Session) {
    let mut nodes = match session.watch_nodes().await {
        Ok(nodes) => nodes,
        Err(error) => return tracing::warn!("{error}"),
    };
    let mut known = Known::default();
    let end = Instant::now() + FOUND_WITHIN;
    while let Ok(change) = timeout_at(end, nodes.recv()).await {
        let Some(change) = change else { return };
        known.take(&change);
    }
    say(&known.greeting(session.namespace()));
    while let Some(change) = nodes.recv().await {
        if let Some(words) = known.take(&change) {
            say(&words);
        }
    }
}

/// Other nodes, and how many there are of each name.
#[derive(Debug, Default)]
struct Known {
    nodes: BTreeMap<(String, String), u32>,
}

impl Known {
    /// Takes a change in; the words for it, if anybody is to know.
    fn take(&mut self, change: &NodeChange) -> Option<String> {
        if change.is_own || SERVANTS.contains(&change.kind.as_str()) {
            return None;
        }
        let name = (change.kind.clone(), change.id.clone());
        let count = self.nodes.entry(name.clone()).or_default();
        let sign = if change.is_alive {
            *count += 1;
            "came"
        } else {
            *count = count.saturating_sub(1);
            "went"
        };
        if *count == 0 {
            self.nodes.remove(&name);
        }
        Some(format!("{} {} {sign}", change.kind, change.id))
    }

    /// Who is there at the beginning.
    fn greeting(&self, namespace: Option<&str>) -> String {
        let place = namespace.map_or_else(String::new, |name| format!(" in namespace {name}"));
        let names = self.nodes.iter().flat_map(|((kind, id), count)| {
            std::iter::repeat_n(format!("{kind} {id}"), usize::try_from(*count).unwrap_or(0))
        });
        let names: Vec<String> = names.collect();
        match names.len() {
            0 => format!("no other node yet{place}"),
            1 => listed(&format!("joined 1 node{place}:"), &names),
            count => listed(&format!("joined {count} nodes{place}:"), &names),
        }
    }
}

/// How an endpoint is doing.
#[derive(Debug, Clone, Copy)]
enum Connection {
    /// Not there for so long; and when that was said last.
    Missing {
        since: Instant,
        said: Option<Instant>,
    },
    There,
}

async fn tell_connections(session: &Session) {
    let endpoints = session.connects_to();
    let start = Connection::Missing {
        since: Instant::now(),
        said: None,
    };
    let mut connections = vec![start; endpoints.len()];
    let mut looks = interval(LOOK_EVERY);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while !endpoints.is_empty() {
        looks.tick().await;
        let missing: BTreeSet<String> = session.unconnected().await.into_iter().collect();
        let now = Instant::now();
        for (endpoint, connection) in endpoints.iter().zip(&mut connections) {
            *connection = look(*connection, endpoint, missing.contains(endpoint), now);
        }
    }
}

/// Looks at a connection, says what has to be said, and how it is now.
fn look(before: Connection, endpoint: &str, is_missing: bool, now: Instant) -> Connection {
    match (before, is_missing) {
        (Connection::There, false) => Connection::There,
        (Connection::Missing { .. }, false) => {
            say(&format!("connected to {endpoint}"));
            Connection::There
        }
        (Connection::There, true) => Connection::Missing {
            since: now,
            said: None,
        },
        (Connection::Missing { since, said }, true) => {
            let is_due = said.map_or(now - since >= SAID_AFTER, |said| now - said >= SAID_EVERY);
            if is_due {
                let seconds = (now - since).as_secs();
                tracing::warn!("not connected to {endpoint} for {seconds} s");
                tracing::warn!("check the address, that a node listens there, and the firewall");
            }
            let said = if is_due { Some(now) } else { said };
            Connection::Missing { since, said }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(kind: &str, id: &str, is_alive: bool) -> NodeChange {
        NodeChange {
            kind: kind.to_owned(),
            id: id.to_owned(),
            is_alive,
            is_own: false,
        }
    }

    fn own(kind: &str, id: &str) -> NodeChange {
        NodeChange {
            is_own: true,
            ..change(kind, id, true)
        }
    }

    #[test]
    fn the_greeting_names_who_is_there_and_fits_into_a_line() {
        let mut known = Known::default();
        assert_eq!(known.greeting(None), "no other node yet");
        known.take(&own("planner", "own"));
        known.take(&change("store", "a1b2", true));
        known.take(&change("planner", "car-1", true));
        assert_eq!(
            known.greeting(Some("user-7")),
            "joined 1 node in namespace user-7: planner car-1"
        );
        for number in 0..40 {
            known.take(&change("generator", &format!("lab-{number}"), true));
        }
        let greeting = known.greeting(Some("user-7"));
        let begins = "joined 41 nodes in namespace user-7: generator lab-0";
        assert!(greeting.starts_with(begins), "{greeting}");
        assert!(greeting.ends_with(" more"), "{greeting}");
        assert!(greeting.chars().count() <= MOST_CHARS, "{greeting}");
    }

    #[test]
    fn every_change_of_others_has_its_words() {
        let mut known = Known::default();
        let said = |known: &mut Known, is_alive| known.take(&change("generator", "g", is_alive));
        assert_eq!(said(&mut known, true).as_deref(), Some("generator g came"));
        assert_eq!(said(&mut known, true).as_deref(), Some("generator g came"));
        assert_eq!(
            known.greeting(None),
            "joined 2 nodes: generator g, generator g"
        );
        assert_eq!(said(&mut known, false).as_deref(), Some("generator g went"));
        assert_eq!(known.greeting(None), "joined 1 node: generator g");
        assert_eq!(known.take(&change("store", "s", true)), None);
        assert_eq!(known.take(&own("planner", "p")), None);
    }

    #[test]
    fn a_missing_connection_is_said_after_three_seconds_and_every_thirty() {
        let start = Instant::now();
        let mut connection = Connection::Missing {
            since: start,
            said: None,
        };
        let mut said_at = Vec::new();
        for second in 0..70 {
            let now = start + Duration::from_secs(second);
            let before = connection;
            connection = look(before, "tcp/h:1", true, now);
            let Connection::Missing { said, .. } = connection else {
                panic!("it is missing");
            };
            if said == Some(now) {
                said_at.push(second);
            }
        }
        assert_eq!(said_at, [3, 33, 63]);
        let there = look(connection, "tcp/h:1", false, start);
        assert!(matches!(there, Connection::There));
        let lost = look(there, "tcp/h:1", true, start);
        assert!(matches!(lost, Connection::Missing { said: None, .. }));
    }
}
