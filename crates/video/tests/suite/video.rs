//! Videos that ffmpeg makes in the test: each frame once, at its time, in its range and the right way up; and what is no video.

use crate::data;
use std::path::{Path, PathBuf};
use std::process::Command;

use modulo_core::Frame;
use modulo_video::{VideoFile, VideoFrame};

/// A folder, if ffmpeg is there; else the test is skipped.
pub fn bench() -> Option<tempfile::TempDir> {
    match modulo_video::version() {
        Ok(_) => Some(tempfile::tempdir().expect("a folder")),
        Err(why) => {
            data::skip(&why);
            None
        }
    }
}

/// Runs ffmpeg with these options, separated by blanks.
pub fn ffmpeg(options: &str, out: &Path) {
    let made = Command::new("ffmpeg")
        .args(["-nostdin", "-y", "-v", "error"])
        .args(options.split(' '))
        .arg(out)
        .output();
    let made = made.expect("ffmpeg starts");
    assert!(made.status.success(), "{options}: {}", String::from_utf8_lossy(&made.stderr));
}

/// 20 frames of 64 x 48 px at 10 Hz; frame n has the level 10 n + 20 in every channel.
const LEVELS: &str =
    "-f lavfi -i color=black:s=64x48:r=10,format=rgb24,geq=r='10*N+20':g='10*N+20':b='10*N+20' -frames:v 20";

fn video(folder: &Path, name: &str, options: &str) -> PathBuf {
    let path = folder.join(name);
    ffmpeg(&format!("{LEVELS} {options}"), &path);
    path
}

fn open(path: &Path) -> VideoFile {
    VideoFile::open(path).expect("a video")
}

fn all(video: &mut VideoFile) -> Vec<VideoFrame> {
    std::iter::from_fn(|| video.next_frame()).collect::<Result<_, _>>().expect("frames")
}

/// The mean level of a frame as a share of the full scale, times 255.
fn level(frame: &Frame, bits: u32) -> f32 {
    frame.to_f32().mean().expect("pixels") / ((1 << bits) - 1) as f32 * 255.0
}

#[test]
fn each_frame_comes_once_at_its_time() {
    let Some(bench) = bench() else { return };
    for (name, options, bits) in [
        ("a.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3", 8),
        ("full.mp4", "-c:v libx264 -vf scale=out_range=pc,format=yuv420p -color_range pc", 8),
        ("ten.mkv", "-c:v libx265 -pix_fmt yuv420p10le -x265-params log-level=error", 10),
        (
            "twelve.mkv",
            "-c:v ffv1 -pix_fmt gray12le -vf scale=out_range=tv,format=gray12le -color_range tv",
            12,
        ),
        ("a.avi", "-c:v mjpeg -q:v 2", 8),
        ("a.mov", "-c:v prores_ks -pix_fmt yuv422p10le", 10),
        ("a.webm", "-c:v libvpx-vp9 -lossless 1", 8),
        ("grey.mkv", "-c:v ffv1 -pix_fmt gray", 8),
    ] {
        let path = video(bench.path(), name, options);
        let mut video = open(&path);
        assert_eq!(video.frames(), 20, "{name}");
        let rate = video.rate().expect("two times");
        assert!((rate - 10.0).abs() < 0.01, "{name}: {rate}");
        let frames = all(&mut video);
        assert_eq!(frames.len(), 20, "{name}");
        for (n, frame) in frames.iter().enumerate() {
            assert_eq!(
                (frame.number, frame.pixels.bits, frame.pixels.frame.height()),
                (n as u64, bits, 48),
                "{name}"
            );
            let time = frame.time_ns.expect("a time");
            assert!(time.abs_diff(n as u64 * 100_000_000) <= 1_000_000, "{name} {n}: {time}");
            let (level, wanted) = (level(&frame.pixels.frame, bits), 10.0 * n as f32 + 20.0);
            assert!((level - wanted).abs() < 2.5, "{name} {n}: level {level}, {wanted} expected");
        }
        // As after a crash, and in the next round of a loop.
        for from in [0, 1, 7, 19, 20] {
            video.rewind();
            video.skip(from);
            let rest = all(&mut video);
            assert_eq!(rest.len(), 20 - from as usize, "{name} from {from}");
            let differs = rest.iter().zip(&frames[from as usize..]).find(|(a, b)| a != b);
            let expected = differs.map(|(a, b)| {
                (a.number, a.time_ns, b.time_ns, level(&a.pixels.frame, bits), level(&b.pixels.frame, bits))
            });
            assert_eq!(expected, None, "{name} from {from}");
        }
    }
}

#[test]
fn frames_that_an_edit_list_hides_do_not_count() {
    let Some(bench) = bench() else { return };
    let whole = video(bench.path(), "whole.mp4", "-c:v libx264 -pix_fmt yuv420p -g 10 -bf 0");
    let cut = bench.path().join("cut.mp4");
    ffmpeg(&format!("-ss 0.5 -i {} -c copy", whole.display()), &cut);
    let mut cut = open(&cut);
    let frames = all(&mut cut);
    assert_eq!((frames.len() as u64, frames[0].time_ns), (cut.frames(), Some(0)));
    assert!((level(&frames[0].pixels.frame, 8) - 70.0).abs() < 2.5, "the sixth frame is the first one");
    cut.rewind();
    cut.skip(9);
    assert_eq!(all(&mut cut), frames[9..]);
}

#[test]
fn a_video_of_another_transfer_function_is_named() {
    let Some(bench) = bench() else { return };
    for (name, trc, expected) in [
        ("pq.mp4", "smpte2084", Some("PQ")),
        ("hlg.mp4", "arib-std-b67", Some("HLG")),
        ("sdr.mp4", "bt709", None),
    ] {
        let path = video(bench.path(), name, &format!("-c:v libx264 -pix_fmt yuv420p -color_trc {trc}"));
        let warnings = open(&path).warnings();
        assert_eq!(warnings.len(), usize::from(expected.is_some()), "{name}: {warnings:?}");
        assert!(
            expected.is_none_or(|expected| warnings[0].contains(expected) && warnings[0].contains(name)),
            "{warnings:?}"
        );
    }
}

#[test]
fn a_turned_video_is_the_right_way_up() {
    let Some(bench) = bench() else { return };
    let flat = bench.path().join("flat.mp4");
    ffmpeg(
        "-f lavfi -i color=black:s=64x48:r=10,drawbox=0:0:16:16:white:fill -frames:v 3 -c:v libx264 -pix_fmt yuv420p",
        &flat,
    );
    let turned = bench.path().join("turned.mp4");
    // Phones store the picture as the sensor has it, with the angle by which it is to be turned.
    ffmpeg(&format!("-i {} -c copy -metadata:s:v rotate=90", flat.display()), &turned);
    let frames = all(&mut open(&turned));
    let pixels = frames[0].pixels.frame.as_u8().expect("8 bits");
    assert_eq!(pixels.dim(), (64, 48, 3));
    let corners = [(4, 4), (4, 44), (60, 4), (60, 44)].map(|(row, column)| pixels[(row, column, 0)] > 128);
    // Newer versions of ffmpeg turn to the other side for this option.
    assert!([[false, true, false, false], [false, false, true, false]].contains(&corners), "{corners:?}");
}

/// A colour of `yuv420p` was repeated in 2 x 2 pixels, which no lens can do; a recovered image of a smooth scene was then never trusted.
#[test]
fn colours_of_a_smooth_scene_are_smooth() {
    let Some(bench) = bench() else { return };
    let ramp = bench.path().join("ramp.mkv");
    ffmpeg(
        "-f lavfi -i color=gray:s=64x48:r=5,format=yuv420p,geq=lum=128:cb='64+2*X':cr=128 -frames:v 1 -c:v ffv1",
        &ramp,
    );
    let frames = all(&mut open(&ramp));
    let pixels = frames[0].pixels.frame.as_u8().expect("8 bits");
    let blue: Vec<u8> = (8..56).map(|column| pixels[(24, column, 2)]).collect();
    assert!(blue.is_sorted_by(|before, after| before < after), "{blue:?}");
}

#[test]
fn what_is_no_video_says_so() {
    let Some(bench) = bench() else { return };
    let file = |name: &str, content: &[u8]| {
        let path = bench.path().join(name);
        std::fs::write(&path, content).expect("written");
        path
    };
    let whole =
        std::fs::read(video(bench.path(), "whole.mp4", "-c:v libx264 -pix_fmt yuv420p")).expect("readable");
    let sound = bench.path().join("sound.mp4");
    ffmpeg("-f lavfi -i sine -t 1", &sound);
    let secret = file("secret.mp4", &whole);
    for (path, expected) in [
        (file("empty.mp4", b""), "is empty"),
        (file("text.mp4", b"Dear reader,\n"), "is no video, or is truncated"),
        (file("cut.mp4", &whole[..whole.len() / 2]), "is no video, or is truncated"),
        (sound, "no video stream"),
        (file("list.mp4", b"#EXTM3U\n#EXTINF:10\nfile:///etc/passwd\n"), "no video"),
        (
            file("list.m3u8", b"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9\nfile:///etc/passwd\n"),
            "is a playlist",
        ),
        (
            file("concat.mkv", format!("ffconcat version 1.0\nfile {}\n", secret.display()).as_bytes()),
            "is a playlist",
        ),
        (
            file("v.mp4", b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 9\n"),
            "git lfs pull",
        ),
        (bench.path().to_owned(), "not a regular file"),
        (bench.path().join("absent.mp4"), "No such file"),
    ] {
        let why = VideoFile::open(&path).err().expect("no video").to_string();
        assert!(why.contains(expected) && why.contains(&path.display().to_string()), "{why}");
        assert!(!why.contains("root:"), "{why}");
    }
}

#[test]
fn frames_that_are_cut_off_are_counted() {
    let Some(bench) = bench() else { return };
    // With the index first, as videos of the web have it, and as cameras that lose power leave a matroska file.
    let noise = "-vf noise=alls=40:allf=t -c:v libx264 -pix_fmt yuv420p -bf 0";
    for (name, options, expected) in
        [("a.mp4", format!("{noise} -movflags +faststart"), None), ("a.mkv", noise.to_owned(), Some(1))]
    {
        let path = video(bench.path(), name, &options);
        let bytes = std::fs::read(&path).expect("readable");
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).expect("written");
        let mut video = open(&path);
        let read: Vec<_> = std::iter::from_fn(|| video.next_frame()).collect();
        let (good, bad): (Vec<_>, Vec<_>) = read.into_iter().partition(Result::is_ok);
        assert!((8..19).contains(&good.len()), "{name}: {}", good.len());
        assert_eq!(good.len() + bad.len(), expected.map_or(20, |more| good.len() + more), "{name}");
        let why = bad[0].as_ref().expect_err("a loss").to_string();
        assert!(why.contains(name) && why.contains("missing"), "{why}");
    }
}

#[test]
fn a_damaged_frame_within_a_file_is_counted_and_the_others_keep_their_times() {
    const DAMAGED: usize = 10;
    let Some(bench) = bench() else { return };
    let path = video(bench.path(), "a.avi", "-c:v mjpeg -q:v 2 -pix_fmt yuvj420p");
    let whole = all(&mut open(&path));
    let mut bytes = std::fs::read(&path).expect("readable");
    // Each frame of this codec is a JPEG image.
    let starts: Vec<usize> =
        (0..bytes.len() - 2).filter(|&at| bytes[at..].starts_with(&[0xff, 0xd8, 0xff])).collect();
    assert_eq!(starts.len(), whole.len());
    bytes[starts[DAMAGED]..starts[DAMAGED + 1] - 8].fill(0);
    std::fs::write(&path, bytes).expect("written");
    let mut video = open(&path);
    let read: Vec<_> = std::iter::from_fn(|| video.next_frame()).collect();
    let (good, bad): (Vec<_>, Vec<_>) = read.into_iter().partition(Result::is_ok);
    let good: Vec<VideoFrame> = good.into_iter().map(|frame| frame.expect("a frame")).collect();
    let sound: Vec<VideoFrame> = whole
        .into_iter()
        .enumerate()
        .filter(|(number, _)| *number != DAMAGED)
        .map(|(_, frame)| frame)
        .collect();
    assert!(good == sound, "{} of {} frames", good.len(), sound.len());
    assert_eq!(bad.len(), 1, "{bad:?}");
}

/// What a decoder hides is damage all the same, and so is what is predicted from it.
#[test]
fn frames_are_named_from_hidden_damage_to_the_next_key_frame() {
    let Some(bench) = bench() else { return };
    let path = bench.path().join("a.mp4");
    ffmpeg(
        "-f lavfi -i testsrc=s=160x120:r=10 -frames:v 20 -c:v libx264 -pix_fmt yuv420p -g 10 -bf 2 -crf 8",
        &path,
    );
    let whole = all(&mut open(&path));
    let bytes = std::fs::read(&path).expect("readable");
    let mut seen = 0;
    // Behind the first key frame, and before the index at the end.
    for tenth in 3..7 {
        let mut damaged = bytes.clone();
        let place = bytes.len() * tenth / 10;
        damaged[place..place + 120].iter_mut().for_each(|byte| *byte ^= 0x5a);
        std::fs::write(&path, damaged).expect("writable");
        let mut video = open(&path);
        let read: Vec<_> = std::iter::from_fn(|| video.next_frame()).collect();
        assert_eq!(read.len(), 20);
        let named = |frame: &Result<VideoFrame, _>| {
            frame.as_ref().is_err_and(|why: &modulo_video::VideoError| why.to_string().contains("is damaged"))
        };
        let Some(first) = read.iter().position(named) else { continue };
        seen += 1;
        for (frame, whole) in read.iter().zip(&whole) {
            assert!(named(frame) || frame.as_ref() == Ok(whole), "from {first} on: {:?}", whole.number);
        }
    }
    assert!(seen > 0, "ffmpeg reports some of them");
}

#[test]
fn a_killed_ffmpeg_is_started_again_behind_the_last_frame() {
    let Some(bench) = bench() else { return };
    // Larger than the pipe, so that ffmpeg is still there.
    let path = bench.path().join("a.mp4");
    ffmpeg("-f lavfi -i testsrc=s=640x480:r=10 -frames:v 12 -c:v libx264 -pix_fmt yuv420p", &path);
    let whole = all(&mut open(&path));
    let mut video = open(&path);
    let mut frames = Vec::new();
    while let Some(frame) = video.next_frame() {
        frames.push(frame.expect("a frame"));
        if frames.len() % 5 == 0 {
            kill_children(&path);
        }
    }
    assert!(frames == whole, "{} of {} frames", frames.len(), whole.len());
}

/// Kills each ffmpeg that this process has started on this file.
fn kill_children(path: &Path) {
    let own = std::process::id().to_string();
    for entry in std::fs::read_dir("/proc").expect("Linux").flatten() {
        let read = |what: &str| std::fs::read(entry.path().join(what)).unwrap_or_default();
        let (line, stat) = (read("cmdline"), read("stat"));
        let parent = String::from_utf8_lossy(&stat)
            .rsplit_once(") ")
            .map(|(_, rest)| rest.split(' ').nth(1) == Some(&own));
        if parent == Some(true) && String::from_utf8_lossy(&line).contains(&path.display().to_string()) {
            let id = entry.file_name().into_string().expect("a number");
            assert!(Command::new("kill").args(["-KILL", &id]).status().expect("kill starts").success());
        }
    }
}

#[test]
fn a_drive_is_read_as_it_was() {
    let Some(bench) = bench() else { return };
    let Some(drive) = data::shared("data/kitti_seq/drive_0011/image_02") else { return };
    let mut images: Vec<_> =
        std::fs::read_dir(drive).expect("a folder").map(|entry| entry.expect("an image").path()).collect();
    images.sort();
    images.truncate(30);
    let list =
        images.iter().map(|path| format!("file '{}'\n", path.canonicalize().expect("there").display()));
    let (listed, path) = (bench.path().join("list.txt"), bench.path().join("drive.mp4"));
    std::fs::write(&listed, list.collect::<String>()).expect("written");
    let options = "-c:v libx264 -qp 1 -pix_fmt yuv444p";
    ffmpeg(&format!("-f concat -safe 0 -r 10 -i {} {options}", listed.display()), &path);
    let frames = all(&mut open(&path));
    assert_eq!(frames.len(), images.len());
    for (frame, image) in frames.iter().zip(&images) {
        let image = modulo_images::read_image(image).expect("an image").to_f32();
        let error = (&image - &frame.pixels.frame.to_f32()).mapv(f32::abs).mean().expect("pixels");
        assert!(error < 1.5, "frame {}: {error} codes", frame.number);
    }
}

#[test]
fn the_codes_of_a_grey_video_are_those_of_the_sensor() {
    let Some(bench) = bench() else { return };
    let raw = bench.path().join("codes.raw");
    for (bits, format) in [(8, "gray"), (10, "gray10le"), (12, "gray12le"), (16, "gray16le")] {
        let codes: Vec<u16> =
            (0..64 * 48_u32).map(|at| (at.wrapping_mul(2_654_435_761) >> (32 - bits)) as u16).collect();
        let bytes: Vec<u8> = codes
            .iter()
            .flat_map(|code| code.to_le_bytes().into_iter().take(if bits > 8 { 2 } else { 1 }))
            .collect();
        std::fs::write(&raw, bytes).expect("written");
        for (name, options) in [("codes.mkv", "-c:v ffv1"), ("codes.y4m", "-strict -1")] {
            let path = bench.path().join(name);
            let input = raw.display();
            ffmpeg(
                &format!("-f rawvideo -pixel_format {format} -video_size 64x48 -i {input} {options}"),
                &path,
            );
            let frames = all(&mut open(&path));
            let [VideoFrame { pixels, .. }] = &frames[..] else { panic!("{name}: {} frames", frames.len()) };
            assert_eq!((pixels.bits, pixels.frame.dim()), (bits, (48, 64, 1)), "{name} {format}");
            let wrong =
                pixels.frame.to_f32().iter().zip(&codes).filter(|&(&a, &b)| a != f32::from(b)).count();
            assert_eq!(wrong, 0, "{name} {format}");
        }
    }
    // ffmpeg makes colours of a mosaic.
    let mosaic = bench.path().join("mosaic.nut");
    ffmpeg(
        &format!("-f rawvideo -pixel_format bayer_rggb16le -video_size 64x48 -i {} -c copy", raw.display()),
        &mosaic,
    );
    let warnings = open(&mosaic).warnings();
    assert!(warnings.len() == 1 && warnings[0].contains("raw mosaic"), "{warnings:?}");
}
