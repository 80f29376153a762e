//! Fetching from a server of this machine.

mod server;

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use modulo_models::{FetchError, Fetched, Request, fetch};
use proptest::prelude::*;
use server::{Habit, Server};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

fn body(length: usize) -> Vec<u8> {
    (0..length as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 7) as u8).collect()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A folder with the place for a file and its part.
struct Place {
    _folder: TempDir,
    file: PathBuf,
    part: PathBuf,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("new/model.onnx");
        Self { part: file.with_extension("onnx.part"), file, _folder: folder }
    }

    fn with_part(bytes: &[u8]) -> Self {
        let place = Self::new();
        std::fs::create_dir_all(place.part.parent().expect("a folder")).expect("made");
        std::fs::write(&place.part, bytes).expect("written");
        place
    }

    fn fetch(&self, url: &str, of: &[u8]) -> Result<Fetched, FetchError> {
        let sha256 = sha256(of);
        fetch(&Request { url, file: &self.file, sha256: &sha256, bytes: None }, &|_, _| ())
    }

    fn holds(&self, bytes: &[u8]) -> bool {
        !self.part.exists() && std::fs::read(&self.file).is_ok_and(|found| found == bytes)
    }
}

fn one_line(why: FetchError) -> String {
    let text = why.to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn the_whole_file_comes_with_its_progress() {
    let body = body(300_000);
    let (place, server) = (Place::new(), Server::start(&body, &[Habit::Ranges]));
    let seen = RefCell::new(Vec::new());
    let sum = sha256(&body).to_uppercase();
    let request = Request { url: &server.url, file: &place.file, sha256: &sum, bytes: Some(300_000) };
    let fetched = fetch(&request, &|got, total| seen.borrow_mut().push((got, total))).expect("fetched");
    assert_eq!(fetched, Fetched::Downloaded);
    assert!(place.holds(&body));
    let seen = seen.into_inner();
    assert!(seen.is_sorted() && seen.iter().all(|(_, total)| *total == Some(300_000)), "{seen:?}");
    assert_eq!(seen.last().map(|(got, _)| *got), Some(300_000));
    assert_eq!(server.ranges(), [None]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_download_cut_anywhere_goes_on_from_there(length in 1..200_000_usize, share in 0.0..1.0) {
        let body = body(length);
        let cut = (length as f64 * share) as usize;
        let (place, server) = (Place::new(), Server::start(&body, &[Habit::Cut(cut), Habit::Ranges]));
        let why = place.fetch(&server.url, &body).expect_err("cut");
        prop_assert!(matches!(why, FetchError::Cut { got, .. } if got == cut as u64), "{}", why);
        prop_assert!(!place.file.exists());
        prop_assert_eq!(place.part.exists(), cut > 0);
        prop_assert_eq!(place.fetch(&server.url, &body).expect("the rest"), Fetched::Downloaded);
        prop_assert!(place.holds(&body));
        prop_assert_eq!(server.ranges(), [None, Some(cut).filter(|cut| *cut > 0)]);
    }
}

#[test]
fn a_server_without_ranges_sends_it_anew() {
    let body = body(100_000);
    for habit in [Habit::Whole, Habit::Unsized] {
        let (place, server) = (Place::with_part(&body[..40_000]), Server::start(&body, &[habit]));
        assert_eq!(place.fetch(&server.url, &body).expect("fetched"), Fetched::Downloaded);
        assert!(place.holds(&body));
        assert_eq!(server.ranges(), [Some(40_000)]);
    }
}

#[test]
fn a_part_longer_than_the_file_is_thrown_away() {
    let body = body(5000);
    let (place, server) = (Place::with_part(&[7; 6000]), Server::start(&body, &[Habit::Ranges; 2]));
    assert_eq!(place.fetch(&server.url, &body).expect("fetched"), Fetched::Downloaded);
    assert!(place.holds(&body));
    assert_eq!(server.ranges(), [Some(6000), None]);
}

#[test]
fn a_part_that_is_whole_needs_no_server() {
    let body = body(5000);
    let place = Place::with_part(&body);
    let server = Server::start(&body, &[]);
    assert_eq!(place.fetch(&server.url, &body).expect("renamed"), Fetched::Downloaded);
    assert!(place.holds(&body));
}

#[test]
fn other_bytes_are_removed_and_both_hashes_said() {
    let (body, other) = (body(5000), vec![1; 5000]);
    let (place, server) = (Place::with_part(&other[..10]), Server::start(&body, &[Habit::Ranges; 2]));
    let why = one_line(place.fetch(&server.url, &body).expect_err("a part of something else"));
    assert!(
        why.contains(&sha256(&body)) && why.contains(&sha256(&[&other[..10], &body[10..]].concat())),
        "{why}"
    );
    assert!(!place.part.exists() && !place.file.exists());
    assert_eq!(place.fetch(&server.url, &body).expect("anew"), Fetched::Downloaded);
}

#[test]
fn another_length_than_the_pinned_one_is_refused() {
    let body = body(5000);
    let sum = sha256(&body);
    for habit in [Habit::Ranges, Habit::Unsized] {
        let (place, server) = (Place::new(), Server::start(&body, &[habit]));
        let request = Request { url: &server.url, file: &place.file, sha256: &sum, bytes: Some(4000) };
        let why = one_line(fetch(&request, &|_, _| ()).expect_err("too long"));
        assert!(why.contains("5000") && why.contains("4000"), "{why}");
        assert!(!place.part.exists() && !place.file.exists());
    }
}

#[test]
fn a_status_is_said_and_the_part_stays() {
    for status in [404, 403, 503] {
        let (place, server) = (Place::with_part(b"abc"), Server::start(b"", &[Habit::Status(status)]));
        let why = one_line(place.fetch(&server.url, b"abcdef").expect_err("no file"));
        assert!(why.contains(&status.to_string()) && why.contains(&server.url), "{why}");
        assert_eq!(std::fs::read(&place.part).expect("kept"), b"abc");
    }
}

#[test]
fn offline_is_one_line_with_host_cause_and_remedy() {
    let place = Place::new();
    let server = Server::start(b"", &[]);
    let url = server.url.clone();
    server.ranges(); // the port is closed now
    let why = one_line(place.fetch(&url, b"abc").expect_err("offline"));
    for part in
        ["127.0.0.1", "refused", url.as_str(), "--url", "copy it to", place.file.to_str().expect("text")]
    {
        assert!(why.contains(part), "'{part}' in {why}");
    }
    assert!(!place.part.exists(), "nothing came, nothing is left");
}

#[test]
fn what_is_there_is_not_fetched_and_not_overwritten() {
    let place = Place::with_part(b"");
    std::fs::write(&place.file, b"mine").expect("written");
    let nowhere = "http://127.0.0.1:1/";
    assert_eq!(place.fetch(nowhere, b"mine").expect("there"), Fetched::AlreadyThere);
    let why = one_line(place.fetch(nowhere, b"theirs").expect_err("another file"));
    assert!(why.contains(&sha256(b"mine")) && why.contains(&sha256(b"theirs")), "{why}");
    assert_eq!(std::fs::read(&place.file).expect("there"), b"mine");
}

#[test]
fn nonsense_is_refused_by_name() {
    let sum = sha256(b"");
    for (url, sha256) in [
        ("ftp://host/file", sum.as_str()),
        ("no url", &sum),
        ("http://host/", "abc"),
        ("http://host/", &"g".repeat(64)),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let request = Request { url, file: &folder.path().join("file"), sha256, bytes: None };
        let why = one_line(fetch(&request, &|_, _| ()).expect_err("nonsense"));
        assert!(why.contains("must be"), "{why}");
        assert!(std::fs::read_dir(folder.path()).expect("a folder").next().is_none(), "{why}");
    }
    assert!(
        fetch(&Request { url: "x", file: Path::new("/"), sha256: &sum, bytes: None }, &|_, _| ()).is_err()
    );
}
