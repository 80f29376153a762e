//! `modulo eval` as a grid, through the shipped binary: the same bytes again, killed and resumed, in shards.

mod harness;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harness::{Bench, json, text, wait_until};
use serde_json::Value;

/// Small enough for every cell to be over in a moment.
const SCENE: &str = "scene://day?seed=3&frames=4&width=320&height=128";

fn arguments(out: &Path) -> Vec<String> {
    let out = out.to_str().expect("UTF-8");
    let words = ["eval", "--source", SCENE, "--alpha", "2,4", "--engine", "rten", "-o", out];
    words.map(str::to_owned).to_vec()
}

fn run(bench: &Bench, out: &Path, more: &[&str]) -> Option<i32> {
    let arguments = arguments(out);
    let all: Vec<&str> = arguments.iter().map(String::as_str).chain(more.iter().copied()).collect();
    let output = bench.run(&all);
    eprintln!("{}", text(&output));
    output.status.code()
}

/// The cells in `results.json`.
fn cells(folder: &Path) -> Vec<Value> {
    json(&folder.join("results.json"))["cells"].as_array().expect("cells").clone()
}

/// The file of the frames of a cell.
fn file(cell: &Value) -> String {
    format!("{}.jsonl", cell["name"].as_str().expect("a name"))
}

/// The frames of a cell.
fn frames(folder: &Path, cell: &Value) -> Vec<Value> {
    let text = std::fs::read_to_string(folder.join("frames").join(file(cell))).expect("frames");
    text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

/// The sum of a figure, which counts as 0 where it does not exist.
fn sum(frames: &[Value], figure: &str) -> f64 {
    frames.iter().map(|frame| frame.pointer(figure).and_then(Value::as_f64).unwrap_or_default()).sum()
}

/// Checks that the frames and boxes of each cell add up to the figures of the cell.
fn check_lines(folder: &Path, results: &Value) {
    for cell in results["cells"].as_array().expect("cells") {
        let frames = frames(folder, cell);
        assert_eq!(frames.len(), 4);
        let near = |value: f64, figure: &Value, what: &str| {
            let figure = figure.as_f64().expect(what);
            assert!(
                (value - figure).abs() < 1e-9,
                "{what} of {}: {value}, in the cell {figure}",
                cell["name"]
            );
        };
        for name in ["iou", "f1", "accuracy"] {
            near(sum(&frames, &format!("/paper/{name}")) / 4.0, &cell["paper"][name], name);
        }
        for group in ["vehicle", "person"] {
            let count = |what: &str| sum(&frames, &format!("/groups/{group}/{what}"));
            near(count("objects"), &cell["objects"][group], "objects");
            assert_eq!(count("true_positives") + count("false_negatives"), count("objects"));
            let boxes = frames.iter().flat_map(|frame| frame["boxes"].as_array().expect("boxes"));
            let right = |found: &&Value| found["group"] == group && found["outcome"] == "true positive";
            let certain = |found: &&Value| found["score"].as_f64().expect("a score") >= 0.25;
            assert_eq!(boxes.filter(right).filter(certain).count() as f64, count("true_positives"));
        }
        if cell["exact_k"].is_null() {
            let plain =
                |frame: &Value| matches!(frame.pointer("/recovery/samples"), None | Some(Value::Number(_)));
            assert!(frames.iter().all(plain) && sum(&frames, "/recovery/samples") == 0.0);
            continue;
        }
        near(
            sum(&frames, "/recovery/exact") / sum(&frames, "/recovery/samples"),
            &cell["exact_k"],
            "exact k",
        );
        near(sum(&frames, "/recovery/ideal/ssim") / 4.0, &cell["ssim"], "SSIM");
        let share = |is: fn(&Value) -> bool| {
            frames.iter().filter(|frame| is(&frame["recovery"])).count() as f64 / 4.0
        };
        near(share(|of| of["exact"] == of["samples"]), &cell["exact_frames"], "exact frames");
        near(
            share(|of| of["trusted"] == true),
            &cell["trusted"].as_f64().unwrap_or_default().into(),
            "trusted",
        );
        assert_eq!(share(|of| of["method_used"].as_str().is_some_and(|name| !name.is_empty())), 1.0);
    }
}

/// The files of the frames by their names.
fn lines(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files =
        std::fs::read_dir(folder.join("frames")).expect("frames").map(|file| file.expect("a file").path());
    let name = |file: &Path| file.file_name().expect("a name").to_string_lossy().into_owned();
    files.map(|file| (name(&file), std::fs::read(&file).expect("readable"))).collect()
}

/// `results.json` without its times, without the machine that they were measured on, and without the commands.
fn timeless(folder: &Path) -> Value {
    let mut results = json(&folder.join("results.json"));
    let runs = results.as_object_mut().expect("results").remove("runs").expect("runs");
    assert!(runs[0]["command"].as_str().is_some_and(|command| command.contains(SCENE)), "{runs}");
    for cell in results["cells"].as_array_mut().expect("cells") {
        let (times, frame) = (cell["latency_ms"].clone(), cell["frame_ms"].clone());
        remove_times(cell);
        assert!(times["infer"]["p50"].as_f64().expect("a time") > 0.0, "{times}");
        let [p50, low, high, cpu] =
            [&frame["p50"], &frame["interval95"][0], &frame["interval95"][1], &frame["cpu_ms"]]
                .map(|value| value.as_f64().expect("a time"));
        assert!(low <= p50 && p50 <= high && cpu > 0.0 && frame["frames"] == 20, "{frame}");
    }
    results
}

fn remove_times(cell: &mut Value) {
    let cell = cell.as_object_mut().expect("a cell");
    for name in ["latency_ms", "frame_ms", "device"] {
        cell.remove(name).expect("times");
    }
}

fn whole(bench: &Bench) -> PathBuf {
    let out = bench.path("whole");
    assert_eq!(run(bench, &out, &[]), Some(0));
    out
}

#[test]
fn the_same_command_gives_the_same_figures_however_it_is_cut() {
    let bench = Bench::new();
    let whole = whole(&bench);
    let expected = timeless(&whole);
    let cells = expected["cells"].as_array().expect("cells");
    assert_eq!(cells.len(), 2 * 8, "two alphas, eight ways each");
    check_lines(&whole, &expected);
    assert!(json(&whole.join("results.json"))["runs"][0]["wall_s"].as_f64().expect("seconds") > 0.0);

    let again = bench.path("again");
    assert_eq!(run(&bench, &again, &["--jobs", "1"]), Some(0));
    assert_eq!(timeless(&again).to_string(), expected.to_string());
    assert!(lines(&again) == lines(&whole));

    // As a Slurm array does it: processes that know nothing of each other.
    let shards: Vec<PathBuf> = (1..=3).map(|i| bench.path(&format!("shard{i}"))).collect();
    for (i, shard) in (1..).zip(&shards) {
        assert_eq!(run(&bench, shard, &["--shard", &format!("{i}/3")]), Some(0));
    }
    let merged = bench.path("merged");
    let folders: Vec<&str> = shards.iter().map(|shard| shard.to_str().expect("UTF-8")).collect();
    let words = [vec!["eval", "merge", merged.to_str().expect("UTF-8")], folders].concat();
    let part = bench.run(&words[..words.len() - 1]);
    assert_eq!(part.status.code(), Some(3), "a shard is missing: {}", text(&part));
    assert_eq!(bench.run(&words).status.code(), Some(0));
    assert_eq!(timeless(&merged).to_string(), expected.to_string());
    assert!(lines(&merged) == lines(&whole));
}

#[test]
fn a_killed_run_goes_on_where_it_stopped() {
    let bench = Bench::new();
    let expected = timeless(&whole(&bench)).to_string();
    let out = bench.path("killed");
    let arguments = arguments(&out);
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let cells = || {
        let mut cells = if out.join("results.json").is_file() { cells(&out) } else { Vec::new() };
        cells.iter_mut().for_each(remove_times);
        cells
    };
    for _ in 0..3 {
        let (before, child) = (cells(), bench.start(&words));
        wait_until("another cell is done", || cells().len() > before.len());
        assert_eq!(child.end("KILL").0, None, "it was still at work");
        assert!(before.iter().all(|cell| cells().contains(cell)), "a cell was made again");
    }
    let before = cells();
    assert_eq!(run(&bench, &out, &[]), Some(0));
    assert_eq!(timeless(&out).to_string(), expected);
    assert!(lines(&out) == lines(&bench.path("whole")));
    let whole = cells();
    assert!(before.len() < whole.len() && before.iter().all(|cell| whole.contains(cell)));

    let kept = || json(&out.join("results.json"))["cells"].clone();
    let before = kept();
    assert_eq!(run(&bench, &out, &[]), Some(0));
    assert_eq!(kept(), before, "nothing was left to do, and no time was measured again");
    assert_eq!(cells(), whole);
    assert_eq!(run(&bench, &out, &["--seed", "1"]), Some(2), "other figures must not be mixed in");
    assert_eq!(kept(), before, "a refused command changes nothing");
}

#[test]
fn shot_noise_is_an_axis_that_a_later_run_can_extend() {
    let bench = Bench::new();
    let out = bench.path("out");
    let words = ["--stream", "modulo,recovered", "--method", "auto", "--deblur", "off", "--time-frames", "0"];
    let eval = |alphas: &str, noises: &str| {
        let folder = out.to_str().expect("UTF-8");
        let base = [
            "eval",
            "--source",
            SCENE,
            "--alpha",
            alphas,
            "--engine",
            "rten",
            "-o",
            folder,
            "--shot-noise",
            noises,
        ];
        let output = bench.run(&[&base[..], &words[..]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        text(&output)
    };
    assert!(!eval("4", "0").contains("finished already"));
    assert!(eval("4", "0,2").contains("2 cells are finished already"));
    let cells = cells(&out);
    let noises: Vec<_> = cells.iter().map(|cell| cell["shot_noise"].as_f64()).collect();
    assert_eq!(noises, [0.0, 0.0, 2.0, 2.0].map(Some));
    let exact = |cell: &Value| cell["exact_k"].as_f64().expect("a share");
    assert!(exact(&cells[1]) > exact(&cells[3]), "noise costs exactness: {cells:?}");
    assert!(cells[3]["name"].as_str().is_some_and(|name| name.ends_with("shot_noise_2")), "{cells:?}");
    assert!(cells.iter().all(|cell| frames(&out, cell).len() == 4));
    for file in
        ["shot_demo_input_auto_alpha4_psf1.4_read0.svg", "shot_demo_input_auto_alpha4_psf1.4_read0.png"]
    {
        assert!(out.join("charts").join(file).is_file(), "{file}");
    }
    // The lens and the read noise have one value, so that they have no chart.
    let charts = std::fs::read_dir(out.join("charts")).expect("charts");
    let names: Vec<String> =
        charts.map(|file| file.expect("a file").file_name().into_string().expect("UTF-8")).collect();
    assert!(
        !names.iter().any(|name| ["psf_", "read_", "alpha_"].iter().any(|kind| name.starts_with(kind))),
        "{names:?}"
    );
}

/// Cells of another grid on the same folder were thrown away.
#[test]
fn a_grid_extended_by_other_lenses_keeps_the_old_cells() {
    let bench = Bench::new();
    let out = bench.path("out");
    let folder = out.to_str().expect("UTF-8");
    let eval = |more: &[&str]| {
        let base = ["eval", "--source", SCENE, "--alpha", "4", "--engine", "rten", "--time-frames", "0"];
        let words =
            ["--stream", "ideal,saturated,recovered", "--method", "auto", "--deblur", "off", "-o", folder];
        let output = bench.run(&[&base[..], &words, more].concat());
        (output.status.code(), text(&output))
    };
    let (code, message) = eval(&["--psf-sigma", "1.4,0.8", "--read-noise", "2"]);
    assert_eq!(code, Some(0), "{message}");
    let cells = || cells(&out);
    let (old, old_lines) = (cells(), lines(&out));
    assert_eq!(old.len(), 7);

    let (code, message) = eval(&["--psf-sigma", "0.8,2", "--read-noise", "2"]);
    assert_eq!(code, Some(0), "{message}");
    assert!(
        message.contains("4 cells are finished already") && message.contains("3 cells of other grids"),
        "{message}"
    );
    assert_eq!(cells()[..7].to_vec(), old, "the figures of the old cells stay");
    assert_eq!(cells().len(), 7 + 3);
    let all = lines(&out);
    assert!(
        old_lines.iter().all(|(name, bytes)| all[name] == *bytes) && all.len() == 10,
        "so do their lines"
    );
    let lenses: Vec<f64> = cells().iter().filter_map(|cell| cell["psf_sigma"].as_f64()).collect();
    assert!([0.8, 1.4, 2.0].iter().all(|lens| lenses.contains(lens)), "{lenses:?}");
    let page = std::fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(["1.4 px", "0.8 px", "2 px"].iter().all(|lens| page.contains(&format!("lens blur {lens}"))));
    // A saturated image has a PSNR, but no wrap counts.
    let saturated = &cells()[2];
    let psnr = saturated["psnr_db"].as_f64().expect("a PSNR");
    assert!(saturated["stream"] == "saturated" && (5.0..60.0).contains(&psnr), "{saturated}");
    assert!(saturated["exact_k"].is_null(), "{saturated}");
}

#[test]
fn a_grid_without_a_cell_is_refused_and_empty_combinations_are_named() {
    let bench = Bench::new();
    let out = bench.path("out");
    let eval = |more: &[&str]| {
        let base = ["eval", "--source", SCENE, "--engine", "rten", "--time-frames", "0", "--alpha", "2"];
        let output = bench.run(&[&base[..], &["-o", out.to_str().expect("UTF-8")], more].concat());
        (output.status.code(), text(&output))
    };
    let published = ["--mosaic", "rggb", "--stream", "recovered", "--method", "spud_as_published"];
    for (options, named) in [
        (&["--gains", "checkerboard", "--stream", "modulo"][..], "--stream modulo --gains checkerboard"),
        (&published, "--stream recovered --method spud_as_published --mosaic rggb"),
    ] {
        let (code, message) = eval(options);
        assert_eq!(code, Some(2), "{message}");
        assert!(message.contains(named) && message.lines().count() == 1, "{message}");
    }
    assert!(!out.exists(), "nothing was run");
    let (code, message) =
        eval(&["--gains", "none,checkerboard", "--stream", "ideal,saturated", "--psf-sigma", "0"]);
    assert_eq!(code, Some(0), "{message}");
    let line = message.lines().find(|line| line.contains("no cell")).expect("a line");
    assert!(
        line.contains("--stream ideal --gains checkerboard (") && !line.contains("saturated --gains"),
        "{line}"
    );
}

/// Hours of work ended with an error about the folder of the results.
#[test]
fn a_folder_that_cannot_hold_results_is_refused_before_anything_runs() {
    let bench = Bench::new();
    std::fs::write(bench.path("file"), "").expect("written");
    let file = bench.path("file").display().to_string();
    let picture = bench.images(1).join("000000.png").display().to_string();
    // The words before and after the folder.
    let commands: [(&[&str], &[&str]); 6] = [
        (&["eval", "--source", SCENE, "--engine", "rten", "-o"], &[]),
        (&["eval", "launch/raw.launch.yaml", "-o"], &[]),
        (&["eval", "merge"], &["shard"]),
        (&["simulate", &picture, "-o"], &[]),
        (&["unwrap", &picture, "--alpha", "4", "-o"], &[]),
        (&["stability", "-o"], &[]),
    ];
    for ((before, after), out) in commands.iter().flat_map(|command| [(command, "/proc/x"), (command, &file)])
    {
        let output = bench.run(&[*before, &[out], *after].concat());
        let message = text(&output);
        assert_eq!(output.status.code(), Some(2), "{before:?}: {message}");
        assert!(
            message.contains(out) && message.contains("no result can be written"),
            "{before:?}: {message}"
        );
        assert!(!message.contains("lockstep"), "nothing was run: {message}");
    }
}

/// A sensor with two gains has its own method, and its saturated stream is merged.
#[test]
fn two_gains_are_exact_without_a_lens() {
    let bench = Bench::new();
    let out = bench.path("out");
    let words =
        "--alpha 4 --psf-sigma 0 --stream ideal,saturated,modulo,recovered --method auto,spud --engine rten";
    let more = ["--gains", "none,checkerboard", "--time-frames", "0", "-o", out.to_str().expect("UTF-8")];
    let base = ["eval", "--source", SCENE];
    let words: Vec<&str> = base.into_iter().chain(words.split(' ')).chain(more).collect();
    let output = bench.run(&words);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let cells = cells(&out);
    let words = |cell: &Value| {
        ["gains", "stream", "method"].map(|name| cell[name].as_str().unwrap_or_default().to_owned())
    };
    let named: Vec<[String; 3]> = cells.iter().map(words).collect();
    let gains = "checkerboard_gains";
    let expected = [["checkerboard", "saturated", gains], ["checkerboard", "recovered", gains]];
    assert_eq!(named[named.len() - 2..], expected, "{named:?}");
    assert_eq!(named.iter().filter(|row| row[0] == "none").count(), 5, "{named:?}");
    let exact = cells[cells.len() - 1]["exact_k"].as_f64().expect("a share");
    assert!(exact > 0.99, "{exact}");
}

/// The images of a mosaic are compared and detected in as those of three chips.
#[test]
fn a_mosaic_is_exact_behind_a_lens() {
    let bench = Bench::new();
    let out = bench.path("out");
    let words = "--alpha 2 --psf-sigma 1.4 --stream ideal,recovered,multi_exposure --method auto,spud_as_published \
                 --deblur off --engine rten";
    let more = ["--mosaic", "none,grbg", "--time-frames", "0", "-o", out.to_str().expect("UTF-8")];
    let base = ["eval", "--source", SCENE];
    let words: Vec<&str> = base.into_iter().chain(words.split(' ')).chain(more).collect();
    let output = bench.run(&words);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let cells = cells(&out);
    let word = |cell: &Value, name| cell[name].as_str().expect("a word").to_owned();
    let named: Vec<[String; 2]> =
        cells.iter().map(|cell| ["mosaic", "stream"].map(|name| word(cell, name))).collect();
    let of = |mosaic| [[mosaic, "ideal"], [mosaic, "ideal"], [mosaic, "recovered"]];
    // Three captures and SPUD as published have three chips only.
    let three_chips = [["none", "recovered"], ["none", "multi_exposure"]];
    assert_eq!(named, [&of("none")[..], &three_chips, &of("grbg")].concat());
    let last = &cells[cells.len() - 1];
    let exact = last["exact_k"].as_f64().expect("a share");
    assert!(exact > 0.999, "{exact}");
    assert_eq!(last["psnr_db"].as_f64().filter(|psnr| *psnr < 45.0), None, "{last}");
}

/// Two data sets with the same names and labels: the second one got the figures of the first.
#[test]
fn figures_of_other_pixels_are_not_taken_over() {
    let bench = Bench::new();
    let out = bench.path("out");
    let eval = |kitti: &Path, more: &[&str]| {
        let (kitti, out) = (kitti.to_str().expect("UTF-8"), out.to_str().expect("UTF-8"));
        let quick = ["--stream", "ideal", "--alpha", "2", "--engine", "rten", "-o", out];
        let output = bench.run(&[&["eval", "--kitti", kitti][..], &quick[..], more].concat());
        (output.status.code(), text(&output))
    };
    let [a, b] = [("a", 10), ("b", 200)].map(|(name, grey)| {
        let folder = bench.path(name);
        for part in ["image_2", "label_2"] {
            std::fs::create_dir_all(folder.join(part)).expect("made");
        }
        let image = image::GrayImage::from_pixel(160, 96, image::Luma([grey]));
        image.save(folder.join("image_2/000000.png")).expect("written");
        let car = "Car 0.00 0 0 10 10 60 50 1 1 1 1 1 1 0\n";
        std::fs::write(folder.join("label_2/000000.txt"), car).expect("written");
        folder
    });
    let (code, first) = eval(&a, &[]);
    assert_eq!(code, Some(0), "{first}");
    let (code, refused) = eval(&b, &[]);
    assert_eq!(code, Some(2), "{refused}");
    // Both grids are named, too.
    for grid in ["There: 2 cells of ideal", "Here: 2 cells of ideal"] {
        assert!(refused.contains(grid), "{grid}: {refused}");
    }
    for side in [&a, &b] {
        assert!(refused.contains(side.to_str().expect("UTF-8")), "{refused}");
    }
    let before = json(&out.join("results.json"));
    let (code, anew) = eval(&b, &["--fresh"]);
    assert_eq!(code, Some(0), "{anew}");
    assert_ne!(before["input"]["digest"], json(&out.join("results.json"))["input"]["digest"]);
}

#[test]
fn what_cannot_be_scored_is_said() {
    let bench = Bench::new();
    let kitti = bench.path("kitti");
    let images = bench.images(3);
    std::fs::create_dir(&kitti).expect("made");
    std::fs::rename(images, kitti.join("image_2")).expect("moved");
    let kitti = kitti.to_str().expect("UTF-8").to_owned();
    let out = bench.path("out");
    let eval = |more: &[&str]| {
        let quick =
            ["--stream", "ideal", "--alpha", "2", "--engine", "rten", "-o", out.to_str().expect("UTF-8")];
        let words = [&["eval", "--kitti", &kitti][..], &quick[..], more].concat();
        let output = bench.run(&words);
        (output.status.code(), text(&output))
    };
    let (code, message) = eval(&[]);
    assert!(code == Some(3) && message.contains("no labels") && message.contains("3 frames"), "{message}");

    let labels = Path::new(&kitti).join("label_2");
    std::fs::create_dir(&labels).expect("made");
    let car = |x1: f32, x2: f32| format!("Car 0.00 0 0 {x1} 10 {x2} 50 1 1 1 1 1 1 0\n");
    std::fs::write(labels.join("000000.txt"), car(10.0, 60.0) + &car(80.0, 140.0)).expect("written");
    std::fs::write(labels.join("000001.txt"), "Car 0.00 0 0 ten\n").expect("written");
    let (code, message) = eval(&[]);
    assert_eq!(code, Some(3), "{message}");
    for wanted in
        ["1 frames are not readable", "000001.txt:1", "1 frames have no labels", "reach outside the image"]
    {
        assert!(message.contains(wanted), "{wanted}: {message}");
    }
    let results = json(&out.join("results.json"));
    assert_eq!((&results["input"]["frames"], &results["input"]["labelled"]), (&3.into(), &1.into()));

    let list = bench.path("list.txt");
    let listed = |text: &str| {
        std::fs::write(&list, text).expect("written");
        std::fs::remove_dir_all(&out).ok();
        eval(&["--list", list.to_str().expect("UTF-8")])
    };
    let (code, message) = listed("# nothing\n");
    assert!(code == Some(1) && message.contains("list is empty"), "{message}");
    let (code, message) = listed("000000\n000000\n");
    assert!(code == Some(3) && message.contains("1 frames are there twice"), "{message}");
    let (code, message) = listed("000009\n");
    assert!(code == Some(3) && message.contains("000009.png"), "{message}");
    let (code, message) = eval(&["--method", "magic"]);
    assert!(code == Some(2) && message.contains("magic") && message.contains("spud"), "{message}");
    assert_eq!(bench.run(&["eval", "-o", "/tmp/nowhere"]).status.code(), Some(2));
}

/// Two small images in the form of each data set, with one car on each.
struct DataSets<'a>(&'a Bench);

impl DataSets<'_> {
    fn new(bench: &Bench) -> DataSets<'_> {
        let images = bench.images(2);
        for folder in ["kitti/image_2", "kitti/label_2", "labels"] {
            std::fs::create_dir_all(bench.path(folder)).expect("made");
        }
        let sets = DataSets(bench);
        for name in ["000000", "000001"] {
            let image = format!("{name}.png");
            std::fs::copy(images.join(&image), bench.path("kitti/image_2").join(image)).expect("copied");
            sets.write(&format!("kitti/label_2/{name}.txt"), &kitti_label("Car"));
            sets.write(&format!("labels/{name}.txt"), "0 0.5 0.5 0.4 0.8\n");
        }
        sets.write("data.yaml", "names: [car, person]\n");
        sets.coco("000000.png", "[7, 1], [8, 1]");
        sets
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.0.path(name), text).expect("written");
    }

    /// `first` is the file of image 7; objects are pairs of an image and a category, 1 (car) or 2 (dog).
    fn coco(&self, first: &str, objects: &str) {
        let objects: Vec<[u64; 2]> = serde_json::from_str(&format!("[{objects}]")).expect("pairs");
        let objects: Vec<Value> = objects
            .iter()
            .map(|[image, category]| {
                serde_json::json!({"image_id": image, "category_id": category, "bbox": [10, 10, 40, 50]})
            })
            .collect();
        let file = serde_json::json!({
            "images": [{"id": 7, "file_name": first}, {"id": 8, "file_name": "000001.png"}],
            "annotations": objects,
            "categories": [{"id": 1, "name": "car"}, {"id": 2, "name": "dog"}],
        });
        self.write("coco.json", &file.to_string());
    }

    /// The exit code and the output of a grid of one cell over a data set of this folder.
    fn eval(&self, option: &str, name: &str, more: &[&str]) -> (Option<i32>, String) {
        let [data, out] = [name, "out"].map(|name| self.0.path(name).display().to_string());
        std::fs::remove_dir_all(&out).ok();
        let model = harness::model();
        // One of two cells: a part of a grid draws no pictures, which would take most of the time.
        let cell = ["--stream", "ideal,saturated", "--alpha", "2", "--psf-sigma", "0", "--shard", "1/2"];
        let quick = ["--engine", "rten", "--model", &model, "-o", &out];
        let output = self.0.run(&[&["eval", option, &data], &cell[..], &quick, more].concat());
        (output.status.code(), text(&output))
    }
}

fn kitti_label(class: &str) -> String {
    format!("{class} 0.00 0 0 10 10 50 60 1 1 1 1 1 1 0\n")
}

#[test]
fn labels_without_an_odd_line_end_with_0() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    for (option, name) in [("--kitti", "kitti"), ("--yolo", ""), ("--coco", "coco.json")] {
        let (code, message) = sets.eval(option, name, &[]);
        assert_eq!(code, Some(0), "{option}: {message}");
        let figures = message.lines().find(|line| line.contains("AP50")).expect("the figures of the cell");
        assert!(figures.contains("AP50 vehicle ") && !figures.contains("person"), "{figures}");
    }
}

#[test]
fn labels_that_cannot_be_scored_end_with_3_and_a_line() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    let list = bench.path("list.txt").display().to_string();
    let odd = |option: &str, name: &str, more: &[&str], lines: &[&[&str]]| {
        let (code, message) = sets.eval(option, name, more);
        assert_eq!(code, Some(3), "{option}: {message}");
        for wanted in lines {
            let line = message.lines().find(|line| wanted.iter().all(|wanted| line.contains(wanted)));
            assert!(line.is_some(), "{wanted:?}: {message}");
        }
        assert!(!message.contains("scene://"), "{message}");
    };
    let no_group = "classes that no group holds";

    sets.write("kitti/label_2/000001.txt", &kitti_label("Bike"));
    sets.write("kitti/label_2/000002.txt", &kitti_label("Car"));
    let unknown: &[&str] = &["1 labels", no_group, "bike (1)", "--groups"];
    odd("--kitti", "kitti", &[], &[unknown, &["1 label files have no image", "000002.txt"]]);

    sets.write("kitti/label_2/000000.txt", &kitti_label("DontCare"));
    sets.write("list.txt", "000000\n000009\n");
    let unscored: &[&str] = &["no labelled object is scored", "--difficulty"];
    odd("--kitti", "kitti", &["--list", &list], &[&["1 frames are not readable", "000009.png"], unscored]);

    sets.write("labels/000001.txt", "0 0.5 0.5 0.4 0.8\n7 0.5 0.5 0.4 0.8\n");
    sets.write("labels/000002.txt", "0 0.5 0.5 0.4 0.8\n");
    let unnamed: &[&str] = &["1 frames are not readable", "000001.txt:2", "class 7", "0 to 1"];
    odd("--yolo", "", &[], &[unnamed, &["1 label files have no image", "000002.txt"]]);

    sets.coco("gone.png", "[7, 1], [8, 1], [8, 2], [9, 1], [9, 1]");
    let without: &[&str] = &["2 annotations have no image", "image 9"];
    let gone: &[&str] = &["1 frames are not readable", "gone.png"];
    odd("--coco", "coco.json", &[], &[&[no_group, "dog (1)"], without, gone]);
}

#[test]
fn a_missing_data_set_is_named_with_what_is_needed() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    sets.coco("gone.png", "[7, 1]");
    std::fs::remove_file(bench.path("images/000001.png")).expect("removed");
    for (option, name, wanted) in [
        ("--kitti", "nowhere", ["nowhere", "image_2"]),
        ("--sequence", "nowhere", ["nowhere", "image_02"]),
        ("--yolo", "nowhere", ["nowhere", "YOLO"]),
        ("--coco", "coco.json", ["gone.png", "--coco-images"]),
        ("--coco", "nowhere.json", ["nowhere.json", "No such file"]),
    ] {
        let (code, message) = sets.eval(option, name, &[]);
        assert_eq!(code, Some(1), "{message}");
        assert!(
            wanted.iter().all(|wanted| message.contains(wanted)) && !message.contains("scene://"),
            "{message}"
        );
    }
}

#[test]
fn a_class_may_be_left_out_on_purpose() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    sets.coco("000000.png", "[7, 1], [8, 2]");
    sets.write("groups.yaml", "car: vehicle\ndog:\n");
    let groups = bench.path("groups.yaml").display().to_string();
    let (code, message) = sets.eval("--coco", "coco.json", &["--groups", &groups]);
    assert_eq!(code, Some(0), "{message}");
}
