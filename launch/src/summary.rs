//! [`Summary`]: the reports of all nodes and their lives added up; percentiles come from merged counts.

mod accounts;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use modulo_runtime::output;
use modulo_runtime::report::{Histogram, Percentiles, add, quantile};
use serde::Serialize;

use crate::{LaunchError, files_in};
pub use accounts::Account;
pub use modulo_runtime::report::NodeReport;

/// The counts and durations of a run, over all its nodes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Frames that the sources sent.
    pub frames: u64,
    /// Detections by stream and class.
    pub detections: BTreeMap<String, BTreeMap<String, u64>>,
    /// Messages that were lost, replaced by newer ones or left unread, by topic.
    pub dropped: BTreeMap<String, u64>,
    /// What became of each message, by topic and reader.
    pub readers: Vec<Account>,
    /// Durations by stage.
    pub latency_ms: BTreeMap<String, Percentiles>,
    /// The inference engines that really ran, joined with `+` when they differ.
    pub engine: Option<String>,
    /// What unwrapping took, such as `lines 58, gradient_tree 2; trusted 60 of 60 frames`, by node.
    pub unwrapped: BTreeMap<String, String>,
    /// The counts of live cameras, such as `300 frames arrived, 2 replaced, 1 connections`, by node.
    pub live: BTreeMap<String, String>,
    /// Messages by topic.
    pub topics: BTreeMap<String, TopicCounts>,
    /// Restarts after crashes, by process; only those that had one.
    pub restarts: BTreeMap<String, u32>,
    /// Processes that have done their work but have lost something, such as a player of a bag that was cut, with the reason.
    pub with_loss: Vec<String>,
    /// Whether an evaluation was stopped before its sources were over.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
    /// Topics that are read as best effort: the sender does not promise that all messages arrive.
    #[serde(skip)]
    pub best_effort: BTreeSet<String>,
    /// Whether a detector with the engine `auto` took the slower one.
    #[serde(skip)]
    pub slower_engine: bool,
}

/// Messages of one topic, over all nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TopicCounts {
    /// Received, by all subscribers together.
    #[serde(rename = "in")]
    pub received: u64,
    /// Sent.
    #[serde(rename = "out")]
    pub sent: u64,
    /// Replaced, lost or unread.
    pub dropped: u64,
    /// Replaced by newer ones before a node took them.
    pub replaced: u64,
    /// Lost on the way.
    pub lost: u64,
    /// Left unread by a node that ended or changed its inputs.
    pub unread: u64,
    /// Could not be read, processed or sent.
    pub bad: u64,
}

/// The first bytes of the file of a summary.
pub const SUMMARY_BEGIN: &str = "{\n  \"frames\": ";

impl Summary {
    /// Adds up `reports`, one for each life of each node; `restarts` are (process, count).
    pub fn new<'a>(reports: &[NodeReport], restarts: impl IntoIterator<Item = (&'a str, u32)>) -> Self {
        let readers = accounts::accounts(reports);
        let mut summary = Self { engine: engine(reports), readers, ..Self::default() };
        let mut stages: BTreeMap<&str, Histogram> = BTreeMap::new();
        for report in reports {
            summary.frames += frames(report);
            summary.add_topics(report);
            summary.add_detections(report);
            summary.slower_engine |=
                report.status.get("engine_from").is_some_and(|note| note.starts_with("auto: "));
            let status = |key| report.status.get(key);
            if let (Some(methods), Some(trusted)) = (status("methods_used"), status("trusted")) {
                let over =
                    status("over_budget").map_or_else(String::new, |over| format!("; over budget {over}"));
                add_life(&mut summary.unwrapped, report, format!("{methods}; trusted {trusted}{over}"));
            }
            if let Some(live) = status("live") {
                add_life(&mut summary.live, report, live.clone());
            }
            for (stage, buckets) in &report.stages {
                // All nodes count in buckets of the same bounds, so their counts can be added.
                let merged = stages.entry(stage).or_default();
                buckets.iter().for_each(|(bound, count)| *merged.entry(*bound).or_default() += count);
            }
        }
        let latency = stages.into_iter().filter_map(|(stage, h)| Some((stage.to_owned(), percentiles(&h)?)));
        summary.latency_ms = latency.collect();
        for (process, count) in restarts.into_iter().filter(|(_, count)| *count > 0) {
            // Two processes may have the same label, such as the same node in two namespaces.
            *summary.restarts.entry(process.to_owned()).or_default() += count;
        }
        summary
    }

    /// Whether something was lost that should never be: the run ends with exit code 3.
    ///
    /// A live run promises the newest image, so an image that a newer one replaced, or that was dropped on its way to
    /// a reader that was late, is only counted. So is one that was left unread at the end. With `strict` these are
    /// losses too. These always are: a message that could not be read, processed or sent, a message lost on
    /// the way of a reliable topic, what was lost in a crash, and what a process says that it has lost. A message from outside of
    /// the launch counts as a loss, too: the figures are not those of its own camera.
    pub fn lost(&self, strict: bool) -> bool {
        let broken = |(topic, n): (&String, &TopicCounts)| {
            n.bad > 0 || (n.lost > 0 && !self.best_effort.contains(topic)) || (strict && n.dropped > 0)
        };
        let is_named = !self.with_loss.is_empty() || self.readers.iter().any(Account::is_broken);
        is_named || self.topics.iter().any(broken)
    }

    /// Writes the summary to `file` as JSON.
    ///
    /// # Errors
    /// [`LaunchError::File`] when it cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), LaunchError> {
        let mut text = serde_json::to_string_pretty(self).map_err(|e| LaunchError::file(file, e))?;
        text.push('\n');
        output::replace(file, text.as_bytes()).map_err(|e| LaunchError::file(file, e))
    }

    fn add_topics(&mut self, report: &NodeReport) {
        self.add_counts(&report.received, |topic| &mut topic.received);
        self.add_counts(&report.published, |topic| &mut topic.sent);
        self.add_counts(&report.replaced, |topic| &mut topic.replaced);
        self.add_counts(&report.lost, |topic| &mut topic.lost);
        self.add_counts(&report.unread, |topic| &mut topic.unread);
        self.add_counts(&report.bad, |topic| &mut topic.bad);
        let dropped = report.dropped();
        self.add_counts(&dropped, |topic| &mut topic.dropped);
        dropped.iter().for_each(|(topic, n)| add(&mut self.dropped, topic, *n));
        self.best_effort.extend(report.best_effort.iter().cloned());
    }

    fn add_counts(&mut self, counts: &BTreeMap<String, u64>, field: fn(&mut TopicCounts) -> &mut u64) {
        for (topic, n) in counts {
            *field(self.topics.entry(topic.clone()).or_default()) += n;
        }
    }

    fn add_detections(&mut self, report: &NodeReport) {
        // A stream in which nothing was found is named as well.
        let read = report.status.get("stream").into_iter().flat_map(|streams| streams.split(", "));
        let read = read.map(|stream| (stream, BTreeMap::new()));
        for (stream, found) in report.classes.iter().map(|(s, c)| (s.as_str(), c.clone())).chain(read) {
            let classes = self.detections.entry(stream.to_owned()).or_default();
            found.iter().for_each(|(class, n)| add(classes, class, *n));
        }
    }
}

/// Adds what a life of a node says to that of its lives before.
fn add_life(reported: &mut BTreeMap<String, String>, report: &NodeReport, life: String) {
    let lives = reported.entry(report.node.clone()).or_default();
    *lives = if lives.is_empty() { life } else { format!("{lives}; after a restart {life}") };
}

/// Returns the number of frames that a source has sent: from its status, else from its busiest topic.
fn frames(report: &NodeReport) -> u64 {
    if report.status.get("role").map(String::as_str) != Some("source") {
        return 0;
    }
    let reported = report.status.get("frames").and_then(|frames| frames.parse().ok());
    reported.unwrap_or_else(|| report.published.values().copied().max().unwrap_or(0))
}

fn engine(reports: &[NodeReport]) -> Option<String> {
    let engines: BTreeSet<&str> =
        reports.iter().filter_map(|report| report.status.get("engine")).map(String::as_str).collect();
    (!engines.is_empty()).then(|| engines.into_iter().collect::<Vec<_>>().join("+"))
}

fn percentiles(histogram: &Histogram) -> Option<Percentiles> {
    Percentiles::of(|q| quantile(histogram, q).map(|us| us as f64 / 1000.0))
}

/// Returns the reports that nodes have written into `folder` so far, one for each life of a node. A report that a node
/// is about to write for the first time is left out.
pub fn reports_so_far(folder: &Path) -> Vec<NodeReport> {
    reports_in(folder, |_, _| ())
}

/// Returns the reports in `folder` in the order of their names. `unread` gets a file that cannot be read, and why.
pub(crate) fn reports_in(folder: &Path, unread: impl Fn(&Path, String)) -> Vec<NodeReport> {
    let files = files_in(folder).unwrap_or_default().into_iter();
    let read = |file: PathBuf| {
        let text = std::fs::read_to_string(&file).map_err(|e| e.to_string());
        let report = text.and_then(|text| serde_json::from_str(&text).map_err(|e| e.to_string()));
        report.map_err(|why| unread(&file, why)).ok()
    };
    files.filter(|file| file.extension().is_some_and(|e| e == "json")).filter_map(read).collect()
}

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
            let nothing = if counts.is_empty() { " nothing" } else { "" };
            write_list(f, &format!("detected on {stream}:{nothing}"), &counts)?;
        }
        let live = self.live.iter().map(|(node, live)| format!("{node} live: {live}"));
        let used = self.unwrapped.iter().map(|(node, methods)| format!("{node} used {methods}"));
        let broken = self.readers.iter().filter(|reader| reader.is_broken()).map(ToString::to_string);
        let restarted = |(process, count)| format!("{process} crashed and was restarted {count} times");
        let mut lines = live.chain(used).chain(broken).chain(self.restarts.iter().map(restarted));
        lines.try_for_each(|line| writeln!(f, "{}", fitted(&line, WIDTH)))
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
    use super::*;

    fn report(json: &str) -> NodeReport {
        serde_json::from_str(json).expect("a report")
    }

    /// 1..=100 ms, odd ones in one node, even ones in the other.
    fn halves() -> [NodeReport; 2] {
        [1, 2].map(|first| {
            let buckets: Histogram = (0..50).map(|i| ((first + 2 * i) * 1000, 1)).collect();
            report(
                &serde_json::json!({
                    "node": format!("/detector_{first}"), "received": {"/recovered": 50}, "published": {},
                    "replaced": {"/recovered": 0}, "bad": {}, "classes": {"recovered": {"car": 3}},
                    "status": {"engine": "rten", "stream": "recovered"}, "stages": {"infer": buckets}
                })
                .to_string(),
            )
        })
    }

    fn camera() -> NodeReport {
        report(
            r#"{"node": "/modulo_camera", "received": {}, "published": {"/modulo": 20, "/ideal": 7},
                "status": {"role": "source", "frames": "21"}, "stages": {}}"#,
        )
    }

    #[test]
    fn percentiles_of_merged_nodes_are_those_of_all_values() {
        let summary = Summary::new(&halves(), []);
        let expected = Percentiles { p50: 50.0, p95: 95.0, p99: 99.0 };
        assert_eq!(summary.latency_ms["infer"], expected);
        assert_eq!(summary.detections["recovered"]["car"], 6);
        assert_eq!(summary.topics["/recovered"].received, 100);
        assert_eq!(summary.engine.as_deref(), Some("rten"));
        assert!(!summary.lost(true));
    }

    #[test]
    fn frames_come_from_sources_alone() {
        let mut source = camera();
        let unwrap =
            NodeReport { published: [("/recovered".into(), 99)].into(), ..NodeReport::new("/unwrap") };
        assert_eq!(Summary::new(&[source.clone(), unwrap.clone()], []).frames, 21);
        source.status.remove("frames");
        assert_eq!(Summary::new(&[source, unwrap], []).frames, 20);
    }

    /// The table of exit code 3: what was counted, on a best-effort topic or a reliable one, and with `--strict`.
    #[test]
    fn only_what_should_never_be_lost_is_a_loss() {
        type Field = fn(&mut NodeReport) -> &mut BTreeMap<String, u64>;
        let fields: [(Field, [bool; 4]); 5] = [
            // best effort, reliable, strict best effort, strict reliable
            (|r| &mut r.received, [false, false, false, false]),
            (|r| &mut r.replaced, [false, false, true, true]),
            (|r| &mut r.unread, [false, false, true, true]),
            (|r| &mut r.lost, [false, true, true, true]),
            (|r| &mut r.bad, [true, true, true, true]),
        ];
        for (line, (field, expected)) in fields.into_iter().enumerate() {
            let lost = |best_effort: bool, strict: bool| {
                let mut node = NodeReport::new("/unwrap");
                field(&mut node).insert("/t".into(), 1);
                if best_effort {
                    node.best_effort.insert("/t".into());
                }
                Summary::new(&[node], []).lost(strict)
            };
            let found = [lost(true, false), lost(false, false), lost(true, true), lost(false, true)];
            assert_eq!(found, expected, "line {line}");
        }
        let crashed = NodeReport { running: true, ..NodeReport::new("/unwrap") };
        let mut summary = Summary::new(&[crashed], []);
        assert!(!summary.lost(true), "a crash that took nothing");
        summary.readers.push(Account { down: 1, ..Account::default() });
        assert!(summary.lost(false));
    }

    /// A node whose input was changed: each frame counts for the stream that it came from.
    #[test]
    fn detections_count_by_the_stream_of_their_frame() {
        let node = report(
            r#"{"node": "/detector", "classes": {"recovered": {"car": 2}, "modulo": {"car": 1, "bus": 4}},
                "status": {"stream": "ideal"}}"#,
        );
        let expected =
            serde_json::json!({"recovered": {"car": 4}, "modulo": {"car": 2, "bus": 8}, "ideal": {}});
        let summary = Summary::new(&[node.clone(), node], []);
        assert_eq!(serde_json::to_value(&summary.detections).expect("serialises"), expected);
    }

    #[test]
    fn each_camera_of_a_detector_has_its_own_stream() {
        let node = report(
            r#"{"node": "/detector", "classes": {"/front/recovered": {"car": 2}},
                "status": {"stream": "/front/recovered, /rear/recovered"}}"#,
        );
        let streams: Vec<_> = Summary::new(&[node], []).detections.into_keys().collect();
        assert_eq!(streams, ["/front/recovered", "/rear/recovered"]);
    }

    #[test]
    fn engines_that_differ_are_both_named() {
        let mut nodes = halves();
        nodes[1].status.insert("engine".into(), "ort".into());
        assert_eq!(Summary::new(&nodes, []).engine.as_deref(), Some("ort+rten"));
    }

    #[test]
    fn the_json_has_the_promised_shape() {
        let [a, b] = halves();
        let summary = Summary::new(&[a, b, camera()], [("detector", 2), ("unwrap", 0)]);
        let json = serde_json::to_value(&summary).expect("serialises");
        assert_eq!(json["latency_ms"]["infer"], serde_json::json!({"p50": 50.0, "p95": 95.0, "p99": 99.0}));
        assert_eq!(
            json["topics"]["/recovered"],
            serde_json::json!({"in": 100, "out": 0, "dropped": 0, "replaced": 0, "lost": 0, "unread": 0, "bad": 0})
        );
        assert_eq!(json["restarts"], serde_json::json!({"detector": 2}));
        assert_eq!(json["dropped"], serde_json::json!({"/recovered": 0}));
    }

    #[test]
    fn a_torn_report_is_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let whole = serde_json::to_string(&camera()).expect("serialises");
        std::fs::write(folder.path().join("a.json"), &whole).expect("written");
        std::fs::write(folder.path().join("b.json"), &whole[..40]).expect("written");
        std::fs::write(folder.path().join("c.tmp"), &whole).expect("written");
        assert_eq!(reports_so_far(folder.path()), [camera()]);
    }

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
        let detections = [("modulo".to_owned(), [].into()), ("recovered".to_owned(), classes)].into();
        let summary = Summary { detections, ..Summary::default() };
        let expected =
            "frames 0, engine none\ndetected on modulo: nothing\ndetected on recovered: 31 person, 2 car\n";
        assert_eq!(summary.to_string(), expected);
    }
}
