//! The cameras that image topics belong to. The images of one camera have the stamps of its frames; those of two cameras have no
//! moment in common.

use std::collections::{BTreeMap, BTreeSet};

use modulo_runtime::StreamKind;

use crate::protocol::{DetectorView, GraphView};

/// The most streams that are remembered; a publisher may invent more.
const MOST_SEEN: usize = 64;
/// The stream that is shown of each of several cameras.
const SHOWN: &str = "recovered";

/// Returns the namespace of a topic, without a slash at its end.
pub(crate) fn namespace(topic: &str) -> &str {
    topic.rsplit_once('/').map_or("", |(namespace, _)| namespace)
}

impl GraphView {
    pub(crate) fn camera<'a>(&'a self, topic: &'a str) -> &'a str {
        self.cameras.get(topic).map_or(namespace(topic), String::as_str)
    }
}

/// Returns the camera of each published image topic, named by a namespace. `published` and `read` have the nodes and the image topics
/// that they publish and read.
///
/// The images of a namespace are of one camera. An image that a detector has drawn is of the camera that the detector has read:
/// `/detector/front/annotated` is of `/front`. What another node publishes is of the same camera as what it reads, unless it reads
/// images of several cameras.
pub(crate) fn cameras(
    published: &BTreeSet<(String, String)>,
    read: &BTreeSet<(String, String)>,
    detectors: &[DetectorView],
) -> BTreeMap<String, String> {
    let mut cameras: BTreeMap<String, String> =
        published.iter().map(|(_, topic)| (topic.clone(), camera_by_name(topic, detectors))).collect();
    for (node, made) in published.iter().filter(|(node, _)| detectors.iter().all(|d| d.node != *node)) {
        let sources = read.iter().filter(|(reader, _)| reader == node);
        let sources: BTreeSet<String> =
            sources.filter_map(|(_, topic)| cameras.get(topic).cloned()).collect();
        let (Some(source), 1) = (sources.first(), sources.len()) else { continue };
        let camera = cameras[made].clone();
        cameras.values_mut().filter(|of| *of == source).for_each(|of| of.clone_from(&camera));
    }
    cameras
}

/// Returns the camera that the name of a topic tells.
fn camera_by_name(topic: &str, detectors: &[DetectorView]) -> String {
    let below = |detector: &DetectorView| {
        let rest = topic.strip_prefix(&detector.node).filter(|rest| rest.starts_with('/'))?;
        Some(format!("{}{}", namespace(&detector.node), namespace(rest)))
    };
    detectors.iter().find_map(below).unwrap_or_else(|| namespace(topic).to_owned())
}

/// Returns the rank of an image topic among those of its camera: the names of streams of the suite come first.
fn rank(topic: &str) -> usize {
    let name = topic.rsplit('/').next();
    StreamKind::for_detectors().position(|stream| Some(stream) == name).unwrap_or(usize::MAX)
}

/// Brings image topics into the order in which they are listed: the streams of the suite by camera, then the others.
pub(crate) fn sort(images: &mut [String], cameras: &BTreeMap<String, String>) {
    let key = |topic: &String| (rank(topic) == usize::MAX, cameras.get(topic), rank(topic), topic.clone());
    images.sort_by(|a, b| key(a).cmp(&key(b)));
}

/// The image topics that are shown as long as the user has chosen none.
#[derive(Default)]
pub(crate) struct FirstStreams {
    /// The streams that there were. A stream stays while its node is away.
    seen: BTreeSet<String>,
}

impl FirstStreams {
    /// Returns the streams of the only camera, of each of several cameras the one that a detector reads, or any image where there are no
    /// streams.
    pub fn of(&mut self, graph: &GraphView) -> Vec<String> {
        let streams = graph.images.iter().filter(|topic| rank(topic) < usize::MAX);
        for topic in streams {
            if self.seen.len() < MOST_SEEN {
                self.seen.insert(topic.clone());
            }
        }
        // The graph knows no camera of a stream whose node is away; its namespace stays.
        let mut cameras: BTreeMap<&str, Vec<&String>> = BTreeMap::new();
        self.seen.iter().for_each(|topic| cameras.entry(namespace(topic)).or_default().push(topic));
        cameras.values_mut().for_each(|topics| topics.sort_by_key(|topic| rank(topic)));
        let one_of = |topics: &Vec<&String>| {
            let is_read = |topic: &&&String| {
                let mut links = graph.links.iter().filter(|link| link.topic == ***topic);
                links.any(|link| graph.detectors.iter().any(|detector| detector.node == link.to))
            };
            let read = topics.iter().find(is_read);
            let shown = read.or(topics.iter().find(|topic| topic.ends_with(SHOWN))).or(topics.first());
            shown.map(|topic| (*topic).clone())
        };
        match cameras.len() {
            0 => graph.images.first().cloned().into_iter().collect(),
            1 => cameras.into_values().flatten().cloned().collect(),
            _ => cameras.values().filter_map(one_of).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::LinkView;

    fn pairs(all: &[(&str, &str)]) -> BTreeSet<(String, String)> {
        all.iter().map(|(node, topic)| ((*node).to_owned(), (*topic).to_owned())).collect()
    }

    fn detector(node: &str) -> DetectorView {
        DetectorView { node: node.into(), topic: String::new(), inputs: Vec::new(), offers: Vec::new() }
    }

    #[test]
    fn images_belong_to_the_camera_whose_frames_they_show() {
        let published = pairs(&[
            ("/driver", "/camera/image_raw"),
            ("/modulo_camera", "/modulo"),
            ("/unwrap", "/recovered"),
            ("/front/modulo_camera", "/front/modulo"),
            ("/front/unwrap", "/front/recovered"),
            ("/detector", "/detector/annotated"),
            ("/detector", "/detector/front/annotated"),
            ("/front/detector", "/front/detector/annotated"),
            ("/panorama", "/panorama/image"),
        ]);
        let read = pairs(&[
            ("/modulo_camera", "/camera/image_raw"),
            ("/unwrap", "/modulo"),
            ("/front/unwrap", "/front/modulo"),
            ("/detector", "/recovered"),
            ("/detector", "/front/recovered"),
            ("/front/detector", "/front/recovered"),
            ("/panorama", "/recovered"),
            ("/panorama", "/front/recovered"),
            ("/viewer", "/recovered"),
        ]);
        let got = cameras(&published, &read, &[detector("/detector"), detector("/front/detector")]);
        let of = |camera: &str| {
            got.iter().filter(|(_, of)| *of == camera).map(|(topic, _)| topic.as_str()).collect::<Vec<_>>()
        };
        assert_eq!(of(""), ["/camera/image_raw", "/detector/annotated", "/modulo", "/recovered"]);
        let front =
            ["/detector/front/annotated", "/front/detector/annotated", "/front/modulo", "/front/recovered"];
        assert_eq!(of("/front"), front);
        assert_eq!(of("/panorama"), ["/panorama/image"], "it has frames of two cameras");
    }

    fn graph(images: &[&str]) -> GraphView {
        GraphView { images: images.iter().map(|topic| (*topic).to_owned()).collect(), ..GraphView::default() }
    }

    #[test]
    fn streams_are_listed_by_camera_before_all_other_images() {
        let all =
            ["/rear/recovered", "/detector/a/annotated", "/front/saturated", "/front/modulo", "/front/hdr"];
        let mut images = graph(&all).images;
        let cameras = images.iter().map(|topic| (topic.clone(), namespace(topic).to_owned())).collect();
        sort(&mut images, &cameras);
        let sorted =
            ["/front/modulo", "/front/saturated", "/rear/recovered", "/detector/a/annotated", "/front/hdr"];
        assert_eq!(images, sorted);
    }

    #[test]
    fn the_streams_of_one_camera_or_one_of_each_are_shown_first() {
        let mut first = FirstStreams::default();
        assert!(first.of(&graph(&[])).is_empty());
        assert_eq!(first.of(&graph(&["/usb/image_raw", "/web/image"])), ["/usb/image_raw"]);
        assert_eq!(first.of(&graph(&["/modulo", "/usb/image_raw"])), ["/modulo"]);
        assert_eq!(
            first.of(&graph(&["/modulo", "/ideal", "/recovered"])),
            ["/modulo", "/recovered", "/ideal"]
        );
        // A node that has gone leaves its place.
        assert_eq!(first.of(&graph(&["/modulo"])), ["/modulo", "/recovered", "/ideal"]);
        let mut first = FirstStreams::default();
        let two = ["/front/modulo", "/front/recovered", "/rear/modulo"];
        assert_eq!(first.of(&graph(&two)), ["/front/recovered", "/rear/modulo"]);
        assert_eq!(first.of(&graph(&["/rear/recovered"])), ["/front/recovered", "/rear/recovered"]);
        let mut read = graph(&["/front/metered", "/front/recovered", "/rear/modulo"]);
        let link = |topic: &str| LinkView {
            topic: topic.to_owned(),
            to: "/detector".to_owned(),
            ..LinkView::default()
        };
        (read.detectors, read.links) = (vec![detector("/detector")], vec![link("/front/metered")]);
        assert_eq!(FirstStreams::default().of(&read), ["/front/metered", "/rear/modulo"]);
        let many: Vec<String> = (0..2 * MOST_SEEN).map(|camera| format!("/{camera}/modulo")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert!(first.of(&graph(&many)).len() <= MOST_SEEN);
    }
}
