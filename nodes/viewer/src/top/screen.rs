//! The table on a terminal, with keys.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use modulo_runtime::{Stop, Urgency};
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::Style;
use ratatui::text::Line;
use ratatui::widgets::{Paragraph, TableState};

use super::{Change, NodeRow, Top, table};
use crate::feed::Session;
use crate::protocol::GraphView;

/// Interval at which the table is drawn anew.
const TICK: Duration = Duration::from_millis(250);
/// Changes that wait for their nodes.
const CHANGES: usize = 8;
const KEYS: &str = "i: next input   m: next method   + -: alpha   up down: select   ?: help   q: quit";
const HELP: [&str; 6] = [
    "i       the detector reads the next stream that exists",
    "m       the unwrap node uses the next method",
    "+ -     alpha of the camera is 0.5 higher or lower",
    "up down selects a node; a key concerns this node if it can, else the first node that can",
    "?       hides this help",
    "q       ends the view; the suite goes on",
];

/// Restores the terminal at the end of its life. After a panic, the hook of ratatui has done so before the message.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// Shows the table on the terminal until `q` is pressed or `stop` is asked for an end.
///
/// # Errors
/// The error of the operating system when the terminal cannot be used.
pub fn show(mut top: Top, stop: &Stop) -> io::Result<()> {
    let (requests, waiting) = sync_channel(CHANGES);
    let told = Arc::new(Mutex::new(String::new()));
    let (session, answers) = (top.session.clone(), told.clone());
    thread::Builder::new().name("changes".into()).spawn(move || carry_out(&session, &waiting, &answers))?;
    let mut terminal = ratatui::try_init()?;
    let _restore = Restore;
    let mut screen = Screen { selected: TableState::new().with_selected(0), help: false, told };
    while stop.urgency() == Urgency::None {
        top.look();
        let rows = top.rows();
        terminal.draw(|frame| screen.draw(frame, &rows))?;
        if !event::poll(TICK)? {
            continue;
        }
        match event::read()? {
            Event::Key(key) if key.kind != KeyEventKind::Release => match screen.press(key, &rows) {
                Some(KeyCommand::Quit) => break,
                Some(KeyCommand::Ask(change, node)) => screen.ask(&requests, change, node, &top.graph),
                None => {}
            },
            _ => {}
        }
    }
    Ok(())
}

/// A change that is asked of a node, with the graph as it was then.
struct ChangeRequest {
    change: Change,
    node: String,
    graph: GraphView,
}

/// Carries out requests one after the other: a node answers between two frames, and keys must not wait for it.
fn carry_out(session: &Session, waiting: &Receiver<ChangeRequest>, told: &Mutex<String>) {
    for ChangeRequest { change, node, graph } in waiting {
        let result = change.ask(&session.transport, &graph, &node);
        *told.lock().unwrap_or_else(PoisonError::into_inner) = result;
    }
}

/// The action that a key asks for.
#[derive(Debug, PartialEq, Eq)]
enum KeyCommand {
    Quit,
    /// Asks a node for a change.
    Ask(Change, String),
}

struct Screen {
    selected: TableState,
    help: bool,
    /// The result of the last change.
    told: Arc<Mutex<String>>,
}

impl Screen {
    fn press(&mut self, key: KeyEvent, rows: &[NodeRow]) -> Option<KeyCommand> {
        let change = match key.code {
            KeyCode::Char('q') => return Some(KeyCommand::Quit),
            // A terminal in raw mode sends no SIGINT.
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => {
                return Some(KeyCommand::Quit);
            }
            KeyCode::Char('i') => Change::Input,
            KeyCode::Char('m') => Change::Method,
            KeyCode::Char('+' | '=') => Change::MoreAlpha,
            KeyCode::Char('-') => Change::LessAlpha,
            other => {
                match other {
                    KeyCode::Char('?') => self.help = !self.help,
                    KeyCode::Up => self.selected.select_previous(),
                    KeyCode::Down => self.selected.select_next(),
                    _ => {}
                }
                return None;
            }
        };
        let selected = self.selected.selected().and_then(|index| rows.get(index));
        let can = |row: &&NodeRow| row.changes.contains(&change);
        let Some(node) = selected.filter(can).or_else(|| rows.iter().find(can)) else {
            self.say(format!("no {} is running", change.target()));
            return None;
        };
        Some(KeyCommand::Ask(change, node.node.clone()))
    }

    fn ask(&self, requests: &SyncSender<ChangeRequest>, change: Change, node: String, graph: &GraphView) {
        self.say(format!("{node} is asked"));
        let request = ChangeRequest { change, node, graph: graph.clone() };
        match requests.try_send(request) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                self.say("too many changes wait for their nodes; press the key again later".to_owned());
            }
            Err(TrySendError::Disconnected(_)) => unreachable!("the thread ends after the last sender"),
        }
    }

    fn say(&self, text: String) {
        *self.told.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }

    fn draw(&mut self, frame: &mut Frame<'_>, rows: &[NodeRow]) {
        let help = if self.help { HELP.len() as u16 } else { 0 };
        let parts =
            [Constraint::Min(1), Constraint::Length(help), Constraint::Length(1), Constraint::Length(1)];
        let [nodes, help, told, keys] = Layout::vertical(parts).areas(frame.area());
        if rows.is_empty() {
            frame.render_widget(Paragraph::new("No node is running in this domain yet."), nodes);
        } else {
            let (table, _) = table(rows);
            let table = table.row_highlight_style(Style::new().reversed());
            frame.render_stateful_widget(table, nodes, &mut self.selected);
        }
        frame.render_widget(Paragraph::new(HELP.map(Line::from).to_vec()), help);
        let text = self.told.lock().unwrap_or_else(PoisonError::into_inner).clone();
        frame.render_widget(Paragraph::new(text), told);
        frame.render_widget(Paragraph::new(KEYS).style(Style::new().dim()), keys);
    }
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;

    fn row(node: &str, changes: &[Change]) -> NodeRow {
        NodeRow { node: node.into(), changes: changes.into(), ..NodeRow::default() }
    }

    fn screen() -> Screen {
        Screen { selected: TableState::new().with_selected(0), help: false, told: Arc::default() }
    }

    #[test]
    fn a_key_concerns_the_selected_node_or_the_first_one_that_can() {
        let rows = [row("/a", &[Change::Method]), row("/b", &[Change::Input]), row("/c", &[Change::Input])];
        let mut screen = screen();
        let mut press = |code| screen.press(KeyEvent::from(code), &rows);
        let input = |node: &str| Some(KeyCommand::Ask(Change::Input, node.into()));
        assert_eq!(press(KeyCode::Char('i')), input("/b"));
        assert_eq!(press(KeyCode::Down), None);
        assert_eq!(press(KeyCode::Down), None);
        assert_eq!(press(KeyCode::Char('i')), input("/c"));
        assert_eq!(press(KeyCode::Char('m')), Some(KeyCommand::Ask(Change::Method, "/a".into())));
        assert_eq!(press(KeyCode::Char('+')), None, "there is no camera");
        assert_eq!(press(KeyCode::Char('q')), Some(KeyCommand::Quit));
        assert_eq!(*screen.told.lock().expect("no panic"), "no camera is running");
    }

    #[test]
    fn a_screen_of_any_size_is_drawn() {
        let (mut screen, rows) = (screen(), [row("/a", &[])]);
        for (width, height) in [(80, 24), (10, 2), (1, 1)] {
            let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a buffer");
            for rows in [&rows[..], &[]] {
                screen.press(KeyEvent::from(KeyCode::Char('?')), rows);
                terminal.draw(|frame| screen.draw(frame, rows)).expect("a buffer");
            }
        }
    }
}
