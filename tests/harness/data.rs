//! Test data outside the repository, and what happens to a test where they are absent.

use std::io::Write;
use std::path::{Path, PathBuf};

/// `path` in the folder of test data: `MODULO_SHARED`, else `shared` beside the repository. Where it is absent, the
/// test has to end: it is recorded as skipped.
///
/// # Panics
/// When it is absent although `MODULO_REQUIRE_DATA` is 1.
pub fn shared(path: &str) -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root =
        own.ancestors().find(|folder| folder.join("Cargo.lock").is_file()).expect("a crate of the workspace");
    let folder = std::env::var_os("MODULO_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
    let found = folder.join(path);
    if found.exists() {
        return Some(found);
    }
    let required = std::env::var_os("MODULO_REQUIRE_DATA").is_some_and(|value| value == "1");
    assert!(!required, "MODULO_REQUIRE_DATA = 1, but {} is absent", found.display());
    skip(&format!("{} is absent", found.display()));
    None
}

/// Records that the running test is skipped: prints it, and adds a line to the file that `MODULO_SKIPPED` names.
pub fn skip(why: &str) {
    let test = std::thread::current();
    let line = format!("skipped: {}: {why}\n", test.name().unwrap_or("a test"));
    eprint!("{line}");
    if let Some(path) = std::env::var_os("MODULO_SKIPPED") {
        let mut file = std::fs::File::options()
            .append(true)
            .create(true)
            .open(path)
            .expect("MODULO_SKIPPED is writable");
        file.write_all(line.as_bytes()).expect("MODULO_SKIPPED is writable");
    }
}
