//! Zenoh's errors in words for people: without the places in its source that raised them.

/// What ends the place in the source that an error was raised at: a file and, behind it, a line.
const FILE_END: &str = ".rs:";
/// What begins it.
const PLACE: &str = " at ";
/// What zenoh puts between an error and its cause.
const CAUSE: &str = " - Caused by ";

/// What the number of an error of the system begins with.
const SYSTEM_CODE: &str = "(os error ";

/// The text of an error without places in source files, each cause said once.
pub fn plain_words(error: &str) -> String {
    let text = without_places(error).replace(CAUSE, ": ");
    let text = text.trim().trim_end_matches(['.', '!']);
    let mut said: Vec<&str> = Vec::new();
    for part in text.split(": ") {
        if said.last() != Some(&part) {
            said.push(part);
        }
    }
    said.join(": ")
}

/// What the system said, if that is in a text of zenoh's; else all of it.
pub(super) fn system_cause(text: &str) -> &str {
    let Some(code) = text.find(SYSTEM_CODE) else {
        return text;
    };
    let start = text[..code].rfind(": ").map_or(0, |colon| colon + 2);
    let end = text[code..]
        .find(')')
        .map_or(text.len(), |close| code + close + 1);
    &text[start..end]
}

/// Leaves out every ` at FILE.rs:LINE.`; the path may have spaces in it.
fn without_places(text: &str) -> String {
    let mut kept = String::new();
    let mut rest = text;
    while let Some(end) = rest.find(FILE_END) {
        let behind = &rest[end + FILE_END.len()..];
        let line = behind.trim_start_matches(|c: char| c.is_ascii_digit());
        let is_place = line.len() < behind.len();
        match rest[..end].rfind(PLACE) {
            Some(start) if is_place => kept.push_str(&rest[..start]),
            _ => {
                kept.push_str(&rest[..end + FILE_END.len()]);
                rest = behind;
                continue;
            }
        }
        rest = line.strip_prefix('.').unwrap_or(line);
    }
    kept + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_in_sources_are_left_out() {
        for (error, plain) in [
            (
                "No listener at /home/a b/.cargo/x/src/tcp-1.0/src/unicast.rs:32. - Caused by \
                 Address in use at src/lib.rs:7.",
                "No listener: Address in use",
            ),
            (
                "Cannot listen on tcp/[::1]:1: [tcp/[::1]:1: in use at /a/b.rs:30.] at c/d.rs:4.",
                "Cannot listen on tcp/[::1]:1: [tcp/[::1]:1: in use]",
            ),
            ("nothing to leave out", "nothing to leave out"),
            ("look at it.rs: there", "look at it.rs: there"),
            ("x: y: y at /z.rs:1.", "x: y"),
            ("", ""),
        ] {
            assert_eq!(plain_words(error), plain);
        }
    }

    #[test]
    fn the_word_of_the_system_is_taken_out_of_what_stands_around_it() {
        for (text, cause) in [
            (
                "Cannot: [a:1: In use (os error 98)]",
                "In use (os error 98)",
            ),
            ("In use (os error 98)", "In use (os error 98)"),
            ("no: such thing", "no: such thing"),
            ("x: cut (os error ", "cut (os error "),
        ] {
            assert_eq!(system_cause(text), cause);
        }
    }
}
