//! Tells the binary its target and its commit: `modulo --version` prints them.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let target = std::env::var("TARGET").expect("cargo sets TARGET for a build script");
    println!("cargo::rustc-env=MODULO_TARGET={target}");
    println!("cargo::rustc-env=MODULO_COMMIT={}", commit().unwrap_or_else(|| "unknown".to_owned()));
}

/// Returns the short hash of the checkout, with `-dirty` when a tracked file was changed; `None` without git, and in a
/// tree that is not a checkout of its own, such as a tarball unpacked within another checkout.
fn commit() -> Option<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).canonicalize().ok()?;
    if Path::new(&git(&["rev-parse", "--show-toplevel"])?).canonicalize().ok()? != root {
        return None;
    }
    // HEAD names a branch; a new commit changes the file of the branch, or the packed one, and the log of HEAD.
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD", "logs/HEAD", "packed-refs"].into_iter().chain(branch.as_deref()) {
        let file = git(&["rev-parse", "--git-path", name])?;
        // Cargo would run this again at every build for a file that is absent.
        if root.join(&file).exists() {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    git(&["describe", "--always", "--dirty", "--abbrev=7", "--exclude=*"])
}

/// Returns the output of a command of git that succeeds.
fn git(arguments: &[&str]) -> Option<String> {
    let mut command = Command::new("git");
    let output =
        command.arg("--no-optional-locks").args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output();
    let output = output.ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
