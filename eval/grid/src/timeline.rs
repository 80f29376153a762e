//! [`Timeline`]: the frames of a camera, whose time stamps go on over several sources.

use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::OnTopic;

/// Moves the time stamps of several sources so that each frame is later than the one before it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Timeline {
    pub frames: u64,
    /// Time stamp of the last frame, ns.
    last: Option<u64>,
    /// Time that is added to the stamps of the current source, ns.
    shift: u64,
}

impl Timeline {
    /// Counts a frame, and moves the stamps of its messages to `interval` after the frame before, if they are not later than that
    /// frame. Sources were recorded independently, and a repeated source starts again at its first stamp, but labels and
    /// images are matched by their stamps: no two frames may share a stamp. All later frames of the source are moved by
    /// the same time, so that the intervals within a source do not change.
    pub(crate) fn place(&mut self, out: &mut [OnTopic], interval: Duration) {
        self.frames += 1;
        let Some((_, first)) = out.first() else { return };
        // All messages of a frame carry the stamp of its image.
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
