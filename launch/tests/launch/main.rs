//! Launch files from text to plan to processes.

mod plans;
mod refusals;
mod supervision;

use std::path::PathBuf;

use modulo_launch::{LaunchError, Plan, resolve};
use tempfile::TempDir;

fn owned(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()
}

/// Launch files in a folder of their own.
struct Files(TempDir);

impl Files {
    /// A folder with `main.launch.yaml`.
    fn new(main: &str) -> Self {
        let files = Self(tempfile::tempdir().expect("a folder"));
        files.with("main.launch.yaml", main)
    }

    /// One more file.
    fn with(self, name: &str, text: &str) -> Self {
        std::fs::write(self.path(name), text).expect("written");
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn resolve(&self, arguments: &[(&str, &str)]) -> Result<Plan, LaunchError> {
        resolve(&self.path("main.launch.yaml"), &owned(arguments))
    }

    /// The error, with the folder's path cut off.
    fn refusal(&self, arguments: &[(&str, &str)]) -> String {
        let error = self.resolve(arguments).expect_err("must be refused").to_string();
        error.replace(&format!("{}/", self.0.path().display()), "")
    }
}
