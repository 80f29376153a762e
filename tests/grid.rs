//! `modulo eval` as a grid, through the shipped binary: the same bytes again, killed and resumed.

mod harness;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harness::{Bench, assert_has, json, wait_until};
use serde_json::Value;

/// Small enough for every cell to be over in a moment.
const SCENE: &str = "scene://day?seed=3&frames=4&width=320&height=128";

/// A grid on [`SCENE`].
const CELL: &str = "eval --source scene://day?seed=3&frames=4&width=320&height=128 --engine rten -o @/out";

/// A grid on a folder.
const KITTI: &str = "eval --stream ideal --alpha 2 --engine rten -o @/out --kitti";

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

/// A grid of two alphas, small enough for every cell to be over in a moment.
const GRID: &str = "eval --source scene://day?seed=3&frames=4&width=320&height=128 --engine rten --alpha 2,4 --time-frames 20 -o";

fn whole(bench: &Bench) -> PathBuf {
    bench.says(0, &format!("{GRID} @/whole"));
    bench.path("whole")
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

    bench.says(0, &format!("{GRID} @/again --jobs 1"));
    let again = bench.path("again");
    assert_eq!(timeless(&again).to_string(), expected.to_string());
    assert!(lines(&again) == lines(&whole));
}

#[test]
fn a_killed_run_goes_on_where_it_stopped() {
    let bench = Bench::new();
    let expected = timeless(&whole(&bench)).to_string();
    let (out, killed) = (bench.path("killed"), format!("{GRID} @/killed"));
    let cells = || {
        let mut cells = if out.join("results.json").is_file() { cells(&out) } else { Vec::new() };
        cells.iter_mut().for_each(remove_times);
        cells
    };
    for _ in 0..3 {
        let (before, child) = (cells(), bench.starts(&killed));
        wait_until("another cell is done", || cells().len() > before.len());
        assert_eq!(child.end("KILL").0, None, "it was still at work");
        assert!(before.iter().all(|cell| cells().contains(cell)), "a cell was made again");
    }
    let before = cells();
    bench.says(0, &killed);
    assert_eq!(timeless(&out).to_string(), expected);
    assert!(lines(&out) == lines(&bench.path("whole")));
    let whole = cells();
    assert!(before.len() < whole.len() && before.iter().all(|cell| whole.contains(cell)));

    let kept = || bench.json("killed/results.json")["cells"].clone();
    let before = kept();
    bench.says(0, &killed);
    assert_eq!(kept(), before, "nothing was left to do, and no time was measured again");
    assert_eq!(cells(), whole);
    // Other figures must not be mixed in.
    bench.says(2, &format!("{killed} --seed 1"));
    assert_eq!(kept(), before, "a refused command changes nothing");
}

#[test]
fn shot_noise_is_an_axis_that_a_later_run_can_extend() {
    let bench = Bench::new();
    let out = bench.path("out");
    let streams = "--stream modulo,recovered --method auto --deblur off --alpha 4";
    let eval = |noises: &str| bench.says(0, &format!("{CELL} {streams} --shot-noise {noises}"));
    assert!(!eval("0").contains("finished already"));
    assert_has(&eval("0,2"), &["2 cells are finished already"]);
    let cells = cells(&out);
    let noises: Vec<_> = cells.iter().map(|cell| cell["shot_noise"].as_f64()).collect();
    assert_eq!(noises, [0.0, 0.0, 2.0, 2.0].map(Some));
    let exact = |cell: &Value| cell["exact_k"].as_f64().expect("a share");
    assert!(exact(&cells[1]) > exact(&cells[3]), "noise costs exactness: {cells:?}");
    assert!(cells[3]["name"].as_str().is_some_and(|name| name.ends_with("shot_noise_2")), "{cells:?}");
    assert!(cells.iter().all(|cell| frames(&out, cell).len() == 4));
    let charts = std::fs::read_dir(out.join("charts")).expect("charts");
    let names: Vec<String> =
        charts.map(|file| file.expect("a file").file_name().into_string().expect("UTF-8")).collect();
    for file in ["svg", "png"].map(|kind| format!("shot_demo_input_auto_alpha4_psf1.4_read0.{kind}")) {
        assert!(names.contains(&file), "{file}");
    }
    // The lens and the read noise have one value, so that they have no chart.
    let is_odd = |name: &String| ["psf_", "read_", "alpha_"].iter().any(|kind| name.starts_with(kind));
    assert!(!names.iter().any(is_odd), "{names:?}");
}

/// Cells of another grid on the same folder were thrown away.
#[test]
fn a_grid_extended_by_other_lenses_keeps_the_old_cells() {
    let bench = Bench::new();
    let out = bench.path("out");
    let grid = "--alpha 4 --stream ideal,saturated,recovered --method auto --deblur off --read-noise 2";
    let eval = |lenses: &str| bench.says(0, &format!("{CELL} {grid} --psf-sigma {lenses}"));
    eval("1.4,0.8");
    let cells = || cells(&out);
    let (old, old_lines) = (cells(), lines(&out));
    assert_eq!(old.len(), 7);

    assert_has(&eval("0.8,2"), &["4 cells are finished already", "3 cells of other grids"]);
    assert_eq!(cells()[..7].to_vec(), old, "the figures of the old cells stay");
    assert_eq!(cells().len(), 7 + 3);
    let all = lines(&out);
    let are_kept = old_lines.iter().all(|(name, bytes)| all[name] == *bytes);
    assert!(are_kept && all.len() == 10, "so do their lines");
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
    let eval = |code, more: &str| bench.says(code, &format!("{CELL} --alpha 2 {more}"));
    for (options, named) in [
        ("--gains checkerboard --stream modulo", "--stream modulo --gains checkerboard"),
        (
            "--mosaic rggb --stream recovered --method spud_as_published",
            "--stream recovered --method spud_as_published --mosaic rggb",
        ),
    ] {
        let message = eval(2, options);
        assert!(message.contains(named) && message.lines().count() == 1, "{message}");
    }
    assert!(!bench.path("out").exists(), "nothing was run");
    let message = eval(0, "--gains none,checkerboard --stream ideal,saturated --psf-sigma 0");
    let line = message.lines().find(|line| line.contains("no cell")).expect("a line");
    assert!(
        line.contains("--stream ideal --gains checkerboard (") && !line.contains("saturated --gains"),
        "{line}"
    );
}

/// A sensor with two gains has its own method, and its saturated stream is merged.
#[test]
fn two_gains_are_exact_without_a_lens() {
    let bench = Bench::new();
    let sensor = "--alpha 4 --psf-sigma 0 --gains none,checkerboard";
    bench.says(0, &format!("{CELL} {sensor} --stream ideal,saturated,modulo,recovered --method auto,spud"));
    let cells = cells(&bench.path("out"));
    let words = |cell: &Value| {
        ["gains", "stream", "method"].map(|name| cell[name].as_str().unwrap_or_default().to_owned())
    };
    let named: Vec<[String; 3]> = cells.iter().map(words).collect();
    let expected = ["saturated", "recovered"].map(|stream| ["checkerboard", stream, "checkerboard_gains"]);
    assert_eq!(named[named.len() - 2..], expected, "{named:?}");
    assert_eq!(named.iter().filter(|row| row[0] == "none").count(), 5, "{named:?}");
    let exact = cells[cells.len() - 1]["exact_k"].as_f64().expect("a share");
    assert!(exact > 0.99, "{exact}");
}

/// The images of a mosaic are compared and detected in as those of three chips.
#[test]
fn a_mosaic_is_exact_behind_a_lens() {
    let bench = Bench::new();
    let sensor = "--alpha 2 --psf-sigma 1.4 --mosaic none,grbg --deblur off";
    let streams = "--stream ideal,recovered,multi_exposure --method auto,spud_as_published";
    bench.says(0, &format!("{CELL} {sensor} {streams}"));
    let cells = cells(&bench.path("out"));
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

/// A raw mosaic has the blur of its own lens, which nobody knows: the unwrapping node got the perfect lens of the cell, and trusted nothing.
#[test]
fn a_raw_mosaic_is_not_sensed_through_a_perfect_lens() {
    let bench = Bench::new();
    let folder = bench.path("raw");
    std::fs::create_dir_all(&folder).expect("a folder");
    let radiance = |x: u32, y: u32| 0.5 + 0.45 * (f64::from(x) / 23.0).sin() * (f64::from(y) / 31.0).cos();
    let filter = |x: u32, y: u32| [[0.6, 1.0], [1.0, 0.4]][y as usize % 2][x as usize % 2];
    let pixel = |x, y| image::Luma([(60_000.0 * radiance(x, y) * filter(x, y)) as u16]);
    image::ImageBuffer::from_fn(192, 128, pixel).save(folder.join("a.png")).expect("saved");
    for (name, text) in [("a.txt", "0 0.5 0.5 0.2 0.2\n"), ("classes.txt", "car\n")] {
        std::fs::write(folder.join(name), text).expect("written");
    }
    let sensor = "--alpha 4 --psf-sigma 0 --mosaic rggb --optical-black 32 --stream recovered --method auto";
    bench.says(0, &format!("eval --yolo @/raw --engine rten -o @/out {sensor}"));
    let cell = &cells(&bench.path("out"))[0];
    assert_eq!([&cell["exact_frames"], &cell["trusted"]], [1.0, 1.0], "{cell}");
}

/// Two data sets with the same names and labels: the second one got the figures of the first.
#[test]
fn figures_of_other_pixels_are_not_taken_over() {
    let bench = Bench::new();
    for (name, grey) in [("a", 10), ("b", 200)] {
        let folder = bench.path(name);
        for part in ["image_2", "label_2"] {
            std::fs::create_dir_all(folder.join(part)).expect("made");
        }
        let image = image::GrayImage::from_pixel(160, 96, image::Luma([grey]));
        image.save(folder.join("image_2/000000.png")).expect("written");
        std::fs::write(folder.join("label_2/000000.txt"), kitti_label("Car")).expect("written");
    }
    bench.says(0, &format!("{KITTI} @/a"));
    let refused = bench.says(2, &format!("{KITTI} @/b"));
    // Both grids are named, too.
    let sides = ["a", "b"].map(|name| bench.path(name).display().to_string());
    let [a, b] = sides.each_ref().map(String::as_str);
    assert_has(&refused, &["There: 2 cells of ideal", "Here: 2 cells of ideal", a, b]);
    let before = bench.json("out/results.json");
    bench.says(0, &format!("{KITTI} @/b --fresh"));
    assert_ne!(before["input"]["digest"], bench.json("out/results.json")["input"]["digest"]);
}

#[test]
fn what_cannot_be_scored_is_said() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("kitti")).expect("made");
    std::fs::rename(bench.images(3), bench.path("kitti/image_2")).expect("moved");
    let eval = |code, more: &str| bench.says(code, &format!("{KITTI} @/kitti {more}"));
    assert_has(&eval(3, ""), &["no labels", "3 frames"]);

    std::fs::create_dir(bench.path("kitti/label_2")).expect("made");
    let label = |name: &str, text: &str| {
        std::fs::write(bench.path("kitti/label_2").join(name), text).expect("written");
    };
    label("000000.txt", &(kitti_label("Car") + "Car 0.00 0 0 80 10 140 50 1 1 1 1 1 1 0\n"));
    label("000001.txt", "Car 0.00 0 0 ten\n");
    let wanted =
        ["1 labels cannot be read", "000001.txt:1", "1 frames have no labels", "reach outside the image"];
    assert_has(&eval(3, ""), &wanted);
    let results = bench.json("out/results.json");
    assert_eq!((&results["input"]["frames"], &results["input"]["labelled"]), (&3.into(), &2.into()));

    for (list, code, wanted) in [
        ("# nothing\n", 1, "list is empty"),
        ("000000\n000000\n", 3, "1 frames are there twice"),
        ("000009\n", 3, "000009.png"),
    ] {
        std::fs::write(bench.path("list.txt"), list).expect("written");
        std::fs::remove_dir_all(bench.path("out")).ok();
        assert_has(&eval(code, "--list @/list.txt"), &[wanted]);
    }
    assert_has(&eval(2, "--method magic"), &["magic", "spud"]);
    bench.says(2, "eval -o /tmp/nowhere");
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

    /// The output of a grid of one cell over a data set of this folder.
    fn eval(&self, code: i32, data: &str, more: &str) -> String {
        std::fs::remove_dir_all(self.0.path("out")).ok();
        let cell = "--stream ideal --alpha 2 --psf-sigma 0 --engine rten --model %";
        let message = self.0.says(code, &format!("eval {data} {cell} -o @/out {more}"));
        assert!(!message.contains("scene://"), "{message}");
        message
    }
}

fn kitti_label(class: &str) -> String {
    format!("{class} 0.00 0 0 10 10 50 60 1 1 1 1 1 1 0\n")
}

#[test]
fn labels_without_an_odd_line_end_with_0() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    for data in ["--kitti @/kitti", "--yolo @", "--coco @/coco.json"] {
        let message = sets.eval(0, data, "");
        let figures = message.lines().find(|line| line.contains("AP50")).expect("the figures of the cell");
        assert!(figures.contains("AP50 vehicle ") && !figures.contains("person"), "{data}: {figures}");
    }
}

#[test]
fn labels_that_cannot_be_scored_end_with_3_and_a_line() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    let odd = |data: &str, more: &str, lines: &[&[&str]]| {
        let message = sets.eval(3, data, more);
        for wanted in lines {
            let line = message.lines().find(|line| wanted.iter().all(|wanted| line.contains(wanted)));
            assert!(line.is_some(), "{wanted:?}: {message}");
        }
    };
    let no_group = "classes that no group holds";

    sets.write("kitti/label_2/000001.txt", &kitti_label("Bike"));
    sets.write("kitti/label_2/000002.txt", &kitti_label("Car"));
    let unknown: &[&str] = &["1 labels", no_group, "bike (1)", "--groups"];
    odd("--kitti @/kitti", "", &[unknown, &["1 label files have no image", "000002.txt"]]);

    sets.write("kitti/label_2/000000.txt", &kitti_label("DontCare"));
    sets.write("list.txt", "000000\n000009\n");
    let unscored: &[&str] = &["no labelled object is scored", "--difficulty"];
    let unreadable: &[&str] = &["1 frames are not readable", "000009.png"];
    odd("--kitti @/kitti", "--list @/list.txt", &[unreadable, unscored]);

    sets.write("labels/000001.txt", "0 0.5 0.5 0.4 0.8\n7 0.5 0.5 0.4 0.8\n");
    sets.write("labels/000002.txt", "0 0.5 0.5 0.4 0.8\n");
    let unnamed: &[&str] = &["1 labels cannot be read", "000001.txt:2", "class 7", "0 to 1"];
    odd("--yolo @", "", &[unnamed, &["1 label files have no image", "000002.txt"]]);

    sets.coco("gone.png", "[7, 1], [8, 1], [8, 2], [9, 1], [9, 1]");
    let without: &[&str] = &["2 annotations have no image", "image 9"];
    let gone: &[&str] = &["1 frames are not readable", "gone.png"];
    odd("--coco @/coco.json", "", &[&[no_group, "dog (1)"], without, gone]);
}

/// Classes are scored in the groups of their names, however a program spells them; without names, the files that may have them are named.
#[test]
fn classes_are_scored_by_their_names_in_each_spelling() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    sets.write("data.yaml", "names: [CAR, Person]\n");
    assert_has(&sets.eval(0, "--yolo @", ""), &["AP50 vehicle "]);
    assert_has(&sets.eval(0, "--yolo @/data.yaml", ""), &["AP50 vehicle "]);
    std::fs::remove_file(bench.path("data.yaml")).expect("removed");
    let wanted =
        ["2 labels have classes that no group holds", "0 (2)", "no file with the names of the classes"];
    assert_has(&sets.eval(3, "--yolo @", ""), &wanted);
    sets.write("groups.yaml", "0: vehicle\n");
    assert_has(&sets.eval(0, "--yolo @", "--groups @/groups.yaml"), &["AP50 vehicle "]);
}

#[test]
fn a_missing_data_set_is_named_with_what_is_needed() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    sets.coco("gone.png", "[7, 1]");
    std::fs::remove_file(bench.path("images/000001.png")).expect("removed");
    for (data, wanted) in [
        ("--kitti @/nowhere", ["nowhere", "image_2"]),
        ("--sequence @/nowhere", ["nowhere", "image_02"]),
        ("--yolo @/nowhere", ["nowhere", "YOLO"]),
        ("--coco @/coco.json", ["gone.png", "--coco-images"]),
        ("--coco @/nowhere.json", ["nowhere.json", "No such file"]),
    ] {
        assert_has(&sets.eval(2, data, ""), &wanted);
    }
}

#[test]
fn a_class_may_be_left_out_on_purpose() {
    let bench = Bench::new();
    let sets = DataSets::new(&bench);
    sets.coco("000000.png", "[7, 1], [8, 2]");
    sets.write("groups.yaml", "car: vehicle\ndog:\n");
    sets.eval(0, "--coco @/coco.json", "--groups @/groups.yaml");
}
