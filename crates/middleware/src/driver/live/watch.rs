//! The warning of a live node whose images do not come.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use modulo_runtime::MessageKind;
use modulo_runtime::clock::nanos;
use modulo_runtime::name::{NOT_OVER_ZENOH, did_you_mean};
use modulo_runtime::wire::keys::EntityKind;

use crate::driver::pacing::TOPIC as TAKEN;
use crate::transport::Transport;

/// A node that waits for an image for so long warns.
const PATIENCE: Duration = Duration::from_secs(2);

/// The waits for the next image of each image topic. Only the time counts in which the node could have taken one.
#[derive(Default)]
pub(super) struct Silence {
    waits: BTreeMap<String, Wait>,
}

struct Wait {
    /// Ticks of its begin.
    since: u64,
    /// The warning, while it holds.
    warning: Option<String>,
}

impl Silence {
    /// Returns the warning that holds now, of one of the topics.
    pub fn warning(&self) -> Option<&str> {
        self.waits.values().find_map(|wait| wait.warning.as_deref())
    }

    /// Notes that an image of `topic` was answered from the ticks `begin` to `now`. Returns a text after a warning.
    pub fn end(&mut self, topic: &str, begin: u64, now: u64) -> Option<String> {
        let before = self.waits.get(topic)?.since;
        // Images of other topics could not be taken meanwhile.
        self.waits
            .values_mut()
            .for_each(|wait| wait.since = (wait.since + now.saturating_sub(begin)).min(now));
        let wait = self.waits.get_mut(topic)?;
        wait.since = now;
        wait.warning.take()?;
        Some(format!("an image has come on {topic} after {} s", seconds(now, before)))
    }

    /// Returns the text of a warning if one is due at the ticks `now`: once, when no image has come on one of `topics` for
    /// 2 s. Publishers that are still starting are waited for without a warning.
    pub fn look<'a>(
        &mut self,
        topics: impl Iterator<Item = &'a str> + Clone,
        node: &str,
        transport: &dyn Transport,
        now: u64,
    ) -> Option<&str> {
        self.waits.retain(|waited, _| topics.clone().any(|topic| topic == waited));
        for topic in topics {
            // The images of a new input are waited for from now on.
            if !self.waits.contains_key(topic) {
                self.waits.insert(topic.to_owned(), Wait { since: now, warning: None });
            }
        }
        let is_due =
            |wait: &Wait| wait.warning.is_none() && now.saturating_sub(wait.since) >= nanos(PATIENCE);
        let (topic, wait) = self.waits.iter_mut().find(|(_, wait)| is_due(wait))?;
        let publishers = transport.publishers(topic);
        // A node announces itself when it is ready: a camera may wait for a detector that loads its model.
        let starts =
            !publishers.is_empty() && !publishers.iter().any(|publisher| transport.is_ready(publisher));
        if starts || is_told_upstream(topic, transport) {
            wait.since = now;
            return None;
        }
        let images = transport.users(EntityKind::Publisher, MessageKind::Image);
        let images = images.into_iter().filter(|(_, by)| by != node);
        let images: BTreeSet<String> = images.map(|(topic, _)| topic).collect();
        let cause = transport.lost_publisher(topic).map_or_else(
            || cause_of(topic, &publishers, &images),
            |lost| format!("the link to {}, which published it, was lost", lost.node),
        );
        let seconds = seconds(now, wait.since);
        Some(wait.warning.insert(format!("no image has come on {topic} for {seconds} s: {cause}")))
    }
}

/// Returns whether a node of the suite before this one waits for an image topic that no node publishes, and so warns of the
/// cause itself.
fn is_told_upstream(topic: &str, transport: &dyn Transport) -> bool {
    let suite = transport.publishers(TAKEN);
    let read = transport.users(EntityKind::Subscription, MessageKind::Image);
    let (mut topics, mut seen) = (vec![topic.to_owned()], BTreeSet::new());
    while let Some(topic) = topics.pop() {
        let mut before = transport.publishers(&topic);
        before.retain(|node| suite.contains(node) && seen.insert(node.clone()));
        for (input, _) in read.iter().filter(|(_, node)| before.contains(node)) {
            if transport.publishers(input).is_empty() {
                return true;
            }
            topics.push(input.clone());
        }
    }
    false
}

fn seconds(now: u64, since: u64) -> u64 {
    Duration::from_nanos(now.saturating_sub(since)).as_secs()
}

fn cause_of(topic: &str, publishers: &[String], images: &BTreeSet<String>) -> String {
    let near = did_you_mean(topic, images.iter().map(String::as_str));
    let cause = match publishers {
        [] => format!("no node publishes it{near}"),
        publishers => format!("{} publishes it, but sends nothing", publishers.join(", ")),
    };
    let kind = MessageKind::Image.type_name();
    let others = match images.iter().map(String::as_str).collect::<Vec<_>>() {
        images if images.is_empty() => format!("no topic of the type {kind} is published now"),
        images => format!("the published topics of the type {kind} are {}", images.join(", ")),
    };
    let remedy =
        if publishers.is_empty() && near.is_empty() { format!("; {NOT_OVER_ZENOH}") } else { String::new() };
    format!("{cause}; {others}{remedy}")
}

#[cfg(test)]
mod tests {
    use modulo_runtime::{Address, NodeName, Topic};

    use super::*;
    use crate::transport::local::LocalTransport;

    #[test]
    fn a_silent_input_is_told_once_and_not_while_its_publisher_starts() {
        const S: u64 = 1_000_000_000;
        let transport = LocalTransport::default();
        let node = |name: &str| NodeName::new(name, "/", &[]).expect("a name");
        let image = |topic: &str| {
            Address::resolve(&node("unwrap"), &Topic::new(topic, MessageKind::Image)).expect("a name")
        };
        let own = transport.advertise(&node("unwrap"), &image("/recovered")).expect("local");
        let mut silence = Silence::default();
        let look = |silence: &mut Silence, topics: &[&str], now| {
            silence.look(topics.iter().copied(), "/unwrap", &transport, now).map(str::to_owned)
        };
        assert_eq!([0, 2 * S - 1].map(|now| look(&mut silence, &["/modulo"], now)), [None, None]);
        let text = look(&mut silence, &["/modulo"], 2 * S).expect("a warning");
        assert!(text.contains("no node publishes it; no topic of the type"), "{text}");
        assert!(
            text.contains("RMW_IMPLEMENTATION=rmw_zenoh_cpp") && text.contains("dds.launch.yaml"),
            "{text}"
        );
        assert_eq!((look(&mut silence, &["/modulo"], 9 * S), silence.warning()), (None, Some(text.as_str())));
        let ended = silence.end("/modulo", 9 * S, 10 * S);
        assert_eq!(ended.as_deref(), Some("an image has come on /modulo after 10 s"));
        assert_eq!((silence.end("/modulo", 10 * S, 11 * S), silence.warning()), (None, None));

        let camera = transport.advertise(&node("camera"), &image("/modulo")).expect("local");
        assert_eq!(look(&mut silence, &["/modulo"], 13 * S), None, "it is not ready yet");
        let ready = transport.announce(&node("camera")).expect("local");
        assert_eq!(look(&mut silence, &["/modulo"], 15 * S - 1), None);
        let text = look(&mut silence, &["/modulo"], 15 * S).expect("a warning");
        assert!(
            text.contains("/camera publishes it, but sends nothing") && text.ends_with("are /modulo"),
            "{text}"
        );
        assert_eq!(look(&mut silence, &["/other"], 16 * S), None, "another input");
        let text =
            look(&mut silence, &["/modulu"], 18 * S).or_else(|| look(&mut silence, &["/modulu"], 20 * S));
        let text = text.expect("a warning");
        assert!(text.contains("did you mean '/modulo'?") && !text.contains("DDS"), "{text}");

        let both = ["/a", "/b"];
        assert_eq!(look(&mut silence, &both, 20 * S), None);
        // A long step for one camera is no silence of the other one.
        assert_eq!(silence.end("/a", 20 * S, 23 * S), None);
        assert_eq!(look(&mut silence, &both, 23 * S), None);
        assert_eq!(silence.end("/a", 25 * S, 25 * S), None);
        let text = look(&mut silence, &both, 25 * S).expect("a warning");
        assert!(text.contains("no image has come on /b for 2 s"), "{text}");
        drop((own, camera, ready));
    }

    /// Behind a camera whose source sends nothing, the camera alone tells the cause.
    #[test]
    fn the_first_node_without_images_tells_the_cause() {
        const S: u64 = 1_000_000_000;
        let transport = LocalTransport::default();
        let node = |name: &str| NodeName::new(name, "/", &[]).expect("a name");
        let image = |topic: &str| {
            Address::resolve(&node("n"), &Topic::new(topic, MessageKind::Image)).expect("a name")
        };
        let chain = [("camera", "/camera/image_raw", "/modulo"), ("unwrap", "/modulo", "/recovered")];
        let guards = chain.map(|(name, input, output)| {
            let reads = transport.subscribe(&node(name), &image(input), Box::new(|_| {})).expect("local");
            let writes =
                [output, TAKEN].map(|topic| transport.advertise(&node(name), &image(topic)).expect("local"));
            (reads, writes, transport.announce(&node(name)).expect("local"))
        });
        let warns = |topic: &'static str, name: &str| {
            let mut silence = Silence::default();
            let mut look = |now| silence.look([topic].into_iter(), name, &transport, now).is_some();
            [look(0), look(3 * S)] == [false, true]
        };
        let who = || {
            [("/camera/image_raw", "/camera"), ("/modulo", "/unwrap"), ("/recovered", "/detector")]
                .map(|(t, n)| warns(t, n))
        };
        assert_eq!(who(), [true, false, false]);
        let driver = transport.advertise(&node("driver"), &image("/camera/image_raw")).expect("local");
        assert_eq!(
            who(),
            [false, true, true],
            "a node that is not ready publishes it, so that the cause is unknown"
        );
        drop((guards, driver));
    }
}
