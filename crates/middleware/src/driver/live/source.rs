//! The loop of a source: one frame each period, or at the pace of its readers ([`Pacing`]).

use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::{Address, Clock, Flow, Message, Trigger, Urgency};

use super::{GRAPH_GLANCE, IDLE, Live, LiveEvent, LiveOutput, REQUESTS, nanoseconds};
use crate::driver::RunError;
use crate::driver::pacing::{Pacing, ack_topic, has_watcher};
use crate::transport::Guard;
use crate::transport::queue::{Keep, Lane};

/// The longest time by which a period that has become shorter waits for the readers of the last frame.
const OVERLAP: Duration = Duration::from_secs(1);

/// When the frames of a source are due, in ticks of the clock.
struct Schedule {
    /// When the next frame is due.
    due: u64,
    /// When the last one was due.
    last: Option<u64>,
    /// The period of the source when `due` was decided.
    period: Option<Duration>,
}

impl Schedule {
    /// Goes on to the frame after the one that was due, at the ticks `now`.
    fn next(&mut self, period: Option<Duration>, now: u64) {
        self.last = Some(self.due);
        self.change(period, now);
    }

    /// Plans the next frame anew with another period. A shorter one holds for the frame after the next one, or after
    /// [`OVERLAP`]: readers may still work on the last frame.
    fn change(&mut self, period: Option<Duration>, now: u64) {
        let before = std::mem::replace(&mut self.period, period).map(|before| before.min(OVERLAP));
        let nanoseconds = |period: Option<Duration>| period.map_or(0, nanoseconds);
        if let Some(last) = self.last {
            self.due = next_due(last, nanoseconds(period).max(nanoseconds(before)), now);
        }
    }
}

impl Live<'_> {
    /// Sends one frame each period, or with a period of zero as soon as every reader has taken the last frame. The
    /// period may change between two frames. Returns when the node is done, or has become a listener.
    pub(super) fn run_source(&mut self) -> Result<(), RunError> {
        let mut schedule = Schedule { due: self.first_due(), last: None, period: self.node.period() };
        // The subscription to the acknowledgements of readers, which is held only while the period is zero.
        let mut readers: Option<(Guard, Lane)> = None;
        loop {
            let (period, paced) = (self.node.period(), self.node.period() == Some(Duration::ZERO));
            if paced != readers.is_some() {
                self.change_pacing(&mut readers)?;
                // Readers send nothing before they have found out that this node listens.
                let listening = self.time.ticks_ns() + nanoseconds(self.transport.settling());
                schedule.due = schedule.due.max(listening);
            }
            if period.is_none() {
                return Ok(());
            }
            self.wait_until(schedule.due)?;
            let is_changed = self.node.period() != period;
            if self.stop.urgency() != Urgency::None {
                return Ok(());
            } else if is_changed {
                // A request has changed the pace of the frame that is waited for.
                schedule.change(self.node.period(), self.time.ticks_ns());
            } else if !self.enabled {
                schedule.due = self.time.ticks_ns() + nanoseconds(IDLE);
            } else if self.send_frame(paced)? == Flow::Done {
                return Ok(());
            } else {
                schedule.next(self.node.period(), self.time.ticks_ns());
            }
        }
    }

    /// Makes the next frame and sends it, `paced` when all readers have taken the last one. Returns whether it was the last.
    fn send_frame(&mut self, paced: bool) -> Result<Flow, RunError> {
        let changes = self.settings.changes;
        let (flow, messages) = self.step(Trigger::Tick, "source", None, None)?;
        // The step has made the next frame meanwhile; only its sending waits.
        if paced {
            self.wait_for_readers()?;
            if let Some((stamp, topics)) = images(&messages, &self.outputs) {
                self.pacing.sent(stamp, topics);
            }
        }
        self.send_all(&messages);
        // A request that was answered while readers were waited for may have given the node another source.
        Ok(if self.settings.changes == changes { flow } else { Flow::Continue })
    }

    /// Returns when the first frame is due. A node that watches the graph has found all publishers by then, those of nodes that this
    /// one has waited for, too. Without such a node, only the graph must be known.
    fn first_due(&self) -> u64 {
        let (now, settling) = (self.time.ticks_ns(), nanoseconds(self.transport.settling()));
        if has_watcher(self.transport) { now + settling } else { now.max(self.advertised_ns + settling) }
    }

    /// Begins to listen to the readers, or ends it if `readers` holds the subscription.
    fn change_pacing(&mut self, readers: &mut Option<(Guard, Lane)>) -> Result<(), RunError> {
        match readers.take() {
            Some((_, lane)) => drop(self.queue.close(lane)),
            // Readers acknowledge frames only while a source listens, since it costs them a message for each frame.
            None => *readers = Some(self.listen_to_readers()?),
        }
        // A frame of the time before says nothing about the readers at the new pace.
        self.pacing = Pacing::default();
        Ok(())
    }

    fn listen_to_readers(&self) -> Result<(Guard, Lane), RunError> {
        let (queue, lane) = (self.queue.clone(), self.queue.open(Keep::Last(REQUESTS)));
        let deliver = Box::new(move |incoming| drop(queue.push(lane, LiveEvent::Ack(incoming))));
        let address = Address::resolve(&self.node_name, &ack_topic())?;
        Ok((self.transport.subscribe(&self.node_name, &address, deliver)?, lane))
    }

    /// Handles at most one event that waits, and all that come until `due`, or until one has changed the period.
    fn wait_until(&mut self, due: u64) -> Result<(), RunError> {
        let period = self.node.period();
        loop {
            // With no time left it still takes one event that waits, so that a fast source answers requests as well.
            let patience = Duration::from_nanos(due.saturating_sub(self.time.ticks_ns()));
            if let Some(arrived) = self.queue.take(Some(patience.min(IDLE))) {
                self.handle(arrived)?;
            }
            self.report_when_due();
            let is_over = self.time.ticks_ns() >= due || self.node.period() != period;
            if is_over || self.stop.urgency() != Urgency::None {
                return Ok(());
            }
        }
    }

    fn wait_for_readers(&mut self) -> Result<(), RunError> {
        // A frame that is ready when the node is disabled stays until the node goes on.
        while self.stop.urgency() == Urgency::None
            && (!self.enabled || self.pacing.holds(self.transport, &self.time))
        {
            let patience = if self.enabled { GRAPH_GLANCE } else { IDLE };
            if let Some(arrived) = self.queue.take(Some(patience)) {
                self.handle(arrived)?;
            }
            // A source that waits long still shows that it is alive.
            self.report_when_due();
        }
        Ok(())
    }
}

/// Returns the time of the frame after the one due at `due`, in ns: the first multiple of `period` after it that is not
/// past. As a timer of ROS 2 does, a late source leaves frames out; it does not catch up in a burst.
fn next_due(due: u64, period: u64, now: u64) -> u64 {
    let late = now.saturating_sub(due);
    due + period * late.div_ceil(period.max(1)).max(1)
}

/// Returns the stamp of the first image among `messages`, and the topics of all images; `None` without an image.
pub(super) fn images(messages: &[(usize, Message)], outputs: &[LiveOutput]) -> Option<(Time, Vec<String>)> {
    let is_image = |message: &Message| matches!(message, Message::Image(_) | Message::CompressedImage(_));
    let images = || messages.iter().filter(|(_, message)| is_image(message));
    let stamp = images().next()?.1.stamp();
    let topic =
        |(output, message): &(usize, Message)| Some(outputs.get(*output)?.route(message.kind()).0.to_owned());
    Some((stamp, images().filter_map(topic).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_source_leaves_frames_out() {
        assert_eq!(next_due(1000, 100, 1000), 1100, "on time");
        assert_eq!(next_due(1000, 100, 1099), 1100, "late, but not for the next one");
        assert_eq!(next_due(1000, 100, 1100), 1100);
        assert_eq!(next_due(1000, 100, 1351), 1400, "two frames are left out");
        assert_eq!(next_due(1000, 0, 1351), 1000, "with no period, the next frame is due at once");
    }

    const MS: u64 = 1_000_000;

    #[test]
    fn frames_are_due_by_the_period_that_held_before_them() {
        let period = |ms| Some(Duration::from_millis(ms));
        let mut schedule = Schedule { due: 10_000 * MS, last: None, period: period(5000) };
        schedule.change(period(1000), 9000 * MS);
        assert_eq!(schedule.due, 10_000 * MS, "the first frame waits for the graph, whatever its period is");
        schedule.next(period(1000), 10_200 * MS);
        assert_eq!(schedule.due, 11_000 * MS);
        schedule.next(period(100), 11_000 * MS);
        assert_eq!(schedule.due, 12_000 * MS, "a shorter period holds after the next frame");
        schedule.next(period(100), 12_350 * MS);
        assert_eq!(schedule.due, 12_400 * MS, "a late source leaves frames out");
        schedule.next(period(5000), 12_400 * MS);
        schedule.change(period(100), 12_500 * MS);
        assert_eq!(schedule.due, 13_400 * MS, "a long period is not waited for");
    }
}
