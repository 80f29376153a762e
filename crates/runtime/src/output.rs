//! The place of a result, which is made before a run: a run whose result would have no place is not begun.

use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

/// Error: a result cannot be written to a file, or to a new folder.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written, choose another path: {source}", path.display())]
pub struct OutputError {
    /// The file or folder.
    pub path: PathBuf,
    /// The error of the system.
    pub source: io::Error,
}

impl OutputError {
    /// Returns the error `source` of the file or folder `path`.
    pub fn new(path: &Path, source: io::Error) -> Self {
        Self { path: path.to_owned(), source }
    }
}

/// Makes the file `path` if it is missing, and checks that it can be written. The content of an existing file is kept.
///
/// # Errors
/// [`OutputError`] when it cannot be made or opened for writing.
pub fn prepare_file(path: &Path) -> Result<(), OutputError> {
    // The reader of a pipe would take the end of this check for the end of the result.
    if fs::metadata(path).is_ok_and(|found| found.file_type().is_fifo()) {
        return Ok(());
    }
    let opened = OpenOptions::new().create(true).append(true).open(path);
    opened.map(drop).map_err(|why| OutputError::new(path, why))
}

/// Returns the first of the folders `runs/COMMAND/1`, `runs/COMMAND/2` and so on that is not there, for results without a place.
pub fn free_folder(command: &str) -> PathBuf {
    let folders = (1u32..).map(|number| Path::new("runs").join(command).join(number.to_string()));
    folders.into_iter().find(|folder| !folder.exists()).expect("there are more numbers than folders")
}

/// Makes the folder `path` with its parents if it is missing, and checks that a file can be written into it.
///
/// # Errors
/// [`OutputError`] when that fails.
pub fn prepare_folder(path: &Path) -> Result<(), OutputError> {
    let probe = path.join(format!(".modulo-{}", std::process::id()));
    let written = fs::create_dir_all(path).and_then(|()| fs::write(&probe, []));
    written.and_then(|()| fs::remove_file(&probe)).map_err(|why| OutputError::new(path, why))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_made_and_what_is_there_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("summary.json");
        prepare_file(&file).expect("writable");
        assert_eq!(fs::read(&file).expect("made"), b"");
        fs::write(&file, "earlier").expect("writable");
        prepare_file(&file).expect("writable");
        assert_eq!(fs::read(&file).expect("kept"), b"earlier");
    }

    #[test]
    fn a_place_that_cannot_be_is_refused_with_its_path() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        fs::write(&file, "no folder").expect("writable");
        for path in [file.join("s.json"), folder.path().join("missing/s.json"), folder.path().to_owned()] {
            let why = prepare_file(&path).expect_err("not a file that can be written").to_string();
            assert!(why.contains(&path.display().to_string()) && why.contains("cannot be written"), "{why}");
        }
        let why = prepare_folder(&file.join("out")).expect_err("a file is no folder").to_string();
        assert!(why.contains("file/out: cannot be written"), "{why}");
        let out = folder.path().join("new/out");
        prepare_folder(&out).expect("writable");
        assert_eq!(fs::read_dir(&out).expect("made").count(), 0, "the probe is gone");
    }
}
