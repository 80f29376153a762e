//! Videos in the shipped binary: launch, eval, simulate, import and the annotated video; what is no video; and passwords of cameras.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use modulo_bags::IMAGE_TOPIC;
use modulo_bags::bag::{BagReader, Selection};
use modulo_bags::source::{self, SourceOptions};
use modulo_runtime::MessageKind;
use modulo_video::{Encoder, VideoFile};

use crate::harness::{Bench, Peer, arg, data, json, model, text};

/// A video of 12 frames of a rendered scene at 10 Hz; `None`, and the test is skipped, without ffmpeg.
fn video(bench: &Bench) -> Option<PathBuf> {
    if let Err(why) = modulo_video::version() {
        data::skip(&why);
        return None;
    }
    let path = bench.path("drive.mp4");
    let mut scene =
        source::open("scene://day?seed=3&frames=12&width=320&height=192", &SourceOptions::default())
            .expect("a scene");
    let mut encoder = Encoder::create(&path, (320, 192), 10.0).expect("ffmpeg");
    while let Some(frame) = scene.next() {
        let codes = frame.expect("a frame").radiance.mapv(|value| (value * 255.0) as u8);
        encoder.add(&codes.into_raw_vec_and_offset().0).expect("written");
    }
    encoder.finish().expect("written");
    Some(path)
}

#[test]
fn a_video_is_a_source_of_every_command() {
    let bench = Bench::new();
    let Some(video) = video(&bench) else { return };
    let (source, model) = (arg("source", &video), arg("model", model()));
    let (out, annotated) = (bench.path("out"), bench.path("boxes.mp4"));
    let [out_text, annotated_text, video_text] =
        [&out, &annotated, &video].map(|path| path.display().to_string());
    let file = "launch/recovered.launch.yaml";
    let run = bench.run(&["eval", file, &source, &model, "-o", &out_text, "--video", &annotated_text]);
    assert!(run.status.success(), "{}", text(&run));
    assert_eq!(json(&out.join("summary.json"))["frames"], 12);

    let mut written = VideoFile::open(&annotated).expect("a video");
    let frames: Vec<_> =
        std::iter::from_fn(|| written.next_frame()).collect::<Result<_, _>>().expect("frames");
    assert_eq!(
        (frames.len(), frames[11].time_ns),
        (12, Some(1_100_000_000)),
        "the rate is that of the source"
    );
    assert!(frames[0].pixels.frame.height() > 192, "with a title");

    // All frames at the pace of the readers, and the same boxes.
    let summary = bench.path("summary.json");
    let run = bench.run(&["launch", file, &source, &model, "--summary", &summary.display().to_string()]);
    assert!(run.status.success(), "{}", text(&run));
    let (live, lockstep) = (json(&summary), json(&out.join("summary.json")));
    assert_eq!((&live["frames"], &live["detections"]), (&lockstep["frames"], &lockstep["detections"]));

    let bag = bench.path("bag");
    let run = bench.run(&["bag", "import", "video", &video_text, &bag.display().to_string()]);
    assert!(run.status.success() && text(&run).contains("12 frames, 0 missing"), "{}", text(&run));
    let reader = BagReader::open(&bag).expect("a bag");
    let times: Vec<_> = reader
        .messages(&Selection::of([IMAGE_TOPIC]))
        .map(|message| message.expect("readable").log_time)
        .collect();
    assert_eq!(times, (0..12).map(|n| n * 100_000_000).collect::<Vec<u64>>());

    let simulated = bench.path("simulated");
    let run = bench.run(&["simulate", &video_text, "-o", &simulated.display().to_string()]);
    assert!(run.status.success(), "{}", text(&run));
    assert!(simulated.join("drive_000011_alpha4_modulo.png").is_file());
}

#[test]
fn what_is_no_video_ends_with_2_and_a_cut_one_with_3() {
    let bench = Bench::new();
    let Some(video) = video(&bench) else { return };
    let file = |name: &str, content: &[u8]| {
        let path = bench.path(name);
        std::fs::write(&path, content).expect("written");
        path
    };
    let whole = std::fs::read(&video).expect("readable");
    let fast = bench.path("fast.mp4");
    let index_first =
        ["-nostdin", "-v", "error", "-i"].into_iter().map(str::to_owned).chain([video.display().to_string()]);
    let index_first = index_first.chain(["-c", "copy", "-movflags", "+faststart"].map(str::to_owned));
    assert!(Command::new("ffmpeg").args(index_first).arg(&fast).status().expect("ffmpeg starts").success());
    let fast = std::fs::read(&fast).expect("readable");
    for (path, code, expected) in [
        (file("empty.mp4", b""), 2, "is empty"),
        (file("text.mkv", b"Dear reader,\n"), 2, "is no video"),
        (file("cut.mp4", &whole[..whole.len() / 2]), 2, "is truncated"),
        (file("list.mp4", b"ffconcat version 1.0\nfile /etc/passwd\n"), 2, "is a playlist"),
        (file("half.mp4", &fast[..fast.len() * 3 / 4]), 3, "is missing or cannot be decoded"),
    ] {
        let out = bench.path("out").display().to_string();
        let run = bench.run(&[
            "eval",
            "launch/raw.launch.yaml",
            &arg("source", &path),
            &arg("model", model()),
            "-o",
            &out,
        ]);
        let printed = text(&run);
        assert_eq!(run.status.code(), Some(code), "{}: {printed}", path.display());
        assert!(printed.contains(expected) && !printed.contains("root:"), "{printed}");
        let bag = bench.path(&format!("bag-{}", path.file_stem().expect("a name").display()));
        let run =
            bench.run(&["bag", "import", "video", &path.display().to_string(), &bag.display().to_string()]);
        assert_eq!((run.status.code(), bag.exists()), (Some(code), code == 3), "{}", text(&run));
    }
}

#[test]
fn without_ffmpeg_a_video_is_refused_with_the_remedy() {
    let bench = Bench::new();
    let video = bench.path("drive.mp4");
    std::fs::write(&video, "a video").expect("written");
    let source = arg("source", &video);
    for source in [source.as_str(), "source:=rtsp://10.255.255.1/live"] {
        let run =
            bench.modulo(&["launch", "launch/raw.launch.yaml", source]).env("PATH", "/nonexistent").output();
        let run = run.expect("the binary starts");
        assert_eq!(run.status.code(), Some(2), "{}", text(&run));
        assert!(text(&run).contains("apt install ffmpeg"), "{}", text(&run));
    }
    let run = bench.modulo(&["doctor"]).env("PATH", "/nonexistent").output().expect("the binary starts");
    assert!(run.status.success() && text(&run).contains("apt install ffmpeg"), "{}", text(&run));
}

/// The password of a camera that nobody answers for.
const SECRET: &str = "s3cr3t";

#[test]
fn a_password_is_in_no_output() {
    let bench = Bench::new();
    if let Err(why) = modulo_video::version() {
        return data::skip(&why);
    }
    let url = format!("http://admin:{SECRET}@127.0.0.1:9/live?token={SECRET}");
    let source = arg("source", &url);
    let file = "launch/recovered.launch.yaml";
    for arguments in [
        vec!["launch", file, &source, "--print"],
        vec!["launch", file, &source, "alpha:=-1"],
        vec!["launch", file, &source, "no_such:=1"],
        vec!["eval", file, &source, "-o", "/nonexistent/out"],
        vec!["eval", "--source", &url, "-o", "/nonexistent/out"],
        vec!["simulate", &url, "-o", "/nonexistent/out"],
    ] {
        let run = bench.run(&arguments);
        assert!(!text(&run).contains(SECRET), "{arguments:?}: {}", text(&run));
    }

    let bag = bench.path("bag");
    let recorder = bench.record(&bag, &["--all"]);
    let peer = Peer::new(&bench);
    let (state, events) = (
        peer.hear("/modulo_camera/state", MessageKind::Diagnostics),
        peer.hear("/parameter_events", MessageKind::ParameterEvent),
    );
    let summary = bench.path("summary.json");
    let mut launch = bench.modulo(&[
        "launch",
        file,
        &source,
        &arg("model", model()),
        "--summary",
        &summary.display().to_string(),
    ]);
    let launch = launch
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("starts");
    let shown = format!("{:?}", state.next(Duration::from_secs(60)).expect("the state of the camera"));
    assert!(shown.contains("***@127.0.0.1:9") && !shown.contains(SECRET), "{shown}");
    let camera =
        events.until("the parameters of the camera", |event| format!("{event:?}").contains("modulo_camera"));
    assert!(!format!("{camera:?}").contains(SECRET));
    let read = bench.run(&["param", "get", "/modulo_camera", "source"]);
    assert!(text(&read).contains("***@127.0.0.1:9") && !text(&read).contains(SECRET), "{}", text(&read));
    // The node takes its own value back, as from a dump.
    let set = bench.run(&["param", "set", "/modulo_camera", "source", "http://***@127.0.0.1:9/live?***"]);
    assert!(set.status.success(), "{}", text(&set));
    // Attempts that fail are told meanwhile.
    std::thread::sleep(Duration::from_secs(2));
    crate::harness::signal(launch.id(), "INT");
    let ended = launch.wait_with_output().expect("ends");
    assert!(text(&ended).contains("127.0.0.1:9") && !text(&ended).contains(SECRET), "{}", text(&ended));
    recorder.interrupt();
    assert!(!holds(&bag, SECRET) && !holds(&summary, SECRET));
}

/// Whether a file, or one in a folder, holds this text.
fn holds(path: &Path, text: &str) -> bool {
    if path.is_dir() {
        let mut entries = std::fs::read_dir(path).expect("a folder").flatten();
        return entries.any(|entry| holds(&entry.path(), text));
    }
    let bytes = std::fs::read(path).unwrap_or_default();
    bytes.windows(text.len()).any(|part| part == text.as_bytes())
}
