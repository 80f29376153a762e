//! What the classes of a YOLO data set are called: `names` of a YAML file, or a text with one name a line.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use modulo_runtime::yaml::{self, Content, Item};

use super::SourceError;
use super::folder::{extension_of, files_of};
use super::labels::read_text;

/// Files with the names of the classes that are read before others.
const KNOWN: [&str; 5] = ["data.yaml", "data.yml", "dataset.yaml", "dataset.yml", "classes.txt"];
/// Extensions of other files that may have them.
const EXTENSIONS: [&str; 4] = ["yaml", "yml", "names", "labels"];
/// The files in which the names of the classes of a YOLO data set are looked for, for people.
pub const NAME_FILES: &str = "data.yaml, classes.txt, obj.names and other *.yaml, *.yml, *.names and *.labels beside the images, beside their labels \
                              and in the folder above";

/// The classes of a data set.
#[derive(Debug, Default, PartialEq)]
pub(super) struct YoloClasses {
    /// Their names by number; empty without names.
    names: BTreeMap<usize, String>,
    /// Numbers of the key points of an object.
    pub key_points: Option<usize>,
}

impl YoloClasses {
    /// Reads the classes of the data set at `path`, a folder or a file that may have them itself, with this image, whose labels lie in the folders
    /// `labels`. A split such as `images/val` lies two folders below the file of the data set.
    pub fn of(path: &Path, image: &Path, labels: &[PathBuf]) -> Result<Self, SourceError> {
        if path.is_file()
            && let Some(classes) = read(path).transpose()?
        {
            return Ok(classes);
        }
        // A relative path hides the folders above it.
        let [path, image] = [path, image].map(|path| std::path::absolute(path).unwrap_or(path.to_owned()));
        let given = path.ancestors().skip(usize::from(path.is_file())).take(3);
        let of_image = image.ancestors().skip(1);
        let root = of_image.clone().find(|folder| folder.ends_with("images")).and_then(Path::parent);
        // Where no folder is called `images`, the one above may belong to the data set.
        let own = given.clone().take(if root.is_some() { 1 } else { 2 });
        let near = own.chain(labels.iter().map(PathBuf::as_path)).chain(of_image.take(2)).chain(root);
        for folder in near {
            if let Some(classes) = in_folder(folder)? {
                return Ok(classes);
            }
        }
        let above = given.flat_map(|folder| [folder.to_owned(), folder.join("labels")]);
        Ok(above.into_iter().find_map(|folder| known_in(&folder)).transpose()?.unwrap_or_default())
    }

    /// Returns the name of class `number`, or the number itself if the data set names no class.
    pub fn name(&self, number: usize) -> Result<String, String> {
        let (Some((first, _)), Some((last, _))) = (self.names.first_key_value(), self.names.last_key_value())
        else {
            return Ok(number.to_string());
        };
        let unnamed =
            || format!("class {number} found, but the data set has names for the classes {first} to {last}");
        self.names.get(&number).cloned().ok_or_else(unnamed)
    }
}

/// Returns the classes that a file in `folder` names.
fn in_folder(folder: &Path) -> Result<Option<YoloClasses>, SourceError> {
    if let Some(classes) = known_in(folder) {
        return classes.map(Some);
    }
    // Files of other purposes may have these extensions, so that one that is not readable is none of a data set.
    let others = files_of(folder, &EXTENSIONS).into_iter();
    let mut named = others.filter_map(|path| Some((read(&path)?.ok()?, path)));
    let Some((classes, file)) = named.next() else { return Ok(None) };
    match named.find(|(others, _)| *others != classes) {
        None => Ok(Some(classes)),
        Some((_, other)) => {
            let why =
                format!("has other names of classes than {}; move one of the two away", other.display());
            Err(SourceError::of(&file, &why))
        }
    }
}

/// Returns the classes in one of the files in `folder` that every program reads.
fn known_in(folder: &Path) -> Option<Result<YoloClasses, SourceError>> {
    let known = KNOWN.map(|name| folder.join(name)).into_iter().filter(|path| path.is_file());
    known.into_iter().find_map(|path| read(&path))
}

/// Reads the classes in the file at `path`; `None` for a file without any.
fn read(path: &Path) -> Option<Result<YoloClasses, SourceError>> {
    let is_yaml = match extension_of(path).as_str() {
        "yaml" | "yml" => true,
        "names" | "labels" => false,
        _ if path.ends_with("classes.txt") => false,
        _ => return None,
    };
    let bad = |why: String| SourceError::label(path, 1, &format!("no readable `names`: {why}"));
    let text = match read_text(path) {
        Ok(text) => text,
        Err(why) => return Some(Err(why.into())),
    };
    if is_yaml {
        return listed(&text).map_err(bad).transpose();
    }
    let names = text.lines().map(|line| line.trim().to_owned()).enumerate();
    let names: BTreeMap<usize, String> = names.filter(|(_, name)| !name.is_empty()).collect();
    (!names.is_empty()).then_some(Ok(YoloClasses { names, key_points: None }))
}

/// Reads a data set's file: `names`, a list or a mapping by number, and `kpt_shape`, a list of two numbers. `None` for a file without `names`.
fn listed(text: &str) -> Result<Option<YoloClasses>, String> {
    let file = yaml::read(text).map_err(|why| why.to_string())?;
    let Some(names) = file.entry("names") else { return Ok(None) };
    let names: Vec<(usize, &Item)> = match &names.content {
        Content::List(list) => list.iter().enumerate().collect(),
        Content::Map(entries) => {
            let number =
                |text: &str| text.parse().map_err(|_| format!("class '{text}' found, a whole number needed"));
            let numbered = entries.iter().map(|(key, name)| Ok((number(&key.name)?, name)));
            numbered.collect::<Result<_, String>>()?
        }
        Content::Scalar(..) => {
            return Err("a list of names, or a mapping from numbers to names is needed".to_owned());
        }
    };
    let text = |(number, name): (usize, &Item)| Some((number, name.text()?.to_owned()));
    let bad = "a name of a class is empty, a list or a mapping; a word is needed";
    let names = names.into_iter().map(text).collect::<Option<_>>().ok_or(bad)?;
    let key_points = file.entry("kpt_shape").map(|shape| {
        let Content::List(sides) = &shape.content else { return None };
        let sides = sides.iter().map(|side| side.text()?.parse().ok()).collect::<Option<Vec<usize>>>()?;
        (sides.len() == 2).then(|| sides[0].checked_mul(sides[1])).flatten()
    });
    let key_points =
        key_points.map(|count| count.ok_or("kpt_shape must be a list of two numbers, such as [17, 3]"));
    Ok(Some(YoloClasses { names, key_points: key_points.transpose()? }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_of(folder: &Path) -> Vec<String> {
        let image = folder.join("a.png");
        YoloClasses::of(folder, &image, &[folder.join("labels")])
            .expect("readable")
            .names
            .into_values()
            .collect()
    }

    #[test]
    fn names_are_found_in_the_files_of_each_program() {
        for (place, text) in [
            ("set/data.yaml", "names: [car, bus]"),
            ("set/data.yml", "nc: 2\nnames:\n  0: car\n  1: bus\n"),
            ("set/dataset.yaml", "\u{feff}path: C:\\data\r\nnames: ['car', \"bus\"]\r\n"),
            ("coco.yaml", "path: coco # root\ntrain: images/train\nnames: {0: car, 1: bus}\n"),
            ("set/classes.txt", "car\r\nbus\r\n\r\n"),
            ("set/labels/classes.txt", "car\nbus\n"),
            ("set/obj.names", "car\nbus"),
            ("obj.names", " car \nbus\n"),
            ("set/_darknet.labels", "car\nbus\n"),
        ] {
            let folder = tempfile::tempdir().expect("a folder");
            std::fs::create_dir_all(folder.path().join("set/labels")).expect("made");
            // Files of other purposes beside it.
            for (name, text) in [("args.yaml", "epochs: 9"), ("bad.yaml", "a: ["), ("empty.names", "\n")] {
                std::fs::write(folder.path().join("set").join(name), text).expect("written");
            }
            std::fs::write(folder.path().join(place), text).expect("written");
            assert_eq!(names_of(&folder.path().join("set")), ["car", "bus"], "{place}");
        }
    }

    /// Of the folders further above, only files that every program calls so count: others may belong to other images.
    #[test]
    fn only_known_files_are_read_two_folders_above() {
        let folder = tempfile::tempdir().expect("a folder");
        let set = folder.path().join("set");
        std::fs::create_dir_all(set.join("images/val")).expect("made");
        let read = |given: &str, image: &str| {
            let classes = YoloClasses::of(&folder.path().join(given), &set.join(image), &[]);
            classes.expect("readable").names.into_values().collect::<Vec<_>>()
        };
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        write("obj.names", "bus\n");
        assert!(read("set", "images/a.png").is_empty());
        assert_eq!(read("set", "a.png"), ["bus"]);
        write("set/custom.yaml", "names: [van]");
        for given in ["set", "set/images", "set/images/val"] {
            assert_eq!(read(given, "images/val/a.png"), ["van"], "{given}");
        }
        std::fs::remove_file(set.join("custom.yaml")).expect("removed");
        write("data.yaml", "names: [car]");
        assert_eq!(
            (read("set/images", "images/a.png"), read("set", "images/a.png")),
            (vec!["car".into()], vec!["car".into()])
        );
    }

    #[test]
    fn files_with_other_names_are_both_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        write("a.yaml", "names: [car]");
        write("b.names", "car\n");
        assert_eq!(names_of(folder.path()), ["car"], "the same twice");
        write("b.names", "bus\n");
        let why = YoloClasses::of(folder.path(), Path::new("a.png"), &[]).expect_err("two").to_string();
        assert!(why.contains("a.yaml") && why.contains("b.names"), "{why}");
        // The file that every program reads counts.
        write("data.yaml", "names: [van]");
        assert_eq!(names_of(folder.path()), ["van"]);
        write("data.yaml", "names: [");
        assert!(
            YoloClasses::of(folder.path(), Path::new("a.png"), &[])
                .expect_err("broken")
                .to_string()
                .contains("data.yaml")
        );
    }

    #[test]
    fn a_file_of_a_data_set_says_what_is_wrong() {
        for (text, expected) in [
            ("names: 80", "list of names"),
            ("names: {car: 0}", "class 'car' found, a whole number needed"),
            ("names: [[car]]", "a word is needed"),
            ("names: [~]", "a word is needed"),
            ("names: [car", "line "),
            (
                "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\n\
              d: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\nnames: [*e,*e,*e,*e]",
                "alias",
            ),
            ("names: [person]\nkpt_shape: 17\n", "kpt_shape"),
        ] {
            let why = listed(text).expect_err(text);
            assert!(why.contains(expected), "{why}");
        }
        assert_eq!(listed("train: images"), Ok(None));
        assert_eq!(
            listed("names: [person]\nkpt_shape: [3, 2]\n").map(|of| of.and_then(|of| of.key_points)),
            Ok(Some(6))
        );
    }
}
