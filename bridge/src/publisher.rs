//! Publishing messages of one type on one key, carried as the topic says.

use std::marker::PhantomData;
use std::time::Duration;

use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::pubsub::PublisherBuilder;
use zenoh::qos::{CongestionControl, Priority};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

use crate::Error;
use crate::cdr;
use crate::keys::{Qos, Topic};
use crate::msg::Message;
use crate::session::{Session, network};

/// How often a publisher of weights or references tells what it sent last, so that a subscriber
/// that lost it asks again.
const HEARTBEAT: Duration = Duration::from_millis(500);

/// A publisher of messages of one type on one key.
///
/// A message that was put has not necessarily arrived, whatever its quality of service.
#[derive(Debug)]
pub struct Publisher<M> {
    raw: RawPublisher,
    message: PhantomData<fn(M)>,
}

impl Session {
    /// Declares a publisher.
    ///
    /// # Errors
    /// [`Error::BadKey`] for a key with wildcards, [`Error::Network`] if the session is closed.
    pub async fn publisher<M: Message>(&self, topic: &Topic<M>) -> Result<Publisher<M>, Error> {
        Ok(Publisher {
            raw: self.raw_publisher(topic.key(), topic.qos()).await?,
            message: PhantomData,
        })
    }

    /// Declares a publisher of messages that are encoded already.
    ///
    /// # Errors
    /// [`Error::BadKey`] for a key with wildcards, [`Error::Network`] if the session is closed.
    pub async fn raw_publisher(&self, key: &str, qos: Qos) -> Result<RawPublisher, Error> {
        check_key(key)?;
        let declared = self.zenoh.declare_publisher(key.to_owned());
        let builder = as_carried(declared, qos).encoding(Encoding::APPLICATION_CDR);
        let declared = match qos {
            Qos::Durable | Qos::Latched | Qos::Kept => builder
                .cache(CacheConfig::default().max_samples(1))
                .sample_miss_detection(MissDetectionConfig::default().heartbeat(HEARTBEAT))
                .publisher_detection()
                .await
                .map(Inner::Advanced),
            _ => builder.await.map(Inner::Plain),
        };
        match declared {
            Ok(inner) => Ok(RawPublisher {
                key: key.to_owned(),
                inner,
            }),
            Err(error) => Err(network(&format!("{key}: no publisher"), error)),
        }
    }
}

/// Sets how far a message pushes aside others, and what happens when the network is behind.
fn as_carried<'a, 'b>(builder: PublisherBuilder<'a, 'b>, qos: Qos) -> PublisherBuilder<'a, 'b> {
    let (congestion, priority, express) = match qos {
        Qos::Block => (CongestionControl::Block, Priority::Data, false),
        Qos::Durable | Qos::Latched => (CongestionControl::Block, Priority::DataHigh, false),
        Qos::Kept => (CongestionControl::Drop, Priority::DataHigh, false),
        Qos::Newest => (CongestionControl::Drop, Priority::RealTime, true),
        // Not express: a plan and its path go out together rather than one of them not at all.
        Qos::Interactive => (CongestionControl::Drop, Priority::InteractiveHigh, false),
        Qos::Lossy => (CongestionControl::Drop, Priority::DataLow, false),
    };
    builder
        .congestion_control(congestion)
        .priority(priority)
        .express(express)
}

/// Checks that a key names one topic.
fn check_key(key: &str) -> Result<(), Error> {
    let bad = |what| {
        Err(Error::BadKey {
            key: key.to_owned(),
            what,
        })
    };
    if key.contains(['*', '$', '?', '#']) {
        return bad("expected one without * $ ? #");
    }
    if key.split('/').any(str::is_empty) {
        return bad("expected a name between every two slashes");
    }
    Ok(())
}

impl<M: Message> Publisher<M> {
    /// Sends a message.
    ///
    /// # Errors
    /// [`Error::Encode`] if the message has no form in CDR, [`Error::Network`] if the session is
    /// closed.
    pub async fn put(&self, message: &M) -> Result<(), Error> {
        let payload = cdr::to_vec(message).map_err(|source| Error::Encode {
            topic: self.raw.key.clone(),
            type_name: M::TYPE_NAME,
            source,
        })?;
        self.raw.put(payload).await
    }

    /// The key.
    pub fn key(&self) -> &str {
        &self.raw.key
    }

    /// Whether anybody listens.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn has_subscribers(&self) -> Result<bool, Error> {
        self.raw.has_subscribers().await
    }

    /// Waits until somebody listens.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn wait_for_subscribers(&self) -> Result<(), Error> {
        self.raw.wait_for_subscribers().await
    }
}

/// A publisher of messages that are encoded already.
#[derive(Debug)]
pub struct RawPublisher {
    key: String,
    inner: Inner,
}

#[derive(Debug)]
enum Inner {
    Plain(zenoh::pubsub::Publisher<'static>),
    Advanced(AdvancedPublisher<'static>),
}

impl RawPublisher {
    /// Sends a message in CDR.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn put(&self, payload: Vec<u8>) -> Result<(), Error> {
        let sent = match &self.inner {
            Inner::Plain(publisher) => publisher.put(payload).await,
            Inner::Advanced(publisher) => publisher.put(payload).await,
        };
        sent.map_err(|error| network(&format!("{}: not sent", self.key), error))
    }

    /// Whether anybody listens.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn has_subscribers(&self) -> Result<bool, Error> {
        let status = match &self.inner {
            Inner::Plain(publisher) => publisher.matching_status().await,
            Inner::Advanced(publisher) => publisher.matching_status().await,
        };
        match status {
            Ok(status) => Ok(status.matching()),
            Err(error) => Err(network(&format!("{}: no status", self.key), error)),
        }
    }

    /// Waits until somebody listens.
    ///
    /// # Errors
    /// [`Error::Network`] if the session is closed.
    pub async fn wait_for_subscribers(&self) -> Result<(), Error> {
        let listener = match &self.inner {
            Inner::Plain(publisher) => publisher.matching_listener().wait(),
            Inner::Advanced(publisher) => publisher.matching_listener().wait(),
        };
        let closed = |error| network(&format!("{}: no status", self.key), error);
        let listener = listener.map_err(closed)?;
        // The listener is there first, so that no change between the two is missed.
        while !self.has_subscribers().await? {
            listener.recv_async().await.map_err(closed)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_with_wildcards_or_gaps_are_refused() {
        for key in [
            "swath/sample/*",
            "swath/**",
            "swath//g",
            "",
            "a/b?c",
            "a/b#c",
            "a/$*",
        ] {
            assert!(check_key(key).is_err(), "{key}");
        }
        assert!(check_key("swath/sample/g0").is_ok());
    }
}
