//! The web server: the page, which holds nothing of the graph, and one WebSocket for each browser, which needs the token.

use std::net::TcpListener;
use std::sync::Arc;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use modulo_runtime::process::stop::Wake;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{Clock, NodeName, Stop, Urgency};
use tokio::sync::{Notify, Semaphore};

use crate::{ViewError, client};

/// Browsers at one time, since each of them costs memory and the encoding of its images.
const BROWSERS: usize = 8;
/// The largest message from the page.
const REQUEST_BYTES: usize = 64 << 10;
/// The page asks nothing from any other place, and no other page may show it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// The session, the clock and the token that all browsers share.
pub(crate) struct Viewer {
    pub transport: ZenohTransport,
    pub node_name: NodeName,
    pub clock: Arc<dyn Clock>,
    token: String,
    seats: Arc<Semaphore>,
}

impl Viewer {
    pub fn new(
        transport: ZenohTransport,
        node_name: NodeName,
        clock: Arc<dyn Clock>,
        token: String,
    ) -> Arc<Self> {
        Arc::new(Self { transport, node_name, clock, token, seats: Arc::new(Semaphore::new(BROWSERS)) })
    }
}

/// Serves the page until `stop` is asked for an end.
pub(crate) async fn serve(viewer: Arc<Viewer>, listener: TcpListener, stop: &Stop) -> Result<(), ViewError> {
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let routes = Router::new()
        .route("/", get(|| file("text/html; charset=utf-8", include_str!("page/index.html"))))
        .route("/viewer.js", get(|| file("text/javascript; charset=utf-8", include_str!("page/viewer.js"))))
        .route("/viewer.css", get(|| file("text/css; charset=utf-8", include_str!("page/viewer.css"))))
        .route("/socket", get(socket))
        .with_state(viewer);
    let end = Arc::new(End(Notify::new()));
    stop.wakes(&end);
    tokio::select! {
        served = axum::serve(listener, routes).into_future() => served?,
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

/// Opens the connection of a browser that knows the token. A page of another place cannot know it.
async fn socket(
    State(viewer): State<Arc<Viewer>>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let given =
        query.as_deref().and_then(|query| query.split('&').find_map(|pair| pair.strip_prefix("token=")));
    if given != Some(&viewer.token) || !is_same_origin(&headers) {
        let why = "The token is missing or wrong: open the address that `modulo view` has printed.";
        return (StatusCode::UNAUTHORIZED, why).into_response();
    }
    let Ok(seat) = viewer.seats.clone().try_acquire_owned() else {
        let why = format!("{BROWSERS} browsers are connected already: close one of them.");
        return (StatusCode::SERVICE_UNAVAILABLE, why).into_response();
    };
    upgrade.max_message_size(REQUEST_BYTES).on_upgrade(move |socket| async move {
        client::serve(viewer, socket).await;
        drop(seat);
    })
}

/// A browser names the place of the page that opens the connection; other programs name none.
fn is_same_origin(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let origin = text(header::ORIGIN)
        .map(|origin| origin.trim_start_matches("http://").trim_start_matches("https://"));
    origin.is_none() || origin == text(header::HOST)
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
