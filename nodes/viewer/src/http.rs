//! The HTTP server: how many connections there are, and how long each of them may take.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::serve::Listener;
use hyper_util::rt::{TokioExecutor, TokioIo};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::timeout;

/// Connections at one time, without those that have become a WebSocket; further ones wait.
const CONNECTIONS: usize = 64;
/// Time within which a client has sent its requests and taken the answers. A client that sends half a request would otherwise hold its
/// connection for ever.
pub(crate) const EXCHANGE: Duration = Duration::from_secs(10);

/// Answers the requests of `routes` without end. A connection is closed after `limit`, unless it has become a WebSocket.
pub(crate) async fn answer(mut listener: TcpListener, routes: Router, limit: Duration) {
    let connections = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let room = connections.clone().acquire_owned().await.expect("the semaphore is never closed");
        let (stream, _) = Listener::accept(&mut listener).await;
        let service = TowerToHyperService::new(routes.clone());
        tokio::spawn(async move {
            let server = Builder::new(TokioExecutor::new());
            // How a connection ends matters to its client alone.
            let _ =
                timeout(limit, server.serve_connection_with_upgrades(TokioIo::new(stream), service)).await;
            drop(room);
        });
    }
}

#[cfg(test)]
mod tests {
    use axum::extract::ws::{Message, WebSocketUpgrade};
    use axum::routing::get;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpStream;

    use super::*;

    const LIMIT: Duration = Duration::from_millis(300);

    /// Returns a connection on which `request` was sent.
    async fn ask(address: std::net::SocketAddr, request: &str) -> TcpStream {
        let mut stream = TcpStream::connect(address).await.expect("a connection");
        stream.write_all(request.as_bytes()).await.expect("sent");
        stream
    }

    /// Reads all that comes until the connection is closed.
    async fn all(mut stream: TcpStream) -> String {
        let mut bytes = Vec::new();
        // Closed, with or without a reset.
        let _ = timeout(Duration::from_secs(60), stream.read_to_end(&mut bytes)).await.expect("it is closed");
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// A thousand halves of a request stayed open for ever, so that nobody else could connect.
    #[tokio::test]
    async fn clients_that_send_half_a_request_make_room_for_others() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("bound");
        let later = |upgrade: WebSocketUpgrade| async {
            upgrade.on_upgrade(|mut socket| async move {
                tokio::time::sleep(4 * LIMIT).await;
                let _ = socket.send(Message::text("later")).await;
            })
        };
        let routes = Router::new().route("/", get(|| async { "the page" })).route("/socket", get(later));
        tokio::spawn(answer(listener, routes, LIMIT));
        let mut halves = Vec::new();
        for _ in 0..2 * CONNECTIONS {
            halves.push(ask(address, "GET / HTTP/1.1\r\nHost: ").await);
        }
        let page = all(ask(address, "GET / HTTP/1.1\r\nHost: x\r\n\r\n").await).await;
        assert!(page.starts_with("HTTP/1.1 200") && page.ends_with("the page"), "{page}");
        for half in halves {
            assert_eq!(all(half).await, "");
        }
        let upgrade = "Connection: upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==";
        let socket =
            all(ask(address, &format!("GET /socket HTTP/1.1\r\nHost: x\r\n{upgrade}\r\n\r\n")).await).await;
        assert!(
            socket.starts_with("HTTP/1.1 101") && socket.contains("later"),
            "a WebSocket stays: {socket}"
        );
    }
}
