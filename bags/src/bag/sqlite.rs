//! [`SqliteFile`]: a `.db3` file of rosbag2's SQLite storage, any version of its tables. Read only.

use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, Row};

use super::storage::{Cursor, FileSummary, Storage};
use super::{BagError, BagTopic, BagWarning, RawMessage, Selection, TopicCount};
use crate::FileError;

/// Messages that are read at once.
const BATCH: u32 = 8;

/// The index of one file.
#[derive(Debug)]
pub(super) struct SqliteFile {
    path: PathBuf,
    /// Numbers of the topics, in the order of the summary.
    ids: Vec<i64>,
    summary: FileSummary,
}

impl SqliteFile {
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        let size = std::fs::metadata(path).map_err(|e| FileError::new(path, e))?.len();
        let mut warnings = Vec::new();
        let read = connect(path).and_then(|file| Ok((topics(&file, path, &mut warnings)?, span(&file)?)));
        let (topics, span) = read.map_err(|e| broken(path, &e))?;
        let (ids, topics) = topics.into_iter().unzip();
        let summary = FileSummary { id: "sqlite3", size, span, topics, warnings };
        Ok(Self { path: path.to_owned(), ids, summary })
    }
}

fn connect(path: &Path) -> rusqlite::Result<Connection> {
    Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX)
}

fn broken(path: &Path, why: &rusqlite::Error) -> BagError {
    let remedy = "`sqlite3 FILE .recover` may save what is in a broken file";
    BagError::Damaged(path.to_owned(), why.to_string(), remedy)
}

/// Reads a time. Times are stored as signed numbers; all of them are after the epoch.
fn time(row: &Row<'_>, column: usize) -> rusqlite::Result<u64> {
    Ok(u64::try_from(row.get::<_, i64>(column)?).unwrap_or(0))
}

fn span(file: &Connection) -> rusqlite::Result<Option<(u64, u64)>> {
    file.query_row("SELECT COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages", [], |row| {
        if row.get::<_, i64>(0)? == 0 { Ok(None) } else { Ok(Some((time(row, 1)?, time(row, 2)?))) }
    })
}

/// Returns the topics that are CDR, by their number.
fn topics(
    file: &Connection,
    path: &Path,
    warnings: &mut Vec<BagWarning>,
) -> rusqlite::Result<Vec<(i64, TopicCount)>> {
    let mut count = file.prepare("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id")?;
    let counts: HashMap<i64, i64> =
        count.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect::<Result<_, _>>()?;
    let definitions = definitions(file)?;
    // All columns, since the version of the file decides which of them exist.
    let mut query = file.prepare("SELECT * FROM topics ORDER BY id")?;
    let mut rows = query.query([])?;
    let mut topics = Vec::new();
    while let Some(row) = rows.next()? {
        let id: i64 = row.get("id")?;
        let messages = counts.get(&id).and_then(|&n| u64::try_from(n).ok()).unwrap_or(0);
        let topic = topic(row, &definitions)?;
        let format = column(row, "serialization_format")?;
        let path = path.to_owned();
        if format != "cdr" {
            let why = format!("they are '{format}', cdr is needed");
            warnings.push(BagWarning::LeftOut { path, topic: topic.name, messages, why });
            continue;
        }
        if topic.schema.is_empty() {
            let (topic, type_name) = (topic.name.clone(), topic.type_name.clone());
            warnings.push(BagWarning::NoDefinition { path, topic, type_name });
        }
        topics.push((id, TopicCount { topic: Arc::new(topic), messages }));
    }
    Ok(topics)
}

/// Returns a column that older versions of the table do not have.
fn column(row: &Row<'_>, name: &str) -> rusqlite::Result<String> {
    // A missing column is an older version, and NULL is a recorder that knew no value.
    let has = row.as_ref().column_index(name).is_ok();
    if has { Ok(row.get::<_, Option<String>>(name)?.unwrap_or_default()) } else { Ok(String::new()) }
}

/// Reads a topic. A definition that the file lacks is taken from the suite.
fn topic(row: &Row<'_>, definitions: &HashMap<String, (String, String)>) -> rusqlite::Result<BagTopic> {
    let (name, type_name): (String, String) = (row.get("name")?, row.get("type")?);
    let (qos, type_hash) = (column(row, "offered_qos_profiles")?, column(row, "type_description_hash")?);
    if let Some((encoding, text)) = definitions.get(&type_name) {
        let (schema_encoding, schema) = (encoding.clone(), text.clone().into_bytes());
        let type_hash = super::type_hash(type_hash, &type_name, &schema);
        return Ok(BagTopic { name, type_name, type_hash, qos, schema_encoding, schema });
    }
    let ours = BagTopic::new(&name, &type_name, super::qos::parse(&qos));
    let type_hash = if type_hash.is_empty() { ours.type_hash } else { type_hash };
    Ok(BagTopic { type_hash, qos, ..ours })
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

    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Option<Box<dyn Cursor>>, BagError> {
        let wanted = self.ids.iter().zip(&self.summary.topics);
        let wanted = wanted.filter(|(_, counted)| selection.has(&counted.topic.name));
        let wanted: HashMap<_, _> = wanted.map(|(id, counted)| (*id, Arc::clone(&counted.topic))).collect();
        if wanted.is_empty() {
            return Ok(None);
        }
        let start = selection.start_ns.filter(|start| *start > 0);
        // The query goes on behind the last message, so the reading starts behind the tick before the start.
        let before = start.map_or(i64::MIN, |start| i64::try_from(start - 1).unwrap_or(i64::MAX));
        let file = connect(&self.path).map_err(|e| broken(&self.path, &e))?;
        let path = self.path.clone();
        let last = (before, i64::MAX);
        Ok(Some(Box::new(SqliteMessages { path, file, wanted, last, batch: VecDeque::new() })))
    }
}

/// The selected messages of one file.
struct SqliteMessages {
    path: PathBuf,
    file: Connection,
    wanted: HashMap<i64, Arc<BagTopic>>,
    /// Time and number of the last message that was read.
    last: (i64, i64),
    batch: VecDeque<RawMessage>,
}

impl SqliteMessages {
    fn read_batch(&mut self) -> rusqlite::Result<()> {
        let ids: Vec<_> = self.wanted.keys().map(i64::to_string).collect();
        // A statement borrows its connection, so it cannot stay open between two calls. The pair of time and
        // number finds the next message by the index, where an OFFSET would read all rows before it again.
        let mut query = self.file.prepare(&format!(
            "SELECT id, topic_id, timestamp, data FROM messages WHERE (timestamp, id) > (?1, ?2) \
             AND topic_id IN ({}) ORDER BY timestamp, id LIMIT {BATCH}",
            ids.join(", ")
        ))?;
        let mut rows = query.query(self.last)?;
        while let Some(row) = rows.next()? {
            self.last = (row.get(2)?, row.get(0)?);
            let Some(topic) = self.wanted.get(&row.get(1)?) else { continue };
            let log_time = time(row, 2)?;
            // A broken file may hold anything in place of a payload.
            let data = match row.get_ref(3)? {
                ValueRef::Blob(bytes) | ValueRef::Text(bytes) => bytes.to_vec(),
                // An empty payload is refused where it is decoded, with the topic and the time.
                ValueRef::Null | ValueRef::Integer(_) | ValueRef::Real(_) => Vec::new(),
            };
            let topic = Arc::clone(topic);
            self.batch.push_back(RawMessage { topic, log_time, publish_time: log_time, data });
        }
        Ok(())
    }
}

impl Cursor for SqliteMessages {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError> {
        if self.batch.is_empty() {
            self.read_batch().map_err(|e| broken(&self.path, &e))?;
        }
        Ok(self.batch.pop_front())
    }
}
