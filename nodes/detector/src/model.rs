//! The required inputs and outputs of a model, and the form of its output.
//!
//! No engine is named here: engines bring the inputs, outputs and properties of a model, this judges them.

use std::fmt;
use std::path::Path;

use crate::engine::EngineError;
use crate::head::FORMS;
use crate::input_size::STRIDE;
use crate::names::ClassNames;

/// Value of the parameter `model` for the embedded model; a file of that name is `./demo`.
pub const DEMO: &str = "demo";

/// The sentence that says which images the embedded model is made for, and how another model is fetched.
pub const DEMO_LIMIT: &str = "the embedded demonstration model knows rendered scenes (scene://PRESET) only; fetch a real one, such as by \
                              modulo model fetch yolov10n";

/// Returns the bytes of `model` if it is the embedded one.
pub fn embedded(model: &Path) -> Option<&'static [u8]> {
    (model == Path::new(DEMO)).then_some(modulo_models::DEMO)
}

const INPUT: &str = "exactly one input [1, 3, H, W] of float32 or float16, H and W both fixed or both free";
const NAMES: &str = "a text file with one name a line, or none";
const TASK: &str = "a YOLO for detection (task detect), such as yolo11n.pt";

/// The type of the elements of a tensor that each engine reads: floats of 32 bits.
pub const FLOAT32: &str = "float32";
/// Floats of 16 bits, which ONNX Runtime reads as well: exports with `half=True` have them.
pub const FLOAT16: &str = "float16";
/// The types of the elements that a tensor may have.
const FLOATS: [&str; 2] = [FLOAT32, FLOAT16];

/// An input or output of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Its name in the graph.
    pub name: String,
    /// Name of the type of its elements, such as [`FLOAT32`].
    pub element: String,
    /// Sides, `None` for a free one; `None` as a whole when the file does not contain the shape.
    pub shape: Option<Vec<Option<usize>>>,
}

impl fmt::Display for TensorSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, element, shape } = self;
        let Some(shape) = shape else { return write!(f, "'{name}' of {element} without a shape") };
        let side = |side: &Option<usize>| side.map_or("?".to_owned(), |side| side.to_string());
        let sides: Vec<_> = shape.iter().map(side).collect();
        write!(f, "'{name}' [{}] of {element}", sides.join(", "))
    }
}

/// The value of a property of a model, such as ultralytics writes them, as an engine reads it.
type Property<'a> = &'a dyn Fn(&str) -> Option<String>;

/// Returns what the model is where that is no YOLO for detection.
fn other_model(property: Property<'_>) -> Option<String> {
    let task = property("task").filter(|task| !task.is_empty() && task != "detect");
    let task = task.map(|task| match &*task {
        "segment" => "a model for segmentation".to_owned(),
        "pose" => "a model for poses".to_owned(),
        "obb" => "a model for oriented boxes (OBB)".to_owned(),
        "classify" => "a model for classification".to_owned(),
        other => format!("a model for the task {other}"),
    });
    let is_rt_detr = property("head").is_some_and(|head| head.starts_with("RTDETR"));
    task.or_else(|| is_rt_detr.then(|| "an RT-DETR".to_owned()))
}

/// Returns the stride, of which the sides of the input are multiples.
fn stride(property: Property<'_>) -> usize {
    let told = property("stride").and_then(|stride| stride.parse().ok());
    told.filter(|stride| [64, 128].contains(stride)).unwrap_or(STRIDE)
}

/// Returns whether the model says that it removes overlapping boxes itself, if it says anything about that.
fn is_end_to_end(property: Property<'_>) -> Option<bool> {
    let args = property("args").unwrap_or_default().to_lowercase().replace([' ', '\'', '"'], "");
    if args.split(['{', ',', '}']).any(|pair| pair == "nms:true") {
        return Some(true);
    }
    property("end2end").and_then(|value| value.to_lowercase().parse().ok())
}

/// Names and sizes of a model that this node can read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelLayout {
    /// Name of the image input.
    pub input: String,
    /// Name of the output with the boxes.
    pub output: String,
    /// (height, width) of the input where the model fixes them.
    pub size: Option<(usize, usize)>,
    /// The sides of the input are multiples of it.
    pub stride: usize,
    pub names: ClassNames,
    /// Whether the model says that it removes overlapping boxes itself.
    pub end_to_end: Option<bool>,
}

impl ModelLayout {
    /// Judges the inputs, without the initialisers, and the outputs in the order of the file. Reads the names: from the metadata, else from
    /// a file `<model>.names`, else there are no names.
    pub fn of(
        model: &Path,
        (inputs, outputs): (&[TensorSpec], &[TensorSpec]),
        property: Property<'_>,
    ) -> Result<Self, EngineError> {
        let property = &|key: &str| property(key).map(|value| value.trim().to_owned());
        let refuse = |found: String, needed| {
            EngineError(format!("model '{}': {found}, needed is {needed}", model.display()))
        };
        if let Some(other) = other_model(property) {
            return Err(refuse(format!("is {other}"), TASK));
        }
        let (input, size) =
            image_input(inputs).ok_or_else(|| refuse(format!("input is {}", list(inputs)), INPUT))?;
        let output = output(outputs).ok_or_else(|| refuse(format!("output is {}", list(outputs)), FORMS))?;
        Ok(Self {
            input: input.to_owned(),
            output: output.name.clone(),
            size,
            stride: stride(property),
            names: ClassNames::of(model, property("names").as_deref())
                .map_err(|why| refuse(format!("file of class names {why}"), NAMES))?,
            end_to_end: is_end_to_end(property),
        })
    }
}

/// Returns the name of the only input, and the size that it fixes, if any.
fn image_input(inputs: &[TensorSpec]) -> Option<(&str, Option<(usize, usize)>)> {
    let [TensorSpec { name, element, shape: Some(shape) }] = inputs else { return None };
    match shape[..] {
        _ if !FLOATS.contains(&element.as_str()) => None,
        [Some(1) | None, Some(3) | None, Some(height), Some(width)] if height > 0 && width > 0 => {
            Some((name, Some((height, width))))
        }
        [Some(1) | None, Some(3) | None, None, None] => Some((name, None)),
        _ => None,
    }
}

/// Returns the first output that may have boxes, or a later one whose rows are those of an end-to-end export. The first run looks at the
/// real shape, which a file may leave open.
fn output(outputs: &[TensorSpec]) -> Option<&TensorSpec> {
    let mut possible = outputs.iter().filter(|port| {
        let sides = port.shape.as_deref();
        FLOATS.contains(&port.element.as_str())
            && sides.is_none_or(|sides| matches!(sides, [None | Some(1), _, _]))
    });
    let has_rows = |port: &&TensorSpec| matches!(port.shape.as_deref(), Some([_, _, Some(6)]));
    possible.clone().find(has_rows).or_else(|| possible.next())
}

fn list(ports: &[TensorSpec]) -> String {
    if ports.is_empty() {
        return "missing".to_owned();
    }
    ports.iter().map(TensorSpec::to_string).collect::<Vec<_>>().join(" and ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(name: &str, sides: &[usize]) -> TensorSpec {
        // A free side is written as 0.
        let shape = Some(sides.iter().map(|&side| Some(side).filter(|&side| side > 0)).collect());
        TensorSpec { name: name.to_owned(), element: FLOAT32.to_owned(), shape }
    }

    fn judged(outputs: Vec<TensorSpec>, properties: &[(&str, &str)]) -> Result<ModelLayout, String> {
        let property = |key: &str| {
            properties.iter().find(|(known, _)| *known == key).map(|(_, value)| (*value).to_owned())
        };
        let inputs = [port("images", &[1, 3, 0, 0])];
        ModelLayout::of(Path::new("model.onnx"), (&inputs, &outputs), &property)
            .map_err(|why| why.to_string())
    }

    #[test]
    fn a_model_for_another_task_is_refused_by_name() {
        for (properties, name) in [
            (("task", "segment"), "segmentation"),
            (("task", "pose"), "poses"),
            (("task", "obb"), "OBB"),
            (("task", "classify"), "classification"),
            (("task", "depth"), "the task depth"),
            (("head", "RTDETRDecoder"), "an RT-DETR"),
        ] {
            let why = judged(vec![port("output0", &[1, 84, 8400])], &[properties]).expect_err("no detector");
            assert!(why.contains(name) && why.contains("task detect"), "{why}");
        }
        assert!(
            judged(vec![port("output0", &[1, 84, 8400])], &[("task", "detect"), ("head", "Detect")]).is_ok()
        );
    }

    #[test]
    fn the_metadata_says_who_removes_overlapping_boxes() {
        let args =
            |nms: &str| format!("{{'data': None, 'agnostic_nms': True, 'nms': {nms}, 'dynamic': False}}");
        for (properties, expected) in [
            (vec![], None),
            (vec![("end2end", "True".to_owned())], Some(true)),
            (vec![("end2end", "false".to_owned()), ("args", args("None"))], Some(false)),
            (vec![("end2end", "False".to_owned()), ("args", args("True"))], Some(true)),
            (vec![("args", r#"{"nms": true}"#.to_owned())], Some(true)),
            (vec![("args", args("False"))], None),
            (vec![("end2end", "perhaps".to_owned())], None),
        ] {
            let properties: Vec<_> = properties.iter().map(|(key, value)| (*key, value.as_str())).collect();
            let layout = judged(vec![port("output0", &[1, 300, 6])], &properties).expect("a detector");
            assert_eq!(layout.end_to_end, expected, "{properties:?}");
        }
    }

    #[test]
    fn the_output_with_boxes_is_found() {
        for (outputs, name) in [
            (vec![port("boxes", &[0, 84, 0])], "boxes"),
            (vec![port("boxes", &[1, 25_200, 85]), port("map", &[1, 3, 80, 80, 85])], "boxes"),
            (vec![port("many", &[1, 84, 8400]), port("boxes", &[1, 300, 6])], "boxes"),
            (vec![TensorSpec { shape: None, ..port("boxes", &[]) }], "boxes"),
        ] {
            assert_eq!(judged(outputs, &[]).expect("a detector").output, name);
        }
        for none in [
            vec![],
            vec![port("output0", &[1, 1000])],
            vec![port("output0", &[4, 84, 8400])],
            vec![TensorSpec { element: "int64".to_owned(), ..port("output0", &[1, 300, 6]) }],
        ] {
            let why = judged(none, &[]).expect_err("no boxes");
            assert!(why.contains("output is") && why.contains("[1, 4 + C, N]"), "{why}");
        }
    }

    #[test]
    fn the_stride_is_that_of_the_metadata() {
        for (told, stride) in [("32", 32), ("64", 64), ("16", 32), ("0", 32), ("99999999", 32), ("many", 32)]
        {
            let layout =
                judged(vec![port("output0", &[1, 300, 6])], &[("stride", told)]).expect("a detector");
            assert_eq!(layout.stride, stride, "{told}");
        }
    }
}
