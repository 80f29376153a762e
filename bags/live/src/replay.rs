//! Replaying a bag into a running graph: each payload is sent as it was recorded when it is due.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use modulo_middleware::driver::pacing::{Pacing, ack_topic};
use modulo_middleware::graph::qos_overrides;
use modulo_middleware::parameter::events::ParameterEvents;
use modulo_middleware::transport::queue::{Keep, Limit, Queue, Queued};
use modulo_middleware::transport::zenoh::{RawPublisher, RawService, ZenohTransport};
use modulo_middleware::transport::{
    Guard, Incoming, ParameterAnswer, ParameterPort, ParameterRequest, Publisher as _, Transport,
    TransportError,
};
use modulo_msgs::builtin_interfaces::Time;
use modulo_msgs::cdr::CdrError;
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::{Interface, cdr, rosgraph_msgs, sensor_msgs};
use modulo_runtime::clock::nanos;
use modulo_runtime::report::hex;
use modulo_runtime::wire::keys::{self, Endpoint, Hashes};
use modulo_runtime::{
    Address, Allowed, Clock, Descriptor, Message, MessageKind, NodeName, NodeReport, Parameters, Qos, Stop,
    Topic, Urgency, Value, sensor_info,
};

use crate::LiveError;
use crate::control::{PlayerAction, PlayerCommand, PlayerReply, Service};
use crate::play::{PlaybackClock, Player};
use crate::remap::TopicRemaps;
use modulo_bags::bag::{BagError, BagTopic, RawMessage, TopicCount, qos};

/// The name of the node in ROS 2, too.
const NODE: &str = "rosbag2_player";
/// Interval at which the graph is looked at while a node in it is awaited.
const GLANCE: Duration = Duration::from_millis(20);
/// The topic on which the replay tells where it is, and how often a second. A hidden one is not recorded.
const STATUS: &str = "/_modulo/replay";
const STATUS_HZ: f64 = 2.0;
/// Commands that wait for the replay; each caller waits for its answer.
const COMMANDS: usize = 64;

/// Something that the replay has to deal with between two messages.
enum PlayerEvent {
    /// A call of one of its services.
    Command(PlayerCommand),
    /// A reader has acknowledged a frame.
    Ack(Incoming),
}

impl Queued for PlayerEvent {}

/// Options of a replay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReplayOptions {
    /// The new names of topics.
    pub remaps: TopicRemaps,
    /// The bag's time on `/clock`, so many times a second; finite and above 0.
    pub clock_hz: Option<f64>,
}

/// The messages of a replay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replayed {
    /// Number of messages that were sent, by topic and global id of the publisher.
    pub sent: BTreeMap<String, BTreeMap<String, u64>>,
    /// Topics with messages that no reader gets: ROS 2 allows not their name or type, or their type has no hash.
    pub unheard: Vec<String>,
}

/// Sends every message of `player` when it is due by `pace`. At rate 0 each image waits for the readers of the last one.
///
/// # Errors
/// [`LiveError`] when the bag cannot be read on or the wire does not take it.
pub fn replay(
    transport: &ZenohTransport,
    clock: &Arc<dyn Clock>,
    player: &mut Player,
    pace: PlaybackClock,
    options: &ReplayOptions,
    stop: &Stop,
) -> Result<Replayed, LiveError> {
    let node_name = NodeName { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() };
    let node = PlayerNode { transport, name: node_name, remaps: &options.remaps };
    let time = options.clock_hz.map(|hz| node.regular("/clock", rosgraph_msgs::Clock::NAME, Qos::Clock, hz));
    let time = time.transpose()?;
    let status = Qos::usual(MessageKind::Diagnostics);
    let status = node.regular(STATUS, DiagnosticArray::NAME, status, STATUS_HZ)?;
    let mut unheard = Vec::new();
    let publishers = node.publishers(player, time.as_ref(), &mut unheard)?;
    let events = Arc::new(Queue::new(clock.clone(), Limit { messages: COMMANDS, bytes: usize::MAX }));
    stop.wakes(&events);
    // Services come before the announcement: a node that others see must answer them.
    let _services = (node.serve(&events)?, node.serve_parameters(&**clock)?);
    let _announced = transport.announce(&node.name)?;
    let clock = &**clock;
    wait_for_readers(&publishers, clock, stop);
    let _acks = (pace.rate() == 0.0).then(|| node.listen_to_readers(&events)).transpose()?;
    let (pacing, ahead, stopped) = (Pacing::default(), None, false);
    let mut replay =
        Replay { transport, clock, player, pace, pacing, ahead, publishers, time, status, events, stopped };
    // The timeline starts here, so that the wait for readers is no part of it.
    replay.pace.jump(clock.ticks_ns(), 0);
    let done = replay.run(stop);
    // The last messages must have left before the publishers go.
    thread::sleep(transport.settling());
    replay.events.end();
    done.map(|()| Replayed { sent: replay.publishers.sent(), unheard })
}

/// Waits for half a second at most, so that readers that are there already get the first message: after the announcement, because tools wait
/// for the node before they subscribe.
fn wait_for_readers(publishers: &Publishers, clock: &dyn Clock, stop: &Stop) {
    let latest = clock.ticks_ns() + 500_000_000;
    while !publishers.wanted() && clock.ticks_ns() < latest && stop.urgency() == Urgency::None {
        thread::sleep(GLANCE);
    }
}

/// The node of a replay, as the graph sees it.
struct PlayerNode<'a> {
    transport: &'a ZenohTransport,
    name: NodeName,
    remaps: &'a TopicRemaps,
}

impl PlayerNode<'_> {
    /// Returns the services of the node, and where their calls arrive.
    fn serve(&self, events: &Arc<Queue<PlayerEvent>>) -> Result<Guard, TransportError> {
        let lane = events.open(Keep::All);
        let services = Service::ALL.iter().map(|service| {
            let events = events.clone();
            let give = move |command| events.push(lane, PlayerEvent::Command(command)).is_none();
            RawService::new(service.name_and_type(), keys::SERVICE_QOS, move |request| {
                service.call(request, &give)
            })
        });
        self.transport.serve_raw(&self.name, services.collect())
    }

    /// Subscribes to what the readers have taken, and waits until they have found out about it.
    fn listen_to_readers(&self, events: &Arc<Queue<PlayerEvent>>) -> Result<Guard, TransportError> {
        let (events, lane) = (events.clone(), events.open(Keep::Last(COMMANDS)));
        let deliver = Box::new(move |incoming| drop(events.push(lane, PlayerEvent::Ack(incoming))));
        let address = Address::resolve(&self.name, &ack_topic())
            .map_err(|why| TransportError::new("subscription to the readers", why))?;
        let acks = self.transport.subscribe(&self.name, &address, deliver)?;
        thread::sleep(self.transport.settling());
        Ok(acks)
    }

    /// Offers the parameters that the player of ROS 2 Jazzy has. All of them are fixed: the player makes the time of the bag.
    fn serve_parameters(&self, clock: &dyn Clock) -> Result<(Guard, ParameterEvents), TransportError> {
        let own = [
            ("start_type_description_service", true, "Serves ~/get_type_description."),
            ("use_sim_time", false, "Takes stamps from the topic /clock."),
        ];
        let own = own.map(|(name, default, description)| {
            let (default, allowed) = (Value::Bool(default), Allowed::Any);
            Descriptor { name, default, allowed, read_only: true, description }
        });
        let mut declared =
            qos_overrides(&self.name, &[Topic::new("/parameter_events", MessageKind::ParameterEvent)])
                .map_err(|why| TransportError::new("parameters of the player", why))?;
        declared.extend(own);
        let parameters = Parameters::declare(declared);
        let events = ParameterEvents::new(&self.name, self.transport)
            .map_err(|why| TransportError::new("publisher of /parameter_events", why))?;
        events.started(clock.now_ns(), &parameters);
        let read = parameters.clone();
        let request = move |request: ParameterRequest| {
            // Fails only when the caller has gone.
            let answers = request.changes.iter().map(|values| parameters.with(values, true).map(drop));
            let _ = request.answer.send(ParameterAnswer::Done(answers.collect()));
            true
        };
        let port = ParameterPort { read: Box::new(move || read.clone()), request: Box::new(request) };
        Ok((self.transport.serve_parameters(&self.name, port)?, events))
    }

    /// Declares all topics of `player` except that of `time`. Those that no reader gets are added to `unheard`.
    fn publishers(
        &self,
        player: &Player,
        time: Option<&RegularPublisher>,
        unheard: &mut Vec<String>,
    ) -> Result<Publishers, TransportError> {
        // Every topic is declared before the first message, so that readers find them all in time.
        let mut publishers = Vec::new();
        for TopicCount { topic, messages } in player.topics() {
            let offered = endpoint(&topic, self.remaps);
            let fault = fault(&topic, &offered, self.transport.hashes());
            if let Some(fault) = fault.filter(|_| messages > 0) {
                tracing::warn!("{fault}");
                unheard.push(topic.name.clone());
            }
            let Ok(endpoint) = offered else { continue };
            if time.is_some_and(|time| time.name == endpoint.topic) {
                tracing::warn!("{} of the bag is left out: --clock publishes it", endpoint.topic);
                continue;
            }
            let publisher = self.transport.advertise_raw(&self.name, &endpoint)?;
            publishers.push(TopicPublisher { topic, name: endpoint.topic, publisher });
        }
        Ok(Publishers(publishers))
    }

    /// Declares a topic that is published `hz` times a second.
    fn regular(
        &self,
        name: &str,
        type_name: &str,
        qos: Qos,
        hz: f64,
    ) -> Result<RegularPublisher, TransportError> {
        let endpoint = endpoint(&BagTopic::new(name, type_name, qos), self.remaps)
            .map_err(|why| TransportError::new(format!("publisher of {name}"), why))?;
        let publisher = self.transport.advertise_raw(&self.name, &endpoint)?;
        Ok(RegularPublisher { name: endpoint.topic, publisher, every: (1e9 / hz) as u64, next: 0 })
    }
}

/// Returns the account of a replay for the summary of a launch; its frames are the images on the topic with the most.
pub fn report(
    sent: &BTreeMap<String, BTreeMap<String, u64>>,
    player: &Player,
    options: &ReplayOptions,
) -> NodeReport {
    let mut report = NodeReport::new(format!("/{NODE}"));
    let mut frames = 0;
    for topic in player.topics().into_iter().map(|counted| counted.topic) {
        // The messages were sent by the names in the graph.
        let Ok(name) = options.remaps.resolve(&topic.name) else { continue };
        let Some(count) = sent.get(&name).map(|sent| sent.values().sum()) else { continue };
        if matches!(topic.type_name.as_str(), "sensor_msgs/msg/Image" | "sensor_msgs/msg/CompressedImage") {
            frames = frames.max(count);
        }
        report.published.insert(name, count);
    }
    let status = [("role", "source".to_owned()), ("frames", frames.to_string())];
    report.status.extend(status.map(|(key, value)| (key.to_owned(), value)));
    report.sent = sent.clone();
    report
}

struct Replay<'a> {
    transport: &'a ZenohTransport,
    clock: &'a dyn Clock,
    player: &'a mut Player,
    pace: PlaybackClock,
    /// The readers of the last frame, which are waited for at rate 0.
    pacing: Pacing,
    /// The next message behind its position.
    ahead: Option<(u64, RawMessage)>,
    publishers: Publishers,
    time: Option<RegularPublisher>,
    status: RegularPublisher,
    events: Arc<Queue<PlayerEvent>>,
    /// Whether a caller has asked for the end.
    stopped: bool,
}

impl Replay<'_> {
    fn run(&mut self, stop: &Stop) -> Result<(), LiveError> {
        while !self.stopped && stop.urgency() == Urgency::None && self.look_ahead()? {
            let now = self.clock.ticks_ns();
            self.tell_time(now)?;
            // At most one message a turn, so that a replay that is late still serves its callers.
            if self.ticks_until_due(now) == Some(0) && !self.waits_for_readers() {
                self.send_next(now)?;
            }
            match self.events.take(self.patience()).map(|arrived| arrived.item) {
                Some(PlayerEvent::Command(command)) => {
                    let answer = self.carry_out(command.action, stop)?;
                    // Fails only when the caller has gone.
                    let _ = command.answer.send(answer);
                }
                Some(PlayerEvent::Ack(incoming)) => {
                    if let Ok(Message::Diagnostics(ack)) = incoming.open(MessageKind::Diagnostics) {
                        self.pacing.note(&ack);
                    }
                }
                None => {}
            }
        }
        Ok(())
    }

    /// Publishes the time of the bag where that is due: on `/clock`, if that was asked for, and in a status, with which a viewer draws where
    /// the replay is.
    fn tell_time(&mut self, now: u64) -> Result<(), TransportError> {
        let log_time = self.player.log_time(self.pace.position(now));
        if let Some(time) = &mut self.time {
            time.publish(now, || cdr::to_vec(&rosgraph_msgs::Clock { clock: Time::from_ns(log_time) }))?;
        }
        let (start, end) = self.player.window;
        let seconds = |ns: u64| Duration::from_nanos(ns).as_secs_f64().to_string();
        let times = [("start_s", start), ("position_s", log_time - start), ("duration_s", end - start)];
        self.status.publish(now, || {
            let topics = ("topics", self.publishers.0.len().to_string());
            let values = times.map(|(key, ns)| (key, seconds(ns))).into_iter().chain([topics]);
            let values = values.map(|(key, value)| KeyValue { key: key.into(), value }).collect();
            let status = DiagnosticStatus { name: NODE.into(), values, ..DiagnosticStatus::default() };
            cdr::to_vec(&DiagnosticArray::of(Time::from_ns(self.clock.now_ns()), status))
        })
    }

    fn look_ahead(&mut self) -> Result<bool, BagError> {
        if self.ahead.is_none() {
            self.ahead = self.player.next_message().transpose()?;
        }
        Ok(self.ahead.is_some())
    }

    /// Returns whether the next message is the image of a frame that comes too early for the readers of the last one.
    fn waits_for_readers(&mut self) -> bool {
        let next = self.ahead.as_ref().filter(|_| self.pace.rate() == 0.0);
        let Some((_, message)) = next else { return false };
        let Some(stamp) = image_stamp(message) else { return false };
        let Some(to) = self.publishers.of(message) else { return false };
        if self.pacing.adds(stamp, &to.name) {
            return false;
        }
        let holds = self.pacing.holds(self.transport, self.clock);
        if !holds {
            self.pacing.sent(stamp, [to.name.clone()]);
        }
        holds
    }

    /// Returns the ticks until the next message is due; `None` while paused, and at the end.
    fn ticks_until_due(&self, now: u64) -> Option<u64> {
        let (due, _) = self.ahead.as_ref()?;
        Some(self.pace.ticks_of(*due)?.saturating_sub(now))
    }

    /// Returns the time until something is due; `None` while only an order can change anything.
    fn patience(&self) -> Option<Duration> {
        if self.ahead.is_none() {
            // The next message is not read yet.
            return Some(Duration::ZERO);
        }
        let now = self.clock.ticks_ns();
        let regular = self.time.iter().chain([&self.status]);
        let regular = regular.map(|publisher| publisher.next.saturating_sub(now)).min();
        // At rate 0 a message that has not been sent waits for readers, one of which may leave the graph.
        let waits = self.pace.rate() == 0.0;
        let due = self.ticks_until_due(now).map(|ticks| if waits { nanos(GLANCE) } else { ticks });
        [due, regular].into_iter().flatten().min().map(Duration::from_nanos)
    }

    /// Sends the next message. Where no time passes by itself, its position is the new one.
    fn send_next(&mut self, now: u64) -> Result<(), TransportError> {
        let Some((due, message)) = self.ahead.take() else { return Ok(()) };
        self.publishers.send(message)?;
        if self.pace.rate() == 0.0 || self.pace.is_paused() {
            self.pace.jump(now, due);
        }
        Ok(())
    }

    fn carry_out(&mut self, action: PlayerAction, stop: &Stop) -> Result<PlayerReply, LiveError> {
        let now = self.clock.ticks_ns();
        let (mut done, mut played) = (true, 0);
        match action {
            PlayerAction::Tell => {}
            PlayerAction::Stop => self.stopped = true,
            PlayerAction::Pause(pause) => self.pace.set_paused(now, pause.unwrap_or(!self.pace.is_paused())),
            // An impossible rate is refused in the response, and the replay goes on.
            // So is 0, as in rosbag2: readers tell what they have taken only to a replay that began at that rate.
            PlayerAction::SetRate(rate) => done = rate > 0.0 && self.pace.set_rate(now, rate).is_ok(),
            PlayerAction::Step(number) => {
                played = self.step(now, number.unwrap_or(u64::MAX), stop)?;
                done = played > 0;
            }
            PlayerAction::Seek(log_time) => match self.player.seek(log_time) {
                None => done = false,
                Some(position) => {
                    // The message that was read ahead belongs to the old position.
                    self.ahead = None;
                    self.pace.jump(now, position);
                }
            },
        }
        Ok(PlayerReply { done, played, is_paused: self.pace.is_paused(), rate: self.pace.rate() })
    }

    /// Plays up to `number` messages at once, if the replay is paused and until it is stopped; how many.
    fn step(&mut self, now: u64, number: u64, stop: &Stop) -> Result<u64, LiveError> {
        if !self.pace.is_paused() {
            return Ok(0);
        }
        let mut played = 0;
        while played < number && stop.urgency() == Urgency::None && self.look_ahead()? {
            self.send_next(now)?;
            played += 1;
        }
        Ok(played)
    }
}

/// Returns the stamp of an image, raw or compressed, which stands at the start of its payload; `None` for other messages.
fn image_stamp(message: &RawMessage) -> Option<Time> {
    let image =
        [sensor_msgs::Image::NAME, sensor_msgs::CompressedImage::NAME].contains(&&*message.topic.type_name);
    // A payload that is too short is sent as it is, as any other.
    image.then(|| cdr::from_slice(&message.data).ok()).flatten()
}

/// The publishers of the topics of a bag. A topic that the bag has with two types gets two of them.
struct Publishers(Vec<TopicPublisher>);

struct TopicPublisher {
    topic: Arc<BagTopic>,
    /// Name of the topic in the graph.
    name: String,
    publisher: RawPublisher,
}

impl Publishers {
    fn wanted(&self) -> bool {
        self.0.iter().any(|topic| topic.publisher.wanted())
    }

    /// Returns the publisher of the topic and type of `message`; `None` for a topic that is left out, as /clock by --clock.
    fn of(&mut self, message: &RawMessage) -> Option<&mut TopicPublisher> {
        let BagTopic { name, type_name, .. } = &*message.topic;
        self.0.iter_mut().find(|to| to.topic.name == *name && to.topic.type_name == *type_name)
    }

    fn send(&mut self, message: RawMessage) -> Result<(), TransportError> {
        let Some(topic) = self.of(&message) else { return Ok(()) };
        topic.publisher.put(message.data)
    }

    /// Returns the number of messages that were sent, by topic and publisher. Publishers without messages are left out.
    fn sent(&self) -> BTreeMap<String, BTreeMap<String, u64>> {
        let mut sent: BTreeMap<String, BTreeMap<String, u64>> = BTreeMap::new();
        for topic in &self.0 {
            let (publisher, count) = topic.publisher.sent();
            if count > 0 {
                sent.entry(topic.name.clone()).or_default().insert(hex(&publisher), count);
            }
        }
        sent
    }
}

/// A publisher of messages that the replay makes itself, at regular times.
struct RegularPublisher {
    name: String,
    publisher: RawPublisher,
    /// Ticks between two messages, ns.
    every: u64,
    /// When the next one is due, in ticks.
    next: u64,
}

impl RegularPublisher {
    /// Publishes a message if one is due at the ticks `now`.
    fn publish(
        &mut self,
        now: u64,
        message: impl FnOnce() -> Result<Vec<u8>, CdrError>,
    ) -> Result<(), TransportError> {
        if now < self.next {
            return Ok(());
        }
        // A late message is not made up for.
        self.next = self.next.saturating_add(self.every).max(now);
        let payload = message().map_err(|why| TransportError::new("time of the bag", why))?;
        self.publisher.put(payload)
    }
}

/// Returns why no reader gets `topic`; `None` where one can.
fn fault(topic: &BagTopic, offered: &Result<Endpoint, String>, hashes: Hashes) -> Option<String> {
    let BagTopic { name, type_name, .. } = topic;
    match offered {
        Err(why) => Some(format!("topic '{name}' is left out: {why}")),
        Ok(endpoint) if endpoint.type_hash == keys::NO_HASH && hashes == Hashes::Rihs01 => Some(format!(
            "topic '{name}' is found only by readers without type hashes: neither the bag nor the suite defines \
             {type_name}, and MODULO_TYPE_HASH=none plays without hashes"
        )),
        Ok(_) => None,
    }
}

/// Returns the endpoint of `topic`, or why ROS 2 does not allow it.
fn endpoint(topic: &BagTopic, remaps: &TopicRemaps) -> Result<Endpoint, String> {
    let name = &topic.name;
    let remedy =
        |why| format!("{why}; --remap '{name}:=/NAME' plays it as /NAME, --topics plays others only");
    let is_status = topic.type_name == MessageKind::Diagnostics.type_name();
    let latched = is_status && sensor_info::is_topic(name);
    let is_word = |word: &str| NodeName::new(word, "/", &[]).is_ok();
    if topic.type_name.split('/').count() != 3 || !topic.type_name.split('/').all(is_word) {
        let type_name = &topic.type_name;
        return Err(format!("its type '{type_name}' is none of ROS 2, such as sensor_msgs/msg/Image"));
    }
    // A token needs some text in place of the hash, and rmw_zenoh has one for this.
    let type_hash = if topic.type_hash.is_empty() { keys::NO_HASH } else { &topic.type_hash };
    Ok(Endpoint {
        topic: remaps.resolve(name).map_err(remedy)?,
        dds_type: modulo_msgs::dds_name(&topic.type_name),
        type_hash: type_hash.to_owned(),
        qos: keys::qos_string(if latched { Qos::Latched } else { qos::parse(&topic.qos) }).to_owned(),
    })
}
