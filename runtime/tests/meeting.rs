//! Sessions that are opened at the same moment.

#[path = "../../tests/harness/live.rs"]
#[allow(dead_code, reason = "the other tests use the rest")]
mod harness;

use std::io::Write;
use std::sync::{Arc, Barrier, Mutex};

use modulo_runtime::SystemClock;
use modulo_runtime::transport::keys::Hashes;
use modulo_runtime::transport::zenoh::ZenohTransport;

use harness::Domain;

#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().expect("no writer panics").write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Each first run printed "Unable to open listener ... Address already in use" with paths of zenoh's sources.
#[test]
fn sessions_meet_without_a_warning() {
    let lines = Lines::default();
    let writer = lines.clone();
    tracing_subscriber::fmt().with_max_level(tracing::Level::WARN).with_writer(move || writer.clone()).init();
    for _ in 0..5 {
        let domain = Domain::take();
        let start = Barrier::new(8);
        let open = || {
            start.wait();
            ZenohTransport::open(domain.id, Hashes::Rihs01, Arc::new(SystemClock::default()))
                .expect("a session")
        };
        std::thread::scope(|scope| {
            let sessions = [(); 8].map(|()| scope.spawn(open));
            sessions.map(|session| session.join().expect("no panic"))
        });
    }
    let text = String::from_utf8(lines.0.lock().expect("no writer panics").clone()).expect("text");
    assert!(!text.contains("in use"), "{text}");
}
