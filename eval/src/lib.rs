//! Evaluation in lockstep: a source's frames go through the same steps as in a
//! live run, each once, in order, and every detector's boxes come out.
//!
//! Nothing here goes through a transport or reads a clock; the same frames and
//! parameters give the same files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use modulo_bags::image_out::{SaveError, save_png};
use modulo_core::Detection;
use modulo_runtime::Message;
use modulo_runtime::driver::RunError;
use modulo_runtime::driver::lockstep::{Lockstep, OnTopic};
use serde_json::{Value, json};

/// Time between two frames whose source has no stamps, ns.
const INTERVAL_NS: u64 = 100_000_000;

/// A detector of the chain and the image stream it reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Name of its files: the image topic without the leading slash, `.` for `/`.
    pub name: String,
    /// Topic of the images.
    pub images: String,
    /// Topic of the boxes.
    pub detections: String,
}

impl Stream {
    /// The stream of images on `images` with boxes on `detections`.
    pub fn new(images: &str, detections: &str) -> Self {
        let name = images.trim_start_matches('/').replace('/', ".");
        Self { name, images: images.to_owned(), detections: detections.to_owned() }
    }
}

/// What is kept of the images that the detectors saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Images {
    /// Nothing.
    Discard,
    /// `FOLDER/STREAM/NUMBER.png`.
    Save,
}

/// Why an evaluation ended early.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A step.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An image could not be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// A file or folder could not be written.
    #[error("{path}: {why}")]
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
}

/// Boxes of every frame by stream; a frame without an answer has none.
pub type Boxes = BTreeMap<String, Vec<Vec<Detection>>>;

/// Drives source `source` of `chain` to its end and collects the boxes of
/// `streams`, into `folder` as `STREAM.json`:
/// `{"000000.png": [[x1, y1, x2, y2, score, "class"], ...], ...}`.
///
/// # Errors
/// [`EvalError`] when a step fails or a file cannot be written.
pub fn run(
    chain: &mut Lockstep<'_>,
    source: usize,
    streams: &[Stream],
    images: Images,
    folder: &Path,
) -> Result<Boxes, EvalError> {
    prepare_folders(streams, images, folder)?;
    let mut boxes: Boxes = streams.iter().map(|s| (s.name.clone(), Vec::new())).collect();
    for number in 0.. {
        let Some(out) = chain.tick(source, number * INTERVAL_NS)? else { break };
        for stream in streams {
            let found = boxes.entry(stream.name.clone()).or_default();
            found.push(detections(&out, &stream.detections));
            if images == Images::Save {
                save(&out, stream, folder, number)?;
            }
        }
    }
    for (name, frames) in &boxes {
        write(&folder.join(format!("{name}.json")), &as_json(frames))?;
    }
    Ok(boxes)
}

fn prepare_folders(streams: &[Stream], images: Images, folder: &Path) -> Result<(), EvalError> {
    let all = streams.iter().map(|s| folder.join(&s.name)).filter(|_| images == Images::Save);
    for path in all.chain([folder.to_owned()]) {
        std::fs::create_dir_all(&path).map_err(|why| EvalError::File { path, why })?;
    }
    Ok(())
}

fn detections(out: &[OnTopic], topic: &str) -> Vec<Detection> {
    let arrays = out.iter().filter(|(name, _)| name == topic);
    arrays
        .filter_map(|(_, message)| match message {
            Message::Detections(array) => Some(array),
            _ => None,
        })
        .flat_map(|array| array.detections.iter().filter_map(|d| d.to_detection()))
        .collect()
}

fn save(out: &[OnTopic], stream: &Stream, folder: &Path, number: u64) -> Result<(), EvalError> {
    for (_, message) in out.iter().filter(|(topic, _)| *topic == stream.images) {
        if let Message::Image(image) = message {
            save_png(&folder.join(&stream.name).join(file_name(number)), &image.frame)?;
        }
    }
    Ok(())
}

fn file_name(number: u64) -> String {
    format!("{number:06}.png")
}

/// One line a frame, so that two runs can be compared with `diff`.
fn as_json(frames: &[Vec<Detection>]) -> String {
    let row =
        |d: &Detection| -> Value { json!([d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2, d.score, d.class]) };
    let line = |(number, frame): (usize, &Vec<Detection>)| {
        let rows: Vec<Value> = frame.iter().map(row).collect();
        format!("  \"{}\": {}", file_name(number as u64), Value::Array(rows))
    };
    let lines: Vec<String> = frames.iter().enumerate().map(line).collect();
    format!("{{\n{}\n}}\n", lines.join(",\n"))
}

fn write(path: &Path, text: &str) -> Result<(), EvalError> {
    std::fs::write(path, text).map_err(|why| EvalError::File { path: path.to_owned(), why })
}
