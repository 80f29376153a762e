//! [`Storage`]: one file of a bag in any form. The first bytes of a file determine its form. [`Merge`] reads several as
//! one.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{BagError, BagWarning, Extra, RawMessage, TopicCount};
use crate::FileError;

/// File name extensions of bags. Those of ROS 1 are among them, so that their error names the remedy.
const EXTENSIONS: [&str; 3] = ["mcap", "db3", "bag"];

/// A choice of messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Names of topics; `None` is all of them.
    pub topics: Option<Vec<String>>,
    /// Messages from this log time on, ns since the epoch.
    pub start_ns: Option<u64>,
}

impl Selection {
    /// Selects these topics.
    pub fn of<T: Into<String>>(topics: impl IntoIterator<Item = T>) -> Self {
        Self { topics: Some(topics.into_iter().map(Into::into).collect()), start_ns: None }
    }

    /// Returns whether the topic called `topic` is selected.
    pub fn has(&self, topic: &str) -> bool {
        self.topics.as_ref().is_none_or(|topics| topics.iter().any(|t| t == topic))
    }
}

#[derive(Debug)]
pub(super) struct FileSummary {
    /// Name of the storage in rosbag2.
    pub(super) id: &'static str,
    /// Size in bytes.
    pub(super) size: u64,
    /// First and last log time, ns since the epoch; `None` without messages.
    pub(super) span: Option<(u64, u64)>,
    /// The topics with their counts, in the order of the file.
    pub(super) topics: Vec<TopicCount>,
    /// What the file holds beside its messages, in its order.
    pub(super) extras: Vec<Extra>,
    /// Problems of the file.
    pub(super) warnings: Vec<BagWarning>,
}

/// An open file with a known index.
pub(super) trait Storage: Debug + Send + Sync {
    fn summary(&self) -> &FileSummary;

    /// Returns the selected messages. The file is not opened when no topic of it is selected.
    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Cursor, BagError>;
}

/// A message, or the report of one that is left out; any other error ends the messages.
pub(super) type Item = Result<RawMessage, BagError>;

pub(super) type Cursor = Box<dyn Iterator<Item = Item> + Send>;

/// Returns whether `path` is called as a file of a bag is, compressed or not.
pub(super) fn is_storage(path: &Path) -> bool {
    let uncompressed = decompressed(path);
    let extension = uncompressed.as_deref().unwrap_or(path).extension();
    extension.is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Returns the name that the compressed file `path` has without its compression.
pub(super) fn decompressed(path: &Path) -> Option<PathBuf> {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zstd")).then(|| path.with_extension(""))
}

/// Returns the files of a bag in `folder`, by name. One that is there without its compression is not read twice.
pub(super) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let io = |e| FileError::new(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_file() && is_storage(&path) && !decompressed(&path).is_some_and(|path| path.exists()) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

pub(super) type OpenInput = Box<dyn FnOnce() -> Result<Cursor, BagError> + Send>;

/// The time of the start of an input, ns since the epoch, before which it has no message; and the function that opens it.
pub(super) type MergeInput = (u64, OpenInput);

enum Input {
    Closed(OpenInput),
    /// A message, or what is in its place, and what is behind it.
    Open(Item, Cursor),
}

/// The messages of several inputs, such as files, in one order of time. An input is opened only when its first message
/// may be next. The messages end after the first error that is not [`BagError::LeftOut`].
///
/// Each input has the time of what comes next in it, whether it is closed, and its place by the start: one that is closed may wait for an open
/// one of the same time, since its first message is not earlier.
pub struct Merge(BTreeMap<(u64, bool, usize), Input>);

impl Merge {
    /// Merges `inputs`. Of messages with the same time, the one of the earlier input is first.
    pub(super) fn of(mut inputs: Vec<MergeInput>) -> Self {
        inputs.sort_by_key(|(start, _)| *start);
        let closed = |(place, (start, open)): (_, MergeInput)| ((start, true, place), Input::Closed(open));
        Self(inputs.into_iter().enumerate().map(closed).collect())
    }

    /// Keeps the rest of an input open, unless it is over. An error comes as soon as it is known.
    fn advance(&mut self, place: usize, mut rest: Cursor) {
        let Some(head) = rest.next() else { return };
        let time = head.as_ref().map_or(0, |message| message.log_time);
        self.0.insert((time, false, place), Input::Open(head, rest));
    }
}

impl Iterator for Merge {
    type Item = Item;

    fn next(&mut self) -> Option<Item> {
        loop {
            let ((.., place), input) = self.0.pop_first()?;
            let (head, rest) = match input {
                Input::Open(head, rest) => (head, Some(rest)),
                Input::Closed(open) => match open() {
                    Ok(rest) => {
                        self.advance(place, rest);
                        continue;
                    }
                    Err(why) => (Err(why), None),
                },
            };
            if head.as_ref().is_err_and(|why| !matches!(why, BagError::LeftOut(_))) {
                // The position in the input is unknown.
                self.0.clear();
            } else {
                rest.into_iter().for_each(|rest| self.advance(place, rest));
            }
            return Some(head);
        }
    }
}
