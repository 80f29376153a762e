//! Finds the objects in an image without any transport, and prints their boxes.
//!
//!     cargo run --release --example detect -- [IMAGE] [MODEL.onnx]
//!
//! Without arguments, the embedded demonstration model looks at a frame of the procedural street.

use modulo_bags::source::Pictures;
use modulo_detector::{DEMO, Detector, DetectorParameters};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let image = arguments.next().unwrap_or_else(|| "scene://day?seed=1".into());
    let model = arguments.next().unwrap_or_else(|| DEMO.into());

    let picture = Pictures::open(&image, &Default::default())?.next().ok_or("the source has no frame")??;
    let mut detector = Detector::new(&DetectorParameters { model, ..Default::default() })?;
    for one in detector.find(&picture.pixels)? {
        let bbox = one.bbox;
        println!(
            "{:12} {:.2}  {:.0} {:.0} {:.0} {:.0} px",
            one.class, one.score, bbox.x1, bbox.y1, bbox.x2, bbox.y2
        );
    }
    Ok(())
}
