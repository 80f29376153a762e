//! [`BagInfo`]: the content of a bag, printed as `ros2 bag info` prints it.

use std::fmt;
use std::path::Path;

use jiff::Timestamp;

use super::{BagReader, TopicCount};

const NS: u64 = 1_000_000_000;

/// The content of a bag, to be printed.
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
        writeln!(f, "Bag size:          {}", Bytes(bag.size()))?;
        writeln!(f, "Storage id:        {}", bag.storage_id())?;
        writeln!(f, "ROS Distro:        {}", bag.ros_distro().unwrap_or("unknown"))?;
        writeln!(f, "Duration:          {}.{:09}s", duration / NS, duration % NS)?;
        writeln!(f, "Start:             {}", Utc(start))?;
        writeln!(f, "End:               {}", Utc(end))?;
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
        bag.warnings().iter().try_for_each(|warning| writeln!(f, "Warning:           {warning}"))
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
