//! Where packages lie, and the launch files that can be found: the suite itself lies in its checkout or beside its binary,
//! all other packages where ROS 2 installed them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use modulo_runtime::input::{LARGEST_TEXT, read_text};

/// The name of the package of this suite.
pub const SUITE: &str = "modulo";

/// A file by which the share folder of the suite is recognised.
const MARKER: &str = "launch/suite.launch.yaml";

/// The variable `name` of a process whose `environment` is added to that of the launcher; `None` when it is not text.
pub(crate) fn variable(environment: &BTreeMap<String, String>, name: &str) -> Option<String> {
    environment.get(name).cloned().or_else(|| std::env::var(name).ok())
}

/// The prefixes under which ROS 2 has installed packages.
pub(crate) fn prefixes(environment: &BTreeMap<String, String>) -> Vec<PathBuf> {
    let path = variable(environment, "AMENT_PREFIX_PATH").unwrap_or_default();
    path.split(':').filter(|prefix| !prefix.is_empty()).map(PathBuf::from).collect()
}

/// `share/<package>` of a package; for the suite the folder that holds `launch/`.
pub(crate) fn share(
    package: &str,
    file: &Path,
    environment: &BTreeMap<String, String>,
) -> Result<PathBuf, String> {
    // A checkout can have any name and an installed suite any prefix, so the folder is known by a file in it.
    if package == SUITE
        && let Some(root) = suite_roots(file).into_iter().find(|root| root.join(MARKER).is_file())
    {
        return Ok(root);
    }
    Ok(installed(package, environment)?.join("share").join(package))
}

/// The prefix under which a package is installed; for the suite in a checkout the checkout.
pub(crate) fn prefix(
    package: &str,
    file: &Path,
    environment: &BTreeMap<String, String>,
) -> Result<PathBuf, String> {
    if package != SUITE {
        return installed(package, environment);
    }
    let share = share(package, file, environment)?;
    let installed = share.ends_with(Path::new("share").join(SUITE));
    Ok(share.ancestors().nth(if installed { 2 } else { 0 }).unwrap_or(&share).to_owned())
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

fn installed(package: &str, environment: &BTreeMap<String, String>) -> Result<PathBuf, String> {
    let prefixes = prefixes(environment);
    let found = prefixes.iter().find(|prefix| prefix.join("share").join(package).is_dir());
    // An empty name would be the folder of all packages, and a name with a slash could lead out of it.
    if let (Some(prefix), false) = (found, package.is_empty() || package.contains('/')) {
        return Ok(prefix.clone());
    }
    let places = match (prefixes.is_empty(), package == SUITE) {
        (true, true) => "looked beside the launch file, above the binary and in AMENT_PREFIX_PATH".to_owned(),
        (true, false) => "looked in AMENT_PREFIX_PATH, which is empty".to_owned(),
        (false, _) => {
            let place = |prefix: &PathBuf| format!("{}/share/{package}", prefix.display());
            let places: Vec<String> = prefixes.iter().map(place).collect();
            format!("looked at {}", places.join(", "))
        }
    };
    Err(format!("package '{package}' is not found, {places}"))
}

/// A launch file that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundFile {
    /// Its path.
    pub path: PathBuf,
    /// The first line of its leading comment; empty without a comment.
    pub about: String,
}

/// Returns the launch files in the folder `launch` of the current folder, and then those in
/// `$(find-pkg-share modulo)/launch`, each in the order of their names.
pub fn launch_files() -> Vec<FoundFile> {
    let here = PathBuf::from("launch");
    let suite = share(SUITE, &here.join("any.launch.yaml"), &BTreeMap::new());
    // Within a checkout both folders are the same, and its files are listed once.
    let mut folders = vec![here.clone()];
    folders.extend(suite.ok().map(|share| share.join("launch")).filter(|folder| *folder != here));
    folders.iter().flat_map(|folder| files_in(folder)).collect()
}

/// Returns the launch file that `file` means: `file` itself where it exists or none has this name, else the first of [`launch_files`].
pub fn launch_file(file: &Path) -> PathBuf {
    let is_name = file.components().count() == 1 && !file.exists();
    let found = launch_files().into_iter().find(|found| is_name && found.path.ends_with(file));
    found.map_or_else(|| file.to_owned(), |found| found.path)
}

fn files_in(folder: &Path) -> Vec<FoundFile> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_launch_file = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.is_file() && ["launch.yaml", "launch.yml"].iter().any(|ending| name.ends_with(ending))
    };
    let mut paths: Vec<PathBuf> = entries.filter(is_launch_file).collect();
    paths.sort();
    let found = |path: PathBuf| FoundFile { about: about(&path), path };
    paths.into_iter().map(found).collect()
}

fn about(file: &Path) -> String {
    let text = read_text(file, LARGEST_TEXT).unwrap_or_default();
    let comment = text.lines().next().and_then(|line| line.strip_prefix('#'));
    comment.unwrap_or_default().trim().to_owned()
}
