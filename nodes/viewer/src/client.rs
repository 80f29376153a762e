//! The connection of one browser: the images and events that are sent, and the requests that are carried out.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{Message as Frame, WebSocket};
use modulo_middleware::parameter::client::{ClientError, ParameterClient};
use modulo_msgs::builtin_interfaces::Time;
use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::rosbag2_interfaces as player;
use serde::Serialize;
use tokio::sync::mpsc;
use tokio::task::spawn_blocking;
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::Viewer;
use crate::graph::PLAYER;
use crate::protocol::{Event, GraphView, PageRequest, ParameterView, PlayerCall};
use crate::watch::{Audience, LOOK, Subscriptions, Watch};

/// Time between two questions whether the browser is still there, which it answers by itself. One that leaves two of them unanswered
/// makes room for another one; its page connects again when it goes on.
const QUESTION: Duration = Duration::from_secs(15);
/// Requests of a browser that wait for the services of nodes.
const REQUESTS: usize = 32;
/// Time limit for an answer of the player of a bag.
const PATIENCE: Duration = Duration::from_secs(5);

pub(crate) async fn serve(viewer: Arc<Viewer>, mut socket: WebSocket) {
    let client = Arc::new(Client { watch: Watch::new(viewer.session.clone(), Audience::Page), viewer });
    let (requests, waiting) = mpsc::channel(REQUESTS);
    let (answers, mut answered) = mpsc::channel(REQUESTS);
    let caller = client.clone();
    // Nodes answer between two frames: one thread waits for them, so that images go on meanwhile.
    spawn_blocking(move || caller.carry_out(waiting, &answers));
    let (mut look, mut question) = (interval(LOOK), interval(QUESTION));
    // After a pause of the viewer itself, the browser has the whole time again.
    question.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut unanswered = 0;
    let (subscribed, mut graph) = (Subscriptions::default(), GraphView::default());
    loop {
        let sent = tokio::select! {
            frame = socket.recv() => match frame.inspect(|_| unanswered = 0) {
                Some(Ok(Frame::Text(text))) => send_all(&mut socket, client.take(&text, &requests)).await,
                Some(Ok(Frame::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => Ok(()),
            },
            _ = question.tick() => {
                if unanswered == 2 {
                    return;
                }
                unanswered += 1;
                put(&mut socket, Frame::Ping(Bytes::new())).await
            }
            Some(event) = answered.recv() => send_all(&mut socket, [event]).await,
            () = client.watch.news.notified() => send_all(&mut socket, client.watch.notices()).await,
            _ = look.tick() => {
                let (seen, errors) = client.watch.look(&subscribed).await;
                let events = client.watch.events(&mut graph, seen);
                send_all(&mut socket, events.into_iter().chain(errors.into_iter().map(Event::Error))).await
            }
        };
        if sent.is_err() || client.send_images(&graph, &mut socket).await.is_err() {
            return;
        }
    }
}

/// Sends `frame`. It is an error when the browser does not take it for as long as it may stand still.
async fn put(socket: &mut WebSocket, frame: Frame) -> Result<(), axum::Error> {
    let sent = timeout(2 * QUESTION, socket.send(frame)).await;
    sent.unwrap_or_else(|late| Err(axum::Error::new(late)))
}

async fn send_all(
    socket: &mut WebSocket,
    events: impl IntoIterator<Item = Event>,
) -> Result<(), axum::Error> {
    for event in events {
        let text = serde_json::to_string(&event).expect("strings and numbers are JSON");
        put(socket, Frame::Text(text.into())).await?;
    }
    Ok(())
}

struct Client {
    viewer: Arc<Viewer>,
    watch: Arc<Watch>,
}

impl Client {
    /// Takes a message of the page. What needs a node waits in `requests`. Returns the answer that is there already, if any.
    fn take(&self, text: &str, requests: &mpsc::Sender<PageRequest>) -> Option<Event> {
        let request = match serde_json::from_str(text) {
            Ok(request) => request,
            Err(why) => return Some(Event::Error(format!("unreadable request: {why}"))),
        };
        let mut inbox = self.watch.inbox();
        match request {
            PageRequest::Watch(topics) => inbox.streams.watch(&topics),
            PageRequest::Drawn(topics) => topics.iter().for_each(|topic| inbox.streams.drawn(topic)),
            PageRequest::Together(together) => inbox.together = together,
            PageRequest::Pixel { u, v, images } => {
                return Some(Event::Pixel { u, v, samples: inbox.streams.pixel(u, v, images) });
            }
            other => {
                let why = "too many requests wait for their nodes; this one was left out, try again";
                return requests.try_send(other).is_err().then(|| Event::Error(why.to_owned()));
            }
        }
        None
    }

    async fn send_images(&self, graph: &GraphView, socket: &mut WebSocket) -> Result<(), axum::Error> {
        while let Some(moment) = self.watch.next(graph).await {
            let message = moment.message();
            let is_empty = moment.images.is_empty();
            for image in moment.images {
                self.watch.inbox().streams.sent(&image.header.topic, image.image, image.scale);
            }
            if !is_empty {
                put(socket, Frame::Binary(Bytes::from(message))).await?;
            }
            send_all(socket, moment.errors.into_iter().map(Event::Error)).await?;
        }
        Ok(())
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
        let transport = &self.viewer.session.transport;
        Ok(match request {
            PageRequest::Parameters(node) => {
                let parameters = ParameterView::read_all(&ParameterClient::new(transport, &node))?;
                Event::Parameters { node, parameters }
            }
            PageRequest::Set { node, name, value } => {
                let set = ParameterClient::new(transport, &node).set(&name, &value);
                Event::Set { node, name, error: set.err().map(|why| why.to_string()) }
            }
            PageRequest::Player(call) => self.play(call)?,
            PageRequest::Expose(of) => {
                let captured = self.watch.captured(&of);
                let mut exposer = self.viewer.exposer.lock().unwrap_or_else(PoisonError::into_inner);
                let result = captured.and_then(|captured| exposer.expose(&captured, of.stops));
                Event::Exposed { of, result }
            }
            _ => unreachable!("requests without a node are answered at once"),
        })
    }

    /// Calls the player of a bag, and returns its state after that.
    fn play(&self, call: PlayerCall) -> Result<Event, ClientError> {
        match call {
            PlayerCall::State => {}
            PlayerCall::Toggle => {
                self.call_player("TogglePaused", "toggle_paused", &player::TogglePausedRequest::default())?;
            }
            PlayerCall::Next => {
                drop(self.call_player("PlayNext", "play_next", &player::PlayNextRequest::default())?)
            }
            PlayerCall::Rate(rate) => {
                self.call_player("SetRate", "set_rate", &player::SetRateRequest { rate })?;
            }
            PlayerCall::Seek(seconds, num_messages) => {
                let time = Time::from_ns((seconds.max(0.0) * 1e9) as u64);
                self.call_player("Seek", "seek", &player::SeekRequest { time })?;
                // One that plays refuses.
                self.call_player("Burst", "burst", &player::BurstRequest { num_messages })?;
            }
        }
        let paused = self.call_player("IsPaused", "is_paused", &player::IsPausedRequest::default())?;
        let rate = self.call_player("GetRate", "get_rate", &player::GetRateRequest::default())?;
        let player::IsPausedResponse { paused } = cdr::from_slice(&paused).map_err(unreadable)?;
        let player::GetRateResponse { rate } = cdr::from_slice(&rate).map_err(unreadable)?;
        Ok(Event::Player { paused, rate })
    }

    /// Calls a service of the player; returns its response as CDR.
    fn call_player(
        &self,
        type_name: &str,
        service: &str,
        request: &impl Serialize,
    ) -> Result<Vec<u8>, ClientError> {
        let ros_type = format!("rosbag2_interfaces/srv/{type_name}");
        let (service, request) = (format!("{PLAYER}/{service}"), cdr::to_vec(request).map_err(unreadable)?);
        let answer = self.viewer.session.transport.call(&service, &ros_type, request, PATIENCE);
        answer.map_err(|why| ClientError::of_node(PLAYER, why))
    }
}

fn unreadable(why: CdrError) -> ClientError {
    ClientError::of_node(PLAYER, why)
}
