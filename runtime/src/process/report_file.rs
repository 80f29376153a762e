//! [`ReportFile`]: the account of a running node on the disk, so that it outlasts a crash.
//!
//! Each life of a node has a file of its own, `unwrap.1.json`, `unwrap.2.json` and so on; the launcher adds all of them
//! up. After each step the account is written before the step's messages are sent. A message that a killed node did not
//! send any more is therefore in its account, and the reader's account misses it.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::process::launcher;
use crate::report::NodeReport;

/// A listener writes at most this often.
const AFTER_STEP_NS: u64 = 10_000_000;
/// A node without work writes this often.
const IDLE_NS: u64 = 1_000_000_000;

/// The report of one life of a node.
pub struct ReportFile {
    file: PathBuf,
    written_ns: u64,
    failed: bool,
}

/// The reason for writing a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteReason {
    /// A source has made a frame. Always written: the account is never behind the frames sent.
    Source,
    /// A listener has taken a message. Written when the last time is at least 10 ms ago.
    Step,
    /// Nothing has happened. Written when the last time is at least 1 s ago.
    Idle,
    /// The first and the last time.
    Edge,
}

impl ReportFile {
    /// Returns the file for this life of the node with this fully qualified name: the first number that no earlier life has.
    ///
    /// # Errors
    /// The error of the system when no file can be made in `folder`.
    pub fn create(folder: &Path, node: &str) -> io::Result<Self> {
        for life in 1..=u32::MAX {
            let file = launcher::file_of(folder, node, &format!("{life}.json"));
            match File::create_new(&file) {
                Err(why) if why.kind() == io::ErrorKind::AlreadyExists => {}
                Err(why) => return Err(why),
                Ok(_) => {
                    launcher::replace(&file, &text(&NodeReport { running: true, ..NodeReport::new(node) })?)?;
                    return Ok(Self { file, written_ns: 0, failed: false });
                }
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    /// Returns whether the report is to be written at `reason`; `now_ns` are ticks of the machine's clock.
    pub fn is_due(&self, reason: WriteReason, now_ns: u64) -> bool {
        let pause = match reason {
            WriteReason::Source | WriteReason::Edge => 0,
            WriteReason::Step => AFTER_STEP_NS,
            WriteReason::Idle => IDLE_NS,
        };
        now_ns.saturating_sub(self.written_ns) >= pause
    }

    /// Writes `report`. An error, such as a full disk, does not end the node; it is logged once.
    pub fn write(&mut self, report: &NodeReport, now_ns: u64) {
        self.written_ns = now_ns;
        let written = text(report).and_then(|text| launcher::replace(&self.file, &text));
        if let Err(why) = &written
            && !self.failed
        {
            tracing::warn!("{}: {why}; the summary of the launch will be incomplete", self.file.display());
        }
        self.failed = written.is_err();
    }
}

fn text(report: &NodeReport) -> io::Result<Vec<u8>> {
    Ok(serde_json::to_vec(report)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_life_has_a_file_that_is_always_whole() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let read = |name: &str| -> NodeReport {
            let text = std::fs::read(folder.path().join(name)).expect("written");
            serde_json::from_slice(&text).expect("a whole report")
        };
        let mut first = ReportFile::create(folder.path(), "/car/unwrap").expect("a file");
        assert!(read("car.unwrap.1.json").running, "before the first step");
        let mut second = ReportFile::create(folder.path(), "/car/unwrap").expect("a file");
        let mut report = NodeReport::new("/car/unwrap");
        crate::report::add(&mut report.received, "/modulo", 3);
        first.write(&report, 5);
        crate::report::add(&mut report.received, "/modulo", 1);
        second.write(&report, 6);
        assert_eq!((read("car.unwrap.1.json").received["/modulo"], read("car.unwrap.2.json")), (3, report));
    }

    #[test]
    fn a_source_writes_always_and_others_when_time_has_passed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut file = ReportFile::create(folder.path(), "/n").expect("a file");
        let start = 7_000_000_000;
        file.write(&NodeReport::new("/n"), start);
        for (reason, pause) in [
            (WriteReason::Source, 0),
            (WriteReason::Step, AFTER_STEP_NS),
            (WriteReason::Idle, IDLE_NS),
            (WriteReason::Edge, 0),
        ] {
            assert!(file.is_due(reason, start + pause), "{reason:?}");
            assert!(pause == 0 || !file.is_due(reason, start + pause - 1), "{reason:?}");
        }
    }
}
