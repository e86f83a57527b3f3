//! Which of the endpoints that a session is to connect to it is connected to.

use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

use tokio::task::spawn_blocking;
use tokio::time::{Instant, sleep};

use super::Session;
use super::loopback::is_deserted;

/// Longest time that a session takes to be connected to whoever is there.
const SETTLED_WITHIN: Duration = Duration::from_secs(3);
/// Time between two looks.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Time in which sessions that are connected tell one another of their nodes.
const TOLD_WITHIN: Duration = Duration::from_millis(300);

impl Session {
    /// Endpoints that the session was told to connect to and is not connected to now, as they were
    /// given.
    ///
    /// Names of hosts are looked up anew each time. An endpoint without a host and port counts as
    /// connected as soon as anything is.
    pub async fn unconnected(&self) -> Vec<String> {
        if self.connect.is_empty() {
            return Vec::new();
        }
        let links = self.zenoh.info().links().await;
        let reached: Vec<String> = links.map(|link| link.dst().to_string()).collect();
        let wanted = self.connect.to_vec();
        // Looking up a name may take seconds.
        let left = spawn_blocking(move || {
            let mut left = wanted;
            left.retain(|endpoint| !is_reached(endpoint, &reached));
            left
        });
        left.await.unwrap_or_default()
    }

    /// Waits until the session is connected wherever it can be, and knows who is there; a few seconds
    /// at most.
    pub(crate) async fn settle(&self) {
        let end = Instant::now() + SETTLED_WITHIN;
        // On loopback those above connect to this session, and it cannot tell which of them have. So
        // it counts; and it looks at the ports once, since looking takes them for a moment.
        let neighbours = self.neighbours.iter();
        let taken = neighbours.filter(|endpoint| !is_deserted(endpoint)).count();
        while Instant::now() < end {
            if self.peers().await.len() >= taken && self.unconnected().await.is_empty() {
                break;
            }
            sleep(LOOK_EVERY).await;
        }
        sleep(TOLD_WITHIN).await;
    }
}

/// A transport protocol and an address: `tcp`, `10.0.0.2:7447`.
fn parts(endpoint: &str) -> Option<(&str, &str)> {
    let bare = endpoint.split(['?', '#']).next()?;
    bare.split_once('/')
}

fn is_reached(endpoint: &str, reached: &[String]) -> bool {
    let Some((protocol, address)) = parts(endpoint) else {
        return !reached.is_empty();
    };
    let same = |other: &String| parts(other) == Some((protocol, address));
    if reached.iter().any(same) {
        return true;
    }
    if !address.contains(':') {
        return !reached.is_empty();
    }
    let Ok(addresses) = address.to_socket_addrs() else {
        return false;
    };
    let addresses: Vec<SocketAddr> = addresses.collect();
    reached.iter().any(|other| {
        let Some((other_protocol, other)) = parts(other) else {
            return false;
        };
        let other = other.parse::<SocketAddr>();
        other_protocol == protocol && other.is_ok_and(|other| addresses.contains(&other))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_is_reached_by_any_address_of_its_host() {
        let reached = ["tcp/127.0.0.1:7447".to_owned(), "tcp/[::1]:7448".to_owned()];
        for (endpoint, expected) in [
            ("tcp/127.0.0.1:7447", true),
            ("tcp/localhost:7447", true),
            ("tcp/localhost:7447#iface=lo", true),
            ("tcp/127.0.0.1:7449", false),
            ("tls/127.0.0.1:7447", false),
            ("tcp/no-such-host.invalid:7447", false),
            ("unixsock-stream/a.sock", true),
        ] {
            assert_eq!(is_reached(endpoint, &reached), expected, "{endpoint}");
        }
        assert!(!is_reached("unixsock-stream/a.sock", &[]));
    }
}
