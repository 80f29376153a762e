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

/// The official exports (Wang et al., YOLOv10, NeurIPS 2024; 80 COCO classes, 640 x 640, rows `[1, 300, 6]`), from small to large: the name,
/// and the length of the file in bytes and its sha256 as 64 hexadecimal digits, if they are known.
const OFFICIAL: [(&str, Option<(u64, &str)>); 6] = [
    ("yolov10n", Some((9_309_375, "aeab0bcae6d55b6dd1907c14620e79f21a487e55a0e04f5051c365ebb780b059"))),
    ("yolov10s", None),
    ("yolov10m", Some((61_659_339, "89b526498a6d55f869a6ab52e3a2eb20ad45b3711c1f7de3dd9ca0b399dfd6d7"))),
    ("yolov10b", None),
    ("yolov10l", None),
    ("yolov10x", None),
];

const UNPINNED: &str = "its sha256 is not known to this program, so a damaged or exchanged file could not be told from the right one; \
                        give --sha256 HEX of a copy that you trust";

/// Returns the URL of the official export `name`, and the length and the sha256 that a download must have. If the user has `given` a sha256,
/// it belongs to another file, whose length is not known.
///
/// # Errors
/// [`FetchError`] with all names, if there is no such export, or when no sha256 is known.
pub fn official<'a>(
    name: &str,
    given: Option<&'a str>,
) -> Result<(String, Option<u64>, &'a str), FetchError> {
    let Some((_, known)) = OFFICIAL.iter().find(|(other, _)| *other == name) else {
        let names = OFFICIAL.map(|(name, _)| name).join(", ");
        return Err(FetchError(format!("model '{name}': must be one of {names}")));
    };
    let (bytes, sha256) = match (given, *known) {
        (Some(given), _) => (None, given),
        (None, Some((bytes, sha256))) => (Some(bytes), sha256),
        (None, None) => return Err(FetchError(format!("model '{name}': {UNPINNED}"))),
    };
    Ok((format!("{RELEASE}/{name}.onnx"), bytes, sha256))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_hash_is_64_hex_digits() {
        assert!(OFFICIAL[0].1.is_some());
        for (_, digits) in OFFICIAL.iter().filter_map(|(_, known)| *known) {
            assert!(digits.len() == 64 && digits.bytes().all(|digit| digit.is_ascii_hexdigit()));
        }
    }

    #[test]
    fn names_lead_to_files_of_the_release() {
        let url = official("yolov10n", None).expect("known").0;
        assert_eq!(url, "https://github.com/THU-MIG/yolov10/releases/download/v1.1/yolov10n.onnx");
        let why = official("yolov8n", None).expect_err("unknown").to_string();
        assert!(why.contains("'yolov8n'") && why.contains("yolov10n, yolov10s"), "{why}");
    }

    #[test]
    fn an_unknown_hash_must_be_given() {
        let pinned = |name, given| official(name, given).map(|(_, bytes, sha256)| (bytes, sha256));
        let why = pinned("yolov10s", None).expect_err("no hash").to_string();
        assert!(why.contains("yolov10s") && why.contains("--sha256"), "{why}");
        for name in ["yolov10s", "yolov10n"] {
            assert_eq!(pinned(name, Some("ab")).expect("given"), (None, "ab"), "the user's word counts");
        }
        assert_eq!(pinned("yolov10n", None).expect("known").0, Some(9_309_375));
    }
}
