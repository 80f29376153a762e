//! [`BagReader`]: a `.mcap` file or a bag folder, its messages in log-time order.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file::{BagFile, FileMessages};
use super::{BagError, BagWarning, RawMessage, TopicCount, metadata};

/// An opened bag: what is in it is known, no message is read yet.
#[derive(Debug)]
pub struct BagReader {
    path: PathBuf,
    files: Vec<(PathBuf, Arc<BagFile>)>,
    ros_distro: Option<String>,
    warnings: Vec<BagWarning>,
}

/// Which messages are read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Names of topics; `None` is all of them.
    pub topics: Option<Vec<String>>,
    /// Messages from this log time on, ns since the epoch.
    pub start_ns: Option<u64>,
}

impl Selection {
    /// Just these topics.
    pub fn of<T: Into<String>>(topics: impl IntoIterator<Item = T>) -> Self {
        Self { topics: Some(topics.into_iter().map(Into::into).collect()), start_ns: None }
    }

    pub(super) fn has(&self, topic: &str) -> bool {
        self.topics.as_ref().is_none_or(|topics| topics.iter().any(|t| t == topic))
    }
}

impl BagReader {
    /// Opens a `.mcap` file, or a folder with `metadata.yaml` or `.mcap` files.
    /// A file without a summary, such as a truncated one, is scanned.
    ///
    /// # Errors
    /// [`BagError`] when there is no bag, or one that is not MCAP.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let mut warnings = Vec::new();
        let mut ros_distro = None;
        let (paths, ordered) = if !path.is_dir() {
            (vec![path.to_owned()], true)
        } else if path.join(metadata::FILE_NAME).is_file() {
            let metadata = metadata::read(&path.join(metadata::FILE_NAME))?;
            ros_distro = metadata.ros_distro;
            (metadata.relative_file_paths.iter().map(|name| path.join(name)).collect(), true)
        } else {
            warnings.push(BagWarning::NoMetadata { path: path.to_owned() });
            (mcap_files(path)?, false)
        };
        if paths.is_empty() {
            return Err(BagError::NoBag { path: path.to_owned() });
        }
        let mut files = Vec::new();
        for path in paths {
            let file = BagFile::open(&path)?;
            warnings.extend(file.warnings.iter().cloned());
            files.push((path, Arc::new(file)));
        }
        if !ordered {
            files.sort_by_key(|(_, file)| file.span());
        }
        Ok(Self { path: path.to_owned(), files, ros_distro, warnings })
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The MCAP files, in order.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(path, _)| path.as_path())
    }

    /// Size of all files, bytes.
    pub fn size(&self) -> u64 {
        self.files.iter().map(|(_, file)| file.size).sum()
    }

    /// The ROS distribution that `metadata.yaml` names.
    pub fn ros_distro(&self) -> Option<&str> {
        self.ros_distro.as_deref()
    }

    /// What this bag lacks; empty for a whole one.
    pub fn warnings(&self) -> &[BagWarning] {
        &self.warnings
    }

    /// First and last log time, ns since the epoch; `None` without messages.
    pub fn span(&self) -> Option<(u64, u64)> {
        let spans = self.files.iter().filter_map(|(_, file)| file.span());
        spans.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// All topics with their counts, in the order of their first appearance;
    /// files and channels with the same name and type are one topic.
    pub fn topics(&self) -> Vec<TopicCount> {
        let mut topics: Vec<TopicCount> = Vec::new();
        for counted in self.files.iter().flat_map(|(_, file)| file.topics()) {
            let same = |t: &&mut TopicCount| {
                t.topic.name == counted.topic.name && t.topic.type_name == counted.topic.type_name
            };
            match topics.iter_mut().find(same) {
                Some(known) => known.messages += counted.messages,
                None => topics.push(counted),
            }
        }
        topics
    }

    /// How many messages can be read.
    pub fn message_count(&self) -> u64 {
        self.topics().iter().map(|t| t.messages).sum()
    }

    /// The selected messages, in log-time order within each file, file by file.
    pub fn messages(&self, selection: &Selection) -> Messages {
        let files: Vec<_> = self.files.iter().rev().map(|(_, file)| Arc::clone(file)).collect();
        Messages { files, current: None, selection: selection.clone() }
    }
}

/// Messages of a bag; ends after the first error.
pub struct Messages {
    /// Files that are still to come, the next one last.
    files: Vec<Arc<BagFile>>,
    current: Option<FileMessages>,
    selection: Selection,
}

impl Messages {
    fn advance(&mut self) -> Result<Option<RawMessage>, BagError> {
        loop {
            if let Some(current) = &mut self.current
                && let Some(message) = current.next()?
            {
                return Ok(Some(message));
            }
            let Some(file) = self.files.pop() else { return Ok(None) };
            self.current = FileMessages::open(file, &self.selection)?;
        }
    }
}

impl Iterator for Messages {
    type Item = Result<RawMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = self.advance();
        if !matches!(next, Ok(Some(_))) {
            self.files.clear();
            self.current = None;
        }
        next.transpose()
    }
}

pub(super) fn is_mcap(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
}

/// The `.mcap` files of a folder, by name.
pub(super) fn mcap_files(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let io = |e| BagError::io(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_file() && is_mcap(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
