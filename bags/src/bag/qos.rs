//! Offered quality of service as rosbag2 writes it: a YAML list of profiles, with words since version 9 and with the
//! numbers of `rmw` before.

use modulo_runtime::Qos;
use modulo_runtime::topic::{Durability, Profile, Reliability};
use modulo_runtime::wire::keys::qos_string;

const INFINITE: &str = "sec: 9223372036\n    nsec: 854775807";

/// Names of the numbers of `rmw`, by key.
const WORDS: [(&str, &[&str]); 4] = [
    ("history", &["system_default", "keep_last", "keep_all", "system_default"]),
    ("reliability", &["system_default", "reliable", "best_effort", "system_default"]),
    ("durability", &["system_default", "transient_local", "volatile", "system_default"]),
    ("liveliness", &["system_default", "automatic", "system_default", "manual_by_topic", "system_default"]),
];

/// Returns the profile of `qos` as a YAML list of one.
pub fn yaml(qos: Qos) -> String {
    let Profile { reliability, durability, depth } = Profile::parse(qos_string(qos));
    let reliability = if reliability == Reliability::Reliable { "reliable" } else { "best_effort" };
    let durability = if durability == Durability::Volatile { "volatile" } else { "transient_local" };
    let lifespan = if qos == Qos::Logs { "sec: 10\n    nsec: 0" } else { INFINITE };
    format!(
        "- history: keep_last\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n  \
         deadline:\n    {INFINITE}\n  lifespan:\n    {lifespan}\n  liveliness: automatic\n  \
         liveliness_lease_duration:\n    {INFINITE}\n  avoid_ros_namespace_conventions: false\n"
    )
}

/// Returns the nearest of this suite's profiles to the first one in `yaml`; [`Qos::Results`] when it names no policy.
pub fn parse(yaml: &str) -> Qos {
    let words = in_words(yaml);
    // An exact match first: some profiles differ only in their depth or lifespan.
    if let Some(known) = Qos::ALL.into_iter().find(|qos| self::yaml(*qos) == words) {
        return known;
    }
    let first = |key: &str| words.lines().find_map(|line| value(line, key));
    if first("durability") == Some("transient_local") {
        Qos::Latched
    } else if first("reliability") == Some("best_effort") {
        Qos::Images
    } else {
        Qos::Results
    }
}

/// Returns `yaml` with words for numbers, as version 9 of the metadata needs it.
pub(super) fn in_words(yaml: &str) -> String {
    yaml.lines().map(|line| line_in_words(line) + "\n").collect()
}

fn line_in_words(line: &str) -> String {
    for (key, words) in WORDS {
        // A number comes from an older version; words stay as they are.
        let word = value(line, key).and_then(|v| v.parse::<usize>().ok()).and_then(|n| words.get(n));
        if let (Some(word), Some(colon)) = (word, line.find(':')) {
            return format!("{}: {word}", &line[..colon]);
        }
    }
    line.to_owned()
}

fn value<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    let (name, value) = line.trim_start_matches(['-', ' ']).split_once(':')?;
    (name == key).then_some(value.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_return() {
        for qos in Qos::ALL {
            assert_eq!(parse(&yaml(qos)), qos);
            assert_eq!(in_words(&yaml(qos)), yaml(qos));
        }
        assert_eq!(parse(""), Qos::Results);
    }

    #[test]
    fn numbers_are_read_as_words() {
        let old = "- history: 1\n  depth: 10\n  reliability: 2\n  durability: 2\n  liveliness: 1\n";
        assert_eq!(parse(old), Qos::Images);
        let new = "- history: keep_last\n  depth: 10\n  reliability: best_effort\n  durability: volatile\n  \
                   liveliness: automatic\n";
        assert_eq!(in_words(old), new);
    }
}
