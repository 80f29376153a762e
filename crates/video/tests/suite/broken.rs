//! Videos that are joined, cut or fragmented, beside what ffmpeg decodes of them: each frame that is whole is given, and no other one.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use modulo_video::{VideoFile, VideoFrame};

use crate::video::{bench, ffmpeg};

/// 60 frames that all differ, in groups of ten.
const SOURCE: &str = "-f lavfi -i testsrc2=s=160x120:r=25 -frames:v 60 -pix_fmt yuv420p";
const H264: &str = "-c:v libx264 -g 10 -bf 2 -crf 12";
/// Frames before a key frame may be predicted from those before it.
const OPEN: &str = "-c:v libx264 -x264-params open-gop=1:bframes=3:keyint=10:min-keyint=10:scenecut=0";

fn frames(path: &Path) -> Vec<Result<VideoFrame, modulo_video::VideoError>> {
    let mut video = VideoFile::open(path).expect("a video");
    std::iter::from_fn(|| video.next_frame()).collect()
}

/// The checksum of each frame that ffmpeg decodes, damaged or not.
fn checksums(path: &Path) -> Vec<String> {
    let is_old =
        ["4.", "5.0"].iter().any(|old| modulo_video::version().is_ok_and(|own| own.starts_with(old)));
    let each = if is_old { "-vsync" } else { "-fps_mode" };
    let listed = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "quiet", "-threads", "1", "-copyts", "-i"])
        .arg(path)
        .args(
            format!("-map 0:V:0 {each} passthrough -vf scale=flags=bicubic,format=rgb24 -f framemd5 -")
                .split(' '),
        )
        .output()
        .expect("ffmpeg starts");
    let text = String::from_utf8(listed.stdout).expect("a list");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.filter_map(|line| Some(line.rsplit(',').next()?.trim().to_owned())).collect()
}

/// A whole video, with its frames and their checksums.
struct Whole {
    bytes: Vec<u8>,
    frames: Vec<VideoFrame>,
    checksums: Vec<String>,
}

impl Whole {
    fn new(path: &Path, options: &str) -> Self {
        ffmpeg(&format!("{SOURCE} {options}"), path);
        let frames: Vec<_> = frames(path).into_iter().map(|frame| frame.expect("whole")).collect();
        assert_eq!(frames.len(), 60, "{}", path.display());
        Self { bytes: std::fs::read(path).expect("readable"), frames, checksums: checksums(path) }
    }

    /// Checks that of the video at `path`, which has parts of this one, all frames are given that ffmpeg decodes as those of this one, but
    /// `most` of them, and no others. Returns the places of the given frames in this one.
    fn check(&self, path: &Path, most: usize) -> Vec<usize> {
        let name = path.display();
        let read = frames(path);
        let places = read.iter().flatten().map(|frame| {
            let place = self.frames.iter().position(|whole| whole.pixels == frame.pixels);
            place.unwrap_or_else(|| panic!("{name}: frame {} is not whole", frame.number))
        });
        let places: Vec<_> = places.collect();
        let whole = checksums(path).iter().filter(|sum| self.checksums.contains(sum)).count();
        assert!(places.len() + most >= whole, "{name}: {} of {whole} frames", places.len());
        let stamps: Vec<_> = read.iter().flatten().filter_map(|frame| frame.time_ns).collect();
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{name}: {stamps:?}");
        places
    }
}

#[test]
fn joined_recordings_keep_each_whole_frame() {
    let Some(bench) = bench() else { return };
    let path = bench.path().join("whole.ts");
    // The frames of a joint that may be left out: the one before it, of which the container reports damage, and those before a key frame that
    // may be predicted from it. Behind a joint of H.264 that is not closed, ffmpeg reports damage of any frame.
    for (options, most) in [(H264, 1), (OPEN, 60), ("-c:v mpeg2video -g 10 -bf 2 -q:v 3", 3)] {
        let whole = Whole::new(&path, options);
        let segment = |number: u32| bench.path().join(format!("{number}.ts"));
        let cut =
            format!("-i {} -c copy -f segment -segment_time 0.4 -segment_format mpegts", path.display());
        ffmpeg(&cut, &bench.path().join("%d.ts"));
        // Each segment has one key frame, and begins with it.
        for order in [&[0, 0, 0][..], &[0, 1, 2, 3, 4, 5], &[0, 2], &[3, 1], &[2, 3, 0, 4, 4]] {
            let parts: Vec<_> =
                order.iter().map(|number| std::fs::read(segment(*number)).expect("a segment")).collect();
            let joined = bench.path().join("joined.ts");
            std::fs::write(&joined, parts.concat()).expect("written");
            let places = whole.check(&joined, (order.len() - 1) * most);
            // In the order of the segments, of which each one gives frames.
            let segments = places.chunk_by(|a, b| a / 10 == b / 10 && a < b).map(|places| places[0] / 10);
            assert!(
                most > 1 || segments.eq(order.iter().map(|number| *number as usize)),
                "{order:?}: {places:?}"
            );
        }
        let joined = bench.path().join("joined.ts");
        std::fs::write(&joined, [&whole.bytes[..], &whole.bytes].concat()).expect("written");
        let places = whole.check(&joined, 1);
        assert!(places.len() >= 119 && places[..59].is_sorted() && places[60..].is_sorted(), "{places:?}");
    }
}

#[test]
fn cut_and_fragmented_videos_keep_each_whole_frame() {
    let Some(bench) = bench() else { return };
    let fragmented = format!("{H264} -movflags frag_keyframe+empty_moov");
    let indexed = format!("{H264} -movflags +faststart");
    for (name, options) in [
        ("a.ts", H264),
        ("a.mkv", H264),
        ("a.avi", H264),
        ("a.flv", H264),
        ("a.h264", H264),
        ("a.mp4", &indexed),
        ("fragmented.mp4", &fragmented),
        ("a.mjpeg", "-c:v mjpeg -q:v 3 -pix_fmt yuvj420p"),
    ] {
        let path = bench.path().join(name);
        let whole = Whole::new(&path, options);
        for percent in [40, 85] {
            let cut = bench.path().join(format!("cut_{name}"));
            std::fs::write(&cut, &whole.bytes[..whole.bytes.len() * percent / 100]).expect("written");
            let places = whole.check(&cut, 0);
            assert!(places.is_sorted() && places[0] == 0 && places.len() > 10, "{name}: {places:?}");
        }
    }
    // As from a recorder that had begun before.
    let path = bench.path().join("begun.ts");
    let whole = Whole::new(&path, H264);
    for percent in [10, 35, 60] {
        std::fs::write(&path, &whole.bytes[whole.bytes.len() * percent / 100..]).expect("written");
        let places = whole.check(&path, 0);
        assert!(places.is_sorted() && places.last() == Some(&59) && places.len() >= 10, "{places:?}");
    }
}

#[test]
fn times_that_wrap_or_vary_are_in_order() {
    let Some(bench) = bench() else { return };
    let wrapped = format!("{H264} -output_ts_offset 95442");
    let steps = "-vf setpts=N*N/25/TB/8 -fps_mode passthrough";
    let varied = format!("{H264} {steps}");
    for (name, options) in
        [("wrapped.ts", wrapped.as_str()), ("varied.mkv", &varied), ("varied.mp4", &varied)]
    {
        let path = bench.path().join(name);
        let whole = Whole::new(&path, options);
        let different: BTreeMap<_, _> = whole.checksums.iter().zip(0..).collect();
        assert_eq!(different.len(), 60, "{name}");
        let places = whole.check(&path, 0);
        assert_eq!(places, (0..60).collect::<Vec<_>>(), "{name}");
        let mut video = VideoFile::open(&path).expect("a video");
        video.skip(33);
        let rest: Vec<_> =
            std::iter::from_fn(|| video.next_frame()).collect::<Result<_, _>>().expect("whole");
        assert!(rest == whole.frames[33..], "{name}");
    }
}
