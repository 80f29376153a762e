//! Where packages lie, and the launch files that can be found: the suite itself lies in its checkout, beside its binary, or in the binary;
//! all other packages lie where ROS 2 installed them.

use std::path::{Path, PathBuf};

use modulo_runtime::embedded;
use modulo_runtime::input::{LARGEST_TEXT, read_text};
use modulo_runtime::name::did_you_mean;

use crate::{LaunchError, files_in};

/// The name of the package of this suite.
pub const SUITE: &str = "modulo";

/// A file by which the share folder of the suite is recognised.
const MARKER: &str = "launch/suite.launch.yaml";

/// The folder of launch files, and the ending of their names.
const FOLDER: &str = "launch";
const ENDING: &str = ".launch.yaml";

/// The prefixes under which ROS 2 has installed packages.
pub(crate) fn prefixes() -> Vec<PathBuf> {
    let path = std::env::var("AMENT_PREFIX_PATH").unwrap_or_default();
    path.split(':').filter(|prefix| !prefix.is_empty()).map(PathBuf::from).collect()
}

/// `share/<package>` of a package; for the suite the folder that holds `launch/`.
pub(crate) fn share(package: &str, file: &Path) -> Result<PathBuf, String> {
    // A checkout can have any name and an installed suite any prefix, so the folder is known by a file in it.
    if package == SUITE
        && let Some(root) = suite_roots(file).into_iter().find(|root| root.join(MARKER).is_file())
    {
        return Ok(root);
    }
    match installed(package) {
        Err(_) if package == SUITE => embedded::folder().map_err(|why| why.to_string()),
        found => Ok(found?.join("share").join(package)),
    }
}

/// Returns the folders that may be the share folder of the suite, the likeliest first.
fn suite_roots(file: &Path) -> Vec<PathBuf> {
    let beside_the_file = file.parent().and_then(Path::parent).map(Path::to_owned);
    let binary = std::env::current_exe().and_then(|exe| exe.canonicalize()).unwrap_or_default();
    let above_the_binary = binary.ancestors().skip(1);
    beside_the_file
        .into_iter()
        .chain(above_the_binary.flat_map(|dir| [dir.join("share").join(SUITE), dir.to_owned()]))
        .collect()
}

/// Returns the prefix under which ROS 2 has installed a package.
fn installed(package: &str) -> Result<PathBuf, String> {
    let prefixes = prefixes();
    let found = prefixes.iter().find(|prefix| prefix.join("share").join(package).is_dir());
    // An empty name would be the folder of all packages, and a name with a slash could lead out of it.
    if let (Some(prefix), false) = (found, package.is_empty() || package.contains('/')) {
        return Ok(prefix.clone());
    }
    let place = |prefix: &PathBuf| format!("{}/share/{package}", prefix.display());
    let places: Vec<String> = prefixes.iter().map(place).collect();
    let places = match &places[..] {
        [] => "looked in AMENT_PREFIX_PATH, which is empty".to_owned(),
        places => format!("looked at {}", places.join(", ")),
    };
    Err(format!("package '{package}' is not found, {places}"))
}

/// A launch file that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundFile {
    /// Its name without `.launch.yaml`, which [`launch_file`] takes.
    pub name: String,
    /// Its path.
    pub path: PathBuf,
    /// The first line of its leading comment; empty without a comment.
    pub about: String,
}

/// Returns the launch files in the folder `launch` of the current folder, and then those in `$(find-pkg-share modulo)/launch` that have
/// other names, each in the order of their names.
///
/// # Errors
/// [`LaunchError::Other`] when the files of the suite are neither found nor written from the program.
pub fn launch_files() -> Result<Vec<FoundFile>, LaunchError> {
    let here = PathBuf::from(FOLDER);
    let suite = share(SUITE, Path::new("")).map_err(LaunchError::Other)?;
    let mut files = launch_files_in(&here);
    for file in launch_files_in(&suite.join(FOLDER)) {
        if files.iter().all(|other| other.name != file.name) {
            files.push(file);
        }
    }
    Ok(files)
}

/// Returns the launch file that `file` means: `file` itself where it exists or is no name, else the one of [`launch_files`] with this
/// name, such as `raw`, `raw.launch.yaml` or `launch/raw.launch.yaml`.
///
/// # Errors
/// Those of [`launch_files`], and [`LaunchError::File`] where none has this name.
pub fn launch_file(file: &Path) -> Result<PathBuf, LaunchError> {
    // A folder with the name of a launch file, such as one of results, is no launch file.
    let (Some(name), false) = (name_of(file), file.exists() && !file.is_dir()) else {
        return Ok(file.to_owned());
    };
    let files = launch_files()?;
    let found = files.iter().find(|found| found.name == name).map(|found| found.path.clone());
    found.ok_or_else(|| {
        let near = did_you_mean(&name, files.iter().map(|file| file.name.as_str()));
        LaunchError::file(
            file,
            format!("no such launch file (modulo launch lists those that are found){near}"),
        )
    })
}

/// Returns the name of a launch file without folder and ending; `None` for a path to another folder.
fn name_of(file: &Path) -> Option<String> {
    let folder = file.parent().filter(|folder| [Path::new(""), Path::new(FOLDER)].contains(folder));
    let name = folder.and(file.file_name())?.to_string_lossy();
    Some(name.strip_suffix(ENDING).unwrap_or(&name).to_owned())
}

/// Writes the launch file of the suite with this name into the folder `launch` below `folder`, together with the files of the suite that it
/// refers to and those by which the copy is found. Returns each path, and whether the file was written: an included one that is there
/// already is kept.
///
/// # Errors
/// [`LaunchError`] when the suite has no such file, when it exists below `folder`, or when a file cannot be written.
pub fn copy(file: &Path, folder: &Path) -> Result<Vec<(PathBuf, bool)>, LaunchError> {
    let first = name_of(file).map(|name| format!("{FOLDER}/{name}{ENDING}"));
    let first = first.filter(|path| embedded::text(path).is_some()).ok_or_else(|| {
        let why = "the suite has no launch file of this name to copy; modulo launch lists the launch files";
        LaunchError::file(file, why)
    })?;
    if folder.join(&first).exists() {
        let why = "exists already and is not overwritten; move it away, or run the command in another folder";
        return Err(LaunchError::file(&folder.join(&first), why));
    }
    let (mut paths, mut copied) = (vec![first, MARKER.to_owned()], Vec::new());
    while let Some(path) = paths.get(copied.len()).cloned() {
        let (text, target) = (embedded::text(&path).unwrap_or_default(), folder.join(path));
        let is_new = !target.exists();
        if is_new {
            let made = target.parent().map_or(Ok(()), std::fs::create_dir_all);
            made.and_then(|()| std::fs::write(&target, text))
                .map_err(|why| LaunchError::file(&target, why))?;
        }
        copied.push((target, is_new));
        let named = text.split("$(find-pkg-share modulo)/").skip(1).filter_map(|rest| rest.split('"').next());
        for path in named.filter(|path| embedded::text(path).is_some()) {
            if !paths.iter().any(|other| other == path) {
                paths.push(path.to_owned());
            }
        }
    }
    Ok(copied)
}

fn launch_files_in(folder: &Path) -> Vec<FoundFile> {
    let found = |path: PathBuf| {
        let file = path.file_name()?.to_string_lossy().into_owned();
        let is_launch_file =
            path.is_file() && ["launch.yaml", "launch.yml"].iter().any(|ending| file.ends_with(ending));
        is_launch_file.then_some(FoundFile { name: name_of(file.as_ref())?, about: about(&path), path })
    };
    files_in(folder).unwrap_or_default().into_iter().filter_map(found).collect()
}

fn about(file: &Path) -> String {
    let text = read_text(file, LARGEST_TEXT).unwrap_or_default();
    let comment = text.lines().next().and_then(|line| line.strip_prefix('#'));
    comment.unwrap_or_default().trim().to_owned()
}
