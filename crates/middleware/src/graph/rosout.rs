//! `/rosout`: a node's log lines as `rcl_interfaces/msg/Log`.
//!
//! [`layer`] takes only the lines of the suite and not those of its libraries, so that publishing a line makes no other
//! line. A line waits in a bounded queue; when the queue is full the line is counted, and the node does not wait.

use std::fmt;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use modulo_msgs::rcl_interfaces::Log;
use modulo_msgs::std_msgs::Time;
use modulo_runtime::{Address, Clock, Message, MessageKind, NodeName, Topic};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use crate::driver::RunError;
use crate::graph::logger;
use crate::transport::queue::{Keep, Lane, Limit, Queue, Queued};
use crate::transport::{Guard, OnDrop, Publisher, Transport, TransportError};

/// Largest number of lines that wait for the transport. A late reader also gets so many lines.
const WAITING: usize = 1000;

impl Queued for Log {}

/// Takes log lines off the threads that write them.
pub struct RosoutLayer {
    lines: LogQueue,
    clock: Arc<dyn Clock>,
}

/// The lines that [`RosoutLayer`] took.
#[derive(Clone)]
pub struct LogQueue {
    queue: Arc<Queue<Log>>,
    lane: Lane,
}

/// Returns a layer for `tracing_subscriber`, and the queue in which its lines wait, stamped with the time of `clock`.
pub fn layer(clock: Arc<dyn Clock>) -> (RosoutLayer, LogQueue) {
    let queue = Arc::new(Queue::new(clock.clone(), Limit { messages: WAITING, bytes: usize::MAX }));
    let lines = LogQueue { lane: queue.open(Keep::All), queue };
    (RosoutLayer { lines: lines.clone(), clock }, lines)
}

impl<S: Subscriber> Layer<S> for RosoutLayer {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        if !metadata.target().starts_with("modulo") {
            return;
        }
        let mut text = EventText::default();
        event.record(&mut text);
        let line = Log {
            stamp: Time::from_ns(self.clock.now_ns()),
            level: level(*metadata.level()),
            name: String::new(),
            msg: text.message + &text.fields,
            file: metadata.file().unwrap_or_default().to_owned(),
            function: metadata.module_path().unwrap_or_default().to_owned(),
            line: metadata.line().unwrap_or_default(),
        };
        // A line for which there is no room is counted by the queue.
        self.lines.queue.push(self.lines.lane, line);
    }
}

fn level(level: Level) -> u8 {
    match level {
        Level::ERROR => Log::ERROR,
        Level::WARN => Log::WARN,
        Level::INFO => Log::INFO,
        _ => Log::DEBUG,
    }
}

/// An event's message, and its other fields behind it.
#[derive(Default)]
struct EventText {
    message: String,
    fields: String,
}

impl Visit for EventText {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            // The name of the logger already contains the node.
            "node" => {}
            name => self.fields += &format!(" {name}={value:?}"),
        }
    }
}

impl LogQueue {
    /// Publishes the lines as those of the node `node_name`, the waiting ones first, until the guard is dropped.
    pub fn publish(self, node_name: &NodeName, transport: &dyn Transport) -> Result<Guard, RunError> {
        let address = Address::resolve(node_name, &Topic::new("/rosout", MessageKind::Log))?;
        let publisher = transport.advertise(node_name, &address)?;
        let logger = logger::name_of(node_name);
        let queue = self.queue.clone();
        let thread = thread::Builder::new()
            .name("rosout".into())
            .spawn(move || self.publish_until_end(&logger, &*publisher))
            .map_err(|why| TransportError::new("thread of /rosout", why))?;
        let mut thread = Some(thread);
        // The thread sends the waiting lines first. It waits without a limit until the queue has ended.
        Ok(Box::new(OnDrop(move || {
            queue.end();
            let _ = thread.take().map(JoinHandle::join);
        })))
    }

    fn publish_until_end(&self, logger: &str, publisher: &dyn Publisher) {
        let mut reported = 0;
        while let Some(arrived) = self.queue.take(None) {
            let lost = self.queue.counts(self.lane).overflowed;
            // Reported before the next line, which is where the lines are missing.
            if lost > reported {
                let missing = lost - reported;
                let msg =
                    format!("{missing} lines are missing here: they came faster than they could be sent");
                let line = Log { stamp: arrived.item.stamp, level: Log::WARN, msg, ..Log::default() };
                put(publisher, logger, line);
                reported = lost;
            }
            put(publisher, logger, arrived.item);
        }
    }
}

/// Publishes a line. A line that the transport does not take is only on standard error.
fn put(publisher: &dyn Publisher, logger: &str, line: Log) {
    let _ = publisher.put(&Message::Log(Arc::new(Log { name: logger.to_owned(), ..line })));
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use tracing_subscriber::layer::SubscriberExt;

    use super::*;
    use crate::transport::Incoming;
    use crate::transport::local::LocalTransport;
    use modulo_runtime::ManualClock;

    /// What `write` logs, as it is on `/rosout` of `/car/eye`.
    fn published(write: impl FnOnce()) -> Vec<Arc<Log>> {
        let (layer, queue) = layer(Arc::new(ManualClock::at(5_000_000_007)));
        tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), write);
        let transport = LocalTransport::default();
        let node_name = NodeName::new("eye", "/car", &[]).expect("valid");
        let address = Address::resolve(&node_name, &Topic::new("/rosout", MessageKind::Log)).expect("a name");
        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let _subscription = transport.subscribe(&node_name, &address, deliver).expect("local");
        drop(queue.publish(&node_name, &transport).expect("local"));
        arrived
            .try_iter()
            .filter_map(|incoming| match incoming {
                Incoming::Message(Message::Log(log)) => Some(log),
                _ => None,
            })
            .collect()
    }

    #[test]
    fn a_line_is_published_with_what_ros_knows_of_it() {
        let line = line!() + 2;
        let logs = published(|| {
            tracing::warn!(node = %"/car/eye", topic = "/modulo", "skipped: {}", "short");
            tracing::debug!("deep");
            tracing::info!(target: "zenoh::net", "the carrier's own");
        });
        let [warned, deep] = &logs[..] else { panic!("two lines: {logs:?}") };
        assert_eq!((warned.level, warned.msg.as_str()), (Log::WARN, "skipped: short topic=\"/modulo\""));
        assert_eq!((warned.name.as_str(), warned.stamp), ("car.eye", Time { sec: 5, nanosec: 7 }));
        assert!(warned.file.ends_with("rosout.rs") && warned.function.contains("rosout"), "{warned:?}");
        assert_eq!(warned.line, line);
        assert_eq!((deep.level, deep.msg.as_str()), (Log::DEBUG, "deep"));
    }

    #[test]
    fn too_many_lines_are_counted_and_nobody_waits() {
        let logs = published(|| (0..WAITING + 7).for_each(|number| tracing::info!("{number}")));
        assert_eq!(logs.len(), WAITING + 1);
        assert_eq!((logs[0].level, logs[0].msg.starts_with("7 lines")), (Log::WARN, true), "{:?}", logs[0]);
        assert_eq!(logs[WAITING].msg, (WAITING - 1).to_string());
    }
}
