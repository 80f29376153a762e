//! The boxes that the embedded detector finds, as the detector node finds them with the engine rten.

use modulo_core::candidates::Candidate;
use modulo_core::{BBox, tone};
use rten::{Model, ModelOptions, NodeId, ValueView, op_registry};

/// The embedded demonstration. It knows rendered scenes only.
const MODEL: &[u8] = include_bytes!("../../crates/models/demo.onnx");

/// Boxes with a lower score are left out: more of them are on what is no object.
const LEAST_SCORE: f32 = 0.5;

/// The embedded model, loaded.
pub struct Detector {
    model: Model,
    input: NodeId,
    output: NodeId,
}

impl Detector {
    /// Loads the model, with its operators alone, so that the program has no others.
    pub fn new() -> Result<Self, String> {
        let operators = op_registry!(
            Add,
            ArgMax,
            Cast,
            Clip,
            Concat,
            ConstantOfShape,
            Conv,
            Div,
            Exp,
            Floor,
            Gather,
            GatherElements,
            GreaterOrEqual,
            MaxPool,
            Mul,
            Pad,
            ReduceMax,
            Relu,
            Reshape,
            Resize,
            Shape,
            Sigmoid,
            Slice,
            Sub,
            TopK,
            Transpose,
            Unsqueeze
        );
        let model = ModelOptions::with_ops(operators).load_static_slice(MODEL).map_err(text)?;
        let (&[input], &[output]) = (model.input_ids(), model.output_ids()) else {
            return Err("The embedded model has one input and one output.".to_owned());
        };
        Ok(Self { model, input, output })
    }

    /// Returns the boxes in an image of red, green and blue, whose height and width are multiples of 32.
    pub fn find(&self, pixels: &[u8], (height, width): (usize, usize)) -> Result<Vec<Candidate>, String> {
        let mut planes = vec![0.0; 3 * height * width];
        let (red, rest) = planes.split_at_mut(height * width);
        let (green, blue) = rest.split_at_mut(height * width);
        tone::unit_planes(pixels, [red, green, blue]);
        let image =
            ValueView::from_shape([1, 3, height, width].as_slice(), planes.as_slice()).map_err(text)?;
        let [output] =
            self.model.run_n(vec![(self.input, image.into())], [self.output], None).map_err(text)?;
        let (_, rows) = output.into_shape_vec::<f32, 3>().map_err(text)?;
        let of_row = |row: &[f32]| Candidate {
            bbox: BBox { x1: row[0], y1: row[1], x2: row[2], y2: row[3] }.clamp(height, width),
            score: row[4],
            class: row[5] as usize,
        };
        Ok(rows.chunks_exact(6).filter(|row| row[4] >= LEAST_SCORE).map(of_row).collect())
    }
}

fn text(why: impl std::fmt::Display) -> String {
    why.to_string()
}
