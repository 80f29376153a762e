//! Writes a training set for the demo detector: raw 8-bit images of the ideal stream and their labels.
//!
//! `cargo run --release -p modulo-scene --example export_scenes -- FOLDER FIRST_SEED SEEDS FRAMES STRIDE`
//!
//! For each preset, seed and frame, `images.u8` gets 192 x 640 x 3 bytes, round(255 x) of the sharp radiance, and
//! `labels.csv` one line for each object: image, preset, seed, frame, class, x1, y1, x2, y2, occlusion,
//! truncation (class -1 for an image without objects).

use modulo_scene::{Preset, Scene, SceneObject};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

const HEIGHT: usize = 192;
const WIDTH: usize = 640;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("no folder given")?);
    let number = |i: usize| {
        arguments
            .get(i)
            .ok_or("five arguments are needed".to_owned())
            .and_then(|a| a.parse::<u32>().map_err(|e| format!("'{a}': {e}")))
    };
    let (first, seeds, frames, stride) = (number(1)?, number(2)?, number(3)?, number(4)?);
    std::fs::create_dir_all(folder)?;
    let mut images = BufWriter::new(File::create(folder.join("images.u8"))?);
    let mut labels = BufWriter::new(File::create(folder.join("labels.csv"))?);
    writeln!(labels, "image,preset,seed,frame,class,x1,y1,x2,y2,occlusion,truncation")?;
    let mut count = 0u32;
    for seed in first..first + seeds {
        for (preset, part) in Preset::ALL.into_iter().zip(0u64..) {
            // Distinct worlds for distinct presets: four times as much traffic to learn from.
            let world = if first >= 1000 { 4 * u64::from(seed) + part } else { u64::from(seed) };
            for frame in (0..frames).map(|f| f * stride) {
                let rendered = Scene::new(preset, world).render(frame, HEIGHT, WIDTH);
                let bytes: Vec<u8> = rendered.radiance.iter().map(|x| (255.0 * x).round() as u8).collect();
                images.write_all(&bytes)?;
                let key = format!("{count},{},{world},{frame}", preset.name());
                rendered.objects.iter().try_for_each(|o| writeln!(labels, "{key},{}", line(o)))?;
                if rendered.objects.is_empty() {
                    writeln!(labels, "{key},-1,0,0,0,0,0,0")?;
                }
                count += 1;
            }
        }
    }
    println!("{count} images of {HEIGHT} x {WIDTH} in {}", folder.display());
    Ok(())
}

fn line(o: &SceneObject) -> String {
    let b = o.bbox;
    format!("{},{},{},{},{},{:.4},{:.4}", o.class as u8, b.x1, b.y1, b.x2, b.y2, o.occlusion, o.truncation)
}
