//! The mapping from the classes of a model to the classes of the labels, and the groups in which they are scored.
//!
//! A mapping is a file of lines `from: to`. `#` starts a comment.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use modulo_ap::average::Membership;
use modulo_ap::difficulty::DONT_CARE;
use modulo_bags::source::{GroundTruth, NAME_FILES};
use modulo_core::Detection;
use modulo_detector::{COCO_TO_KITTI, parse_class_map};
use modulo_runtime::input::{LARGEST_TEXT, read_text};

use crate::GridError;

/// The groups vehicle and person.
pub const GROUPS: &str = include_str!("../class_maps/groups.yaml");

/// The classes of KITTI in lower case.
const KITTI: [&str; 8] = ["car", "van", "truck", "pedestrian", "person_sitting", "cyclist", "tram", "misc"];

/// The lines `from: to` of a file, whose classes are [`folded`].
pub type Table = BTreeMap<String, String>;

/// Returns the name by which a class is known here: `Traffic Light` and `traffic-light` are `traffic_light`.
pub fn folded(class: &str) -> String {
    let words = class.split(|c: char| c.is_whitespace() || c == '_' || c == '-');
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_").to_lowercase()
}

/// Maps the classes of a model to those of the labels.
#[derive(Clone, Debug)]
pub struct ClassMap {
    /// Class of the labels by class of the model.
    pub table: Table,
    /// Whether a class that the table does not list is kept under its own name; else it is dropped.
    keeps: fn(&str) -> bool,
}

impl ClassMap {
    /// The identity, for labels with the class names of the model.
    pub fn same() -> Self {
        Self { table: Table::new(), keeps: |_| true }
    }

    /// Maps the classes of COCO to those of KITTI, and keeps those of KITTI.
    pub fn kitti() -> Self {
        // A model that was trained on KITTI has its class names already.
        Self { table: embedded(COCO_TO_KITTI), keeps: |class| KITTI.contains(&class) }
    }

    /// Reads a mapping from a file. Classes that it does not list are dropped.
    ///
    /// # Errors
    /// [`GridError::Request`] with the wrong line.
    pub fn read(path: &Path) -> Result<Self, GridError> {
        let table = read(path)?.into_iter().map(|(from, to)| (from, folded(&to))).collect();
        Ok(Self { table, keeps: |_| false })
    }

    /// The class of the labels for a class of the model. `None` means that the class is dropped.
    pub fn mapped(&self, class: &str) -> Option<String> {
        let class = folded(class);
        // A line `from:` without a class drops the class on purpose.
        match self.table.get(&class) {
            Some(mapped) => Some(mapped.clone()).filter(|mapped| !mapped.is_empty()),
            None => Some(class).filter(|class| (self.keeps)(class)),
        }
    }

    /// The detections in the classes of the labels. Classes without a counterpart are dropped.
    pub fn all<'a>(&self, found: impl IntoIterator<Item = &'a Detection>) -> Vec<Detection> {
        let mapped = |detection: &Detection| {
            Some(Detection { class: self.mapped(&detection.class)?, ..detection.clone() })
        };
        found.into_iter().filter_map(mapped).collect()
    }
}

/// The groups in which classes are scored: lines `class: group` and `class: ignore group`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClassGroups(pub Table);

impl Default for ClassGroups {
    fn default() -> Self {
        Self(embedded(GROUPS))
    }
}

impl ClassGroups {
    /// Reads groups from a file.
    ///
    /// # Errors
    /// [`GridError::Request`] with the wrong line.
    pub fn read(path: &Path) -> Result<Self, GridError> {
        read(path).map(Self)
    }

    /// The names of all groups.
    pub fn names(&self) -> BTreeSet<&str> {
        self.0.values().filter_map(|value| value.split_whitespace().last()).collect()
    }

    /// The relation of `class` to `group`.
    pub fn membership(&self, class: &str, group: &str) -> Membership {
        let words = self.0.get(class).map(|value| value.split_whitespace().collect::<Vec<_>>());
        match words.as_deref() {
            Some([name]) if *name == group => Membership::Member,
            Some(["ignore", name]) if *name == group => Membership::Ignored,
            _ => Membership::Other,
        }
    }

    /// The group in which `class` is scored.
    pub fn of(&self, class: &str) -> Option<&str> {
        self.0.get(class).map(String::as_str).filter(|value| value.split_whitespace().count() == 1)
    }

    /// A line that counts the labels of classes that the table does not name. A line `class:` leaves one out on purpose.
    pub fn unnamed<'a>(&self, labels: impl Iterator<Item = &'a GroundTruth>) -> Option<String> {
        let unnamed = |label: &&GroundTruth| label.class != DONT_CARE && !self.0.contains_key(&label.class);
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        labels.filter(unnamed).for_each(|label| *counts.entry(&label.class).or_default() += 1);
        let all: usize = counts.values().sum();
        let classes: Vec<String> = counts.iter().map(|(class, count)| format!("{class} ({count})")).collect();
        let is_number = |class: &&str| class.bytes().all(|byte| byte.is_ascii_digit());
        let remedy = match counts.keys().all(is_number) {
            true => format!(
                "no file with the names of the classes was found, which are looked for in {NAME_FILES}"
            ),
            false => "the file of --groups may name them".to_owned(),
        };
        (all > 0).then(|| {
            format!(
                "{all} labels have classes that no group holds and are not scored: {}; {remedy}",
                classes.join(", ")
            )
        })
    }
}

fn read(path: &Path) -> Result<Table, GridError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|why| GridError::io(path, why))?;
    let lines = parse_class_map(&text).map_err(|why| GridError::of_file(path, why))?;
    let mut table = Table::new();
    for (class, to) in &lines {
        if table.insert(folded(class), to.clone()).is_some_and(|other| other != *to) {
            return Err(GridError::of_file(
                path,
                format!("the class '{class}' is there in several spellings"),
            ));
        }
    }
    // An empty file would drop all classes: every score would be 0 without a word.
    if table.is_empty() {
        return Err(GridError::of_file(path, "names no class, at least one line 'from: to' is needed"));
    }
    Ok(table)
}

/// A mapping that is part of the program.
fn embedded(text: &str) -> Table {
    parse_class_map(text).expect("a test of this file reads the embedded mappings")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_tables_are_readable_and_fit() {
        for text in [COCO_TO_KITTI, GROUPS] {
            assert!(!embedded(text).is_empty());
        }
        assert_eq!(ClassGroups::default().names().into_iter().collect::<Vec<_>>(), ["person", "vehicle"]);
        let groups = ClassGroups::default();
        assert_eq!(groups.membership("cyclist", "person"), Membership::Ignored);
        assert_eq!((groups.of("van"), groups.of("cyclist")), (Some("vehicle"), None));
    }

    #[test]
    fn each_map_has_its_own_way_with_unknown_classes() {
        let mapped = |map: ClassMap| {
            ["person", "bus", "van", "zebra", "motorcycle"].map(|c| map.mapped(c).unwrap_or("-".to_owned()))
        };
        assert_eq!(mapped(ClassMap::kitti()), ["pedestrian", "tram", "van", "-", "cyclist"]);
        assert_eq!(mapped(ClassMap::same()), ["person", "bus", "van", "zebra", "motorcycle"]);
    }

    #[test]
    fn a_class_is_the_same_in_each_spelling() {
        for class in ["traffic light", "Traffic_Light", "TRAFFIC-LIGHT", " traffic  light "] {
            assert_eq!(folded(class), "traffic_light");
        }
        assert_eq!(ClassMap::kitti().mapped("Person").as_deref(), Some("pedestrian"));
        assert_eq!(ClassMap::same().mapped("Stop Sign").as_deref(), Some("stop_sign"));
        let file = tempfile::NamedTempFile::new().expect("a file");
        let groups = |text: &str| {
            std::fs::write(file.path(), text).expect("written");
            ClassGroups::read(file.path()).map_err(|why| why.to_string())
        };
        let signs = groups("Traffic Light: sign\nCar: ignore sign\n").expect("groups");
        assert_eq!(signs.of("traffic_light"), Some("sign"));
        assert_eq!(signs.membership("car", "sign"), Membership::Ignored);
        assert!(groups("Car: a\ncar: b\n").expect_err("two groups").contains("'car' is there in several"));
    }

    #[test]
    fn classes_without_names_tell_where_names_are_looked_for() {
        let label = |class: &str| GroundTruth {
            bbox: Default::default(),
            class: class.to_owned(),
            truncated: -1.0,
            occluded: -1,
        };
        let line = |classes: [&str; 2]| {
            ClassGroups::default().unnamed(classes.map(label).iter()).expect("two classes without a group")
        };
        let numbers = line(["0", "2"]);
        assert!(numbers.contains("no file with the names of the classes was found"), "{numbers}");
        assert!(numbers.contains("data.yaml") && numbers.contains("obj.names"), "{numbers}");
        assert!(line(["0", "zebra"]).ends_with("the file of --groups may name them"));
    }

    #[test]
    fn a_line_that_is_no_pair_is_named() {
        assert!(parse_class_map("a: b\nc d").expect_err("no colon").contains("line 2"));
        assert!(parse_class_map("a: b\na: c").expect_err("twice").contains("twice"));
    }
}
