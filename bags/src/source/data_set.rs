//! Where the images of a YOLO data set lie: the layouts of Ultralytics, Roboflow, CVAT and darknet.

use std::path::{Component, Path, PathBuf};

use modulo_runtime::yaml::{self, Content, Item};

use super::SourceError;
use super::folder::{extension_of, folders_of_images, images_below, images_in, no_image};
use super::labels::read_text;

/// The parts of a data set, by the names that programs give them: what `yolo val` reads, and the others.
const PARTS: [&[&str]; 2] = [&["val", "valid", "validation"], &["test", "train", "minival"]];

/// Returns the images of `path`, and whether they are all of their folders: `path` is a folder of images or one that has them in `images`, a
/// file that describes a data set, of which the part for validation is taken, or a list of images.
pub(super) fn images_of(path: &Path) -> Result<(Vec<PathBuf>, bool), SourceError> {
    if !path.exists() {
        return Err(SourceError::absent(path, "a folder of images with YOLO labels is needed"));
    }
    match extension_of(path).as_str() {
        _ if path.is_dir() => Ok((images_of_folder(path)?, true)),
        "yaml" | "yml" | "data" => images_of_description(path),
        "txt" => Ok((images_of_list(path)?, false)),
        _ => {
            let needed =
                "a folder of images with YOLO labels, its data.yaml, or a list of images (.txt) is needed";
            Err(SourceError::of(path, &format!("is another file; {needed}")))
        }
    }
}

fn images_of_folder(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let inside = folder.join("images");
    let folder = if inside.is_dir() { &inside } else { folder };
    let images = images_in(folder)?;
    if !images.is_empty() {
        return Ok(images);
    }
    match &folders_of_images(folder).0[..] {
        [only] => images_in(only),
        several => Err(no_image(folder, "--yolo ", several)),
    }
}

/// Returns the images of the part for validation of a `data.yaml`, or of darknet's `obj.data`, or else those of its only part.
fn images_of_description(path: &Path) -> Result<(Vec<PathBuf>, bool), SourceError> {
    let text = read_text(path)?;
    let is_yaml = extension_of(path) != "data";
    let entries = if is_yaml { entries_of_yaml(&text) } else { Ok(entries_of_lines(&text)) };
    let entries = entries.map_err(|why| SourceError::label(path, why.line, &why.message))?;
    let beside = path.parent().unwrap_or(Path::new(""));
    let Some((part, places)) = part_of(&entries).map_err(|why| SourceError::of(path, &why))? else {
        return Ok((images_of_folder(beside)?, true));
    };
    let root = entries.iter().find(|(key, _)| key == "path").and_then(|(_, places)| places.first());
    let root = root.map(|root| beside.join(slashed(root))).filter(|root| root.is_dir());
    let roots = [root.as_deref().unwrap_or(beside), beside];
    let (mut images, mut is_whole) = (Vec::new(), true);
    for place in places {
        let found = roots.iter().find_map(|root| found_from(root, place)).ok_or_else(|| {
            let why =
                format!("{part}: '{place}' is found neither in {} nor beside this file", roots[0].display());
            SourceError::of(path, &why)
        })?;
        if found.is_dir() {
            images.extend(images_below(&found)?);
        } else {
            is_whole = false;
            images.extend(images_of_list(&found)?);
        }
    }
    let none = || SourceError::of(path, &format!("{part} has no image"));
    if images.is_empty() { Err(none()) } else { Ok((images, is_whole)) }
}

/// Returns the part for validation, or the only one; `None` where no part is named.
fn part_of(entries: &Entries) -> Result<Option<&(String, Vec<String>)>, String> {
    let named = |names: &[&str]| entries.iter().filter(|(key, _)| names.contains(&key.as_str())).collect();
    let [first, others]: [Vec<_>; 2] = PARTS.map(named);
    match (&first[..], &others[..]) {
        ([part, ..], _) | ([], [part]) => Ok(Some(part)),
        ([], []) => Ok(None),
        (_, others) => {
            let names = others.iter().map(|(key, _)| key.as_str()).collect::<Vec<_>>().join(", ");
            Err(format!("has no `val` but {names}; give the folder of the images in its place"))
        }
    }
}

/// The values of a description by their keys.
type Entries = Vec<(String, Vec<String>)>;

fn entries_of_yaml(text: &str) -> Result<Entries, yaml::YamlError> {
    let Content::Map(pairs) = yaml::read(text)?.content else { return Ok(Vec::new()) };
    let texts = |item: Item| match &item.content {
        Content::List(items) => items.iter().filter_map(|item| item.text().map(str::to_owned)).collect(),
        _ => item.text().map(str::to_owned).into_iter().collect(),
    };
    let entries = pairs.into_iter().map(|(key, item)| (key.name, texts(item)));
    Ok(entries.filter(|(_, texts): &(_, Vec<String>)| !texts.is_empty()).collect())
}

fn entries_of_lines(text: &str) -> Entries {
    let pairs = text.lines().filter_map(|line| line.split_once('='));
    let pairs = pairs.map(|(key, value)| (key.trim().to_owned(), value.trim().to_owned()));
    pairs.filter(|(_, value)| !value.is_empty()).map(|(key, value)| (key, vec![value])).collect()
}

/// Returns the images of a list, a path a line. A path that is not there is kept: it is an image that cannot be read.
fn images_of_list(list: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let folder = list.parent().unwrap_or(Path::new(""));
    let text = read_text(list)?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let images: Vec<_> =
        lines.map(|line| found_from(folder, line).unwrap_or_else(|| folder.join(parts(line)))).collect();
    if images.is_empty() {
        Err(SourceError::of(list, "is an empty list; a path of an image a line is needed"))
    } else {
        Ok(images)
    }
}

/// Returns what a file of a data set names by the path `text`, which begins in `folder` or, as on the machine where the file was written,
/// somewhere above it.
fn found_from(folder: &Path, text: &str) -> Option<PathBuf> {
    let given = folder.join(slashed(text));
    if given.exists() { Some(given) } else { below(folder, &parts(text)) }
}

/// Returns the path `text` of Windows or Unix with slashes, and without the letter of a drive.
pub(super) fn slashed(text: &str) -> String {
    let text = text.replace('\\', "/");
    match text.as_bytes() {
        [drive, b':', b'/', ..] if drive.is_ascii_alphabetic() => text[2..].to_owned(),
        _ => text,
    }
}

/// Returns the names in the path `text`, without its root and steps upwards.
pub(super) fn parts(text: &str) -> PathBuf {
    let text = slashed(text);
    Path::new(&text).components().filter(|part| matches!(part, Component::Normal(_))).collect()
}

/// Returns the file or folder in `folder` to which the most of the last names of `parts` lead.
pub(super) fn below(folder: &Path, parts: &Path) -> Option<PathBuf> {
    let names: Vec<_> = parts.iter().collect();
    let tails = (0..names.len()).map(|first| folder.join(names[first..].iter().collect::<PathBuf>()));
    tails.into_iter().find(|path| path.exists())
}
