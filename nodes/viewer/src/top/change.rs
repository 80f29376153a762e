//! [`Change`]: a change of a parameter that a key asks for.

use modulo_middleware::parameter::client::{ClientError, ParameterClient};
use modulo_middleware::transport::zenoh::ZenohTransport;

use crate::protocol::{GraphView, ParameterView};

/// Step of alpha.
const STEP: f64 = 0.5;

/// A change of one parameter to its next value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// The detector reads the next stream.
    Input,
    /// The unwrapper uses the next method.
    Method,
    /// The camera senses with more exposure.
    MoreAlpha,
    /// The camera senses with less exposure.
    LessAlpha,
}

impl Change {
    pub const ALL: [Self; 4] = [Self::Input, Self::Method, Self::MoreAlpha, Self::LessAlpha];

    /// Returns the key of `~/state` that a node has only when it can be asked for this, the kind of such a node, and its parameter.
    pub fn target(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Input => ("model", "detector", "input"),
            Self::Method => ("method", "unwrap node", "method"),
            // Only the camera's alpha changes the image.
            Self::MoreAlpha | Self::LessAlpha => ("source", "camera", "alpha"),
        }
    }

    /// Asks `node` for the change. Returns the result in words.
    pub fn ask(self, transport: &ZenohTransport, graph: &GraphView, node: &str) -> String {
        let (.., parameter) = self.target();
        match self.set(parameter, transport, graph, node) {
            Ok(value) => format!("{node} {parameter} = {value}"),
            Err(why) => format!("{node} {parameter}: {why}"),
        }
    }

    fn set(
        self,
        parameter: &str,
        transport: &ZenohTransport,
        graph: &GraphView,
        node: &str,
    ) -> Result<String, ClientError> {
        let client = ParameterClient::new(transport, node);
        let present = ParameterView::read(&client, &[parameter.to_owned()])?;
        let next = present.first().map(|present| self.next(present, graph, node)).unwrap_or_default();
        client.set(parameter, &next).map(|()| next)
    }

    /// Returns the value after `present`.
    fn next(self, present: &ParameterView, graph: &GraphView, node: &str) -> String {
        let after = |words: &[String]| {
            let next = words.iter().position(|word| *word == present.value).map_or(0, |index| index + 1);
            words.iter().cycle().nth(next).unwrap_or(&present.value).clone()
        };
        let by = |step: f64| {
            let (least, most) = present.range.unwrap_or((1.0, 16.0));
            let value = present.value.parse::<f64>().unwrap_or(least);
            (value + step).clamp(least.max(1.0), most).to_string()
        };
        match self {
            Self::Input => {
                let detector = graph.detectors.iter().find(|detector| detector.node == node);
                after(detector.map_or(&[], |detector| &detector.offers))
            }
            Self::Method => after(&present.words),
            Self::MoreAlpha => by(STEP),
            Self::LessAlpha => by(-STEP),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::DetectorView;

    #[test]
    fn the_next_value_follows_the_present_one() {
        let detector = DetectorView {
            node: "/detector".into(),
            topic: "/boxes".into(),
            inputs: Vec::new(),
            offers: ["modulo", "recovered"].map(str::to_owned).into(),
        };
        let graph = GraphView { detectors: vec![detector], ..GraphView::default() };
        let present = |value: &str| ParameterView {
            name: "a parameter".into(),
            r#type: "string",
            value: value.into(),
            description: String::new(),
            default: None,
            read_only: false,
            range: Some((0.0, 8.0)),
            words: ["auto", "tree"].map(str::to_owned).into(),
        };
        for (change, node, value, next) in [
            (Change::Input, "/detector", "modulo", "recovered"),
            (Change::Input, "/detector", "recovered", "modulo"),
            (Change::Input, "/detector", "/gone", "modulo"),
            (Change::Input, "/other", "modulo", "modulo"),
            (Change::Method, "/unwrap", "auto", "tree"),
            (Change::Method, "/unwrap", "tree", "auto"),
            (Change::MoreAlpha, "/camera", "2.5", "3"),
            (Change::MoreAlpha, "/camera", "8", "8"),
            (Change::LessAlpha, "/camera", "1", "1"),
        ] {
            assert_eq!(change.next(&present(value), &graph, node), next, "{change:?} {value}");
        }
    }
}
