//! [`Scorer`]: computes the figures of a cell from the results of its frames.

use std::collections::{BTreeMap, BTreeSet};

use modulo_ap::Difficulty;
use modulo_ap::average::{self, Membership, image_boxes};
use modulo_ap::difficulty::DONT_CARE;
use modulo_ap::matching::ImageBoxes;
use modulo_core::Detection;
use modulo_detector::{EngineDevice, EngineOptions, class_names};

use super::around;
use super::frames::{Frames, ScoredFrame};
use super::pipeline::{ImageSimilarity, RecoveryQuality};
use super::runner::FrameResult;
use super::{Axes, Request};
use crate::GridError;
use crate::classes::{ClassGroups, ClassMap};
use crate::metric::{bootstrap, paper};
use crate::results::{Cell, ClassScore, Paper, Point};

/// Least share of exact wrap counts of a frame that may be trusted: docs/explanation/trust.md promises it.
const LEAST_TRUSTED_SHARE: f64 = 0.999;

/// The ground truth and the rules of scoring.
pub struct Scorer {
    pub frames: Vec<ScoredFrame>,
    /// Mapping from the classes of the models to those of the labels.
    map: ClassMap,
    pub groups: ClassGroups,
    mapped: MappedClasses,
    /// The objects that are scored.
    pub difficulty: Difficulty,
    units: bootstrap::Units,
}

/// For each model the classes of the labels that it can find.
type MappedClasses = BTreeMap<String, BTreeSet<String>>;

/// Detections of each frame, in the classes of the labels.
pub type Found = Vec<Vec<Detection>>;

impl Scorer {
    /// The rules of `request` for `frames`. Notes in `frames.input` the units of the bootstrap, and the classes without a group or
    /// a counterpart.
    pub fn new(
        request: &Request,
        map: ClassMap,
        groups: ClassGroups,
        frames: &mut Frames,
    ) -> Result<Self, GridError> {
        frames.input.warnings.extend(groups.unnamed(frames.scored.iter().flat_map(|frame| &frame.truth)));
        let drives: Vec<_> = frames.scored.iter().map(|frame| frame.drive.clone()).collect();
        let units = bootstrap::Units::new(&drives, request.options.seed);
        frames.input.drawn = Some(units.drawn);
        let mapped = mapped_classes(request, &map, frames)?;
        let (frames, difficulty) = (frames.scored.clone(), request.difficulty());
        Ok(Self { frames, map, groups, mapped, difficulty, units })
    }

    pub fn cell(&self, point: Point, frames: &[FrameResult]) -> Cell {
        let (found, mapped) = (self.mapped_detections(frames), &self.mapped[&point.model]);
        let groups: BTreeMap<&str, Vec<ImageBoxes>> = self
            .groups
            .names()
            .into_iter()
            .map(|group| (group, self.of_group(&found, group, self.difficulty)))
            .collect();
        // The figures of the paper are computed for every protocol, as a comparison with COCO's.
        let papers = self.papers(&found);
        let nearest = self.nearest_found(&found);
        let moments = self.moments(&groups.values().cloned().collect::<Vec<_>>(), &nearest);
        Cell {
            name: point.file_name(),
            point,
            frames: frames.len(),
            unanswered: frames.iter().filter(|frame| frame.found.is_none()).count(),
            ap50: by_group(&groups, |images| average::ap(images, 0.5)),
            ap50_95: average::mean(groups.values().filter_map(|images| average::ap50_95(images))),
            objects: by_group(&groups, |images| images.iter().map(ImageBoxes::objects).sum()),
            classes: self.classes(&found, mapped),
            difficulty: self.difficulties(&found),
            interval95: self.intervals(&groups, &papers, &nearest),
            nearest: around::share(nearest.iter().flatten().copied()),
            moments,
            paper: paper::mean(&papers),
            // The times are measured in a pass of their own.
            ..recovered(frames)
        }
    }

    /// The detections in the classes of the labels. Classes without a counterpart are dropped.
    pub(super) fn mapped_detections(&self, frames: &[FrameResult]) -> Found {
        frames.iter().map(|frame| self.map.all(frame.found.iter().flat_map(|found| found.iter()))).collect()
    }

    fn of_group(&self, found: &Found, group: &str, difficulty: Difficulty) -> Vec<ImageBoxes> {
        self.images(found, difficulty, |class| self.groups.membership(class, group))
    }

    /// The images for one class. Classes of its group that the model cannot find are ignored.
    fn of_class(&self, found: &Found, class: &str, mapped: &BTreeSet<String>) -> Vec<ImageBoxes> {
        let group = self.groups.of(class);
        self.images(found, self.difficulty, |other| match other {
            other if other == class => Membership::Member,
            other if group.is_some() && self.groups.of(other) == group && !mapped.contains(other) => {
                Membership::Ignored
            }
            _ => Membership::Other,
        })
    }

    fn images(
        &self,
        found: &Found,
        difficulty: Difficulty,
        membership: impl Fn(&str) -> Membership,
    ) -> Vec<ImageBoxes> {
        let frames = found.iter().zip(&self.frames);
        frames.map(|(found, frame)| image_boxes(found, &frame.truth, difficulty, &membership)).collect()
    }

    fn classes(&self, found: &Found, mapped: &BTreeSet<String>) -> BTreeMap<String, ClassScore> {
        let score = |class: &String| {
            let images = self.of_class(found, class, mapped);
            let objects = images.iter().map(ImageBoxes::objects).sum();
            let (ap50, ap50_95) = (average::ap(&images, 0.5)?, average::ap50_95(&images)?);
            Some((class.clone(), ClassScore { ap50, ap50_95, objects }))
        };
        mapped.iter().filter_map(score).collect()
    }

    fn difficulties(&self, found: &Found) -> BTreeMap<Difficulty, BTreeMap<String, Option<f64>>> {
        let groups = self.groups.names();
        let score = |difficulty: Difficulty| {
            let ap = |group: &&str| {
                (String::from(*group), average::ap(&self.of_group(found, group, difficulty), 0.5))
            };
            (difficulty, groups.iter().map(ap).collect())
        };
        Difficulty::WORDS.map(|(_, difficulty)| score(difficulty)).into()
    }

    pub(super) fn papers(&self, found: &Found) -> Vec<Paper> {
        let of_image = |(found, frame): (&Vec<Detection>, &ScoredFrame)| {
            let labels = frame.truth.iter().filter(|label| label.class != DONT_CARE);
            let labels: Vec<_> = labels.map(|label| (label.bbox, label.class.as_str())).collect();
            paper::of_image(found, &labels)
        };
        found.iter().zip(&self.frames).map(of_image).collect()
    }

    fn intervals(
        &self,
        groups: &BTreeMap<&str, Vec<ImageBoxes>>,
        papers: &[Paper],
        nearest: &[Option<bool>],
    ) -> BTreeMap<String, [f64; 2]> {
        let mut intervals = BTreeMap::new();
        for (group, images) in groups {
            // The matching does not depend on the draw, so that it is done once and not a thousand times.
            let sample = average::Sample::new(images, 0.5);
            if let Some(interval) = self.units.interval(|times| sample.ap(times)) {
                intervals.insert(format!("ap50.{group}"), interval);
            }
        }
        let mut add = |name: &str, figures: Vec<Option<f64>>| {
            let mean = |times: &[u64]| {
                let drawn = figures.iter().zip(times).filter_map(|(figure, &n)| Some(((*figure)?, n as f64)));
                let (sum, all) =
                    drawn.fold((0.0, 0.0), |(sum, all), (figure, n)| (sum + figure * n, all + n));
                (all > 0.0).then(|| sum / all)
            };
            intervals.extend(self.units.interval(mean).map(|interval| (name.to_owned(), interval)));
        };
        add("nearest", nearest.iter().map(|found| found.map(|found| f64::from(u8::from(found)))).collect());
        add("paper.iou", papers.iter().map(|paper| Some(paper.iou)).collect());
        add("paper.f1", papers.iter().map(|paper| Some(paper.f1)).collect());
        add("paper.accuracy", papers.iter().map(|paper| Some(paper.accuracy)).collect());
        intervals
    }
}

/// Finds the mapped classes of each model, and notes in `frames.input` the classes without a counterpart.
fn mapped_classes(
    request: &Request,
    map: &ClassMap,
    frames: &mut Frames,
) -> Result<MappedClasses, GridError> {
    let labels = frames.scored.iter().flat_map(|frame| &frame.truth).map(|label| label.class.clone());
    let labels: BTreeSet<String> = labels.filter(|class| class != DONT_CARE).collect();
    let mut all = MappedClasses::new();
    let options = EngineOptions { engine: request.options.engine, device: EngineDevice::Cpu, threads: 1 };
    for model in &request.options.axes.model {
        let name = Axes::model_name(model);
        let own = class_names(model, options)?;
        let found: BTreeSet<String> = own.iter().filter_map(|class| map.mapped(class)).collect();
        // A model without class names may find every class.
        let mapped =
            if own.is_empty() { labels.clone() } else { labels.intersection(&found).cloned().collect() };
        let without = &mut frames.input.without_twin;
        without.insert(format!("labels, for {name}"), labels.difference(&mapped).cloned().collect());
        without.insert(name.clone(), own.into_iter().filter(|class| map.mapped(class).is_none()).collect());
        all.insert(name, mapped);
    }
    Ok(all)
}

/// A cell with the figures of its recovered, merged or saturated images alone.
fn recovered(frames: &[FrameResult]) -> Cell {
    let recoveries = frames.iter().filter_map(|frame| frame.recovery.as_ref());
    let samples: u64 = recoveries.clone().map(|r| r.samples).sum();
    let exact: u64 = recoveries.clone().map(|r| r.exact).sum();
    let (psnr_db, ssim) = ImageSimilarity::mean(recoveries.clone().map(|r| &r.ideal));
    let (psnr_sharp_db, ssim_sharp) = ImageSimilarity::mean(recoveries.clone().map(|r| &r.sharp));
    let unwrapped = recoveries.clone().filter(|r| r.samples > 0);
    let wrong = |r: &&RecoveryQuality| r.trusted == Some(true) && r.exact_share() < LEAST_TRUSTED_SHARE;
    Cell {
        exact_k: (samples > 0).then(|| exact as f64 / samples as f64),
        exact_frames: around::share(unwrapped.clone().map(|r| r.exact == r.samples)),
        trusted: around::share(recoveries.filter_map(|r| r.trusted)),
        trusted_wrong: (samples > 0).then(|| unwrapped.filter(wrong).count()),
        psnr_db,
        ssim,
        psnr_sharp_db,
        ssim_sharp,
        ..Cell::default()
    }
}

fn by_group<T>(
    groups: &BTreeMap<&str, Vec<ImageBoxes>>,
    figure: impl Fn(&[ImageBoxes]) -> T,
) -> BTreeMap<String, T> {
    groups.iter().map(|(group, images)| ((*group).to_owned(), figure(images))).collect()
}
