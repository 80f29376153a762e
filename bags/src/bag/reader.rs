//! [`BagReader`]: a file or a bag folder, its messages in log-time order, and [`BagInfo`], its content in words.

use std::collections::HashSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use modulo_runtime::clock::utc;
use modulo_runtime::embedded::locate;

use super::metadata::{self, Metadata};
use super::storage::{self, Merge, OpenInput, Storage};
use super::{BagError, BagWarning, Extra, ExtraKind, Selection, TopicCount};
use crate::FileError;

/// An open bag: its index is known, and no message has been read yet.
///
/// ```
/// use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, Selection};
/// use modulo_runtime::Qos;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("bag");
/// let mut writer = BagWriter::create(&path, Compression::Zstd)?;
/// let topic = writer.topic(&BagTopic::new("/log", "std_msgs/msg/String", Qos::Results))?;
/// writer.write(topic, 7, 7, &[0, 1, 0, 0, 1, 0, 0, 0, 0])?;
/// writer.finish()?;
///
/// let bag = BagReader::open(&path)?;
/// let times: Vec<u64> = bag.messages(&Selection::default()).map(|m| m.map(|m| m.log_time)).collect::<Result<_, _>>()?;
/// assert_eq!(times, [7]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct BagReader {
    path: PathBuf,
    files: Vec<(PathBuf, Arc<dyn Storage>)>,
    /// The content of `metadata.yaml`, empty where it cannot be used.
    pub(super) metadata: Metadata,
    warnings: Vec<BagWarning>,
}

impl BagReader {
    /// Opens a file (MCAP, rosbag2's SQLite), or a folder with `metadata.yaml` or with such files. An MCAP file
    /// without a summary, such as a truncated one, is scanned. A file of a folder that cannot be read is left out. `bags/samples/tunnel`
    /// is the sample of the suite where nothing lies there.
    ///
    /// # Errors
    /// [`BagError`] when there is no bag, or one in a form that is not read.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let path = &locate(path).map_err(|why| FileError::new(path, why))?;
        let mut warnings = Vec::new();
        let metadata = metadata_of(path, &mut warnings)?;
        let paths = match &metadata {
            Some(metadata) => listed(path, metadata, &mut warnings)?,
            None if path.is_dir() => storage::files_in(path)?,
            None => vec![path.to_owned()],
        };
        let (mut files, mut unread) = (Vec::new(), Vec::new());
        for path in paths {
            match super::open(&path) {
                Ok(file) => files.push((path, file)),
                Err(why) => unread.push(why),
            }
        }
        if files.is_empty() {
            let why = "no bag here, a metadata.yaml or a .mcap or .db3 file is needed".to_owned();
            return Err(unread.into_iter().next().unwrap_or(BagError::File(path.to_owned(), why)));
        }
        warnings.extend(unread.iter().map(|why| BagWarning::Part(why.to_string())));
        warnings.extend(files.iter().flat_map(|(_, file)| file.summary().warnings.iter().cloned()));
        // Files without messages have no start and must not come first.
        files.sort_by_key(|(_, file)| file.summary().span.map_or(u64::MAX, |(start, _)| start));
        let is_described = metadata.is_some();
        let metadata = metadata.unwrap_or_default();
        let mut bag = Self { path: path.to_owned(), files, metadata, warnings };
        if is_described {
            bag.compare();
        }
        Ok(bag)
    }

    /// Notes where the metadata contradict the files.
    fn compare(&mut self) {
        let (metadata, mut contradictions) = (&self.metadata, Vec::new());
        let (stated, found) = (&metadata.storage_identifier, self.storage_id());
        if stated != found {
            contradictions.push(format!("its storage_identifier is '{stated}', its files are {found}"));
        }
        if metadata.compression_mode.eq_ignore_ascii_case("file") {
            contradictions.push("its compression_mode is 'file', its files are not compressed".to_owned());
        }
        let count = self.message_count();
        // Where messages are missing, their number is no contradiction.
        let is_whole = !self.warnings.iter().any(BagWarning::is_loss);
        if let Some(stated) = metadata.message_count.filter(|stated| is_whole && *stated != count) {
            contradictions.push(format!("its message_count is {stated}, its files have {count} messages"));
        }
        let path = self.path.join(metadata::FILE_NAME);
        self.warnings.extend(contradictions.into_iter().map(|why| BagWarning::Remark(path.clone(), why)));
    }

    /// Returns the path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the storage's name in rosbag2: `mcap` or `sqlite3`.
    pub fn storage_id(&self) -> &'static str {
        self.files.first().map_or("mcap", |(_, file)| file.summary().id)
    }

    /// Returns the files, by their first message.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(path, _)| path.as_path())
    }

    /// Returns what the files hold beside their messages, such as attachments, each with its file.
    pub fn extras(&self) -> impl Iterator<Item = (&Path, &Extra)> {
        self.files.iter().flat_map(|(path, file)| file.summary().extras.iter().map(|extra| (&**path, extra)))
    }

    /// Returns the problems of this bag; the list is empty for a complete one.
    pub fn warnings(&self) -> &[BagWarning] {
        &self.warnings
    }

    /// Returns the first and last log time, ns since the epoch; `None` without messages.
    pub fn span(&self) -> Option<(u64, u64)> {
        let spans = self.files.iter().filter_map(|(_, file)| file.summary().span);
        spans.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Returns all topics with their counts, in the order of their first appearance; files and channels with the same
    /// name and type are one topic.
    pub fn topics(&self) -> Vec<TopicCount> {
        let mut topics: Vec<TopicCount> = Vec::new();
        for counted in self.files.iter().flat_map(|(_, file)| &file.summary().topics) {
            // A topic with two types stays two topics: its messages cannot be read as one.
            let same = |t: &&mut TopicCount| {
                t.topic.name == counted.topic.name && t.topic.type_name == counted.topic.type_name
            };
            match topics.iter_mut().find(same) {
                Some(known) => known.messages = known.messages.saturating_add(counted.messages),
                None => topics.push(counted.clone()),
            }
        }
        topics
    }

    /// Returns how many messages can be read.
    pub fn message_count(&self) -> u64 {
        self.topics().iter().map(|t| t.messages).fold(0, u64::saturating_add)
    }

    /// Returns the selected messages in log-time order, over all files.
    pub fn messages(&self, selection: &Selection) -> Merge {
        let from = selection.start_ns.unwrap_or(0);
        let inputs = self.files.iter().filter_map(|(_, file)| {
            // A file that ends before the start is never opened.
            let (start, _) = file.summary().span.filter(|(_, end)| *end >= from)?;
            let (file, selection) = (Arc::clone(file), selection.clone());
            let open: OpenInput = Box::new(move || file.messages(&selection));
            Some((start, open))
        });
        Merge::of(inputs.collect())
    }
}

/// Returns the `metadata.yaml` of the folder `path`. A missing or unreadable one is only a warning, since the files
/// contain all necessary information.
fn metadata_of(path: &Path, warnings: &mut Vec<BagWarning>) -> Result<Option<Metadata>, BagError> {
    if !path.is_dir() {
        return Ok(None);
    }
    match metadata::read(&path.join(metadata::FILE_NAME)) {
        Ok(metadata) => return Ok(Some(metadata)),
        Err(BagError::Metadata(path, why)) => warnings.push(unused_metadata(path, &why)),
        // Other errors of the system, such as a missing permission, are not taken for a missing file.
        Err(BagError::Io(why)) if why.source.kind() == std::io::ErrorKind::NotFound => {
            let why = "no metadata.yaml, all files are read by their start time".to_owned();
            warnings.push(BagWarning::Remark(path.to_owned(), why));
        }
        Err(other) => return Err(other),
    }
    Ok(None)
}

/// Returns the warning of the `metadata.yaml` at `path` that cannot be used.
fn unused_metadata(path: PathBuf, why: &str) -> BagWarning {
    BagWarning::Remark(path, format!("{why}; all files of its folder are read by their start time"))
}

/// Returns the files of the bag `folder` that `metadata` lists, each of them once.
fn listed(
    folder: &Path,
    metadata: &Metadata,
    warnings: &mut Vec<BagWarning>,
) -> Result<Vec<PathBuf>, BagError> {
    let own = folder.join(metadata::FILE_NAME);
    let present = storage::files_in(folder)?;
    let (mut paths, mut known) = (Vec::new(), HashSet::new());
    for name in &metadata.relative_file_paths {
        let path = place(folder, name);
        if known.insert(canonical(&path)) {
            paths.push(path);
        } else {
            let why = format!("'{name}' is listed more than once, and read once");
            warnings.push(BagWarning::Remark(own.clone(), why));
        }
    }
    if !present.is_empty() && !paths.iter().any(|path| path.exists()) {
        warnings.push(unused_metadata(own, "no file that it lists is here"));
        return Ok(present);
    }
    for path in present.iter().filter(|path| !known.contains(&canonical(path))) {
        let why = "is not listed in metadata.yaml; without metadata.yaml all files of a folder are read";
        warnings.push(BagWarning::Part(format!("{}: {why}", path.display())));
    }
    Ok(paths)
}

/// Returns the one path of a file that several paths may lead to.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// Returns the path of the file that the metadata calls `name`. Before version 4 the name begins with that of the
/// folder; and a file that was compressed may be unpacked.
fn place(folder: &Path, name: &str) -> PathBuf {
    let given = folder.join(name);
    let listed = storage::decompressed(&given).filter(|path| path.exists()).unwrap_or(given);
    let bare = listed.file_name().map(|name| folder.join(name));
    bare.filter(|bare| !listed.exists() && bare.exists()).unwrap_or(listed)
}

/// Nanoseconds in a second.
const NS: u64 = 1_000_000_000;

/// The content of a bag, printed as `ros2 bag info` prints it.
pub struct BagInfo<'a>(pub &'a BagReader);

impl fmt::Display for BagInfo<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(bag) = self;
        let name = |path: &Path| {
            path.file_name().expect("the path of an open file ends in a name").to_string_lossy().into_owned()
        };
        let files: Vec<String> = bag.files().map(name).collect();
        // As in ROS 2, an empty bag begins and ends at time 0.
        let (start, end) = bag.span().unwrap_or((0, 0));
        let duration = end.saturating_sub(start);
        writeln!(f, "Files:             {}", files.join("\n                   "))?;
        writeln!(
            f,
            "Bag size:          {}",
            size_text(bag.files.iter().map(|(_, file)| file.summary().size).sum())
        )?;
        writeln!(f, "Storage id:        {}", bag.storage_id())?;
        writeln!(f, "ROS Distro:        {}", bag.metadata.ros_distro.as_deref().unwrap_or("unknown"))?;
        writeln!(f, "Duration:          {}.{:09}s", duration / NS, duration % NS)?;
        writeln!(f, "Start:             {}", date_text(start))?;
        writeln!(f, "End:               {}", date_text(end))?;
        writeln!(f, "Messages:          {}", bag.message_count())?;
        write!(f, "Topic information:")?;
        for (i, TopicCount { topic, messages }) in bag.topics().iter().enumerate() {
            let gap = if i == 0 { " " } else { "                   " };
            let (name, kind) = (&topic.name, &topic.type_name);
            writeln!(f, "{gap}Topic: {name} | Type: {kind} | Count: {messages} | Serialization Format: cdr")?;
        }
        if bag.topics().is_empty() {
            writeln!(f)?;
        }
        write_extras(f, bag)?;
        bag.warnings().iter().try_for_each(|warning| writeln!(f, "Warning:           {warning}"))
    }
}

/// Writes the attachments and the metadata records, where there are any.
fn write_extras(f: &mut fmt::Formatter<'_>, bag: &BagReader) -> fmt::Result {
    let (mut attachments, mut metadata) = (Vec::new(), Vec::new());
    for (_, Extra { kind, .. }) in bag.extras() {
        match kind {
            ExtraKind::Attachment { name, media_type, size } => {
                attachments
                    .push(format!("Name: {name} | Media type: {media_type} | Size: {}", size_text(*size)));
            }
            ExtraKind::Metadata { name } => metadata.push(format!("Name: {name}")),
            ExtraKind::Private(_) => {}
        }
    }
    for (title, lines) in [("Attachments:", attachments), ("Metadata records:", metadata)] {
        if !lines.is_empty() {
            writeln!(f, "{title:<18} {}", lines.len())?;
            lines.iter().try_for_each(|line| writeln!(f, "                   {line}"))?;
        }
    }
    Ok(())
}

fn size_text(bytes: u64) -> String {
    let size = bytes as f64;
    match bytes {
        0..1024 => format!("{bytes} B"),
        1024..1_048_576 => format!("{:.1} KiB", size / 1024.0),
        1_048_576..1_073_741_824 => format!("{:.1} MiB", size / 1_048_576.0),
        _ => format!("{:.1} GiB", size / 1_073_741_824.0),
    }
}

/// Returns nanoseconds since the epoch as a date in UTC.
fn date_text(ns: u64) -> String {
    let (seconds, rest) = (ns / NS, ns % NS);
    format!("{}.{rest:09} UTC ({seconds}.{rest:09})", utc(seconds))
}
