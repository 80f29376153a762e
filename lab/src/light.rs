//! The nearest object around a change of the light: in which share of the frames is it found, before and after each change?

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Parser;
use modulo_lab::nearest::{change_of, frames_of, is_nearest_found, share};
use modulo_lab::{jsons, percent};
use serde_json::Value;

/// The frames before a change, and those after it, that are looked at.
const BEFORE: i64 = 6;
const AFTER: i64 = 24;
/// The number of frames of a moment: one alone has too few objects.
const LENGTH: i64 = 2;

/// Prints the share of the frames whose nearest object is found: of all frames, and by the frames since a change of the light
#[derive(Parser)]
struct Options {
    /// Folder of the results of `modulo eval` for sources with `light=`
    results: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let Options { results } = Options::parse();
    let frames = frames_of(&jsons(&results.join("frames"))?);
    let mut cells: BTreeMap<String, Vec<(&Value, Option<bool>)>> = BTreeMap::new();
    for (_, cell) in jsons(&results.join("cells"))? {
        let shown = cells.entry(cell["key"]["point"].to_string()).or_default();
        for found in cell["frames"].as_array().into_iter().flatten() {
            let frame = frames.get(&found["place"].as_u64().unwrap_or(u64::MAX));
            shown.extend(frame.map(|frame| (frame, is_nearest_found(frame, found))));
        }
    }
    println!("stream,gains,exposure_delay,change,frame,frames,nearest");
    for (point, found) in &cells {
        let point: Value = serde_json::from_str(point)?;
        let name = ["stream", "gains", "exposure_delay"].map(|key| point[key].to_string().replace('"', ""));
        let print = |change: &str, frame: i64, found: &[Option<bool>]| {
            let nearest = percent(share(found));
            println!("{},{change},{frame},{},{nearest}", name.join(","), found.len());
        };
        print("all", 0, &found.iter().map(|(_, is_found)| *is_found).collect::<Vec<_>>());
        for change in ["darker", "brighter"] {
            for moment in (-BEFORE..AFTER).step_by(LENGTH as usize) {
                let is_here = |frame: &Value| {
                    change_of(frame).is_some_and(|(of_frame, since)| {
                        of_frame == change && (moment..moment + LENGTH).contains(&since)
                    })
                };
                let here = found.iter().filter(|(frame, _)| is_here(frame));
                let here: Vec<Option<bool>> = here.map(|(_, is_found)| *is_found).collect();
                if !here.is_empty() {
                    print(change, moment, &here);
                }
            }
        }
    }
    Ok(())
}
