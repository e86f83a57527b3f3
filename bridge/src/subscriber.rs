//! Receiving messages of one type, through a queue that never makes zenoh wait.

use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use zenoh::Wait as _;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::{Sample, SampleKind};
use zenoh_ext::{AdvancedSubscriber, AdvancedSubscriberBuilderExt, HistoryConfig, RecoveryConfig};

use crate::Error;
use crate::cdr;
use crate::clock;
use crate::keys::{self, Qos, Topic};
use crate::msg::Message;
use crate::queue::{Arrived, Inbox, Overflow, Queue};
use crate::session::{Session, network};
use crate::weights_store::STORE_KIND;

/// Of messages that do not decode, the first few and then every so manieth are logged.
const LOGGED_FIRST: u64 = 3;
const LOGGED_EVERY: u64 = 1000;

/// A message and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Received<M> {
    /// The key it was published on.
    pub key: String,
    /// The message.
    pub message: M,
    /// When it arrived, nanoseconds since the Unix epoch by this machine's clock.
    pub received_nanos: u64,
    /// When it was sent by the sender's clock, if the message says.
    pub sent_nanos: Option<u64>,
}

/// What has become of the messages for a subscriber.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages that arrived.
    pub received: u64,
    /// Those that a newer one replaced or that found the queue full.
    pub dropped: u64,
    /// Those that were not what their key promises.
    pub undecodable: u64,
    /// Those that were sent and did not arrive, where the publisher counts.
    pub missed: u64,
}

/// A subscriber to messages of one type.
#[derive(Debug)]
pub struct Subscriber<M> {
    queue: Arc<Queue>,
    _declared: RawSubscriber,
    _stores: Option<zenoh::pubsub::Subscriber<()>>,
    undecodable: AtomicU64,
    message: PhantomData<fn() -> M>,
}

impl Session {
    /// Subscribes to a topic, of which at most `capacity` messages wait to be received.
    ///
    /// Of grids, references and targets no more than the newest of each key waits. Weights also come
    /// from every [`WeightsStore`](crate::WeightsStore), so that none is missed whose publisher is
    /// gone; the same or older ones may then come again.
    ///
    /// # Errors
    /// [`Error::Network`] if the key is none or the session is closed.
    pub async fn subscriber<M: Message>(
        &self,
        topic: &Topic<M>,
        capacity: usize,
    ) -> Result<Subscriber<M>, Error> {
        let queue = Arc::new(Queue::new(capacity, Overflow::of(topic.qos())));
        let inbox: Arc<dyn Inbox> = Arc::<Queue>::clone(&queue);
        let asking = Arc::clone(&inbox);
        let declared = self.raw_subscriber(topic.key(), topic.qos(), inbox).await?;
        let stores = match topic.qos() {
            Qos::Durable => Some(self.watch_stores(topic.key(), asking).await?),
            _ => None,
        };
        Ok(Subscriber {
            queue,
            _declared: declared,
            _stores: stores,
            undecodable: AtomicU64::new(0),
            message: PhantomData,
        })
    }

    /// Asks for what is stored whenever a store comes in sight, those that are there already
    /// included; the answers arrive like messages. Asking once, at the beginning, would miss a store
    /// that this session is not connected to yet.
    async fn watch_stores(
        &self,
        key: &str,
        inbox: Arc<dyn Inbox>,
    ) -> Result<zenoh::pubsub::Subscriber<()>, Error> {
        let (session, asked) = (self.zenoh.clone(), key.to_owned());
        let watched = self
            .zenoh
            .liveliness()
            .declare_subscriber(keys::node_tokens(STORE_KIND, "*"))
            .history(true)
            .callback(move |token| {
                if token.kind() == SampleKind::Put {
                    ask_stores(&session, &asked, &inbox);
                }
            })
            .await;
        watched.map_err(|error| network(&format!("{key}: stores cannot be watched"), error))
    }

    pub(crate) async fn raw_subscriber(
        &self,
        key: &str,
        qos: Qos,
        inbox: Arc<dyn Inbox>,
    ) -> Result<RawSubscriber, Error> {
        let sink = Arc::clone(&inbox);
        let builder = self.zenoh.declare_subscriber(key.to_owned());
        let builder = builder.callback(move |sample| hand_over(&sample, &*sink));
        let declared = match qos {
            Qos::Durable | Qos::Latched | Qos::Kept => {
                let history = HistoryConfig::default()
                    .detect_late_publishers()
                    .max_samples(1);
                let subscriber = builder
                    .history(history)
                    .recovery(RecoveryConfig::default().heartbeat())
                    .subscriber_detection()
                    .await;
                match subscriber {
                    Ok(subscriber) => count_misses(subscriber, &inbox).await,
                    Err(error) => Err(error),
                }
            }
            _ => builder.await.map(Declared::Plain),
        };
        match declared {
            Ok(declared) => Ok(RawSubscriber {
                inbox,
                _declared: declared,
            }),
            Err(error) => Err(network(&format!("{key}: no subscriber"), error)),
        }
    }
}

async fn count_misses(
    subscriber: AdvancedSubscriber<()>,
    inbox: &Arc<dyn Inbox>,
) -> zenoh::Result<Declared> {
    let inbox = Arc::clone(inbox);
    subscriber
        .sample_miss_listener()
        .callback(move |miss| inbox.add_missed(miss.nb().into()))
        .background()
        .await?;
    Ok(Declared::Advanced(subscriber))
}

/// Sends a query whose answers go to the inbox.
fn ask_stores(session: &zenoh::Session, key: &str, inbox: &Arc<dyn Inbox>) {
    let inbox = Arc::clone(inbox);
    let sent = session
        .get(key.to_owned())
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .callback(move |reply| {
            if let Ok(sample) = reply.result() {
                hand_over(sample, &*inbox);
            }
        })
        .wait();
    if let Err(error) = sent {
        tracing::warn!("{key}: stores were not asked: {error}");
    }
}

/// Runs on zenoh's threads: nothing here waits or decodes.
fn hand_over(sample: &Sample, inbox: &dyn Inbox) {
    if sample.kind() == SampleKind::Put {
        inbox.push(Arrived {
            key: sample.key_expr().to_string(),
            payload: sample.payload().clone(),
            received_nanos: clock::now_nanos(),
            sent_nanos: sample.timestamp().map(|stamp| {
                let since_epoch = stamp.get_time().to_duration();
                u64::try_from(since_epoch.as_nanos()).unwrap_or(u64::MAX)
            }),
        });
    }
}

/// A subscriber to messages that stay encoded. Its inbox may be shared with others.
#[derive(Debug)]
pub(crate) struct RawSubscriber {
    inbox: Arc<dyn Inbox>,
    _declared: Declared,
}

#[derive(Debug)]
enum Declared {
    Plain(#[expect(dead_code, reason = "held until it is dropped")] zenoh::pubsub::Subscriber<()>),
    Advanced(#[expect(dead_code, reason = "held until it is dropped")] AdvancedSubscriber<()>),
}

impl<M: Message> Subscriber<M> {
    /// The next message that decodes. It may be cancelled without loss.
    pub async fn recv(&mut self) -> Option<Received<M>> {
        loop {
            let arrived = self.queue.pop().await?;
            if let Some(received) = self.decode(arrived) {
                return Some(received);
            }
        }
    }

    /// The next message that decodes, if one is waiting.
    pub fn try_recv(&mut self) -> Option<Received<M>> {
        loop {
            let arrived = self.queue.try_pop()?;
            if let Some(received) = self.decode(arrived) {
                return Some(received);
            }
        }
    }

    /// What has become of the messages so far.
    pub fn counts(&self) -> Counts {
        Counts {
            received: self.queue.received(),
            dropped: self.queue.dropped(),
            undecodable: self.undecodable.load(Ordering::Relaxed),
            missed: self.queue.missed(),
        }
    }

    fn decode(&self, arrived: Arrived) -> Option<Received<M>> {
        match cdr::from_slice(&arrived.payload.to_bytes()) {
            Ok(message) => Some(Received {
                key: arrived.key,
                message,
                received_nanos: arrived.received_nanos,
                sent_nanos: arrived.sent_nanos,
            }),
            Err(source) => {
                let before = self.undecodable.fetch_add(1, Ordering::Relaxed);
                if before < LOGGED_FIRST || before.is_multiple_of(LOGGED_EVERY) {
                    let error = Error::Decode {
                        topic: arrived.key,
                        type_name: M::TYPE_NAME,
                        source,
                    };
                    tracing::warn!(count = before + 1, "dropped a message: {error}");
                }
                None
            }
        }
    }
}

impl Drop for RawSubscriber {
    fn drop(&mut self) {
        self.inbox.close();
    }
}
