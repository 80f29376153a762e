//! The places of an ONNX Runtime library. This file loads no library.

use std::path::{Path, PathBuf};

/// Returns the places that this process tries, in order.
pub fn places_here() -> Vec<PathBuf> {
    let variable = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    places(variable, std::env::current_exe().ok().as_deref())
}

/// Returns the places in the order in which they are tried: `$ORT_DYLIB_PATH`, beside the program, the install's
/// library folder, the system's loader.
fn places(variable: Option<PathBuf>, program: Option<&Path>) -> Vec<PathBuf> {
    let name = format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let folder = program.and_then(Path::parent);
    let beside = folder.map(|folder| folder.join(&name));
    let installed = folder.map(|folder| folder.join("../lib/modulo").join(&name));
    variable
        .filter(|path| !path.as_os_str().is_empty())
        .into_iter()
        .chain(beside)
        .chain(installed)
        .chain([PathBuf::from(&name)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_comes_first_and_the_loader_last() {
        let found = places(Some("/opt/my.so".into()), Some(Path::new("/usr/bin/modulo")));
        assert_eq!(found.first().map(PathBuf::as_path), Some(Path::new("/opt/my.so")));
        assert!(found.iter().any(|place| place.starts_with("/usr/bin/../lib/modulo")));
        assert_eq!(found.last().and_then(|place| place.parent()), Some(Path::new("")));
        assert_eq!(places(Some("".into()), None).len(), 1);
    }
}
