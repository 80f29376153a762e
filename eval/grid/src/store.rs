//! [`Folder`]: the results of runs as files, each of which is written once and by a rename. Any number of processes may work on one folder: what
//! one of them has finished, the others find, and what it has begun, they leave to it as long as it lives.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use modulo_core::Detection;
use modulo_runtime::input::read_bytes;
use modulo_runtime::output::{self, ResultFolder};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::frames::{FrameRecord, Slice};
use crate::quality::RecoveryQuality;
use crate::results::{CellKey, CellTimes, FIGURES, Point, RESULTS, Results};
use crate::{GridError, rows};

/// The file that marks a folder of results.
pub const MARKER: &str = "evaluation.json";
/// The folders of the frames, of the boxes of each cell, of the points that runs were asked for, and of the times.
const FRAMES: &str = "frames";
const CELLS: &str = "cells";
const PLANS: &str = "plans";
const TIMES: &str = "times";
/// What a folder without a marker has.
const OLDER: &str =
    "holds results of an older version of modulo, or of another program; choose another folder";
/// Size of the largest file, bytes.
const LARGEST: u64 = 1 << 30;

#[derive(Debug, Serialize, Deserialize)]
struct Marker {
    format: u32,
    program: String,
}

/// The boxes of one cell on a slice of frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CellSlice {
    /// All that decides the boxes.
    pub key: CellKey,
    /// The classes that the model knows, as it calls them.
    pub classes: Vec<String>,
    /// The places of the first frame and behind the last one.
    pub places: [usize; 2],
    /// The frames.
    pub frames: Vec<FrameFound>,
}

/// A frame of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameFound {
    /// Its place among the frames of its camera.
    pub place: usize,
    /// The boxes from a score of 0.001 on, by descending score; `None` where the detector gave no answer.
    #[serde(with = "rows::boxes")]
    pub boxes: Option<Vec<Detection>>,
    /// Quality of a recovered, merged or saturated image.
    pub recovery: Option<RecoveryQuality>,
}

/// A folder of results.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
}

/// The right to work on something as long as this lives.
pub struct Claim {
    path: PathBuf,
    // The system lets go of the lock when the process ends, however it ends.
    _lock: Option<File>,
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Another process may have taken it away.
        let _ = fs::remove_file(&self.path);
    }
}

impl CellKey {
    /// The name of its files.
    fn name(&self) -> String {
        digest(self)
    }

    /// Returns the places of `wanted`, from the first to the last one, that none of the `finished` files of this cell covers; `None` if all
    /// are covered.
    pub fn missing(&self, finished: &[String], wanted: &Range<usize>) -> Option<Range<usize>> {
        let name = self.name();
        let own = finished.iter().filter_map(|file| places_of(file.strip_prefix(&name)?));
        let mut covered: Vec<Range<usize>> = own.collect();
        covered.sort_by_key(|places| places.start);
        let first = |start: usize, places: &Range<usize>| {
            if places.start <= start { start.max(places.end) } else { start }
        };
        let last =
            |end: usize, places: &Range<usize>| if places.end >= end { end.min(places.start) } else { end };
        let (start, end) =
            (covered.iter().fold(wanted.start, first), covered.iter().rev().fold(wanted.end, last));
        (start < end).then_some(start..end)
    }
}

/// The first 16 digits of the sha256 of a value as JSON.
pub(crate) fn digest(value: &impl Serialize) -> String {
    let text = serde_json::to_vec(value).expect("its keys are texts");
    modulo_models::hex(&Sha256::digest(text))[..16].to_owned()
}

impl Folder {
    /// Takes the folder of a run: `given`, which may have results of this version, or a new one in runs.
    ///
    /// # Errors
    /// [`GridError::Request`] of a folder with other files, or with results of another version.
    pub fn take(given: Option<&Path>) -> Result<ResultFolder, GridError> {
        // In this order: another process that begins with the marker and ends with the results may be at work.
        if let Some(path) = given.filter(|path| path.join(RESULTS).exists() && !path.join(MARKER).exists()) {
            return Err(GridError::of_file(path, OLDER));
        }
        let taken = ResultFolder::take(given, "eval", Some(MARKER));
        taken.map_err(|why| GridError::Request(why.to_string()))
    }

    /// Opens a folder for a run, which adds to the results that are there, or with `fresh` removes them. It is made if it is missing.
    ///
    /// # Errors
    /// Those of [`Folder::take`].
    pub fn open(path: &Path, fresh: bool) -> Result<Self, GridError> {
        let _taken = Self::take(Some(path))?;
        let folder = Self { path: path.to_owned() };
        for old in [FRAMES, CELLS, PLANS, TIMES].map(|name| path.join(name)).iter().filter(|_| fresh) {
            match fs::remove_dir_all(old) {
                Err(why) if why.kind() != ErrorKind::NotFound => return Err(GridError::io(old, why)),
                _ => {}
            }
        }
        if fresh || !path.join(MARKER).exists() {
            let program = concat!("modulo ", env!("CARGO_PKG_VERSION")).to_owned();
            folder.put(MARKER, &Marker { format: FIGURES, program })?;
            return Ok(folder);
        }
        Self::existing(path)
    }

    /// Opens a folder to read it.
    ///
    /// # Errors
    /// [`GridError`] of a folder without results, or with those of another version.
    pub fn existing(path: &Path) -> Result<Self, GridError> {
        let marker = path.join(MARKER);
        let Some(Marker { format, program }) = read::<Marker>(&marker)? else {
            if path.join(RESULTS).exists() {
                return Err(GridError::of_file(path, OLDER));
            }
            let why = "there are no results; modulo eval --out writes them";
            return Err(GridError::Results(format!("{}: {why}", marker.display())));
        };
        if format == FIGURES {
            return Ok(Self { path: path.to_owned() });
        }
        let why = format!(
            "holds results of {program} in format {format}, and this version has {FIGURES}; choose another folder, or start anew \
             with --fresh"
        );
        Err(GridError::of_file(path, why))
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn put(&self, name: &str, value: &impl Serialize) -> Result<(), GridError> {
        let mut text = serde_json::to_vec(value).expect("its keys are texts");
        text.push(b'\n');
        replace(&self.path.join(name), &text)
    }

    /// Stores the frames of a slice of the data with this name, and the points of the run.
    ///
    /// # Errors
    /// [`GridError::Request`] if frames at the same places are there and others.
    pub fn put_frames(&self, name: &str, slice: &Slice) -> Result<(), GridError> {
        let own: BTreeMap<usize, &String> =
            slice.frames.iter().map(|frame| (frame.place, &frame.digest)).collect();
        let [first, end] = slice.places;
        for file in self.files(FRAMES)? {
            let places = file.strip_prefix(name).and_then(places_of);
            let overlaps = places.is_some_and(|places| places.start < end && first < places.end);
            let path = self.path.join(FRAMES).join(&file);
            let Some(other) = overlaps.then(|| read::<Slice>(&path)).transpose()?.flatten() else { continue };
            let differs =
                |frame: &&FrameRecord| own.get(&frame.place).is_some_and(|own| **own != frame.digest);
            if let Some(frame) = other.frames.iter().find(differs) {
                let (there, here, name) = (other.source, &slice.source, &frame.name);
                let why = format!(
                    "holds results of other images: frame {name} of {there} is not that of {here}; choose another folder, or start anew with --fresh"
                );
                return Err(GridError::of_file(&self.path, why));
            }
        }
        self.put(&format!("{FRAMES}/{name}.{first}-{end}.json"), slice)
    }

    /// Stores the points that a run was asked for.
    pub fn put_plan(&self, points: &[&Point]) -> Result<(), GridError> {
        self.put(&format!("{PLANS}/{}.json", digest(&points)), &points)
    }

    /// Stores the boxes of a cell.
    pub fn put_cell(&self, cell: &CellSlice) -> Result<(), GridError> {
        let [first, end] = cell.places;
        self.put(&format!("{CELLS}/{}.{first}-{end}.json", cell.key.name()), cell)
    }

    /// Stores the times that were measured in a pass.
    pub fn put_times(&self, times: &[(Point, CellTimes)]) -> Result<(), GridError> {
        let pass = times.first().map_or(String::new(), |(_, times)| digest(&times.frame_ms.pass));
        // The names have the order of the passes.
        let number = self.files(TIMES)?.len();
        self.put(&format!("{TIMES}/{number:04}-{pass}.json"), &times)
    }

    /// Returns the names of the files of boxes that are there.
    pub fn finished(&self) -> Result<Vec<String>, GridError> {
        self.files(CELLS)
    }

    /// Claims the work `name`. `None` if another process works on it.
    pub fn claim(&self, name: &str) -> Result<Option<Claim>, GridError> {
        let path = self.path.join(CELLS).join(format!(".{name}.claim"));
        let opened = fs::create_dir_all(self.path.join(CELLS)).and_then(|()| File::create(&path));
        let file = opened.map_err(|why| GridError::io(&path, why))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Claim { path, _lock: Some(file) })),
            Err(TryLockError::WouldBlock) => Ok(None),
            // Without locks, two processes may do the same work, and write the same bytes.
            Err(TryLockError::Error(_)) => Ok(Some(Claim { path, _lock: None })),
        }
    }

    /// Returns the names of the finished files in a folder of this one, in their order.
    fn files(&self, name: &str) -> Result<Vec<String>, GridError> {
        let path = self.path.join(name);
        let entries = match fs::read_dir(&path) {
            Err(why) if why.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.and_then(Iterator::collect::<Result<Vec<_>, _>>),
        };
        let entries = entries.map_err(|why| GridError::io(&path, why))?;
        let names = entries.into_iter().filter_map(|entry| entry.file_name().into_string().ok());
        let mut names: Vec<String> =
            names.filter(|name| !name.starts_with('.') && name.ends_with(".json")).collect();
        names.sort();
        Ok(names)
    }

    /// Returns the content of the files in a folder of this one, each with its name up to the first point.
    fn all<T: DeserializeOwned>(&self, folder: &str) -> Result<Vec<(String, T)>, GridError> {
        let read = |(name, path): (String, PathBuf)| Ok(read(&path)?.map(|value| (name, value)));
        self.named(folder)?.into_iter().map(read).filter_map(Result::transpose).collect()
    }

    /// Returns the paths of the files in a folder of this one, each with its name up to the first point.
    fn named(&self, folder: &str) -> Result<Vec<(String, PathBuf)>, GridError> {
        let path = |file: &String| self.path.join(folder).join(file);
        let name = |file: &String| file.split('.').next().unwrap_or_default().to_owned();
        Ok(self.files(folder)?.iter().map(|file| (name(file), path(file))).collect())
    }

    /// Returns the frames, with the name of their data.
    pub fn slices(&self) -> Result<Vec<(String, Slice)>, GridError> {
        self.all(FRAMES)
    }

    /// Returns the files of the cells, with the name of the cell.
    pub fn cells(&self) -> Result<Vec<(String, PathBuf)>, GridError> {
        self.named(CELLS)
    }

    /// Returns the points that runs were asked for.
    pub fn plans(&self) -> Result<Vec<Point>, GridError> {
        Ok(self.all::<Vec<Point>>(PLANS)?.into_iter().flat_map(|(_, points)| points).collect())
    }

    /// Returns the times of all passes, the last one last.
    pub fn times(&self) -> Result<Vec<(Point, CellTimes)>, GridError> {
        Ok(self.all::<Vec<(Point, CellTimes)>>(TIMES)?.into_iter().flat_map(|(_, times)| times).collect())
    }
}

/// Reads `.FIRST-END.json`.
fn places_of(rest: &str) -> Option<Range<usize>> {
    let (first, end) = rest.strip_prefix('.')?.strip_suffix(".json")?.split_once('-')?;
    Some(first.parse().ok()?..end.parse().ok()?)
}

/// Reads a file of JSON; `None` if it is not there.
///
/// # Errors
/// [`GridError`] if it cannot be read, or is something else.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, GridError> {
    match read_bytes(path, LARGEST) {
        Ok(text) => {
            let json = |why| GridError::Results(format!("{}: {why}", path.display()));
            serde_json::from_slice(&text).map(Some).map_err(json)
        }
        Err(why) if why.kind() == ErrorKind::NotFound => Ok(None),
        Err(why) => Err(GridError::io(path, why)),
    }
}

/// Returns the figures in `folder` that another program has written for a report, such as the benchmark of the Python package, which has no boxes.
///
/// # Errors
/// [`GridError`] of figures that are none.
pub fn figures(folder: &Path) -> Result<Option<Results>, GridError> {
    if folder.join(MARKER).exists() {
        return Ok(None);
    }
    let version =
        read::<serde_json::Value>(&folder.join(RESULTS))?.map(|results| results["setup"]["figures"].clone());
    if version == Some(0.into()) { read(&folder.join(RESULTS)) } else { Ok(None) }
}

/// Writes figures, such as those of all cells, as [`RESULTS`] for other programs. Creates `folder` if it is missing.
///
/// # Errors
/// [`GridError`] if it cannot be written.
pub fn save(folder: &Path, results: &impl Serialize) -> Result<(), GridError> {
    let mut text = serde_json::to_vec_pretty(results).expect("results have text keys");
    text.push(b'\n');
    replace(&folder.join(RESULTS), &text)
}

/// Replaces the content of `path` by `bytes`, as [`output::replace`] does. Creates its folder if it is missing.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), GridError> {
    let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
    folder.and_then(|()| output::replace(path, bytes)).map_err(|why| GridError::io(path, why))
}
