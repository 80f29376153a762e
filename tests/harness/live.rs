//! What tests of running nodes need: a ROS domain of their own, and to wait for a condition.

use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use modulo_middleware::transport::zenoh::meeting_port;

/// A ROS domain that no other test on this machine uses until this is dropped.
pub struct Domain {
    /// Its number, 100 to 232.
    pub id: u32,
    _lock: TcpListener,
}

impl Domain {
    /// Takes a free domain: the operating system lets one process listen on its lock port, which lies 300
    /// below the meeting port. A domain where nodes of an earlier test still meet is left out.
    pub fn take() -> Self {
        static TRIED: AtomicU32 = AtomicU32::new(0);
        let listen = |port| TcpListener::bind((Ipv4Addr::LOCALHOST, port));
        for _ in 0..1000 {
            let step = TRIED.fetch_add(1, Ordering::Relaxed);
            // Test programs that run at the same time begin at different numbers, so that they seldom try the
            // same domain.
            let id = 100 + std::process::id().wrapping_add(step) % 133;
            // The lock keeps other tests away, and the second try finds nodes that an earlier test has left
            // running.
            if let Ok(lock) = listen(meeting_port(id) - 300)
                && listen(meeting_port(id)).is_ok()
            {
                return Self { id, _lock: lock };
            }
        }
        panic!("the domains 100 to 232 are all in use: a test before this has left nodes running");
    }
}

/// Waits until `done`.
///
/// # Panics
/// After a minute, with the condition in words.
pub fn wait_until(condition: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "did not happen within a minute: {condition}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
