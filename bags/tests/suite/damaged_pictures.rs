//! Damaged pictures, videos and labels: what is read is what the whole file gives, or the damage is named. What stays unseen is counted, and
//! must not become more.

use std::io::Cursor;
use std::path::Path;
use std::process::Command;

use image::{ImageBuffer, ImageFormat, Rgb};
use modulo_bags::source::{Source, SourceFrame, SourceOptions, open};
use modulo_core::Frame;
use modulo_images::{FileFormat, encode, save_png};

use crate::wounds::wounded;
use crate::{data, frame, write_kitti};

/// Damages `whole` in `count` ways. `read` gives what is read, or `None` if something is named. At most `most` of them may stay unseen, because
/// of what `why` tells.
pub fn damage<T: PartialEq>(
    name: &str,
    whole: &[u8],
    count: u64,
    read: impl Fn(&[u8]) -> Option<T>,
    (most, why): (usize, &str),
) {
    let expected = read(whole).expect("the whole file is read");
    let (mut equal, mut named, mut unseen) = (0, 0, Vec::new());
    for number in 0..count {
        let damaged = wounded(whole, number);
        match read(&damaged.bytes) {
            None => named += 1,
            Some(found) if found == expected => equal += 1,
            Some(_) => unseen.push(damaged.how),
        }
    }
    println!(
        "{name}, {} bytes: {equal} equal, {named} named, {} unseen of {count}: {why}",
        whole.len(),
        unseen.len()
    );
    assert!(unseen.len() <= most, "{name}: {} unseen, at most {most} expected: {unseen:#?}", unseen.len());
}

/// All frames of a source; `None` if anything is named.
fn frames(source: Result<Source, modulo_bags::source::SourceError>) -> Option<Vec<SourceFrame>> {
    let mut source = source.ok()?;
    let frames = std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>().ok()?;
    [source.losses, source.warnings].concat().is_empty().then_some(frames)
}

/// Reads a picture as the only one of a folder.
fn picture(folder: &Path, name: &str) -> impl Fn(&[u8]) -> Option<Vec<SourceFrame>> {
    let (folder, file) = (folder.display().to_string(), folder.join(name));
    move |bytes| {
        std::fs::write(&file, bytes).expect("written");
        frames(open(&folder, &SourceOptions::default()))
    }
}

/// A driving scene of 96 x 64 px.
fn scene() -> SourceFrame {
    let spec = "scene://tunnel?seed=3&frames=1&width=96&height=64";
    open(spec, &SourceOptions::default()).expect("a scene").next().expect("a frame").expect("a good one")
}

const COUNT: u64 = 1000;

#[test]
fn damage_to_pictures_of_codes_is_named() {
    let codes = Frame::from_u8(scene().radiance.mapv(|value| (value.sqrt() * 255.0) as u8)).expect("a frame");
    let folder = tempfile::tempdir().expect("a folder");
    let jpeg = encode(&codes, FileFormat::Jpeg).expect("encoded");
    let why = "JPEG has no checksum, and other values of coefficients have as many codes";
    damage("JPEG", &jpeg, COUNT, picture(folder.path(), "a.jpg"), (310, why));
    let folder = tempfile::tempdir().expect("a folder");
    let png = encode(&codes, FileFormat::Png).expect("encoded");
    damage("PNG", &png, COUNT, picture(folder.path(), "a.png"), (0, "each part of a PNG has a checksum"));
}

#[test]
fn damage_to_pictures_of_radiance_is_named() {
    let radiance = scene().radiance;
    let image =
        ImageBuffer::from_fn(96, 64, |x, y| Rgb([0, 1, 2].map(|c| radiance[(y as usize, x as usize, c)])));
    for (format, name, most, why) in [
        (ImageFormat::OpenExr, "a.exr", 780, "the values of OpenEXR have no checksum"),
        (ImageFormat::Hdr, "a.hdr", 530, "the values of Radiance HDR have no checksum"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).expect("encoded");
        damage(name, file.get_ref(), COUNT, picture(folder.path(), name), (most, why));
    }
}

#[test]
fn damage_to_labels_is_named() {
    let why = "a digit that becomes another one, or a line that is lost, is a label as good as any";
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path();
    write_kitti(&root.join("kitti"), 1);
    let label = root.join("kitti/label_2/000000.txt");
    let whole = std::fs::read(&label).expect("read");
    let read = |bytes: &[u8]| {
        std::fs::write(&label, bytes).expect("written");
        frames(open(&root.join("kitti").display().to_string(), &SourceOptions::default()))
    };
    damage("KITTI", &whole, COUNT, read, (80, why));

    std::fs::create_dir_all(root.join("images")).expect("a folder");
    save_png(&root.join("images/a.png"), &frame(1)).expect("saved");
    let coco = root.join("coco.json");
    let whole = br#"{"images": [{"id": 7, "file_name": "a.png", "width": 6, "height": 4}], "annotations": [{"id": 1, "image_id": 7,
        "category_id": 2, "bbox": [1.25, 0.5, 3.0, 2.75], "iscrowd": 0}], "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "car"}]}"#;
    let read = |bytes: &[u8]| {
        std::fs::write(&coco, bytes).expect("written");
        let source = Source::coco(&coco, Some(&root.join("images")), &SourceOptions::default());
        frames(source)
    };
    damage("COCO", whole, COUNT, read, (30, why));

    std::fs::create_dir_all(root.join("labels")).expect("a folder");
    std::fs::write(root.join("data.yaml"), "names: [car, person]\n").expect("written");
    let label = root.join("labels/a.txt");
    let read = |bytes: &[u8]| {
        std::fs::write(&label, bytes).expect("written");
        let source = Source::yolo(root, &SourceOptions::default());
        frames(source)
    };
    let whole = b"0 0.512345 0.498765 0.250000 0.125000\n1 0.1 0.2 0.5 0.9 0.3 0.4\n";
    damage("YOLO", whole, COUNT, read, (160, why));
}

#[test]
fn damage_to_videos_is_named() {
    if let Err(why) = modulo_video::version() {
        return data::skip(&why);
    }
    let folder = tempfile::tempdir().expect("a folder");
    for (name, codec) in [
        ("a.mp4", "-c:v libx264 -g 5 -bf 2 -crf 12"),
        ("a.ts", "-c:v libx264 -g 5 -bf 2 -crf 12"),
        ("a.avi", "-c:v mjpeg"),
    ] {
        let path = folder.path().join(name);
        let options = format!(
            "-nostdin -y -v error -f lavfi -i testsrc=s=96x64:r=10 -frames:v 20 -pix_fmt yuv420p {codec}"
        );
        let made =
            Command::new("ffmpeg").args(options.split(' ')).arg(&path).status().expect("ffmpeg starts");
        assert!(made.success(), "{name}");
        let whole = std::fs::read(&path).expect("read");
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            let mut source = open(&path.display().to_string(), &SourceOptions::default()).ok()?;
            let frames: Vec<_> = std::iter::from_fn(|| source.next()).map(Result::ok).collect();
            Some(frames)
        };
        let expected = read(&whole).expect("a video");
        // Frames that are named are left out of the comparison.
        let read = |bytes: &[u8]| {
            let found = read(bytes)?;
            let is_whole = |(number, frame): (usize, &Option<SourceFrame>)| {
                frame.is_none() || expected.get(number) == Some(frame)
            };
            let all_named = found.len() < expected.len() && found.iter().all(Option::is_some);
            Some(found.iter().enumerate().all(is_whole) && !all_named)
        };
        damage(
            name,
            &whole,
            20,
            read,
            (12, "other values of coefficients, and fewer frames, are a video as good as any"),
        );
    }
}
