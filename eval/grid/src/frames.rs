//! [`Frames`]: the frames that one camera takes, in slices.
//!
//! A frame that cannot be read is left out here, with a warning, and nowhere else: every cell gets the same frames.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use modulo_ap::difficulty::DONT_CARE;
use modulo_bags::source::{FrameList, GroundTruth, Source, SourceError, SourceFrame};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::classes::folded;
use crate::data::{Drive, LabelNames};
use crate::rows;

/// Labels that reach outside the image by at most this many px give no warning: they were rounded.
const TOLERANCE: f32 = 1.0;

/// The frames of a camera, and a position among them.
pub struct Frames {
    /// The data, as it was given.
    name: String,
    drives: Vec<Drive>,
    /// The names of the classes of the labels.
    names: LabelNames,
    /// Whether its frames are single images, which do not follow each other.
    pub is_still: bool,
    /// Whether each frame should have labels, and be there once.
    pub is_labelled: bool,
    /// The drives of the frames, if a list names them.
    pub list: Option<FrameList>,
    /// The number of frames to take; `None` for all.
    pub most: Option<usize>,
    /// Whether they start again after the last one.
    pub repeats: bool,
    /// Whether no frame of this round was good: then there would be no end.
    is_vain: bool,
    /// Index of the next frame over all drives, and of the present drive and its first frame.
    place: usize,
    drive: usize,
    start: usize,
}

/// A frame on its way to a camera.
#[derive(Clone, Debug)]
pub struct HandedFrame {
    /// Index over all drives.
    pub place: usize,
    /// Index of the drive.
    pub drive: usize,
    /// The frame.
    pub frame: SourceFrame,
}

/// The frames of a camera from one place to another, as they are stored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Slice {
    /// The data, as it was given.
    pub source: String,
    /// The names of the classes of the labels.
    pub names: LabelNames,
    /// Whether each frame should have labels.
    pub is_labelled: bool,
    /// The places of its first frame and behind its last one, over all drives.
    pub places: [usize; 2],
    /// The frames that can be read.
    pub frames: Vec<FrameRecord>,
    /// The frames and labels that were left out or changed, by what is wrong with them.
    pub left_out: BTreeMap<String, Vec<String>>,
    /// What the sources say of themselves.
    pub warnings: BTreeSet<String>,
}

/// A frame, with all that the scores need of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Index over all drives.
    pub place: usize,
    /// Name of the frame, such as that of its file.
    pub name: String,
    /// Name of its drive, if it is known.
    pub drive: Option<String>,
    /// Rows and columns.
    pub size: [usize; 2],
    /// The labelled objects; `None` without labels.
    #[serde(with = "rows::labels")]
    pub truth: Option<Vec<GroundTruth>>,
    /// sha256 of its name, its labels and its pixels, hexadecimal.
    pub digest: String,
}

/// A frame of the data with its place and its drive, or the reason why it cannot be read.
type Raw = (usize, usize, Result<SourceFrame, SourceError>);

impl Frames {
    /// Frames of drives that follow each other.
    pub fn new(name: String, drives: Vec<Drive>) -> Self {
        Self {
            name,
            drives,
            names: LabelNames::Kitti,
            is_still: false,
            is_labelled: false,
            list: None,
            most: None,
            repeats: false,
            is_vain: true,
            place: 0,
            drive: 0,
            start: 0,
        }
    }

    /// Single images with labels.
    pub fn of_stills(name: String, names: LabelNames, source: Source) -> Self {
        Self { names, is_still: true, is_labelled: true, ..Self::new(name, vec![(None, source)]) }
    }

    /// Reads and checks the frames at `places`, or as many of them as there are. All are read once before the first cell: a frame that turned
    /// out to be damaged in the middle of a run would be scored in some cells only.
    pub fn inspect(&mut self, places: Range<usize>) -> Slice {
        self.seek(places.start);
        let mut slice = Slice {
            source: self.name.clone(),
            names: self.names,
            is_labelled: self.is_labelled,
            places: [places.start; 2],
            ..Slice::default()
        };
        let mut names = BTreeSet::new();
        while slice.places[1] < places.end
            && let Some(raw) = self.raw()
        {
            slice.places[1] += 1;
            self.note(raw, &mut slice, &mut names);
        }
        let found = self.drives.iter().flat_map(|(_, source)| source.losses.iter().chain(&source.warnings));
        slice.warnings = found.cloned().collect();
        slice
    }

    /// Goes to the frame at `place`.
    fn seek(&mut self, place: usize) {
        self.drives.iter_mut().for_each(|(_, source)| source.rewind());
        (self.place, self.drive, self.start, self.is_vain) = (0, 0, 0, true);
        while let Some((_, source)) = self.drives.get_mut(self.drive) {
            let Some(length) = source.len.filter(|_| !self.repeats) else { break };
            if self.start + length > place {
                // Its frames need not be read to be skipped.
                source.pass((place - self.start) as u64);
                self.place = place;
                return;
            }
            self.start += length;
            (self.place, self.drive) = (self.start, self.drive + 1);
        }
        while self.place < place && self.raw().is_some() {}
    }

    /// Reads the next frame.
    fn raw(&mut self) -> Option<Raw> {
        while let Some((_, source)) = self.drives.get_mut(self.drive)
            && self.most.is_none_or(|most| self.place < most)
        {
            let mut next = source.next();
            if next.is_none() && self.repeats && !self.is_vain {
                self.is_vain = true;
                source.rewind();
                next = source.next();
            }
            if let Some(frame) = next {
                self.is_vain &= frame.is_err();
                self.place += 1;
                return Some((self.place - 1, self.drive, frame));
            }
            (self.drive, self.start) = (self.drive + 1, self.place);
        }
        None
    }

    fn note(
        &self,
        (place, drive, frame): Raw,
        slice: &mut Slice,
        names: &mut BTreeSet<(Option<String>, String)>,
    ) {
        let (name_of_drive, _) = &self.drives[drive];
        let frame = match frame {
            Ok(frame) => frame,
            Err(why) => return slice.leave_out("frames are not readable and left out", why.to_string()),
        };
        let of_list = || Some(self.list.as_ref()?.drive_of(&frame.name)?.to_owned());
        let drive = name_of_drive.clone().or_else(of_list);
        // Two drives can have frames of one name. Within a drive, a frame that comes twice would count twice.
        if !names.insert((drive.clone(), frame.name.clone())) && slice.is_labelled {
            return slice.leave_out("frames are there twice and count once", frame.name);
        }
        let (height, width, _) = frame.radiance.dim();
        if frame.ground_truth.is_none() && slice.is_labelled {
            slice.leave_out("frames have no labels and are not scored", frame.name.clone());
        }
        let truth = frame.ground_truth.map(|truth| slice.inside(truth, &frame.name, (height, width)));
        let mut digest = Sha256::new();
        digest.update(format!("{drive:?} {} {height} {width} {truth:?}\n", frame.name));
        // The digest covers the pixels, too: results of other images with the same names and labels must not be joined.
        for row in frame.radiance.outer_iter() {
            digest.update(row.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>());
        }
        let digest = modulo_models::hex(&digest.finalize());
        let (name, size) = (frame.name, [height, width]);
        slice.frames.push(FrameRecord { place, name, drive, size, truth, digest });
    }
}

impl Slice {
    /// Why no frame of the source of a camera can be read.
    pub fn nothing(&self) -> Option<String> {
        let is_vain = self.frames.is_empty() && !self.is_labelled;
        let first = self.left_out.values().flatten().next().filter(|_| is_vain);
        first.map(|why| format!("no frame of the source is good: {why}"))
    }

    fn leave_out(&mut self, why: &str, one: String) {
        self.left_out.entry(why.to_owned()).or_default().push(one);
    }

    /// Clips labels to the image, with their classes [`folded`]. Labels outside the image are left out, and second ones of an
    /// object.
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
                self.leave_out(
                    "labels reach outside the image and are cut",
                    format!("{} of {name}", label.class),
                );
            }
            let label = GroundTruth { bbox, ..label };
            if kept.contains(&label) && label.class != DONT_CARE {
                // Joined exports hold an object twice, and a detector finds it once.
                self.leave_out("labels are there twice and count once", format!("{} of {name}", label.class));
            } else if bbox.area() > 0.0 {
                kept.push(label);
            } else if !beyond && label.class != DONT_CARE {
                self.leave_out("labels have no area and are left out", format!("{} of {name}", label.class));
            }
        }
        kept
    }
}

/// Iterates over the frames of a slice, and those that lead to it, in their order.
pub struct Walk<'a> {
    frames: &'a mut Frames,
    slice: &'a Slice,
    /// The index in the slice of the next frame.
    next: usize,
}

impl<'a> Walk<'a> {
    /// Starts at the first frame of `slice`, or with `is_led` at that of its drive.
    pub fn new(frames: &'a mut Frames, slice: &'a Slice, is_led: bool) -> Self {
        frames.seek(slice.places[0]);
        if is_led && frames.start < slice.places[0] {
            frames.seek(frames.start);
        }
        Self { frames, slice, next: 0 }
    }
}

impl Iterator for Walk<'_> {
    /// The index of the frame in the slice, which a frame before it does not have; and the frame.
    type Item = Result<(Option<usize>, HandedFrame), SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (place, drive, frame) = self.frames.raw()?;
            if place >= self.slice.places[1] {
                return None;
            }
            let index = self.next;
            let is_next = self.slice.frames.get(index).is_some_and(|record| record.place == place);
            let handed = |frame| HandedFrame { place, drive, frame };
            match frame {
                frame if is_next => {
                    self.next += 1;
                    return Some(frame.map(|frame| (Some(index), handed(frame))));
                }
                Ok(frame) if place < self.slice.places[0] => return Some(Ok((None, handed(frame)))),
                _ => {}
            }
        }
    }
}
