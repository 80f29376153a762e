//! The three drivers run the same steps to the same results.

use std::sync::Arc;
use std::time::Duration;

use modulo_core::Frame;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::driver::live::{self, Subject};
use modulo_runtime::driver::{CommonParameters, composed, lockstep::Lockstep};
use modulo_runtime::transport::Transport;
use modulo_runtime::transport::keys::Hashes;
use modulo_runtime::transport::local::LocalTransport;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{
    Clock, Context, Cue, Flow, ManualClock, Message, MessageKind, Node, NodeReport, ParameterSet, Parameters,
    Place, Refusal, StampedFrame, StepError, Stop, SystemClock, Topic,
};
use ndarray::Array3;

/// Sends `count` one-pixel images whose value is their number.
struct Counter {
    next: u8,
    count: u8,
}

/// Adds one to every pixel; skips the frame with value `bad`.
struct Increment {
    input: &'static str,
    output: &'static str,
    bad: Option<u8>,
}

fn pixel(value: u8) -> Frame {
    Frame::from_u8(Array3::from_elem((1, 1, 1), value)).expect("1 x 1 x 1 is a frame")
}

impl Node for Counter {
    fn inputs(&self) -> Vec<Topic> {
        Vec::new()
    }
    fn outputs(&self) -> Vec<Topic> {
        vec![Topic::new("a", MessageKind::Image)]
    }
    fn period(&self) -> Option<Duration> {
        Some(Duration::from_millis(30))
    }
    fn configure(&mut self, _: &Parameters) -> Result<(), Refusal> {
        Ok(())
    }
    fn step(&mut self, _: Cue, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if self.next == self.count {
            return Ok(Flow::Done);
        }
        let header = Header { stamp: Time::from_ns(u64::from(self.next) * 1000), frame_id: "camera".into() };
        cx.emit(0, Message::Image(Arc::new(StampedFrame { header, frame: pixel(self.next) })));
        self.next += 1;
        Ok(Flow::Continue)
    }
}

impl Node for Increment {
    fn inputs(&self) -> Vec<Topic> {
        vec![Topic::new(self.input, MessageKind::Image)]
    }
    fn outputs(&self) -> Vec<Topic> {
        vec![Topic::new(self.output, MessageKind::Image)]
    }
    fn configure(&mut self, _: &Parameters) -> Result<(), Refusal> {
        Ok(())
    }
    fn step(&mut self, cue: Cue, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let Cue::Message { message: Message::Image(image), .. } = cue else { return Ok(Flow::Continue) };
        let Frame::U8(pixels) = &image.frame else { return Err(StepError::Skip("not 8 bit".into())) };
        if self.bad == pixels.first().copied() {
            return Err(StepError::Skip("a bad frame".into()));
        }
        let frame = cx.stage("increment", || pixel(pixels[(0, 0, 0)] + 1));
        cx.emit(0, Message::Image(Arc::new(StampedFrame { header: image.header.clone(), frame })));
        Ok(Flow::Continue)
    }
}

fn place(name: &str) -> Place {
    Place::new(name, "/", &[]).expect("a valid name")
}

/// Common parameters with `wait_for` set.
fn waiting_for(nodes: &str) -> Parameters {
    Parameters::declare(CommonParameters::descriptors())
        .with_text(&[("wait_for", nodes), ("wait_timeout", "20")])
        .expect("valid")
}

fn counts(report: &NodeReport) -> (u64, u64, u64, u64) {
    let sum = |counts: &std::collections::BTreeMap<String, u64>| counts.values().sum();
    (sum(&report.received), sum(&report.published), sum(&report.dropped()), sum(&report.bad))
}

#[test]
fn a_composed_chain_drains_to_its_last_frame() {
    let member = |node: Box<dyn Node>, name, wait_for, on_exit| composed::Member {
        node,
        parameters: waiting_for(wait_for),
        place: place(name),
        on_exit,
    };
    let members = vec![
        member(Box::new(Counter { next: 0, count: 20 }), "counter", "[first]", composed::OnExit::Shutdown),
        member(
            Box::new(Increment { input: "a", output: "b", bad: Some(7) }),
            "first",
            "[second]",
            composed::OnExit::Continue,
        ),
        member(
            Box::new(Increment { input: "b", output: "c", bad: None }),
            "second",
            "",
            composed::OnExit::Continue,
        ),
    ];
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let reports = composed::run(members, &clock, &Stop::default()).expect("runs");
    assert_eq!(counts(&reports[0]), (0, 20, 0, 0));
    assert_eq!(counts(&reports[1]), (20, 19, 0, 1), "the bad frame is counted and skipped");
    assert_eq!(counts(&reports[2]), (19, 19, 0, 0));
    assert_eq!(reports[2].stages["increment"].values().sum::<u64>(), 19);
}

#[test]
fn lockstep_gives_the_same_messages_every_time() {
    let run = || {
        let timer = ManualClock::at(0);
        let mut chain = Lockstep::new(&timer, vec!["/c".into()]);
        chain.add(Box::new(Counter { next: 0, count: 3 }), &place("counter")).expect("names");
        chain
            .add(Box::new(Increment { input: "a", output: "b", bad: None }), &place("first"))
            .expect("names");
        chain
            .add(Box::new(Increment { input: "b", output: "c", bad: None }), &place("second"))
            .expect("names");
        let mut bytes = Vec::new();
        while let Some(out) = chain.tick(0, 5).expect("runs") {
            for (topic, message) in out {
                bytes.push((topic, message.encode().expect("encodes")));
            }
        }
        (bytes, chain.finish())
    };
    let (first, reports) = run();
    assert_eq!(first.len(), 3);
    assert_eq!(counts(&reports[2]), (3, 3, 0, 0));
    assert_eq!(run().0, first);
}

#[test]
fn a_node_that_waits_in_vain_says_for_whom() {
    let parameters = waiting_for("[nobody]").with_text(&[("wait_timeout", "0.05")]).expect("valid");
    let transport = LocalTransport::default();
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let node = Box::new(Counter { next: 0, count: 1 });
    let subject = Subject { node, parameters, place: place("counter"), saved: None };
    let error = live::run(subject, &transport, &clock, Stop::default()).expect_err("nobody is not there");
    assert!(error.to_string().contains("/nobody"), "{error}");
}

/// Three sessions without a router: they find each other, lose nothing and end.
#[test]
fn zenoh_carries_a_chain_between_sessions() {
    const DOMAIN: u32 = 201;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let stop = Stop::default();
    let session =
        || ZenohTransport::open(DOMAIN, Hashes::Rihs01, clock.clone()).expect("a session on loopback");
    let (one, two, three) = (session(), session(), session());
    let reports = std::thread::scope(|scope| {
        let run = |node: Box<dyn Node>, name, wait_for, transport| {
            let (clock, stop) = (clock.clone(), stop.clone());
            let transport: &dyn Transport = transport;
            let subject =
                Subject { node, parameters: waiting_for(wait_for), place: place(name), saved: None };
            scope.spawn(move || live::run(subject, transport, &clock, stop))
        };
        let last = run(Box::new(Increment { input: "b", output: "c", bad: None }), "second", "", &three);
        let middle =
            run(Box::new(Increment { input: "a", output: "b", bad: None }), "first", "[second]", &two);
        let source = run(Box::new(Counter { next: 0, count: 20 }), "counter", "[first, second]", &one);
        let source = source.join().expect("no panic").expect("runs");
        stop.ask(modulo_runtime::Urgency::Drain);
        [
            source,
            middle.join().expect("no panic").expect("runs"),
            last.join().expect("no panic").expect("runs"),
        ]
    });
    assert_eq!(reports.each_ref().map(counts), [(0, 20, 0, 0), (20, 20, 0, 0), (20, 20, 0, 0)]);
    assert!(one.graph().tokens().next().is_none() || !one.graph().has_node("/first"));
}
