//! Runs the shipped binary as a user would, each test in a ROS domain of its
//! own so that tests do not hear each other.

#![allow(dead_code, reason = "each test binary uses its part")]

pub mod peer;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

/// A folder and a domain of one test.
pub struct Bench {
    /// Files of this test.
    pub folder: TempDir,
    pub domain: u32,
}

impl Bench {
    /// `domain` must be used by no other test.
    pub fn new(domain: u32) -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder"), domain }
    }

    /// A path in the test's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The binary with `arguments`, not started yet.
    pub fn modulo(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_modulo"));
        command
            .args(arguments)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("ROS_DOMAIN_ID", self.domain.to_string())
            .env_remove("MODULO_REPORT_DIR")
            .env_remove("MODULO_STATE_DIR")
            .env_remove("MODULO_LAUNCHER_PID")
            .env_remove("ZENOH_SESSION_CONFIG_URI")
            .env_remove("ZENOH_CONFIG_OVERRIDE")
            .env_remove("RUST_LOG")
            .stdin(Stdio::null());
        command
    }

    /// Runs it to its end.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.modulo(arguments).output().expect("the binary starts")
    }

    /// Starts it in the background.
    pub fn start(&self, arguments: &[&str]) -> Background {
        let child = self.modulo(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        Background(child.expect("the binary starts"))
    }

    /// `count` small images with a bright square that moves.
    pub fn images(&self, count: u32) -> PathBuf {
        let folder = self.path("images");
        std::fs::create_dir_all(&folder).expect("a writable folder");
        for number in 0..count {
            let image = image::RgbImage::from_fn(96, 64, |x, y| {
                let inside = (x.wrapping_sub(10 + 3 * number) < 20) && (20..40).contains(&y);
                let shade = (x + y) as u8;
                if inside { image::Rgb([shade + 60, shade + 80, shade]) } else { image::Rgb([shade; 3]) }
            });
            image.save(folder.join(format!("{number:06}.png"))).expect("a writable folder");
        }
        folder
    }
}

/// Waits until `done`, at most a minute.
pub fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A process that is ended with the test.
pub struct Background(pub Child);

impl Background {
    /// Sends SIGINT and waits for the end.
    pub fn interrupt(mut self) -> Option<i32> {
        let pid = self.0.id().to_string();
        let sent = Command::new("kill").args(["-INT", &pid]).status();
        assert!(sent.is_ok_and(|status| status.success()), "the process is there");
        self.0.wait().expect("it ends").code()
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The small model of the detector's own tests: boxes that depend on the image.
pub fn model() -> String {
    format!("{}/nodes/detector/tests/data/rows.onnx", env!("CARGO_MANIFEST_DIR"))
}

/// `name:=value`.
pub fn arg(name: &str, value: impl AsRef<Path>) -> String {
    format!("{name}:={}", value.as_ref().display())
}

/// Standard output and error as text.
pub fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// A JSON file.
pub fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|why| panic!("{}: {why}", path.display()));
    serde_json::from_str(&text).expect("JSON")
}

/// Detections by class of one stream of a summary.
pub fn classes(summary: &Value, stream: &str) -> BTreeMap<String, u64> {
    let classes = summary["detections"][stream].as_object().cloned().unwrap_or_default();
    classes.into_iter().map(|(class, n)| (class, n.as_u64().expect("a count"))).collect()
}

/// The shared test data, if it is here.
pub fn shared() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let folder = std::env::var_os("MODULO_SHARED").map_or(beside, PathBuf::from);
    let found = folder.join("data/kitti_object").is_dir();
    if !found {
        eprintln!("skipped: no test data at {} (MODULO_SHARED)", folder.display());
    }
    found.then_some(folder)
}
