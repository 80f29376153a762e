//! [`Recording`]: the last minute of a suite, as the messages that a browser would have got.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use modulo_middleware::parameter::client::ParameterClient;
use tokio::task::spawn_blocking;

use crate::graph::{NAMES, Session, has_room};
use crate::page;
use crate::protocol::{Event, GraphView, ParameterView};
use crate::watch::{Audience, LOOK, Subscriptions, Watch, done};

const KEPT_MS: f64 = 60_000.0;
/// Bytes that are kept: fewer seconds of large images.
const KEPT_BYTES: usize = 64 << 20;

#[derive(Default)]
pub(crate) struct Recording {
    /// Messages that hold until the next one of their kind: the graph, and the parameters of each node.
    lasting: BTreeMap<String, String>,
    passing: VecDeque<(f64, String)>,
    bytes: usize,
    /// Messages that were left out since each of them alone is larger than what is kept.
    pub too_large: usize,
}

impl Recording {
    fn note(&mut self, at_ms: f64, event: &Event) {
        let text = serde_json::to_string(event).expect("strings and numbers are JSON");
        match event {
            Event::Graph(_) => self.hold("", KEPT_BYTES, text),
            Event::Parameters { node, .. } => self.hold(node, KEPT_BYTES / NAMES, text),
            _ => self.keep(at_ms, text),
        }
    }

    /// Holds a message of at most `most` bytes until the next one of its kind. Nodes beyond the first 256 are left out.
    fn hold(&mut self, kind: &str, most: usize, text: String) {
        if text.len() > most {
            self.too_large += 1;
        } else if has_room(&self.lasting, kind) {
            self.lasting.insert(kind.to_owned(), text);
        }
    }

    fn note_images(&mut self, at_ms: f64, message: &[u8]) {
        self.keep(at_ms, format!("\"{}\"", STANDARD.encode(message)));
    }

    fn keep(&mut self, at_ms: f64, text: String) {
        if text.len() > KEPT_BYTES {
            if self.too_large == 0 {
                let (bytes, most) = (text.len() >> 20, KEPT_BYTES >> 20);
                let why =
                    format!("a moment of {bytes} MiB is left out of the recording, which holds {most} MiB");
                tracing::warn!("{why}");
                self.note(at_ms, &Event::Error(why));
            }
            self.too_large += 1;
            return;
        }
        self.bytes += text.len();
        self.passing.push_back((at_ms, text));
        while let Some((first_ms, first)) = self.passing.front()
            && (at_ms - first_ms > KEPT_MS || self.bytes > KEPT_BYTES)
        {
            self.bytes -= first.len();
            self.passing.pop_front();
        }
    }

    pub fn page(&self) -> String {
        let lasting = self.lasting.values().map(|text| format!("[0,{text}]"));
        let passing = self.passing.iter().map(|(at_ms, text)| format!("[{at_ms:.3},{text}]"));
        page::with_recording(&format!("[{}]", lasting.chain(passing).collect::<Vec<_>>().join(",\n")))
    }
}

/// Records without an end. Images are taken twice a second.
pub(crate) async fn record(session: Arc<Session>, recording: Arc<Mutex<Recording>>) {
    let watch = Watch::new(session.clone(), Audience::Page);
    let (subscribed, mut graph) = (Subscriptions::default(), GraphView::default());
    let mut look = tokio::time::interval(LOOK);
    let now_ms = || session.clock.now_ns() as f64 / 1e6;
    let lock = || recording.lock().unwrap_or_else(PoisonError::into_inner);
    let note = |events: Vec<Event>| events.iter().for_each(|event| lock().note(now_ms(), event));
    loop {
        tokio::select! {
            () = watch.news.notified() => note(watch.notices()),
            _ = look.tick() => {
                let (seen, _) = watch.look(&subscribed).await;
                let joined: Vec<String> =
                    seen.nodes.iter().filter(|node| !graph.nodes.contains(node)).cloned().collect();
                note(watch.events(&mut graph, seen));
                note(parameters(session.clone(), joined).await);
                watch.inbox().streams.watch(&graph.first);
                // One moment of each camera.
                while let Some(moment) = watch.next(&graph).await {
                    lock().note_images(moment.at_ms, &moment.message());
                }
                graph.first.iter().for_each(|topic| watch.inbox().streams.drawn(topic));
            }
        }
    }
}

/// Returns the parameters of nodes; those of a node that does not answer are left out.
async fn parameters(session: Arc<Session>, nodes: Vec<String>) -> Vec<Event> {
    let read = move |node: String| {
        let parameters = ParameterView::read_all(&ParameterClient::new(&session.transport, &node)).ok()?;
        Some(Event::Parameters { node, parameters })
    };
    done(spawn_blocking(move || nodes.into_iter().filter_map(read).collect())).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minute_is_kept_and_what_lasts() {
        let mut recording = Recording::default();
        recording.note(0.0, &Event::Graph(GraphView::default()));
        for second in 0..100 {
            recording.note(f64::from(second) * 1000.0, &Event::Error(format!("second {second}")));
        }
        let page = recording.page();
        assert!(page.contains("\"graph\"") && page.contains("second 99") && page.contains("second 39\""));
        assert!(!page.contains("second 38\""));
        // A moment that is too large took all others with it.
        for _ in 0..2 {
            recording.note_images(99_500.0, &vec![0; KEPT_BYTES * 3 / 4]);
        }
        let page = recording.page();
        assert!(page.contains("second 99") && page.contains("second 40\"") && page.len() < 1 << 20);
        for number in 0..2 * NAMES {
            let node = format!("/node_{number}");
            recording.note(99_600.0, &Event::Parameters { node, parameters: Vec::new() });
        }
        assert_eq!(recording.lasting.len(), NAMES, "nodes may be invented without end");
        assert_eq!((recording.too_large, page.matches("is left out of the recording").count()), (2, 1));
    }
}
