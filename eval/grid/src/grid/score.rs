//! From what a cell saw to its figures. Pure.

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection};

use super::recovery::Likeness;
use super::seen::Seen;
use crate::classes::{ClassMap, DONT_CARE, Groups, Part};
use crate::metric::matching::{Image, Role};
use crate::metric::{average, bootstrap, latency, paper};
use crate::results::{Cell, ClassScore, Device, Difficulty, Paper, Point, WORST, Worst};

/// What all cells of a grid are scored with.
pub struct Scorer<'a> {
    /// Labels of every frame.
    pub truths: &'a [Vec<GroundTruth>],
    /// Model's class to the labels'.
    pub map: &'a ClassMap,
    /// Classes to groups.
    pub groups: &'a Groups,
    /// Classes of the labels that the model at hand has a twin for.
    pub twins: &'a BTreeSet<String>,
    /// Which objects count.
    pub difficulty: Difficulty,
    /// What is drawn for intervals.
    pub units: &'a bootstrap::Units,
}

/// Detections by frame, in the classes of the labels.
type Found = Vec<Vec<Detection>>;

impl Scorer<'_> {
    /// The cell at `point`.
    pub fn cell(&self, point: Point, seen: &[Seen], device: Device) -> Cell {
        let found = self.translated(seen);
        let groups: BTreeMap<&str, Vec<Image>> = self
            .groups
            .names()
            .into_iter()
            .map(|group| (group, self.of_group(&found, group, self.difficulty)))
            .collect();
        let papers = self.papers(&found);
        let recoveries = seen.iter().filter_map(|seen| seen.recovery.as_ref());
        let samples: u64 = recoveries.clone().map(|r| r.samples).sum();
        let exact: u64 = recoveries.clone().map(|r| r.exact).sum();
        let (psnr_db, ssim) = Likeness::mean(recoveries.clone().map(|r| &r.ideal));
        let (psnr_sharp_db, ssim_sharp) = Likeness::mean(recoveries.clone().map(|r| &r.sharp));
        let claims: Vec<f64> =
            recoveries.filter_map(|r| r.trust.claim()).map(|t| f64::from(u8::from(t))).collect();
        let means: Vec<f64> = groups.values().filter_map(|images| average::ap50_95(images)).collect();
        Cell {
            point,
            frames: seen.len(),
            unanswered: seen.iter().filter(|seen| seen.found.is_none()).count(),
            ap50: by_group(&groups, |images| average::ap(images, 0.5)),
            ap50_95: (!means.is_empty()).then(|| average::mean(&means)),
            objects: by_group(&groups, |images| images.iter().map(Image::objects).sum()),
            classes: self.classes(&found),
            difficulty: self.difficulties(&found),
            precision: by_group(&groups, |images| average::curve(images, 0.5).unwrap_or_default()),
            interval95: self.intervals(&groups, &papers),
            paper: paper::mean(&papers),
            worst: self.worst(&papers),
            exact_k: (samples > 0).then(|| exact as f64 / samples as f64),
            trusted: (!claims.is_empty()).then(|| average::mean(&claims)),
            psnr_db,
            ssim,
            psnr_sharp_db,
            ssim_sharp,
            latency_ms: latency::by_stage(seen.iter().map(|seen| &seen.stages[..])),
            latency_histogram: latency::histogram(seen.iter().map(|seen| &seen.stages[..])),
            device,
        }
    }

    fn translated(&self, seen: &[Seen]) -> Found {
        let twin = |detection: &Detection| {
            let class = self.map.twin(&detection.class)?.to_owned();
            Some(Detection { class, ..detection.clone() })
        };
        let of = |seen: &Seen| seen.found.iter().flat_map(|found| found.iter()).filter_map(twin).collect();
        seen.iter().map(of).collect()
    }

    fn of_group(&self, found: &Found, group: &str, difficulty: Difficulty) -> Vec<Image> {
        let part = |class: &str| self.groups.part(class, group);
        self.images(found, difficulty, part)
    }

    /// One class alone; classes of its group that the model has no twin for are ignored.
    fn of_class(&self, found: &Found, class: &str) -> Vec<Image> {
        let group = self.groups.of(class);
        let part = |other: &str| match other {
            other if other == class => Part::Member,
            other if group.is_some() && self.groups.of(other) == group && !self.twins.contains(other) => {
                Part::Ignored
            }
            _ => Part::Other,
        };
        self.images(found, self.difficulty, part)
    }

    fn images(&self, found: &Found, difficulty: Difficulty, part: impl Fn(&str) -> Part) -> Vec<Image> {
        let role = |label: &GroundTruth| -> Option<(BBox, Role)> {
            let role = match part(&label.class) {
                _ if label.class == DONT_CARE => Role::Area,
                Part::Member => difficulty.role(label),
                Part::Ignored => Role::Ignored,
                Part::Other => return None,
            };
            Some((label.bbox, role))
        };
        let frames = found.iter().zip(self.truths);
        frames
            .map(|(found, truth)| Image {
                truth: truth.iter().filter_map(role).collect(),
                found: found
                    .iter()
                    .filter(|d| part(&d.class) == Part::Member)
                    .map(|d| (d.bbox, d.score))
                    .collect(),
                least_height: difficulty.least_height(),
            })
            .collect()
    }

    fn classes(&self, found: &Found) -> BTreeMap<String, ClassScore> {
        let score = |class: &String| {
            let images = self.of_class(found, class);
            let objects = images.iter().map(Image::objects).sum();
            let (ap50, ap50_95) = (average::ap(&images, 0.5)?, average::ap50_95(&images)?);
            Some((class.clone(), ClassScore { ap50, ap50_95, objects }))
        };
        self.twins.iter().filter_map(score).collect()
    }

    fn difficulties(&self, found: &Found) -> BTreeMap<Difficulty, BTreeMap<String, Option<f64>>> {
        let groups = self.groups.names();
        let score = |difficulty: Difficulty| {
            let ap = |group: &&str| {
                (String::from(*group), average::ap(&self.of_group(found, group, difficulty), 0.5))
            };
            (difficulty, groups.iter().map(ap).collect())
        };
        Difficulty::ALL.into_iter().map(score).collect()
    }

    fn papers(&self, found: &Found) -> Vec<Paper> {
        let of_image = |(found, truth): (&Vec<Detection>, &Vec<GroundTruth>)| {
            let labels = truth.iter().filter(|label| label.class != DONT_CARE);
            let labels: Vec<_> = labels.map(|label| (label.bbox, label.class.as_str())).collect();
            paper::of_image(found, &labels)
        };
        found.iter().zip(self.truths).map(of_image).collect()
    }

    fn worst(&self, papers: &[Paper]) -> Vec<Worst> {
        let labelled = |number: &usize| self.truths[*number].iter().any(|label| label.class != DONT_CARE);
        let numbers = (0..papers.len()).filter(labelled);
        let mut worst: Vec<Worst> = numbers.map(|number| Worst { number, f1: papers[number].f1 }).collect();
        worst.sort_by(|a, b| a.f1.total_cmp(&b.f1));
        worst.truncate(WORST);
        worst
    }

    fn intervals(&self, groups: &BTreeMap<&str, Vec<Image>>, papers: &[Paper]) -> BTreeMap<String, [f64; 2]> {
        let mut intervals = BTreeMap::new();
        for (group, images) in groups {
            let sample = average::Sample::new(images, 0.5);
            if let Some(interval) = self.units.interval(|times| sample.ap(times)) {
                intervals.insert(format!("ap50.{group}"), interval);
            }
        }
        let figures = |paper: &Paper| [paper.iou, paper.f1, paper.accuracy];
        for (index, name) in ["iou", "f1", "accuracy"].into_iter().enumerate() {
            let mean = |times: &[u64]| {
                let weighted = papers.iter().zip(times).map(|(paper, n)| figures(paper)[index] * *n as f64);
                let sum: f64 = weighted.sum();
                Some(sum / times.iter().sum::<u64>().max(1) as f64)
            };
            if let Some(interval) = self.units.interval(mean) {
                intervals.insert(format!("paper.{name}"), interval);
            }
        }
        intervals
    }
}

fn by_group<T>(groups: &BTreeMap<&str, Vec<Image>>, figure: impl Fn(&[Image]) -> T) -> BTreeMap<String, T> {
    groups.iter().map(|(group, images)| ((*group).to_owned(), figure(images))).collect()
}
