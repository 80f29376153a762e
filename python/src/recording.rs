//! Recorded and rendered frames.

use std::ffi::CString;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use modulo_bags::source::{self, BagSource, GroundTruth, SourceError, SourceOptions};
use modulo_camera::CameraParameters;
use modulo_core::Mosaic;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::image::{frame_to_numpy, to_numpy, value_error};
use crate::parameters::parse;
use crate::score::Object;

/// The image, its name, its stamp, its coordinate frame, its mosaic, and its labelled objects.
type Frame<'py> = (Bound<'py, PyAny>, String, Option<u64>, String, &'static str, Option<Vec<Object>>);

/// The images of one topic of a bag, as they were recorded.
#[pyclass(frozen, module = "modulo_camera._core")]
pub struct Bag(Mutex<BagSource>);

/// The radiance of the frames of a source of the camera.
#[pyclass(frozen, module = "modulo_camera._core")]
pub struct Source(Mutex<source::Source>);

#[pymethods]
impl Bag {
    #[new]
    fn new(py: Python<'_>, parameters: &Bound<'_, PyDict>) -> PyResult<Self> {
        let (source, options) = options(parameters)?;
        let bag = py.detach(|| BagSource::open(Path::new(&source), &options)).map_err(value_error)?;
        warn(py, bag.bag().warnings().iter().map(ToString::to_string))?;
        Ok(Self(Mutex::new(bag)))
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Frame<'py>>> {
        let Some(image) = next(py, &self.0, BagSource::next_image)? else { return Ok(None) };
        let stamp = image.header.stamp.as_ns();
        let mosaic = image.pixels.mosaic().map_or("none", Mosaic::word);
        let pixels = frame_to_numpy(py, image.pixels, true);
        let objects = objects(image.ground_truth);
        Ok(Some((pixels, stamp.to_string(), Some(stamp), image.header.frame_id, mosaic, objects)))
    }
}

#[pymethods]
impl Source {
    #[new]
    fn new(py: Python<'_>, parameters: &Bound<'_, PyDict>) -> PyResult<Self> {
        let (source, options) = options(parameters)?;
        let source = py.detach(|| source::open(&source, &options)).map_err(value_error)?;
        warn(py, [&*source.losses, &*source.warnings].concat().into_iter())?;
        Ok(Self(Mutex::new(source)))
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Frame<'py>>> {
        let Some(frame) = next(py, &self.0, source::Source::next)? else { return Ok(None) };
        let radiance = to_numpy(py, frame.radiance, true);
        let objects = objects(frame.ground_truth);
        Ok(Some((radiance, frame.name, frame.stamp_ns, frame.frame_id, "none", objects)))
    }
}

fn options(parameters: &Bound<'_, PyDict>) -> PyResult<(String, SourceOptions)> {
    let parameters = CameraParameters::from(&parse(parameters)?);
    let coding = parameters.coding().map_err(value_error)?;
    let topic = Some(parameters.source_topic).filter(|topic| !topic.is_empty());
    Ok((parameters.source, SourceOptions { coding, topic }))
}

/// Reads the next item while Python runs other threads.
fn next<S: Send, T: Send>(
    py: Python<'_>,
    source: &Mutex<S>,
    read: impl FnOnce(&mut S) -> Option<Result<T, SourceError>> + Send,
) -> PyResult<Option<T>> {
    // The lock is taken without Python: a thread that waits for it must not keep the one that holds it from going on.
    let item = py.detach(|| read(&mut source.lock().unwrap_or_else(PoisonError::into_inner)));
    item.transpose().map_err(value_error)
}

fn objects(truth: Option<Vec<GroundTruth>>) -> Option<Vec<Object>> {
    let object = |GroundTruth { bbox, class, truncated, occluded }| {
        (bbox.x1, bbox.y1, bbox.x2, bbox.y2, class, truncated, occluded)
    };
    Some(truth?.into_iter().map(object).collect())
}

fn warn(py: Python<'_>, mut warnings: impl Iterator<Item = String>) -> PyResult<()> {
    warnings.try_for_each(|text| {
        // A text of C ends at its first zero byte, which a name in a damaged bag may have.
        let text = CString::new(text.replace('\0', " ")).expect("no zero byte is left");
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)
    })
}
