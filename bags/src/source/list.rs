//! [`FrameList`]: which frames of a folder, in which order, and the drives they come from.

use std::collections::BTreeMap;
use std::path::Path;

use super::SourceError;
use crate::FileError;

/// The ids of the paper's test images.
const PAPER: std::ops::RangeInclusive<u32> = 7385..=7485;

/// A list of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameList {
    /// Name for people: the file or the preset.
    pub name: String,
    /// Names of the image files without extension.
    pub frames: Vec<String>,
    drives: BTreeMap<String, String>,
}

impl FrameList {
    /// Reads lines `FRAME [DRIVE]`; `#` opens a comment.
    ///
    /// # Errors
    /// [`SourceError`] when the file cannot be read or names no frame.
    pub fn read(path: &Path) -> Result<Self, SourceError> {
        let text = std::fs::read_to_string(path).map_err(|why| FileError::new(path, why))?;
        let (mut frames, mut drives) = (Vec::new(), BTreeMap::new());
        for (line, text) in (1..).zip(text.lines()) {
            let entry = text.split_once('#').map_or(text, |(entry, _comment)| entry);
            match entry.split_whitespace().collect::<Vec<_>>()[..] {
                [] => {}
                [frame] => frames.push(frame.to_owned()),
                [frame, drive] => {
                    frames.push(frame.to_owned());
                    drives.insert(frame.to_owned(), drive.to_owned());
                }
                _ => {
                    let why = format!("'{text}' found, FRAME or FRAME DRIVE needed");
                    return Err(SourceError::Label { path: path.to_owned(), line, why });
                }
            }
        }
        if frames.is_empty() {
            let why = "the list is empty, at least one frame is needed".to_owned();
            return Err(SourceError::Label { path: path.to_owned(), line: 1, why });
        }
        Ok(Self { name: path.display().to_string(), frames, drives })
    }

    /// Returns the paper's 100 (it names 101) test images of KITTI's object set.
    pub fn paper() -> Self {
        let frames = PAPER.map(|id| format!("{id:06}")).collect();
        Self { name: "the paper's list".to_owned(), frames, drives: BTreeMap::new() }
    }

    /// Returns the drive of a frame, if the list names it.
    pub fn drive_of(&self, frame: &str) -> Option<&str> {
        self.drives.get(frame).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<FrameList, String> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        FrameList::read(file.path()).map_err(|why| why.to_string())
    }

    #[test]
    fn a_frame_may_have_a_drive() {
        let list = read("000003 # first\n\n000001 drive_0011\n").expect("two frames");
        assert_eq!(list.frames, ["000003", "000001"]);
        assert_eq!((list.drive_of("000003"), list.drive_of("000001")), (None, Some("drive_0011")));
        assert_eq!(FrameList::paper().frames.first().map(String::as_str), Some("007385"));
    }

    #[test]
    fn an_empty_list_is_an_error() {
        assert!(read("# nothing\n").expect_err("empty").contains("at least one frame"));
        assert!(read("1 2 3\n").expect_err("three words").contains("FRAME DRIVE"));
    }
}
