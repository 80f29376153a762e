//! The table on a terminal, with keys.

use std::io::{self, Write as _};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use console::{Alignment, Key, Style, Term, pad_str};
use modulo_runtime::{Stop, Urgency};
use nix::sys::termios::{SetArg, Termios, cfmakeraw, tcgetattr, tcsetattr};

use super::{Change, NodeRow, Top, lock, printable, table};
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

/// A terminal in raw mode that shows another screen without a cursor, until the end of this value.
struct Screened {
    terminal: Term,
    before: Termios,
}

impl Screened {
    fn new() -> io::Result<Self> {
        let (mut terminal, before) = (Term::stdout(), tcgetattr(io::stdout())?);
        let mut raw = before.clone();
        cfmakeraw(&mut raw);
        tcsetattr(io::stdout(), SetArg::TCSANOW, &raw)?;
        terminal.write_all(b"\x1b[?1049h\x1b[?25l")?;
        Ok(Self { terminal, before })
    }
}

impl Drop for Screened {
    fn drop(&mut self) {
        // Both fail only for a terminal that is gone.
        let _ = self.terminal.write_all(b"\x1b[?25h\x1b[?1049l");
        let _ = tcsetattr(io::stdout(), SetArg::TCSANOW, &self.before);
    }
}

/// Shows the table on the terminal until `q` is pressed or `stop` is asked for an end.
///
/// # Errors
/// The error of the operating system when the terminal cannot be used.
pub fn show(mut top: Top, stop: &Stop) -> io::Result<()> {
    let (requests, waiting) = sync_channel(CHANGES);
    let message = Arc::new(Mutex::new(String::new()));
    let (session, answers) = (top.session.clone(), message.clone());
    thread::Builder::new().name("changes".into()).spawn(move || carry_out(&session, &waiting, &answers))?;
    let mut screened = Screened::new()?;
    let (pressed, keys) = channel();
    // One thread a key: none of them changes the mode of the terminal after the last key.
    let read_key = || {
        let (terminal, pressed) = (Term::stdout(), pressed.clone());
        let read = move || pressed.send(terminal.read_key_raw());
        thread::Builder::new().name("key".into()).spawn(read)
    };
    read_key()?;
    let mut screen = Screen { selected: 0, help: false, message };
    while stop.urgency() == Urgency::None {
        top.look();
        let rows = top.rows();
        let drawn = screen.draw(&rows, screened.terminal.size());
        screened.terminal.write_all(drawn.as_bytes())?;
        let Ok(key) = keys.recv_timeout(TICK) else { continue };
        match screen.press(&key?, &rows) {
            Some(KeyCommand::Quit) => break,
            Some(KeyCommand::Ask(change, node)) => screen.ask(&requests, change, node, &top.graph),
            None => {}
        }
        read_key()?;
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
fn carry_out(session: &Session, waiting: &Receiver<ChangeRequest>, message: &Mutex<String>) {
    for ChangeRequest { change, node, graph } in waiting {
        let result = change.ask(&session.transport, &graph, &node);
        *lock(message) = result;
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
    selected: usize,
    help: bool,
    /// The result of the last change.
    message: Arc<Mutex<String>>,
}

impl Screen {
    fn press(&mut self, key: &Key, rows: &[NodeRow]) -> Option<KeyCommand> {
        let change = match key {
            // A terminal in raw mode sends no SIGINT.
            Key::Char('q') | Key::CtrlC => return Some(KeyCommand::Quit),
            Key::Char('i') => Change::Input,
            Key::Char('m') => Change::Method,
            Key::Char('+' | '=') => Change::MoreAlpha,
            Key::Char('-') => Change::LessAlpha,
            other => {
                match other {
                    Key::Char('?') => self.help = !self.help,
                    Key::ArrowUp => self.selected = self.selected.saturating_sub(1),
                    Key::ArrowDown => self.selected += 1,
                    _ => {}
                }
                return None;
            }
        };
        let can = |row: &&NodeRow| row.changes.contains(&change);
        let Some(node) = rows.get(self.selected).filter(can).or_else(|| rows.iter().find(can)) else {
            self.show(format!("no {} is running", change.target().1));
            return None;
        };
        Some(KeyCommand::Ask(change, node.node.clone()))
    }

    fn ask(&self, requests: &SyncSender<ChangeRequest>, change: Change, node: String, graph: &GraphView) {
        self.show(format!("{node} is asked"));
        if requests.try_send(ChangeRequest { change, node, graph: graph.clone() }).is_err() {
            self.show("too many changes wait for their nodes; press the key again later".to_owned());
        }
    }

    fn show(&self, text: String) {
        *lock(&self.message) = text;
    }

    /// Returns what draws the screen of `height` lines and `width` columns: each line covers the one before it, so that
    /// nothing flickers.
    fn draw(&mut self, rows: &[NodeRow], (height, width): (u16, u16)) -> String {
        self.selected = self.selected.min(rows.len().saturating_sub(1));
        let (height, width) = (usize::from(height), usize::from(width));
        let line = |text: &str| pad_str(text, width, Alignment::Left, Some("")).into_owned();
        let help = if self.help { &HELP[..] } else { &[] };
        let room = height.saturating_sub(help.len() + 2).max(1);
        let mut lines = self.nodes(rows, room, line);
        lines.resize(room, line(""));
        lines.extend(help.iter().map(|text| line(text)));
        lines.push(line(&printable(&lock(&self.message))));
        lines.push(Style::new().dim().apply_to(line(KEYS)).to_string());
        lines.truncate(height);
        format!("\x1b[H{}", lines.join("\r\n"))
    }

    /// Returns at most `room` lines of the table, the selected one among them.
    fn nodes(&self, rows: &[NodeRow], room: usize, line: impl Fn(&str) -> String) -> Vec<String> {
        if rows.is_empty() {
            return vec![line("No node is running in this domain yet.")];
        }
        let styles = [Style::new(), Style::new().yellow(), Style::new().red()];
        let selected = Style::new().reverse().force_styling(true);
        let mut lines = table(rows).into_iter().map(|text| line(&text));
        let titles = lines.next().map(|titles| Style::new().bold().apply_to(titles).to_string());
        let nodes = rows.iter().zip(lines).enumerate().map(|(index, (row, text))| {
            let text = styles[usize::from(row.level.min(2))].apply_to(text).to_string();
            if index == self.selected { selected.apply_to(text).to_string() } else { text }
        });
        // With the titles, the selected line is the last one that there is room for.
        let hidden = (self.selected + 2).saturating_sub(room);
        titles.into_iter().chain(nodes.skip(hidden)).take(room).collect()
    }
}

#[cfg(test)]
mod tests {
    use console::measure_text_width;

    use super::*;

    fn row(node: &str, changes: &[Change]) -> NodeRow {
        NodeRow { node: node.into(), changes: changes.into(), ..NodeRow::default() }
    }

    fn screen() -> Screen {
        Screen { selected: 0, help: false, message: Arc::default() }
    }

    #[test]
    fn a_key_concerns_the_selected_node_or_the_first_one_that_can() {
        let rows = [row("/a", &[Change::Method]), row("/b", &[Change::Input]), row("/c", &[Change::Input])];
        let mut screen = screen();
        let mut press = |key| screen.press(&key, &rows);
        let input = |node: &str| Some(KeyCommand::Ask(Change::Input, node.into()));
        assert_eq!(press(Key::Char('i')), input("/b"));
        assert_eq!(press(Key::ArrowDown), None);
        assert_eq!(press(Key::ArrowDown), None);
        assert_eq!(press(Key::Char('i')), input("/c"));
        assert_eq!(press(Key::Char('m')), Some(KeyCommand::Ask(Change::Method, "/a".into())));
        assert_eq!(press(Key::Char('+')), None, "there is no camera");
        assert_eq!(press(Key::Char('q')), Some(KeyCommand::Quit));
        assert_eq!(*screen.message.lock().expect("no panic"), "no camera is running");
    }

    #[test]
    fn a_screen_of_any_size_is_filled() {
        let rows = [row("/a", &[]), NodeRow { level: 1, ..row("/b", &[]) }];
        for size in [(24, 80), (2, 10), (1, 1)] {
            for rows in [&rows[..], &[]] {
                for help in [false, true] {
                    let drawn = Screen { help, ..screen() }.draw(rows, size);
                    let lines: Vec<_> = drawn.split("\r\n").map(measure_text_width).collect();
                    assert_eq!(lines, vec![usize::from(size.1); size.0.into()], "{drawn:?}");
                }
            }
        }
    }

    #[test]
    fn the_selected_node_is_shown_where_not_all_have_room() {
        let rows: Vec<_> = (0..9).map(|number| row(&format!("/node{number}"), &[])).collect();
        for selected in 0..9 {
            let drawn = Screen { selected, ..screen() }.draw(&rows, (5, 80));
            assert!(
                drawn.contains("trusted") && drawn.contains(&format!("\x1b[7m/node{selected}")),
                "{drawn:?}"
            );
        }
    }
}
