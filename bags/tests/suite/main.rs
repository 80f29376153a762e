//! Tests of the public interface of the crate, with small inputs that the tests make for themselves.

mod bags;
mod damage;
mod damaged_pictures;
#[path = "../../../tests/harness/data.rs"]
mod data;
mod extras;
mod files;
mod layouts;
#[path = "../../../tests/harness/readings.rs"]
mod readings;
mod sources;
mod spikes;
#[cfg(feature = "sqlite")]
mod sqlite;
mod wounds;

use std::path::{Path, PathBuf};

use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, RawMessage, Selection, WriteOptions};
use modulo_core::Frame;
use modulo_images::save_png;
use modulo_runtime::Qos;
use ndarray::Array3;
use tempfile::TempDir;

/// All compressions.
pub const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

/// One message to write: (topic number, log time in ns, payload).
pub type Line = (usize, u64, Vec<u8>);

/// A folder that lasts as long as the guard, and the path of `name` in it.
pub fn temporary(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    (folder, path)
}

/// Topic number `i`.
pub fn topic(i: usize) -> BagTopic {
    BagTopic::new(&format!("/topic_{i}"), "std_msgs/msg/String", Qos::Results)
}

/// Writes `lines` as a recorder does, in their order; sent 7 ns before they were recorded.
pub fn write_bag(folder: &Path, options: impl Into<WriteOptions>, lines: &[Line]) {
    let mut bag = BagWriter::create(folder, options).expect("a new folder");
    for (i, log_time, data) in lines {
        let id = bag.topic(&topic(*i)).expect("one type");
        bag.write(id, *log_time, log_time.saturating_sub(7), data).expect("written");
        bag.settle(*log_time).expect("flushed");
    }
    bag.finish().expect("finished");
}

/// Writes messages of topics with their types, log times and payloads.
pub fn write_messages<'a>(path: &Path, messages: impl IntoIterator<Item = (&'a str, &'a str, u64, Vec<u8>)>) {
    let mut bag = BagWriter::create(path, Compression::None).expect("a new folder");
    for (topic, type_name, at, payload) in messages {
        let id = bag.topic(&BagTopic::new(topic, type_name, Qos::Images)).expect("one type");
        bag.write(id, at, at, &payload).expect("written");
    }
    bag.finish().expect("finished");
}

/// The bytes of an MCAP file with a message of `length` bytes at each of these times.
pub fn mcap_file(options: mcap::WriteOptions, times: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut mcap = options.create(&mut bytes).expect("a writer");
    let channel_id = mcap.add_channel(0, "/a", "cdr", &Default::default()).expect("a channel");
    for time in times {
        let log_time = (*time).into();
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: 1 };
        mcap.write_to_known_channel(&header, &vec![*time; length]).expect("written");
    }
    mcap.finish().expect("finished");
    drop(mcap);
    bytes.into_inner()
}

/// The selected messages, all of which must be readable.
pub fn read_all(bag: &BagReader, selection: &Selection) -> Vec<RawMessage> {
    bag.messages(selection).collect::<Result<_, _>>().expect("readable messages")
}

/// A small colour image whose pixels depend on `seed`.
pub fn frame(seed: u8) -> Frame {
    let pixels = Array3::from_shape_fn((4, 6, 3), |(y, x, c)| seed ^ (40 * y + 6 * x + c) as u8);
    Frame::from_u8(pixels).expect("4 x 6 x 3")
}

/// A KITTI object folder of `frames` images; every second one is labelled.
pub fn write_kitti(folder: &Path, frames: u8) {
    for name in ["image_2", "label_2"] {
        std::fs::create_dir_all(folder.join(name)).expect("a folder");
    }
    for i in 0..frames {
        save_png(&folder.join(format!("image_2/{i:06}.png")), &frame(i)).expect("a PNG");
        if i % 2 == 0 {
            let text = format!(
                "Car 0.08 1 2.25 0.00 0.5{i} 2.30 3.40 1.78 1.60 4.29 -16.40 1.78 22.09 1.62\n\
                 DontCare -1 -1 -10 1.00 1.00 5.00 3.00 -1 -1 -1 -1000 -1000 -1000 -10\n"
            );
            std::fs::write(folder.join(format!("label_2/{i:06}.txt")), text).expect("a label");
        }
    }
}
