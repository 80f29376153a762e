use std::fs::{self, File, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;
use ureq::Agent;
use ureq::http::Uri;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

/// Largest file that is fetched when the request does not state a length, bytes.
pub const LIMIT: u64 = 512 << 20;
const CONNECT: Duration = Duration::from_secs(10);
/// A large file on a slow line may take hours, but some byte must arrive within this time.
const STALL: Duration = Duration::from_secs(30);

/// A file to fetch.
#[derive(Clone, Debug)]
pub struct FetchRequest<'a> {
    /// Address, `http://HOST/...` or `https://HOST/...`.
    pub url: &'a str,
    /// Path of the file to write; its folder is created.
    pub file: &'a Path,
    /// Expected sha256, 64 hex digits.
    pub sha256: &'a str,
    /// Expected length in bytes, if it is known.
    pub bytes: Option<u64>,
}

/// The result of a successful fetch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fetched {
    /// The file was downloaded.
    Downloaded,
    /// The file existed already, with the expected sha256.
    AlreadyThere,
}

/// Error: the file could not be fetched. The text says why, with a remedy where there is one.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct FetchError(pub(crate) String);

/// Downloads a file, or finds that it exists already. `progress` is called with the bytes received so far and, if it is
/// known, the length of the file.
///
/// The download goes to a temporary file beside the target, which it replaces in one step when it is complete and its
/// sha256 is right. An existing file is never overwritten.
///
/// # Errors
/// [`FetchError`]. Then nothing was written.
pub fn fetch(request: &FetchRequest<'_>, progress: &dyn Fn(u64, Option<u64>)) -> Result<Fetched, FetchError> {
    let expected = request.sha256.to_ascii_lowercase();
    if expected.len() != 64 || !expected.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Err(FetchError(format!("sha256 '{}': must be 64 hex digits", request.sha256)));
    }
    // An existing file is compared before the server is asked, so that a fetched model needs no network any more.
    let file = request.file.display();
    let disk = |why: io::Error| FetchError(format!("{file}: {why}"));
    match sha256_of(request.file) {
        Ok(found) if found == expected => return Ok(Fetched::AlreadyThere),
        Ok(found) => {
            return Err(FetchError(format!(
                "{file}: exists already with sha256 {found}, expected is {expected}; move it away or choose another folder"
            )));
        }
        Err(why) if why.kind() == io::ErrorKind::NotFound => {}
        Err(why) => return Err(disk(why)),
    }
    let uri = request.url.parse::<Uri>().ok();
    let uri = uri.filter(|uri| matches!(uri.scheme_str(), Some("http" | "https")) && uri.host().is_some());
    let url = request.url;
    let no_url = || FetchError(format!("url '{url}': must be http://HOST/... or https://HOST/..."));
    let agent = agent(&uri.ok_or_else(no_url)?, STALL)?;
    let folder = request.file.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(disk)?;
    // A temporary file is readable for its owner only. The model gets the mode of any new file, so that the umask
    // decides. It lies in the folder of the target, because a file can only be renamed within one file system.
    let mode = Permissions::from_mode(0o666);
    let mut fetched = tempfile::Builder::new().permissions(mode).tempfile_in(folder).map_err(disk)?;
    let found = request.download(&agent, &mut fetched, progress)?;
    if found != expected {
        let why = format!("sha256 is {found}, expected is {expected}; the downloaded file was removed");
        return Err(FetchError(format!("{url}: {why}")));
    }
    // Without the synchronisation a power failure could leave a file of the right name without its content. Another
    // process may have written the target in the meantime: it is never overwritten.
    fetched.as_file().sync_all().map_err(disk)?;
    fetched.persist_noclobber(request.file).map_err(|why| disk(why.error))?;
    Ok(Fetched::Downloaded)
}

impl FetchRequest<'_> {
    /// Writes the file at the URL to `file`; returns its sha256.
    fn download(
        &self,
        agent: &Agent,
        file: &mut NamedTempFile,
        progress: &dyn Fn(u64, Option<u64>),
    ) -> Result<String, FetchError> {
        let (url, name) = (self.url, self.file.display());
        let remedy = "download it on another machine and copy it to";
        let offline = |why| {
            FetchError(format!("cannot reach {url}: {why}; {remedy} {name}, or set a mirror with --url"))
        };
        let cut = |got: u64, why: String| {
            FetchError(format!("{url}: the connection broke after {got} bytes: {why}; run the command again"))
        };
        let response = agent.get(url).call().map_err(offline)?;
        if response.status() != 200 {
            let why = format!("the server answered {}, needed is 200", response.status().as_u16());
            return Err(FetchError(format!("{url}: {why}; set another address with --url")));
        }
        // The announced length can be missing or wrong: a server must not be able to fill the disk.
        let total = response.body().content_length();
        total.map_or(Ok(()), |total| self.check_length(total, true))?;
        let mut body = response.into_body().into_reader();
        let (mut hash, mut got, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 16]);
        while let read @ 1.. = body.read(&mut buffer).map_err(|why| cut(got, why.to_string()))? {
            got += read as u64;
            self.check_length(got, false)?;
            hash.update(&buffer[..read]);
            file.write_all(&buffer[..read]).map_err(|why| FetchError(format!("{name}: {why}")))?;
            progress(got, total.or(self.bytes));
        }
        // A closed connection looks like the end of the file. Only the length shows that bytes are missing.
        match total.or(self.bytes) {
            Some(total) if got < total => Err(cut(got, format!("{total} were announced"))),
            _ => Ok(hex(&hash.finalize())),
        }
    }

    /// Refuses a file of `bytes` bytes, or one that has so many already and is not `whole` yet.
    fn check_length(&self, bytes: u64, whole: bool) -> Result<(), FetchError> {
        let allowed = match self.bytes {
            Some(exact) if bytes > exact || (whole && bytes != exact) => exact.to_string(),
            None if bytes > LIMIT => format!("at most {LIMIT}"),
            _ => return Ok(()),
        };
        Err(FetchError(format!("{}: has {bytes} bytes, allowed is {allowed}", self.url)))
    }
}

/// Returns the certificates that this system trusts, or those of the file SSL_CERT_FILE or the folder SSL_CERT_DIR, as behind the proxy of
/// a company; those of Mozilla, which the program contains, where the system has none.
fn roots() -> Result<RootCerts, FetchError> {
    let found = rustls_native_certs::load_native_certs();
    match (&found.certs[..], found.errors.first()) {
        ([], Some(why)) => Err(FetchError(format!(
            "no certificate can be read: {why}; set SSL_CERT_FILE to a file of certificates (PEM), or unset it"
        ))),
        ([], None) => Ok(RootCerts::WebPki),
        (certificates, _) => Ok(certificates
            .iter()
            .map(|one| Certificate::from_der(one).to_owned())
            .collect::<Vec<_>>()
            .into()),
    }
}

fn agent(uri: &Uri, stall: Duration) -> Result<Agent, FetchError> {
    let roots = if uri.scheme_str() == Some("https") { roots()? } else { RootCerts::WebPki };
    let mut config = Agent::config_builder()
        .tls_config(TlsConfig::builder().root_certs(roots).build())
        .http_status_as_error(false)
        .timeout_resolve(Some(CONNECT))
        .timeout_connect(Some(CONNECT))
        .timeout_per_read(Some(stall))
        .user_agent(concat!("modulo/", env!("CARGO_PKG_VERSION")));
    if matches!(uri.host(), Some("127.0.0.1" | "[::1]" | "localhost")) {
        // A proxy of the environment would look for the file on its own loopback interface.
        config = config.proxy(None);
    }
    Ok(config.build().new_agent())
}

fn sha256_of(path: &Path) -> io::Result<String> {
    // To open a pipe would wait for its writer, and a device may have no end.
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::other("is not a regular file"));
    }
    let mut hash = Sha256::new();
    io::copy(&mut File::open(path)?, &mut hash)?;
    Ok(hex(&hash.finalize()))
}

/// Two lower-case hex digits for each byte, as hashes are written.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_silent_server_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}/", listener.local_addr().expect("an address"));
        let uri = url.parse().expect("an address");
        let agent = agent(&uri, Duration::from_millis(50)).expect("http needs no certificate");
        let why = agent.get(url).call().expect_err("silence");
        assert!(matches!(why, ureq::Error::Timeout(ureq::Timeout::PerRead)), "{why}");
    }

    #[test]
    fn announced_lengths_are_checked_before_a_byte_comes() {
        let with = |bytes| FetchRequest { url: "u", file: Path::new("f"), sha256: "", bytes };
        assert!(with(None).check_length(LIMIT, true).is_ok());
        assert!(with(None).check_length(LIMIT + 1, true).is_err());
        assert!(with(Some(7)).check_length(6, true).is_err() && with(Some(7)).check_length(6, false).is_ok());
        assert!(with(Some(LIMIT + 1)).check_length(LIMIT + 1, true).is_ok(), "a stated length is trusted");
    }
}
