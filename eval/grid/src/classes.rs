//! Classes of a model, classes of the labels, and the groups in which they are scored. Maps are files of lines
//! `from: to`; `#` opens a comment.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use modulo_bags::source::GroundTruth;
use modulo_detector::{COCO_TO_KITTI, parse_class_map};

use crate::grid::GridError;

/// The paper's own map.
pub const PAPER: &str = include_str!("../class_maps/paper.yaml");
/// Which classes are vehicles and which are persons.
pub const GROUPS: &str = include_str!("../class_maps/groups.yaml");

/// The class of an area that everybody leaves out.
pub const DONT_CARE: &str = "dontcare";
/// What KITTI calls its objects, in lower case.
const KITTI: [&str; 8] = ["car", "van", "truck", "pedestrian", "person_sitting", "cyclist", "tram", "misc"];

/// Lines `from: to` of a file.
pub type Table = BTreeMap<String, String>;

/// What a model's class is called among the labels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClassMap {
    /// By the model's name.
    pub table: Table,
    others: Others,
}

/// What becomes of a class that the table does not name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Others {
    /// It is its own twin.
    Kept,
    /// It is its own twin when KITTI knows it.
    KittiKept,
    /// It is dropped.
    Dropped,
}

impl ClassMap {
    /// Labels and model have the same names.
    pub fn same() -> Self {
        Self { table: Table::new(), others: Others::Kept }
    }

    /// COCO's names to KITTI's; KITTI's own stay.
    pub fn kitti() -> Self {
        Self { table: shipped(COCO_TO_KITTI), others: Others::KittiKept }
    }

    /// The paper's.
    pub fn paper() -> Self {
        Self { table: shipped(PAPER), others: Others::Dropped }
    }

    /// A file's, which alone counts.
    ///
    /// # Errors
    /// [`GridError::Table`] with the line.
    pub fn read(path: &Path) -> Result<Self, GridError> {
        Ok(Self { table: read(path)?, others: Others::Dropped })
    }

    /// The labels' class of a model's; `None` drops it.
    pub fn twin<'a>(&'a self, class: &'a str) -> Option<&'a str> {
        match self.table.get(class) {
            Some(twin) => Some(twin.as_str()).filter(|twin| !twin.is_empty()),
            None if self.others == Others::Kept => Some(class),
            None if self.others == Others::KittiKept && KITTI.contains(&class) => Some(class),
            None => None,
        }
    }
}

/// The groups of a file of `class: group` and `class: ignore group`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Groups(Table);

/// What a class is to a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// One of its own.
    Member,
    /// Near enough that a detection of it is no mistake.
    Ignored,
    /// Something else.
    Other,
}

impl Default for Groups {
    fn default() -> Self {
        Self(shipped(GROUPS))
    }
}

impl Groups {
    /// A file's.
    ///
    /// # Errors
    /// [`GridError::Table`] with the line.
    pub fn read(path: &Path) -> Result<Self, GridError> {
        read(path).map(Self)
    }

    /// As in the file.
    pub fn table(&self) -> &Table {
        &self.0
    }

    /// All groups.
    pub fn names(&self) -> BTreeSet<&str> {
        self.0.values().filter_map(|value| value.split_whitespace().last()).collect()
    }

    /// What `class` is to `group`.
    pub fn part(&self, class: &str, group: &str) -> Part {
        let words = self.0.get(class).map(|value| value.split_whitespace().collect::<Vec<_>>());
        match words.as_deref() {
            Some([name]) if *name == group => Part::Member,
            Some(["ignore", name]) if *name == group => Part::Ignored,
            _ => Part::Other,
        }
    }

    /// The group that `class` is a member of.
    pub fn of(&self, class: &str) -> Option<&str> {
        self.0.get(class).map(String::as_str).filter(|value| !value.contains(char::is_whitespace))
    }
}

/// The classes of labels, without the areas to leave out.
pub fn of_labels<'a>(labels: impl Iterator<Item = &'a GroundTruth>) -> BTreeSet<&'a str> {
    labels.map(|label| label.class.as_str()).filter(|class| *class != DONT_CARE).collect()
}

fn read(path: &Path) -> Result<Table, GridError> {
    let text = std::fs::read_to_string(path).map_err(|why| GridError::io(path, why))?;
    let table = parse_class_map(&text).map_err(|why| GridError::Table(path.to_owned(), why))?;
    if table.is_empty() {
        let why = "names no class, at least one line 'from: to' is needed".to_owned();
        return Err(GridError::Table(path.to_owned(), why));
    }
    Ok(table)
}

/// A map that is part of this program.
fn shipped(text: &str) -> Table {
    parse_class_map(text).expect("a test of this file reads the shipped maps")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_tables_are_readable_and_fit() {
        for text in [COCO_TO_KITTI, PAPER, GROUPS] {
            assert!(!shipped(text).is_empty());
        }
        assert_eq!(Groups::default().names().into_iter().collect::<Vec<_>>(), ["person", "vehicle"]);
        let groups = Groups::default();
        assert_eq!(groups.part("cyclist", "person"), Part::Ignored);
        assert_eq!((groups.of("van"), groups.of("cyclist")), (Some("vehicle"), None));
    }

    #[test]
    fn each_map_has_its_own_way_with_unknown_classes() {
        let twins = |map: ClassMap| {
            ["person", "bus", "van", "zebra", "motorcycle"].map(|c| map.twin(c).unwrap_or("-").to_owned())
        };
        assert_eq!(twins(ClassMap::kitti()), ["pedestrian", "tram", "van", "-", "cyclist"]);
        assert_eq!(twins(ClassMap::paper()), ["pedestrian", "tram", "-", "-", "-"]);
        assert_eq!(twins(ClassMap::same()), ["person", "bus", "van", "zebra", "motorcycle"]);
    }

    #[test]
    fn a_line_that_is_no_pair_is_named() {
        assert!(parse_class_map("a: b\nc d").expect_err("no colon").contains("line 2"));
        assert!(parse_class_map("a: b\na: c").expect_err("twice").contains("twice"));
    }
}
