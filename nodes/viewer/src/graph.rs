//! [`GraphView`]: the part of the ROS graph that is shown, and [`Statuses`].

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use modulo_middleware::graph::Graph;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::diagnostic_msgs::DiagnosticStatus;
use modulo_msgs::ros_name;
use modulo_runtime::topic::{Durability, Profile, Reliability};
use modulo_runtime::wire::keys::{Endpoint, EntityKind, Token};
use modulo_runtime::{Clock, MessageKind, NodeName, StreamKind};

use crate::cameras;
use crate::protocol::{DetectorView, GraphView, LinkView};

/// Name of the player of ROS 2, and of the suite.
pub(crate) const PLAYER: &str = "/rosbag2_player";
/// The input that follows the trust of the unwrapper.
const AUTO: &str = "auto";
/// Names of one kind that are kept, such as those of statuses; publishers may invent more.
pub(crate) const NAMES: usize = 256;

/// Whether there is room in `kept` for the name `name`.
pub(crate) fn has_room<T>(kept: &BTreeMap<String, T>, name: &str) -> bool {
    kept.len() < NAMES || kept.contains_key(name)
}

pub(crate) struct Session {
    pub transport: ZenohTransport,
    pub node_name: NodeName,
    pub clock: Arc<dyn Clock>,
}

pub(crate) struct MessageOrigin {
    pub node: String,
    pub topic: String,
}

#[derive(Default)]
pub(crate) struct Statuses {
    by_name: BTreeMap<String, DiagnosticStatus>,
    /// The names of those that have come since they were taken last.
    fresh: BTreeSet<String>,
}

impl Statuses {
    /// Takes a status under its own name, or under another one where several publishers share that; names beyond the first 256 are left
    /// out.
    pub fn note(&mut self, name: &str, status: &DiagnosticStatus) {
        if has_room(&self.by_name, name) {
            self.by_name
                .insert(name.to_owned(), DiagnosticStatus { name: name.to_owned(), ..status.clone() });
            self.fresh.insert(name.to_owned());
        }
    }

    /// Returns the values of the newest status of this name.
    pub fn values(&self, name: &str) -> Option<BTreeMap<String, String>> {
        let values = self.by_name.get(name)?.values.iter();
        Some(values.map(|one| (one.key.clone(), one.value.clone())).collect())
    }

    /// Returns those that have come since the last call.
    pub fn take_fresh(&mut self) -> Vec<DiagnosticStatus> {
        let fresh = std::mem::take(&mut self.fresh);
        fresh.iter().filter_map(|name| self.by_name.get(name).cloned()).collect()
    }
}

impl GraphView {
    /// Returns the view of `graph` as the node of `session` shows it, without that node.
    pub fn of(session: &Session, graph: &Graph) -> Self {
        let own = &session.node_name.fully_qualified();
        let of = |kind, message: MessageKind| {
            graph.tokens().filter(move |token| token.kind == kind).filter_map(move |token| {
                let endpoint = token.endpoint.as_ref()?;
                let fits = ros_name(&endpoint.dds_type) == message.type_name();
                fits.then(|| (token.node_name(), endpoint.topic.clone()))
            })
        };
        let published = |message| of(EntityKind::Publisher, message);
        let topics = |message| published(message).map(|(_, topic)| topic).collect::<BTreeSet<String>>();
        let published_images: BTreeSet<_> = published(MessageKind::Image).collect();
        let read_images: BTreeSet<_> = of(EntityKind::Subscription, MessageKind::Image).collect();
        let mut images: Vec<String> = topics(MessageKind::Image).into_iter().collect();
        let statuses: Vec<String> = topics(MessageKind::Diagnostics).into_iter().collect();
        let (detectors, truths) = boxes(published(MessageKind::Detections), &read_images, &images, &statuses);
        let cameras = cameras::cameras(&published_images, &read_images, &detectors);
        cameras::sort(&mut images, &cameras);
        let mut nodes = graph.nodes_with_parameters();
        nodes.remove(own);
        Self {
            domain: session.transport.domain(),
            detectors,
            truths,
            links: links(graph, own),
            statuses,
            player: nodes.contains(PLAYER),
            nodes: nodes.into_iter().collect(),
            images,
            first: Vec::new(),
            makers: published_images.into_iter().map(|(node, topic)| (topic, node)).collect(),
            warnings: warnings(&session.transport),
            cameras,
        }
    }
}

/// Returns the detectors and the topics of labels among the publishers of boxes, with the image topics that nodes read. Labels are published
/// with the type of boxes as well, by a node that reads no image.
fn boxes(
    published: impl Iterator<Item = (String, String)>,
    read_images: &BTreeSet<(String, String)>,
    images: &[String],
    statuses: &[String],
) -> (Vec<DetectorView>, Vec<String>) {
    let (mut detectors, mut labels) = (Vec::new(), Vec::new());
    for (publisher, topic) in published {
        let of_node = |(reader, input): &(String, String)| (*reader == publisher).then(|| input.clone());
        let inputs: Vec<String> = read_images.iter().filter_map(of_node).collect();
        let node = author(publisher.clone(), &topic, statuses);
        if node == publisher && inputs.is_empty() {
            labels.push(topic);
        } else {
            detectors.push(DetectorView { inputs, offers: offers(&node, images), node, topic });
        }
    }
    (detectors, labels)
}

/// Returns what mixes in the graph now, and the nodes whose links were lost.
fn warnings(transport: &ZenohTransport) -> Vec<String> {
    let mut warnings: Vec<String> = transport.twins().iter().map(ToString::to_string).collect();
    let lost: BTreeSet<String> = transport.lost_publishers().into_iter().map(|lost| lost.node).collect();
    warnings.extend(lost.iter().map(|node| format!("the link to {node} was lost")));
    warnings
}

/// Returns the ways that images and boxes take between nodes other than `own`.
fn links(graph: &Graph, own: &str) -> Vec<LinkView> {
    let carried = [MessageKind::Image, MessageKind::CompressedImage, MessageKind::Detections];
    let carries =
        |endpoint: &Endpoint| carried.iter().any(|kind| ros_name(&endpoint.dds_type) == kind.type_name());
    let readers = graph.tokens().filter(|token| token.kind == EntityKind::Subscription);
    let readers = readers.filter_map(|token| Some((token.node_name(), token.endpoint.as_ref()?)));
    let readers = readers.filter(|(node, endpoint)| node != own && carries(endpoint));
    let links: BTreeSet<LinkView> = readers
        .flat_map(|(to, read)| {
            graph.endpoints(EntityKind::Publisher, &read.topic).map(move |token: &Token| {
                let qos = token.endpoint.as_ref().map_or("", |endpoint| &endpoint.qos);
                let (from, to, topic) = (token.node_name(), to.clone(), read.topic.clone());
                LinkView { from, to, topic, qos: qos_text(Profile::parse(qos)) }
            })
        })
        .collect();
    links.into_iter().collect()
}

fn qos_text(Profile { reliability, durability, depth }: Profile) -> String {
    let reliability = if reliability == Reliability::Reliable { "reliable" } else { "best effort" };
    let durability = if durability == Durability::TransientLocal { ", transient local" } else { "" };
    let depth = if depth == usize::MAX { "all".to_owned() } else { depth.to_string() };
    format!("{reliability}{durability}, keep {depth}")
}

/// Returns the node that has made the messages on `topic`: their `publisher` or, where that is the player of a bag, the recorded node, which the
/// topic of its values names.
pub(crate) fn author(publisher: String, topic: &str, statuses: &[String]) -> String {
    let recorded = |state: &String| {
        let node = state.strip_suffix("/state")?;
        topic.strip_prefix(node)?.starts_with('/').then(|| node.to_owned())
    };
    let is_played = publisher == PLAYER;
    let node = statuses.iter().filter(|_| is_played).filter_map(recorded).max_by_key(String::len);
    node.unwrap_or(publisher)
}

/// Returns the topic of the values that `node` uses.
pub(crate) fn state_topic(node: &str) -> String {
    format!("{node}/state")
}

/// Returns the name of the topic that `node`, which is not remapped, reads when its input is `stream`.
pub(crate) fn input_topic(node: &str, stream: &str) -> String {
    match node.rsplit_once('/') {
        Some((namespace, _)) if !stream.starts_with('/') => format!("{namespace}/{stream}"),
        _ => stream.to_owned(),
    }
}

/// Returns the values of the parameter `input` of the detector `node` that name one of `images`: a stream of its namespace by
/// its short name, any other image by its topic, and `auto`. Annotated images and `/hdr` are left out: no detector was made for
/// them.
fn offers(node: &str, images: &[String]) -> Vec<String> {
    let short = StreamKind::for_detectors().filter(|stream| images.contains(&input_topic(node, stream)));
    let is_short =
        |topic: &&String| StreamKind::for_detectors().any(|stream| input_topic(node, stream) == **topic);
    let made = |topic: &&String| topic.ends_with("/annotated") || topic.ends_with("/hdr");
    let others = images.iter().filter(|topic| !is_short(topic) && !made(topic));
    short.map(str::to_owned).chain(others.cloned()).chain([AUTO.to_owned()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bags of earlier versions call the sensor of each camera alike.
    #[test]
    fn each_camera_keeps_its_sensor() {
        let mut statuses = Statuses::default();
        let status = DiagnosticStatus { name: "sensor".into(), ..DiagnosticStatus::default() };
        for topic in ["/front/sensor_info", "/rear/sensor_info"] {
            statuses.note(topic, &status);
        }
        let names: Vec<String> = statuses.take_fresh().into_iter().map(|status| status.name).collect();
        assert_eq!(names, ["/front/sensor_info", "/rear/sensor_info"]);
    }
}
