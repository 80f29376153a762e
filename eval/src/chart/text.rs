//! What the charts of a grid say below their title, and in the names of their files.

use crate::results::Results;
use crate::wording::{Conditions, distinct};

/// Counts, engine and device.
pub fn subtitle(results: &Results) -> String {
    let objects = results.cells.first().map(|cell| &cell.objects);
    let objects = objects.into_iter().flatten().map(|(group, n)| format!("{n} {group}")).collect::<Vec<_>>();
    let devices = distinct(results.cells.iter().map(|cell| {
        let device = &cell.device;
        format!(
            "{} on {}, {}, {}",
            device.engine,
            device.processor,
            counted(device.threads, "thread an inference", "threads an inference"),
            counted(device.jobs, "frame at a time", "frames at a time")
        )
    }));
    let frames = format!("{} labelled frames of {}", results.input.labelled, results.setup.source);
    let objects = format!("objects that count: {}", objects.join(", "));
    [vec![frames, objects], devices].concat().join(" · ")
}

/// The conditions as part of a file's name.
pub fn suffix((psf_sigma, noise): Conditions) -> String {
    format!("psf{psf_sigma}_noise{noise}")
}

/// A name as part of a file's name.
pub fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' }).collect()
}

fn counted(n: usize, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}
