//! Names of the pictures in the folder of results.

use std::collections::HashSet;
use std::path::PathBuf;

/// The stem of each file, with `-2`, `-3` and so on where another file has it already.
pub fn of(files: &[PathBuf]) -> Vec<String> {
    let mut taken = HashSet::new();
    let free = |file: &PathBuf| {
        let stem = file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let numbered = (2..).map(|n: u32| format!("{stem}-{n}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        names.find(|name| taken.insert(name.clone())).unwrap_or(stem)
    };
    files.iter().map(free).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_stems_are_told_apart() {
        let files = ["a/x.png", "b/x.png", "x-2.jpg", "x.exr", "y"].map(PathBuf::from);
        assert_eq!(of(&files), ["x", "x-2", "x-2-2", "x-3", "y"]);
    }
}
