//! [`Classes`]: from the model's class index to the name that is published.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use modulo_msgs::vision_msgs::VisionClass;
use modulo_runtime::ParameterError;
use modulo_runtime::input::{in_home, read_text};

use crate::names::ClassNames;

/// Number of known names that an error lists.
const SHOWN: usize = 12;

/// Size of the largest file with a class map, bytes.
const MAX_MAP: u64 = 1 << 20;

/// The published classes and their names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Classes {
    names: ClassNames,
    pub map: ClassMap,
    wanted: Vec<String>,
}

/// The new names of classes, as a file with lines `from: to` has them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClassMap {
    /// Path of the file; empty where there is none.
    pub file: String,
    /// By the name in the model. Other classes are dropped. `None`: all classes keep their names.
    names: Option<BTreeMap<String, String>>,
}

impl ClassMap {
    /// Reads the file at `path` for a model with these `names`; an empty path is no map.
    /// A file of more than 1 MiB or of another form is refused, and a class that the model does not have.
    pub fn read(path: &str, names: &ClassNames) -> Result<Self, ParameterError> {
        if path.is_empty() {
            return Ok(Self::default());
        }
        let map = read_map(&in_home(Path::new(path)), names);
        let map = map.map_err(|why| ParameterError::new("class_map", path, why))?;
        Ok(Self { file: path.to_owned(), names: Some(map) })
    }
}

impl Classes {
    /// `wanted` names the classes to keep as they are called after the `map`, empty = all.
    pub fn new(names: &ClassNames, map: ClassMap, wanted: &[String]) -> Result<Self, ParameterError> {
        let mut classes = Self { names: names.clone(), map, wanted: Vec::new() };
        let mut published = Vec::new();
        for VisionClass { class_name, .. } in classes.labels() {
            if !published.contains(&class_name) {
                published.push(class_name);
            }
        }
        // The classes of a model without names are called by their numbers.
        let is_unnamed = names.count() == 0 && classes.map.names.is_none();
        let is_number = |name: &str| name.parse().is_ok_and(|index: u16| names.name(index.into()) == name);
        let is_possible = |name: &String| published.contains(name) || (is_unnamed && is_number(name));
        if let Some(name) = wanted.iter().find(|name| !is_possible(name)) {
            let why = format!("no such class, known are {}", some(&published));
            return Err(ParameterError::new("classes", name, why));
        }
        classes.wanted = wanted.to_vec();
        Ok(classes)
    }

    /// Returns the name under which class `index` is published; `None` drops it.
    pub fn publish(&self, index: usize) -> Option<String> {
        let name = self.names.name(index);
        let name = match &self.map.names {
            None => name,
            Some(map) => map.get(&name)?.clone(),
        };
        (self.wanted.is_empty() || self.wanted.contains(&name)).then_some(name)
    }

    /// Returns the names in the model.
    pub fn names(&self) -> &ClassNames {
        &self.names
    }

    /// Returns the least index in the model of each name that is published. The classes of a model without names are called by it.
    pub fn numbers(&self) -> HashMap<String, usize> {
        let of_map = self.map.names.iter().flatten();
        let unnamed = of_map.filter_map(|(from, to)| Some((to.clone(), from.parse().ok()?)));
        // From the end, so that the least index stays.
        let named = self.labels().into_iter().rev().map(|label| (label.class_name, label.class_id.into()));
        unnamed.chain(named).collect()
    }

    /// Returns the published classes: the index in the model and the name of each.
    pub fn labels(&self) -> Vec<VisionClass> {
        let label = |index| {
            let (class_id, class_name) = (u16::try_from(index).ok()?, self.publish(index)?);
            Some(VisionClass { class_id, class_name })
        };
        (0..self.names.all().len()).filter_map(label).collect()
    }
}

/// Reads a class map; an empty `to` drops the class like a class that is not named at all.
fn read_map(path: &Path, names: &ClassNames) -> Result<BTreeMap<String, String>, String> {
    let text = read_text(path, MAX_MAP).map_err(|error| error.to_string())?;
    let known = names.all();
    let mut map = parse_class_map(&text)?;
    if let Some(from) = map.keys().find(|from| !known.is_empty() && !known.contains(from)) {
        return Err(format!("the model has no class '{from}', known are {}", some(&known)));
    }
    map.retain(|_, to| !to.is_empty());
    if map.is_empty() {
        return Err("maps no class, at least one line 'from: to' is needed".to_owned());
    }
    Ok(map)
}

/// Parses the lines `from: to` of a class map; `#` opens a comment, names may be in quotes.
///
/// # Errors
/// The first line that is not such a pair, or that names a class again.
pub fn parse_class_map(text: &str) -> Result<BTreeMap<String, String>, String> {
    let mut map = BTreeMap::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.split_once('#').map_or(line, |(pair, _comment)| pair).trim();
        if line.is_empty() {
            continue;
        }
        let (from, to) =
            line.split_once(':').ok_or_else(|| format!("line {number} is '{line}', must be 'from: to'"))?;
        let [from, to] = [from, to].map(|word| word.trim().trim_matches(['\'', '"']).to_owned());
        if map.contains_key(&from) {
            return Err(format!("line {number}: '{from}' is there twice"));
        }
        map.insert(from, to);
    }
    Ok(map)
}

fn some(names: &[String]) -> String {
    match names.len() {
        0 => "class numbers alone".to_owned(),
        count if count <= SHOWN => names.join(", "),
        count => format!("{} and {} more", names[..SHOWN].join(", "), count - SHOWN),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names() -> ClassNames {
        ClassNames::of(Path::new("none"), Some("{0: 'person', 1: 'bicycle', 2: 'car'}")).expect("names")
    }

    fn classes(map: &str, wanted: &[&str]) -> Result<Classes, String> {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(map.as_bytes()).expect("written");
        let path = if map.is_empty() { "" } else { file.path().to_str().expect("a path") };
        let wanted: Vec<_> = wanted.iter().map(|name| (*name).to_owned()).collect();
        let map = ClassMap::read(path, &names());
        map.and_then(|map| Classes::new(&names(), map, &wanted)).map_err(|why| why.to_string())
    }

    #[test]
    fn a_map_renames_and_drops() {
        let classes = classes("# for KITTI\nperson: pedestrian\n'car': \"car\" # as it is\nbicycle:\n", &[])
            .expect("a map");
        assert_eq!(classes.publish(0).as_deref(), Some("pedestrian"));
        assert_eq!(classes.publish(1), None);
        assert_eq!(classes.publish(2).as_deref(), Some("car"));
        assert_eq!(classes.publish(7), None);
    }

    #[test]
    fn wanted_names_are_those_after_the_map() {
        let kept = classes("person: pedestrian\ncar: car", &["pedestrian"]).expect("known after the map");
        assert_eq!((kept.publish(0).as_deref(), kept.publish(2)), (Some("pedestrian"), None));
        let why = classes("person: pedestrian", &["person"]).expect_err("gone after the map");
        assert!(why.contains("classes") && why.contains("person") && why.contains("pedestrian"), "{why}");
    }

    #[test]
    fn unknown_names_are_refused_with_some_that_are_known() {
        for (map, wanted) in [("", &["zebra"][..]), ("zebra: horse", &[]), ("car: 1\nzebra: x", &[])] {
            let why = classes(map, wanted).expect_err("zebra");
            assert!(why.contains("zebra") && why.contains("person, bicycle, car"), "{why}");
        }
        assert!(classes("car = car", &[]).expect_err("no colon").contains("line 1"));
        assert!(classes("# nothing", &[]).expect_err("empty").contains("maps no class"));
        let read = |path: &str| ClassMap::read(path, &names()).expect_err("no map").to_string();
        let missing = read("/nowhere/map.yaml");
        assert!(missing.contains("/nowhere/map.yaml"), "{missing}");
        for special in ["/dev/zero", "/dev/null", "/tmp"] {
            assert!(read(special).contains("is not a regular file"), "{special}");
        }
    }

    #[test]
    fn a_class_without_a_name_is_its_number() {
        let nameless = ClassNames::of(Path::new("none"), None).expect("none");
        let of = |name: &str| Classes::new(&nameless, ClassMap::default(), &[name.to_owned()]);
        assert_eq!(of("99").expect("a number").publish(99).as_deref(), Some("99"));
        assert!(of("99999999").is_err(), "a number of 16 bits");
        assert!(classes("", &["2"]).is_err(), "2 is called car");
        let why = classes("", &["99"]).expect_err("all classes of this model have names");
        assert!(why.contains("person, bicycle, car"), "{why}");
    }
}
