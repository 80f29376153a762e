//! The viewer node: one web page with the streams of a running suite, the boxes of its detectors, latencies, and controls that
//! set the real parameters.
//!
//! ```text
//! topics -> Streams (newest few images, boxes by stamp) -> one WebSocket for each browser -> page
//! page -> PageRequest -> parameter and player services
//! ```
//!
//! The viewer is a reader as any other: nodes never wait for it, it keeps at most [`streams::KEPT_BYTES`] of images for each
//! topic and browser, and sends the next image of a topic only when the browser has drawn the last one. A token, which is part of
//! the printed address, is needed for everything but the empty page.

mod client;
pub mod protocol;
mod server;
pub mod streams;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;

use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::transport::{Transport as _, TransportError};
use modulo_runtime::{Clock, NodeName, Stop};

/// Name of the node in the graph.
const NODE: &str = "viewer";

/// Where the page is served, and who may use it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewOptions {
    /// Address and port; port 0 takes a free one.
    pub address: SocketAddr,
    /// The token of the address; a random one for `None`.
    pub token: Option<String>,
}

/// Error: the viewer cannot run.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The address cannot be listened on.
    #[error("{0}: {1}; choose another one with --address or --port")]
    Listen(SocketAddr, io::Error),
    /// The operating system gives no random numbers for the token.
    #[error("no random numbers for the token: {0}; give one with --token")]
    Random(getrandom::Error),
    /// The server failed.
    #[error("web server: {0}")]
    Serve(#[from] io::Error),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// Serves the page until `stop` is asked for an end. `ready` gets the address to open, with the token, once a browser can connect.
///
/// # Errors
/// [`ViewError`] when the address is taken or the transport fails.
pub fn run(
    transport: ZenohTransport,
    clock: Arc<dyn Clock>,
    options: &ViewOptions,
    stop: &Stop,
    ready: impl FnOnce(&str),
) -> Result<(), ViewError> {
    let token = match &options.token {
        Some(token) => token.clone(),
        None => random_token().map_err(ViewError::Random)?,
    };
    let taken = |why| ViewError::Listen(options.address, why);
    let listener = TcpListener::bind(options.address).map_err(taken)?;
    let address = listener.local_addr().map_err(taken)?;
    let node_name = NodeName { name: NODE.into(), namespace: "/".into(), remaps: Vec::new() };
    let _announced = transport.announce(&node_name)?;
    let viewer = server::Viewer::new(transport, node_name, clock, token.clone());
    // Two threads: zenoh may not be called from a runtime of one.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    ready(&format!("http://{address}/?token={token}"));
    runtime.block_on(server::serve(viewer, listener, stop))?;
    // A call that still waits for its node must not hold up the end.
    runtime.shutdown_background();
    Ok(())
}

/// Returns 128 random bits in hexadecimal digits.
fn random_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
