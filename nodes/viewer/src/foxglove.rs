//! The server for Foxglove and Lichtblick: images, boxes as annotations and parameters, over the Foxglove WebSocket protocol.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use foxglove::messages::points_annotation::Type;
use foxglove::messages::{
    Color, CompressedImage, ImageAnnotations, Point2, PointsAnnotation, TextAnnotation, Timestamp,
};
use foxglove::websocket::{
    AnyClient, ClientId, GetParametersResponder, Parameter, ParameterHandler, ParameterType, ParameterValue,
    SetParametersResponder,
};
use foxglove::{Channel, Context, FoxgloveError, WebSocketServer, WebSocketServerHandle};
use modulo_middleware::parameter::client::ParameterClient;
use modulo_runtime::Value;
use modulo_runtime::name::is_hidden_node;
use modulo_runtime::parameter::from_ros;
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;

use crate::graph::Session;
use crate::protocol::{BoxView, GraphView};
use crate::watch::{Audience, JpegImage, LOOK, Subscriptions, Watch};

/// Messages that wait for a client; the oldest one is dropped when there are more.
const BACKLOG: usize = 32;
/// Requests for parameters that wait for nodes at most, of all clients together.
const REQUESTS: usize = 8;
/// The message to a client whose request is refused because there are more.
const BUSY: &str = "too many requests for parameters wait for the nodes; ask again";
/// The parameter to which a client gives the token before it may set any other one.
const TOKEN: &str = "token";
const NO_TOKEN: &str = "give the token that `modulo view` has printed, by setting the parameter `token`; only then others can \
                        be set";
/// Boxes and the background of their labels.
const CYAN: Color = Color { r: 0.0, g: 0.9, b: 0.9, a: 1.0 };
const BLACK: Color = Color { r: 0.0, g: 0.0, b: 0.0, a: 1.0 };
/// Height of a label in px.
const LABEL: f64 = 12.0;

pub(crate) struct FoxgloveServer {
    context: Arc<Context>,
    parameters: Arc<ParameterProxy>,
}

impl FoxgloveServer {
    /// Listens on `address`. A client may set parameters once it has given `token`.
    pub async fn start(
        session: Arc<Session>,
        address: SocketAddr,
        token: String,
    ) -> Result<Self, FoxgloveError> {
        let context = Context::new();
        let parameters = Arc::new(ParameterProxy {
            session,
            token,
            trusted: Mutex::default(),
            server: OnceLock::new(),
            places: Arc::new(Semaphore::new(REQUESTS)),
        });
        // The server puts a colon between host and port, so that an IPv6 address needs its brackets.
        let host = if address.is_ipv6() { format!("[{}]", address.ip()) } else { address.ip().to_string() };
        let server = WebSocketServer::new()
            .name("modulo")
            .context(&context)
            .bind(host, address.port())
            .message_backlog_size(BACKLOG)
            .parameter_handler(Arc::new(Handler(parameters.clone())))
            .start()
            .await?;
        parameters.server.get_or_init(|| server);
        Ok(Self { context, parameters })
    }

    pub fn port(&self) -> u16 {
        self.parameters.server.get().expect("`start` sets it").port()
    }

    /// Sends what clients have subscribed to, without an end.
    pub async fn serve(self) {
        let watch = Watch::new(self.parameters.session.clone(), Audience::Foxglove);
        let (mut graph, mut channels) = (GraphView::default(), StreamChannels::default());
        let (subscribed, mut look) = (Subscriptions::default(), tokio::time::interval(LOOK));
        loop {
            tokio::select! {
                () = watch.news.notified() => {}
                _ = look.tick() => {
                    watch.inbox().streams.watch(&channels.watched(&graph));
                    let (seen, errors) = watch.look(&subscribed).await;
                    graph = seen;
                    channels.follow(&self.context, &graph);
                    errors.iter().for_each(|why| tracing::warn!("{why}"));
                }
            }
            while let Some(next) = watch.next(&graph).await {
                for image in next.images {
                    // A client does not tell when it has drawn an image; its backlog is bounded.
                    watch.inbox().streams.drawn(&image.header.topic);
                    channels.send(image);
                }
                next.errors.iter().for_each(|why| tracing::warn!("{why}"));
            }
        }
    }
}

#[derive(Default)]
struct StreamChannels {
    images: BTreeMap<String, Channel<CompressedImage>>,
    boxes: BTreeMap<String, Channel<ImageAnnotations>>,
}

impl StreamChannels {
    /// Offers exactly the topics of `graph`.
    fn follow(&mut self, context: &Arc<Context>, graph: &GraphView) {
        fn follow<T: foxglove::Encode>(
            channels: &mut BTreeMap<String, Channel<T>>,
            context: &Arc<Context>,
            topics: &BTreeSet<&String>,
        ) {
            let gone = channels.extract_if(.., |topic, _| !topics.contains(topic));
            gone.for_each(|(_, channel)| channel.close());
            for &topic in topics {
                let open = || context.channel_builder(topic).build();
                channels.entry(topic.clone()).or_insert_with(open);
            }
        }
        follow(&mut self.images, context, &graph.images.iter().collect());
        follow(&mut self.boxes, context, &graph.detectors.iter().map(|detector| &detector.topic).collect());
    }

    /// Returns the image topics that a client needs: those that it has subscribed to, and those in which boxes are found.
    fn watched(&self, graph: &GraphView) -> Vec<String> {
        let images = self.images.iter().filter(|(_, channel)| channel.has_sinks());
        let shown = |topic: &String| self.boxes.get(topic).is_some_and(Channel::has_sinks);
        let detectors = graph.detectors.iter().filter(|detector| shown(&detector.topic));
        let inputs = detectors.flat_map(|detector| detector.inputs.iter().cloned());
        images.map(|(topic, _)| topic.clone()).chain(inputs).collect()
    }

    fn send(&self, JpegImage { image, header, jpeg, .. }: JpegImage) {
        // Stamps before 1970 do not exist in this protocol.
        let timestamp = Timestamp::new_checked(u32::try_from(header.stamp.0).unwrap_or(0), header.stamp.1);
        for (detector, boxes) in &header.boxes {
            if let Some(channel) = self.boxes.get(detector) {
                channel.log(&annotations(timestamp, boxes));
            }
        }
        if let Some(channel) = self.images.get(&header.topic) {
            channel.log(&CompressedImage {
                timestamp,
                frame_id: image.header.frame_id.clone(),
                data: jpeg.into(),
                format: "jpeg".to_owned(),
            });
        }
    }
}

/// Returns `boxes` as closed lines with a label each.
fn annotations(timestamp: Option<Timestamp>, boxes: &[BoxView]) -> ImageAnnotations {
    let outline = |b: &BoxView| {
        let [x1, y1, x2, y2] = b.edges.map(f64::from);
        let corners = [(x1, y1), (x2, y1), (x2, y2), (x1, y2)];
        PointsAnnotation {
            timestamp,
            r#type: Type::LineLoop.into(),
            points: corners.map(|(x, y)| Point2 { x, y }).into(),
            outline_color: Some(CYAN),
            thickness: 2.0,
            ..PointsAnnotation::default()
        }
    };
    let label = |b: &BoxView| TextAnnotation {
        timestamp,
        position: Some(Point2 { x: b.edges[0].into(), y: b.edges[1].into() }),
        text: format!("{} {:.2}", b.class, b.score),
        font_size: LABEL,
        text_color: Some(BLACK),
        background_color: Some(CYAN),
        ..TextAnnotation::default()
    };
    ImageAnnotations {
        timestamp,
        points: boxes.iter().map(outline).collect(),
        texts: boxes.iter().map(label).collect(),
        ..ImageAnnotations::default()
    }
}

/// The parameters of all nodes, called `/detector.input`.
struct ParameterProxy {
    session: Arc<Session>,
    token: String,
    /// The clients that have given the token.
    trusted: Mutex<Vec<ClientId>>,
    server: OnceLock<WebSocketServerHandle>,
    /// The requests that may wait for nodes at the same time.
    places: Arc<Semaphore>,
}

impl ParameterProxy {
    /// Returns the names of all parameters, that of the token first.
    fn names(&self, client: &AnyClient) -> Vec<String> {
        let mut nodes = self.session.transport.graph().nodes_with_parameters();
        nodes.retain(|node| !is_hidden_node(node));
        let mut all = vec![TOKEN.to_owned()];
        for node in nodes {
            match ParameterClient::new(&self.session.transport, &node).names() {
                Ok(names) => all.extend(names.iter().map(|name| format!("{node}.{name}"))),
                Err(why) => client.send_warning(why.to_string()),
            }
        }
        all
    }

    /// Returns the parameters called `names`. Those that no node has are left out.
    fn read(&self, client: &AnyClient, names: &[String]) -> Vec<Parameter> {
        let nodes = self.session.transport.graph().nodes_with_parameters();
        let mut by_node: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (node, name) in names.iter().filter_map(|name| name.split_once('.')) {
            if nodes.contains(node) {
                by_node.entry(node).or_default().push(name.to_owned());
            }
        }
        let mut read = Vec::new();
        // It is always empty: a client that reads it must not learn it.
        if names.iter().any(|name| name == TOKEN) {
            read.push(parameter(TOKEN.to_owned(), Value::String(String::new())));
        }
        for (node, names) in by_node {
            match ParameterClient::new(&self.session.transport, node).values(&names) {
                Ok(values) => {
                    let values = names.iter().zip(values.into_iter().map(from_ros));
                    let known = values.filter_map(|(name, value)| Some((name, value?)));
                    read.extend(known.map(|(name, value)| parameter(format!("{node}.{name}"), value)));
                }
                Err(why) => client.send_warning(why.to_string()),
            }
        }
        read
    }

    /// Sets one parameter, or takes the token.
    fn set(&self, client: &AnyClient, name: &str, value: &ParameterValue) -> Result<(), String> {
        let text = match value {
            ParameterValue::String(text) => text.clone(),
            other => serde_json::to_string(other).expect("numbers, booleans and lists of them are JSON"),
        };
        let mut trusted = self.trusted.lock().unwrap_or_else(PoisonError::into_inner);
        if name == TOKEN {
            if text != self.token {
                return Err("is not the token that `modulo view` has printed".to_owned());
            }
            if !trusted.contains(&client.id()) {
                trusted.push(client.id());
            }
            return Ok(());
        }
        if !trusted.contains(&client.id()) {
            return Err(NO_TOKEN.to_owned());
        }
        drop(trusted);
        let Some((node, name)) = name.split_once('.') else {
            return Err(format!("'{name}' is not the name of a parameter, such as /detector.input"));
        };
        let set = ParameterClient::new(&self.session.transport, node).set(name, &text);
        set.map_err(|why| why.to_string())
    }
}

impl ParameterHandler for Handler {
    fn get(
        &self,
        client: AnyClient,
        names: Vec<String>,
        _request: Option<String>,
        responder: GetParametersResponder,
    ) {
        let parameters = self.0.clone();
        let Ok(place) = parameters.places.clone().try_acquire_owned() else {
            client.send_warning(BUSY);
            return responder.respond(Vec::new());
        };
        // Nodes answer between two frames, which the connection must not wait for.
        spawn_blocking(move || {
            let _place = place;
            let names = if names.is_empty() { parameters.names(&client) } else { names };
            responder.respond(parameters.read(&client, &names));
        });
    }

    fn set(
        &self,
        client: AnyClient,
        changes: Vec<Parameter>,
        _request: Option<String>,
        responder: SetParametersResponder,
    ) {
        let parameters = self.0.clone();
        let Ok(place) = parameters.places.clone().try_acquire_owned() else {
            client.send_error(BUSY);
            return responder.respond(Vec::new());
        };
        spawn_blocking(move || {
            let _place = place;
            let (mut names, mut is_changed) = (Vec::new(), false);
            for Parameter { name, value, .. } in changes {
                // A parameter of a node can be set, but not removed.
                let Some(value) = value else { continue };
                match parameters.set(&client, &name, &value) {
                    Ok(()) => is_changed = true,
                    Err(why) => client.send_error(format!("{name}: {why}")),
                }
                names.push(name);
            }
            // What the nodes have now, whether they took the values or not.
            let values = parameters.read(&client, &names);
            if let Some(server) = parameters.server.get().filter(|_| is_changed) {
                server.publish_parameter_values(values.clone());
            }
            responder.respond(values);
        });
    }
}

/// [`ParameterProxy`] for the threads that wait for nodes.
struct Handler(Arc<ParameterProxy>);

/// Returns `value` in the types of the protocol.
fn parameter(name: String, value: Value) -> Parameter {
    fn list<T>(items: Vec<T>, to: impl Fn(T) -> ParameterValue) -> ParameterValue {
        ParameterValue::Array(items.into_iter().map(to).collect())
    }
    let (r#type, value) = match value {
        Value::Bool(value) => (None, ParameterValue::Bool(value)),
        Value::Integer(value) => (None, ParameterValue::Integer(value)),
        Value::Double(value) => (Some(ParameterType::Float64), ParameterValue::Float64(value)),
        Value::String(value) => (None, ParameterValue::String(value)),
        Value::Bytes(values) => (None, list(values, |value| ParameterValue::Integer(value.into()))),
        Value::Bools(values) => (None, list(values, ParameterValue::Bool)),
        Value::Integers(values) => (None, list(values, ParameterValue::Integer)),
        Value::Doubles(values) => (Some(ParameterType::Float64Array), list(values, ParameterValue::Float64)),
        Value::Strings(values) => (None, list(values, ParameterValue::String)),
    };
    Parameter { name, r#type, value: Some(value) }
}
