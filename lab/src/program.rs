//! The folders of pictures with KITTI's labels, and the program that evaluates a detector on them.

pub mod nearest;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use clap::Args;
use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Frame};
use modulo_images::save_png;
use serde_json::Value;

/// The program, and the detector that it runs.
#[derive(Args)]
pub struct Program {
    /// The program, such as target/release/modulo
    pub program: PathBuf,
    /// YOLO model in ONNX format, or demo: the embedded demonstration
    #[arg(long, default_value = "demo")]
    pub model: String,
    /// Inference engine, as the parameter `engine` of the detector takes it
    #[arg(long, default_value = "auto")]
    pub engine: String,
}

/// Options by which the program detects in the pictures as they are: the ideal image of a perfect sensor with the largest range. A code of a picture
/// stands for light from half a code below to half a code above it, so that one sample in 500 may be a code darker.
const AS_THEY_ARE: &str =
    "--stream ideal --alpha 256 --headroom 1 --psf-sigma 0 --optical-black 0 --deblur off";

impl Program {
    /// Runs an evaluation with `options` on pictures as they are, and returns its results from the folder `out`.
    pub fn evaluate(&self, options: &[&str], out: &Path) -> anyhow::Result<Value> {
        let mut command = Command::new(&self.program);
        command.arg("eval").args(options).args(AS_THEY_ARE.split(' '));
        command.args(["--model", &self.model, "--engine", &self.engine, "--out"]).arg(out);
        run(&mut command)?;
        json(&out.join("results.json"))
    }
}

fn run(command: &mut Command) -> anyhow::Result<()> {
    let output = command.stdin(Stdio::null()).output().with_context(|| format!("{command:?}"))?;
    // Labels that are cut or left out are told, and end with exit code 3.
    let is_done = matches!(output.status.code(), Some(0 | 3));
    ensure!(is_done, "{command:?}: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr));
    Ok(())
}

/// Reads a file of JSON.
fn json(file: &Path) -> anyhow::Result<Value> {
    let text = fs::read(file).with_context(|| file.display().to_string())?;
    serde_json::from_slice(&text).with_context(|| file.display().to_string())
}

/// Returns the files of JSON in a folder, with their content, in the order of their names.
pub fn jsons(folder: &Path) -> anyhow::Result<Vec<(PathBuf, Value)>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
    files.sort();
    files.into_iter().map(|file| Ok((file.clone(), json(&file)?))).collect()
}

/// Writes a picture into `image_2` of a KITTI folder, and makes the folder of its labels.
pub fn write_picture(folder: &Path, name: &str, picture: &Frame) -> anyhow::Result<()> {
    for part in ["image_2", "label_2"] {
        fs::create_dir_all(folder.join(part)).with_context(|| folder.display().to_string())?;
    }
    Ok(save_png(&folder.join("image_2").join(format!("{name}.png")), picture)?)
}

/// Writes labels into `label_2` of a KITTI folder.
pub fn write_labels(folder: &Path, name: &str, labels: &[GroundTruth]) -> anyhow::Result<()> {
    let line = |label: &GroundTruth| {
        let GroundTruth { bbox, class, truncated, occluded } = label;
        let corners = [bbox.x1, bbox.y1, bbox.x2, bbox.y2].map(|corner| corner.to_string()).join(" ");
        format!("{class} {truncated} {occluded} 0 {corners} 0 0 0 0 0 0 0\n")
    };
    let file = folder.join("label_2").join(format!("{name}.txt"));
    fs::write(&file, labels.iter().map(line).collect::<String>()).with_context(|| file.display().to_string())
}

/// Reads the corners of a box.
pub fn bbox(corners: &Value) -> Option<BBox> {
    let at = |corner: usize| corners[corner].as_f64().map(|corner| corner as f32);
    Some(BBox { x1: at(0)?, y1: at(1)?, x2: at(2)?, y2: at(3)? })
}

/// Returns the AP50 of a group in a cell, in percent; `-` without one.
pub fn ap50(cell: &Value, group: &str) -> String {
    percent(cell["ap50"][group].as_f64())
}

/// Returns a fraction in percent; `-` without one.
pub fn percent(fraction: Option<f64>) -> String {
    fraction.map_or_else(|| "-".to_owned(), |fraction| format!("{:.1}", 100.0 * fraction))
}
