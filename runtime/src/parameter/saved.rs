//! [`SavedParameters`]: what a node has accepted since its launch, kept in a
//! file by the node, so that it is still so after a crash.
//!
//! The folder lives as long as the launch: a file that is there at a node's
//! start is of the same node before it crashed. Launch parameters of another
//! day are never brought back.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::name::Place;
use crate::parameter::{Parameters, Value};

/// The file of one node.
pub struct SavedParameters {
    file: PathBuf,
}

impl SavedParameters {
    /// The file of the node at `place` in `folder`.
    pub fn new(folder: &Path, place: &Place) -> Self {
        let name = place.fully_qualified().trim_matches('/').replace('/', ".");
        Self { file: folder.join(format!("{name}.json")) }
    }

    /// `launched` with what was accepted before a crash. What cannot be read,
    /// or is not possible any more, is left out with a warning.
    pub fn restore(&self, launched: Parameters) -> Parameters {
        let changes = match self.read() {
            Ok(Some(changes)) => changes,
            Ok(None) => return launched,
            Err(why) => {
                tracing::warn!("parameters of before the crash, {}: {why}", self.file.display());
                return launched;
            }
        };
        changes.into_iter().fold(launched, |set, change| {
            match set.with(std::slice::from_ref(&change), false) {
                Ok(next) => {
                    tracing::info!("parameter {} = {} again, as before the crash", change.0, change.1);
                    next
                }
                Err(refusal) => {
                    tracing::warn!("of before the crash, {refusal}");
                    set
                }
            }
        })
    }

    /// Keeps every changeable value of `accepted`. A full disk costs the memory
    /// of the change, not the node.
    pub fn keep(&self, accepted: &Parameters) {
        if let Err(why) = self.write(accepted) {
            tracing::warn!("parameters would not outlast a crash, {}: {why}", self.file.display());
        }
    }

    fn read(&self) -> io::Result<Option<Vec<(String, Value)>>> {
        match fs::read(&self.file) {
            Ok(text) => Ok(Some(serde_json::from_slice(&text)?)),
            Err(why) if why.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(why) => Err(why),
        }
    }

    /// Beside the file and then into its place: a crash between the two leaves
    /// the older one whole.
    fn write(&self, accepted: &Parameters) -> io::Result<()> {
        let changeable = accepted.descriptors().iter().filter(|d| !d.read_only);
        let values: Vec<_> = changeable.filter_map(|d| Some((d.name, accepted.get(d.name)?))).collect();
        let fresh = self.file.with_extension("new");
        fs::write(&fresh, serde_json::to_vec(&values)?)?;
        fs::rename(&fresh, &self.file)
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
        let place = Place::new("eye", "/car", &[]).expect("valid");
        let saved = SavedParameters::new(folder.path(), &place);
        assert_eq!(saved.restore(launched()), launched(), "at the first start");

        let list = Value::Strings(vec!["a, b".into(), "'".into()]);
        let changes = [("angle".to_owned(), Value::Double(2.5)), ("wait_for".to_owned(), list)];
        let accepted = launched().with(&changes, true).expect("possible");
        saved.keep(&accepted);
        assert_eq!(SavedParameters::new(folder.path(), &place).restore(launched()), accepted);

        // A fixed one comes from the launch, whatever it was before.
        let other = launched().with(&[("model".into(), Value::String("b.onnx".into()))], false);
        assert_eq!(
            saved.restore(other.expect("possible")).get("model"),
            Some(&Value::String("b.onnx".into()))
        );
        let elsewhere = Place::new("eye", "/", &[]).expect("valid");
        assert_eq!(SavedParameters::new(folder.path(), &elsewhere).restore(launched()), launched());
    }

    #[test]
    fn a_damaged_or_impossible_file_is_left_out() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let place = Place::new("eye", "/", &[]).expect("valid");
        let saved = SavedParameters::new(folder.path(), &place);
        let file = folder.path().join("eye.json");
        for text in ["", "{", "[[\"angle\", {\"Double\": 0.0}]]", "[[\"gone\", {\"Bool\": true}]]"] {
            fs::write(&file, text).expect("writable");
            assert_eq!(saved.restore(launched()), launched(), "{text}");
        }
        fs::write(&file, "[[\"gone\", {\"Bool\": true}], [\"angle\", {\"Double\": 3.0}]]").expect("writable");
        assert_eq!(saved.restore(launched()).get("angle"), Some(&Value::Double(3.0)));
    }
}
