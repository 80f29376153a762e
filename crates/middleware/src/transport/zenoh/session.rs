//! Opening a session: rmw_zenoh's configuration, and how sessions of one machine meet.

use std::fs::{self, DirBuilder, File};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, mpsc};
use std::thread::sleep;
use std::time::Duration;

use zenoh::shm::ShmClientStorage;
use zenoh::{Config, Session, Wait};

use super::TransportError;

/// First of the loopback ports on which sessions meet, one a domain.
const MEETING_PORT: u16 = 7450;

/// A session waits at most this long for the lock: the lock only avoids a warning of zenoh, and its holder may hang.
const PORT_LOCK: Duration = Duration::from_secs(3);
/// Longest wait until everything sent has left: longer than the 2.5 s that zenoh gives a link whose reader stands still, and with
/// [`LINGERING`] shorter than a launcher waits for the end of a node.
const CLOSING: Duration = Duration::from_secs(3);
/// Longest wait for the connections of a closed session.
const LINGERING: Duration = Duration::from_secs(1);
const GLANCE: Duration = Duration::from_millis(10);

/// Returns a session in `domain`, on the meeting port where that is free. Its connections hold `shared` while shared memory is
/// enabled.
pub(super) fn open_session(domain: u32, shared: &Arc<ShmClientStorage>) -> Result<Session, TransportError> {
    let open = |is_host| {
        let opened = zenoh::open(configuration(domain, is_host)?).with_shm_clients(shared.clone()).wait();
        opened.map_err(|why| TransportError::new(format!("zenoh session, domain {domain}"), why))
    };
    // Without the lock, another session may take the port between the look and the opening, of which zenoh would warn.
    let lock = port_lock(domain);
    let free = std::net::TcpListener::bind(("127.0.0.1", meeting_port(domain))).is_ok();
    if free && let Ok(session) = open(true) {
        return Ok(session);
    }
    drop(lock);
    open(false)
}

/// Closes `session`, in at most [`CLOSING`]: zenoh closes the links one after the other, and may wait for each. What is not sent by then
/// is for readers that stand still.
pub(super) fn close(session: &Session) {
    let (session, (closed, is_closed)) = (session.clone(), mpsc::channel());
    let close = move || {
        if let Err(why) = session.close().wait() {
            tracing::warn!("zenoh session did not close: {why}");
        }
        // Nobody waits any more where this took longer.
        let _ = closed.send(());
    };
    match std::thread::Builder::new().name("close".into()).spawn(close) {
        // Also ends where the thread has ended without a word.
        Ok(_) => drop(is_closed.recv_timeout(CLOSING)),
        Err(why) => tracing::warn!("thread that closes the zenoh session: {why}"),
    }
}

/// Waits until no connection of a closed session holds `shared` any more, at most for [`LINGERING`].
pub(super) fn wait_for_connections<T>(shared: &Arc<T>) {
    for _ in 0..LINGERING.as_millis() / GLANCE.as_millis() {
        match Arc::strong_count(shared) {
            // Only the caller: shared memory is not enabled.
            1 => return,
            // The session as well. A connection that has just let go of it still holds the session for a moment.
            2 => return sleep(GLANCE),
            _ => sleep(GLANCE),
        }
    }
}

/// Waits until no other session of this user and `domain` is being opened, at most for [`PORT_LOCK`]. Dropping the file
/// releases the lock. Returns `None` where no file can be locked in this time; sessions then still find each other.
fn port_lock(domain: u32) -> Option<File> {
    let path = own_folder()?.join(format!("modulo-meeting-{}.lock", meeting_port(domain)));
    // The file is only locked and never read, so it stays empty.
    let file = File::options().create(true).append(true).open(&path).ok()?;
    for _ in 0..PORT_LOCK.as_millis() / GLANCE.as_millis() {
        if file.try_lock().is_ok() {
            return Some(file);
        }
        sleep(GLANCE);
    }
    tracing::debug!("{} has been locked for {PORT_LOCK:?}; going on without it", path.display());
    None
}

/// Returns a folder in which no other user can make or lock a file: that of the login session, else a temporary one.
fn own_folder() -> Option<PathBuf> {
    let user = fs::metadata("/proc/self").ok()?.uid();
    let is_own = |folder: &Path| {
        // A link that another user has made there would lead elsewhere.
        fs::symlink_metadata(folder).is_ok_and(|found| found.is_dir() && found.uid() == user)
    };
    let session = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    if let Some(folder) = session.filter(|folder| is_own(folder)) {
        return Some(folder);
    }
    let folder = std::env::temp_dir().join(format!("modulo-{user}"));
    // Fails where the folder is there already.
    let _ = DirBuilder::new().mode(0o700).create(&folder);
    is_own(&folder).then_some(folder)
}

/// Returns the loopback port on which the sessions of `domain` meet.
pub fn meeting_port(domain: u32) -> u16 {
    u16::try_from(domain).unwrap_or(u16::MAX).saturating_add(MEETING_PORT)
}

fn configuration(domain: u32, is_host: bool) -> Result<Config, TransportError> {
    let mut config = match std::env::var("ZENOH_SESSION_CONFIG_URI") {
        Ok(path) if !path.is_empty() => Config::from_file(&path)
            .map_err(|why| TransportError::new(format!("ZENOH_SESSION_CONFIG_URI = {path}"), why))?,
        _ => {
            let mut config = Config::default();
            for (key, value) in defaults(domain, is_host) {
                insert(&mut config, key, &value)?;
            }
            config
        }
    };
    // After the file or the defaults, so that one key can be changed without a file.
    let overrides = std::env::var("ZENOH_CONFIG_OVERRIDE").unwrap_or_default();
    for pair in overrides.split(';').filter(|pair| !pair.trim().is_empty()) {
        let (key, value) = pair.split_once('=').ok_or_else(|| {
            TransportError::new("ZENOH_CONFIG_OVERRIDE", format!("'{pair}' is not key=json5"))
        })?;
        insert(&mut config, key.trim(), value.trim())
            .map_err(|why| TransportError::new("ZENOH_CONFIG_OVERRIDE", why))?;
    }
    Ok(config)
}

fn insert(config: &mut Config, key: &str, value: &str) -> Result<(), TransportError> {
    config
        .insert_json5(key, value)
        .map_err(|why| TransportError::new(format!("zenoh configuration {key} = {value}"), why))
}

/// Returns rmw_zenoh's session, plus the meeting port, plus queues that hold a whole image: with zenoh's default of two
/// batches a 1.4 MB image is dropped as soon as its reader is a millisecond late. The host of the sessions of a machine listens on
/// the meeting port; all others connect to it, again and again if they must.
fn defaults(domain: u32, is_host: bool) -> Vec<(&'static str, String)> {
    let meeting = format!("\"tcp/127.0.0.1:{}\"", meeting_port(domain));
    let (mut listen, mut connect) = (String::new(), String::new());
    *if is_host { &mut listen } else { &mut connect } = format!(", {meeting}");
    vec![
        ("mode", "\"peer\"".into()),
        ("connect/endpoints", format!("[\"tcp/127.0.0.1:7447\"{connect}]")),
        // Without a limit: the other session may come at any time.
        ("connect/timeout_ms", "-1".into()),
        ("connect/exit_on_failure", "false".into()),
        ("connect/retry", "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }".into()),
        ("listen/endpoints", format!("[\"tcp/127.0.0.1:0\"{listen}]")),
        ("listen/exit_on_failure", "true".into()),
        ("listen/timeout_ms", "0".into()),
        // A session also works without any other session.
        ("open/return_conditions/connect_scouted", "false".into()),
        // As in rmw_zenoh: sessions learn of each other by gossip and never by multicast.
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "true".into()),
        // The cache for late readers needs the time of each sample.
        ("timestamping/enabled", "true".into()),
        ("queries_default_timeout", "600000".into()),
        // One key turns it on: large payloads then go through shared memory.
        ("transport/shared_memory/enabled", "false".into()),
        // In bytes. Smaller payloads gain nothing, and a node that sends only such needs no pool of 16 MiB.
        ("transport/shared_memory/transport_optimization/message_size_threshold", "65536".into()),
        // As in rmw_zenoh: a session may stand still for a minute before the others close their links to it.
        ("transport/link/tx/lease", "60000".into()),
        ("transport/link/tx/keep_alive", "24".into()),
        // In bytes; a larger message is dropped where it arrives.
        ("transport/link/rx/max_message_size", "134217728".into()),
        // What announces sessions and endpoints waits for every reader, so that there must be room for it.
        ("transport/link/tx/queue/size/control", "16".into()),
        ("transport/link/tx/queue/size/data", "16".into()),
        // In microseconds. A publisher waits once for each reader that stands still: three of them must not keep it from all others for long.
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "20000".into()),
        ("transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments", "50000".into()),
    ]
}

/// Returns a domain, with a number above those of ROS 2, in which no test of another process meets.
#[cfg(test)]
pub(super) fn free_domain() -> u32 {
    // Two tests of one process get two domains.
    static TRIED: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let step = || TRIED.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let is_free = |domain: &u32| std::net::TcpListener::bind(("127.0.0.1", meeting_port(*domain))).is_ok();
    let numbers = std::iter::repeat_with(|| 1000 + std::process::id().wrapping_add(step()) % 20_000);
    numbers.take(1000).find(|domain| is_free(domain)).expect("a free port")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_that_lingers_is_waited_for() {
        let shared = Arc::new(());
        let (_session, connection) = (shared.clone(), shared.clone());
        let lingering = std::thread::spawn(move || {
            sleep(5 * GLANCE);
            drop(connection);
        });
        wait_for_connections(&shared);
        assert_eq!(Arc::strong_count(&shared), 2);
        lingering.join().expect("no panic");
    }
}
