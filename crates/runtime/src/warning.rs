//! Warnings that a peer can cause: [`warn_once`] and [`RareWarnings`] bound how many there are, and [`shown`] how they look.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The warnings so far, at most [`MOST_KEPT`] of them: a peer that sets parameters must not fill the memory.
static WARNED: Mutex<Vec<String>> = Mutex::new(Vec::new());
const MOST_KEPT: usize = 64;

/// Logs a warning, unless the same text was among the last 64 different ones of this process.
pub fn warn_once(text: String) {
    let mut warned = WARNED.lock().unwrap_or_else(PoisonError::into_inner);
    if warned.contains(&text) {
        return;
    }
    tracing::warn!("{text}");
    if warned.len() == MOST_KEPT {
        warned.remove(0);
    }
    warned.push(text);
}

/// Returns `text` as it is printed where it may come from a peer: at most `most` characters, and those that could end a line or
/// control a terminal are escaped.
pub fn shown(text: &str, most: usize) -> String {
    let mut shown = String::new();
    for character in text.chars().take(most) {
        if character.is_control() {
            shown.extend(character.escape_default());
        } else {
            shown.push(character);
        }
    }
    if text.chars().nth(most).is_some() {
        shown.push_str("...");
    }
    shown
}

/// Shortest time between two warnings about one source.
const WARNING_PERIOD_NS: u64 = 1_000_000_000;
/// Longest reason in a warning, in characters.
const LONGEST_REASON: usize = 500;

/// Gives at most one warning a second about each source of faults, such as a topic or a service, with the number of those that were
/// not reported. A peer whose messages cannot be read would otherwise fill the log at its rate.
#[derive(Debug, Default)]
pub struct RareWarnings {
    /// By source: ticks of the last warning, and the number of faults since then.
    sources: BTreeMap<String, (u64, u64)>,
}

impl RareWarnings {
    /// Notes a fault of `source` at the ticks `now`; returns the text of a warning if one is due.
    pub fn note(&mut self, source: &str, why: &str, now: u64) -> Option<String> {
        let Some((last, unreported)) = self.sources.get_mut(source) else {
            self.sources.insert(source.to_owned(), (now, 0));
            return Some(shown(why, LONGEST_REASON));
        };
        *unreported += 1;
        if now.saturating_sub(*last) < WARNING_PERIOD_NS {
            return None;
        }
        *last = now;
        let why = shown(why, LONGEST_REASON);
        Some(match std::mem::take(unreported) {
            1 => why,
            count => format!("{why} (one of {count} since the last warning)"),
        })
    }

    /// Returns each source with faults that no warning has counted, with the text of the last warning.
    pub fn rest(&mut self) -> Vec<(String, String)> {
        let sources = std::mem::take(&mut self.sources).into_iter();
        let unreported = sources.filter(|(_, (_, unreported))| *unreported > 0);
        unreported.map(|(source, (_, n))| (source, format!("{n} more since the last warning"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn faults_are_told_once_a_second_and_none_is_left_out_of_the_count() {
        let mut warnings = RareWarnings::default();
        assert_eq!(warnings.note("/a", "cut", 0).as_deref(), Some("cut"));
        assert_eq!(warnings.note("/b", "cut", 10 * MS).as_deref(), Some("cut"), "another topic");
        assert_eq!(warnings.note("/a", "odd", 500 * MS), None);
        assert_eq!(warnings.note("/a", "odd", 999 * MS), None);
        let text = warnings.note("/a", "cut", 1000 * MS);
        assert_eq!(text.as_deref(), Some("cut (one of 3 since the last warning)"));
        assert_eq!(warnings.note("/a", "odd", 9000 * MS).as_deref(), Some("odd"));
        assert_eq!(warnings.note("/a", "odd", 9001 * MS), None);
        assert_eq!(warnings.rest(), [("/a".to_owned(), "1 more since the last warning".to_owned())]);
        assert_eq!(warnings.rest(), []);
    }

    /// A peer wrote lines of its own into the log, and 27 MB of them in half a minute.
    #[test]
    fn a_peer_that_floods_writes_few_short_lines_and_none_of_its_own() {
        let mut warnings = RareWarnings::default();
        let why = "encoding '\nWARN all is lost\0\u{1b}[2J".to_owned() + &"x".repeat(64 << 10);
        let lines: Vec<_> = (0..10_000).filter_map(|n| warnings.note("/a", &why, n * 3 * MS)).collect();
        assert!(lines.len() <= 31, "{}", lines.len());
        for line in lines {
            assert!(line.len() < 600 && !line.contains(char::is_control), "{line}");
            assert!(line.starts_with("encoding '\\nWARN all is lost\\u{0}\\u{1b}[2Jx"), "{line}");
        }
    }

    #[test]
    fn a_text_is_cut_between_its_characters() {
        assert_eq!([3, 4].map(|most| shown("日本語x", most)), ["日本語...", "日本語x"]);
    }
}
