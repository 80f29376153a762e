//! The three drivers run the same steps to the same results, and sessions that are opened at the same moment meet.

use std::io::Write;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Barrier, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_core::Frame;
use modulo_middleware::driver::live::{self, NodeSetup};
use modulo_middleware::driver::{CommonParameters, composed};
use modulo_middleware::transport::local::LocalTransport;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{
    Claim, Guard, Incoming, ParameterAnswer, ParameterPort, ParameterRequest, Publisher, Transport,
};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::{
    Address, Clock, Context, Flow, Job, ManualClock, Message, MessageKind, Node, NodeName, NodeReport,
    ParameterError, ParameterSet, Parameters, Part, PlannedInputs, StampedFrame, StepError, Stop,
    SystemClock, Topic, Trigger, Urgency, Value,
};
use ndarray::Array3;

use crate::harness::{Domain, wait_until};
use crate::offered::Offered;

/// Sends `count` one-pixel images whose value is their number.
struct Counter {
    next: u8,
    count: u8,
    /// The period after so many frames.
    period: fn(u8) -> Duration,
}

/// A counter at the pace of its readers.
fn counter(count: u8) -> Box<dyn Node> {
    Box::new(Counter { next: 0, count, period: |_| Duration::ZERO })
}

/// Adds one to every pixel; skips the frame with value `bad`.
struct Increment {
    input: &'static str,
    output: &'static str,
    bad: Option<u8>,
    delay: Duration,
}

fn increment(input: &'static str, output: &'static str) -> Increment {
    Increment { input, output, bad: None, delay: Duration::ZERO }
}

fn pixel(value: u8) -> Frame {
    Frame::from_u8(Array3::from_elem((1, 1, 1), value)).expect("1 x 1 x 1 is a frame")
}

/// The image topics of a node, which has no parameters of its own.
macro_rules! topics {
    ($node:ident: $inputs:expr => $outputs:expr) => {
        fn inputs(&$node) -> Vec<Topic> {
            $inputs.map(|name: &str| Topic::new(name, MessageKind::Image)).to_vec()
        }
        fn outputs(&$node) -> Vec<Topic> {
            $outputs.map(|name: &str| Topic::new(name, MessageKind::Image)).to_vec()
        }
        fn configure(&mut $node, _: &Parameters) -> Result<(), ParameterError> {
            Ok(())
        }
    };
}

impl Node for Counter {
    topics!(self: [] => ["a"]);
    fn period(&self) -> Option<Duration> {
        Some((self.period)(self.next))
    }
    fn step(&mut self, _: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if self.next == self.count {
            return Ok(Flow::Done);
        }
        let header = Header { stamp: Time::from_ns(u64::from(self.next) * 1000), frame_id: "camera".into() };
        cx.emit(0, image(header, self.next));
        self.next += 1;
        Ok(Flow::Continue)
    }
}

impl Node for Increment {
    topics!(self: [self.input] => [self.output]);
    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let Trigger::Message { message: Message::Image(image), .. } = trigger else {
            return Ok(Flow::Continue);
        };
        let pixels = image.frame.as_u8().ok_or_else(|| StepError::Skip("not 8 bit".into()))?;
        if self.bad == pixels.first().copied() {
            return Err(StepError::Skip("a bad frame".into()));
        }
        std::thread::sleep(self.delay);
        let frame = cx.stage("increment", || pixel(pixels[(0, 0, 0)] + 1));
        cx.emit(0, Message::Image(Arc::new(StampedFrame { header: image.header.clone(), frame })));
        Ok(Flow::Continue)
    }
}

fn node_name(name: &str) -> NodeName {
    NodeName::new(name, "/", &[]).expect("a valid name")
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

fn setup(node: Box<dyn Node>, name: &str, parameters: Parameters) -> NodeSetup {
    NodeSetup { node, parameters, node_name: node_name(name), saved: None, report_file: None }
}

fn clock() -> Arc<dyn Clock> {
    Arc::new(SystemClock::default())
}

fn member(node: Box<dyn Node>, name: &str, wait_for: &str, ends_all: bool) -> composed::Member {
    composed::Member { setup: setup(node, name, waiting_for(wait_for)), ends_all }
}

fn image(header: Header, value: u8) -> Message {
    Message::Image(Arc::new(StampedFrame { header, frame: pixel(value) }))
}

/// The value of the pixel that has arrived.
fn value_of(incoming: Incoming) -> u8 {
    let Incoming::Message(Message::Image(image)) = incoming else { panic!("no image: {incoming:?}") };
    image.frame.as_u8().expect("8 bit")[(0, 0, 0)]
}

/// Runs a source of `period` before a fast node, which skips a frame, and a slow one: each takes all that there is.
fn assert_no_frame_is_lost(period: fn(u8) -> Duration) {
    let slow = Increment { delay: Duration::from_millis(15), ..increment("b", "c") };
    let members = vec![
        member(Box::new(Counter { next: 0, count: 30, period }), "counter", "[first]", true),
        member(Box::new(Increment { bad: Some(7), ..increment("a", "b") }), "first", "[second]", false),
        member(Box::new(slow), "second", "", false),
    ];
    let reports = composed::run(members, &clock(), &Stop::default()).expect("runs");
    let expected = [(0, 30, 0, 0), (30, 29, 0, 1), (29, 29, 0, 0)];
    assert_eq!([0, 1, 2].map(|member| counts(&reports[member])), expected);
    assert_eq!(reports[2].stages["increment"].values().sum::<u64>(), 29);
}

/// A source of rate 0 waits for the slowest node, also behind one that is fast.
#[test]
fn a_paced_source_loses_no_frame_to_a_slow_reader() {
    assert_no_frame_is_lost(|_| Duration::ZERO);
}

#[test]
fn a_source_may_become_paced_while_it_runs() {
    // A frame that is not paced replaces the one before where a node is not scheduled for its whole period.
    assert_no_frame_is_lost(|sent| Duration::from_millis(if (1..29).contains(&sent) { 0 } else { 600 }));
}

/// A step that panics at its first frame.
struct Panic;

impl Node for Panic {
    topics!(self: ["a"] => []);
    fn step(&mut self, _: Trigger, _: &mut Context<'_>) -> Result<Flow, StepError> {
        panic!("an error in the step")
    }
}

#[test]
fn a_member_that_panics_ends_the_others() {
    // By itself the counter would go on for four minutes.
    let slow = Counter { next: 0, count: 255, period: |_| Duration::from_secs(1) };
    let members = vec![
        member(Box::new(slow), "counter", "[broken]", false),
        member(Box::new(Panic), "broken", "", false),
    ];
    let (sender, ended) = std::sync::mpsc::channel();
    // In a thread of its own, because a run that does not end must fail the test.
    std::thread::spawn(move || {
        let run = || composed::run(members, &clock(), &Stop::default()).map(|reports| reports.len());
        sender.send(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err())
    });
    assert_eq!(ended.recv_timeout(Duration::from_secs(60)), Ok(true), "the panic is passed on");
}

/// A node that was asked to end, and leaves because its source does not, has answered or counted every image it took.
#[test]
fn a_node_that_leaves_its_source_counts_every_image() {
    let (transport, test, stop) = (LocalTransport::default(), node_name("test"), Stop::default());
    let address = Address::resolve(&test, &Topic::new("a", MessageKind::Image)).expect("a name");
    let frames = transport.advertise(&test, &address).expect("local");
    let (asked, local) = (stop.clone(), transport.clone());
    let running = std::thread::spawn(move || {
        let setup = setup(Box::new(increment("a", "b")), "leaver", waiting_for(""));
        live::run(setup, &local, &clock(), asked).expect("runs")
    });
    let mut sent = 0;
    while !running.is_finished() {
        frames.put(&image(Header::default(), 0)).expect("local");
        sent += 1;
        if sent == 10 {
            stop.ask(Urgency::Drain);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let report = running.join().expect("no panic");
    let (received, published, dropped, bad) = counts(&report);
    assert!(received > 10, "it went on for a while: {received}");
    assert_eq!((published, dropped, bad), (received, 0, 0));
}

#[test]
fn lockstep_gives_the_same_messages_every_time() {
    let run = || {
        let timer = ManualClock::at(0);
        let mut chain = Lockstep::new(&timer, vec!["/c".into()]);
        chain.add(counter(3), &node_name("counter")).expect("names");
        chain.add(Box::new(increment("a", "b")), &node_name("first")).expect("names");
        chain.add(Box::new(increment("b", "c")), &node_name("second")).expect("names");
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
    let setup = setup(counter(1), "counter", parameters);
    let error = live::run(setup, &transport, &clock(), Stop::default()).expect_err("nobody is not there");
    assert!(error.to_string().contains("/nobody"), "{error}");
}

/// A running node, and a test that sends it images.
struct Stage {
    transport: Arc<Offered>,
    ports: Receiver<ParameterPort>,
    test: NodeName,
    stop: Stop,
    answers: Receiver<Incoming>,
    _answers: Guard,
}

impl Stage {
    /// A stage on which the test hears the images of `output`.
    fn new(output: &str) -> Self {
        let (transport, ports) = Offered::new();
        let (test, (sender, answers)) = (node_name("test"), channel());
        let take = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let address = Address::resolve(&test, &Topic::new(output, MessageKind::Image)).expect("a name");
        let _answers = transport.subscribe(&test, &address, take).expect("local");
        Self { transport, ports, test, stop: Stop::default(), answers, _answers }
    }

    fn advertise(&self, topic: &str) -> Box<dyn Publisher> {
        let address = Address::resolve(&self.test, &Topic::new(topic, MessageKind::Image)).expect("a name");
        self.transport.advertise(&self.test, &address).expect("local")
    }

    /// Starts a node. Not in a scope: a failure must not wait for the node.
    fn start<P: ParameterSet>(
        &self,
        node: Box<dyn Node>,
        name: &'static str,
    ) -> (JoinHandle<NodeReport>, ParameterPort) {
        let (offered, asked) = (self.transport.clone(), self.stop.clone());
        let declared = [P::descriptors(), CommonParameters::descriptors()].concat();
        let setup = setup(node, name, Parameters::declare(declared));
        let running = std::thread::spawn(move || live::run(setup, &*offered, &clock(), asked).expect("runs"));
        (running, self.ports.recv().expect("the node starts"))
    }
}

modulo_runtime::parameters! {
    /// The parameters of [`Add`].
    pub struct AddParameters {
        /// Summand.
        amount: u8 = 1 => 0..=255,
    }
}

/// Adds an amount to every pixel. Another amount takes as long to make as the test wants.
struct Add {
    amount: u8,
    makes: Arc<Mutex<Receiver<Result<u8, ParameterError>>>>,
}

impl Node for Add {
    topics!(self: ["a"] => ["b"]);
    fn prepare(&self, now: &Parameters, next: &Parameters) -> Option<Job> {
        let makes = self.makes.clone();
        let make = move || {
            Ok(Box::new(makes.lock().expect("not poisoned").recv().expect("the test sends it")?) as Part)
        };
        (now.get("amount") != next.get("amount")).then(|| Box::new(make) as Job)
    }
    fn exchange(&mut self, _: &Parameters, part: Part) -> Result<(), ParameterError> {
        self.amount = *part.downcast().expect("the part of this node");
        Ok(())
    }
    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if let Trigger::Message { message: Message::Image(image), .. } = trigger {
            let value = image.frame.as_u8().expect("8 bit")[(0, 0, 0)];
            cx.emit(0, self::image(image.header.clone(), value + self.amount));
        }
        Ok(Flow::Continue)
    }
}

/// Returns what a node loads, as its state says.
fn loading(state: Incoming) -> Option<String> {
    let Incoming::Message(Message::Diagnostics(array)) = state else { panic!("no state: {state:?}") };
    let value = array.status[0].values.iter().find(|value| value.key == "loading");
    value.map(|value| value.value.clone())
}

/// While a part is made, frames are answered with the part that the node has, and the parameter keeps its value. The new
/// one is exchanged or refused, also when the caller has gone meanwhile.
#[test]
fn a_part_is_made_while_the_node_goes_on() {
    let (stage, (make, makes)) = (Stage::new("b"), channel());
    let states = Arc::new(Mutex::new(Vec::new()));
    let expected = states.clone();
    let note = move |incoming: Incoming| expected.lock().expect("not poisoned").push(loading(incoming));
    let topic = Topic::new("/add/state", MessageKind::Diagnostics);
    let state = Address::resolve(&stage.test, &topic).expect("a name");
    let _states = stage.transport.subscribe(&stage.test, &state, Box::new(note)).expect("local");
    let frames = stage.advertise("a");
    let frame = || {
        frames.put(&image(Header::default(), 10)).expect("local");
        value_of(stage.answers.recv().expect("an answer")) - 10
    };
    let node = Box::new(Add { amount: 1, makes: Arc::new(Mutex::new(makes)) });
    let (running, port) = stage.start::<AddParameters>(node, "add");
    let ask = |amount| {
        let (answer, verdict) = channel();
        let (claim, changes) = (Claim::default(), vec![vec![("amount".to_owned(), Value::Integer(amount))]]);
        let request = ParameterRequest { changes, answer, claim: claim.clone() };
        assert!((port.request)(request));
        let answer = move || loop {
            match verdict.recv() {
                Ok(ParameterAnswer::Loading) => {}
                Ok(ParameterAnswer::Done(answers)) => {
                    break Ok(answers.into_iter().next().expect("an answer"));
                }
                Err(gone) => break Err(gone),
            }
        };
        (claim, answer)
    };
    let in_use = || (frame(), (port.read)().get("amount").cloned());
    let value = |amount: u8| (amount, Some(Value::Integer(amount.into())));

    assert_eq!(in_use(), value(1));
    let (_, verdict) = ask(5);
    assert_eq!(in_use(), value(1), "it is not made yet");
    let busy = ask(6).1().expect("answered").expect_err("one at a time").to_string();
    assert!(busy.contains("'amount' = 6") && busy.contains("still loading"), "{busy}");
    make.send(Ok(5)).expect("the job waits");
    assert_eq!((verdict(), in_use()), (Ok(Ok(())), value(5)));

    let refusal = ParameterError::new("amount", 7, "no");
    let (_, verdict) = ask(7);
    make.send(Err(refusal.clone())).expect("the job waits");
    assert_eq!((verdict(), in_use()), (Ok(Err(refusal)), value(5)));

    // A caller that has been told that the node loads does not take its request back by going.
    let (claim, verdict) = ask(9);
    wait_until("the node has begun to load", || claim.is_taken());
    drop(verdict);
    make.send(Ok(9)).expect("the job waits");
    wait_until("the part is in use", || in_use() == value(9));
    let mut states = states.lock().expect("not poisoned").clone();
    states.dedup();
    let loads = |amount: u8| Some(format!("amount = {amount}"));
    assert_eq!(states, [None, loads(5), None, loads(7), None, loads(9), None]);
    stage.stop.ask(Urgency::Now);
    running.join().expect("no panic");
}

modulo_runtime::parameters! {
    /// The parameters of [`Relay`].
    pub struct RelayParameters {
        /// The topics to read.
        inputs: Vec<String> = vec!["/left/a".into(), "/right/a".into()],
    }
}

/// Reads any number of topics, and sends the images on.
struct Relay(RelayParameters);

fn topics_of(parameters: &RelayParameters) -> Vec<Topic> {
    parameters.inputs.iter().map(|name| Topic::new(name, MessageKind::Image)).collect()
}

impl Node for Relay {
    fn inputs(&self) -> Vec<Topic> {
        topics_of(&self.0)
    }
    fn inputs_with(&self, next: &Parameters) -> Result<PlannedInputs, ParameterError> {
        Ok(PlannedInputs { first: topics_of(&next.into()), later: Vec::new() })
    }
    fn outputs(&self) -> Vec<Topic> {
        vec![Topic::new("out", MessageKind::Image)]
    }
    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.0 = parameters.into();
        Ok(())
    }
    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if let Trigger::Message { input, message: Message::Image(image) } = trigger {
            // The index tells under which of its inputs the node has seen the image.
            let value = image.frame.as_u8().expect("8 bit")[(0, 0, 0)] + input as u8;
            cx.emit(0, self::image(image.header.clone(), value));
        }
        Ok(Flow::Continue)
    }
}

/// A change of one input leaves the subscriptions of all others alone, whatever their order; an input that the node
/// publishes itself, or that is no name, is refused, and nothing is stored.
#[test]
fn inputs_are_found_by_their_address() {
    let stage = Stage::new("out");
    let topics = ["/left/a", "/right/a", "/left/b"];
    let publishers = topics.map(|topic| stage.advertise(topic));
    let sent = std::cell::Cell::new(0);
    let answer = |publisher: usize| {
        sent.set(sent.get() + 1);
        let header = Header { stamp: Time::from_ns(sent.get()), ..Header::default() };
        publishers[publisher].put(&image(header, 10)).expect("local");
        value_of(stage.answers.recv_timeout(Duration::from_secs(60)).expect("an answer")) - 10
    };
    let node = Box::new(Relay(RelayParameters::default()));
    let (running, port) = stage.start::<RelayParameters>(node, "relay");
    let set = |inputs: &[&str]| {
        let (answer, verdict) = channel();
        let value = Value::Strings(inputs.iter().map(|name| (*name).to_owned()).collect());
        let changes = vec![vec![("inputs".to_owned(), value)]];
        assert!((port.request)(ParameterRequest { changes, answer, claim: Claim::default() }));
        match verdict.recv_timeout(Duration::from_secs(60)).expect("an answer") {
            ParameterAnswer::Done(mut answers) => {
                answers.pop().expect("one change").map_err(|why| why.to_string())
            }
            ParameterAnswer::Loading => panic!("this node loads nothing"),
        }
    };
    assert_eq!([answer(0), answer(1)], [0, 1]);
    for (bad, why) in [("/out", "publishes /out itself"), ("a b", "'a b'")] {
        let expected = set(&["/right/a", bad]).expect_err(bad);
        assert!(expected.contains("'inputs' = ") && expected.contains(why), "{expected}");
    }
    assert_eq!([answer(0), answer(1)], [0, 1], "refused whole");
    assert_eq!((port.read)().get("inputs").map(ToString::to_string).as_deref(), Some("[/left/a, /right/a]"));

    // The same topics at other places are no change of any of them.
    set(&["/right/a", "/left/a"]).expect("possible");
    assert_eq!([answer(0), answer(1)], [1, 0]);
    set(&["/left/b", "/left/a", "/right/a"]).expect("possible");
    assert_eq!([answer(2), answer(0), answer(1)], [0, 1, 2]);
    set(&["/right/a"]).expect("possible");
    assert_eq!(answer(1), 0);
    stage.stop.ask(Urgency::Now);
    let report = running.join().expect("no panic");
    let received = topics.map(|topic| {
        (report.received.get(topic).copied().unwrap_or(0), report.unread.get(topic).copied().unwrap_or(0))
    });
    assert_eq!(received, [(4, 0), (5, 0), (1, 0)]);
}

/// Three sessions without a router: they find each other, lose nothing and end.
#[test]
fn zenoh_carries_a_chain_between_sessions() {
    let domain = Domain::take();
    let stop = Stop::default();
    let session = || ZenohTransport::open(domain.id, Hashes::Rihs01, clock()).expect("a session on loopback");
    let (one, two, three) = (session(), session(), session());
    let reports = std::thread::scope(|scope| {
        let run = |node: Box<dyn Node>, name, wait_for, transport| {
            let (setup, stop) = (setup(node, name, waiting_for(wait_for)), stop.clone());
            let transport: &dyn Transport = transport;
            scope.spawn(move || live::run(setup, transport, &clock(), stop).expect("runs"))
        };
        let last = run(Box::new(increment("b", "c")), "second", "", &three);
        let middle = run(Box::new(increment("a", "b")), "first", "[second]", &two);
        let source = run(counter(20), "counter", "[first, second]", &one);
        let source = source.join().expect("no panic");
        // The source has ended; the others have to finish what is still on its way to them.
        stop.ask(modulo_runtime::Urgency::Drain);
        [source, middle.join().expect("no panic"), last.join().expect("no panic")]
    });
    assert_eq!(reports.each_ref().map(counts), [(0, 20, 0, 0), (20, 20, 0, 0), (20, 20, 0, 0)]);
    for node in ["/counter", "/first", "/second"] {
        wait_until("a node that ended leaves the graph of the others", || {
            [&one, &two, &three].iter().all(|session| !session.graph().has_node(node))
        });
    }
}

#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().expect("no writer panics").write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Each first run printed "Unable to open listener ... Address already in use" with paths of zenoh's sources.
#[test]
fn sessions_meet_without_a_warning() {
    let lines = Lines::default();
    let writer = lines.clone();
    tracing_subscriber::fmt().with_max_level(tracing::Level::WARN).with_writer(move || writer.clone()).init();
    for _ in 0..5 {
        let domain = Domain::take();
        let start = Barrier::new(8);
        let open = || {
            start.wait();
            ZenohTransport::open(domain.id, Hashes::Rihs01, clock()).expect("a session")
        };
        std::thread::scope(|scope| {
            let sessions = [(); 8].map(|()| scope.spawn(open));
            sessions.map(|session| session.join().expect("no panic"))
        });
    }
    let text = String::from_utf8(lines.0.lock().expect("no writer panics").clone()).expect("text");
    assert!(!text.contains("in use"), "{text}");
}
