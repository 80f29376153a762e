//! What a bag holds beside its messages, such as a calibration, survives a copy, or is named.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use modulo_bags::bag::{
    BagInfo, BagReader, BagWarning, Compression, Copied, Extra, ExtraKind, Selection, copy,
};

use crate::{read_all, temporary, write_bag};

/// More than is copied at once.
const CALIBRATION: usize = (5 << 20) / 2;

/// An MCAP file with messages around two attachments, two metadata records and a record of an application.
fn file(options: mcap::WriteOptions) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut mcap = options.create(&mut bytes).expect("a writer");
    let noted = BTreeMap::from([("frame".to_owned(), "camera".to_owned())]);
    let channel_id = mcap.add_channel(0, "/a", "cdr", &noted).expect("a channel");
    let message = |log_time| MessageHeader { channel_id, sequence: 0, log_time, publish_time: 1 };
    mcap.write_to_known_channel(&message(1), &[0; 50]).expect("written");
    for (name, media_type, data) in
        [("calib.yaml", "application/yaml", calibration()), ("empty", "", Vec::new())]
    {
        let (name, media_type) = (name.to_owned(), media_type.to_owned());
        let header = AttachmentHeader { log_time: 3, create_time: 2, name, media_type };
        mcap.start_attachment(data.len() as u64, header).expect("begun");
        mcap.put_attachment_bytes(&data).expect("written");
        mcap.finish_attachment().expect("written");
    }
    for (name, key) in [("drive", "weather"), ("rosbag2", "serialized_metadata")] {
        let metadata = BTreeMap::from([(key.to_owned(), "rain".to_owned())]);
        mcap.write_metadata(&Metadata { name: name.to_owned(), metadata }).expect("written");
    }
    mcap.write_private_record(0x81, b"own", Default::default()).expect("written");
    mcap.write_to_known_channel(&message(2), &[0; 50]).expect("written");
    mcap.finish().expect("finished");
    drop(mcap);
    bytes.into_inner()
}

fn calibration() -> Vec<u8> {
    (0..CALIBRATION).map(|at| (at % 251) as u8).collect()
}

/// Copies the file of these bytes into the folder `out`.
fn copied(bytes: &[u8], out: &Path) -> (BagReader, Copied) {
    let path = out.with_extension("mcap");
    std::fs::write(&path, bytes).expect("writable");
    let bag = BagReader::open(&path).expect("a bag");
    let copied = copy(&bag, out, Compression::Zstd).expect("a new folder");
    (bag, copied)
}

fn kinds(bag: &BagReader) -> Vec<ExtraKind> {
    bag.extras().map(|(_, Extra { kind, .. })| kind.clone()).collect()
}

fn expected() -> Vec<ExtraKind> {
    let attachment = |name: &str, media_type: &str, size| ExtraKind::Attachment {
        name: name.to_owned(),
        media_type: media_type.to_owned(),
        size,
    };
    let calibration = attachment("calib.yaml", "application/yaml", CALIBRATION as u64);
    let metadata = ExtraKind::Metadata { name: "drive".to_owned() };
    vec![calibration, attachment("empty", "", 0), metadata, ExtraKind::Private(0x81)]
}

#[test]
fn attachments_and_metadata_survive_a_copy() {
    let plain = || mcap::WriteOptions::new().compression(None);
    let cut = {
        let mut bytes = file(plain());
        bytes.truncate(bytes.len() - 100);
        bytes
    };
    for (what, bytes) in [
        ("plain", file(plain())),
        ("compressed", file(mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)))),
        ("without chunks", file(plain().use_chunks(false))),
        (
            "without an index of them",
            file(plain().emit_attachment_indexes(false).emit_metadata_indexes(false)),
        ),
        ("without an index", file(plain().emit_summary_records(false).emit_summary_offsets(false))),
        ("cut", cut),
        ("without CRCs", file(plain().calculate_attachment_crcs(false))),
    ] {
        let (_folder, out) = temporary("copy");
        let (bag, copied) = copied(&bytes, &out);
        assert_eq!(kinds(&bag), expected(), "{what}");
        assert_eq!(copied.left_out, [], "{what}");
        let bag = BagReader::open(&out).expect("a bag");
        assert_eq!((kinds(&bag), bag.message_count(), bag.warnings()), (expected(), 2, &[][..]), "{what}");
        let messages = read_all(&bag, &Selection::default());
        assert_eq!(messages[0].topic.metadata["frame"], "camera", "{what}");

        let bytes = std::fs::read(out.join("copy_0.mcap")).expect("there");
        let index = mcap::Summary::read(&bytes).expect("whole").expect("indexed");
        let attachment = mcap::read::attachment(&bytes, &index.attachment_indexes[0]).expect("whole");
        assert_eq!((attachment.log_time, attachment.create_time), (3, 2), "{what}");
        assert!(attachment.data == calibration(), "{what}");
        let drive = index.metadata_indexes.iter().find(|record| record.name == "drive").expect("copied");
        let drive = mcap::read::metadata(&bytes, drive).expect("whole");
        assert_eq!(drive.metadata["weather"], "rain", "{what}");
        let of_file = index.metadata_indexes.iter().filter(|record| record.name == "rosbag2");
        assert_eq!(of_file.count(), 1, "{what}: what describes the file is written anew");
    }
}

#[test]
fn an_attachment_that_is_damaged_is_left_out_by_name() {
    let (_folder, out) = temporary("copy");
    let options = mcap::WriteOptions::new().compression(None).calculate_data_section_crc(false);
    let mut bytes = file(options);
    let place = bytes.windows(10).position(|window| window == b"calib.yaml").expect("there");
    bytes[place + 5000] ^= 1;
    let (bag, copied) = copied(&bytes, &out);
    assert!(!bag.warnings().iter().any(BagWarning::is_loss), "its data are not read: {:?}", bag.warnings());
    let [left_out] = &copied.left_out[..] else { panic!("{:?}", copied.left_out) };
    assert!(
        left_out.is_loss() && left_out.to_string().contains("'calib.yaml' is left out: its CRC is wrong")
    );
    assert_eq!(kinds(&BagReader::open(&out).expect("a bag")), expected()[1..]);

    // A length that contradicts the record is told when the bag is opened.
    bytes[place + 10] ^= 0x40;
    std::fs::write(out.with_extension("mcap"), &bytes).expect("writable");
    let bag = BagReader::open(&out.with_extension("mcap")).expect("a bag");
    assert!(bag.warnings().iter().any(|why| why.is_loss() && why.to_string().contains("is skipped")));
    assert_eq!(bag.message_count(), 2);
}

#[test]
fn info_names_what_is_beside_the_messages() {
    let (_folder, out) = temporary("copy");
    let (bag, _) = copied(&file(mcap::WriteOptions::new()), &out);
    let info = BagInfo(&bag).to_string();
    for line in [
        "Attachments:       2\n                   Name: calib.yaml | Media type: application/yaml | Size: 2.5 MiB\n",
        "Metadata records:  1\n                   Name: drive\n",
    ] {
        assert!(info.contains(line), "{info}");
    }
}

/// `ros2 bag record --custom-data KEY=VALUE`.
#[test]
fn custom_data_survive_a_copy() {
    let (folder, bag) = temporary("bag");
    write_bag(&bag, Compression::None, &[(0, 7, vec![0; 50])]);
    let metadata = bag.join("metadata.yaml");
    let text = std::fs::read_to_string(&metadata).expect("there");
    let noted = "custom_data:\n    car: \"7: red\"\n    driver: no\n";
    assert!(text.contains("custom_data: ~\n"), "{text}");
    std::fs::write(&metadata, text.replace("custom_data: ~\n", noted)).expect("writable");
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    for (from, to) in [(&bag, &first), (&first, &second)] {
        copy(&BagReader::open(from).expect("a bag"), to, Compression::None).expect("a new folder");
    }
    let text = std::fs::read_to_string(second.join("metadata.yaml")).expect("there");
    assert!(text.contains("  custom_data:\n    car: '7: red'\n    driver: 'no'\n"), "{text}");
}
