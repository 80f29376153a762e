//! The sockets of the process, which zenoh opens.
//!
//! zenoh 1.10 sets `SO_LINGER` to 10 s on each link. To close a link whose reader stands still then blocks a thread for that time, and
//! the one thread `net-0` also serves all links that this process has dialled: they stand still as well
//! (`tests/peers/linger.py`).

use std::fs;

/// Lets `close` return at once for each socket that the process has now; the system then sends in the background what is left.
pub fn close_without_waiting() {
    let Ok(descriptors) = fs::read_dir("/proc/self/fd") else { return };
    for descriptor in descriptors.flatten() {
        let Some(number) = descriptor.file_name().to_str().and_then(|name| name.parse().ok()) else {
            continue;
        };
        let (option, size) = (libc::linger { l_onoff: 0, l_linger: 0 }, size_of::<libc::linger>());
        let size = libc::socklen_t::try_from(size).expect("the size of two numbers");
        // An error says that this is no socket, or is closed by now.
        #[expect(
            unsafe_code,
            reason = "a function of the C library: the descriptors belong to zenoh, which does not lend them"
        )]
        // SAFETY: `setsockopt` reads `size` bytes of `option`, which lives longer. On a socket of any other part of the program it only
        // sets what new sockets have.
        unsafe {
            libc::setsockopt(number, libc::SOL_SOCKET, libc::SO_LINGER, (&raw const option).cast(), size);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{ErrorKind, Write};
    use std::net::{TcpListener, TcpStream};
    use std::time::{Duration, Instant};

    use socket2::SockRef;

    use super::*;

    #[test]
    fn a_connection_to_a_reader_that_stands_still_is_closed_at_once() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let mut stream = TcpStream::connect(listener.local_addr().expect("bound")).expect("listens");
        let _stands_still = listener.accept().expect("connected");
        let linger = Duration::from_secs(60);
        SockRef::from(&stream).set_linger(Some(linger)).expect("a socket");
        stream.set_nonblocking(true).expect("a socket");
        let full = (0..10_000).find_map(|_| stream.write(&[0; 65_536]).err()).expect("nobody reads");
        assert_eq!(full.kind(), ErrorKind::WouldBlock);
        close_without_waiting();
        let start = Instant::now();
        drop(stream);
        assert!(start.elapsed() < linger / 2, "{:?}", start.elapsed());
    }
}
