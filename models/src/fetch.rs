//! [`fetch`]: one file over HTTP, resumed where it broke off, kept only when
//! its sha256 is right. Never overwrites a file that is something else.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use ureq::http::{Response, Uri, header};
use ureq::{Agent, Body};

use crate::part::{Part, sha256_of};

/// Largest file that is fetched, bytes.
pub const LIMIT: u64 = 512 << 20;
const CONNECT: Duration = Duration::from_secs(10);
/// A large file on a slow line may take hours, but not without a byte for this long.
const STALL: Duration = Duration::from_secs(30);

/// What to fetch.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// `http://` or `https://`.
    pub url: &'a str,
    /// Where it goes; its folder is made.
    pub file: &'a Path,
    /// 64 hex digits.
    pub sha256: &'a str,
    /// Length, where known: a server that announces another is not listened to.
    pub bytes: Option<u64>,
}

/// How the file came to be there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetched {
    /// It was downloaded, or the rest of it.
    Downloaded,
    /// It was there, with the right sha256.
    AlreadyThere,
}

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    /// The URL is none.
    #[error("url '{url}': must be http://HOST/... or https://HOST/...")]
    Url {
        /// As given.
        url: String,
    },
    /// The sha256 is none.
    #[error("sha256 '{0}': must be 64 hex digits")]
    Sha256(String),
    /// No answer.
    #[error(
        "cannot reach {host}: {why}; download {url} on another machine and copy it to {}, \
         or set a mirror with --url",
        file.display()
    )]
    Offline {
        /// The host asked.
        host: String,
        /// What failed.
        why: String,
        /// The URL.
        url: String,
        /// Where it should lie.
        file: PathBuf,
    },
    /// An answer, but no file.
    #[error("{url}: the server answered {status}, needed is 200; set another address with --url")]
    Status {
        /// The URL.
        url: String,
        /// The HTTP status.
        status: u16,
    },
    /// The connection ended before the file did.
    #[error("{url}: broken off after {got} bytes: {why}; the same command goes on from there")]
    Cut {
        /// The URL.
        url: String,
        /// Bytes that are there now.
        got: u64,
        /// What failed.
        why: String,
    },
    /// Longer or shorter than it may be.
    #[error("{url}: has {got} bytes, allowed is {allowed}")]
    Size {
        /// The URL.
        url: String,
        /// Bytes announced, or received so far.
        got: u64,
        /// In words.
        allowed: String,
    },
    /// All bytes came, but not the right ones.
    #[error("{url}: sha256 is {got}, expected is {expected}; what was downloaded is removed")]
    Wrong {
        /// The URL.
        url: String,
        /// Of the bytes that came.
        got: String,
        /// As asked.
        expected: String,
    },
    /// There is another file at the place.
    #[error(
        "{}: is there already with sha256 {got}, expected is {expected}; move it away or choose another folder",
        file.display()
    )]
    Occupied {
        /// The file.
        file: PathBuf,
        /// Of the file.
        got: String,
        /// As asked.
        expected: String,
    },
    /// The disk said no.
    #[error("{}: {why}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What the system said.
        why: io::Error,
    },
}

/// Fetches a file, or finds it there. `progress` is told the bytes that are
/// there and, where the server says so, the bytes of the whole.
///
/// A download that breaks off leaves `<file>.part`; the next call goes on from
/// it with a `Range` request where the server can.
///
/// # Errors
/// [`FetchError`]. The file is then not there; a part of it may be.
pub fn fetch(request: &Request<'_>, progress: &dyn Fn(u64, Option<u64>)) -> Result<Fetched, FetchError> {
    if request.sha256.len() != 64 || !request.sha256.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Err(FetchError::Sha256(request.sha256.to_owned()));
    }
    let host = host(request.url).ok_or_else(|| FetchError::Url { url: request.url.to_owned() })?;
    if let Some(got) = sha256_of(request.file).map_err(|why| request.disk(why))? {
        return request.right(&got).then_some(Fetched::AlreadyThere).ok_or_else(|| request.occupied(got));
    }
    let mut part = open(request).map_err(|why| request.disk(why))?;
    if !request.right(&part.sha256())
        && let Err(why) = download(request, &host, &mut part, progress)
    {
        if part.len() == 0 {
            part.remove().map_err(|why| request.disk(why))?;
        }
        return Err(why);
    }
    let got = part.sha256();
    if !request.right(&got) {
        part.remove().map_err(|why| request.disk(why))?;
        let (url, expected) = (request.url.to_owned(), request.sha256.to_owned());
        return Err(FetchError::Wrong { url, got, expected });
    }
    part.keep(request.file).map_err(|why| request.disk(why))?;
    Ok(Fetched::Downloaded)
}

impl Request<'_> {
    fn right(&self, sha256: &str) -> bool {
        self.sha256.eq_ignore_ascii_case(sha256)
    }

    fn disk(&self, why: io::Error) -> FetchError {
        FetchError::File { file: self.file.to_owned(), why }
    }

    fn occupied(&self, got: String) -> FetchError {
        FetchError::Occupied { file: self.file.to_owned(), got, expected: self.sha256.to_owned() }
    }

    fn cut(&self, got: u64, why: impl ToString) -> FetchError {
        FetchError::Cut { url: self.url.to_owned(), got, why: why.to_string() }
    }

    /// Judges a length that the server announces.
    fn judge(&self, announced: u64) -> Result<(), FetchError> {
        let allowed = match self.bytes {
            Some(bytes) if bytes != announced => bytes.to_string(),
            None if announced > LIMIT => format!("at most {LIMIT}"),
            _ => return Ok(()),
        };
        Err(FetchError::Size { url: self.url.to_owned(), got: announced, allowed })
    }
}

fn open(request: &Request<'_>) -> io::Result<Part> {
    if let Some(folder) = request.file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    Part::open(request.file)
}

fn download(
    request: &Request<'_>,
    host: &str,
    part: &mut Part,
    progress: &dyn Fn(u64, Option<u64>),
) -> Result<(), FetchError> {
    let mut response = ask(request, host, part.len())?;
    if !continues(&response, part.len()) {
        // A server without ranges, or one that has no such range: the part is
        // of no use.
        part.restart().map_err(|why| request.disk(why))?;
        if response.status() != 200 {
            response = ask(request, host, 0)?;
        }
    }
    if !matches!(response.status().as_u16(), 200 | 206) {
        return Err(FetchError::Status { url: request.url.to_owned(), status: response.status().as_u16() });
    }
    let total = response.body().content_length().map(|rest| rest.saturating_add(part.len()));
    if let Some(total) = total {
        request.judge(total)?;
    }
    receive(request, response, part, &|got| progress(got, total.or(request.bytes)))?;
    match total.or(request.bytes) {
        Some(total) if part.len() < total => Err(request.cut(part.len(), format!("{total} were announced"))),
        _ => Ok(()),
    }
}

/// Whether what comes follows the first `have` bytes. An answer without a file
/// says nothing about those, and they stay.
fn continues(response: &Response<Body>, have: u64) -> bool {
    match response.status().as_u16() {
        206 => {
            let range = response.headers().get(header::CONTENT_RANGE).and_then(|range| range.to_str().ok());
            let start = range.and_then(|range| range.strip_prefix("bytes ")?.split_once('-'));
            start.and_then(|(start, _)| start.trim().parse().ok()) == Some(have)
        }
        200 | 416 => have == 0,
        _ => true,
    }
}

/// The host of an HTTP URL.
fn host(url: &str) -> Option<String> {
    let uri: Uri = url.parse().ok()?;
    uri.host().filter(|_| matches!(uri.scheme_str(), Some("http" | "https"))).map(str::to_owned)
}

fn ask(request: &Request<'_>, host: &str, from: u64) -> Result<Response<Body>, FetchError> {
    let mut call = agent(host, STALL).get(request.url);
    if from > 0 {
        call = call.header(header::RANGE, format!("bytes={from}-"));
    }
    call.call().map_err(|why| FetchError::Offline {
        host: host.to_owned(),
        why: reason(why),
        url: request.url.to_owned(),
        file: request.file.to_owned(),
    })
}

fn agent(host: &str, stall: Duration) -> Agent {
    let mut config = Agent::config_builder()
        .http_status_as_error(false)
        .timeout_resolve(Some(CONNECT))
        .timeout_connect(Some(CONNECT))
        .timeout_per_read(Some(stall))
        .user_agent(concat!("modulo/", env!("CARGO_PKG_VERSION")));
    if matches!(host, "127.0.0.1" | "[::1]" | "localhost") {
        // A proxy's own loopback is never what is meant.
        config = config.proxy(None);
    }
    config.build().new_agent()
}

fn reason(why: ureq::Error) -> String {
    match why {
        ureq::Error::HostNotFound => "no such host, or no network".to_owned(),
        ureq::Error::Io(why) => why.to_string(),
        why => why.to_string(),
    }
}

fn receive(
    request: &Request<'_>,
    response: Response<Body>,
    part: &mut Part,
    progress: &dyn Fn(u64),
) -> Result<(), FetchError> {
    let limit = request.bytes.unwrap_or(LIMIT);
    let mut reader = response.into_body().into_reader();
    let mut buffer = vec![0; 1 << 16];
    loop {
        let read = reader.read(&mut buffer).map_err(|why| request.cut(part.len(), why))?;
        if read == 0 {
            return Ok(());
        }
        part.append(&buffer[..read]).map_err(|why| request.disk(why))?;
        if part.len() > limit {
            let (url, got) = (request.url.to_owned(), part.len());
            part.restart().map_err(|why| request.disk(why))?;
            return Err(FetchError::Size { url, got, allowed: format!("at most {limit}") });
        }
        progress(part.len());
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_server_that_says_nothing_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}/", listener.local_addr().expect("an address"));
        let why = agent("127.0.0.1", Duration::from_millis(50)).get(url).call().expect_err("silence");
        assert!(matches!(why, ureq::Error::Timeout(ureq::Timeout::PerRead)), "{why}");
    }

    #[test]
    fn sizes_are_judged_before_a_byte_comes() {
        let with = |bytes| Request { url: "u", file: Path::new("f"), sha256: "", bytes };
        assert!(with(None).judge(LIMIT).is_ok());
        assert!(with(None).judge(LIMIT + 1).is_err());
        assert!(with(Some(7)).judge(7).is_ok());
        assert!(with(Some(7)).judge(6).is_err());
        assert!(with(Some(LIMIT + 1)).judge(LIMIT + 1).is_ok(), "a pinned length is trusted");
    }
}
