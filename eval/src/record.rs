//! A lockstep run as a bag: the same frames and parameters give the same bytes.

use std::time::Duration;

use modulo_bags::bag::{BagTopic, BagWriter};
use modulo_msgs::std_msgs::Time;
use modulo_runtime::Topic;
use modulo_runtime::clock::nanos;
use modulo_runtime::driver::lockstep::OnTopic;

use crate::EvalError;

/// The stamps of a run over several sources: each frame is later than the one before it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Timeline {
    /// Stamp of the last frame, ns.
    last: Option<u64>,
    /// By how much the stamps of the present source are moved, ns.
    shift: u64,
}

impl Timeline {
    /// Moves the stamps of a frame's messages to `interval` after the frame before, where they are not later than
    /// that. Sources were recorded independently of each other, and one that is repeated begins again at its first
    /// stamp; labels and images find each other by their stamps, so that no two frames may share one. All frames
    /// after a moved one move by the same time: the times between the frames of a source stay.
    pub(crate) fn place(&mut self, out: &mut [OnTopic], interval: Duration) {
        let Some((_, first)) = out.first() else { return };
        let stamp = first.stamp().as_ns();
        if let Some(last) = self.last.filter(|last| stamp.saturating_add(self.shift) <= *last) {
            self.shift = last.saturating_add(nanos(interval)) - stamp;
        }
        self.last = Some(stamp.saturating_add(self.shift));
        if self.shift > 0 {
            for (_, message) in out {
                message.set_stamp(Time::from_ns(message.stamp().as_ns().saturating_add(self.shift)));
            }
        }
    }
}

/// Writes what came out on `topics`; both times are the message's own stamp.
pub(crate) fn record(recorder: &mut BagWriter, out: &[OnTopic], topics: &[String]) -> Result<(), EvalError> {
    for (topic, message) in out.iter().filter(|(topic, _)| topics.contains(topic)) {
        let bytes = message.encode()?;
        let stamp = message.stamp().as_ns();
        let kind = message.kind();
        let bag_topic = BagTopic::new(topic, kind.type_name(), Topic::new(topic, kind).qos);
        recorder.record(&bag_topic, stamp, stamp, &bytes)?;
    }
    Ok(())
}
