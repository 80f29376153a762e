//! The connection of one browser: its subscriptions, the images that are sent, and the requests that are carried out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{Message as Frame, WebSocket};
use modulo_core::Samples;
use modulo_images::FileFormat;
use modulo_msgs::builtin::Time;
use modulo_msgs::rosbag2_interfaces as player;
use modulo_msgs::{cdr, ros_name};
use modulo_runtime::parameter::client::{ClientError, ParameterClient};
use modulo_runtime::transport::keys::{Endpoint, EntityKind, Token};
use modulo_runtime::transport::{Guard, RawSample, TransportError};
use modulo_runtime::{Message, MessageKind, StampedFrame};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::sync::{Notify, mpsc};
use tokio::task::spawn_blocking;

use crate::protocol::{
    BoxView, DetectorView, Event, GraphView, ImageHeader, PageRequest, ParameterView, PlayerCall, StatusView,
    image_message,
};
use crate::server::Viewer;
use crate::streams::{NextImage, Streams};

/// Interval at which the graph and the statuses are sent if they have changed.
const LOOK: Duration = Duration::from_millis(500);
/// Requests of a browser that wait for the services of nodes.
const REQUESTS: usize = 32;
/// Names of statuses that are kept; a publisher may invent more.
const STATUSES: usize = 256;
/// Name of the player of ROS 2, and of the suite.
const PLAYER: &str = "/rosbag2_player";
/// Time limit for its answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// The messages of the graph that wait for the connection; the callbacks of the transport fill it.
#[derive(Default)]
struct Inbox {
    streams: Streams,
    statuses: BTreeMap<String, StatusView>,
    statuses_changed: bool,
}

/// Serves one browser until it goes.
pub(crate) async fn serve(viewer: Arc<Viewer>, mut socket: WebSocket) {
    let client = Arc::new(Client { viewer, inbox: Mutex::default(), news: Notify::new() });
    let (requests, waiting) = mpsc::channel(REQUESTS);
    let (answers, mut answered) = mpsc::channel(REQUESTS);
    let caller = client.clone();
    // Nodes answer between two frames: one thread waits for them, so that images go on meanwhile.
    spawn_blocking(move || caller.carry_out(waiting, &answers));
    let mut look = tokio::time::interval(LOOK);
    let (mut guards, mut graph) = (BTreeMap::new(), GraphView::default());
    loop {
        let sent = tokio::select! {
            frame = socket.recv() => match frame {
                Some(Ok(Frame::Text(text))) => client.take(&text, &requests, &mut socket).await,
                Some(Ok(Frame::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => Ok(()),
            },
            Some(event) = answered.recv() => send(&mut socket, &event).await,
            () = client.news.notified() => Ok(()),
            _ = look.tick() => {
                let looking = client.clone();
                let looked = spawn_blocking(move || { let seen = looking.look(&mut guards); (guards, seen) }).await;
                let (kept, (seen, errors)) = looked.expect("a look at the graph does not panic");
                guards = kept;
                client.report(&mut graph, seen, errors, &mut socket).await
            }
        };
        if sent.is_err() || client.send_images(&graph.detectors, &mut socket).await.is_err() {
            return;
        }
    }
}

async fn send(socket: &mut WebSocket, event: &Event) -> Result<(), axum::Error> {
    let text = serde_json::to_string(event).expect("strings and numbers are JSON");
    socket.send(Frame::Text(text.into())).await
}

struct Client {
    viewer: Arc<Viewer>,
    inbox: Mutex<Inbox>,
    news: Notify,
}

impl Client {
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a message of the page. What needs a node waits in `requests`.
    async fn take(
        &self,
        text: &str,
        requests: &mpsc::Sender<PageRequest>,
        socket: &mut WebSocket,
    ) -> Result<(), axum::Error> {
        let request = match serde_json::from_str(text) {
            Ok(request) => request,
            Err(why) => return send(socket, &Event::Error(format!("unreadable request: {why}"))).await,
        };
        match request {
            PageRequest::Watch(topics) => self.inbox().streams.watch(&topics),
            PageRequest::Drawn(topic) => self.inbox().streams.drawn(&topic),
            PageRequest::Pixel { u, v } => {
                let samples = self.inbox().streams.pixel(u, v);
                return send(socket, &Event::Pixel { u, v, samples }).await;
            }
            other => {
                if requests.try_send(other).is_err() {
                    let why = "too many requests wait for their nodes; this one was left out, try again";
                    return send(socket, &Event::Error(why.to_owned())).await;
                }
            }
        }
        Ok(())
    }

    /// Looks at the graph, and subscribes to what the browser is shown. Returns the graph and what failed.
    fn look(self: &Arc<Self>, guards: &mut BTreeMap<String, Guard>) -> (GraphView, Vec<String>) {
        let tokens: Vec<Token> = self.viewer.transport.graph().tokens().cloned().collect();
        let graph = view(&tokens, &self.viewer.node_name.fully_qualified());
        let watched: BTreeSet<String> = self.inbox().streams.watched().cloned().collect();
        let detectors =
            graph.detectors.iter().filter(|d| d.inputs.iter().any(|input| watched.contains(input)));
        let boxes: BTreeSet<String> = detectors.map(|detector| detector.topic.clone()).collect();
        let statuses = ["/diagnostics", "/sensor_info"].map(str::to_owned);
        let wanted: BTreeSet<String> = watched.iter().cloned().chain(boxes).chain(statuses).collect();
        guards.retain(|topic, _| wanted.contains(topic));
        let mut errors = Vec::new();
        for topic in wanted {
            let publisher = tokens.iter().filter(|token| token.kind == EntityKind::Publisher);
            let endpoint = publisher.filter_map(|token| token.endpoint.as_ref()).find(|e| e.topic == topic);
            // A topic without a publisher has no type yet; it is looked at again.
            let (Some(endpoint), false) = (endpoint, guards.contains_key(&topic)) else { continue };
            match self.subscribe(endpoint) {
                Ok(guard) => drop(guards.insert(topic, guard)),
                Err(why) => errors.push(why.to_string()),
            }
        }
        (graph, errors)
    }

    fn subscribe(self: &Arc<Self>, endpoint: &Endpoint) -> Result<Guard, TransportError> {
        let client = Arc::downgrade(self);
        let (topic, type_name) = (endpoint.topic.clone(), ros_name(&endpoint.dds_type));
        let take = move |sample: RawSample| {
            let Some(client) = client.upgrade() else { return };
            client.hear(&topic, &type_name, sample);
            client.news.notify_one();
        };
        self.viewer.transport.subscribe_raw(&self.viewer.node_name, endpoint, take)
    }

    /// Takes a message of the graph. One that cannot be read is left out: its reader in the suite counts it.
    fn hear(&self, topic: &str, type_name: &str, sample: RawSample) {
        match MessageKind::from_type_name(type_name) {
            Some(MessageKind::Image) => {
                self.inbox().streams.image(topic, sample.payload, self.viewer.clock.ticks_ns())
            }
            Some(kind @ (MessageKind::Detections | MessageKind::Diagnostics)) => {
                match Message::decode(kind, &sample.payload) {
                    Ok(Message::Detections(boxes)) => {
                        let now = self.viewer.clock.ticks_ns();
                        self.inbox().streams.boxes(topic, boxes, now);
                    }
                    Ok(Message::Diagnostics(array)) => self.inbox().note(&array.status),
                    _ => {}
                }
            }
            _ => {}
        }
    }

    /// Sends the graph and the statuses if they have changed.
    async fn report(
        &self,
        graph: &mut GraphView,
        seen: GraphView,
        errors: Vec<String>,
        socket: &mut WebSocket,
    ) -> Result<(), axum::Error> {
        if *graph != seen {
            *graph = seen;
            send(socket, &Event::Graph(graph.clone())).await?;
        }
        let statuses = {
            let mut inbox = self.inbox();
            std::mem::take(&mut inbox.statuses_changed).then(|| inbox.statuses.values().cloned().collect())
        };
        if let Some(statuses) = statuses {
            send(socket, &Event::Status(statuses)).await?;
        }
        for why in errors {
            send(socket, &Event::Error(why)).await?;
        }
        Ok(())
    }

    /// Sends the images that are due.
    async fn send_images(
        self: &Arc<Self>,
        detectors: &[DetectorView],
        socket: &mut WebSocket,
    ) -> Result<(), axum::Error> {
        loop {
            let now = self.viewer.clock.ticks_ns();
            // The lock ends with the line, before the next wait.
            let next = self.inbox().streams.next(detectors, now);
            let Some(next) = next else { return Ok(()) };
            let topic = next.topic.clone();
            match spawn_blocking(move || encode(&next)).await.expect("encoding does not panic") {
                Ok((image, bytes)) => {
                    self.inbox().streams.sent(&topic, image);
                    socket.send(Frame::Binary(Bytes::from(bytes))).await?;
                }
                Err(why) => {
                    self.inbox().streams.drawn(&topic);
                    send(socket, &Event::Error(format!("{topic}: {why}"))).await?;
                }
            }
        }
    }

    /// Carries out requests one after the other, until the browser goes.
    fn carry_out(&self, mut waiting: mpsc::Receiver<PageRequest>, answers: &mpsc::Sender<Event>) {
        while let Some(request) = waiting.blocking_recv() {
            let event = self.answer(request).unwrap_or_else(|why| Event::Error(why.to_string()));
            // Nobody waits for the answer once the browser has gone.
            if answers.blocking_send(event).is_err() {
                return;
            }
        }
    }

    fn answer(&self, request: PageRequest) -> Result<Event, ClientError> {
        let transport = &self.viewer.transport;
        Ok(match request {
            PageRequest::Parameters(node) => {
                let client = ParameterClient::new(transport, &node);
                let names = client.names()?;
                let (values, descriptors) = (client.values(&names)?, client.descriptors(&names)?);
                let views = descriptors.iter().zip(&values).map(|(d, value)| ParameterView::new(d, value));
                let mut parameters: Vec<_> = views.collect();
                parameters.sort_by(|a, b| a.name.cmp(&b.name));
                Event::Parameters { node, parameters }
            }
            PageRequest::Set { node, name, value } => {
                let set = ParameterClient::new(transport, &node).set(&name, &value);
                Event::Set { node, name, error: set.err().map(|why| why.to_string()) }
            }
            PageRequest::Player(call) => self.play(call)?,
            PageRequest::Watch(_) | PageRequest::Drawn(_) | PageRequest::Pixel { .. } => {
                unreachable!("requests without a node are answered at once")
            }
        })
    }

    /// Calls the player of a bag, and returns its state after that.
    fn play(&self, call: PlayerCall) -> Result<Event, ClientError> {
        match call {
            PlayerCall::State => {}
            PlayerCall::Toggle => {
                let _: player::TogglePausedResponse =
                    self.call_player("TogglePaused", "toggle_paused", &player::TogglePausedRequest)?;
            }
            PlayerCall::Next => {
                let _: player::PlayNextResponse =
                    self.call_player("PlayNext", "play_next", &player::PlayNextRequest)?;
            }
            PlayerCall::Rate(rate) => {
                let _: player::SetRateResponse =
                    self.call_player("SetRate", "set_rate", &player::SetRateRequest { rate })?;
            }
            PlayerCall::Seek(seconds) => {
                let time = Time::from_ns((seconds.max(0.0) * 1e9) as u64);
                let _: player::SeekResponse =
                    self.call_player("Seek", "seek", &player::SeekRequest { time })?;
            }
        }
        let paused: player::IsPausedResponse =
            self.call_player("IsPaused", "is_paused", &player::IsPausedRequest)?;
        let rate: player::GetRateResponse =
            self.call_player("GetRate", "get_rate", &player::GetRateRequest)?;
        Ok(Event::Player { paused: paused.paused, rate: rate.rate })
    }

    fn call_player<Q: Serialize, R: DeserializeOwned>(
        &self,
        type_name: &str,
        service: &str,
        request: &Q,
    ) -> Result<R, ClientError> {
        let unreadable = |why| ClientError::Cdr(PLAYER.to_owned(), why);
        let ros_type = format!("rosbag2_interfaces/srv/{type_name}");
        let request = cdr::to_vec(request).map_err(unreadable)?;
        let answer = self.viewer.transport.call(&format!("{PLAYER}/{service}"), &ros_type, request, PATIENCE);
        cdr::from_slice(&answer.map_err(|why| ClientError::Call(PLAYER.to_owned(), why))?).map_err(unreadable)
    }
}

impl Inbox {
    fn note(&mut self, statuses: &[modulo_msgs::diagnostic_msgs::DiagnosticStatus]) {
        for status in statuses {
            if self.statuses.len() < STATUSES || self.statuses.contains_key(&status.name) {
                self.statuses.insert(status.name.clone(), status.into());
                self.statuses_changed = true;
            }
        }
    }
}

/// Returns the view of the graph without the node `own`.
fn view(tokens: &[Token], own: &str) -> GraphView {
    let of = |kind, type_name: &'static str| {
        tokens.iter().filter(move |token| token.kind == kind).filter_map(move |token| {
            let endpoint = token.endpoint.as_ref()?;
            (ros_name(&endpoint.dds_type) == type_name).then(|| (token.node_name(), endpoint.topic.clone()))
        })
    };
    let (image, boxes) = (MessageKind::Image.type_name(), MessageKind::Detections.type_name());
    let images: BTreeSet<String> = of(EntityKind::Publisher, image).map(|(_, topic)| topic).collect();
    let detectors = of(EntityKind::Publisher, boxes).map(|(node, topic)| {
        let inputs = of(EntityKind::Subscription, image).filter(|(reader, _)| *reader == node);
        DetectorView { inputs: inputs.map(|(_, topic)| topic).collect(), node, topic }
    });
    let servers = tokens.iter().filter(|token| token.kind == EntityKind::Server);
    let nodes: BTreeSet<String> = servers
        .filter_map(|token| {
            token.endpoint.as_ref()?.topic.strip_suffix("/list_parameters").map(str::to_owned)
        })
        .filter(|node| node != own)
        .collect();
    GraphView {
        images: images.into_iter().collect(),
        // Labels are published with the type of boxes as well, by a node that reads no image.
        detectors: detectors.filter(|detector| !detector.inputs.is_empty()).collect(),
        player: nodes.contains(PLAYER),
        nodes: nodes.into_iter().collect(),
    }
}

/// Returns an image, decoded and as a binary message of a JPEG file.
fn encode(next: &NextImage) -> Result<(Arc<StampedFrame>, Vec<u8>), String> {
    let Message::Image(image) =
        Message::decode(MessageKind::Image, &next.payload).map_err(|why| why.to_string())?
    else {
        return Err("is no image".to_owned());
    };
    let (shown, white) = eight_bits(&image.frame);
    let jpeg = modulo_images::encode(&shown, FileFormat::Jpeg).map_err(|why| why.to_string())?;
    let boxes = next.boxes.iter().map(|(detector, boxes)| (detector.clone(), BoxView::of(boxes)));
    let header = ImageHeader {
        topic: next.topic.clone(),
        stamp: (image.header.stamp.sec, image.header.stamp.nanosec),
        width: image.frame.width(),
        height: image.frame.height(),
        white,
        boxes: boxes.collect(),
    };
    Ok((image, image_message(&header, &jpeg)))
}

/// Returns the image with 8 bits, and the value that became white if it had more. Values in between keep their ratio.
fn eight_bits(frame: &modulo_core::Frame) -> (modulo_core::Frame, Option<f32>) {
    if let Samples::U8(_) = frame.samples() {
        return (frame.clone(), None);
    }
    let values = frame.to_f32();
    let white = values.iter().copied().fold(1.0, f32::max);
    let scaled = values.mapv(|value| (255.0 * value / white).round() as u8);
    (modulo_core::Frame::from_u8(scaled).expect("the shape is that of a frame"), Some(white))
}
