//! Fetching from a server on this machine.

use std::cell::RefCell;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};

use modulo_models::{FetchError, FetchRequest, Fetched, fetch, hex};
use proptest::prelude::*;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

/// A status line with fields, and a body; the connection is closed after them.
type Answer = (String, Vec<u8>);

fn sized(length: usize, body: &[u8]) -> Answer {
    (format!("200 OK\r\ncontent-length: {length}"), body.to_owned())
}

/// Gives one connection after the other its answer, then refuses connections; returns the address.
fn serve(answers: Vec<Answer>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("http://{}/model.onnx", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for (head, body) in answers {
            let mut stream = listener.accept().expect("a client").0;
            let lines = BufReader::new(stream.try_clone().expect("a stream")).lines();
            lines.map_while(Result::ok).take_while(|line| !line.is_empty()).for_each(drop);
            // A client that refuses the head hangs up.
            let _ = stream.write_all(format!("HTTP/1.1 {head}\r\nconnection: close\r\n\r\n").as_bytes());
            let _ = stream.write_all(&body);
        }
    });
    url
}

fn body(length: usize) -> Vec<u8> {
    (0..length as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 7) as u8).collect()
}

fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// A folder, and the path of the file to fetch in a folder below it.
fn place() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("new/model.onnx");
    (folder, file)
}

fn get(url: &str, file: &Path, of: &[u8]) -> Result<Fetched, FetchError> {
    fetch(&FetchRequest { url, file, sha256: &sha256(of), bytes: None }, &|_, _| ())
}

/// The error in one line; nothing lies beside the missing file.
fn refused(result: Result<Fetched, FetchError>, file: &Path) -> String {
    let text = result.expect_err("refused").to_string();
    assert!(!text.contains('\n'), "{text}");
    let mut left = file.parent().expect("a folder").read_dir().into_iter().flatten();
    assert!(left.next().is_none(), "{text}");
    text
}

#[test]
fn the_whole_file_comes_with_its_progress() {
    let (body, (_folder, file)) = (body(300_000), place());
    let (url, seen, sum) =
        (serve(vec![sized(300_000, &body)]), RefCell::new(Vec::new()), sha256(&body).to_uppercase());
    let request = FetchRequest { url: &url, file: &file, sha256: &sum, bytes: Some(300_000) };
    let fetched = fetch(&request, &|got, total| seen.borrow_mut().push((got, total))).expect("fetched");
    assert_eq!(fetched, Fetched::Downloaded);
    assert_eq!(std::fs::read(&file).expect("a file"), body);
    let seen = seen.into_inner();
    assert!(seen.is_sorted() && seen.iter().all(|(_, total)| *total == Some(300_000)), "{seen:?}");
    assert_eq!(seen.last().map(|(got, _)| *got), Some(300_000));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_download_cut_anywhere_leaves_nothing_and_can_be_repeated(
        length in 1..200_000_usize, share in 0.0..1.0,
    ) {
        let (body, (_folder, file)) = (body(length), place());
        let cut = (length as f64 * share) as usize;
        let url = serve(vec![sized(length, &body[..cut]), sized(length, &body)]);
        let why = refused(get(&url, &file, &body), &file);
        prop_assert!(why.contains(&format!("after {cut} bytes")), "{}", why);
        prop_assert_eq!(get(&url, &file, &body).expect("whole"), Fetched::Downloaded);
        prop_assert_eq!(std::fs::read(&file).expect("a file"), body);
    }
}

#[test]
fn other_bytes_are_refused_and_the_error_has_both_hashes() {
    let ((_folder, file), sent) = (place(), body(5000));
    let why = refused(get(&serve(vec![sized(5000, &sent)]), &file, b"other"), &file);
    assert!(why.contains(&sha256(&sent)) && why.contains(&sha256(b"other")), "{why}");
}

#[test]
fn another_length_than_the_pinned_one_is_refused() {
    let body = body(5000);
    for answer in [sized(5000, &body), ("200 OK".to_owned(), body.clone())] {
        let ((_folder, file), url, sum) = (place(), serve(vec![answer]), sha256(&body));
        let request = FetchRequest { url: &url, file: &file, sha256: &sum, bytes: Some(4000) };
        let why = refused(fetch(&request, &|_, _| ()), &file);
        assert!(why.contains("5000") && why.contains("4000"), "{why}");
    }
}

#[test]
fn a_status_is_named_with_the_address() {
    for status in [404, 503] {
        let ((_folder, file), url) = (place(), serve(vec![(format!("{status} No"), Vec::new())]));
        let why = refused(get(&url, &file, b"abcdef"), &file);
        assert!(why.contains(&status.to_string()) && why.contains(&url), "{why}");
    }
}

#[test]
fn offline_is_one_line_with_address_cause_and_remedy() {
    let (_folder, file) = place();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("http://{}/", listener.local_addr().expect("an address"));
    drop(listener);
    let why = refused(get(&url, &file, b"abc"), &file);
    for part in ["127.0.0.1", "refused", &url, "--url", "copy it to", file.to_str().expect("text")] {
        assert!(why.contains(part), "'{part}' in {why}");
    }
}

#[test]
fn an_existing_file_is_neither_fetched_nor_overwritten() {
    let (_folder, file) = place();
    std::fs::create_dir(file.parent().expect("a folder")).expect("made");
    std::fs::write(&file, b"mine").expect("written");
    let nowhere = "http://127.0.0.1:1/";
    assert_eq!(get(nowhere, &file, b"mine").expect("there"), Fetched::AlreadyThere);
    let why = get(nowhere, &file, b"theirs").expect_err("another file").to_string();
    assert!(why.contains(&sha256(b"mine")) && why.contains(&sha256(b"theirs")), "{why}");
    assert_eq!(std::fs::read(&file).expect("there"), b"mine");
}

#[test]
fn a_wrong_url_or_sha256_is_refused_by_name() {
    let (sum, not_hex) = (sha256(b""), "g".repeat(64));
    for (url, sha256) in
        [("ftp://host/file", &*sum), ("no url", &sum), ("http://host/", "abc"), ("http://host/", &not_hex)]
    {
        let (_folder, file) = place();
        let why = refused(fetch(&FetchRequest { url, file: &file, sha256, bytes: None }, &|_, _| ()), &file);
        assert!(why.contains("must be"), "{why}");
    }
}
