//! Renders frames of a scene to PNG, as the detector sees them (linear, 8 bit),
//! as a clipping camera does, and brightened for the eye.
//!
//! `cargo run --release -p modulo-core --example render_scene -- "glare?seed=3" OUT_FOLDER [FRAME ...]`

use image::{Rgb, RgbImage};
use modulo_core::scene::{Rendered, Scene};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (address, folder) =
        (arguments.next().ok_or("no scene given")?, arguments.next().ok_or("no folder given")?);
    let spec = Scene::parse(&address)?;
    let frames = arguments.map(|a| a.parse()).collect::<Result<Vec<u32>, _>>()?;
    let name = format!("{}_{}", spec.preset.name(), spec.seed);
    for frame in if frames.is_empty() { vec![0] } else { frames } {
        let start = Instant::now();
        let rendered = spec.scene().render(frame, spec.height, spec.width);
        println!(
            "{name} frame {frame}: {:.1} ms, {} objects",
            start.elapsed().as_secs_f64() * 1e3,
            rendered.objects.len()
        );
        let save = |kind: &str, picture: RgbImage| {
            picture.save(Path::new(&folder).join(format!("{name}_{frame}_{kind}.png")))
        };
        save("ideal", picture(&rendered, |x| x))?;
        save("saturated", picture(&rendered, |x| (4.0 * x).min(1.0)))?;
        let mut shown = picture(&rendered, |x| x.sqrt().min(1.0));
        boxes(&mut shown, &rendered);
        save("shown", shown)?;
    }
    Ok(())
}

fn picture(rendered: &Rendered, tone: impl Fn(f32) -> f32) -> RgbImage {
    let (height, width, _) = rendered.radiance.dim();
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        Rgb([0, 1, 2].map(|c| (255.0 * tone(rendered.radiance[[y as usize, x as usize, c]])).round() as u8))
    })
}

/// Outlines every object that is at least half visible.
fn boxes(picture: &mut RgbImage, rendered: &Rendered) {
    for object in rendered.objects.iter().filter(|o| o.occlusion + o.truncation <= 0.5) {
        let b = object.bbox;
        let (x1, y1, x2, y2) = (b.x1 as u32, b.y1 as u32, b.x2 as u32 - 1, b.y2 as u32 - 1);
        let colours = [[60, 220, 60], [60, 200, 240], [250, 160, 40], [250, 80, 80], [240, 80, 240]];
        let colour = Rgb(colours[object.class as usize]);
        (x1..=x2).for_each(|x| [y1, y2].iter().for_each(|&y| picture.put_pixel(x, y, colour)));
        (y1..=y2).for_each(|y| [x1, x2].iter().for_each(|&x| picture.put_pixel(x, y, colour)));
    }
}
