//! Runs the detector node on an image without any transport, and prints the boxes.
//!
//!     cargo run --release --example detect -- [IMAGE] [MODEL.onnx]
//!
//! Without arguments, the embedded demonstration model looks at a frame of the procedural street.

use std::sync::Arc;

use modulo_bags::source;
use modulo_core::{Range, tone};
use modulo_detector::{DEMO, Detector, DetectorParameters};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{Message, NodeName, StampedFrame, SystemClock};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let image = arguments.next().unwrap_or_else(|| "scene://day?seed=1".into());
    let model = arguments.next().unwrap_or_else(|| DEMO.into());

    let radiance =
        source::open(&image, &Default::default())?.next().ok_or("the source has no frame")??.radiance;
    // Radiance of full scale 1 as 8 bits: one exposure of an ideal camera.
    let frame = tone::linear8(&radiance.mapv(|v| v * 256.0), Range::new(8, 1.0)?)?;
    let header = Header { stamp: Time::from_ns(0), frame_id: "camera".into() };

    let detector = Detector::new(&DetectorParameters { model, ..Default::default() })?;
    let clock = SystemClock::default();
    let mut chain = Lockstep::new(&clock, vec!["/detector/detections".into()]);
    chain.add(Box::new(detector), &NodeName::new("detector", "/", &[])?)?;
    let image = Message::Image(Arc::new(StampedFrame { header, frame }));
    for (_, message) in chain.feed("/recovered", image, 0)? {
        let Message::Detections(boxes) = message else { continue };
        for detection in &boxes.detections {
            let (center, best) = (&detection.bbox.center.position, &detection.results[0].hypothesis);
            println!(
                "{:12} {:.2}  centre ({:.0}, {:.0}) px, {:.0} x {:.0} px",
                best.class_id, best.score, center.x, center.y, detection.bbox.size_x, detection.bbox.size_y
            );
        }
    }
    for (stage, ns) in chain.stages() {
        println!("{stage}: {:.2} ms", *ns as f64 / 1e6);
    }
    Ok(())
}
