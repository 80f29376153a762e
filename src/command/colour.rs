//! The colours of a terminal: red for what is lost or wrong, yellow for what is skipped or not trusted.

use std::fmt::Display;

use console::{Style, StyledObject, style};
use modulo_launch::Summary;

/// Returns the begin of an error, on standard error.
pub fn error(text: &str) -> StyledObject<&str> {
    style(text).for_stderr().red().bold()
}

/// Returns the begin of a warning, on standard error.
pub fn warning(text: &str) -> StyledObject<&str> {
    style(text).for_stderr().yellow().bold()
}

pub fn say_summary(summary: &Summary) {
    summary.to_string().trim_end().lines().for_each(|line| say!("{}", of_summary(line)));
}

fn of_summary(line: &str) -> impl Display {
    let words: Vec<&str> = line.split_whitespace().collect();
    let number = |word: &str| word.parse::<u64>().ok();
    // Topic, received, sent, dropped and bad.
    let counts = match words[..] {
        [topic, _, _, dropped, bad] if topic.starts_with('/') => number(dropped).zip(number(bad)),
        _ => None,
    };
    let trusted = words.windows(4).find_map(|words| match words {
        ["trusted", some, "of", all] => number(some).zip(number(all)),
        _ => None,
    });
    let is_loss = counts.is_some_and(|(_, bad)| bad > 0) || line.contains("crash");
    let is_less =
        counts.is_some_and(|(dropped, _)| dropped > 0) || trusted.is_some_and(|(some, all)| some < all);
    let colour = match (is_loss, is_less) {
        (true, _) => Style::new().red(),
        (false, true) => Style::new().yellow(),
        (false, false) => Style::new(),
    };
    colour.apply_to(line.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_with_a_loss_have_a_colour() {
        console::set_colors_enabled(true);
        let is_plain = |line: &str| of_summary(line).to_string() == line;
        for line in [
            "/modulo 12 12 0 0",
            "unwrap used auto (lines 12), trusted 12 of 12 frames",
            "frames 12, engine rten",
        ] {
            assert!(is_plain(line), "{line}");
        }
        for line in [
            "/modulo 12 12 3 0",
            "/modulo 12 12 0 1",
            "/unwrap used auto, trusted 0 of 12 frames",
            "unwrap crashed and was restarted 1 times",
        ] {
            assert!(!is_plain(line), "{line}");
        }
    }
}
