//! The launch files, the sensor files and the sample bag of the suite, which the program contains; the links in `embedded/` pack them here.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::input::in_home;
use crate::output;

macro_rules! contents {
    ($($path:literal)*) => {
        &[$(($path, include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/embedded/", $path)))),*]
    };
}

/// The files with their paths from the root of the repository.
const FILES: &[(&str, &[u8])] = contents![
    "launch/cameras.launch.yaml"
    "launch/compare.launch.yaml"
    "launch/dds.launch.yaml"
    "launch/demo.launch.yaml"
    "launch/detector.launch.yaml"
    "launch/raw.launch.yaml"
    "launch/recovered.launch.yaml"
    "launch/replay.launch.yaml"
    "launch/sensor.launch.yaml"
    "launch/suite.launch.yaml"
    "sensors/arguments.yaml"
    "sensors/mosaic.yaml"
    "sensors/paper.yaml"
    "sensors/two_gains.yaml"
    "bags/samples/tunnel/metadata.yaml"
    "bags/samples/tunnel/tunnel_0.mcap"
];

/// Returns the content of the text with this path, such as `launch/raw.launch.yaml`.
pub fn text(path: &str) -> Option<&'static str> {
    let (_, content) = FILES.iter().find(|(name, _)| *name == path)?;
    std::str::from_utf8(content).ok()
}

/// Returns the place of the file or folder that a person names by `path`: [`in_home`], or that of the file or folder of the suite with this path where
/// nothing lies at `path` itself.
///
/// # Errors
/// Those of [`folder`].
pub fn locate(path: &Path) -> Result<PathBuf> {
    // A single word, such as `launch`, is more likely a folder that the user has forgotten to make.
    let is_ours =
        path.components().count() > 1 && FILES.iter().any(|(name, _)| Path::new(name).starts_with(path));
    if is_ours && !path.exists() { Ok(folder()?.join(path)) } else { Ok(in_home(path)) }
}

/// Returns the folder in the cache of the user that has all these files. It is made, and a file that was changed is written anew.
///
/// # Errors
/// Error of the system with the file and the remedy, where the files cannot be written.
pub fn folder() -> Result<PathBuf> {
    static FOLDER: OnceLock<std::result::Result<PathBuf, String>> = OnceLock::new();
    FOLDER.get_or_init(unpack).clone().map_err(Error::other)
}

const REMEDY: &str = "set XDG_CACHE_HOME to a folder that can be written";

/// Returns the folder of this suite in the cache of the user, which may not be there yet.
///
/// # Errors
/// A text with the remedy, where the environment names no cache.
pub fn cache() -> std::result::Result<PathBuf, String> {
    let variable = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = variable("XDG_CACHE_HOME").or_else(|| Some(variable("HOME")?.join(".cache")));
    let cache =
        cache.ok_or_else(|| format!("there is no folder for files, since HOME is not set; {REMEDY}"))?;
    Ok(cache.join("modulo"))
}

fn unpack() -> std::result::Result<PathBuf, String> {
    let cache = cache()?;
    // Programs of different versions run side by side.
    let mut hash = DefaultHasher::new();
    FILES.hash(&mut hash);
    let folder = cache.join(format!("{}-{:016x}", env!("CARGO_PKG_VERSION"), hash.finish()));
    for (name, content) in FILES {
        let file = folder.join(name);
        write(&file, content).map_err(|why| {
            format!("{}: cannot be written from the program: {why}; {REMEDY}", file.display())
        })?;
    }
    Ok(folder)
}

/// Writes `file` in one step where it has another content, because other processes may read it.
fn write(file: &Path, content: &[u8]) -> Result<()> {
    if std::fs::read(file).is_ok_and(|found| found == content) {
        return Ok(());
    }
    file.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    output::replace(file, content)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_contains_every_file_of_these_folders() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut found = Vec::new();
        for folder in ["launch", "sensors", "bags/samples/tunnel"] {
            let entries = std::fs::read_dir(root.join(folder)).expect("a folder").flatten();
            let names = entries.map(|entry| format!("{folder}/{}", entry.file_name().to_string_lossy()));
            found.extend(names.filter(|name| name.ends_with(".yaml") || name.ends_with(".mcap")));
        }
        let mut contained: Vec<_> = FILES.iter().map(|(name, _)| (*name).to_owned()).collect();
        found.sort();
        contained.sort();
        assert_eq!(contained, found, "FILES lists these files");
    }

    #[test]
    fn a_changed_file_is_written_anew_and_the_path_of_another_file_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("launch/file.yaml");
        for before in [None, Some("changed")] {
            before.iter().for_each(|text| std::fs::write(&file, text).expect("writable"));
            write(&file, b"whole").expect("writable");
            assert_eq!(std::fs::read(&file).expect("readable"), b"whole");
        }
        assert_eq!(
            std::fs::read_dir(folder.path().join("launch")).expect("a folder").count(),
            1,
            "nothing else is left"
        );
        for other in ["", "launch", "sensors/none.yaml", "/sensors/mosaic.yaml"].map(Path::new) {
            assert_eq!(locate(other).expect("no file of the suite"), other);
        }
    }
}
