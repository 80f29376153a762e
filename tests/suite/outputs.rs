//! What a command writes: its lines to a terminal that takes none, and its results to places where something is already.

use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::harness::{Background, Bench, assert_has, borrowed, in_shell, text};

const SCENE: &str = "source:=scene://day?seed=3&frames=2&width=96&height=64";

/// Runs a line as a shell does after `script`; returns its exit code and what it could print.
fn redirected(bench: &Bench, line: &str, script: &str) -> (Option<i32>, String) {
    let output = in_shell(&bench.modulo(&borrowed(&bench.words(line))), script).output().expect("a shell");
    (output.status.code(), text(&output))
}

/// A full disk of the log ended a launch with a panic before its first frame.
#[test]
fn a_line_of_the_log_that_cannot_be_written_ends_nothing() {
    let bench = Bench::new();
    bench.images(1);
    for (line, result) in [
        (
            &*format!("launch launch/raw.launch.yaml {SCENE} engine:=rten --summary @/summary.json"),
            "summary.json",
        ),
        (
            &format!("launch launch/raw.launch.yaml {SCENE} engine:=rten --compose --summary @/one.json"),
            "one.json",
        ),
        (&format!("eval launch/raw.launch.yaml {SCENE} engine:=rten -o @/eval"), "eval/report.html"),
        (
            "eval --source scene://day?frames=1&width=96&height=64 --engine rten -o @/grid",
            "grid/results.json",
        ),
        ("simulate @/images --alpha 2 -o @/simulated", "simulated/results.json"),
        ("bag convert bags/samples/tunnel @/bag", "bag/metadata.yaml"),
        ("detect @/images --model % -o @/found", "found/000000.png"),
    ] {
        let whole = bench.words(line);
        for script in ["exec 2>/dev/full", "exec 2>&-"] {
            let outcome = redirected(&bench, line, &format!("export RUST_LOG='=;x'; {script}"));
            // No score of a scene without a scored object is a loss, as with a whole log.
            assert!(matches!(outcome.0, Some(0 | 3)), "{script} {whole:?}: {outcome:?}");
            let result = bench.path(result);
            assert!(result.metadata().is_ok_and(|file| file.len() > 0), "{script} {whole:?}");
            let folder = result.parent().filter(|folder| *folder != bench.folder.path());
            folder.map_or_else(|| std::fs::remove_file(&result), std::fs::remove_dir_all).expect("there");
        }
    }
    assert_eq!(redirected(&bench, "bag info /no/such.mcap", "exec 2>/dev/full").0, Some(2));
    assert_eq!(redirected(&bench, "nonsense", "exec 2>/dev/full").0, Some(2));
}

#[test]
fn a_result_that_cannot_be_printed_is_a_failure_and_a_reader_that_has_left_is_none() {
    let bench = Bench::new();
    let launch = format!("launch launch/raw.launch.yaml {SCENE} engine:=rten --summary @/summary.json");
    for line in [
        "bag info bags/samples/tunnel",
        "launch --print launch/raw.launch.yaml",
        "doctor",
        "--help",
        "eval -h",
        "--version",
        &launch,
    ] {
        let (code, message) = redirected(&bench, line, "exec >/dev/full");
        assert_eq!(code, Some(1), "{line}: {message}");
        assert_has(message.lines().last().expect("a reason"), &["standard output", "os error 28"]);
        let mut left = bench.modulo(&borrowed(&bench.words(line)));
        let mut left = left.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        drop((left.stdout.take(), left.stderr.take()));
        assert_eq!(left.wait().expect("it ends").code(), Some(0), "{line}");
        assert_eq!(redirected(&bench, line, "exec >&-").0, Some(0), "{line}");
    }
    assert!(bench.json("summary.json")["frames"] == 2);
    let words = |script: &str| redirected(&bench, "", &format!("export COMPLETE=bash; {script}")).0;
    assert_eq!((words("exec >/dev/full"), words("exec >/dev/null")), (Some(1), Some(0)));
}

/// The launcher stood still with its reader, and no node was supervised any more.
#[test]
fn a_reader_that_stands_still_holds_up_no_process() {
    let bench = Bench::new();
    let noise = "launch:\n  - executable: { name: noise, cmd: sh -c \"yes a line | head -n 200000 >&2\", on_exit: shutdown }\n";
    std::fs::write(bench.path("noise.launch.yaml"), noise).expect("writable");
    let mut launch = bench.modulo(&borrowed(&bench.words("launch @/noise.launch.yaml")));
    let launch = launch.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it starts");
    let (mut launch, start) = (Background(launch), Instant::now());
    while launch.0.try_wait().expect("a child").is_none() && start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(launch.0.wait().expect("it ends").code(), Some(0), "nobody has read its standard error");
}

/// All files below a folder with their content.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let (folders, files): (Vec<PathBuf>, Vec<PathBuf>) = entries.partition(|path| path.is_dir());
    let below = folders.iter().flat_map(|folder| self::files(folder));
    below
        .chain(files.into_iter().map(|file| (file.clone(), std::fs::read(file).expect("readable"))))
        .collect()
}

#[test]
fn no_command_writes_over_a_file_that_it_has_not_made() {
    let bench = Bench::new();
    let images = bench.images(2);
    std::fs::create_dir(bench.path("own")).expect("writable");
    std::fs::copy(images.join("000000.png"), bench.path("own/000001.png")).expect("copied");
    std::fs::write(bench.path("own/drive.mp4"), "no video").expect("writable");
    std::fs::write(bench.path("own/results.json"), "{\"of\": \"somebody else\"}").expect("writable");
    symlink(bench.path("own"), bench.path("link")).expect("writable");
    std::fs::hard_link(bench.path("own/drive.mp4"), bench.path("hard.mp4")).expect("writable");
    let before = files(bench.folder.path());
    let raw = format!("launch/raw.launch.yaml {SCENE} engine:=rten");
    for line in [
        "detect @/own/000001.png --model % -o @/own",
        "detect @/own/000001.png --model % -o @/link",
        "detect @/images --model % -o @/own/../images",
        "simulate @/images --alpha 2 -o @/images",
        "unwrap @/own/000001.png --alpha 2 -o @/own",
        &format!("eval {raw} source:=@/images -o @ --images"),
        &format!("eval {raw} --bag @/own --topics /modulo -o @/out"),
        "eval --source scene://day?frames=1&width=96&height=64 --engine rten -o @/own",
        "eval --source scene://day?frames=1&width=96&height=64 --engine rten -o @/own --fresh",
        "eval --source scene://day?frames=1&width=96&height=64 --engine rten -o @/images --fresh",
        "eval stability -o @/own",
        &format!("launch {raw} --summary @/own/drive.mp4"),
        &format!("launch {raw} --compose --summary @/own/results.json"),
        &format!("launch {raw} --trace @/hard.mp4"),
        &format!("launch {raw} --summary @/a.json --trace @/own/../a.json"),
        "demo --image @/own/000001.png",
        "view --port 0 --record @/own/000001.png",
        "bag convert bags/samples/tunnel @/own",
        "bag record -o @/own",
    ] {
        bench.says(2, line);
        std::fs::remove_file(bench.path("a.json")).ok();
        assert!(files(bench.folder.path()) == before, "{line} has written something");
        assert!(!bench.path("out").exists(), "{line}");
    }
}

/// The results of an earlier run are replaced where they are known as such, and never mixed.
#[test]
fn results_of_an_earlier_run_are_replaced_or_refused() {
    let bench = Bench::new();
    let launch = |frames: u32| {
        let line = format!(
            "launch launch/raw.launch.yaml source:=scene://day?frames={frames}&width=96&height=64 engine:=rten"
        );
        bench.says(0, &format!("{line} --summary @/summary.json --trace @/trace.json"))
    };
    launch(1);
    assert_has(&launch(2), &["summary.json: is of an earlier run", "trace.json: is of an earlier run"]);
    assert_eq!(bench.json("summary.json")["frames"], 2);
    assert_eq!(files(bench.folder.path()).len(), 2, "nothing is left beside them");
    let images = bench.images(1).display().to_string();
    bench.says(0, &format!("simulate {images} --alpha 2 -o @/out"));
    let before = files(&bench.path("out"));
    assert_has(
        &bench.says(2, &format!("simulate {images} --alpha 3 -o @/out")),
        &["/out", "not empty", "mix"],
    );
    assert!(files(&bench.path("out")) == before);
}

/// Three simulations that were started at the same time had two folders.
#[test]
fn runs_that_start_together_have_a_folder_each() {
    let bench = Bench::new();
    let images = bench.images(1).display().to_string();
    let start = |alpha: &str| {
        let mut command = bench.modulo(&["simulate", &images, "--alpha", alpha]);
        command
            .current_dir(bench.folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it starts")
    };
    let runs = ["1", "2", "3"].map(start).map(|run| Background(run).errors());
    let folders: BTreeMap<_, _> =
        runs.iter().map(|(code, message)| (message.lines().last().expect("a folder"), code)).collect();
    assert_eq!(folders.len(), 3, "{runs:?}");
    for number in ["1", "2", "3"] {
        let folder = bench.path("runs/images").join(number);
        let alphas: Vec<_> =
            crate::harness::json(&folder.join("results.json")).as_array().expect("rows").clone();
        assert_eq!((alphas.len(), std::fs::read_dir(&folder).expect("there").count()), (1, 6), "{number}");
    }
    // A help text and a refused command take no number.
    let here = |arguments: &[&str]| {
        bench.modulo(arguments).current_dir(bench.folder.path()).output().expect("it starts")
    };
    here(&["eval", "--help"]);
    assert_eq!(here(&["simulate", "/no/such.png"]).status.code(), Some(2));
    assert_eq!(std::fs::read_dir(bench.path("runs/images")).expect("there").count(), 3);
    assert!(!bench.path("runs/eval").exists());
}

/// The player had "crashed", and its reason stood two lines above.
#[test]
fn a_replay_of_what_is_no_bag_is_refused_with_the_reason() {
    let bench = Bench::new();
    std::fs::write(bench.path("text.mcap"), "no bag").expect("writable");
    for (bag, topic, reason) in [
        ("/not/there", "/modulo", "/not/there: No such file"),
        ("@/text.mcap", "/modulo", "not a bag"),
        ("bags/samples/tunnel", "/elsewhere", "/elsewhere"),
    ] {
        let message = bench.says(2, &format!("launch launch/replay.launch.yaml bag:={bag} bag_topic:={topic} bag_sensor_info:={topic} model:=%"));
        assert_has(message.lines().last().expect("a reason"), &["player", reason]);
        assert!(!message.contains("crashed"), "{message}");
    }
}
