//! The files of the methods: none uses itself by way of others.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the paths of the `use` statements of a file outside its tests.
fn uses(file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).unwrap();
    let text = text.split("#[cfg(test)]").next().unwrap();
    let code: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let of = |statement: &str| statement.rsplit_once("use ").map(|(_, path)| path.to_owned());
    code.join("\n").split(';').filter_map(of).collect()
}

fn words(path: &str) -> impl Iterator<Item = &str> {
    path.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// Returns the files of a folder and of the folders in it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// Returns for each module of a folder those beside it that it uses, by their names or by what `mod.rs` exports of them.
fn modules(folder: &Path, path: &str) -> BTreeMap<String, BTreeSet<String>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let entries: Vec<PathBuf> = entries.filter(|entry| entry.file_name().unwrap() != "mod.rs").collect();
    let name = |entry: &PathBuf| entry.file_stem().unwrap().to_str().unwrap().to_owned();
    let mut names: BTreeMap<String, String> =
        entries.iter().map(|entry| (name(entry), name(entry))).collect();
    for exported in uses(&folder.join("mod.rs")) {
        let mut words = words(&exported).map(str::to_owned).skip_while(|word| word == "self");
        if let Some(module) = words.next().and_then(|module| names.get(&module).cloned()) {
            words.for_each(|word| _ = names.entry(word).or_insert_with(|| module.clone()));
        }
    }
    let used_by = |entry: &PathBuf| {
        let files = if entry.is_dir() { files(entry) } else { vec![entry.clone()] };
        let beside = |file: &Path| file == entry || file.ends_with("mod.rs");
        let paths = files.iter().flat_map(|file| {
            let is_beside = beside(file);
            uses(file)
                .into_iter()
                .filter(move |used| used.starts_with(path) || (is_beside && used.starts_with("super::")))
        });
        let used = paths.flat_map(|path| words(&path).map(str::to_owned).collect::<Vec<_>>());
        used.filter_map(|word| names.get(&word).cloned()).filter(|used| *used != name(entry)).collect()
    };
    entries.iter().map(|entry| (name(entry), used_by(entry))).collect()
}

#[test]
fn no_file_of_the_methods_uses_itself_by_way_of_others() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/unwrap");
    for (folder, path) in [("", "crate::unwrap::"), ("tree", "super::"), ("lines", "super::")] {
        let mut left = modules(&root.join(folder), path);
        assert!(left.values().any(|used| !used.is_empty()), "the files of {folder:?} use each other");
        // What uses nothing that is left is in no circle.
        while let Some(free) = left.iter().find(|(_, used)| used.is_empty()).map(|(name, _)| name.clone()) {
            left.remove(&free);
            left.values_mut().for_each(|used| _ = used.remove(&free));
        }
        assert!(left.is_empty(), "a circle in {folder:?}, or behind one: {left:?}");
    }
}
