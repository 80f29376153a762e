//! The unwrapping methods on image files, with their times: on pictures through a simulated sensor, and on modulo images.

pub mod recover;
pub mod runner;
pub mod simulate;

use std::path::PathBuf;

use modulo_bags::source::images_of;

use crate::GridError;
use crate::progress::GridEvent;

/// Returns `paths` with the image files of each folder among them in place of the folder, and tells which others are left out.
fn files(paths: &[PathBuf], tell: &dyn Fn(GridEvent<'_>)) -> Result<Vec<PathBuf>, GridError> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let (images, others) = images_of(path)?;
            files.extend(images);
            others.iter().for_each(|line| tell(GridEvent::Warning(&format!("{}: {line}", path.display()))));
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}
