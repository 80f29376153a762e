//! The viewer node: one web page with the streams of a running suite, the boxes of its detectors, latencies, and controls that
//! set the real parameters.
//!
//! ```text
//! topics -> Streams (newest few images, boxes by stamp) -> moments -> one WebSocket for each browser -> page
//! page -> PageRequest -> parameter and player services
//! topics -> Streams -> moments -> Recording -> a page as one file
//! topics -> Streams -> channels of the Foxglove protocol -> Foxglove, Lichtblick
//! ```
//!
//! The viewer is a reader as any other: nodes never wait for it, it keeps at most 64 MiB of images for each
//! topic and browser, and sends the next images only when the browser has drawn the last ones. A token, which is part of
//! the printed address, is needed for everything but the empty page.

mod cameras;
mod client;
mod expose;
mod foxglove;
mod graph;
mod http;
mod page;
mod protocol;
mod record;
mod sent;
mod shown;
mod streams;
mod watch;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_middleware::transport::{Transport as _, TransportError};
use modulo_runtime::output::replace;
use modulo_runtime::stop::Wake;
use modulo_runtime::{Clock, NodeName, Stop, Urgency};
use rand::TryRng as _;
use rand::rngs::{SysError, SysRng};
use tokio::sync::{Notify, Semaphore};

use crate::expose::Exposer;
pub use crate::expose::FindBoxes;
use crate::graph::Session;
use crate::page::PageFile;
pub use crate::page::RECORDING_BEGIN;
use crate::record::Recording;

const NODE: &str = "viewer";

/// Where the page is served, and who may use it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewOptions {
    /// Address and port; port 0 takes a free one.
    pub address: SocketAddr,
    /// The token of the address; a random one for `None`.
    pub token: Option<String>,
    /// The port for Foxglove, on the same address, if it is served; port 0 takes a free one.
    pub foxglove: Option<u16>,
    /// The file that gets a page with the last minute at the end.
    pub record: Option<PathBuf>,
}

/// The addresses of a viewer that is ready.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewAddresses {
    /// The page, with the token.
    pub page: String,
    /// The address for Foxglove.
    pub foxglove: Option<String>,
    /// The token.
    pub token: String,
}

/// Error: the viewer cannot run.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// An address cannot be listened on, there is no token, or the recording cannot be written. The text has a remedy.
    #[error("{0}")]
    Setup(String),
    /// The server failed.
    #[error("web server: {0}")]
    Serve(#[from] io::Error),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// Serves the page until `stop` is asked for an end. `find` looks at pictures that are exposed anew, and `ready` gets the addresses once
/// clients can connect. Returns the number of moments that were too large for the recording.
///
/// # Errors
/// [`ViewError`] when the address is taken or the transport fails.
pub fn run(
    transport: ZenohTransport,
    clock: Arc<dyn Clock>,
    options: &ViewOptions,
    stop: &Stop,
    find: Box<FindBoxes>,
    ready: impl FnOnce(&ViewAddresses),
) -> Result<usize, ViewError> {
    let no_random = |why: SysError| {
        ViewError::Setup(format!("no random numbers for the token: {why}; give one with --token"))
    };
    let token = options.token.clone().map_or_else(random_token, Ok).map_err(no_random)?;
    let (listener, address) = listen(options.address)?;
    let page = format!("http://{address}/?token={token}");
    let mut addresses = ViewAddresses { page, foxglove: None, token: token.clone() };
    let node_name = NodeName { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() };
    let _announced = transport.announce(&node_name)?;
    let session = Arc::new(Session { transport, node_name, clock });
    // Two threads: zenoh may not be called from a runtime of one.
    let recording = Arc::new(Mutex::new(Recording::default()));
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    runtime.block_on(async {
        if let Some(port) = options.foxglove {
            let address = SocketAddr::new(address.ip(), port);
            let port = serve_foxglove(session.clone(), address, token.clone()).await?;
            addresses.foxglove = Some(format!("ws://{}", SocketAddr::new(address.ip(), port)));
        }
        if options.record.is_some() {
            tokio::spawn(record::record(session.clone(), recording.clone()));
        }
        ready(&addresses);
        let seats = Arc::new(Semaphore::new(BROWSERS));
        let exposer = Mutex::new(Exposer::new(find));
        serve(Arc::new(Viewer { session, token, seats, exposer }), listener, stop).await
    })?;
    // A call that still waits for its node must not hold up the end.
    runtime.shutdown_background();
    let recording = recording.lock().unwrap_or_else(PoisonError::into_inner);
    options.record.as_deref().map_or(Ok(0), |file| save(&recording, file))
}

/// Listens on `address`. Returns the address with the port that the system chose for port 0.
fn listen(address: SocketAddr) -> Result<(TcpListener, SocketAddr), ViewError> {
    let in_use = |why: io::Error| {
        let other = if why.kind() == io::ErrorKind::AddrInUse { "--port" } else { "--address" };
        ViewError::Setup(format!("{address}: {why}; choose another one with {other}"))
    };
    let listener = TcpListener::bind(address).map_err(in_use)?;
    let bound = listener.local_addr().map_err(in_use)?;
    Ok((listener, bound))
}

/// Writes the page of a recording. Returns the number of moments that were too large for it.
fn save(recording: &Recording, file: &Path) -> Result<usize, ViewError> {
    let name = file.display();
    let lost = |why: io::Error| ViewError::Setup(format!("{name}: {why}; the recording is lost"));
    replace(file, recording.page().as_bytes()).map_err(lost)?;
    Ok(recording.too_large)
}

/// Serves Foxglove in the background. Returns its port.
async fn serve_foxglove(session: Arc<Session>, address: SocketAddr, token: String) -> Result<u16, ViewError> {
    let server = foxglove::FoxgloveServer::start(session, address, token).await;
    let remedy = "choose another port with --foxglove PORT";
    let server = server.map_err(|why| ViewError::Setup(format!("Foxglove on {address}: {why}; {remedy}")))?;
    let port = server.port();
    tokio::spawn(server.serve());
    Ok(port)
}

/// Returns 128 random bits in hexadecimal digits.
fn random_token() -> Result<String, SysError> {
    let mut bytes = [0; 16];
    SysRng.try_fill_bytes(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Browsers at one time, since each of them costs memory and the encoding of its images.
const BROWSERS: usize = 8;
/// The largest message from the page.
const REQUEST_BYTES: usize = 64 << 10;
/// The page asks nothing from any other place, and no other page may show it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// The session and the token that all browsers share.
pub(crate) struct Viewer {
    pub session: Arc<Session>,
    token: String,
    seats: Arc<Semaphore>,
    pub exposer: Mutex<Exposer>,
}

/// Serves the page until `stop` is asked for an end.
pub(crate) async fn serve(viewer: Arc<Viewer>, listener: TcpListener, stop: &Stop) -> Result<(), ViewError> {
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut routes = Router::new()
        .route("/", get(|| file("text/html; charset=utf-8", page::DOCUMENT)))
        .route("/socket", get(socket).post(socket))
        .fallback(elsewhere)
        .with_state(viewer);
    for &PageFile { path, kind, text } in page::FILES {
        routes = routes.route(path, get(move || file(kind, text)));
    }
    let end = Arc::new(End(Notify::new()));
    stop.wakes(&end);
    tokio::select! {
        () = http::answer(listener, routes, http::EXCHANGE) => {}
        () = end.reached(stop) => {}
    }
    Ok(())
}

async fn file(kind: &'static str, text: &'static str) -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, text)
}

/// Opens the connection of a browser that knows the token. A page of another place cannot know it. A script of the page that has failed to
/// connect asks without an upgrade, since only such a request shows it the reason.
async fn socket(
    State(viewer): State<Arc<Viewer>>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let given =
        query.as_deref().and_then(|query| query.split('&').find_map(|pair| pair.strip_prefix("token=")));
    if given != Some(&viewer.token) {
        let why = "The token is missing or wrong: open the address that `modulo view` has printed.";
        return (StatusCode::UNAUTHORIZED, why).into_response();
    }
    if let Some(why) = other_origin(&headers) {
        return (StatusCode::FORBIDDEN, why).into_response();
    }
    let Ok(seat) = viewer.seats.clone().try_acquire_owned() else {
        let why = format!("{BROWSERS} browsers are connected already: close one of them.");
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    let Ok(upgrade) = upgrade else {
        let why = "The viewer expects a WebSocket: a reverse proxy must pass on the headers Upgrade and Connection.";
        return (StatusCode::UPGRADE_REQUIRED, why).into_response();
    };
    upgrade.max_message_size(REQUEST_BYTES).on_upgrade(move |socket| async move {
        client::serve(viewer, socket).await;
        drop(seat);
    })
}

/// Returns why a page of this origin is not served. A browser names the place of the page that opens the connection; other programs name
/// none.
fn other_origin(headers: &HeaderMap) -> Option<String> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let (origin, host) = (text(header::ORIGIN)?, text(header::HOST).unwrap_or_default());
    let place = origin.trim_start_matches("http://").trim_start_matches("https://");
    (place != host).then(|| {
        format!(
            "The page is one of {origin}, but was asked for at {host}: behind a reverse proxy, the proxy must pass on the host that the browser \
             asks for, as nginx does with `proxy_set_header Host $http_host;`."
        )
    })
}

async fn elsewhere() -> impl IntoResponse {
    let why = "The viewer has no such page: a reverse proxy that serves it below a path must take off the path, as nginx does with a slash at the \
               end of `proxy_pass`.";
    (StatusCode::NOT_FOUND, why)
}

/// Wakes the server when the process is asked for an end.
struct End(Notify);

impl Wake for End {
    fn wake(&self) {
        self.0.notify_one();
    }
}

impl End {
    async fn reached(&self, stop: &Stop) {
        // A wake before this wait is kept, so that it is never missed.
        while stop.urgency() == Urgency::None {
            self.0.notified().await;
        }
    }
}
