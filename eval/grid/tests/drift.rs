//! Checks the comparison of two runs: a node that depends on the wall clock makes them differ.

use std::path::Path;
use std::time::SystemTime;

use modulo_detector::{DetectorParameters, EngineChoice};
use modulo_eval::data::Data;
use modulo_eval::grid::{Axes, GridError, Nodes, Options, Request, Suite, run};
use modulo_eval::results::{Cell, Stream};
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::{
    Context, Flow, Message, Node, ParameterError, Parameters, StepError, SystemClock, Topic, Trigger,
};

/// The nodes of the suite with a detector that depends on the wall clock.
struct Drifting;

struct Detector(Box<dyn Node>);

impl Nodes for Drifting {
    fn detector(&self, with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(Detector(Suite.detector(with)?)))
    }
}

impl Node for Detector {
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

fn request(out: &Path) -> Request {
    let axes = Axes { stream: vec![Stream::Ideal], alpha: vec![2.0], ..Axes::default() };
    Request {
        data: Data::Any("scene://day?seed=3&frames=3&width=320&height=128".to_owned()),
        options: Options { axes, engine: EngineChoice::Rten, jobs: 1, ..Options::default() },
        processor: String::new(),
        out: out.to_owned(),
    }
}

/// The cells of a new run without their durations.
fn cells(nodes: &dyn Nodes) -> Vec<Cell> {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = run(&request(folder.path()), nodes, &SystemClock::default(), &|_| {}).expect("evaluated");
    let timeless =
        |cell: Cell| Cell { latency_ms: Default::default(), latency_histogram: Vec::new(), ..cell };
    outcome.results.cells.into_iter().map(timeless).collect()
}

#[test]
fn two_runs_are_the_same_and_a_look_at_the_clock_is_seen() {
    let steady = cells(&Suite);
    assert!(steady[0].ap50["vehicle"].is_some_and(|ap| ap > 0.2), "{:?}", steady[0].ap50);
    assert_eq!(steady, cells(&Suite));
    let drifting = cells(&Drifting);
    assert_ne!(drifting, cells(&Drifting), "a wall clock in a step must not go unseen");
    assert_ne!(drifting, steady);
}
