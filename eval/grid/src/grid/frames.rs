//! [`Frames`]: the frames that can be scored, found once and then read again for every cell.
//!
//! What cannot be scored is left out here, with a line that says so, and
//! nowhere else; every cell sees the same frames.

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::{GroundTruth, SourceError, SourceFrame};
use sha2::{Digest, Sha256};

use super::GridError;
use crate::classes::DONT_CARE;
use crate::data::{Data, Drive};
use crate::results::Input;

/// Labels may reach outside the image by this much, px, without a word: they were rounded.
const TOLERANCE: f32 = 1.0;

/// The frames of a grid.
pub struct Frames {
    drives: Vec<Drive>,
    /// Places of the frames that are scored, counted over all drives.
    kept: BTreeMap<usize, usize>,
    /// Labels of the scored frames.
    pub truths: Vec<Vec<GroundTruth>>,
    /// Drives of the scored frames, where they are known.
    pub drive_of: Vec<Option<String>>,
    /// What was found, for the results.
    pub input: Input,
    place: usize,
    drive: usize,
}

/// A frame as it is read.
pub struct Raw {
    /// Counted over all drives.
    pub place: usize,
    /// Which drive.
    pub drive: usize,
    /// The frame, or why there is none.
    pub frame: Result<SourceFrame, SourceError>,
}

/// What the first reading notes.
#[derive(Default)]
struct Notes {
    names: BTreeSet<(Option<String>, String)>,
    unlabelled: Vec<String>,
    twice: Vec<String>,
    unreadable: Vec<String>,
    outside: Vec<String>,
    digest: Sha256,
}

impl Frames {
    /// Reads everything once.
    ///
    /// # Errors
    /// [`GridError::Nothing`] when no frame can be scored; [`GridError::Source`] when the data is not there.
    pub fn inspect(data: &Data) -> Result<Self, GridError> {
        let drives = data.open()?;
        let (kept, truths, drive_of) = Default::default();
        let mut frames = Self { drives, kept, truths, drive_of, input: Input::default(), place: 0, drive: 0 };
        let mut notes = Notes::default();
        let mut seen = 0;
        while let Some(frame) = frames.advance() {
            seen += 1;
            frames.note(data, frame, &mut notes);
        }
        let warnings = notes.warnings();
        if frames.truths.is_empty() {
            let why = match warnings.first() {
                Some(first) => first.clone(),
                None => "there is no frame".to_owned(),
            };
            return Err(GridError::Nothing { source_name: data.name(), frames: seen, why });
        }
        let mut known: Vec<_> = frames.drive_of.iter().flatten().collect();
        known.sort();
        known.dedup();
        let digest = modulo_models::hex(&notes.digest.finalize());
        let (all, drives) = (frames.truths.len(), known.len());
        let without_twin = BTreeMap::new();
        frames.input = Input { frames: seen, labelled: all, drives, digest, warnings, without_twin };
        Ok(frames)
    }

    /// How many are scored.
    pub fn len(&self) -> usize {
        self.truths.len()
    }

    /// Back to the first one.
    ///
    /// # Errors
    /// [`SourceError`] when the data is no longer there.
    pub fn rewind(&mut self) -> Result<(), SourceError> {
        (self.place, self.drive) = (0, 0);
        self.drives.iter_mut().try_for_each(|(_, source)| source.rewind())
    }

    /// Which of the scored frames lies at a place.
    pub fn number_of(&self, place: usize) -> Option<usize> {
        self.kept.get(&place).copied()
    }

    /// The next one, scored or not.
    pub fn raw(&mut self) -> Option<Raw> {
        let place = self.place;
        let frame = self.advance()?;
        Some(Raw { place, drive: self.drive, frame })
    }

    fn advance(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        while let Some((_, source)) = self.drives.get_mut(self.drive) {
            if let Some(frame) = source.next() {
                self.place += 1;
                return Some(frame);
            }
            self.drive += 1;
        }
        None
    }

    fn note(&mut self, data: &Data, frame: Result<SourceFrame, SourceError>, notes: &mut Notes) {
        let place = self.place - 1;
        let drive = self.drives.get(self.drive).and_then(|(drive, _)| drive.clone());
        let frame = match frame {
            Ok(frame) => frame,
            Err(why) => return notes.unreadable.push(why.to_string()),
        };
        let drive = drive.or_else(|| data.drive_of(&frame.name));
        if !notes.names.insert((drive.clone(), frame.name.clone())) {
            return notes.twice.push(frame.name);
        }
        let Some(truth) = frame.ground_truth else { return notes.unlabelled.push(frame.name) };
        let (height, width, _) = frame.radiance.dim();
        let truth = notes.inside(truth, &frame.name, (height, width));
        notes.digest.update(format!("{drive:?} {} {height} {width} {truth:?}\n", frame.name));
        self.kept.insert(place, self.truths.len());
        self.truths.push(truth);
        self.drive_of.push(drive);
    }
}

impl Notes {
    /// Labels cut to the image; those that lie outside are left out.
    fn inside(
        &mut self,
        truth: Vec<GroundTruth>,
        name: &str,
        (height, width): (usize, usize),
    ) -> Vec<GroundTruth> {
        let mut kept = Vec::with_capacity(truth.len());
        for label in truth {
            let bbox = label.bbox.clamp(height, width);
            let [old, new] = [label.bbox, bbox].map(|b| [b.x1, b.y1, b.x2, b.y2]);
            let beyond = old.iter().zip(new).any(|(old, new)| (old - new).abs() > TOLERANCE);
            if beyond && label.class != DONT_CARE {
                self.outside.push(format!("{} of {name}", label.class));
            }
            if bbox.area() > 0.0 {
                kept.push(GroundTruth { bbox, ..label });
            }
        }
        kept
    }

    fn warnings(&self) -> Vec<String> {
        let told = |what: &str, names: &[String]| {
            names.first().map(|first| format!("{} {what}, the first: {first}", names.len()))
        };
        [
            told("frames are not readable and left out", &self.unreadable),
            told("frames have no labels and are left out", &self.unlabelled),
            told("frames are there twice and count once", &self.twice),
            told("labels reach outside the image and are cut", &self.outside),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}
