//! Runs of a grid on rendered scenes. Two runs are equal, unless a node depends on the wall clock; three merged captures have
//! ghosts where one capture has none.

use std::path::Path;
use std::time::SystemTime;

use modulo_detector::{DetectorParameters, EngineChoice};
use modulo_eval::grid::{
    Axes, Data, DeblurChoice, GridError, GridEvent, GridOptions, Nodes, Request, Suite, draw_pictures, run,
};
use modulo_eval::report;
use modulo_eval::results::{Cell, Provenance, Results, Stream};
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::{
    Context, Flow, Message, Node, ParameterError, Parameters, StepError, SystemClock, Topic, Trigger,
};

/// The nodes of the suite with a detector that depends on the wall clock.
struct DriftingNodes;

struct DriftingDetector(Box<dyn Node>);

impl Nodes for DriftingNodes {
    fn detector(&self, with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(DriftingDetector(Suite.detector(with)?)))
    }
}

impl Node for DriftingDetector {
    fn inputs(&self) -> Vec<Topic> {
        self.0.inputs()
    }

    fn outputs(&self) -> Vec<Topic> {
        self.0.outputs()
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        self.0.status()
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.0.configure(parameters)
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let wanted = [true; 2];
        let clock = SystemClock::default();
        let mut inner = Context::new(cx.node(), &clock, &wanted[..1]);
        let flow = self.0.step(trigger, &mut inner)?;
        // The deliberate mistake: the clock moves the boxes by up to 30 px.
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let drift = f64::from(now.subsec_nanos() % 30_011) / 1000.0;
        for (output, message) in inner.finish().messages {
            let Message::Detections(array) = message else { continue };
            let mut array: Detection2DArray = (*array).clone();
            array.detections.iter_mut().for_each(|d| d.bbox.center.position.x += drift);
            cx.emit(output, Message::Detections(array.into()));
        }
        Ok(flow)
    }
}

fn still_request(out: &Path) -> Request {
    let axes = Axes { stream: vec![Stream::Ideal], alpha: vec![2.0], ..Axes::default() };
    Request {
        data: Data::Any("scene://day?seed=3&frames=3&width=320&height=128".to_owned()),
        options: GridOptions {
            axes,
            engine: EngineChoice::Rten,
            jobs: 1,
            time_frames: 0,
            ..GridOptions::default()
        },
        provenance: Provenance::default(),
        out: out.to_owned(),
    }
}

/// The cells of a new run without their durations.
fn cells(nodes: &dyn Nodes) -> Vec<Cell> {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome =
        run(&still_request(folder.path()), nodes, &SystemClock::default(), &|_| {}).expect("evaluated");
    let timeless = |cell: Cell| Cell {
        latency_ms: Default::default(),
        latency_histogram: Vec::new(),
        frame_ms: None,
        ..cell
    };
    outcome.results.cells.into_iter().map(timeless).collect()
}

#[test]
fn two_runs_are_the_same_and_a_look_at_the_clock_is_seen() {
    let steady = cells(&Suite);
    assert!(steady[0].ap50["vehicle"].is_some_and(|ap| ap > 0.2), "{:?}", steady[0].ap50);
    assert_eq!(steady, cells(&Suite));
    let drifting = cells(&DriftingNodes);
    assert_ne!(drifting, cells(&DriftingNodes), "a wall clock in a step must not go unseen");
    assert_ne!(drifting, steady);
}

fn request(data: Data, streams: &[Stream], out: &Path) -> Request {
    let axes = Axes {
        stream: streams.to_vec(),
        method: vec!["auto".to_owned()],
        deblur: DeblurChoice::Off,
        alpha: vec![4.0],
        ..Axes::default()
    };
    let options =
        GridOptions { axes, engine: EngineChoice::Rten, jobs: 2, time_frames: 1, ..GridOptions::default() };
    Request { data, options, provenance: Provenance::default(), out: out.to_owned() }
}

fn results(request: &Request) -> Result<Results, GridError> {
    run(request, &Suite, &SystemClock::default(), &|_: GridEvent<'_>| {}).map(|outcome| outcome.results)
}

fn cell(results: &Results, stream: Stream) -> &Cell {
    results.cells.iter().rev().find(|cell| cell.point.stream == stream).expect("the cell")
}

#[test]
fn what_moves_has_ghosts_in_three_captures_and_none_in_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let streams = [Stream::Ideal, Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill];
    let scene = "scene://glare?seed=3&frames=6&width=480&height=144";
    let request = request(Data::Any(scene.to_owned()), &streams, folder.path());
    let results = results(&request).expect("results");
    let psnr = |stream| cell(&results, stream).psnr_db.unwrap_or(f64::INFINITY);
    let [one, moving, still] =
        [Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill].map(psnr);
    assert!(still > 45.0, "merged captures of a still scene are nearly ideal: {still} dB");
    assert!(moving < still - 10.0, "the ghosts: {moving} dB against {still} dB");
    assert!(one > moving + 10.0, "one capture has none: {one} dB against {moving} dB");
    let merged = cell(&results, Stream::MultiExposure);
    assert_eq!((merged.frames, merged.exact_k), (6, None));
    assert!(merged.latency_ms.contains_key("merge"));

    let pictures = draw_pictures(&request, &Suite, &SystemClock::default(), &results).expect("pictures");
    report::save_pictures(folder.path(), &pictures).expect("kept");
    let page = std::fs::read_to_string(report::write(folder.path()).expect("a page")).expect("readable");
    assert!(page.contains("multi_exposure_still") && page.contains("data:image/jpeg;base64,"));
    assert!(folder.path().join("charts/pictures_streams.png").is_file());
    // The page is the same if it is written again from the files.
    assert_eq!(
        page,
        std::fs::read_to_string(report::write(folder.path()).expect("a page")).expect("readable")
    );
}

#[test]
fn frames_that_do_not_follow_each_other_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = Data::Kitti { folder: folder.path().to_owned(), list: None };
    let why = results(&request(data, &[Stream::MultiExposure], folder.path())).expect_err("refused");
    assert!(why.to_string().contains("multi_exposure_still"), "{why}");
}
