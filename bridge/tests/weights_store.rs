//! Weights outlive the trainer that published them, and the store that kept them.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::Weights;
use swath_bridge::signature::{SigningKey, load_or_create_key, sign};
use swath_bridge::{Session, SessionConfig, WeightsStore, keys};
use tempfile::TempDir;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

/// A session that can be connected to, and is connected to the others.
async fn open(others: &[&Session]) -> Session {
    let mut config = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    for other in others {
        config.connect.extend(other.endpoints().await);
    }
    Session::open(&config).await.unwrap()
}

fn signed(run: &str, version: u64, key: &SigningKey) -> Weights {
    let mut weights = Weights {
        header: Header::at(version, ""),
        run: run.to_owned(),
        version,
        step: 0,
        epoch: 0,
        architecture: "enet".to_owned(),
        input_rows: 8,
        input_cols: 8,
        vehicle: String::new(),
        loss: 0.0,
        miou: 0.5,
        iou_path: 0.5,
        iou_background: 0.5,
        digest: [0; 32],
        public_key: Vec::new(),
        signature: Vec::new(),
        safetensors: vec![7; 300_000],
    };
    sign(&mut weights, key).unwrap();
    weights
}

/// Versions that the stores give, once they have the wanted one.
async fn stored(session: &Session, wanted: u64) -> Vec<(String, u64)> {
    soon(async {
        loop {
            let weights = session.stored_weights("*", &[]).await.unwrap();
            let found: Vec<(String, u64)> = weights
                .into_iter()
                .map(|received| (received.message.run, received.message.version))
                .collect();
            if found.iter().any(|(_, version)| *version == wanted) {
                return found;
            }
        }
    })
    .await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_newest_weights_outlive_their_trainer_and_their_store() {
    let dir = TempDir::new().unwrap();
    let key = SigningKey::from_bytes(&[1; 32]);
    let planner = open(&[]).await;
    let keeper = open(&[&planner]).await;
    let store = WeightsStore::open(&keeper, dir.path(), &[]).await.unwrap();
    let trainer = open(&[&planner, &keeper]).await;
    let publisher = trainer.publisher(&keys::weights("r")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    for version in 1..=3 {
        publisher.put(&signed("r", version, &key)).await.unwrap();
    }
    // A stray message with an older number does not replace the newest.
    publisher.put(&signed("r", 2, &key)).await.unwrap();
    publisher.put(&signed("s", 4, &key)).await.unwrap();
    drop(publisher);
    let newest = [("r".to_owned(), 3), ("s".to_owned(), 4)];
    assert_eq!(stored(&planner, 4).await, newest);
    trainer.close().await.unwrap();
    drop(store);
    keeper.close().await.unwrap();

    let another = open(&[&planner]).await;
    let _store = WeightsStore::open(&another, dir.path(), &[]).await.unwrap();
    assert_eq!(stored(&planner, 4).await, newest);
    // Who subscribes now gets them as if they had just been published.
    let mut late = planner.subscriber(&keys::weights("r"), 4).await.unwrap();
    let received = soon(late.recv()).await.unwrap();
    assert_eq!(received.key, "swath/weights/r");
    assert_eq!(received.message.version, 3);
    let trusted = [SigningKey::from_bytes(&[9; 32]).verifying_key()];
    let untrusted = planner.stored_weights("r", &trusted).await.unwrap();
    assert!(untrusted.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn weights_of_strangers_and_damaged_files_are_not_kept() {
    let dir = TempDir::new().unwrap();
    let [trusted, stranger] = [1, 2].map(|number| SigningKey::from_bytes(&[number; 32]));
    std::fs::write(dir.path().join("cut.weights"), [0, 1, 0, 0, 9]).unwrap();
    let a = open(&[]).await;
    let b = open(&[&a]).await;
    let keys_trusted = [trusted.verifying_key()];
    let _store = WeightsStore::open(&b, dir.path(), &keys_trusted)
        .await
        .unwrap();
    let publisher = a.publisher(&keys::weights("r")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    publisher.put(&signed("s", 9, &stranger)).await.unwrap();
    publisher.put(&signed("../r", 8, &trusted)).await.unwrap();
    publisher.put(&signed("r", 7, &trusted)).await.unwrap();
    assert_eq!(stored(&a, 7).await, [("r".to_owned(), 7)]);
}

#[test]
fn a_key_is_made_once_and_then_kept() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("key");
    let made = load_or_create_key(&path).unwrap();
    assert_eq!(load_or_create_key(&path).unwrap(), made);
    let other = load_or_create_key(&dir.path().join("other")).unwrap();
    assert_ne!(other, made);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0);
    }
    for text in ["", "0", &"0".repeat(65), &"0".repeat(1000), "\u{fffd}"] {
        std::fs::write(&path, text).unwrap();
        let error = load_or_create_key(&path).unwrap_err().to_string();
        assert!(error.contains("hexadecimal"), "{error}");
    }
}
