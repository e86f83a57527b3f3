//! Choosing topics by patterns, as a shell chooses files.

use crate::keys;

/// Whether a topic is one that a pattern means. A `*` stands for anything, also for nothing and for
/// slashes; the slash in front of a topic may be left out.
pub(super) fn matches(pattern: &str, topic: &str) -> bool {
    let bare = keys::key_of_topic(topic);
    let wanted = keys::key_of_topic(pattern);
    glob(wanted.as_bytes(), bare.as_bytes())
        || glob(pattern.as_bytes(), format!("/{bare}").as_bytes())
}

fn glob(pattern: &[u8], text: &[u8]) -> bool {
    let (mut at, mut from) = (0, 0);
    // Where to go on if the last star has to stand for one byte more.
    let mut star: Option<(usize, usize)> = None;
    while from < text.len() {
        if pattern.get(at) == Some(&b'*') {
            star = Some((at, from));
            at += 1;
        } else if pattern.get(at) == Some(&text[from]) {
            at += 1;
            from += 1;
        } else if let Some((behind, taken)) = star {
            at = behind + 1;
            from = taken + 1;
            star = Some((behind, taken + 1));
        } else {
            return false;
        }
    }
    pattern[at.min(pattern.len())..]
        .iter()
        .all(|byte| *byte == b'*')
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn stars_stand_for_anything_and_the_first_slash_is_optional() {
        for (pattern, topic, expected) in [
            ("*/grid", "/swath/vehicle/v0/grid", true),
            ("*/grid", "/grid", true),
            ("*grid", "/swath/vehicle/v0/grid", true),
            ("/swath/*", "/swath/vehicle/v/grid", true),
            ("swath/*/grid", "/swath/vehicle/v0/grid", true),
            ("swath/vehicle/v0/grid", "/swath/vehicle/v0/grid", true),
            ("*", "/anything", true),
            ("**", "/anything", true),
            ("odom", "/odometry", false),
            ("*/grid", "/swath/vehicle/v0/grids", false),
            ("*v1*", "/swath/vehicle/v0/grid", false),
            ("", "/odom", false),
        ] {
            assert_eq!(matches(pattern, topic), expected, "{pattern} {topic}");
        }
    }

    /// All ways in which stars can be filled in, tried one after the other.
    fn slow(pattern: &[u8], text: &[u8]) -> bool {
        match pattern.split_first() {
            None => text.is_empty(),
            Some((b'*', rest)) => (0..=text.len()).any(|count| slow(rest, &text[count..])),
            Some((first, rest)) => text.first() == Some(first) && slow(rest, &text[1..]),
        }
    }

    proptest! {
        #[test]
        fn agrees_with_trying_everything(pattern in "[ab*]{0,6}", text in "[ab]{0,8}") {
            prop_assert_eq!(
                glob(pattern.as_bytes(), text.as_bytes()),
                slow(pattern.as_bytes(), text.as_bytes())
            );
        }
    }
}
