//! [`Merge`]: the messages of several parts, such as files, in one order of time.
//! A part is opened only when its first message may be next.

use super::storage::Cursor;
use super::{BagError, RawMessage};

/// Opens a part; `None` when nothing of it is wanted.
type OpenPart = Box<dyn FnOnce() -> Result<Option<Box<dyn Cursor>>, BagError> + Send>;

/// A part that is not open yet.
pub(super) struct Part {
    /// No message of it is earlier, ns since the epoch.
    pub(super) start: u64,
    /// Opens it.
    pub(super) open: OpenPart,
}

/// A part with its next message.
struct Open {
    head: RawMessage,
    rest: Box<dyn Cursor>,
}

/// Several parts as one.
pub(super) struct Merge {
    /// Parts that are still closed, the earliest last.
    closed: Vec<Part>,
    open: Vec<Open>,
    /// What comes after the message that was returned last.
    broken: Option<BagError>,
}

impl Merge {
    /// Of messages at the same time, that of the earlier one of `parts` is first.
    pub(super) fn of(mut parts: Vec<Part>) -> Self {
        parts.sort_by_key(|part| part.start);
        parts.reverse();
        Self { closed: parts, open: Vec::new(), broken: None }
    }

    /// The open part whose message is next.
    fn earliest(&self) -> Option<usize> {
        (0..self.open.len()).min_by_key(|&i| self.open[i].head.log_time)
    }

    /// Whether a closed part may have an earlier message than the open ones.
    fn must_open(&self) -> bool {
        let next = self.earliest().map(|i| self.open[i].head.log_time);
        self.closed.last().is_some_and(|part| next.is_none_or(|next| part.start < next))
    }
}

impl Cursor for Merge {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError> {
        if let Some(why) = self.broken.take() {
            return Err(why);
        }
        while self.must_open() {
            let Some(part) = self.closed.pop() else { break };
            let Some(mut rest) = (part.open)()? else { continue };
            if let Some(head) = rest.next()? {
                self.open.push(Open { head, rest });
            }
        }
        let Some(index) = self.earliest() else { return Ok(None) };
        let part = &mut self.open[index];
        Ok(Some(match part.rest.next() {
            Ok(Some(next)) => std::mem::replace(&mut part.head, next),
            Ok(None) => self.open.remove(index).head,
            // The message at hand is whole: it is lost no more than those before it.
            Err(why) => {
                self.broken = Some(why);
                self.open.remove(index).head
            }
        }))
    }
}
