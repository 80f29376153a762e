//! The unwrapping methods on image files, with their times: on pictures through a simulated sensor, and on modulo images.

pub mod recover;
pub mod runner;
pub mod simulate;

use std::fs;
use std::path::{Path, PathBuf};

use modulo_images::{EXTENSIONS, has_extension, is_hidden};

use crate::GridError;
use crate::progress::GridEvent;

/// Returns `paths` with the image files of each folder among them in place of the folder, and tells what else is in it.
fn files(paths: &[PathBuf], tell: &dyn Fn(GridEvent<'_>)) -> Result<Vec<PathBuf>, GridError> {
    if paths.is_empty() {
        return Err(GridError::Request(
            "the list of files is empty; at least one entry is needed".to_owned(),
        ));
    }
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            files.extend(images(path, tell)?);
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}

/// Returns the image files of `folder`, sorted by name, and tells how many other files are in it.
fn images(folder: &Path, tell: &dyn Fn(GridEvent<'_>)) -> Result<Vec<PathBuf>, GridError> {
    let io = |source| GridError::io(folder, source);
    let (mut images, mut others) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        // Hidden files hold what systems note about others, such as `._x.png` of macOS.
        if path.is_dir() || is_hidden(&path) {
            continue;
        }
        if has_extension(&path, &EXTENSIONS) { &mut images } else { &mut others }.push(path);
    }
    if images.is_empty() {
        return Err(GridError::of_file(
            folder,
            format!("there is no readable image ({})", EXTENSIONS.join(", ")),
        ));
    }
    // The order of `read_dir` depends on the file system. The results must not.
    images.sort();
    if let Some(first) = others.iter().min() {
        let (folder, count, first) = (folder.display(), others.len(), first.display());
        tell(GridEvent::Warning(&format!(
            "{folder}: skipped {count} files that are no images, the first: {first}"
        )));
    }
    Ok(images)
}
