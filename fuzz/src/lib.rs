//! The bodies of the fuzz targets: each takes any bytes, and panics where a property does not hold.
//!
//! `cargo fuzz run -s none NAME` looks for such bytes; `tests/suite/corpus.rs` repeats those that are kept.

pub mod bags;
pub mod messages;
pub mod texts;
pub mod vision;

/// The body of a target: it panics when a property does not hold for the input.
pub type Target = fn(&[u8]);

/// All targets by name.
pub const TARGETS: [(&str, Target); 15] = [
    ("cdr", messages::cdr),
    ("dynamic", messages::dynamic),
    ("keys", messages::keys),
    ("schema", messages::schema),
    ("mcap", bags::mcap),
    ("metadata", bags::metadata),
    ("sqlite", bags::sqlite),
    ("spikes", bags::spikes),
    ("kitti", texts::kitti),
    ("coco", texts::coco),
    ("yolo", texts::yolo),
    ("launch", texts::launch),
    ("parameters", texts::parameters),
    ("detector", vision::detector),
    ("unwrap", vision::unwrap),
];

#[allow(dead_code, reason = "the replay of kept inputs goes over the list")]
/// Gives `data` to the target called `name`.
pub fn run(name: &str, data: &[u8]) {
    let (_, target) = TARGETS.iter().find(|(known, _)| *known == name).expect("a listed target");
    target(data);
}

/// A folder with these files, until it is dropped.
fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("below the folder")).expect("writable");
        std::fs::write(path, bytes).expect("writable");
    }
    folder
}
