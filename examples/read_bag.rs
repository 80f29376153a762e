//! Reads a bag (rosbag2 MCAP or SQLite) and prints the size of each image and the boxes of each detection.
//!
//!     cargo run --release --example read_bag -- [BAG]
//!
//! Without a bag, the sample bag of the suite is read.

use std::path::PathBuf;

use modulo_bags::bag::{BagReader, Selection};
use modulo_runtime::{Message, MessageKind};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).map_or("bags/samples/tunnel".into(), PathBuf::from);
    let bag = BagReader::open(&path)?;
    for count in bag.topics() {
        println!("{} [{}]: {} messages", count.topic.name, count.topic.type_name, count.messages);
    }
    for message in bag.messages(&Selection::default()) {
        let message = message?;
        let kind = MessageKind::ALL.iter().find(|kind| kind.type_name() == message.topic.type_name);
        // A bag may have topics of any type; the suite decodes those that its nodes exchange.
        let Some(kind) = kind else { continue };
        match Message::decode(*kind, &message.data)? {
            Message::Image(image) => {
                println!(
                    "{} ns {}: H x W x C = {:?}",
                    message.log_time,
                    message.topic.name,
                    image.frame.dim()
                )
            }
            Message::Detections(boxes) => {
                println!("{} ns {}: {} boxes", message.log_time, message.topic.name, boxes.detections.len())
            }
            _ => {}
        }
    }
    for warning in bag.warnings() {
        eprintln!("{warning}");
    }
    Ok(())
}
