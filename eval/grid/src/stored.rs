//! [`Stored`]: all that lies in the folders of one evaluation.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use modulo_bags::source::GroundTruth;
use modulo_core::Detection;

use crate::GridError;
use crate::data::LabelNames;
use crate::frames::{FrameRecord, Slice};
use crate::pictures::LEAST_SHOWN;
use crate::store::{self, CellSlice, Folder, FrameFound};

/// The stream of what a camera without a limit of light would take.
pub const IDEAL: &str = "ideal";

/// The frames of a camera, in all slices.
#[derive(Default)]
pub struct Scene {
    /// The data, as it was given.
    pub source: String,
    /// The names of the classes of its labels.
    pub names: LabelNames,
    /// Whether each frame should have labels.
    pub is_labelled: bool,
    /// The frames that can be read, by their places.
    pub frames: BTreeMap<usize, FrameRecord>,
    /// The places of all frames that were looked at.
    pub places: BTreeSet<usize>,
    /// The frames and labels that were left out or changed, by what is wrong with them.
    pub left_out: BTreeMap<String, BTreeSet<String>>,
    /// What the sources say of themselves.
    pub warnings: BTreeSet<String>,
}

impl Scene {
    fn add(&mut self, folder: &Folder, slice: Slice) -> Result<(), GridError> {
        (self.source, self.names, self.is_labelled) = (slice.source, slice.names, slice.is_labelled);
        for frame in slice.frames {
            let other = self.frames.get(&frame.place).filter(|other| other.digest != frame.digest);
            if let Some(other) = other {
                let why = format!(
                    "its frame {} is not frame {} of the other folders, so that they cannot be shown together",
                    frame.name, other.name
                );
                return Err(GridError::of_file(folder.path(), why));
            }
            self.frames.insert(frame.place, frame);
        }
        self.places.extend(slice.places[0]..slice.places[1]);
        self.warnings.extend(slice.warnings);
        for (why, ones) in slice.left_out {
            self.left_out.entry(why).or_default().extend(ones);
        }
        Ok(())
    }
}

/// All that lies in folders. The boxes are read cell by cell, since those of all cells may be gigabytes.
pub struct Stored {
    /// The frames, by the name of their files.
    pub scenes: BTreeMap<String, Scene>,
    /// The files of each cell.
    files: BTreeMap<String, Vec<PathBuf>>,
}

impl Stored {
    /// Reads the frames in folders.
    ///
    /// # Errors
    /// [`GridError`] of a file that cannot be read, and of results that cannot be shown together.
    pub fn read(folders: &[Folder]) -> Result<Self, GridError> {
        let mut stored = Self { scenes: BTreeMap::new(), files: BTreeMap::new() };
        for folder in folders {
            for (name, slice) in folder.slices()? {
                stored.scenes.entry(name).or_default().add(folder, slice)?;
            }
            for (name, file) in folder.cells()? {
                stored.files.entry(name).or_default().push(file);
            }
        }
        Ok(stored)
    }

    /// Where no frame has labels, takes what the one cell of the stream `ideal` has found for them, so that the others can be compared with it.
    /// Returns the sentence that says so.
    ///
    /// # Errors
    /// [`GridError`] of a file that cannot be read.
    pub fn refer_to_ideal(&mut self) -> Result<Option<String>, GridError> {
        if self.scenes.values().flat_map(|scene| scene.frames.values()).any(|frame| frame.truth.is_some()) {
            return Ok(None);
        }
        let cells = self.cells().filter(|cell| cell.as_ref().map_or(true, |cell| cell.key.point.is(IDEAL)));
        // With several models or lenses, each would have a reference of its own: two suffice to see it.
        let cells = cells.take(2).collect::<Result<Vec<_>, _>>()?;
        let [ideal] = &cells[..] else { return Ok(None) };
        let Some(scene) = self.scenes.get_mut(&ideal.key.frames) else { return Ok(None) };
        scene.names = LabelNames::Model;
        let found: BTreeMap<usize, &FrameFound> =
            ideal.frames.iter().map(|frame| (frame.place, frame)).collect();
        for (place, frame) in &mut scene.frames {
            let boxes = found.get(place).and_then(|found| found.boxes.as_ref());
            let label = |Detection { bbox, class, .. }: &Detection| GroundTruth {
                bbox: *bbox,
                class: class.clone(),
                truncated: -1.0,
                occluded: -1,
            };
            let drawn = |boxes: &Vec<Detection>| {
                boxes.iter().filter(|found| found.score >= LEAST_SHOWN).map(label).collect()
            };
            frame.truth = boxes.map(drawn);
        }
        Ok(Some(format!(
            "No frame has labels: the reference is what the model finds with a score of at least {LEAST_SHOWN} in the image of a camera \
             without a limit of light ({IDEAL})"
        )))
    }

    /// Reads each cell, all slices of it as one.
    pub fn cells(&self) -> impl Iterator<Item = Result<CellSlice, GridError>> {
        self.files.values().map(|paths| {
            let (mut cell, mut found) = (CellSlice::default(), BTreeMap::new());
            for path in paths {
                let Some(slice) = store::read::<CellSlice>(path)? else { continue };
                cell.key = slice.key;
                if !slice.classes.is_empty() {
                    cell.classes = slice.classes;
                }
                found.extend(slice.frames.into_iter().map(|frame| (frame.place, frame)));
            }
            cell.frames = found.into_values().collect();
            Ok(cell)
        })
    }
}
