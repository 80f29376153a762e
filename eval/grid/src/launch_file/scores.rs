//! The scores of the streams of a launch file with their 95 % intervals, and which streams these intervals tell apart.

use std::collections::{BTreeMap, BTreeSet};

use modulo_ap::Difficulty;
use modulo_ap::average::{Sample, ScoredFrame, by_class, images, mean};
use modulo_bags::source::GroundTruth;
use modulo_core::Detection;
use serde_json::{Value, json};

use super::EvaluatedFrame;
use crate::classes::{ClassGroups, ClassMap, folded};
use crate::metric::bootstrap::Units;

/// The result of a stream.
#[derive(Clone, Debug)]
pub enum StreamResult {
    /// Its boxes were compared with labels.
    Scored(StreamScore),
    /// The detector gave no answer, since no image arrived.
    NoImage,
    /// None of its frames has labels.
    NoLabels,
    /// The labels have no object that counts and has a class that the model knows.
    NoObject,
}

/// AP50 of one stream.
#[derive(Clone, Debug)]
pub struct StreamScore {
    /// Mean over the classes, or over the groups of classes where all labels have one.
    pub ap50: f64,
    /// The 95 % interval of this mean; `None` for a single frame.
    pub interval95: Option<[f64; 2]>,
    /// AP50 and number of objects of each class or group.
    pub classes: BTreeMap<String, (f64, usize)>,
    /// The number of objects of each class or group that the model does not know. They are not scored.
    pub unknown: BTreeMap<String, usize>,
    /// Number of frames with labels. Those without an answer of the detector count as frames without a box.
    pub frames: usize,
    /// Number of those without an answer of the detector.
    pub unanswered: usize,
    /// Number of other frames, without labels or unreadable, which are not scored.
    pub unlabelled: usize,
    /// The matched boxes of each class.
    samples: BTreeMap<String, Sample>,
    /// The drives or frames that the bootstrap draws.
    units: Units,
}

impl StreamResult {
    /// Scores the frames of a stream. A class of the labels that is not among those `known` to the model is left out.
    pub(super) fn new(
        frames: &[EvaluatedFrame],
        known: Option<&BTreeSet<String>>,
        difficulty: Difficulty,
    ) -> Self {
        if frames.iter().all(|frame| frame.found.is_none()) {
            return Self::NoImage;
        }
        // In a frame without labels, every box would count as wrong.
        let labelled: Vec<_> =
            frames.iter().filter_map(|frame| Some((frame, frame.truth.clone()?))).collect();
        // A frame without an answer counts as one without a box.
        let boxes = |frame: &EvaluatedFrame| frame.found.clone().unwrap_or_default();
        let scored: Vec<ScoredFrame> =
            labelled.iter().map(|(frame, truth)| by_folded_names(boxes(frame), truth)).collect();
        if scored.is_empty() {
            return Self::NoLabels;
        }
        let (samples, unknown) = matched(&scored, known, difficulty);
        let once = vec![1; scored.len()];
        let Some(ap50) = mean_ap(&samples, &once) else { return Self::NoObject };
        let drives: Vec<_> = labelled.iter().map(|(frame, _)| Some(frame.source.to_string())).collect();
        let units = Units::new(&drives, 0);
        let class = |(class, sample): (&String, &Sample)| {
            Some((class.clone(), (sample.ap(&once)?, sample.objects())))
        };
        Self::Scored(StreamScore {
            ap50,
            interval95: units.interval(|times| mean_ap(&samples, times)),
            classes: samples.iter().filter_map(class).collect(),
            unknown,
            frames: scored.len(),
            unanswered: labelled.iter().filter(|(frame, _)| frame.found.is_none()).count(),
            unlabelled: frames.len() - scored.len(),
            samples,
            units,
        })
    }

    /// Returns the score, or why there is none.
    pub fn score(&self) -> Result<&StreamScore, &'static str> {
        match self {
            Self::Scored(score) => Ok(score),
            Self::NoImage => Err("no image arrived"),
            Self::NoLabels => Err("no frame has labels"),
            Self::NoObject => Err("there is no labelled object of a class that the model knows"),
        }
    }

    /// Whether something of the stream should have been scored and was not.
    pub fn lost(&self) -> bool {
        match self {
            Self::Scored(score) => score.unanswered > 0 || score.unlabelled > 0,
            Self::NoImage | Self::NoObject => true,
            Self::NoLabels => false,
        }
    }
}

/// Matches the boxes of each class, or of each group of classes where all labels have one, as a grid does. Returns those that the model knows, and the
/// numbers of the objects of those that it does not.
fn matched(
    scored: &[ScoredFrame],
    known: Option<&BTreeSet<String>>,
    difficulty: Difficulty,
) -> (BTreeMap<String, Sample>, BTreeMap<String, usize>) {
    let (groups, map) = (ClassGroups::default(), ClassMap::kitti());
    let has_groups = groups.unnamed(scored.iter().flat_map(|(_, truth)| truth)).is_none();
    let is_known = |category: &String, _: &mut Sample| {
        known.is_none_or(|known| match has_groups {
            true => known
                .iter()
                .filter_map(|class| map.mapped(class))
                .any(|class| groups.of(&class) == Some(category)),
            false => known.iter().any(|class| folded(class) == *category),
        })
    };
    let images = if has_groups {
        let frames: Vec<ScoredFrame> =
            scored.iter().map(|(found, truth)| (map.all(found), truth.clone())).collect();
        let of = |group: &str| images(&frames, difficulty, |class| groups.membership(class, group));
        groups.names().into_iter().map(|group| (group.to_owned(), of(group))).collect()
    } else {
        by_class(scored, difficulty)
    };
    let samples = images.into_iter().map(|(class, images)| (class, Sample::new(&images, 0.5)));
    let mut samples: BTreeMap<_, _> = samples.filter(|(_, sample)| sample.objects() > 0).collect();
    let of_model = samples.extract_if(.., is_known).collect();
    (of_model, samples.into_iter().map(|(class, sample)| (class, sample.objects())).collect())
}

/// A frame whose classes have the names by which they are compared.
fn by_folded_names(found: Vec<Detection>, truth: &[GroundTruth]) -> ScoredFrame {
    let found = found.into_iter().map(|one| Detection { class: folded(&one.class), ..one });
    let truth = truth.iter().map(|one| GroundTruth { class: folded(&one.class), ..one.clone() });
    (found.collect(), truth.collect())
}

/// The mean AP50 of the classes of images that come so many `times`. `None` if no object is scored.
fn mean_ap(samples: &BTreeMap<String, Sample>, times: &[u64]) -> Option<f64> {
    mean(samples.values().filter_map(|sample| sample.ap(times)))
}

impl StreamScore {
    /// The number of scored objects.
    pub fn objects(&self) -> usize {
        self.classes.values().map(|(_, objects)| objects).sum()
    }

    /// Returns a sentence for each kind of frame and object that is not scored or counts as not found.
    pub fn notes(&self) -> Vec<String> {
        let Self { unanswered, frames, unlabelled, unknown, .. } = self;
        let mut notes = Vec::new();
        if *unanswered > 0 {
            notes.push(format!(
                "{unanswered} of its {frames} frames have no answer, and count as frames without a box"
            ));
        }
        if *unlabelled > 0 {
            notes.push(format!(
                "{unlabelled} other frames have no labels or cannot be read, and are not scored"
            ));
        }
        if !unknown.is_empty() {
            let classes: Vec<_> = unknown.iter().map(|(class, n)| format!("{class} ({n})")).collect();
            notes.push(format!("the model has no class for {}, which are not scored", classes.join(", ")));
        }
        notes
    }

    /// Whether more than chance lies between this stream and `other`, whose frames are the same.
    fn is_above(&self, other: &Self) -> bool {
        let lead = |times: &[u64]| Some(mean_ap(&self.samples, times)? - mean_ap(&other.samples, times)?);
        self.units.interval(lead).is_some_and(|[low, _]| low > 0.0)
    }

    /// `{"ap50": f, "interval95": [f, f], "difficulty": "moderate", "frames": n, "classes": {"CLASS": {"ap50": f, "objects": n}}}`, and
    /// `"unknown": {"CLASS": n}` where the labels have classes that the model does not know; `"stopped": true` of a run that was stopped.
    pub(super) fn json(&self, difficulty: Difficulty, stopped: bool) -> Value {
        let class = |(ap50, objects): &(f64, usize)| json!({ "ap50": ap50, "objects": objects });
        let classes: BTreeMap<&String, Value> = self.classes.iter().map(|(k, v)| (k, class(v))).collect();
        let mut value = json!({
            "ap50": self.ap50, "interval95": self.interval95, "difficulty": difficulty, "frames": self.frames, "classes": classes,
        });
        if !self.unknown.is_empty() {
            value["unknown"] = json!(self.unknown);
        }
        if stopped {
            value["stopped"] = true.into();
        }
        value
    }
}

/// Says in a sentence which of the streams of one camera finds the most objects, and which of the others the figures tell from it. `None` for a
/// single stream.
pub(super) fn verdict(streams: &[(&str, &StreamScore)]) -> Option<String> {
    let best = streams.iter().reduce(|best, next| if next.1.ap50 > best.1.ap50 { next } else { best })?;
    let others = streams.iter().filter(|stream| stream.0 != best.0 && stream.1.frames == best.1.frames);
    let (below, equal): (Vec<_>, Vec<_>) = others.partition(|other| best.1.is_above(other.1));
    let list = |streams: Vec<&(&str, &StreamScore)>| {
        streams.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
    };
    let objects = best.1.objects();
    let chance = match best.1.interval95 {
        Some(_) => format!("with {objects} objects, the 95 % interval of the difference contains 0"),
        None => "a single frame gives no interval".to_owned(),
    };
    let above = (!below.is_empty()).then(|| format!("is above {}, by more than chance", list(below)));
    let unranked = (!equal.is_empty()).then(|| format!("cannot be ranked against {}: {chance}", list(equal)));
    let text: Vec<String> = above.into_iter().chain(unranked).collect();
    (!text.is_empty()).then(|| format!("{} has the highest AP50; it {}", best.0, text.join(", and ")))
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;

    use super::*;

    const BOX: BBox = BBox { x1: 10.0, y1: 10.0, x2: 60.0, y2: 60.0 };

    /// 40 frames with an object of each of `classes`, of which the boxes in `class` are found in every `n`th frame.
    fn frames(classes: &[&str], (class, n): (&str, usize)) -> Vec<EvaluatedFrame> {
        let truth = |class: &&str| {
            let class = (*class).to_owned();
            GroundTruth { bbox: BOX, class, truncated: -1.0, occluded: -1 }
        };
        let frame = |number: usize| {
            let found = Detection { bbox: BOX, score: 0.9, class: class.to_owned() };
            EvaluatedFrame {
                found: Some(Vec::from_iter(number.is_multiple_of(n).then_some(found))),
                truth: Some(classes.iter().map(truth).collect()),
                source: 1,
            }
        };
        (0..40).map(frame).collect()
    }

    fn score(frames: &[EvaluatedFrame], known: &[&str]) -> StreamScore {
        let known = known.iter().map(|class| (*class).to_owned()).collect();
        let result = StreamResult::new(frames, Some(&known), Difficulty::Moderate);
        result.score().expect("labelled frames").clone()
    }

    #[test]
    fn a_verdict_names_what_the_figures_tell_apart() {
        let [all, half, again] = [1, 2, 1].map(|n| score(&frames(&["car"], ("car", n)), &["car", "person"]));
        assert_eq!((all.ap50, all.interval95, all.objects()), (1.0, Some([1.0, 1.0]), 40));
        assert!(half.interval95.is_some_and(|[low, high]| low < 0.5 && 0.5 < high), "{half:?}");
        assert_eq!(verdict(&[("all", &all)]), None);
        let of_three = verdict(&[("half", &half), ("all", &all), ("again", &again)]).expect("three streams");
        assert!(
            of_three.starts_with("all has the highest AP50; it is above half, by more than"),
            "{of_three}"
        );
        assert!(of_three.contains("cannot be ranked against again: with 40 objects"), "{of_three}");
        let of_two = verdict(&[("again", &again), ("half", &half)]).expect("two streams");
        let of_one_frame = |n| score(&frames(&["car"], ("car", n))[1..2], &["car"]);
        let of_one =
            verdict(&[("found", &of_one_frame(1)), ("missed", &of_one_frame(2))]).expect("two streams");
        assert!(
            of_one.ends_with("cannot be ranked against missed: a single frame gives no interval"),
            "{of_one}"
        );
        assert_eq!(of_two, "again has the highest AP50; it is above half, by more than chance");
    }

    /// A network for COCO finds a person where KITTI has a pedestrian. A class that it cannot find is left out, and said.
    #[test]
    fn classes_are_scored_in_groups_where_all_have_one() {
        let of_kitti = score(&frames(&["pedestrian", "misc"], ("person", 1)), &["person"]);
        assert_eq!(of_kitti.classes, BTreeMap::from([("person".to_owned(), (1.0, 40))]));
        let without_cars = score(&frames(&["pedestrian", "van"], ("person", 1)), &["person"]);
        assert_eq!((without_cars.ap50, without_cars.objects()), (1.0, 40));
        assert_eq!(without_cars.notes(), ["the model has no class for vehicle (40), which are not scored"]);
        let of_animals = score(&frames(&["zebra", "car"], ("zebra", 1)), &["zebra", "dog"]);
        assert_eq!(of_animals.classes, BTreeMap::from([("zebra".to_owned(), (1.0, 40))]));
        assert_eq!(of_animals.unknown, BTreeMap::from([("car".to_owned(), 40)]));
    }

    #[test]
    fn classes_are_the_same_in_each_spelling() {
        let of_groups = score(&frames(&["Pedestrian", "Car"], ("CAR", 1)), &["CAR"]);
        assert_eq!(of_groups.classes, BTreeMap::from([("vehicle".to_owned(), (1.0, 40))]));
        let of_classes = score(&frames(&["Traffic-Light"], ("traffic light", 1)), &["Traffic_Light"]);
        assert_eq!(of_classes.classes, BTreeMap::from([("traffic_light".to_owned(), (1.0, 40))]));
    }
}
