//! The place of a result, which is taken before a run: a run whose result would have no place is not begun. No run writes over a file that it
//! has not made, or mixes its results with other files.

use std::fs::{self, DirEntry, File, OpenOptions};
use std::io::{self, BufWriter, Read as _, Write};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

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

/// Makes the file `path` if it is missing, and checks that it can be written. A file that is there must be empty, or a result of an earlier
/// run, whose first bytes are `earlier`: its content is kept until [`replace`] replaces it.
///
/// # Errors
/// [`OutputError`] when it cannot be made or opened for writing, or is another file.
pub fn prepare_file(path: &Path, earlier: Option<&str>) -> Result<(), OutputError> {
    let prepared = || {
        let found = fs::metadata(path);
        // The reader of a pipe would take the end of this check for the end of the result.
        if found.as_ref().is_ok_and(|found| found.file_type().is_fifo()) {
            return Ok(());
        }
        if found.is_ok_and(|found| found.is_file() && found.len() > 0) {
            let mut begin = vec![0; earlier.map_or(0, str::len)];
            let read = File::open(path)?.read_exact(&mut begin);
            if read.is_err() || earlier.is_none_or(|earlier| begin != earlier.as_bytes()) {
                return Err(taken("is a file that this run has not made"));
            }
            tracing::warn!("{}: is of an earlier run, and will be replaced", path.display());
        }
        OpenOptions::new().create(true).append(true).open(path).map(drop)
    };
    prepared().map_err(|why| OutputError::new(path, why))
}

fn taken(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AlreadyExists, why)
}

/// The folder of the results of one run. If it was made for the run and stays empty, it is removed with this.
#[derive(Debug)]
pub struct ResultFolder {
    path: PathBuf,
    /// It and its parents as far as they were made, the innermost first.
    made: Vec<PathBuf>,
}

impl ResultFolder {
    /// Takes the folder `given`, which is made if it is missing, and has to be empty but for hidden files. One that has the file
    /// `continued` holds results that this run adds to. Without `given`, it makes the first of the folders `runs/COMMAND/1`,
    /// `runs/COMMAND/2` and so on that is not there, which no other run takes.
    ///
    /// # Errors
    /// [`OutputError`] when no file can be written into it, or there are others in it.
    pub fn take(given: Option<&Path>, command: &str, continued: Option<&str>) -> Result<Self, OutputError> {
        let Some(path) = given else {
            let runs = Path::new("runs").join(command);
            return Self::number(&runs).map_err(|why| OutputError::new(&runs, why));
        };
        let folder = Self { path: path.to_owned(), made: missing(path) };
        prepare_folder(path)?;
        let check = || {
            let is_shown = |entry: &io::Result<DirEntry>| {
                entry.as_ref().map_or(true, |entry| !entry.file_name().as_encoded_bytes().starts_with(b"."))
            };
            let is_empty = fs::read_dir(path)?.all(|entry| !is_shown(&entry));
            // Only after the list was read: another process that begins with the same folder writes this file first.
            match is_empty || continued.is_some_and(|file| path.join(file).is_file()) {
                true => Ok(()),
                false => Err(taken(
                    "the folder is not empty, and its files would mix with the results or be replaced",
                )),
            }
        };
        check().map(|()| folder).map_err(|why| OutputError::new(path, why))
    }

    fn number(runs: &Path) -> io::Result<Self> {
        for number in 1u32.. {
            // A run that was refused may remove it meanwhile.
            fs::create_dir_all(runs)?;
            let path = runs.join(number.to_string());
            match fs::create_dir(&path).map_err(|why| why.kind()) {
                Ok(()) => {
                    // The parents have no other content than runs.
                    let made = path.ancestors().take(3).map(Path::to_owned).collect();
                    return Ok(Self { path, made });
                }
                Err(io::ErrorKind::AlreadyExists | io::ErrorKind::NotFound) => {}
                Err(why) => return Err(why.into()),
            }
        }
        unreachable!("there are more numbers than folders")
    }

    /// Returns its path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for ResultFolder {
    fn drop(&mut self) {
        // It fails where something is in it.
        self.made.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

/// Returns `path` and its parents as far as they are missing, the innermost first.
fn missing(path: &Path) -> Vec<PathBuf> {
    let folders = path.ancestors().take_while(|folder| *folder != Path::new("") && !folder.exists());
    folders.map(Path::to_owned).collect()
}

/// Makes the folder `path` with its parents if it is missing, and checks that a file can be written into it.
///
/// # Errors
/// [`OutputError`] when that fails.
pub fn prepare_folder(path: &Path) -> Result<(), OutputError> {
    let probe = beside(&path.join("file"));
    let written = fs::create_dir_all(path).and_then(|()| fs::write(&probe, []));
    written.and_then(|()| fs::remove_file(&probe)).map_err(|why| OutputError::new(path, why))
}

/// Returns a new path in the folder of `file`.
fn beside(file: &Path) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    file.with_file_name(format!(".modulo-{}-{number}", std::process::id()))
}

/// Replaces the content of `file` by `content`, as [`replace_with`] does.
///
/// # Errors
/// Those of [`replace_with`].
pub fn replace(file: &Path, content: &[u8]) -> io::Result<()> {
    replace_with(file, |new| new.write_all(content))
}

/// Replaces the content of `file` by what `write` writes. A reader finds either the old content or the new one, also after a crash of this
/// process. After a crash of the machine there is no guarantee. A pipe, or a file in a folder that cannot be written, is written to as it is.
///
/// # Errors
/// The error of the system; the old content is then unchanged.
pub fn replace_with<T>(file: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<T>) -> io::Result<T> {
    let write_to = |opened: File| {
        let mut opened = BufWriter::new(opened);
        write(&mut opened).and_then(|written| opened.flush().map(|()| written))
    };
    // What a link leads to is replaced, and not the link.
    let target = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
    let new = beside(&target);
    if fs::metadata(&target).is_ok_and(|found| !found.is_file()) {
        return write_to(File::create(&target)?);
    }
    match File::create(&new) {
        // A rename replaces the file in one step, so that no reader finds half of it.
        Ok(opened) => write_to(opened)
            .and_then(|written| fs::rename(&new, &target).map(|()| written))
            .inspect_err(|_| drop(fs::remove_file(&new))),
        Err(why) if why.kind() == io::ErrorKind::PermissionDenied => write_to(File::create(&target)?),
        Err(why) => Err(why),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_made_and_what_is_there_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("summary.json");
        for _ in 0..2 {
            prepare_file(&file, None).expect("new or empty");
        }
        assert_eq!(fs::read(&file).expect("made"), b"");
        fs::write(&file, "{\"frames\": 3}").expect("writable");
        prepare_file(&file, Some("{\"frames\"")).expect("of an earlier run");
        for earlier in [None, Some("{\"spans\""), Some("{\"frames\": 3} and more")] {
            let why = prepare_file(&file, earlier).expect_err("another file").to_string();
            assert!(why.contains("choose another path"), "{why}");
        }
        assert_eq!(fs::read(&file).expect("kept"), b"{\"frames\": 3}");
    }

    #[test]
    fn a_place_that_cannot_be_is_refused_with_its_path() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        fs::write(&file, "no folder").expect("writable");
        for path in [file.join("s.json"), folder.path().join("missing/s.json"), folder.path().to_owned()] {
            let why = prepare_file(&path, None).expect_err("not a file that can be written").to_string();
            assert!(why.contains(&path.display().to_string()) && why.contains("cannot be written"), "{why}");
        }
        let take = |path: &Path, continued| ResultFolder::take(Some(path), "eval", continued);
        let why = take(&file.join("out"), None).expect_err("a file is no folder").to_string();
        assert!(why.contains("file/out: cannot be written"), "{why}");
        let why = take(folder.path(), Some("results.json")).expect_err("a file of the user").to_string();
        assert!(why.contains("not empty"), "{why}");
        take(folder.path(), Some("file")).expect("a run that adds to it");
        fs::remove_file(&file).expect("there");
        fs::write(folder.path().join(".hidden"), []).expect("writable");
        take(folder.path(), None).expect("empty");
        assert!(folder.path().exists(), "it was not made for the run");
    }

    #[test]
    fn a_folder_that_stays_empty_leaves_with_its_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new/out");
        drop(ResultFolder::take(Some(&path), "eval", None).expect("new"));
        assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 0);
        let taken = ResultFolder::take(Some(&path), "eval", None).expect("new");
        fs::write(taken.path().join("result"), []).expect("writable");
        drop(taken);
        assert!(path.join("result").exists());
    }

    /// Four evaluations that were started at the same time took the same folder.
    #[test]
    fn each_run_has_a_number_of_its_own() {
        let folder = tempfile::tempdir().expect("a folder");
        let runs = folder.path().join("runs/eval");
        let take = || ResultFolder::number(&runs).expect("a number");
        let taken: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(take)).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        });
        let mut paths: Vec<_> = taken.iter().map(|folder| folder.path().to_owned()).collect();
        paths.sort();
        let expected: Vec<_> = (1..=8).map(|number| runs.join(number.to_string())).collect();
        assert_eq!(paths, expected);
        drop(taken);
        assert!(!folder.path().join("runs").exists(), "nothing was written");
    }

    #[test]
    fn a_file_is_replaced_in_one_step_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        replace(&file, b"old").expect("writable");
        let full = || -> io::Result<()> { Err(taken("no more room")) };
        let failed = replace_with(&file, |new| new.write_all(b"half").and_then(|()| full()));
        assert_eq!((failed.is_err(), fs::read(&file).expect("kept")), (true, b"old".into()));
        std::os::unix::fs::symlink(&file, &link).expect("writable");
        replace(&link, b"new").expect("writable");
        assert_eq!((link.is_symlink(), fs::read(&file).expect("there")), (true, b"new".into()));
        replace(Path::new("/dev/null"), b"new").expect("a device is written to");
        assert!(replace(folder.path(), b"new").is_err(), "a folder");
        assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 2, "nothing is left beside them");
    }
}
