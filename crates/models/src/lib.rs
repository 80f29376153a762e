//! Detection models: the embedded demonstration detector, and the official YOLOv10 exports and ONNX Runtime with the means to fetch them.
//!
//! A model is fetched only when its name is given, and kept only when its sha256 is right. An export whose hash is not
//! known is not fetched without a hash from the user. Models are files here: no model is run.

mod fetch;
mod runtime;

pub use fetch::{FetchError, FetchRequest, Fetched, LIMIT, fetch, hex};
pub use runtime::Wheel;

/// The embedded demonstration detector, ONNX, trained by this project on its own scenes only. Its card is
/// `crates/models/README.md`.
pub const DEMO: &[u8] = include_bytes!("../demo.onnx");

/// Licence of the official weights. It differs from that of the project.
pub const LICENCE: &str = "AGPL-3.0";

const RELEASE: &str = "https://github.com/THU-MIG/yolov10/releases/download/v1.1";

/// An official export (Wang et al., YOLOv10, NeurIPS 2024; 80 COCO classes, 640 x 640, rows `[1, 300, 6]`).
#[derive(Debug, PartialEq, Eq)]
pub struct Official {
    /// Name of the model, such as `yolov10n`.
    pub name: &'static str,
    /// Length of the file in bytes and its sha256 as 64 hexadecimal digits, if they are known.
    pub known: Option<(u64, &'static str)>,
}

impl Official {
    /// Name of the released file.
    pub fn file_name(&self) -> String {
        format!("{}.onnx", self.name)
    }

    /// URL of the released file.
    pub fn url(&self) -> String {
        format!("{RELEASE}/{}", self.file_name())
    }

    /// Length and sha256 that a download must have. If the user gives a sha256, it belongs to another file, whose length
    /// is not known.
    ///
    /// # Errors
    /// [`OfficialError`] when no sha256 is known.
    pub fn pinned<'a>(&self, given: Option<&'a str>) -> Result<(Option<u64>, &'a str), OfficialError> {
        match (given, self.known) {
            (Some(given), _) => Ok((None, given)),
            (None, Some((bytes, sha256))) => Ok((Some(bytes), sha256)),
            (None, None) => Err(OfficialError(self.name.to_owned(), UNPINNED.to_owned())),
        }
    }
}

/// All official exports, from small to large.
pub const OFFICIAL: &[Official] = &[
    Official {
        name: "yolov10n",
        known: Some((9_309_375, "aeab0bcae6d55b6dd1907c14620e79f21a487e55a0e04f5051c365ebb780b059")),
    },
    Official { name: "yolov10s", known: None },
    Official {
        name: "yolov10m",
        known: Some((61_659_339, "89b526498a6d55f869a6ab52e3a2eb20ad45b3711c1f7de3dd9ca0b399dfd6d7")),
    },
    Official { name: "yolov10b", known: None },
    Official { name: "yolov10l", known: None },
    Official { name: "yolov10x", known: None },
];

/// Error of an official export that is not fetched: no export has its name, or its sha256 is not known.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("model '{0}': {1}")]
pub struct OfficialError(String, String);

const UNPINNED: &str = "its sha256 is not known to this program, so a damaged or exchanged file could not be told from the right one; \
                        give --sha256 HEX of a copy that you trust";

/// Finds the export with the name `name`.
///
/// # Errors
/// [`OfficialError`] with all names, if there is no such export.
pub fn official(name: &str) -> Result<&'static Official, OfficialError> {
    let found = OFFICIAL.iter().find(|model| model.name == name);
    found.ok_or_else(|| {
        let names: Vec<_> = OFFICIAL.iter().map(|model| model.name).collect();
        OfficialError(name.to_owned(), format!("must be one of {}", names.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_hash_is_64_hex_digits() {
        assert!(OFFICIAL[0].known.is_some());
        for (_, digits) in OFFICIAL.iter().filter_map(|model| model.known) {
            assert!(digits.len() == 64 && digits.bytes().all(|digit| digit.is_ascii_hexdigit()));
        }
    }

    #[test]
    fn names_lead_to_files_of_the_release() {
        let url = official("yolov10n").expect("known").url();
        assert_eq!(url, "https://github.com/THU-MIG/yolov10/releases/download/v1.1/yolov10n.onnx");
        let why = official("yolov8n").expect_err("unknown").to_string();
        assert!(why.contains("'yolov8n'") && why.contains("yolov10n, yolov10s"), "{why}");
    }

    #[test]
    fn an_unknown_hash_must_be_given() {
        let small = official("yolov10s").expect("listed");
        let why = small.pinned(None).expect_err("no hash").to_string();
        assert!(why.contains("yolov10s") && why.contains("--sha256"), "{why}");
        assert_eq!(small.pinned(Some("ab")), Ok((None, "ab")));
        let nano = official("yolov10n").expect("listed");
        assert_eq!(nano.pinned(Some("ab")), Ok((None, "ab")), "the user's word counts");
        assert_eq!(nano.pinned(None).map(|(bytes, _)| bytes), Ok(Some(9_309_375)));
    }
}
