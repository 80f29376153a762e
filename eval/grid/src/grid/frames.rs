//! [`Frames`]: the frames that can be scored. They are checked once and read again for every cell.
//! [`FrameWithNeighbours`]: such a frame with the frames before and after it.
//!
//! A frame that cannot be scored is left out here, with a warning, and nowhere else: every cell gets the same frames.

use std::collections::{BTreeMap, BTreeSet};

use modulo_ap::difficulty::DONT_CARE;
use modulo_bags::source::{GroundTruth, LightChange, Skipped, SourceError, SourceFrame, SourceOptions};
use ndarray::Array3;
use sha2::{Digest, Sha256};

use super::request::{Data, Drive};
use crate::GridError;
use crate::classes::folded;
use crate::results::Input;

/// Labels that reach outside the image by at most this many px give no warning: they were rounded.
const TOLERANCE: f32 = 1.0;

/// The frames of a grid, and a position among them.
pub struct Frames {
    drives: Vec<Drive>,
    /// Number of each scored frame by its index over all drives.
    kept: BTreeMap<usize, usize>,
    pub scored: Vec<ScoredFrame>,
    /// Description of the data for the results.
    pub input: Input,
    place: usize,
    drive: usize,
}

/// A frame that is scored, with all that the scores need of it.
#[derive(Clone)]
pub struct ScoredFrame {
    pub name: String,
    pub truth: Vec<GroundTruth>,
    pub drive: Option<String>,
    /// The change of the light around it.
    pub change: Option<LightChange>,
}

/// A frame of the data, scored or not.
pub struct Raw {
    /// Index over all drives.
    pub place: usize,
    /// Index of the drive.
    pub drive: usize,
    /// The frame, or the reason why it cannot be read.
    pub frame: Result<SourceFrame, SourceError>,
}

/// Problems that are found while the data is checked.
#[derive(Default)]
struct Notes {
    names: BTreeSet<(Option<String>, String)>,
    unlabelled: Skipped,
    twice: Skipped,
    unreadable: Skipped,
    outside: Skipped,
    flat: Skipped,
    digest: Sha256,
    /// Index of the present drive, and of its first frame over all drives.
    start: (usize, usize),
}

impl Frames {
    /// Reads and checks all frames, of which at least one can be scored.
    pub fn inspect(data: &Data, options: &SourceOptions) -> Result<Self, GridError> {
        // All frames are read once before the first cell. A frame that turned out to be damaged in the middle of a run
        // would be scored in some cells only.
        let drives = data.open(options)?;
        let (kept, scored, input) = Default::default();
        let mut frames = Self { drives, kept, scored, input, place: 0, drive: 0 };
        let mut notes = Notes::default();
        let mut seen = 0;
        while let Some(raw) = frames.raw() {
            seen += 1;
            frames.note(data, raw, &mut notes);
        }
        let mut warnings = notes.warnings();
        let found =
            frames.drives.iter().flat_map(|(_, source)| [source.losses(), source.warnings()].concat());
        warnings.extend(found);
        if frames.scored.is_empty() {
            let why = warnings.into_iter().next().unwrap_or_else(|| "there is no frame".to_owned());
            return Err(GridError::Nothing(data.name(), seen, why));
        }
        let drives =
            frames.scored.iter().filter_map(|frame| frame.drive.as_ref()).collect::<BTreeSet<_>>().len();
        let digest = modulo_models::hex(&notes.digest.finalize());
        let labelled = frames.len();
        frames.input = Input { frames: seen, labelled, drives, digest, warnings, ..Input::default() };
        Ok(frames)
    }

    /// Number of scored frames.
    pub fn len(&self) -> usize {
        self.scored.len()
    }

    /// Reads the next frame, scored or not.
    pub fn raw(&mut self) -> Option<Raw> {
        while let Some((_, source)) = self.drives.get_mut(self.drive) {
            if let Some(frame) = source.next() {
                self.place += 1;
                return Some(Raw { place: self.place - 1, drive: self.drive, frame });
            }
            self.drive += 1;
        }
        None
    }

    fn note(&mut self, data: &Data, Raw { place, drive, frame }: Raw, notes: &mut Notes) {
        if notes.start.0 != drive {
            notes.start = (drive, place);
        }
        let change =
            data.light_of(drive).and_then(|light| light.nearest_change((place - notes.start.1) as u64));
        let (drive, _) = &self.drives[drive];
        let frame = match frame {
            Ok(frame) => frame,
            Err(why) => return notes.unreadable.add(why.to_string()),
        };
        let drive = drive.clone().or_else(|| data.drive_of(&frame.name));
        // Two drives can have frames of one name. Within a drive, a frame that comes twice would count twice.
        if !notes.names.insert((drive.clone(), frame.name.clone())) {
            return notes.twice.add(frame.name);
        }
        let Some(truth) = frame.ground_truth else { return notes.unlabelled.add(frame.name) };
        let (height, width, _) = frame.radiance.dim();
        let truth = notes.inside(truth, &frame.name, (height, width));
        notes.digest.update(format!("{drive:?} {} {height} {width} {truth:?}\n", frame.name));
        // The digest covers the pixels, too: results of other images with the same names and labels must not be joined.
        let pixels: Vec<u8> = frame.radiance.iter().flat_map(|value| value.to_le_bytes()).collect();
        notes.digest.update(pixels);
        self.kept.insert(place, self.scored.len());
        self.scored.push(ScoredFrame { name: frame.name, truth, drive, change });
    }
}

impl Notes {
    /// Clips labels to the image, with their classes [`folded`]. Labels outside the image are left out.
    fn inside(
        &mut self,
        truth: Vec<GroundTruth>,
        name: &str,
        (height, width): (usize, usize),
    ) -> Vec<GroundTruth> {
        let mut kept = Vec::with_capacity(truth.len());
        for label in truth {
            let label = GroundTruth { class: folded(&label.class), ..label };
            let bbox = label.bbox.clamp(height, width);
            let [old, new] = [label.bbox, bbox].map(|b| [b.x1, b.y1, b.x2, b.y2]);
            let beyond = old.iter().zip(new).any(|(old, new)| (old - new).abs() > TOLERANCE);
            // Cutting a DontCare area changes no score, so that it needs no warning.
            if beyond && label.class != DONT_CARE {
                self.outside.add(format!("{} of {name}", label.class));
            }
            if bbox.area() > 0.0 {
                kept.push(GroundTruth { bbox, ..label });
            } else if !beyond && label.class != DONT_CARE {
                self.flat.add(format!("{} of {name}", label.class));
            }
        }
        kept
    }

    fn warnings(&self) -> Vec<String> {
        [
            self.unreadable.line("frames are not readable and left out"),
            self.unlabelled.line("frames have no labels and are left out"),
            self.twice.line("frames are there twice and count once"),
            self.outside.line("labels reach outside the image and are cut"),
            self.flat.line("labels have no area and are left out"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// A frame that is scored.
#[derive(Clone)]
pub struct FrameWithNeighbours {
    /// Number among the frames that are scored.
    pub number: usize,
    /// Index of the drive.
    pub drive: usize,
    pub frame: SourceFrame,
    /// Radiance of the frames before and after it, with or without labels. At the ends of a drive the frame itself stands
    /// in. `None` if no pipeline needs it.
    pub around: Option<[Array3<f32>; 2]>,
}

/// Iterates over the frames that are scored, in their order.
pub struct FramesWithNeighbours<'a> {
    frames: &'a mut Frames,
    with_neighbours: bool,
    /// Drive and radiance of the frame before.
    before: Option<(usize, Array3<f32>)>,
    ahead: Option<Raw>,
}

impl<'a> FramesWithNeighbours<'a> {
    /// Starts at the first frame. Each frame comes with its neighbours or without them.
    pub fn new(frames: &'a mut Frames, with_neighbours: bool) -> Result<Self, SourceError> {
        (frames.place, frames.drive) = (0, 0);
        frames.drives.iter_mut().try_for_each(|(_, source)| source.rewind())?;
        Ok(Self { frames, with_neighbours, before: None, ahead: None })
    }

    fn around(&self, raw: &Raw) -> Option<[Array3<f32>; 2]> {
        let own = &raw.frame.as_ref().ok()?.radiance;
        // Frames of another drive show another scene, and captures of different sizes cannot be merged.
        let fits = |drive: usize, other: &Array3<f32>| drive == raw.drive && other.dim() == own.dim();
        let before =
            self.before.as_ref().filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        let after =
            self.ahead.as_ref().and_then(|ahead| Some((ahead.drive, &ahead.frame.as_ref().ok()?.radiance)));
        let after = after.filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        Some([before.unwrap_or(own).clone(), after.unwrap_or(own).clone()])
    }
}

impl Iterator for FramesWithNeighbours<'_> {
    type Item = Result<FrameWithNeighbours, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let raw = self.ahead.take().or_else(|| self.frames.raw())?;
            let mut around = None;
            // One frame is read ahead. It is kept in `ahead`, because a source is read only forwards.
            if self.with_neighbours {
                self.ahead = self.frames.raw();
                around = self.around(&raw);
                self.before = raw.frame.as_ref().ok().map(|frame| (raw.drive, frame.radiance.clone()));
            }
            if let Some(&number) = self.frames.kept.get(&raw.place) {
                let drive = raw.drive;
                return Some(raw.frame.map(|frame| FrameWithNeighbours { number, drive, frame, around }));
            }
        }
    }
}
