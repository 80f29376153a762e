//! [`Merge`]: the messages of several inputs, such as files, in one order of time. An input is opened only when its
//! first message may be next.

use super::storage::Cursor;
use super::{BagError, RawMessage};

/// Opens an input; `None` when no message of it is selected.
type OpenInput = Box<dyn FnOnce() -> Result<Option<Box<dyn Cursor>>, BagError> + Send>;

/// An input that is not open yet.
pub(super) struct MergeInput {
    /// No message of it is earlier, ns since the epoch.
    pub(super) start: u64,
    /// Opens the input.
    pub(super) open: OpenInput,
}

/// An input with its next message.
struct OpenedInput {
    /// Log time of `head`.
    time: u64,
    /// A message, or [`BagError::BadMessage`], behind which there are others.
    head: Result<RawMessage, BagError>,
    rest: Box<dyn Cursor>,
}

/// Several inputs as one.
pub(super) struct Merge {
    /// Inputs that are still closed, the earliest last.
    closed: Vec<MergeInput>,
    open: Vec<OpenedInput>,
    /// The error that ended an input; it comes after the message that was returned last.
    broken: Option<BagError>,
}

impl Merge {
    /// Merges `inputs`. Of messages with the same time, the one of the earlier input is first.
    pub(super) fn of(mut inputs: Vec<MergeInput>) -> Self {
        inputs.sort_by_key(|input| input.start);
        inputs.reverse();
        Self { closed: inputs, open: Vec::new(), broken: None }
    }

    /// Returns the open input whose message is next.
    fn earliest(&self) -> Option<usize> {
        (0..self.open.len()).min_by_key(|&i| self.open[i].time)
    }

    /// Keeps the input `rest` open at `index`, unless it is over.
    fn advance(&mut self, index: usize, mut rest: Box<dyn Cursor>) {
        match rest.next().transpose() {
            Some(Ok(message)) => {
                self.open.insert(index, OpenedInput { time: message.log_time, head: Ok(message), rest });
            }
            Some(Err(BagError::BadMessage { path, topic, log_time, why })) => {
                let head = Err(BagError::BadMessage { path, topic, log_time, why });
                self.open.insert(index, OpenedInput { time: log_time, head, rest });
            }
            Some(Err(why)) => self.broken = Some(why),
            None => {}
        }
    }

    /// Returns whether a closed input may have an earlier message than the open ones.
    fn must_open(&self) -> bool {
        let next = self.earliest().map(|i| self.open[i].time);
        self.closed.last().is_some_and(|input| next.is_none_or(|next| input.start < next))
    }
}

impl Cursor for Merge {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError> {
        while self.broken.is_none() && self.must_open() {
            let Some(input) = self.closed.pop() else { break };
            let Some(rest) = (input.open)()? else { continue };
            self.advance(self.open.len(), rest);
        }
        if let Some(why) = self.broken.take() {
            return Err(why);
        }
        let Some(index) = self.earliest() else { return Ok(None) };
        let OpenedInput { head, rest, .. } = self.open.remove(index);
        self.advance(index, rest);
        head.map(Some)
    }
}
