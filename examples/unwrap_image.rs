//! Exposes a simulated modulo sensor to an image, undoes the wrap, and says whether the result is exact.
//!
//!     cargo run --release --example unwrap_image -- [IMAGE] [ALPHA]
//!
//! Without an image, a frame of the procedural tunnel scene is taken. Writes `modulo.png`, `saturated.png` and
//! `recovered.png` into the current folder.

use std::path::Path;

use modulo_core::unwrap::{Method, Options};
use modulo_core::{Psf, Recovered, Sensor, SensorConfig, tone};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let image = arguments.next().unwrap_or_else(|| "scene://tunnel?seed=3".into());
    let alpha = arguments.next().map_or(Ok(4.0), |alpha| alpha.parse())?;

    // Radiance is H x W x C with full scale 1. The sensor scales it to alpha * 2^bits counts.
    let mut source = modulo_bags::source::open(&image, &Default::default())?;
    let radiance = source.next().ok_or("the source has no frame")??.radiance;
    let psf = Psf::Gaussian { sigma: 1.4 };
    let sensor = Sensor::new(SensorConfig { alpha, psf, ..SensorConfig::default() })?;
    let exposure = sensor.expose(radiance.view(), 0)?;

    // `auto` takes the simplest method that the image allows, and says whether it trusts the result.
    let mut method = Method::Auto.build(&Options::default())?;
    let mut recovered = Recovered::default();
    method.unwrap(&exposure.modulo(), &exposure.scene(), &mut recovered)?;

    let wrong = recovered.k.iter().zip(&exposure.wraps()).filter(|(found, truth)| found != truth).count();
    let report = recovered.report;
    println!("{}: {wrong} of {} wrap counts are wrong, {:?}", report.method, recovered.k.len(), report.trust);
    for (name, frame) in [
        ("modulo.png", exposure.modulo()),
        ("saturated.png", exposure.saturated()),
        ("recovered.png", tone::linear8(&recovered.x, exposure.range())?),
    ] {
        modulo_images::save_png(Path::new(name), &frame)?;
        println!("{name}");
    }
    Ok(())
}
