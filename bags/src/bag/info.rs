//! [`BagInfo`]: what a bag holds, printed as `ros2 bag info` prints it.

use std::fmt;

use super::{BagReader, BagWarning, TopicCount};

const NS: u64 = 1_000_000_000;

/// What a bag holds.
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
    /// What the bag lacks.
    pub warnings: Vec<BagWarning>,
}

impl From<&BagReader> for BagInfo {
    fn from(bag: &BagReader) -> Self {
        let name =
            |path: &std::path::Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
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
    /// All messages.
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
        let (seconds, ns) = (self.0 / NS, self.0 % NS);
        let (year, month, day) = civil(seconds / 86_400);
        let (h, m, s) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
        write!(f, "{year}-{month:02}-{day:02} {h:02}:{m:02}:{s:02}.{ns:09} UTC ({seconds}.{ns:09})")
    }
}

/// Year, month and day of the day `days` after 1970-01-01. Howard Hinnant,
/// "chrono-Compatible Low-Level Date Algorithms", `civil_from_days`.
fn civil(days: u64) -> (u64, u64, u64) {
    let z = days + 719_468;
    let (era, day_of_era) = (z / 146_097, z % 146_097);
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    (year + era * 400 + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // As `date -u -d @N` prints them.
        for (seconds, date) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_316_995_200, "2011-09-26 00:00:00"),
            (4_107_542_399, "2100-02-28 23:59:59"),
            (4_107_542_400, "2100-03-01 00:00:00"),
        ] {
            assert!(Utc(seconds * NS).to_string().starts_with(date), "{}", Utc(seconds * NS));
        }
    }
}
