//! [`SqliteFile`]: a `.db3` file of rosbag2's SQLite storage, any version of its tables. Read only.
//!
//! SQLite has no checksums. What is missing is found by the lengths and the structure of the file; a payload that was changed is not.

use std::collections::{BTreeMap, HashMap};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};

use super::definition::complete;
use super::storage::{Cursor, FileSummary, Storage};
use super::{BagError, BagTopic, BagWarning, LeftOut, RawMessage, Selection, TopicCount, unpacked};
use crate::FileError;

#[derive(Debug)]
pub(super) struct SqliteFile {
    path: PathBuf,
    /// Numbers of the topics, in the order of the summary.
    ids: Vec<i64>,
    /// The messages, by time.
    places: Vec<MessagePlace>,
    summary: FileSummary,
}

/// Where a message is. The order is that of the replay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct MessagePlace {
    time: i64,
    /// Number of the message.
    id: i64,
    topic: i64,
}

impl SqliteFile {
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        let size = std::fs::metadata(path).map_err(|e| FileError::new(path, e))?.len();
        let mut warnings = Vec::new();
        let stated = stated_size(path).map_err(|e| FileError::new(path, e))?;
        let read = connect(path).and_then(|file| {
            let places = places(&file, path, &mut warnings)?;
            let topics = topics(&file, path, &places, &mut warnings)?;
            Ok((places, topics))
        });
        let (places, topics) = read.map_err(|e| broken(path, &e))?;
        if stated > size {
            let why = format!("of {stated} bytes");
            warnings.insert(0, BagWarning::truncated(path, size, &why, places.len() as u64));
        }
        let span = places.first().zip(places.last()).map(|(first, last)| (time(first.time), time(last.time)));
        let (ids, topics) = topics.into_iter().unzip();
        let summary = FileSummary { id: "sqlite3", size, span, topics, extras: Vec::new(), warnings };
        Ok(Self { path: path.to_owned(), ids, places, summary })
    }
}

fn connect(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let file = Connection::open_with_flags(path, flags)?;
    // Without this, SQLite does not read a file that was cut at all. A file that is read only is never written.
    file.pragma_update(None, "writable_schema", true)?;
    Ok(file)
}

/// Returns the size that the file says it has, bytes; 0 when it does not say so.
fn stated_size(path: &Path) -> std::io::Result<u64> {
    let mut head = [0; 100];
    let read = std::fs::File::open(path)?.read_exact_at(&mut head, 0);
    let number = |at: usize| u64::from(u32::from_be_bytes(head[at..at + 4].try_into().expect("four bytes")));
    // The number of pages counts where it was written with the last change.
    if read.is_err() || number(24) != number(92) {
        return Ok(0);
    }
    let page = u64::from(u16::from_be_bytes([head[16], head[17]]));
    Ok(number(28) * if page == 1 { 65_536 } else { page })
}

fn broken(path: &Path, why: &rusqlite::Error) -> BagError {
    let has = |end: &str| {
        let mut beside = path.as_os_str().to_owned();
        beside.push(end);
        std::fs::metadata(beside).is_ok_and(|beside| beside.len() > 0)
    };
    let busy = [ErrorCode::DatabaseBusy, ErrorCode::DatabaseLocked];
    let remedy = if why.sqlite_error_code().is_some_and(|code| busy.contains(&code)) {
        "a recorder is still writing it: stop the recorder first"
    } else if has("-journal") {
        "its recorder was stopped while it wrote, and FILE-journal takes back the half that was written: copy both to a folder that \
         can be written, and run `sqlite3 FILE 'SELECT 1 FROM messages LIMIT 1'` there"
    } else if has("-wal") {
        "its recorder was stopped, or still writes, and the last messages are in FILE-wal: copy both to a folder that can be \
         written"
    } else if why.sqlite_error_code() == Some(ErrorCode::CannotOpen) {
        "copy it to a folder that can be written: SQLite reads some files only there"
    } else {
        "`sqlite3 FILE .recover` may save what is in a broken file"
    };
    BagError::File(path.to_owned(), format!("{why}; {remedy}"))
}

/// Returns a time. Times are stored as signed numbers; all of them are after the epoch.
fn time(stored: i64) -> u64 {
    u64::try_from(stored).unwrap_or(0)
}

/// Finds the messages by the table itself, which has no second copy that may contradict it. What can be read on both sides of a broken
/// page is found.
fn places(
    file: &Connection,
    path: &Path,
    warnings: &mut Vec<BagWarning>,
) -> rusqlite::Result<Vec<MessagePlace>> {
    let mut places = Vec::new();
    if let Err(why) = read_places(file, i64::MIN, "ASC", &mut places) {
        let last = places.last().map_or(i64::MIN, |place: &MessagePlace| place.id);
        let before = places.len();
        // The end of the walk backwards is the other side of what the first one has found.
        let _ = read_places(file, last, "DESC", &mut places);
        if places.is_empty() {
            return Err(why);
        }
        let first = places[before..].last().map(|place| place.id);
        let messages = first.and_then(|first| u64::try_from(first.checked_sub(last)? - 1).ok());
        // Without a message on both sides their number is unknown.
        let messages = messages.filter(|_| before > 0);
        let place = "a broken part of the file".to_owned();
        warnings.push(LeftOut { path: path.to_owned(), place, messages, why: why.to_string() }.into());
    }
    places.sort();
    if warnings.is_empty()
        && let Err(why) = compare(file, &places)
    {
        warnings.push(BagWarning::contradiction(path, &why));
    }
    Ok(places)
}

/// Compares the times and numbers of the messages with those in the index of the table, their only other copy.
fn compare(file: &Connection, places: &[MessagePlace]) -> Result<(), String> {
    let indexed = || -> rusqlite::Result<Vec<(i64, i64)>> {
        let mut query = file.prepare("SELECT timestamp, id FROM messages ORDER BY timestamp, id")?;
        query.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
    };
    let indexed = indexed().map_err(|why| format!("the index of its times is broken: {why}"))?;
    if indexed.iter().copied().eq(places.iter().map(|place| (place.time, place.id))) {
        return Ok(());
    }
    let (indexed, found) = (indexed.len(), places.len());
    Err(format!(
        "the index of its times and the table of its {found} messages differ, and the index has {indexed}"
    ))
}

/// Adds the messages behind number `after`, in the order of their numbers, until one cannot be read.
fn read_places(
    file: &Connection,
    after: i64,
    order: &str,
    places: &mut Vec<MessagePlace>,
) -> rusqlite::Result<()> {
    let query = format!("SELECT timestamp, id, topic_id FROM messages WHERE id > ?1 ORDER BY id {order}");
    let mut query = file.prepare(&query)?;
    let mut rows = query.query([after])?;
    while let Some(row) = rows.next()? {
        places.push(MessagePlace { time: row.get(0)?, id: row.get(1)?, topic: row.get(2)? });
    }
    Ok(())
}

/// Returns the topics that are CDR, by their number.
fn topics(
    file: &Connection,
    path: &Path,
    places: &[MessagePlace],
    warnings: &mut Vec<BagWarning>,
) -> rusqlite::Result<Vec<(i64, TopicCount)>> {
    let mut counts: BTreeMap<i64, u64> = BTreeMap::new();
    places.iter().for_each(|place| *counts.entry(place.topic).or_default() += 1);
    let definitions = definitions(file)?;
    // All columns, since the version of the file decides which of them exist.
    let mut query = file.prepare("SELECT * FROM topics ORDER BY id")?;
    let mut rows = query.query([])?;
    let mut topics = Vec::new();
    while let Some(row) = rows.next()? {
        let id: i64 = row.get("id")?;
        let messages = counts.remove(&id).unwrap_or(0);
        let topic = topic(row, &definitions)?;
        let format = column(row, "serialization_format")?;
        if format != "cdr" {
            let why = format!("they are '{format}', cdr is needed");
            warnings.push(LeftOut::of_topic(path, &topic.name, messages, why).into());
            continue;
        }
        let topic = Arc::new(complete(path, topic, warnings));
        topics.push((id, TopicCount { topic, messages }));
    }
    for (id, messages) in counts {
        let (place, why) = (format!("topic number {id}"), "the file has no topic of this number".to_owned());
        warnings.push(LeftOut { path: path.to_owned(), place, messages: Some(messages), why }.into());
    }
    Ok(topics)
}

/// Returns a column that older versions of the table do not have.
fn column(row: &Row<'_>, name: &str) -> rusqlite::Result<String> {
    // A missing column is an older version, and NULL is a recorder that knew no value.
    let has = row.as_ref().column_index(name).is_ok();
    if has { Ok(row.get::<_, Option<String>>(name)?.unwrap_or_default()) } else { Ok(String::new()) }
}

/// Reads a topic with the definition that the file has of its type, if any.
fn topic(row: &Row<'_>, definitions: &HashMap<String, (String, String)>) -> rusqlite::Result<BagTopic> {
    let type_name: String = row.get("type")?;
    let (schema_encoding, text) = definitions.get(&type_name).cloned().unwrap_or_default();
    Ok(BagTopic {
        name: row.get("name")?,
        type_name,
        type_hash: column(row, "type_description_hash")?,
        qos: column(row, "offered_qos_profiles")?,
        schema_encoding,
        schema: text.into_bytes(),
        metadata: BTreeMap::new(),
    })
}

/// Returns the encodings and texts of the definitions by type; files before version 4 have no definitions.
fn definitions(file: &Connection) -> rusqlite::Result<HashMap<String, (String, String)>> {
    let known = "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND name = 'message_definitions'";
    if file.query_row(known, [], |row| row.get::<_, i64>(0))? == 0 {
        return Ok(HashMap::new());
    }
    let mut query =
        file.prepare("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?;
    let all: HashMap<String, (String, String)> = rows.collect::<Result<_, _>>()?;
    // Recorders write an empty definition when they do not find one.
    Ok(all.into_iter().filter(|(_, (_, text))| !text.is_empty()).collect())
}

impl Storage for SqliteFile {
    fn summary(&self) -> &FileSummary {
        &self.summary
    }

    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Cursor, BagError> {
        let wanted = self.ids.iter().zip(&self.summary.topics);
        let wanted = wanted.filter(|(_, counted)| selection.has(&counted.topic.name));
        let wanted: HashMap<_, _> = wanted.map(|(id, counted)| (*id, Arc::clone(&counted.topic))).collect();
        if wanted.is_empty() {
            return Ok(Box::new(std::iter::empty()));
        }
        let start = selection.start_ns.unwrap_or(0);
        let next = self.places.partition_point(|place| time(place.time) < start);
        let file = connect(&self.path).map_err(|e| broken(&self.path, &e))?;
        let messages = (next..self.places.len()).filter_map(move |index| {
            let place = self.places[index];
            let topic = wanted.get(&place.topic)?;
            let log_time = time(place.time);
            let message =
                |data| RawMessage { topic: Arc::clone(topic), log_time, publish_time: log_time, data };
            let read = payload(&file, place.id).map(message);
            Some(read.map_err(|why| LeftOut::of_topic(&self.path, &topic.name, 1, why).into()))
        });
        Ok(Box::new(messages))
    }
}

fn payload(file: &Connection, id: i64) -> Result<Vec<u8>, String> {
    let read = file.query_row("SELECT data FROM messages WHERE id = ?1", [id], |row| {
        Ok(match row.get_ref(0)? {
            ValueRef::Blob(bytes) | ValueRef::Text(bytes) => bytes.to_vec(),
            ValueRef::Null | ValueRef::Integer(_) | ValueRef::Real(_) => Vec::new(),
        })
    });
    let data = unpacked(read.map_err(|why| why.to_string())?)?;
    // The encapsulation of CDR has four bytes, and all of its kinds begin with 0.
    if data.len() < 4 || data[0] != 0 {
        return Err("their payload is not CDR".to_owned());
    }
    Ok(data)
}
