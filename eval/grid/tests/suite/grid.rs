//! Runs on rendered scenes. Two runs are equal, however they are cut; each frame of several sources in one bag has its own time stamp and
//! labels.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use clap::Parser as _;
use modulo_ap::Difficulty;
use modulo_bags::bag::{BagReader, BagWriter, Compression, Selection};
use modulo_bags::source::{GroundTruth, SourceOptions, open};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::Frame;
use modulo_detector::DetectorParameters;
use modulo_eval::data::DataOptions;
use modulo_eval::plan::{CAMERA, DETECTOR, PlannedNode, UNWRAP, Variant, cells};
use modulo_eval::progress::Listener;
use modulo_eval::recordings::{RecordOptions, Recordings};
use modulo_eval::results::{Cell, Results};
use modulo_eval::run::{Evaluation, Request};
use modulo_eval::score::{ScoreOptions, score};
use modulo_eval::store::Folder;
use modulo_eval::variants::{Axes, Varied};
use modulo_eval::{GridError, coco, report};
use modulo_images::save_png;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{ManualClock, Message, NodeName, ParameterSet as _, Parameters, SystemClock};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};
use ndarray::Array3;

/// The nodes of compare.launch.yaml, which has no argument here.
fn nodes(arguments: &[(String, String)]) -> Result<Vec<PlannedNode>, GridError> {
    assert_eq!(arguments, []);
    let node = |executable, name: &str, declared, set: &[(&str, &str)]| PlannedNode {
        executable,
        name: NodeName::new(name, "/", &[]).expect("a name"),
        parameters: Parameters::declare(declared).with_text(set).expect("possible"),
    };
    let mut nodes = vec![
        node(CAMERA, "modulo_camera", CameraParameters::descriptors(), &[]),
        node(UNWRAP, "unwrap", UnwrapParameters::descriptors(), &[]),
    ];
    for input in ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal"] {
        let (name, set) = (format!("detector_{input}"), [("input", input), ("engine", "rten")]);
        nodes.push(node(DETECTOR, &name, DetectorParameters::descriptors(), &set));
    }
    Ok(nodes)
}

fn axes(options: &str) -> Axes {
    Axes::parse_from(["eval"].into_iter().chain(options.split_whitespace()))
}

/// A run without a launch file.
struct Run {
    variants: Vec<Variant>,
    request: Request,
    out: PathBuf,
}

impl Run {
    fn new(sources: &[&str], options: &str, out: &Path) -> Self {
        let source = sources.iter().map(|&source| source.to_owned()).collect();
        let data = DataOptions { source, ..DataOptions::default() };
        let variants = axes(options).variants(&nodes, &[], true).expect("possible");
        Self { variants, request: Request { data, jobs: 2, ..Request::default() }, out: out.to_owned() }
    }

    fn results(&self) -> Results {
        let listener = Listener { tell: &|_| {}, stopped: &|| false };
        let mut evaluation = Evaluation::new(&self.request, &self.variants).expect("possible");
        evaluation.run(&self.out, &SystemClock::default(), &listener).expect("evaluated")
    }
}

/// Without an option, the values of the command line.
const STILL: &str = "--method auto --deblur off --alpha 4 --headroom 1";

fn cell<'r>(results: &'r Results, stream: &str) -> &'r Cell {
    results.cells.iter().rev().find(|cell| cell.point.is(stream)).expect("the cell")
}

/// The settings of the cells of these options.
fn points(options: &str) -> Result<Vec<modulo_eval::results::Point>, GridError> {
    let variants = axes(options).variants(&nodes, &[], true)?;
    Ok(cells(&variants)?.into_iter().map(|cell| cell.key.point).collect())
}

#[test]
fn the_default_has_one_sharp_ideal_an_alpha_and_deblurs_what_was_recovered() {
    let default = points("").expect("possible");
    // Sharp, blurred, saturated, modulo, and two methods with and without.
    assert_eq!(default.len(), 4 * (4 + 2 * 2));
    assert!(default.iter().all(|point| point.is("recovered") == point.method.is_some()));
    assert!(default.iter().all(|point| !point.deblur || point.is("recovered")));
    assert_eq!(default.iter().filter(|point| point.is_sharp_ideal()).count(), 4);
    let alphas: Vec<f64> = default.iter().map(|point| point.sensor.alpha).collect();
    assert!(alphas.is_sorted(), "models and sensors vary slower than streams: {alphas:?}");
    // A value that is there twice, and deblurring without a blur, give no other cell.
    let sharp = points("--psf-sigma 0,0 --alpha 2,2").expect("possible");
    assert_eq!(sharp.len(), 3 + 2);
    assert!(sharp.iter().all(|point| !point.deblur));
}

/// What has no effect on a stream does not tell its cells apart.
#[test]
fn a_cell_has_what_decides_its_boxes() {
    let delays =
        "--stream auto_exposed,metered,recovered --method auto --deblur off --alpha 4 --exposure-delay 1,3";
    assert_eq!(points(delays).expect("possible").len(), 2 + 2);
    let gains = "--stream ideal,saturated,recovered --alpha 4 --psf-sigma 0 --gains none,checkerboard --method auto,spud";
    let gains = points(gains).expect("possible");
    let of_gains: Vec<_> = gains.iter().filter(|point| point.sensor.gains).collect();
    assert_eq!((gains.len(), of_gains.len()), (4 + 2, 2));
    assert!(of_gains.iter().all(|point| point.method.as_deref() == Some("checkerboard_gains")));
    let vary = |text: &str| text.parse::<Varied>().expect("a name with values");
    let varied = [vary("unwrap.budget=50,225"), vary("modulo_camera.seed=0,1")];
    let variants = axes(STILL).variants(&nodes, &varied, false).expect("possible");
    let cells = cells(&variants).expect("possible");
    let budgets = |stream: &str| cells.iter().filter(|cell| cell.key.point.is(stream)).count();
    assert_eq!((budgets("recovered"), budgets("ideal")), (4, 2), "the ideal image is not unwrapped");
    let named = cells.iter().filter(|cell| cell.key.point.more.contains_key("unwrap.budget"));
    let named: Vec<_> = named.map(|cell| cell.key.point.more["unwrap.budget"].as_str()).collect();
    assert_eq!(named, ["50"; 4], "recovered and metered with two seeds; the default has no name");
    let seeds = axes("--method spud_as_published --stream recovered --alpha 4")
        .variants(&nodes, &varied[1..], true)
        .expect("possible");
    assert_eq!(
        modulo_eval::plan::cells(&seeds).expect("possible").len(),
        2,
        "it has the noise of its seed, too"
    );
}

/// A default and a short form overrode what `--vary` named, without a word.
#[test]
fn what_varies_has_no_default_and_is_given_once() {
    let points = |options: &str, varied: &str| {
        let varied = varied.split_whitespace().map(|text| text.parse().expect("a name with values"));
        let variants = axes(options).variants(&nodes, &varied.collect::<Vec<Varied>>(), true)?;
        Ok::<_, GridError>(cells(&variants)?.into_iter().map(|cell| cell.key.point).collect::<Vec<_>>())
    };
    let varied = "modulo_camera.alpha=6 unwrap.method=lines unwrap.deblur=false detector.model=a.onnx,b.onnx \
                  detector_recovered.input_size=96x64";
    let own = points("--stream recovered", varied).expect("possible");
    let words = |point: &modulo_eval::results::Point| {
        (
            point.sensor.alpha,
            point.method.clone().expect("recovered"),
            point.model.clone(),
            point.input.clone(),
        )
    };
    let expected = ["a", "b"].map(|model| (6.0, "lines".to_owned(), model.to_owned(), "96x64".to_owned()));
    assert_eq!(own.iter().map(words).collect::<Vec<_>>(), expected);
    let specific = points("--stream recovered,ideal --input 64x64", "detector_ideal.input_size=96x64")
        .expect("possible");
    assert!(specific.iter().all(|point| (point.input == "96x64") == point.is("ideal")), "{specific:?}");
    for (options, varied, names) in [
        ("--alpha 2", "alpha=4", ["modulo_camera.alpha", "alpha"]),
        ("--model a.onnx", "detector.model=b.onnx", ["detector.model", "short form"]),
        ("--psf-sigma 1", "modulo_camera.psf_sigma=2", ["modulo_camera.psf_sigma", "--vary"]),
        ("", "unwrap.method=auto unwrap.method=spud", ["unwrap.method", "once"]),
    ] {
        let why = points(options, varied).expect_err(varied).to_string();
        assert!(names.iter().all(|name| why.contains(name)), "{why}");
    }
}

#[test]
fn spud_as_published_is_never_deblurred_and_what_is_unknown_is_named() {
    let published = points("--method spud_as_published").expect("possible");
    assert_eq!(published.len(), 4 * 5);
    assert!(published.iter().all(|point| !point.deblur));
    for (options, named) in [("--stream depth", "depth"), ("--method magic", "magic")] {
        assert!(points(options).expect_err(options).to_string().contains(named));
    }
    let idle = ["detector_ideal.score_threshold=0.1,0.5".parse::<Varied>().expect("a name")];
    let why = axes("").variants(&nodes, &idle, false).expect_err("no effect").to_string();
    assert!(why.contains("detector_ideal.score_threshold"), "{why}");
    let varied = ["nobody.alpha=2".parse::<Varied>().expect("a name")];
    let why = axes("").variants(&nodes, &varied, false).expect_err("no node").to_string();
    assert!(why.contains("nobody.alpha") && why.contains("detector_ideal"), "{why}");
}

const DAY: &str = "scene://day?seed=3&frames=3&width=320&height=128";

#[test]
fn two_runs_are_the_same() {
    let run = || {
        let folder = tempfile::tempdir().expect("a folder");
        Run::new(&[DAY], "--stream ideal --alpha 2", folder.path()).results().cells
    };
    let steady = run();
    assert!(steady[0].ap50["vehicle"].is_some_and(|ap| ap > 0.2), "{:?}", steady[0].ap50);
    assert_eq!(steady, run());
}

/// Every file below a folder but claims, with its content.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if entry.is_dir() {
            all.extend(files(&entry));
        } else if !entry.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")) {
            all.push((entry.display().to_string(), std::fs::read(&entry).expect("readable")));
        }
    }
    all.sort();
    all
}

const ALL: Range<usize> = 0..usize::MAX;

/// Two drives, whose light changes: a camera that follows it needs the frames before a slice.
#[test]
fn an_exposure_that_follows_the_frames_is_the_same_however_it_is_cut() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = |seed: u8| format!("scene://glare?seed={seed}&frames=60&width=160&height=64&light=tunnels");
    let [first, second] = [3, 4].map(scene);
    let options =
        "--stream auto_exposed,metered,recovered --method auto --deblur off --alpha 4 --exposure-delay 1,3";
    let cut = |name: &str, jobs, slices: &[Range<usize>]| {
        let mut run = Run::new(&[&first, &second], options, &folder.path().join(name));
        run.request.jobs = jobs;
        let runs = slices.iter().map(|places| {
            run.request.places = Some(places.clone());
            run.results()
        });
        runs.last().expect("a slice")
    };
    let whole = cut("one", 1, std::slice::from_ref(&ALL));
    assert_eq!(whole.cells.len(), 4);
    assert_eq!(cut("three", 3, std::slice::from_ref(&ALL)), whole);
    assert_eq!(cut("slices", 2, &[70..100, 0..45, 45..70, 100..usize::MAX]), whole);
    let (metered, recovered) = (cell(&whole, "metered"), cell(&whole, "recovered"));
    assert_eq!(metered.exact_k, recovered.exact_k);
    assert_eq!(metered.psnr_db, recovered.psnr_db, "the quality is that of the recovered image");
    // What is done is not done again, and a part of it is found.
    let before = files(&folder.path().join("one/cells"));
    cut("one", 2, &[0..usize::MAX, 10..20]);
    assert_eq!(files(&folder.path().join("one/cells")), before);
}

/// Slices of several folders, other groups and COCO's form need no other run.
#[test]
fn scores_follow_from_the_boxes_that_are_stored() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |name: &str, places: Range<usize>| {
        let mut run = Run::new(&[DAY], "--stream ideal,saturated --alpha 2", &folder.path().join(name));
        run.request.places = Some(places);
        (run.results(), Folder::existing(&run.out).expect("results"))
    };
    let (whole, one) = run("whole", 0..3);
    let parts = [run("first", 0..1).1, run("rest", 1..3).1];
    assert_eq!(score(&parts, &ScoreOptions::default()).expect("scored"), whole);
    let groups = folder.path().join("groups.yaml");
    std::fs::write(&groups, "car: everything\nvan: everything\npedestrian: everything\nperson: everything\n")
        .expect("written");
    let options =
        ScoreOptions { groups: Some(groups), difficulty: Some(Difficulty::All), ..ScoreOptions::default() };
    let regrouped = score(std::slice::from_ref(&one), &options).expect("scored");
    let objects = |results: &Results| results.cells[0].objects.values().sum::<usize>();
    assert!(regrouped.cells[0].objects.contains_key("everything") && objects(&regrouped) > objects(&whole));

    let out = folder.path().join("coco");
    coco::export(&[one], &options, &out).expect("written");
    let json = |file: &Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(file).expect("there")).expect("JSON")
    };
    let labels = json(&out.join("annotations.json"));
    assert_eq!(labels["images"].as_array().expect("images").len(), 3);
    let counted =
        labels["annotations"].as_array().expect("labels").iter().filter(|label| label["iscrowd"] == 0);
    assert_eq!(counted.count(), objects(&regrouped));
    let results = std::fs::read_dir(out.join("results"))
        .expect("results")
        .map(|file| json(&file.expect("a file").path()));
    for boxes in results {
        let first = &boxes.as_array().expect("boxes")[0];
        assert!(
            first["image_id"].is_u64()
                && first["category_id"] == 1
                && first["bbox"].as_array().expect("a box").len() == 4
        );
        assert!(
            boxes.as_array().expect("boxes").iter().any(|one| one["score"].as_f64() < Some(0.05)),
            "low scores, too"
        );
    }
}

/// One of eight processes that began with the same folder took the marker of another one for a file of somebody else.
#[test]
fn runs_that_begin_at_the_same_time_share_a_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    for round in 0..200 {
        let out = folder.path().join(round.to_string());
        let start = std::sync::Barrier::new(8);
        let open = || {
            start.wait();
            Folder::open(&out, false).map(drop)
        };
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(open)).collect();
            threads.into_iter().for_each(|thread| thread.join().expect("no panic").expect("taken"));
        });
    }
}

#[test]
fn the_report_has_the_frame_in_which_the_streams_differ_and_is_written_again_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let streams = format!("{STILL} --stream ideal,recovered");
    let run = Run::new(&[DAY], &streams, folder.path());
    let results = run.results();
    let evaluation = Evaluation::new(&run.request, &run.variants).expect("possible");
    let title = evaluation.draw(folder.path(), &SystemClock::default(), &results).expect("drawn");
    assert!(title.is_some_and(|title| title.contains("demo")));
    let page =
        std::fs::read_to_string(report::write(folder.path(), &results).expect("a page")).expect("readable");
    assert!(page.contains("recovered (auto") && page.contains("data:image/jpeg;base64,"));
    assert!(folder.path().join(report::GRID).is_file());
    // The page is the same if it is written again from the files.
    assert_eq!(
        page,
        std::fs::read_to_string(report::write(folder.path(), &results).expect("a page")).expect("readable")
    );
}

/// A picture in linear light, through camera and unwrapping: the recovered image is the ideal one, and the picture.
#[test]
fn a_picture_returns_from_linear_light() {
    let folder = tempfile::tempdir().expect("a folder");
    let picture =
        Array3::from_shape_fn((64, 256, 3), |(i, j, _)| if i < 32 { j as u8 } else { 255 - j as u8 });
    let path = folder.path().join("picture.png");
    save_png(&path, &Frame::from_u8(picture.clone()).expect("a frame")).expect("a PNG");
    let source = path.to_str().expect("UTF-8");
    let pairs = [("source", source), ("bits", "12"), ("transfer", "srgb"), ("optical_black", "0")];
    let timer = ManualClock::default();
    let topics = ["/ideal", "/recovered"].map(str::to_owned).to_vec();
    let mut chain = Lockstep::new(&timer, topics.clone());
    let name = |name| NodeName::new(name, "/", &[]).expect("a name");
    let camera = CameraParameters::from_text(&pairs).expect("possible");
    chain.add(Box::new(ModuloCamera::new(&camera).expect("a camera")), &name("camera")).expect("a node");
    let unwrap = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    chain.add(Box::new(unwrap), &name("unwrap")).expect("a node");
    let out = chain.tick(0, 0).expect("no failure").expect("a frame");
    let [ideal, recovered] = [0, 1].map(|topic: usize| {
        let found = out.iter().find(|(name, _)| *name == topics[topic]).map(|(_, message)| message);
        let Some(Message::Image(image)) = found else { panic!("an image is expected: {out:?}") };
        image.frame.as_u8().expect("8 bits").clone()
    });
    assert_eq!(recovered, ideal);
    // Away from the edge between the two halves, which the lens blurs.
    for ((i, j, c), code) in picture.indexed_iter().filter(|((i, ..), _)| *i < 24 || *i > 40) {
        let shown = recovered[(i, j, c)];
        assert!(shown.abs_diff(*code) <= 2, "({i}, {j}): {code} is shown as {shown}");
    }
}

/// Writes a KITTI folder of `frames` images. All pixels, and the x of an object, have the value `seed`, `seed` + 8, ...
fn write_kitti(folder: &Path, frames: u8, seed: u8) {
    for name in ["image_2", "label_2"] {
        std::fs::create_dir_all(folder.join(name)).expect("a folder");
    }
    for value in (0..frames).map(|number| seed + 8 * number) {
        let frame = Frame::from_u8(Array3::from_elem((64, 200, 3), value)).expect("a frame");
        save_png(&folder.join(format!("image_2/{value:06}.png")), &frame).expect("a PNG");
        let label = format!("Car 0.00 0 0.00 {value}.00 0.00 190.00 60.00 1 1 1 0 0 0 0\n");
        std::fs::write(folder.join(format!("label_2/{value:06}.txt")), label).expect("a label");
    }
}

/// Records a camera at rate 0 over each of `sources` into `bag`.
fn record(sources: &[&Path], more: &[(&str, &str)], bag: &Path) {
    let all = nodes(&[]).expect("nodes");
    let nodes = |source: &Path| {
        let source = [("source", source.to_str().expect("UTF-8")), ("rate", "0"), ("optical_black", "0")];
        let mut nodes = [all[0].clone(), all.last().expect("a detector").clone()].to_vec();
        nodes[0].parameters = nodes[0].parameters.with_text(&[&source, more].concat()).expect("possible");
        nodes
    };
    let topics = ["/ideal", "/ground_truth"].map(str::to_owned).to_vec();
    let options = RecordOptions { bag: Some(bag.to_owned()), topics, images: false };
    let variants = [Variant { nodes: nodes(sources[0]), wanted: None }];
    let out = bag.with_extension("out");
    let mut recordings = Recordings::create(&options, &variants, &out).expect("new").expect("a bag");
    for source in sources {
        let go_on = |_: &Lockstep<'_>| ControlFlow::Continue(());
        recordings.record(&nodes(source), &ManualClock::default(), &go_on).expect("recorded");
    }
    recordings.finish().expect("finished");
}

/// Checks that the images of `bag` are those of `expected`, in this order, at strictly increasing times, each with its
/// own object.
fn check(bag: &Path, expected: &[u8]) {
    let reader = BagReader::open(bag).expect("a bag");
    for topic in ["/ideal", "/ground_truth"] {
        let messages = reader.messages(&Selection::of([topic]));
        let times: Vec<u64> = messages.map(|message| message.expect("readable").log_time).collect();
        assert_eq!(times.len(), expected.len(), "{topic}");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{topic}: {times:?}");
    }
    let options = SourceOptions { topic: Some("/ideal".into()), ..SourceOptions::default() };
    let mut source = open(bag.to_str().expect("UTF-8"), &options).expect("a source");
    let frames = std::iter::from_fn(|| source.next()).map(|frame| frame.expect("whole"));
    let found: Vec<(u8, f32)> = frames
        .map(|frame| {
            let truth: Vec<GroundTruth> = frame.ground_truth.expect("labelled");
            let [object] = &truth[..] else { panic!("one object: {truth:?}") };
            ((frame.radiance[[0, 0, 0]] * 255.0).round() as u8, object.bbox.x1)
        })
        .collect();
    let objects: Vec<f32> = expected.iter().map(|value| f32::from(*value)).collect();
    assert_eq!(found.iter().map(|(_, x1)| *x1).collect::<Vec<_>>(), objects, "{found:?}");
    let pixels: Vec<u8> = found.iter().map(|(pixel, _)| *pixel).collect();
    assert!(
        pixels.windows(2).zip(expected.windows(2)).all(|(a, b)| a[0].cmp(&a[1]) == b[0].cmp(&b[1])),
        "{pixels:?}"
    );
}

#[test]
fn sources_without_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_kitti(&a, 3, 10);
    write_kitti(&b, 2, 60);
    let bag = folder.path().join("bag");
    record(&[&a, &b], &[], &bag);
    check(&bag, &[10, 18, 26, 60, 68]);
    let looped = folder.path().join("looped");
    record(&[&b, &a], &[("loop", "true"), ("frames", "4")], &looped);
    check(&looped, &[60, 68, 60, 68, 10, 18, 26, 10]);
}

/// Both recordings start at the same time stamp.
#[test]
fn sources_with_the_same_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let bags = [("a", 10), ("b", 60)].map(|(name, seed)| {
        let (kitti, bag) = (folder.path().join(name), folder.path().join(format!("{name}_bag")));
        write_kitti(&kitti, 2, seed);
        record(&[&kitti], &[], &bag);
        bag
    });
    let bag = folder.path().join("bag");
    record(&[&bags[0], &bags[1]], &[("loop", "true"), ("frames", "3")], &bag);
    check(&bag, &[10, 18, 10, 60, 68, 60]);
    // A plain copy of both bags is refused, because it has two labels with one stamp.
    let error = both(&bags, &folder.path().join("both"));
    assert!(error.contains("other labels") && error.contains("/ground_truth"), "{error}");
}

/// Copies the messages of all `bags` into one, and opens it.
fn both(bags: &[std::path::PathBuf], out: &Path) -> String {
    let mut recorder = BagWriter::create(out, Compression::None).expect("a new bag");
    for bag in bags {
        for message in BagReader::open(bag).expect("a bag").messages(&Selection::default()) {
            let message = message.expect("readable");
            let (log_time, publish_time) = (message.log_time, message.publish_time);
            recorder.record(&message.topic, log_time, publish_time, &message.data).expect("written");
        }
    }
    recorder.finish().expect("finished");
    open(out.to_str().expect("UTF-8"), &SourceOptions::default()).err().expect("refused").to_string()
}
