//! The screen of a user: on a terminal, in a pipe, and with the variables that choose colours.

use std::process::{Command, Output};

use crate::harness::{Bench, assert_has, borrowed, data, text};
use modulo_bags::bag::{BagTopic, BagWriter, Compression};
use modulo_core::{Sensor, SensorConfig};
use modulo_msgs::image::encode_frame;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::Qos;
use ndarray::Array3;

/// Variables that change what is printed.
const VARIABLES: [&str; 5] = ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "CI", "TERM"];

/// The binary with `arguments` and without `VARIABLES`.
fn plain(bench: &Bench, arguments: &[String]) -> Command {
    let mut command = bench.modulo(&borrowed(arguments));
    for name in VARIABLES {
        command.env_remove(name);
    }
    command
}

/// Returns the output of the binary on a terminal of 80 columns; `None` where there is no program `script`.
fn on_terminal(bench: &Bench, variables: &[(&str, &str)], arguments: &[String]) -> Option<Output> {
    let modulo = plain(bench, arguments);
    let words: Vec<_> = [modulo.get_program()]
        .into_iter()
        .chain(modulo.get_args())
        .map(|word| word.to_string_lossy())
        .collect();
    // `script` gives the program a terminal of its own, which has no size until it is set.
    let line = format!("stty cols 80 rows 24; exec '{}'", words.join("' '"));
    let mut script = Command::new("script");
    script.args(["-qefc", &line, "/dev/null"]).current_dir(env!("CARGO_MANIFEST_DIR"));
    for (name, value) in modulo.get_envs() {
        match value {
            Some(value) => script.env(name, value),
            None => script.env_remove(name),
        };
    }
    script.env("TERM", "xterm").envs(variables.iter().copied()).stdin(std::process::Stdio::null());
    match script.output() {
        Ok(output) => Some(output),
        Err(why) => {
            data::skip(&format!("script does not start: {why}"));
            None
        }
    }
}

/// The texts that the progress line had, one after another.
fn progress(screen: &str) -> Vec<&str> {
    let parts = screen.split(['\r', '\n', '\u{1b}']).map(|part| part.trim_start_matches("[2K"));
    parts.filter(|part| part.starts_with("frames ") && part.contains(" infer ")).collect()
}

/// The arguments of a run with the small model on the pictures of the test.
fn run_arguments(bench: &Bench, command: &str) -> Vec<String> {
    bench.words(&format!("{command} launch/recovered.launch.yaml source:=@/images model:=% engine:=rten"))
}

/// The number of frames grows in place, and the summary is the end.
fn assert_redrawn(screen: &str, least: usize) {
    assert!(progress(screen).len() >= least, "{screen:?}");
    let last = screen.rfind(" infer ").expect("a line of progress");
    let summary = screen.find(", engine rten").expect("a summary");
    assert!(last < summary && !screen[summary..].contains("\u{1b}["), "{screen:?}");
    assert!(!screen.contains("INFO") && !screen.contains("DEBUG"), "{screen:?}");
}

#[test]
fn a_terminal_shows_a_line_that_is_redrawn() {
    let bench = Bench::new();
    bench.images(30);
    for command in ["launch", "launch --compose"] {
        let arguments = [run_arguments(&bench, command), bench.words("rate:=10")].concat();
        // A frame that a busy machine leaves out colours its row of the summary.
        let Some(output) = on_terminal(&bench, &[("NO_COLOR", "1")], &arguments) else { return };
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        assert_redrawn(&text(&output), 5);
        assert_has(&text(&output), &[" Hz, infer "]);
    }
}

#[test]
fn an_evaluation_shows_its_frames() {
    let bench = Bench::new();
    bench.images(5);
    let file = "launch/recovered.launch.yaml model:=% engine:=rten";
    let arguments = bench.words(&format!("eval -o @/out --source @/images {file}"));
    let Some(output) = on_terminal(&bench, &[], &arguments) else { return };
    let screen = text(&output);
    assert_eq!(output.status.code(), Some(0), "{screen}");
    assert_has(&screen, &["5/5 frames", "recovered, alpha 4"]);
}

#[test]
fn the_bar_of_a_grid_fits_the_terminal() {
    let bench = Bench::new();
    let scene = "scene://day?seed=3&frames=2&width=96&height=64";
    let options = "--model % --read-noise 0.125 --engine rten -o @/out";
    let arguments = bench.words(&format!("eval --source {scene} {options}"));
    let Some(output) = on_terminal(&bench, &[], &arguments) else { return };
    let screen = text(&output);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{screen}");
    let parts = screen.split(['\r', '\n', '\u{1b}']).map(|part| part.trim_start_matches("[2K"));
    let bars: Vec<&str> =
        parts.filter(|part| part.contains(" frames, ") && part.contains(" left: ")).collect();
    assert!(!bars.is_empty(), "{screen:?}");
    assert!(bars.iter().all(|bar| bar.chars().count() <= 80), "{bars:#?}");
}

#[test]
fn a_pipe_gets_a_line_at_the_start_and_the_summary() {
    let bench = Bench::new();
    bench.images(3);
    for command in ["launch", "launch --compose"] {
        let output = plain(&bench, &run_arguments(&bench, command)).output().expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr);
        let lines: Vec<&str> = error.lines().collect();
        let [start, pictures] = lines[..] else { panic!("two lines: {error}") };
        assert!(start.starts_with("[launch] ") && start.contains("detector"), "{start}");
        assert!(pictures.contains("modulo eval launch/recovered.launch.yaml"), "{pictures}");
        let summary = String::from_utf8_lossy(&output.stdout);
        assert!(summary.starts_with("frames 3, engine rten\n"), "{summary}");
        assert!(!text(&output).contains('\u{1b}') && !text(&output).contains('\r'), "{}", text(&output));
    }
}

#[test]
fn the_command_for_pictures_makes_them() {
    let bench = Bench::new();
    bench.images(2);
    let message = bench.ends(0, &borrowed(&run_arguments(&bench, "launch --compose")));
    let command = message.lines().find_map(|line| line.strip_prefix("pictures with boxes: modulo "));
    let words = command.expect("a command").split(' ').map(|word| word.trim_matches('\''));
    let out = bench.path("pictures").display().to_string();
    let words: Vec<&str> = words.map(|word| if word == "out" { &out } else { word }).collect();
    assert_has(&bench.ends(0, &words), &["pictures/grid.png"]);
    assert!(bench.path("pictures/grid.png").is_file());
}

#[test]
fn verbose_prints_a_line_for_each_frame() {
    let bench = Bench::new();
    bench.images(3);
    for command in ["launch -v", "launch --verbose --compose", "eval --verbose -o @/out"] {
        let message = bench.ends(0, &borrowed(&run_arguments(&bench, command)));
        let is_step = |line: &&str| line.contains("DEBUG") && line.contains(" boxes: ");
        assert_eq!(message.lines().filter(is_step).count(), 3, "{command}: {message}");
    }
}

/// The hint is there exactly when `auto` took the slower engine, and once although four detectors did.
#[test]
fn the_slower_engine_is_told_once() {
    let bench = Bench::new();
    bench.images(1);
    for (engine, hints) in [("auto", 1), ("rten", 0)] {
        let file = "launch --compose launch/compare.launch.yaml source:=@/images model:=%";
        let arguments = bench.words(&format!("{file} engine:={engine}"));
        let output = bench.modulo(&borrowed(&arguments)).env("ORT_DYLIB_PATH", "").output();
        let message = text(&output.expect("it starts"));
        // Where ONNX Runtime is installed system-wide, `auto` finds it without the variable.
        let hints = if message.contains("engine rten") { hints } else { 0 };
        assert_eq!(message.matches("no ONNX Runtime library was found").count(), hints, "{message}");
    }
}

/// zenoh cannot listen: what it logs about that is shown only if it is asked for.
#[test]
fn no_library_writes_on_the_screen() {
    let bench = Bench::new();
    // A port that is taken makes zenoh log a warning, and nothing else goes wrong.
    let accepted = std::net::TcpListener::bind(("127.0.0.1", 0)).expect("a free port");
    let port = accepted.local_addr().expect("a port").port();
    let keys = format!("listen/endpoints=[\"tcp/127.0.0.1:{port}\"];listen/exit_on_failure=false");
    let node = bench.words("run unwrap --ros-args -p wait_for:=[absent] -p wait_timeout:=0.2");
    for (level, shown) in [(None, false), (Some("warn"), true)] {
        let mut command = plain(&bench, &node);
        command.env("ZENOH_CONFIG_OVERRIDE", &keys).envs(level.map(|level| ("RUST_LOG", level)));
        let message = text(&command.output().expect("it starts"));
        assert_eq!(message.contains("Unable to open listener"), shown, "{message}");
        assert_has(&message, &["modulo: /unwrap: waited"]);
    }
}

#[test]
fn launch_without_a_file_lists_the_files_that_it_finds() {
    let bench = Bench::new();
    let listed = |folder: &std::path::Path| {
        let mut command = bench.modulo(&["launch"]);
        let output = command.current_dir(folder).output().expect("it starts");
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        text(&output)
    };
    let here = listed(env!("CARGO_MANIFEST_DIR").as_ref());
    assert!(here.contains("  Detection on the recovered images (p = true).\n"), "{here}");
    assert_eq!(here.matches("\n  recovered ").count(), 1, "{here}");

    // A file of the suite is known by its name, wherever the command is typed.
    let named = |name| {
        let mut command = bench.modulo(&["launch", "--print", name]);
        text(&command.current_dir(bench.folder.path()).output().expect("it starts"))
    };
    assert!(named("recovered.launch.yaml").contains("modulo/detector"), "{}", named("recovered.launch.yaml"));
    assert!(named("gone.launch.yaml").contains("gone.launch.yaml"), "{}", named("gone.launch.yaml"));

    std::fs::create_dir(bench.path("launch")).expect("writable");
    std::fs::write(bench.path("launch/mine.launch.yaml"), "# My own.\nlaunch: []\n").expect("writable");
    std::fs::write(bench.path("launch/readme.md"), "# No launch file.\n").expect("writable");
    let there = listed(bench.folder.path());
    let lines: Vec<&str> = there.lines().collect();
    assert!(lines[1].starts_with("  mine ") && lines[1].ends_with("  My own."), "{there}");
    assert!(there.contains("\n  recovered ") && !there.contains("readme"), "{there}");
}

#[test]
fn the_version_names_engines_target_and_commit() {
    let bench = Bench::new();
    let version = env!("CARGO_PKG_VERSION");
    for (name, arguments) in [("modulo", &[][..]), ("unwrap", &["run", "unwrap"])] {
        let ask = |option| text(&bench.run(&[arguments, &[option]].concat()));
        assert_eq!(ask("-V"), format!("{name} {version}\n"));
        let long = ask("--version");
        let lines: Vec<&str> = long.lines().collect();
        let [first, commit, target, engines] = lines[..] else { panic!("four lines: {long}") };
        assert_eq!(first, format!("{name} {version}"));
        let hash = commit.strip_prefix("commit:  ").expect("the commit").trim_end_matches("-dirty");
        assert!(hash == "unknown" || hash.chars().all(|c| c.is_ascii_hexdigit()), "{commit}");
        assert!(target.starts_with("target:  ") && target.contains(std::env::consts::ARCH), "{target}");
        assert!(engines.contains("rten (built in)") && engines.contains("ONNX Runtime"), "{engines}");
    }
}

#[test]
fn doctor_tells_what_to_expect_of_a_sensor() {
    let bench = Bench::new();
    let line = |name: &str| {
        let message = bench.says(0, &format!("doctor --sensor sensors/{name}.yaml"));
        message.lines().find(|line| line.starts_with("sensor")).expect("a line").to_owned()
    };
    let (paper, mosaic) = (line("paper"), line("mosaic"));
    assert_has(&paper, &["sensor   fit up to alpha"]);
    assert_ne!(paper, mosaic, "a mosaic needs a softer lens");
    bench.says(2, "doctor --sensor sensors/arguments.yaml");
}

/// A chip whose light rises from frame to frame, in a whole bag, and in bags that are no ramps.
#[test]
fn doctor_measures_the_resets_of_a_ramp() {
    let bench = Bench::new();
    let sensor =
        SensorConfig { modulus: 0.99, reset_loss: 2.56, reset_spread: 0.01, ..SensorConfig::default() };
    let sensor = Sensor::new(sensor).expect("a sensor");
    let record = |name: &str, frames: &mut dyn Iterator<Item = u32>| {
        let mut bag = BagWriter::create(&bench.path(name), Compression::Zstd).expect("a new bag");
        let topic = BagTopic::new("/modulo", "sensor_msgs/msg/Image", Qos::Images);
        let topic = bag.topic(&topic).expect("a topic");
        for frame in frames {
            let light = Array3::from_elem((24, 40, 1), frame as f32 / 500.0);
            let exposure = sensor.expose(light.view(), 0).expect("an image");
            let header = Header { stamp: Time::from_ns(u64::from(frame) + 1), ..Header::default() };
            let image = encode_frame(&header, &exposure.modulo()).expect("an image");
            bag.write(topic, u64::from(frame) + 1, u64::from(frame) + 1, &image).expect("writable");
        }
        bag.finish().expect("writable");
    };
    record("ramp", &mut (0..500));
    let found = bench.says(0, "doctor --ramp @/ramp");
    for (name, truth) in [("modulus", 0.99), ("reset_loss", 2.56), ("reset_spread", 0.01)] {
        let line = found.lines().find(|line| line.trim_start().starts_with(name)).expect("a line");
        let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let &[value, error] = &numbers[..] else { panic!("{line}") };
        assert!((value - truth).abs() <= error && error < 1.6, "{line}");
    }
    let findings = bench.says(0, "doctor --ramp @/ramp --json");
    assert_has(&findings, &["\"reset_loss\":["]);
    record("part", &mut (0..500).filter(|frame| !(190..200).contains(frame)));
    record("dark", &mut (0..100));
    for (name, why) in
        [("part", "evenly"), ("dark", "never reset"), ("none", "no such"), ("empty", "/modulo")]
    {
        if name == "empty" {
            BagWriter::create(&bench.path(name), Compression::None)
                .expect("a bag")
                .finish()
                .expect("writable");
        }
        assert_has(&bench.says(2, &format!("doctor --ramp @/{name}")).to_lowercase(), &[why]);
    }
    assert_has(&bench.says(2, "doctor --ramp bags/samples/tunnel"), &["tunnel"]);
}

/// The rules of cargo: `NO_COLOR`, then `CLICOLOR_FORCE`, then whether it is a terminal. For clap's help, and for the log.
#[test]
fn colours_follow_the_variables_and_the_terminal() {
    let bench = Bench::new();
    bench.images(1);
    // A colour or another attribute; moving the cursor is none.
    let coloured = |output: Output| {
        let is_attribute =
            |part: &str| part.trim_start_matches(|c: char| c.is_ascii_digit()).starts_with('m');
        text(&output).split("\u{1b}[").skip(1).any(is_attribute)
    };
    for arguments in [bench.words("--help"), run_arguments(&bench, "launch --compose --verbose")] {
        for (variables, in_pipe, at_terminal) in [
            (&[][..], false, true),
            (&[("NO_COLOR", "1")], false, false),
            (&[("CLICOLOR_FORCE", "1")], true, true),
            (&[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")], false, false),
            (&[("CLICOLOR", "0")], false, false),
            (&[("TERM", "dumb")], false, false),
        ] {
            let piped =
                plain(&bench, &arguments).envs(variables.iter().copied()).output().expect("it starts");
            assert_eq!(coloured(piped), in_pipe, "{arguments:?} {variables:?} in a pipe");
            let Some(shown) = on_terminal(&bench, variables, &arguments) else { return };
            assert_eq!(coloured(shown), at_terminal, "{arguments:?} {variables:?} on a terminal");
        }
    }
}
