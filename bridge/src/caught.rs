//! Futures whose panics become errors, so that what was published can be withdrawn.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::task::Poll;

/// What the future gives, or what its panic said.
///
/// # Errors
/// The panic's words. What the future had in hand may be half done.
pub async fn caught<T>(work: impl Future<Output = T>) -> Result<T, String> {
    let mut work = pin!(work);
    std::future::poll_fn(|context| {
        match catch_unwind(AssertUnwindSafe(|| work.as_mut().poll(context))) {
            Ok(polled) => polled.map(Ok),
            Err(panic) => Poll::Ready(Err(words(&*panic))),
        }
    })
    .await
}

fn words(panic: &(dyn Any + Send)) -> String {
    let said = panic.downcast_ref::<&str>().map(ToString::to_string);
    let said = said.or_else(|| panic.downcast_ref::<String>().cloned());
    said.unwrap_or_else(|| "a panic of an unknown cause".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_panic_is_what_it_said_and_all_else_is_the_result() {
        assert_eq!(caught(async { 7 }).await, Ok(7));
        let later = async {
            tokio::task::yield_now().await;
            panic!("number {}", 7);
        };
        assert_eq!(
            caught(later).await.map(|(): ()| ()),
            Err("number 7".to_owned())
        );
        let fixed = async { panic!("in words") };
        assert_eq!(
            caught(fixed).await.map(|(): ()| ()),
            Err("in words".to_owned())
        );
    }
}
