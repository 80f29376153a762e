//! [`join`]: the traces of all nodes of a launch as one file of trace events, which Perfetto and Chrome show.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

use modulo_runtime::output;
use modulo_runtime::trace::ENDING;
use serde_json::{Value, json};

use crate::{LaunchError, files_in};

/// The content of a joined trace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceCounts {
    /// Nodes.
    pub nodes: usize,
    /// Spans of all nodes.
    pub spans: u64,
    /// Spans that found no room on their way to the disk.
    pub lost: u64,
}

impl fmt::Display for TraceCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} spans of {} nodes, {} spans were lost", self.spans, self.nodes, self.lost)
    }
}

/// The first bytes of the file of a trace.
pub const TRACE_BEGIN: &str = "{\"displayTimeUnit\": \"ms\", \"traceEvents\": [\n";

/// Writes the traces in `folder` into `out`: a node is a process of the trace, each of its lives a thread.
///
/// # Errors
/// [`LaunchError::File`] when a file cannot be read or written.
pub fn join(folder: &Path, out: &Path) -> Result<TraceCounts, LaunchError> {
    output::replace_with(out, |joined| write_all(folder, joined)).map_err(|why| LaunchError::file(out, why))
}

fn write_all(folder: &Path, joined: &mut dyn Write) -> io::Result<TraceCounts> {
    joined.write_all(TRACE_BEGIN.as_bytes())?;
    let (mut counts, mut lives) = (TraceCounts::default(), BTreeMap::<String, (usize, usize)>::new());
    let mut comma = "";
    let mut write = |event: &Value| -> io::Result<()> {
        write!(joined, "{comma}{event}")?;
        comma = ",\n";
        Ok(())
    };
    for file in files_in(folder)?.iter().filter(|file| file.extension().is_some_and(|e| e == ENDING)) {
        let mut lines = events(file)?;
        let Some(node) = lines.next().and_then(|head| head["node"].as_str().map(str::to_owned)) else {
            continue;
        };
        let next = lives.len() + 1;
        let (pid, life) = lives.entry(node.clone()).or_insert((next, 0));
        *life += 1;
        let (pid, tid) = (*pid, *life);
        for (name, value) in [("process_name", node), ("thread_name", format!("life {tid}"))] {
            write(&json!({ "name": name, "ph": "M", "pid": pid, "tid": tid, "args": { "name": value } }))?;
        }
        let mut lost = 0;
        for mut event in lines {
            lost = event["lost"].as_u64().unwrap_or(lost);
            if event["ph"].is_null() {
                continue;
            }
            counts.spans += u64::from(event["ph"] == "X");
            (event["pid"], event["tid"]) = (pid.into(), tid.into());
            write(&event)?;
        }
        counts.lost += lost;
    }
    joined.write_all(b"\n]}\n")?;
    counts.nodes = lives.len();
    Ok(counts)
}

/// Returns the lines of the trace file of a node. The last line of a node that was killed may be cut, and is left out.
fn events(file: &Path) -> io::Result<impl Iterator<Item = Value> + use<>> {
    let lines = BufReader::new(File::open(file)?).lines();
    Ok(lines.map_while(Result::ok).filter_map(|line| serde_json::from_str(&line).ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_killed_node_keeps_its_spans_and_each_life_is_a_thread() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
        let span = r#"{"name": "step", "ph": "X", "ts": 1.5, "dur": 2.0}"#;
        write("camera.9.trace", &format!("{{\"node\": \"/camera\"}}\n{span}\n{{\"lost\": 3}}\n"));
        write("unwrap.1.trace", &format!("{{\"node\": \"/unwrap\"}}\n{span}\n{}", &span[..20]));
        write("unwrap.2.trace", &format!("{{\"node\": \"/unwrap\"}}\n{span}\n"));
        write("unwrap.3.json", "{}");
        write("x.4.trace", "");
        let out = folder.path().join("all.json");
        assert_eq!(join(folder.path(), &out).expect("joined"), TraceCounts { nodes: 2, spans: 3, lost: 3 });
        let all: Value =
            serde_json::from_str(&std::fs::read_to_string(&out).expect("written")).expect("JSON");
        let events = all["traceEvents"].as_array().expect("events");
        let spans: Vec<_> = events.iter().filter(|event| event["ph"] == "X").collect();
        let places: Vec<_> = spans.iter().map(|span| (span["pid"].as_u64(), span["tid"].as_u64())).collect();
        assert_eq!(places, [(Some(1), Some(1)), (Some(2), Some(1)), (Some(2), Some(2))]);
    }
}
