//! The files of a node that outlast a crash: [`ReportFile`] and [`SavedState`].

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use modulo_runtime::{NodeName, NodeReport, Parameters, Value, launcher, output};

/// The pause between two reports of a listener that has taken a message.
pub const AFTER_STEP_NS: u64 = 10_000_000;
/// The pause between two reports of a node to which no message came.
pub const IDLE_NS: u64 = 1_000_000_000;

/// The report of a running node on the disk.
///
/// Each life of a node has a file of its own, `unwrap.1.json`, `unwrap.2.json` and so on; the launcher adds all of them
/// up. After each step the report is written before the step's messages are sent. A message that a killed node did not
/// send any more is therefore in its report, and the reader's report misses it.
pub struct ReportFile {
    file: PathBuf,
    written_ns: u64,
    failed: bool,
}

impl ReportFile {
    /// Returns the file for this life of the node with this fully qualified name: the first number that is free.
    ///
    /// # Errors
    /// The error of the system when no file can be made in `folder`.
    pub fn create(folder: &Path, node: &str) -> io::Result<Self> {
        for life in 1..=u32::MAX {
            let file = launcher::file_of(folder, node, &format!("{life}.json"));
            // Creating the file decides between two processes that take the same number.
            match File::create_new(&file) {
                Err(why) if why.kind() == io::ErrorKind::AlreadyExists => {}
                Err(why) => return Err(why),
                Ok(_) => {
                    let report = NodeReport { running: true, ..NodeReport::new(node) };
                    output::replace(&file, &serde_json::to_vec(&report)?)?;
                    return Ok(Self { file, written_ns: 0, failed: false });
                }
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    /// Returns whether the report was written at least `pause_ns` before `now_ns`, ticks of the machine's clock.
    pub fn is_due(&self, pause_ns: u64, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.written_ns) >= pause_ns
    }

    /// Writes `report`. An error, such as a full disk, does not end the node; it is logged once.
    pub fn write(&mut self, report: &NodeReport, now_ns: u64) {
        self.written_ns = now_ns;
        let text = serde_json::to_vec(report).map_err(io::Error::from);
        let written = text.and_then(|text| output::replace(&self.file, &text));
        if let Err(why) = &written
            && !self.failed
        {
            tracing::warn!("{}: {why}; the summary of the launch will be incomplete", self.file.display());
        }
        self.failed = written.is_err();
    }
}

/// The state that outlasts a crash of a node: the parameters that it has accepted, and the position of a source.
///
/// The folder exists only during one launch: a file in it at the start of a node was written by the same node before a
/// crash. Parameters of an earlier launch are never restored.
pub struct SavedState {
    parameters: PathBuf,
    position: PathBuf,
}

impl SavedState {
    /// Returns the files of the node `node_name` in `folder`.
    pub fn new(folder: &Path, node_name: &NodeName) -> Self {
        let file = |ending| launcher::file_of(folder, &node_name.fully_qualified(), ending);
        Self { parameters: file("json"), position: file("position") }
    }

    /// Returns `launched` with the parameters that were accepted before a crash. A parameter that cannot be read, or is
    /// not possible any more, is left out with a warning.
    pub fn restore(&self, launched: Parameters) -> Parameters {
        let changes: Vec<(String, Value)> = match read(&self.parameters) {
            Ok(Some(changes)) => changes,
            Ok(None) => return launched,
            Err(why) => {
                let file = self.parameters.display();
                tracing::warn!("{file}: {why}; the parameters are those of the launch again");
                return launched;
            }
        };
        // One by one, so that a value that is no longer possible does not cost the others.
        changes.into_iter().fold(launched, |set, change| {
            match set.with(std::slice::from_ref(&change), false) {
                Ok(next) => {
                    tracing::info!("parameter {} = {} again, as before the crash", change.0, change.1);
                    next
                }
                Err(why) => {
                    tracing::warn!("a parameter from before the crash is not restored: {why}");
                    set
                }
            }
        })
    }

    /// Keeps every changeable value of `accepted`. A full disk costs the memory of the change, not the node.
    pub fn keep(&self, accepted: &Parameters) {
        // Values that are fixed at the start come from the launch again.
        let changeable = accepted.descriptors().iter().filter(|d| !d.read_only);
        let values: Vec<_> = changeable.filter_map(|d| Some((d.name, accepted.get(d.name)?))).collect();
        let text = serde_json::to_vec(&values).map_err(io::Error::from);
        if let Err(why) = text.and_then(|text| output::replace(&self.parameters, &text)) {
            tracing::warn!("{}: {why}; the parameters would not outlast a crash", self.parameters.display());
        }
    }

    /// Returns the position that was kept before a crash; `None` at the first start.
    pub fn position(&self) -> Option<u64> {
        read(&self.position).unwrap_or_else(|why| {
            tracing::warn!("{}: {why}; the source starts from its beginning again", self.position.display());
            None
        })
    }

    /// Keeps the position of a source, to be called before the frame that leads to it is sent.
    pub fn keep_position(&self, position: u64) {
        if let Err(why) = output::replace(&self.position, position.to_string().as_bytes()) {
            let file = self.position.display();
            tracing::warn!("{file}: {why}; after a crash the source would send frames again");
        }
    }

    /// Forgets the position, so that the source starts from its beginning.
    pub fn forget_position(&self) {
        match fs::remove_file(&self.position) {
            Err(why) if why.kind() != io::ErrorKind::NotFound => {
                tracing::warn!("{}: {why}; it is restored at the next start", self.position.display());
            }
            Ok(()) | Err(_) => {}
        }
    }
}

/// Returns the JSON content of `file`; `None` when the file does not exist.
fn read<T: serde::de::DeserializeOwned>(file: &Path) -> io::Result<Option<T>> {
    match fs::read(file) {
        Ok(text) => Ok(Some(serde_json::from_slice(&text)?)),
        Err(why) if why.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(why),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Set;
    use modulo_runtime::ParameterSet as _;

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
        modulo_runtime::report::add(&mut report.received, "/modulo", 3);
        first.write(&report, 5);
        modulo_runtime::report::add(&mut report.received, "/modulo", 1);
        second.write(&report, 6);
        assert_eq!((read("car.unwrap.1.json").received["/modulo"], read("car.unwrap.2.json")), (3, report));
    }

    #[test]
    fn a_source_writes_always_and_others_when_time_has_passed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut file = ReportFile::create(folder.path(), "/n").expect("a file");
        let start = 7_000_000_000;
        file.write(&NodeReport::new("/n"), start);
        for pause in [0, AFTER_STEP_NS, IDLE_NS] {
            assert!(file.is_due(pause, start + pause), "{pause}");
            assert!(pause == 0 || !file.is_due(pause, start + pause - 1), "{pause}");
        }
    }

    fn launched() -> Parameters {
        Parameters::declare(Set::descriptors())
    }

    #[test]
    fn what_was_accepted_returns_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let node_name = NodeName::new("eye", "/car", &[]).expect("valid");
        let saved = SavedState::new(folder.path(), &node_name);
        assert_eq!(saved.restore(launched()), launched(), "at the first start");

        let list = Value::Strings(vec!["a, b".into(), "'".into()]);
        let changes = [("angle".to_owned(), Value::Double(2.5)), ("wait_for".to_owned(), list)];
        let accepted = launched().with(&changes, true).expect("possible");
        saved.keep(&accepted);
        assert_eq!(SavedState::new(folder.path(), &node_name).restore(launched()), accepted);

        // A fixed one comes from the launch, whatever it was before.
        let other = launched().with(&[("model".into(), Value::String("b.onnx".into()))], false);
        assert_eq!(
            saved.restore(other.expect("possible")).get("model"),
            Some(&Value::String("b.onnx".into()))
        );
        let elsewhere = NodeName::new("eye", "/", &[]).expect("valid");
        assert_eq!(SavedState::new(folder.path(), &elsewhere).restore(launched()), launched());
    }

    #[test]
    fn a_damaged_or_impossible_file_is_left_out() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let node_name = NodeName::new("eye", "/", &[]).expect("valid");
        let saved = SavedState::new(folder.path(), &node_name);
        let file = folder.path().join("eye.json");
        for text in ["", "{", "[[\"angle\", {\"Double\": 0.0}]]", "[[\"gone\", {\"Bool\": true}]]"] {
            fs::write(&file, text).expect("writable");
            assert_eq!(saved.restore(launched()), launched(), "{text}");
        }
        fs::write(&file, "[[\"gone\", {\"Bool\": true}], [\"angle\", {\"Double\": 3.0}]]").expect("writable");
        assert_eq!(saved.restore(launched()).get("angle"), Some(&Value::Double(3.0)));
    }

    #[test]
    fn the_last_position_returns() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let node_name = NodeName::new("camera", "/", &[]).expect("valid");
        let saved = SavedState::new(folder.path(), &node_name);
        assert_eq!(saved.position(), None);
        saved.keep_position(7);
        saved.keep_position(u64::MAX);
        assert_eq!(SavedState::new(folder.path(), &node_name).position(), Some(u64::MAX));
        fs::write(folder.path().join("camera.position"), "1 2").expect("writable");
        assert_eq!(saved.position(), None);
    }
}
