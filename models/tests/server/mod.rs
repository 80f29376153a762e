//! A server of one file: HTTP/1.1 with ranges, one habit a connection. When
//! the habits are used up, connections are refused.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;

/// How one connection is answered.
#[derive(Clone, Copy, Debug)]
pub enum Habit {
    /// Ranges are honoured.
    Ranges,
    /// Ranges are not known: always all of it.
    Whole,
    /// As `Ranges`, but the connection ends after so many bytes of body.
    Cut(usize),
    /// All of it, its length not announced.
    Unsized,
    /// A status and an empty body.
    Status(u16),
}

/// A server on a port of its own.
pub struct Server {
    /// Address of its file.
    pub url: String,
    thread: JoinHandle<Vec<Option<usize>>>,
}

impl Server {
    /// Serves `body`, a connection for each of `habits`.
    pub fn start(body: &[u8], habits: &[Habit]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}/model.onnx", listener.local_addr().expect("an address"));
        let (body, habits) = (body.to_owned(), habits.to_owned());
        let serve = move || {
            habits.iter().map(|&habit| answer(listener.accept().expect("a client").0, &body, habit)).collect()
        };
        Self { url, thread: std::thread::spawn(serve) }
    }

    /// The start of the range of each request, once all have come.
    pub fn ranges(self) -> Vec<Option<usize>> {
        self.thread.join().expect("the server ran")
    }
}

fn answer(mut stream: TcpStream, body: &[u8], habit: Habit) -> Option<usize> {
    let lines =
        BufReader::new(stream.try_clone().expect("a stream")).lines().map(|line| line.expect("a line"));
    let head: Vec<String> =
        lines.take_while(|line| !line.is_empty()).map(|line| line.to_lowercase()).collect();
    let range =
        head.iter().find_map(|line| line.strip_prefix("range: bytes=")?.strip_suffix('-')?.parse().ok());
    let length = body.len();
    let from = if matches!(habit, Habit::Whole | Habit::Unsized) { None } else { range };
    let rest = body.get(from.unwrap_or(0)..).unwrap_or_default();
    let sized = format!("content-length: {}\r\n", rest.len());
    let (status, fields) = match (habit, from) {
        (Habit::Status(status), _) => (status, "content-length: 0\r\n".to_owned()),
        (_, Some(from)) if from >= length => (416, "content-length: 0\r\n".to_owned()),
        (_, Some(from)) => (206, format!("{sized}content-range: bytes {from}-{}/{length}\r\n", length - 1)),
        (Habit::Unsized, None) => (200, String::new()),
        (_, None) => (200, sized),
    };
    let rest = match habit {
        Habit::Cut(bytes) => &rest[..bytes.min(rest.len())],
        Habit::Status(_) => &[],
        _ => rest,
    };
    let head = format!("HTTP/1.1 {status} As Asked\r\n{fields}connection: close\r\n\r\n");
    // A client that does not like the head hangs up: that is its right.
    let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(rest));
    range
}
