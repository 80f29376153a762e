//! [`SavedState`]: the state that outlasts a crash of a node. It consists of the parameters that it has accepted since its launch, and the position of a source.
//!
//! The folder exists only during one launch: a file in it at the start of a node was written by the same node before a crash. Parameters of an earlier launch are never restored.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::graph::NodeName;
use crate::parameter::{Parameters, Value};
use crate::process::launcher;

/// The files of one node.
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

    /// Returns `launched` with the parameters that were accepted before a crash. A parameter that cannot be read, or is not possible any more, is left out with a warning.
    pub fn restore(&self, launched: Parameters) -> Parameters {
        let changes: Vec<(String, Value)> = match read(&self.parameters) {
            Ok(Some(changes)) => changes,
            Ok(None) => return launched,
            Err(why) => {
                tracing::warn!(
                    "{}: {why}; the parameters are those of the launch again",
                    self.parameters.display()
                );
                return launched;
            }
        };
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
        if let Err(why) = self.write(accepted) {
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
        if let Err(why) = launcher::replace(&self.position, position.to_string().as_bytes()) {
            tracing::warn!(
                "{}: {why}; after a crash the source would send frames again",
                self.position.display()
            );
        }
    }

    fn write(&self, accepted: &Parameters) -> io::Result<()> {
        let changeable = accepted.descriptors().iter().filter(|d| !d.read_only);
        let values: Vec<_> = changeable.filter_map(|d| Some((d.name, accepted.get(d.name)?))).collect();
        launcher::replace(&self.parameters, &serde_json::to_vec(&values)?)
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
    use crate::parameter::{ParameterSet as _, sample::Set};

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
