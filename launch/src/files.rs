//! [`launch_files`]: the launch files of the current folder and of the suite.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::plan::environment;
use crate::substitution::{SUITE, Surroundings, share};

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
    let around = Surroundings {
        file: &here.join("any.launch.yaml"),
        variables: &BTreeMap::new(),
        environment: &environment(),
    };
    let mut folders = vec![here.clone()];
    folders.extend(
        share(SUITE, &around).ok().map(|share| share.join("launch")).filter(|folder| *folder != here),
    );
    folders.iter().flat_map(|folder| files_in(folder)).collect()
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
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let comment = text.lines().next().and_then(|line| line.strip_prefix('#'));
    comment.unwrap_or_default().trim().to_owned()
}
