//! Weights in files of their own beside an ONNX file, which PyTorch writes by default since 2.9: they are put into the model, so
//! that every engine reads the same bytes.
//!
//! Source: <https://github.com/onnx/onnx/blob/main/docs/ExternalData.md> and the message types of `onnx.proto`

use std::path::{Component, Path, PathBuf};

use modulo_runtime::input::read_bytes;

/// The largest model, bytes: a message of Protocol Buffers has no more.
const MOST: u64 = (1 << 31) - 1;
const REMEDY: &str = "put them beside the model, or save the model as one file: \
                      onnx.save(onnx.load(FILE), NEW, save_as_external_data=False)";
/// Levels of graphs within graphs that are followed.
const DEPTH: usize = 64;

/// An ONNX file with its weights.
pub struct ModelFile {
    /// The model with all of its weights in it.
    pub whole: Vec<u8>,
    /// The file, followed by each file with weights in the order in which the model names them.
    pub parts: Vec<(PathBuf, Vec<u8>)>,
}

/// Reads the model at `path` with the weights that lie beside it. A file that is no ONNX model is given as it is.
/// An error names a file that is missing, too short, no regular file, or not in the folder of the model or below it.
pub fn read(path: &Path) -> Result<ModelFile, String> {
    let file = read_bytes(path, MOST).map_err(|why| why.to_string())?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let size = file.len() as u64;
    let mut weights = Weights { folder, files: Vec::new(), read: size, whole: size, fault: None };
    let whole = weights.embed(&file, Kind::Model, 0);
    if let Some(why) = weights.fault {
        return Err(why);
    }
    let whole = whole.filter(|_| !weights.files.is_empty()).unwrap_or_else(|| file.clone());
    let own = (path.to_owned(), file);
    let others = weights.files.into_iter().map(|(name, bytes)| (folder.join(name), bytes));
    Ok(ModelFile { whole, parts: std::iter::once(own).chain(others).collect() })
}

/// The messages that lead to a tensor.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Model,
    Graph,
    Function,
    Node,
    Attribute,
    Sparse,
    Tensor,
}

impl Kind {
    /// Returns the message in the field `number` of this one; `None` for a field without a tensor.
    fn inner(self, number: u64) -> Option<Self> {
        Some(match (self, number) {
            (Self::Model, 7) | (Self::Attribute, 6 | 11) => Self::Graph,
            (Self::Model, 25) => Self::Function,
            (Self::Graph, 1) | (Self::Function, 7) => Self::Node,
            (Self::Node, 5) => Self::Attribute,
            (Self::Graph, 15) | (Self::Attribute, 22 | 23) => Self::Sparse,
            (Self::Graph, 5) | (Self::Attribute, 5 | 10) | (Self::Sparse, 1 | 2) => Self::Tensor,
            _ => return None,
        })
    }
}

/// Fields of a tensor: its bytes, and where they lie in a file of their own.
const RAW_DATA: u64 = 9;
const EXTERNAL_DATA: u64 = 13;
const DATA_LOCATION: u64 = 14;

struct Weights<'a> {
    folder: &'a Path,
    /// The files that were read, by the name in the model.
    files: Vec<(String, Vec<u8>)>,
    /// Bytes of the model and these files.
    read: u64,
    /// Bytes of the model with all weights in it, which may have one place of a file several times.
    whole: u64,
    fault: Option<String>,
}

impl Weights<'_> {
    /// Returns `message` with all weights in it; `None` when it is no such message, or after a fault.
    fn embed(&mut self, message: &[u8], kind: Kind, depth: usize) -> Option<Vec<u8>> {
        if depth > DEPTH {
            return None;
        }
        let (mut whole, mut place, mut external) = (Vec::new(), Place::default(), false);
        let mut rest = message;
        while !rest.is_empty() {
            let field = Field::take(&mut rest)?;
            match (kind, field.number, field.content) {
                (Kind::Tensor, EXTERNAL_DATA, Some(entry)) => place.add(entry)?,
                (Kind::Tensor, DATA_LOCATION, None) => external = field.value == 1,
                (_, number, Some(content)) if kind.inner(number).is_some() => {
                    let inner = self.embed(content, kind.inner(number)?, depth + 1)?;
                    put(&mut whole, number, &inner);
                }
                _ => whole.extend_from_slice(field.whole),
            }
        }
        if external {
            let bytes = self.bytes(&place);
            put(&mut whole, RAW_DATA, &bytes.map_err(|why| self.fault = Some(why)).ok()?);
        }
        Some(whole)
    }

    fn bytes(&mut self, place: &Place) -> Result<Vec<u8>, String> {
        let name = &place.location;
        let is_inside = |path: &Path| path.components().all(|part| matches!(part, Component::Normal(_)));
        if name.is_empty() || !is_inside(Path::new(name)) {
            return Err(format!(
                "its weights lie in '{name}', which is not in the folder of the model; {REMEDY}"
            ));
        }
        if !self.files.iter().any(|(known, _)| known == name) {
            let path = self.folder.join(name);
            let bytes = read_bytes(&path, MOST.saturating_sub(self.read)).map_err(|why| {
                format!("its weights in {} cannot be read: {why}; {REMEDY}", path.display())
            })?;
            self.read += bytes.len() as u64;
            self.files.push((name.clone(), bytes));
        }
        let (_, file) = self.files.iter().find(|(known, _)| known == name).expect("it was just added");
        let start = usize::try_from(place.offset).unwrap_or(usize::MAX);
        let length = place.length.map(|length| usize::try_from(length).unwrap_or(usize::MAX));
        let end = length.map_or(Some(file.len()), |length| start.checked_add(length));
        let bytes = end.and_then(|end| file.get(start..end)).ok_or_else(|| {
            let length = length.map_or("the rest".to_owned(), |length| format!("{length} bytes"));
            format!(
                "its weights in '{name}' are cut off: {length} from byte {start} on are needed, of {}",
                file.len()
            )
        })?;
        self.whole += bytes.len() as u64;
        // Some tensors may share their bytes, but a small file must not ask for the memory of a large model.
        if self.whole > MOST.min(2 * self.read) {
            return Err(format!(
                "its weights name the bytes in '{name}' again and again; save it as one file"
            ));
        }
        Ok(bytes.to_vec())
    }
}

/// The place of the bytes of a tensor.
#[derive(Default)]
struct Place {
    location: String,
    offset: u64,
    length: Option<u64>,
}

impl Place {
    /// Takes an entry, which has a key and a value.
    fn add(&mut self, entry: &[u8]) -> Option<()> {
        let (mut key, mut value, mut rest) = (String::new(), String::new(), entry);
        while !rest.is_empty() {
            let field = Field::take(&mut rest)?;
            let text = String::from_utf8(field.content?.to_vec()).ok()?;
            *if field.number == 1 { &mut key } else { &mut value } = text;
        }
        match key.as_str() {
            "location" => self.location = value,
            "offset" => self.offset = value.parse().ok()?,
            "length" => self.length = Some(value.parse().ok()?),
            // Such as a checksum, which most exporters leave out.
            _ => {}
        }
        Some(())
    }
}

/// A field of a message of Protocol Buffers.
struct Field<'a> {
    number: u64,
    /// Its value, if that is a number of variable length.
    value: u64,
    /// Its bytes, if it has a length.
    content: Option<&'a [u8]>,
    /// All of it, with its number.
    whole: &'a [u8],
}

impl<'a> Field<'a> {
    /// Takes the first field off `rest`; `None` when there is none.
    fn take(rest: &mut &'a [u8]) -> Option<Self> {
        let start = *rest;
        let key = number(rest)?;
        let (mut value, mut content) = (0, None);
        match key & 7 {
            0 => value = number(rest)?,
            1 => drop(split(rest, 8)?),
            2 => {
                let length = usize::try_from(number(rest)?).ok()?;
                content = Some(split(rest, length)?);
            }
            5 => drop(split(rest, 4)?),
            _ => return None,
        }
        let whole = &start[..start.len() - rest.len()];
        Some(Self { number: key >> 3, value, content, whole })
    }
}

fn split<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (head, left) = rest.split_at_checked(length)?;
    *rest = left;
    Some(head)
}

/// Takes a number of variable length off `rest`.
fn number(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = split(rest, 1)?[0];
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// Adds a field with a length to `message`.
fn put(message: &mut Vec<u8>, number: u64, content: &[u8]) {
    for mut value in [number << 3 | 2, content.len() as u64] {
        while value > 0x7f {
            message.push(value as u8 | 0x80);
            value >>= 7;
        }
        message.push(value as u8);
    }
    message.extend_from_slice(content);
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use ndarray::Array4;

    use super::super::Engine as _;
    use super::super::rten::Rten;
    use super::*;

    const MODEL: &[u8] = include_bytes!("../../tests/data/rows.onnx");

    /// The model with the bytes of its tensors moved to the file `name`, and that file.
    fn apart(message: &[u8], kind: Kind, name: &str, data: &mut Vec<u8>) -> Vec<u8> {
        let (mut whole, mut rest) = (Vec::new(), message);
        while !rest.is_empty() {
            let field = Field::take(&mut rest).expect("a field");
            match (kind, field.number, field.content) {
                (Kind::Tensor, RAW_DATA, Some(bytes)) => {
                    let (offset, length) = (data.len().to_string(), bytes.len().to_string());
                    for (key, value) in [("location", name), ("offset", &offset), ("length", &length)] {
                        let mut entry = Vec::new();
                        put(&mut entry, 1, key.as_bytes());
                        put(&mut entry, 2, value.as_bytes());
                        put(&mut whole, EXTERNAL_DATA, &entry);
                    }
                    whole.extend([(DATA_LOCATION << 3) as u8, 1]);
                    data.extend_from_slice(bytes);
                }
                (_, number, Some(content)) if kind.inner(number).is_some() => {
                    let inner = kind.inner(number).expect("just checked");
                    put(&mut whole, number, &apart(content, inner, name, data));
                }
                _ => whole.extend_from_slice(field.whole),
            }
        }
        whole
    }

    /// Writes the model, whose weights lie in the file `name`, into a folder.
    fn written(name: &str) -> (tempfile::TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (path, mut data) = (folder.path().join("model.onnx"), Vec::new());
        std::fs::write(&path, apart(MODEL, Kind::Model, name, &mut data)).expect("writable");
        (folder, path, data)
    }

    #[test]
    fn a_model_with_weights_beside_it_gives_the_same_boxes() {
        // Not every name ends in .data.
        let (folder, path, data) = written("weights.bin");
        std::fs::write(folder.path().join("weights.bin"), &data).expect("writable");
        let alone = folder.path().join("alone.onnx");
        std::fs::write(&alone, MODEL).expect("writable");
        let run = |path: &Path| {
            let file = read(path).expect("readable");
            let (mut engine, _) = Rten::load(path, file, NonZeroUsize::MIN).expect("a model");
            engine.run(Array4::from_elem((1, 3, 32, 32), 0.25).view()).expect("it runs")
        };
        assert_eq!(run(&path), run(&alone));
        let parts = read(&path).expect("readable").parts;
        assert_eq!(parts.iter().map(|(_, bytes)| bytes.len()).collect::<Vec<_>>()[1..], [data.len()]);
        assert_eq!(read(&alone).expect("readable").whole, MODEL);
    }

    /// A file of 100 MB that 60 tensors name would ask for 6 GB.
    #[test]
    fn a_file_that_many_tensors_name_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("model.onnx");
        std::fs::File::create(folder.path().join("weights"))
            .and_then(|file| file.set_len(1 << 20))
            .expect("sparse");
        let read_with = |tensors: usize| {
            let (mut tensor, mut entry) = (vec![(DATA_LOCATION << 3) as u8, 1], Vec::new());
            put(&mut entry, 1, b"location");
            put(&mut entry, 2, b"weights");
            put(&mut tensor, EXTERNAL_DATA, &entry);
            let (mut graph, mut model) = (Vec::new(), Vec::new());
            (0..tensors).for_each(|_| put(&mut graph, 5, &tensor));
            put(&mut model, 7, &graph);
            std::fs::write(&path, model).expect("writable");
            read(&path)
        };
        assert!(read_with(2).expect("shared weights").whole.len() > 2 << 20);
        assert!(read_with(60).err().expect("too much").contains("again and again"));
    }

    #[test]
    fn weights_that_are_elsewhere_missing_or_cut_are_refused() {
        for name in ["../model.onnx.data", "/etc/hostname", ""] {
            let why = read(&written(name).1).err().expect("outside");
            assert!(why.contains("not in the folder of the model") && why.contains("onnx.save"), "{why}");
        }
        let (folder, path, data) = written("model.onnx.data");
        let beside = folder.path().join("model.onnx.data");
        assert!(read(&path).err().expect("missing").contains("model.onnx.data cannot be read: No such file"));
        std::fs::write(&beside, &data[1..]).expect("writable");
        assert!(read(&path).err().expect("cut").contains("are cut off"));
        std::fs::remove_file(&beside).expect("there");
        std::os::unix::fs::symlink("/dev/zero", &beside).expect("a link");
        assert!(read(&path).err().expect("endless").contains("is not a regular file"));
    }
}
