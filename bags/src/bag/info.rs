//! [`BagInfo`]: the content of a bag, printed as `ros2 bag info` prints it.

use std::fmt;

use jiff::Timestamp;

use super::{BagReader, BagWarning, TopicCount};

const NS: u64 = 1_000_000_000;

/// The content of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BagInfo {
    /// Names of the files, in order.
    pub files: Vec<String>,
    /// Size of all files, bytes.
    pub size: u64,
    /// The storage's name in rosbag2.
    pub storage_id: &'static str,
    /// The ROS distribution of the recorder, where it is known.
    pub ros_distro: Option<String>,
    /// First and last log time, ns since the epoch; `None` without messages.
    pub span: Option<(u64, u64)>,
    /// All topics with their counts.
    pub topics: Vec<TopicCount>,
    /// Problems of the bag.
    pub warnings: Vec<BagWarning>,
}

impl From<&BagReader> for BagInfo {
    fn from(bag: &BagReader) -> Self {
        let name = |path: &std::path::Path| {
            path.file_name()
                .expect("the path of an opened file ends in a name")
                .to_string_lossy()
                .into_owned()
        };
        Self {
            files: bag.files().map(name).collect(),
            size: bag.size(),
            storage_id: bag.storage_id(),
            ros_distro: bag.ros_distro().map(str::to_owned),
            span: bag.span(),
            topics: bag.topics(),
            warnings: bag.warnings().to_vec(),
        }
    }
}

impl BagInfo {
    /// Returns the number of messages of all topics.
    pub fn messages(&self) -> u64 {
        self.topics.iter().map(|t| t.messages).sum()
    }
}

impl fmt::Display for BagInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (start, end) = self.span.unwrap_or_default();
        let duration = end.saturating_sub(start);
        writeln!(f, "Files:             {}", self.files.join("\n                   "))?;
        writeln!(f, "Bag size:          {}", Bytes(self.size))?;
        writeln!(f, "Storage id:        {}", self.storage_id)?;
        writeln!(f, "ROS Distro:        {}", self.ros_distro.as_deref().unwrap_or("unknown"))?;
        writeln!(f, "Duration:          {}.{:09}s", duration / NS, duration % NS)?;
        writeln!(f, "Start:             {}", Utc(start))?;
        writeln!(f, "End:               {}", Utc(end))?;
        writeln!(f, "Messages:          {}", self.messages())?;
        write!(f, "Topic information:")?;
        for (i, TopicCount { topic, messages }) in self.topics.iter().enumerate() {
            let gap = if i == 0 { " " } else { "                   " };
            let (name, kind) = (&topic.name, &topic.type_name);
            writeln!(f, "{gap}Topic: {name} | Type: {kind} | Count: {messages} | Serialization Format: cdr")?;
        }
        if self.topics.is_empty() {
            writeln!(f)?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(f, "Warning:           {warning}"))
    }
}

struct Bytes(u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0 as f64;
        match self.0 {
            0..1024 => write!(f, "{} B", self.0),
            1024..1_048_576 => write!(f, "{:.1} KiB", size / 1024.0),
            1_048_576..1_073_741_824 => write!(f, "{:.1} MiB", size / 1_048_576.0),
            _ => write!(f, "{:.1} GiB", size / 1_073_741_824.0),
        }
    }
}

/// Nanoseconds since the epoch as a date in UTC.
struct Utc(u64);

impl fmt::Display for Utc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time = Timestamp::from_nanosecond(self.0.into()).expect("64 bits of ns end in the year 2554");
        write!(f, "{} ({}.{:09})", time.strftime("%Y-%m-%d %H:%M:%S.%9f UTC"), self.0 / NS, self.0 % NS)
    }
}
