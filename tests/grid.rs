//! `modulo eval` as a grid, through the shipped binary: the same bytes again, killed and resumed.

mod harness;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use harness::{Bench, assert_has, json, wait_until};
use serde_json::Value;

/// A grid on [`SCENE`].
const CELL: &str = "eval --source scene://day?seed=3&frames=4&width=320&height=128 --engine rten -o @/out";

/// A grid on a folder.
const KITTI: &str = "eval --stream ideal --alpha 2 --engine rten -o @/out --kitti";

/// The cells in `results.json`.
fn cells(folder: &Path) -> Vec<Value> {
    json(&folder.join("results.json"))["cells"].as_array().expect("cells").clone()
}

/// The stored boxes of all cells by the names of their files.
fn stored(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = std::fs::read_dir(folder.join("cells"))
        .into_iter()
        .flatten()
        .map(|file| file.expect("a file").path());
    let name = |file: &Path| file.file_name().expect("a name").to_string_lossy().into_owned();
    let files = files.filter(|file| !name(file).starts_with('.'));
    files.map(|file| (name(&file), std::fs::read(&file).expect("readable"))).collect()
}

/// `results.json` without its times, and without the machine that they were measured on.
fn timeless(folder: &Path) -> Value {
    let mut results = json(&folder.join("results.json"));
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

/// Results of a version that had another form are named and left alone.
#[test]
fn results_of_an_older_version_are_refused_by_name() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("out")).expect("writable");
    std::fs::write(bench.path("out/results.json"), "{\"setup\": {\"figures\": 4}}").expect("writable");
    let refused = bench.says(2, &format!("{KITTI} bags/samples"));
    assert!(refused.contains("no such file") || refused.contains("older version"), "{refused}");
    assert_has(&bench.says(2, CELL), &["/out", "older version", "another folder"]);
    assert_has(&bench.says(2, "eval report @/out"), &["/out", "older version"]);
    assert_has(&bench.says(1, "eval report @"), &["evaluation.json", "there are no results"]);
    std::fs::write(bench.path("out/evaluation.json"), "{\"format\": 4, \"program\": \"modulo 0.0.9\"}")
        .expect("writable");
    assert_has(&bench.says(2, CELL), &["modulo 0.0.9", "format 4", "--fresh"]);
    bench.says(0, &format!("{CELL} --fresh"));
    bench.says(0, "eval report @/out");
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
    assert_eq!(expected["cells"].as_array().expect("cells").len(), 2 * 8, "two alphas, eight ways each");
    for (name, more) in [("again", "--jobs 1"), ("slices", "--frames 3:"), ("slices", "--frames 0:3")] {
        bench.says(0, &format!("{GRID} @/{name} {more}"));
    }
    assert_eq!(timeless(&bench.path("again")).to_string(), expected.to_string());
    assert!(stored(&bench.path("again")) == stored(&whole));
    assert_eq!(timeless(&bench.path("slices")).to_string(), expected.to_string());

    let times = || bench.json("whole/results.json")["cells"].clone();
    let before = times();
    bench.says(0, &format!("{GRID} @/whole"));
    assert_eq!(times(), before, "nothing was left to do, and no time was measured again");
    // Another seed is another cell.
    bench.says(0, &format!("{GRID} @/whole --seed 1"));
    assert_eq!(bench.json("whole/results.json")["cells"].as_array().expect("cells").len(), 4 * 8);
}

/// Half of the cells were lost, and a run that was killed left nothing of the cell that it was at.
#[test]
fn processes_on_one_folder_lose_nothing_also_when_they_are_killed() {
    let bench = Bench::new();
    let grid = "eval --source scene://day?seed=3&frames=4&width=320&height=128 --engine rten --alpha 2,3,4 --jobs 1 -o";
    bench.says(0, &format!("{grid} @/whole"));
    let (whole, out) = (bench.path("whole"), bench.path("shared"));
    let shared = format!("{grid} @/shared");
    let others = [(); 2].map(|()| bench.starts(&shared));
    for _ in 0..2 {
        let (before, killed) = (stored(&out).len(), bench.starts(&shared));
        wait_until("another cell is done", || stored(&out).len() > before || stored(&out).len() == 24);
        killed.end("KILL");
    }
    // Each of them waits for what the others are at, and has the whole report.
    for mut other in others {
        assert_eq!(other.0.wait().expect("it ends").code(), Some(0));
    }
    bench.says(0, &shared);
    assert_eq!(stored(&out).len(), 3 * 8);
    assert!(stored(&out) == stored(&whole), "each cell once, with the same bytes");
    for file in ["report.html", "results.json"] {
        let [one, several] = [&whole, &out].map(|folder| std::fs::read(folder.join(file)).expect("there"));
        assert!(one == several, "{file}");
    }
}

#[test]
fn shot_noise_is_an_axis_that_a_later_run_can_extend() {
    let bench = Bench::new();
    let out = bench.path("out");
    let streams = "--stream modulo,recovered --method auto --deblur off --alpha 4";
    let eval = |noises: &str| bench.says(0, &format!("{CELL} {streams} --shot-noise {noises}"));
    eval("0");
    eval("0,2");
    let cells = cells(&out);
    let noises: Vec<_> = cells.iter().map(|cell| cell["shot_noise"].as_f64()).collect();
    assert_eq!(noises, [0.0, 0.0, 2.0, 2.0].map(Some));
    let exact = |cell: &Value| cell["exact_k"].as_f64().expect("a share");
    assert!(exact(&cells[1]) > exact(&cells[3]), "noise costs exactness: {cells:?}");
    assert!(cells.iter().all(|cell| cell["frames"] == 4));
    let charts = std::fs::read_dir(out.join("charts")).expect("charts");
    let names: Vec<String> =
        charts.map(|file| file.expect("a file").file_name().into_string().expect("UTF-8")).collect();
    let wanted = "shot_demo_input_auto_alpha4_psf1.4_read0.svg";
    assert!(names.iter().any(|name| name == wanted), "{names:?}");
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
    let (old, old_boxes) = (cells(), stored(&out));
    assert_eq!(old.len(), 7);

    eval("0.8,2");
    assert!(old.iter().all(|cell| cells().contains(cell)), "the figures of the old cells stay");
    assert_eq!(cells().len(), 7 + 3);
    let all = stored(&out);
    let are_kept = old_boxes.iter().all(|(name, bytes)| all[name] == *bytes);
    assert!(are_kept && all.len() == 10, "so do their boxes");
    let lenses: Vec<f64> = cells().iter().filter_map(|cell| cell["psf_sigma"].as_f64()).collect();
    assert!([0.8, 1.4, 2.0].iter().all(|lens| lenses.contains(lens)), "{lenses:?}");
    let page = std::fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(["1.4 px", "0.8 px", "2 px"].iter().all(|lens| page.contains(&format!("lens blur {lens}"))));
    // A saturated image has a PSNR, but no wrap counts.
    let cells = cells();
    let saturated = cells.iter().find(|cell| cell["stream"] == "saturated").expect("its cell");
    let psnr = saturated["psnr_db"].as_f64().expect("a PSNR");
    assert!(saturated["stream"] == "saturated" && (5.0..60.0).contains(&psnr), "{saturated}");
    assert!(saturated["exact_k"].is_null(), "{saturated}");
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
    // The ideal image does not depend on the gains.
    for (stream, method) in
        [("saturated", "checkerboard_gains"), ("recovered", "checkerboard_gains"), ("modulo", "")]
    {
        assert!(named.iter().any(|row| *row == ["checkerboard", stream, method]), "{named:?}");
    }
    assert_eq!(named.iter().filter(|row| row[0] == "none").count(), 5, "{named:?}");
    let recovered =
        cells.iter().find(|cell| cell["method"] == "checkerboard_gains" && cell["stream"] == "recovered");
    let exact = recovered.expect("its cell")["exact_k"].as_f64().expect("a share");
    assert!(exact > 0.99, "{exact}");
}

/// The images of a mosaic are compared and detected in as those of three chips.
#[test]
fn a_mosaic_is_exact_behind_a_lens() {
    let bench = Bench::new();
    let sensor = "--alpha 2 --psf-sigma 1.4 --mosaic none,grbg --deblur off";
    let streams = "--stream ideal,recovered --method auto,spud_as_published";
    bench.says(0, &format!("{CELL} {sensor} {streams}"));
    let cells = cells(&bench.path("out"));
    let word = |cell: &Value, name| cell[name].as_str().expect("a word").to_owned();
    let mut named: Vec<[String; 2]> =
        cells.iter().map(|cell| ["mosaic", "stream"].map(|name| word(cell, name))).collect();
    named.sort();
    let of = |mosaic| [[mosaic, "ideal"], [mosaic, "ideal"], [mosaic, "recovered"]];
    // SPUD as published has three chips only.
    let three_chips = [["none", "recovered"], ["none", "recovered"]];
    assert_eq!(named, [&of("grbg")[..], &of("none")[..2], &three_chips].concat());
    let last = cells
        .iter()
        .find(|cell| cell["mosaic"] == "grbg" && cell["stream"] == "recovered")
        .expect("its cell");
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
    // Both data sets are named, too.
    let sides = ["a", "b"].map(|name| bench.path(name).display().to_string());
    let [a, b] = sides.each_ref().map(String::as_str);
    assert_has(&refused, &["other images", "frame 000000", a, b, "--fresh"]);
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
    assert_has(&eval(3, ""), &["3 frames have no labels"]);
    std::fs::remove_dir_all(bench.path("out")).expect("there");

    std::fs::create_dir(bench.path("kitti/label_2")).expect("made");
    let label = |name: &str, text: &str| {
        std::fs::write(bench.path("kitti/label_2").join(name), text).expect("written");
    };
    label("000000.txt", &(kitti_label("Car").repeat(2) + "Car 0.00 0 0 80 10 140 50 1 1 1 1 1 1 0\n"));
    label("000001.txt", "Car 0.00 0 0 ten\n");
    let wanted = [
        "1 labels cannot be read",
        "000001.txt:1",
        "1 frames have no labels",
        "reach outside the image",
        "1 labels are there twice and count once",
    ];
    assert_has(&eval(3, ""), &wanted);
    let results = bench.json("out/results.json");
    assert_eq!((&results["input"]["frames"], &results["input"]["labelled"]), (&3.into(), &2.into()));

    for (list, code, wanted) in [
        ("# nothing\n", 2, "list is empty"),
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
