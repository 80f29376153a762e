//! [`TraceFile`]: the spans of a node while it runs, as trace events of Chrome and Perfetto, one JSON object a line.
//!
//! The launcher joins the files of all nodes. Times are those of the monotonic clock, one axis for a machine.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use serde_json::json;

use crate::clock::{Clock, monotonic_ns};
use crate::launcher;
use crate::node::StepOutput;

/// Folder in which a node keeps its trace.
pub const TRACE_DIR: &str = "MODULO_TRACE_DIR";
/// Ending of the name of such a file.
pub const ENDING: &str = "trace";

/// Spans that wait for the disk at most; further ones are lost, and counted.
const WAITING: usize = 4096;
/// The spans are flushed when none has come for this time; a killed node loses at most the later ones.
const PAUSE: Duration = Duration::from_millis(20);

/// The place of a node on the way of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlowPoint {
    /// The frame was made here.
    Source,
    /// An image came, and an image went.
    Pass,
    /// An image came, and none went.
    End,
}

/// Something that took time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Name, such as `infer`.
    pub name: &'static str,
    /// Ticks of the node's clock at its begin, ns.
    pub begin: u64,
    /// Ticks at its end, ns.
    pub end: u64,
    /// Stamp of the frame that it belongs to.
    pub frame: Option<Time>,
    /// Where the frame is on its way, for the span that stands for the whole step.
    pub flow: Option<FlowPoint>,
}

/// The trace of one life of a node. Writing never waits for the disk.
pub struct TraceFile {
    spans: Option<SyncSender<Span>>,
    lost: Arc<AtomicU64>,
    writer: Option<JoinHandle<()>>,
}

impl TraceFile {
    /// Opens the trace of the node with this fully qualified name, if its launcher wants one; `clock` is the clock of its spans.
    /// A file that cannot be made is warned of, and the node runs without it.
    pub fn of_launch(node: &str, clock: &dyn Clock) -> Option<Self> {
        let folder = launcher::folder(TRACE_DIR)?;
        Self::create(&folder, node, clock)
            .inspect_err(|why| tracing::warn!("{}: {why}; {node} is left out of the trace", folder.display()))
            .ok()
    }

    fn create(folder: &Path, node: &str, clock: &dyn Clock) -> io::Result<Self> {
        // The process id tells the lives of a node apart.
        let file = launcher::file_of(folder, node, &format!("{}.{ENDING}", std::process::id()));
        let mut out = BufWriter::new(File::create(file)?);
        line(&mut out, &json!({ "node": node }))?;
        out.flush()?;
        let (spans, waiting) = sync_channel(WAITING);
        let lost = Arc::new(AtomicU64::new(0));
        let (counted, offset) = (lost.clone(), monotonic_ns().wrapping_sub(clock.ticks_ns()));
        let writer = thread::Builder::new().name("trace".into()).spawn(move || {
            if let Err(why) = write_all(&waiting, &mut out, &counted, offset) {
                tracing::warn!("the trace ends here: {why}");
            }
        })?;
        Ok(Self { spans: Some(spans), lost, writer: Some(writer) })
    }

    /// Adds the spans of a step from `begin` to `end` (ticks, ns) on `frame`, if it has one: for all of it, and for each stage.
    pub fn add_step(
        &self,
        (begin, end): (u64, u64),
        output: &StepOutput,
        frame: Option<Time>,
        flow: Option<FlowPoint>,
    ) {
        if frame.is_none() {
            return;
        }
        self.add(Span { name: "step", begin, end, frame, flow });
        for ((name, duration), begin) in output.stages.iter().zip(&output.begins) {
            self.add(Span { name, begin: *begin, end: begin + duration, frame, flow: None });
        }
    }

    /// Hands `span` to the writer; it is lost, and counted, when too many wait.
    pub fn add(&self, span: Span) {
        let sent = self.spans.as_ref().is_some_and(|spans| spans.try_send(span).is_ok());
        if !sent {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        // The closed channel ends the thread when it has written what waits.
        self.spans = None;
        if let Some(writer) = self.writer.take() {
            let _ = writer.join();
        }
    }
}

fn write_all(spans: &Receiver<Span>, out: &mut impl Write, lost: &AtomicU64, offset: u64) -> io::Result<()> {
    let (mut reported, mut flushed) = (0, true);
    loop {
        // A node without work has no span, and must not wake for its trace.
        let next = if flushed {
            spans.recv().map_err(|_| RecvTimeoutError::Disconnected)
        } else {
            spans.recv_timeout(PAUSE)
        };
        flushed = next.is_err();
        match &next {
            Ok(span) => write_span(out, span, offset)?,
            Err(_) => {
                let lost = lost.load(Ordering::Relaxed);
                if lost != std::mem::replace(&mut reported, lost) {
                    line(out, &json!({ "lost": lost }))?;
                }
                out.flush()?;
            }
        }
        if next == Err(RecvTimeoutError::Disconnected) {
            return Ok(());
        }
    }
}

/// Writes a span as a complete event, and its flow as an event of its own.
fn write_span(out: &mut impl Write, span: &Span, offset: u64) -> io::Result<()> {
    let us = |ns: u64| ns as f64 / 1000.0;
    let (ts, dur) = (us(span.begin.wrapping_add(offset)), us(span.end.saturating_sub(span.begin)));
    let frame = span.frame.map(|stamp| stamp.as_ns().to_string());
    line(
        out,
        &json!({ "name": span.name, "cat": "stage", "ph": "X", "ts": ts, "dur": dur, "args": { "frame": frame } }),
    )?;
    let (Some(flow), Some(frame)) = (span.flow, frame) else { return Ok(()) };
    let ph = match flow {
        FlowPoint::Source => "s",
        FlowPoint::Pass => "t",
        FlowPoint::End => "f",
    };
    // `bp: e` binds the end of a flow to the span around it and not to the next one.
    line(out, &json!({ "name": "frame", "cat": "frame", "ph": ph, "bp": "e", "id": frame, "ts": ts }))
}

fn line(out: &mut impl Write, value: &serde_json::Value) -> io::Result<()> {
    writeln!(out, "{value}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SystemClock;

    /// Tells of each flush.
    struct Flushes(std::sync::mpsc::Sender<()>);

    impl Write for Flushes {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            self.0.send(()).map_err(io::Error::other)
        }
    }

    #[test]
    fn spans_are_flushed_at_once_and_an_idle_node_sleeps() {
        let ((spans, waiting), (flushes, flushed)) = (sync_channel(9), std::sync::mpsc::channel());
        let writer = thread::spawn(move || write_all(&waiting, &mut Flushes(flushes), &AtomicU64::new(0), 0));
        for _ in 0..2 {
            spans.send(Span { name: "step", begin: 0, end: 1, frame: None, flow: None }).expect("it waits");
            flushed.recv().expect("the span is on the disk");
            assert!(flushed.recv_timeout(10 * PAUSE).is_err(), "nothing has come since");
        }
        drop(spans);
        writer.join().expect("no panic").expect("written");
    }

    #[test]
    fn spans_that_find_no_room_are_counted_and_the_others_are_whole_lines() {
        let folder = tempfile::tempdir().expect("a folder");
        let clock = SystemClock::default();
        let trace = TraceFile::create(folder.path(), "/car/unwrap", &clock).expect("a file");
        let count = 20 * WAITING;
        for _ in 0..count {
            let (begin, frame) = (clock.ticks_ns(), Some(Time::from_ns(7)));
            let flow = Some(FlowPoint::Pass);
            trace.add(Span { name: "step", begin, end: begin + 1500, frame, flow });
        }
        drop(trace);
        let file = format!("car.unwrap.{}.trace", std::process::id());
        let text = std::fs::read_to_string(folder.path().join(file)).expect("written");
        let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
        let lines: Vec<_> = lines.collect();
        assert_eq!(lines[0]["node"], "/car/unwrap");
        let of = |ph: &str| lines.iter().filter(|line| line["ph"] == ph).count();
        let lost = lines.iter().filter_map(|line| line["lost"].as_u64()).max().unwrap_or(0);
        assert_eq!((of("X") as u64 + lost, of("X")), (count as u64, of("t")));
        assert_eq!((&lines[1]["dur"], &lines[1]["args"]["frame"]), (&1.5.into(), &"7".into()));
    }
}
