//! The summary for a terminal of 80 columns.

use std::fmt;

use super::Summary;

const WIDTH: usize = 80;
const NAME: usize = 36;

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let engine = self.engine.as_deref().unwrap_or("none");
        writeln!(f, "{}", fitted(&format!("frames {}, engine {engine}", self.frames), WIDTH))?;
        if !self.topics.is_empty() {
            writeln!(f, "{:NAME$} {:>10} {:>10} {:>10} {:>10}", "topic", "in", "out", "dropped", "bad")?;
        }
        for (topic, n) in &self.topics {
            let name = fitted(topic, NAME);
            writeln!(f, "{name:NAME$} {:>10} {:>10} {:>10} {:>10}", n.received, n.sent, n.dropped, n.bad)?;
        }
        if !self.latency_ms.is_empty() {
            writeln!(f, "{:NAME$} {:>10} {:>10} {:>10}", "stage", "p50 ms", "p95 ms", "p99 ms")?;
        }
        for (stage, at) in &self.latency_ms {
            let name = fitted(stage, NAME);
            writeln!(f, "{name:NAME$} {:>10.1} {:>10.1} {:>10.1}", at.p50, at.p95, at.p99)?;
        }
        for (stream, classes) in &self.detections {
            let mut counts: Vec<(&String, &u64)> = classes.iter().collect();
            counts.sort_by_key(|(class, n)| (std::cmp::Reverse(**n), class.as_str()));
            let counts: Vec<String> = counts.iter().map(|(class, n)| format!("{n} {class}")).collect();
            write_list(f, &format!("detected on {stream}:"), &counts)?;
        }
        for (node, methods) in &self.unwrapped {
            writeln!(f, "{}", fitted(&format!("{node} used {methods}"), WIDTH))?;
        }
        for lost in &self.lost_in_crashes {
            writeln!(f, "{}", fitted(&lost.to_string(), WIDTH))?;
        }
        for (process, count) in &self.restarts {
            writeln!(f, "{}", fitted(&format!("{process} crashed and was restarted {count} times"), WIDTH))?;
        }
        Ok(())
    }
}

/// `title item, item, ...` on as many lines as it needs.
fn write_list(f: &mut fmt::Formatter<'_>, title: &str, items: &[String]) -> fmt::Result {
    let mut line = fitted(title, WIDTH / 2);
    for (index, item) in items.iter().enumerate() {
        let comma = if index + 1 < items.len() { "," } else { "" };
        let item = format!(" {}{comma}", fitted(item, WIDTH / 2));
        if line.chars().count() + item.chars().count() > WIDTH {
            writeln!(f, "{line}")?;
            line = "   ".to_owned();
        }
        line.push_str(&item);
    }
    writeln!(f, "{line}")
}

/// `text` in at most `width` characters, with a mark where it was cut.
fn fitted(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    text.chars().take(width.saturating_sub(3)).chain("...".chars()).collect()
}

#[cfg(test)]
mod tests {
    use modulo_runtime::report::Percentiles;

    use super::super::TopicCounts;
    use super::*;

    #[test]
    fn eighty_columns_hold_the_longest_names_and_counts() {
        let long = "/a_very_long_name".repeat(8);
        let n = 4_294_967_295;
        let summary = Summary {
            frames: n,
            engine: Some(long.clone()),
            topics: [(
                long.clone(),
                TopicCounts { received: n, sent: n, dropped: n, bad: n, ..TopicCounts::default() },
            )]
            .into(),
            latency_ms: [(long.clone(), Percentiles { p50: 1e6, p95: 1e6, p99: 1e6 })].into(),
            detections: [(long.clone(), (0..80).map(|i| (format!("class {i}"), i)).collect())].into(),
            restarts: [(long, 3)].into(),
            ..Summary::default()
        };
        let table = summary.to_string();
        assert!(table.lines().all(|line| line.chars().count() <= WIDTH), "{table}");
        assert!((0..80).all(|i| table.contains(&format!(" {i} class {i}"))), "none is left out: {table}");
    }

    #[test]
    fn the_most_frequent_class_comes_first() {
        let classes = [("car".to_owned(), 2), ("person".to_owned(), 31)].into();
        let summary =
            Summary { detections: [("recovered".to_owned(), classes)].into(), ..Summary::default() };
        assert_eq!(summary.to_string(), "frames 0, engine none\ndetected on recovered: 31 person, 2 car\n");
    }
}
