//! Videos in the shipped binary: launch, eval, simulate and detect; what is no video; and passwords of cameras.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use modulo_bags::source::{self, Source, SourceOptions};
use modulo_runtime::MessageKind;

use crate::harness::encoder::write_video;
use crate::harness::{Bench, Peer, arg, assert_has, borrowed, data, text};

/// Makes a video of 12 frames of a rendered scene at 10 Hz; without ffmpeg, the test is skipped.
fn has_video(bench: &Bench) -> bool {
    if let Err(why) = modulo_video::version() {
        data::skip(&why);
        return false;
    }
    let scene = source::open("scene://day?seed=3&frames=12&width=320&height=192", &SourceOptions::default())
        .expect("a scene");
    write_video(&bench.path("drive.mp4"), (320, 192), pictures(scene));
    true
}

/// The codes of the frames of a source.
fn pictures(mut source: Source) -> impl Iterator<Item = Vec<u8>> {
    let frames = std::iter::from_fn(move || source.next());
    frames.map(|frame| {
        let codes = frame.expect("a frame").radiance.mapv(|value| (value * 255.0) as u8);
        codes.into_raw_vec_and_offset().0
    })
}

#[test]
fn a_video_is_a_source_of_every_command() {
    let bench = Bench::new();
    if !has_video(&bench) {
        return;
    }
    let file = "launch/recovered.launch.yaml source:=@/drive.mp4 model:=%";
    bench.says(0, &format!("eval {file} -o @/out --images"));
    assert_eq!(bench.json("out/results.json")["input"]["frames"], 12);
    let boxes = image::open(bench.path("out/boxes/000011.png")).expect("a picture of the last frame");
    assert!(boxes.height() > 192, "with a title");

    // All frames at the pace of the readers.
    bench.says(0, &format!("launch {file} --summary @/summary.json"));
    let live = bench.json("summary.json");
    assert_eq!(live["frames"], 12);

    bench.says(0, "simulate @/drive.mp4 -o @/simulated");
    assert!(bench.path("simulated/drive_000011_alpha4_modulo.png").is_file());

    assert_has(&bench.says(0, "detect @/drive.mp4 --model % -o @/found"), &["12 pictures"]);
    assert!(bench.path("found/drive_000011.png").is_file());
}

#[test]
fn what_is_no_video_ends_with_2_and_a_cut_one_with_3() {
    let bench = Bench::new();
    if !has_video(&bench) {
        return;
    }
    let whole = std::fs::read(bench.path("drive.mp4")).expect("readable");
    let index_first = bench.words("-nostdin -v error -i @/drive.mp4 -c copy -movflags +faststart @/fast.mp4");
    assert!(Command::new("ffmpeg").args(index_first).status().expect("ffmpeg starts").success());
    let fast = std::fs::read(bench.path("fast.mp4")).expect("readable");
    let cases: [(&str, &[u8], i32, &str); 5] = [
        ("empty.mp4", b"", 2, "is empty"),
        ("text.mkv", b"Dear reader,\n", 2, "is no video"),
        ("cut.mp4", &whole[..whole.len() / 2], 2, "is truncated"),
        ("list.mp4", b"ffconcat version 1.0\nfile /etc/passwd\n", 2, "is a playlist"),
        ("half.mp4", &fast[..fast.len() * 3 / 4], 3, "is missing or cannot be decoded"),
    ];
    for (name, content, code, expected) in cases {
        std::fs::write(bench.path(name), content).expect("written");
        let file = format!("launch/raw.launch.yaml source:=@/{name} model:=%");
        let printed = bench.says(code, &format!("eval {file} -o @/out"));
        assert!(printed.contains(expected) && !printed.contains("root:"), "{printed}");
    }
}

/// As dash cameras write them: the second recording begins at the time of the first one.
#[test]
fn recordings_that_were_joined_are_read_to_their_end() {
    let bench = Bench::new();
    if let Err(why) = modulo_video::version() {
        return data::skip(&why);
    }
    let source = "-nostdin -v error -f lavfi -i testsrc2=s=96x64:r=10 -frames:v 10 -c:v libx264 -pix_fmt yuv420p @/one.ts";
    assert!(Command::new("ffmpeg").args(bench.words(source)).status().expect("ffmpeg starts").success());
    let one = std::fs::read(bench.path("one.ts")).expect("readable");
    std::fs::write(bench.path("joined.ts"), [&one[..], &one].concat()).expect("written");
    let printed = bench.says(3, "eval launch/raw.launch.yaml source:=@/joined.ts model:=% -o @/out");
    // The frame at the joint may be cut.
    assert_has(&printed, &["1 frames are not readable", " of 20 is damaged"]);
    assert_eq!(bench.json("out/results.json")["input"]["frames"], 20);
}

#[test]
fn without_ffmpeg_a_video_is_refused_with_the_remedy() {
    let bench = Bench::new();
    std::fs::write(bench.path("drive.mp4"), "a video").expect("written");
    for (line, code) in [
        ("launch launch/raw.launch.yaml source:=@/drive.mp4", 2),
        ("launch launch/raw.launch.yaml source:=rtsp://10.255.255.1/live", 2),
        ("doctor", 0),
    ] {
        let run = bench.modulo(&borrowed(&bench.words(line))).env("PATH", "/nonexistent").output();
        let run = run.expect("the binary starts");
        assert_eq!(run.status.code(), Some(code), "{}", text(&run));
        assert_has(&text(&run), &["apt install ffmpeg"]);
    }
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
    let state = peer.hear("/modulo_camera/state", MessageKind::Diagnostics);
    let events = peer.hear("/parameter_events", MessageKind::ParameterEvent);
    let words = bench.words("model:=% --summary @/summary.json");
    let mut launch = bench.modulo(&[&["launch", file, &source], &borrowed(&words)[..]].concat());
    let launch = launch.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("starts");
    let shown = format!("{:?}", state.next(Duration::from_secs(60)).expect("the state of the camera"));
    assert!(shown.contains("***@127.0.0.1:9") && !shown.contains(SECRET), "{shown}");
    let camera =
        events.until("the parameters of the camera", |event| format!("{event:?}").contains("modulo_camera"));
    assert!(!format!("{camera:?}").contains(SECRET));
    let read = bench.run(&["param", "get", "/modulo_camera", "source"]);
    assert!(text(&read).contains("***@127.0.0.1:9") && !text(&read).contains(SECRET), "{}", text(&read));
    // The node takes its own value back, as from a dump.
    bench.ends(0, &["param", "set", "/modulo_camera", "source", "http://***@127.0.0.1:9/live?***"]);
    // Attempts that fail are told meanwhile.
    std::thread::sleep(Duration::from_secs(2));
    crate::harness::signal(launch.id(), "INT");
    let ended = launch.wait_with_output().expect("ends");
    assert!(text(&ended).contains("127.0.0.1:9") && !text(&ended).contains(SECRET), "{}", text(&ended));
    recorder.interrupt();
    assert!(!holds(&bag, SECRET) && !holds(&bench.path("summary.json"), SECRET));
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
