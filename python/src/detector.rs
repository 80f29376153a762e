//! The detector on single images, and its boxes on them.

use std::sync::{Mutex, PoisonError};

use modulo_bags::source::{Pictures, SourceOptions};
use modulo_core::{BBox, Detection, Frame};
use modulo_detector::{Detector, DetectorParameters, drawn};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::{eight_bits, frame_to_numpy, value_error};
use crate::parameters::parse;
use crate::score::Found;

/// A network that is loaded.
#[pyclass(frozen, module = "modulo_camera._core")]
pub struct Network(Mutex<Detector>);

#[pymethods]
impl Network {
    #[new]
    #[pyo3(signature = (**parameters))]
    fn new(py: Python<'_>, parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let parameters = DetectorParameters::from(&parse(parameters.unwrap_or(&PyDict::new(py)))?);
        // All scores, among which `find` chooses, and as many threads as the machine has cores.
        let parameters = DetectorParameters { score_threshold: 0.0, threads: 0, ..parameters };
        py.detach(|| Detector::new(&parameters))
            .map(|detector| Self(Mutex::new(detector)))
            .map_err(value_error)
    }

    /// Returns the objects in an image whose score is at least `threshold`, the best one first.
    fn find(&self, py: Python<'_>, image: &Bound<'_, PyAny>, threshold: f32) -> PyResult<Vec<Found>> {
        if !(0.0..=1.0).contains(&threshold) {
            return Err(value_error(format!("threshold is {threshold}, 0 to 1 is possible")));
        }
        let picture = Frame::from_u8(eight_bits("image", image)?).map_err(value_error)?;
        let find = || self.0.lock().unwrap_or_else(PoisonError::into_inner).find(&picture);
        let mut found = py.detach(find).map_err(value_error)?;
        found.retain(|one| one.score >= threshold);
        let fields = |Detection { bbox, score, class }| (bbox.x1, bbox.y1, bbox.x2, bbox.y2, score, class);
        Ok(found.into_iter().map(fields).collect())
    }
}

/// Returns the image in a file, as the command `modulo detect` looks at it.
#[pyfunction]
pub fn read_image<'py>(py: Python<'py>, path: &str) -> PyResult<Bound<'py, PyAny>> {
    let read = || {
        let mut pictures = Pictures::open(path, &SourceOptions::default()).map_err(|why| why.to_string())?;
        if pictures.files.len() != 1 {
            return Err(format!("{path}: is not one image; read_source gives the frames of other sources"));
        }
        let picture = pictures.next().expect("it has one file").map_err(|why| why.to_string())?;
        Ok(picture.pixels)
    };
    Ok(frame_to_numpy(py, py.detach(read).map_err(value_error)?, true))
}

/// Returns a copy of an image in red, green and blue with boxes.
#[pyfunction]
pub fn draw<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    boxes: Vec<Found>,
) -> PyResult<Bound<'py, PyAny>> {
    let picture = Frame::from_u8(eight_bits("image", image)?).map_err(value_error)?;
    let detection =
        |(x1, y1, x2, y2, score, class)| Detection { bbox: BBox { x1, y1, x2, y2 }, score, class };
    let found: Vec<_> = boxes.into_iter().map(detection).collect();
    Ok(frame_to_numpy(py, py.detach(|| drawn(&picture, &found)).map_err(value_error)?, false))
}
