//! [`score`]: the figures of the cells of folders, from the boxes and labels that are stored there. Nothing is run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use modulo_ap::Difficulty;
use modulo_ap::average::{self, Membership, image_boxes};
use modulo_ap::difficulty::{self, DONT_CARE};
use modulo_ap::matching::ImageBoxes;
use modulo_bags::source::{GroundTruth, Skipped};
use modulo_core::Detection;
use sha2::{Digest as _, Sha256};

use crate::GridError;
use crate::classes::{ClassGroups, ClassMap, Table};
use crate::data::LabelNames;
use crate::frames::FrameRecord;
use crate::metric::{bootstrap, latency};
use crate::quality::{ImageSimilarity, RECOVERY_DEFINITION, RecoveryQuality};
use crate::results::{Cell, CellKey, ClassScore, FIGURES, Input, Point, Results, Setup};
use crate::store::{CellSlice, Folder, FrameFound};
use crate::stored::{IDEAL, Scene, Stored};
use crate::verdict::{self, Judged};

/// Least share of exact wrap counts of a frame that may be trusted: docs/explanation/trust.md promises it.
pub(crate) const LEAST_TRUSTED_SHARE: f64 = 0.999;

/// How boxes are scored. Other values need no other run.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct ScoreOptions {
    /// Objects that are scored [default: moderate; all for YOLO and COCO labels]
    #[arg(long, value_parser = words(Difficulty::WORDS))]
    pub difficulty: Option<Difficulty>,
    /// File of lines `class of the model: class of the labels`, instead of the mapping from COCO to KITTI
    #[arg(long, value_name = "FILE")]
    pub class_map: Option<PathBuf>,
    /// File of lines `class of the labels: group`, instead of the groups vehicle and person
    #[arg(long, value_name = "FILE")]
    pub groups: Option<PathBuf>,
}

/// Reads one of the words of `table` from a command line as the value beside it.
pub fn words<T, const N: usize>(table: [(&'static str, T); N]) -> impl TypedValueParser<Value = T>
where
    T: Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(table.each_ref().map(|(word, _)| *word)).map(move |given| {
        let found = table.iter().find(|(word, _)| *word == given);
        found.map(|(_, value)| value.clone()).expect("clap takes only the words of the table")
    })
}

/// Returns the figures of all cells in `folders`.
///
/// # Errors
/// [`GridError`] of a file that cannot be read, and of results that cannot be shown together.
pub fn score(folders: &[Folder], options: &ScoreOptions) -> Result<Results, GridError> {
    let mut stored = Stored::read(folders)?;
    let mut input = input(&stored);
    let reference = stored.refer_to_ideal()?;
    let rules = Rules::new(&stored, options)?;
    input.warnings.extend(rules.unnamed.clone());
    let mut setup = Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        figures: FIGURES,
        source: distinct(stored.scenes.values().map(|scene| scene.source.clone())),
        difficulty: rules.difficulty,
        groups: rules.groups.0.clone(),
        ..Setup::default()
    };
    let mut cells = Vec::new();
    rules.score(&stored, |scorer| {
        let CellKey { point: Point { model: name, .. }, model, .. } = &scorer.cell.key;
        if setup.models.insert(name.clone(), model.clone()).is_some_and(|other| other != *model) {
            let why = format!("two files were model {name} in the cells, which cannot be shown together");
            return Err(GridError::of_file(folders[0].path(), why));
        }
        input.drawn = Some(scorer.units.drawn);
        scorer.note_classes(&mut input.without_twin);
        setup.class_map.clone_from(&scorer.map.table);
        cells.push(scorer.figures());
        Ok(())
    })?;
    cells.sort_by(|(a, _), (b, _)| a.point.order(&b.point));
    let (mut cells, judged): (Vec<Cell>, Vec<Judged>) = cells.into_iter().unzip();
    for folder in folders {
        setup.grid.extend(folder.plans()?);
        take_times(folder, &mut cells)?;
    }
    setup.grid.sort_by(Point::order);
    setup.grid.dedup();
    Ok(Results { setup, input, definitions: definitions(), verdict: verdict_of(judged, reference), cells })
}

/// The verdict, after the sentence that names the reference where the stream `ideal` is that.
fn verdict_of(mut judged: Vec<Judged>, reference: Option<String>) -> Option<String> {
    // The reference itself has found all of it.
    judged.retain(|cell| reference.is_none() || !cell.point.is(IDEAL));
    let said: Vec<String> = reference.into_iter().chain(verdict::sentence(&judged)).collect();
    (!said.is_empty()).then(|| said.join(". "))
}

/// Gives the cells the times that were measured last.
fn take_times(folder: &Folder, cells: &mut [Cell]) -> Result<(), GridError> {
    for (point, times) in folder.times()? {
        if let Some(cell) = cells.iter_mut().find(|cell| cell.point == point) {
            cell.take_times(times);
        }
    }
    Ok(())
}

fn distinct(texts: impl Iterator<Item = String>) -> String {
    texts.collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(", ")
}

/// The description of the frames.
fn input(stored: &Stored) -> Input {
    let (mut input, mut digest) = (Input::default(), Sha256::new());
    let mut drives = BTreeSet::new();
    for scene in stored.scenes.values() {
        input.frames += scene.places.len();
        let labelled: Vec<&FrameRecord> =
            scene.frames.values().filter(|frame| frame.truth.is_some()).collect();
        input.labelled += labelled.len();
        drives.extend(labelled.iter().filter_map(|frame| frame.drive.clone()));
        scene.frames.values().for_each(|frame| digest.update(&frame.digest));
        let lines = scene
            .left_out
            .iter()
            .filter_map(|(why, ones)| ones.iter().cloned().collect::<Skipped>().line(why));
        input.warnings.extend(lines.chain(scene.warnings.clone()));
        // Of a source of frames with labels, some may be without.
        let unlabelled = scene.frames.len() - labelled.len();
        if !scene.is_labelled && unlabelled > 0 && !labelled.is_empty() {
            input.warnings.push(format!("{unlabelled} frames have no labels, and are not scored"));
        }
    }
    (input.drives, input.digest) = (drives.len(), modulo_models::hex(&digest.finalize()));
    input
}

/// The rules of scoring.
pub(crate) struct Rules {
    class_map: Option<ClassMap>,
    /// The groups in which classes are scored.
    pub groups: ClassGroups,
    /// Whether each class is a group of its own.
    by_class: bool,
    /// Whether the user has named the groups, which are scored then whatever the model knows.
    are_given: bool,
    /// The objects that are scored.
    pub difficulty: Difficulty,
    /// A line about labels that no group holds.
    unnamed: Option<String>,
}

impl Rules {
    pub(crate) fn new(stored: &Stored, options: &ScoreOptions) -> Result<Self, GridError> {
        let class_map = options.class_map.as_deref().map(ClassMap::read).transpose()?;
        let mut groups =
            options.groups.as_deref().map_or_else(|| Ok(ClassGroups::default()), ClassGroups::read)?;
        let labels = || {
            stored
                .scenes
                .values()
                .flat_map(|scene| scene.frames.values())
                .flat_map(|frame| frame.truth.iter().flatten())
        };
        let mut unnamed = groups.unnamed(labels());
        let is_given = options.groups.is_some() || stored.scenes.values().any(|scene| scene.is_labelled);
        let by_class = unnamed.is_some() && !is_given;
        if by_class {
            // The classes of a launch file's own source need no groups.
            let classes = labels().map(|label| label.class.clone()).filter(|class| class != DONT_CARE);
            groups = ClassGroups(classes.map(|class| (class.clone(), class)).collect());
            unnamed = None;
        }
        // These labels have no information on it.
        let of_model = stored.scenes.values().any(|scene| scene.names == LabelNames::Model);
        let of_data = if of_model { Difficulty::All } else { Difficulty::Moderate };
        Ok(Self {
            class_map,
            groups,
            by_class,
            are_given: options.groups.is_some(),
            difficulty: options.difficulty.unwrap_or(of_data),
            unnamed,
        })
    }

    /// Passes each cell to `with`, with the frames that it is scored on.
    pub(crate) fn score(
        &self,
        stored: &Stored,
        mut with: impl FnMut(&Scorer<'_>) -> Result<(), GridError>,
    ) -> Result<(), GridError> {
        stored.cells().try_for_each(|cell| {
            let cell = cell?;
            let scene = stored.scenes.get(&cell.key.frames);
            scene.map_or(Ok(()), |scene| with(&Scorer::new(self, scene, &cell)))
        })
    }

    /// The mapping from the classes of a model to those of the labels.
    fn map(&self, names: LabelNames) -> ClassMap {
        match &self.class_map {
            Some(map) => map.clone(),
            None if self.by_class || names == LabelNames::Model => ClassMap::same(),
            None => ClassMap::kitti(),
        }
    }
}

/// A frame that is scored.
pub(crate) struct ScoredFrame<'a> {
    /// The frame.
    pub record: &'a FrameRecord,
    /// Its labelled objects.
    pub truth: &'a [GroundTruth],
    /// What the cell has found in it.
    found: &'a FrameFound,
}

/// The ground truth and what a cell has found in it.
pub(crate) struct Scorer<'a> {
    /// How it is scored.
    pub rules: &'a Rules,
    /// The cell.
    pub cell: &'a CellSlice,
    /// The labelled frames.
    pub frames: Vec<ScoredFrame<'a>>,
    /// Mapping from the classes of the model to those of the labels.
    map: ClassMap,
    /// The classes of the labels, and those of them that the model can find.
    labels: BTreeSet<String>,
    mapped: BTreeSet<String>,
    units: bootstrap::Units,
}

/// Detections of each frame, in the classes of the labels.
pub(crate) type Found = Vec<Vec<Detection>>;

impl<'a> Scorer<'a> {
    /// The labelled frames of `scene` that a cell has seen.
    fn new(rules: &'a Rules, scene: &'a Scene, cell: &'a CellSlice) -> Self {
        let scored = |found: &'a FrameFound| {
            let record = scene.frames.get(&found.place)?;
            Some(ScoredFrame { record, truth: record.truth.as_deref()?, found })
        };
        let frames: Vec<ScoredFrame<'a>> = cell.frames.iter().filter_map(scored).collect();
        let drives: Vec<_> = frames.iter().map(|frame| frame.record.drive.clone()).collect();
        // All cells and reports use the same draws.
        let units = bootstrap::Units::new(&drives, 0);
        let map = rules.map(scene.names);
        let classes = frames.iter().flat_map(|frame| frame.truth).map(|label| &label.class);
        let labels: BTreeSet<String> = classes.filter(|class| *class != DONT_CARE).cloned().collect();
        let known: BTreeSet<String> = cell.classes.iter().filter_map(|class| map.mapped(class)).collect();
        // A model without class names may find every class.
        let can_find = |class: &&String| cell.classes.is_empty() || known.contains(*class);
        let mapped = labels.iter().filter(can_find).cloned().collect();
        Self { rules, cell, frames, map, labels, mapped, units }
    }

    /// Notes the classes without a counterpart.
    fn note_classes(&self, without_twin: &mut BTreeMap<String, Vec<String>>) {
        let model = &self.cell.key.point.model;
        let of_labels = self.labels.difference(&self.mapped).cloned().collect();
        without_twin.insert(format!("labels, for {model}"), of_labels);
        let of_model = self.cell.classes.iter().filter(|class| self.map.mapped(class).is_none()).cloned();
        without_twin.insert(model.clone(), of_model.collect());
    }

    /// The figures of the cell, and what a verdict on it is based on.
    fn figures(&self) -> (Cell, Judged) {
        let (point, found) = (&self.cell.key.point, self.mapped_detections());
        let (groups, unknown) = self.groups(&found);
        let scored = groups.iter().filter(|(_, images)| objects(images) > 0);
        let samples = scored.map(|(group, images)| ((*group).to_owned(), average::Sample::new(images, 0.5)));
        let (units, frames) = (self.units.clone(), self.frames.len());
        let judged = Judged { point: point.clone(), samples: samples.collect(), units, frames };
        let mut interval95 = self.intervals(&groups);
        interval95.extend(
            self.units.interval(|times| judged.ap50(times)).map(|bounds| ("ap50".to_owned(), bounds)),
        );
        let cell = Cell {
            point: point.clone(),
            frames,
            unanswered: self.cell.frames.iter().filter(|frame| frame.boxes.is_none()).count(),
            ap50: by_group(&groups, |images| average::ap(images, 0.5)),
            ap50_95: average::mean(groups.values().filter_map(|images| average::ap50_95(images))),
            objects: by_group(&groups, objects),
            unknown,
            classes: self.classes(&found),
            difficulty: self.difficulties(&found),
            interval95,
            // The times are measured in a pass of their own.
            ..recovered(self.cell.frames.iter().filter_map(|frame| frame.recovery.as_ref()))
        };
        (cell, judged)
    }

    /// The images of each group, and the number of objects of those that the model has no class for.
    fn groups(&self, found: &Found) -> (BTreeMap<&str, Vec<ImageBoxes>>, BTreeMap<String, usize>) {
        let of = |group| (group, self.of_group(found, group, self.rules.difficulty));
        let mut groups: BTreeMap<&str, Vec<ImageBoxes>> =
            self.rules.groups.names().into_iter().map(of).collect();
        let unknown = groups.extract_if(.., |group, images| objects(images) > 0 && !self.knows(group));
        let unknown = unknown.map(|(group, images)| (group.to_owned(), objects(&images))).collect();
        (groups, unknown)
    }

    /// Whether the model has a class of a group.
    fn knows(&self, group: &str) -> bool {
        let mut of_model = self.cell.classes.iter().filter_map(|class| self.map.mapped(class));
        self.rules.are_given
            || self.cell.classes.is_empty()
            || of_model.any(|class| self.rules.groups.of(&class) == Some(group))
    }

    /// The detections in the classes of the labels. Classes without a counterpart are dropped.
    pub fn mapped_detections(&self) -> Found {
        self.frames.iter().map(|frame| self.map.all(frame.found.boxes.iter().flatten())).collect()
    }

    /// The boxes of a group in each frame.
    pub fn of_group(&self, found: &Found, group: &str, difficulty: Difficulty) -> Vec<ImageBoxes> {
        self.images(found, difficulty, |class| self.rules.groups.membership(class, group))
    }

    /// The images for one class. Classes of its group that the model cannot find are ignored.
    fn of_class(&self, found: &Found, class: &str) -> Vec<ImageBoxes> {
        let group = self.rules.groups.of(class);
        self.images(found, self.rules.difficulty, |other| match other {
            other if other == class => Membership::Member,
            other
                if group.is_some()
                    && self.rules.groups.of(other) == group
                    && !self.mapped.contains(other) =>
            {
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
        frames.map(|(found, frame)| image_boxes(found, frame.truth, difficulty, &membership)).collect()
    }

    fn classes(&self, found: &Found) -> BTreeMap<String, ClassScore> {
        let score = |class: &String| {
            let images = self.of_class(found, class);
            let objects = images.iter().map(ImageBoxes::objects).sum();
            let (ap50, ap50_95) = (average::ap(&images, 0.5)?, average::ap50_95(&images)?);
            Some((class.clone(), ClassScore { ap50, ap50_95, objects }))
        };
        self.mapped.iter().filter_map(score).collect()
    }

    fn difficulties(&self, found: &Found) -> BTreeMap<Difficulty, BTreeMap<String, Option<f64>>> {
        let groups = self.rules.groups.names();
        let score = |difficulty: Difficulty| {
            let ap = |group: &&str| {
                (String::from(*group), average::ap(&self.of_group(found, group, difficulty), 0.5))
            };
            (difficulty, groups.iter().map(ap).collect())
        };
        Difficulty::WORDS.map(|(_, difficulty)| score(difficulty)).into()
    }

    fn intervals(&self, groups: &BTreeMap<&str, Vec<ImageBoxes>>) -> BTreeMap<String, [f64; 2]> {
        let interval = |(group, images): (&&str, &Vec<ImageBoxes>)| {
            // The matching does not depend on the draw, so that it is done once and not a thousand times.
            let sample = average::Sample::new(images, 0.5);
            Some((format!("ap50.{group}"), self.units.interval(|times| sample.ap(times))?))
        };
        groups.iter().filter_map(interval).collect()
    }
}

/// A cell with the figures of its recovered or saturated images alone.
fn recovered<'a>(recoveries: impl Iterator<Item = &'a RecoveryQuality> + Clone) -> Cell {
    let samples: u64 = recoveries.clone().map(|r| r.samples).sum();
    let exact: u64 = recoveries.clone().map(|r| r.exact).sum();
    let (psnr_db, ssim) = ImageSimilarity::mean(recoveries.clone().map(|r| &r.ideal));
    let (psnr_sharp_db, ssim_sharp) = ImageSimilarity::mean(recoveries.clone().map(|r| &r.sharp));
    let unwrapped = recoveries.clone().filter(|r| r.samples > 0);
    let wrong = |r: &&RecoveryQuality| r.trusted == Some(true) && r.exact_share() < LEAST_TRUSTED_SHARE;
    Cell {
        exact_k: (samples > 0).then(|| exact as f64 / samples as f64),
        exact_frames: share(unwrapped.clone().map(|r| r.exact == r.samples)),
        trusted: share(recoveries.filter_map(|r| r.trusted)),
        trusted_wrong: (samples > 0).then(|| unwrapped.filter(wrong).count()),
        psnr_db,
        ssim,
        psnr_sharp_db,
        ssim_sharp,
        ..Cell::default()
    }
}

/// The number of scored objects.
fn objects(images: &[ImageBoxes]) -> usize {
    images.iter().map(ImageBoxes::objects).sum()
}

fn by_group<T>(
    groups: &BTreeMap<&str, Vec<ImageBoxes>>,
    figure: impl Fn(&[ImageBoxes]) -> T,
) -> BTreeMap<String, T> {
    groups.iter().map(|(group, images)| ((*group).to_owned(), figure(images))).collect()
}

fn definitions() -> Table {
    [
        ("ap50", average::DEFINITION),
        ("ap50_95", "Mean over groups of the mean AP at the ten IoU thresholds 0.50, 0.55, ..., 0.95."),
        ("classes", "As ap50, for one class of the labels. Other classes of its group that the model cannot find are ignored."),
        ("difficulty", difficulty::DIFFICULTIES),
        ("exact_k, psnr_db, ssim", RECOVERY_DEFINITION),
        ("interval95", bootstrap::DEFINITION),
        ("latency_ms", latency::DEFINITION),
    ]
    .map(|(name, text)| (name.to_owned(), text.split_whitespace().collect::<Vec<_>>().join(" ")))
    .into()
}

/// Returns the share of `true`; `None` of nothing.
fn share(flags: impl Iterator<Item = bool>) -> Option<f64> {
    average::mean(flags.map(|flag| f64::from(u8::from(flag))))
}
