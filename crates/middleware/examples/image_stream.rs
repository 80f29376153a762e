//! Publishes images of 1.4 MB on `/images`, for tests of readers that are too slow.
//!
//!     cargo run --release -p modulo-runtime --example image_stream -- MB_PER_SECOND SECONDS
//!
//! Waits for a subscriber first. The stamp of image n is n nanoseconds, from 0. Half a second after the others one more
//! image follows, so that a reader sees from its number how many it has lost before it. Prints the number of images.

use std::sync::Arc;
use std::time::{Duration, Instant};

use modulo_core::Frame;
use modulo_middleware::transport::Transport;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::{Address, Message, MessageKind, NodeName, Qos, StampedFrame, SystemClock};
use ndarray::Array3;

const SHAPE: (usize, usize, usize) = (375, 1242, 3);

fn main() {
    let numbers: Vec<f64> = std::env::args().skip(1).map(|n| n.parse().expect("a number")).collect();
    let [mega_bytes, seconds] = numbers[..] else { panic!("image_stream MB_PER_SECOND SECONDS") };
    let domain = std::env::var("ROS_DOMAIN_ID").map_or(0, |id| id.parse().expect("a number"));
    let clock = Arc::new(SystemClock::default());
    let transport = ZenohTransport::open(domain, Hashes::Rihs01, clock).expect("a session");
    let node_name = NodeName::new("image_stream", "/", &[]).expect("a name");
    let address =
        Address { topic: "/images".into(), kind: MessageKind::Image, qos: Qos::Images, profile: None };
    let publisher = transport.advertise(&node_name, &address).expect("a publisher");
    let frame = Frame::from_u8(Array3::from_shape_fn(SHAPE, |(i, j, c)| (i + j + c) as u8)).expect("a frame");
    let send = |number: u32| {
        let header = Header { stamp: Time::from_ns(number.into()), frame_id: "camera".into() };
        let image = StampedFrame { header, frame: frame.clone() };
        publisher.put(&Message::Image(Arc::new(image))).expect("sent");
    };
    while !publisher.wanted() {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(transport.settling());
    let rate = mega_bytes * 1e6 / (SHAPE.0 * SHAPE.1 * SHAPE.2) as f64;
    let (images, start) = ((rate * seconds) as u32, Instant::now());
    for number in 0..images {
        // Measured from the start, so that the delays of single sends do not add up.
        std::thread::sleep(Duration::from_secs_f64(f64::from(number) / rate).saturating_sub(start.elapsed()));
        send(number);
    }
    std::thread::sleep(Duration::from_millis(500));
    send(images);
    println!("{}", images + 1);
    std::thread::sleep(transport.settling());
}
