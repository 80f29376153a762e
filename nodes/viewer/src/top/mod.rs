//! The view of a running suite in a terminal, `modulo top`: one row for each node, and keys that set parameters.
//!
//! ```text
//! /diagnostics, ~/state -> NodeTable -> rows -> screen
//! key -> Change -> parameter services
//! ```

mod change;
mod screen;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use console::{Alignment, measure_text_width, pad_str};
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{Guard, Transport as _, TransportError};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_runtime::name::is_hidden_node;
use modulo_runtime::{Clock, NodeName};

use crate::feed::{Feed, Heard, Session, Statuses, state_topic};
use crate::protocol::GraphView;
use change::Change;

pub use screen::show;

/// Name of the node in the graph.
const NODE: &str = "modulo_top";
const DIAGNOSTICS: &str = "/diagnostics";
/// Nodes publish their diagnostics once a second.
const PATIENCE: Duration = Duration::from_secs(5);
const GLANCE: Duration = Duration::from_millis(50);
/// Ages over which the percentiles are taken: those of the last minute.
const AGES: usize = 60;
/// The columns, and the sides at which their values stand.
const COLUMNS: [(&str, Alignment); 8] = [
    ("node", Alignment::Left),
    ("Hz", Alignment::Right),
    ("age p50 ms", Alignment::Right),
    ("age p99 ms", Alignment::Right),
    ("dropped", Alignment::Right),
    ("input", Alignment::Left),
    ("uses", Alignment::Left),
    ("trusted", Alignment::Right),
];

/// A look at a suite from the terminal.
pub struct Top {
    session: Arc<Session>,
    table: Arc<Mutex<NodeTable>>,
    feed: Feed,
    graph: GraphView,
    _announced: Guard,
}

impl Top {
    /// Joins the graph as the node `/modulo_top`.
    ///
    /// # Errors
    /// [`TransportError`] with the error of zenoh.
    pub fn new(transport: ZenohTransport, clock: Arc<dyn Clock>) -> Result<Self, TransportError> {
        transport.settled_graph();
        let node_name = NodeName { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() };
        // With a token, the node leaves the list of nodes of `rmw_zenoh_cpp` when it ends.
        let announced = transport.announce(&node_name)?;
        let session = Arc::new(Session { transport, node_name, clock });
        let table = Arc::new(Mutex::new(NodeTable::default()));
        let heard = table.clone();
        let feed = Feed::new(session.clone(), move |_, message| {
            if let Heard::Statuses(array) = message {
                lock(&heard).note(&array);
            }
        });
        Ok(Self { session, table, feed, graph: GraphView::default(), _announced: announced })
    }

    /// Returns the table as text, with a line for each node; `None` without a node. It waits until each node has told its
    /// rate, at most for 5 s.
    pub fn once(&mut self) -> Option<String> {
        for _ in 0..PATIENCE.as_millis() / GLANCE.as_millis() {
            self.look();
            let telling = self.session.transport.publishers(DIAGNOSTICS);
            let rows = self.rows();
            if rows.iter().all(|row| row.hz.is_some() || !telling.contains(&row.node)) {
                break;
            }
            sleep(GLANCE);
        }
        let rows = self.rows();
        (!rows.is_empty()).then(|| table(&rows).join("\n"))
    }

    /// Looks for nodes that have come or gone.
    fn look(&mut self) {
        let wanted = |graph: &GraphView| {
            let states = graph.nodes.iter().map(|node| state_topic(node));
            states.chain([DIAGNOSTICS.to_owned()]).collect::<BTreeSet<_>>()
        };
        // A subscription that fails is tried again at the next look.
        (self.graph, _) = self.feed.look(wanted);
        self.graph.nodes.retain(|node| !is_hidden_node(node));
    }

    fn rows(&self) -> Vec<NodeRow> {
        let table = lock(&self.table);
        let namesakes = |node: &String| self.graph.namesakes.get(node).copied();
        self.graph
            .nodes
            .iter()
            .map(|node| NodeRow { namesakes: namesakes(node), ..table.row(node) })
            .collect()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The newest statuses of all nodes, and the ages of their last frames.
#[derive(Default)]
struct NodeTable {
    statuses: Statuses,
    /// The last ages in ms, by the name of the status, which [`Statuses`] bounds.
    ages: BTreeMap<String, VecDeque<f64>>,
}

impl NodeTable {
    fn note(&mut self, array: &DiagnosticArray) {
        self.statuses.note(array);
        for name in array.status.iter().map(|status| &status.name) {
            let age = self.statuses.get(name).and_then(|status| status.value("age_ms")?.parse().ok());
            let Some(age) = age else { continue };
            let ages = self.ages.entry(name.clone()).or_default();
            ages.push_back(age);
            if ages.len() > AGES {
                ages.pop_front();
            }
        }
    }

    /// Returns what is known of `node`, a fully qualified name.
    fn row(&self, node: &str) -> NodeRow {
        // Names of statuses have no leading slash.
        let name = node.trim_start_matches('/');
        let status = self.statuses.get(name);
        let state = self.statuses.get(&format!("{name}: state"));
        let told = |key: &str| status.and_then(|status| status.value(key)).map(str::to_owned);
        let used = |key: &str| state.and_then(|state| state.value(key)).map(str::to_owned);
        let changes = Change::ALL.into_iter().filter(|change| used(change.target().0).is_some());
        let number = |key: &str| told(key).and_then(|text| text.parse::<f64>().ok());
        NodeRow {
            node: node.to_owned(),
            namesakes: None,
            level: status.map_or(0, |status| status.level),
            hz: number("rate_hz"),
            age_p50: self.age(name, 0.5),
            age_p99: self.age(name, 0.99),
            dropped: told("dropped_frames"),
            input: used("stream"),
            uses: used("model").or_else(|| used("method")).or_else(|| used("source")),
            trusted: number("trusted_share"),
            changes: changes.collect(),
        }
    }

    /// Returns the quantile `q` of the last ages, by the nearest rank.
    fn age(&self, name: &str, q: f64) -> Option<f64> {
        let mut ages: Vec<f64> = self.ages.get(name)?.iter().copied().collect();
        ages.sort_unstable_by(f64::total_cmp);
        let rank = (ages.len() as f64 * q).ceil() as usize;
        ages.get(rank.max(1) - 1).copied()
    }
}

/// A row of the table. A value is `None` if the node has not published it.
#[derive(Clone, Debug, Default, PartialEq)]
struct NodeRow {
    node: String,
    /// The number of nodes of this name, where there are several: their values take turns in the row.
    namesakes: Option<usize>,
    /// Level of its diagnostics: 0 for fine, 1 for a warning, above for an error.
    level: u8,
    hz: Option<f64>,
    age_p50: Option<f64>,
    age_p99: Option<f64>,
    dropped: Option<String>,
    input: Option<String>,
    uses: Option<String>,
    /// In [0, 1].
    trusted: Option<f64>,
    /// The changes that can be asked of it.
    changes: Vec<Change>,
}

impl NodeRow {
    fn cells(&self) -> [String; COLUMNS.len()] {
        let number = |value: Option<f64>| value.map(|value| format!("{value:.1}"));
        let several = self.namesakes.map(|count| format!(" ({count} nodes of this name)"));
        [
            Some(self.node.clone() + &several.unwrap_or_default()),
            number(self.hz),
            number(self.age_p50),
            number(self.age_p99),
            self.dropped.clone(),
            self.input.clone(),
            self.uses.clone(),
            self.trusted.map(|share| format!("{:.1} %", 100.0 * share)),
        ]
        .map(|cell| cell.map_or_else(|| "-".to_owned(), |text| printable(&text)))
    }
}

/// Returns `text` without control characters: what another node has sent must not steer the terminal.
fn printable(text: &str) -> String {
    text.chars().filter(|character| !character.is_control()).collect()
}

/// Returns the lines of the table without colours: the titles, and one line for each of `rows`.
fn table(rows: &[NodeRow]) -> Vec<String> {
    let titles = COLUMNS.map(|(title, _)| title.to_owned());
    let cells: Vec<_> = [titles].into_iter().chain(rows.iter().map(NodeRow::cells)).collect();
    let width = |column: usize| cells.iter().map(|cells| measure_text_width(&cells[column])).max();
    let widths: Vec<_> = (0..COLUMNS.len()).filter_map(width).collect();
    let line = |cells: &[String; COLUMNS.len()]| {
        let columns = cells.iter().zip(COLUMNS).zip(&widths);
        let padded = columns.map(|((cell, (_, side)), width)| pad_str(cell, *width, side, None));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    cells.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use modulo_msgs::diagnostic_msgs::{DiagnosticStatus, KeyValue};
    use modulo_msgs::std_msgs::Header;

    use super::*;

    fn array(name: &str, values: &[(&str, &str)]) -> DiagnosticArray {
        let values =
            values.iter().map(|(key, value)| KeyValue { key: (*key).into(), value: (*value).into() });
        let status = DiagnosticStatus {
            level: DiagnosticStatus::OK,
            name: name.into(),
            message: "running".into(),
            hardware_id: String::new(),
            values: values.collect(),
        };
        DiagnosticArray { header: Header::default(), status: vec![status] }
    }

    #[test]
    fn a_row_has_the_rate_the_ages_and_what_is_in_use() {
        let mut nodes = NodeTable::default();
        assert_eq!(
            nodes.row("/front/unwrap"),
            NodeRow { node: "/front/unwrap".into(), ..NodeRow::default() }
        );
        // The first age is forgotten after a minute.
        for age in [1000].into_iter().chain(1..=60) {
            let age = age.to_string();
            let values = [
                ("rate_hz", "30.00"),
                ("age_ms", &*age),
                ("dropped_frames", "3"),
                ("trusted_share", "0.9667"),
            ];
            nodes.note(&array("front/unwrap", &values));
        }
        nodes.note(&array("front/unwrap: state", &[("stream", "modulo"), ("method", "auto")]));
        let row = nodes.row("/front/unwrap");
        assert_eq!(row.cells(), ["/front/unwrap", "30.0", "30.0", "60.0", "3", "modulo", "auto", "96.7 %"]);
        assert_eq!(row.changes, [Change::Method]);
        let shared = NodeRow { namesakes: Some(2), ..row.clone() };
        assert_eq!(shared.cells()[0], "/front/unwrap (2 nodes of this name)");
        assert_eq!(
            table(&[row]),
            [
                "node             Hz  age p50 ms  age p99 ms  dropped  input   uses  trusted",
                "/front/unwrap  30.0        30.0        60.0        3  modulo  auto   96.7 %",
            ]
        );
    }

    #[test]
    fn a_value_cannot_steer_the_terminal() {
        let mut nodes = NodeTable::default();
        nodes.note(&array("a: state", &[("stream", "\u{1b}[2Jx\r\ny\u{9b}5m")]));
        assert_eq!(nodes.row("/a").cells()[5], "[2Jxy5m");
    }

    #[test]
    fn the_table_is_bounded() {
        let mut nodes = NodeTable::default();
        for number in 0..1000 {
            nodes.note(&array(&format!("node{number}"), &[("age_ms", "1")]));
        }
        assert_eq!((nodes.ages.len(), nodes.statuses.take_fresh().len()), (256, 256));
    }
}
