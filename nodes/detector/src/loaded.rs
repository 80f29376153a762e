//! [`Loaded`]: a model that has run, and the sizes of its input that are as fast as they get.

use std::path::Path;

use modulo_core::{Detection, Letterbox};
use modulo_runtime::{Context, Job, ParameterError, Parameters, warn_once};
use ndarray::{Array2, ArrayView4};

use crate::DetectorError;
use crate::classes::ClassMap;
use crate::engine::{Engine as _, OpenedEngine};
use crate::head::Head;
use crate::input_size::InputSize;
use crate::model::{DEMO, DEMO_LIMIT, ModelLayout};
use crate::parameter::{DetectorParameters, Settings};
use crate::plausible::EXPORT;
use crate::post::{are_shares, detections};
use crate::sessions::Sessions;

/// The most sizes of the input that a model has run at before it takes the place of another one.
const MOST_SIZES: usize = 8;

/// A model that has run with these parameters.
pub struct Loaded {
    pub settings: Settings,
    pub engine: OpenedEngine,
    /// The form of the output of the model.
    head: Head,
    /// Whether boxes of this model were looked at, which should not be shares of its input.
    boxes_checked: bool,
    /// (height, width) of the inputs that it has run at, at least one.
    sizes: Vec<(usize, usize)>,
    /// Those at which it could not run, and those that it was asked to be loaded for once more.
    asked: Vec<(usize, usize)>,
}

impl Loaded {
    /// Loads the model and runs it once for images of each of these sizes (height, width), so that their first frame is as fast as all
    /// others; or takes one of `sessions` that has.
    pub fn new(
        parameters: &DetectorParameters,
        images: &[(usize, usize)],
        sessions: &Sessions,
    ) -> Result<Self, DetectorError> {
        let settings = |layout: &ModelLayout| {
            Ok(Settings::new(parameters, layout, ClassMap::read(&parameters.class_map, &layout.names)?)?)
        };
        let (engine, head) = sessions.open(
            parameters.model()?,
            parameters.engine_options()?,
            &parameters.input_size,
            |layout| settings(layout).map(|settings| settings.input_size.tensors(images)),
        )?;
        let settings = settings(&engine.layout)?;
        tracing::info!("model {} runs on {} ({}); output {head}", parameters.model, engine.name, engine.note);
        if parameters.model == DEMO {
            tracing::info!("{DEMO_LIMIT}");
        }
        let sizes = settings.input_size.tensors(images);
        Ok(Self { settings, engine, head, boxes_checked: false, sizes, asked: Vec::new() })
    }

    /// Runs the model for images of these sizes (height, width) where it has not run at the size of their input yet.
    pub fn warm_up(&mut self, images: &[(usize, usize)]) {
        for size in self.settings.input_size.tensors(images) {
            if self.sizes.contains(&size) || self.asked.contains(&size) {
                continue;
            }
            match self.engine.warm_up(size) {
                Ok(_) => {
                    tracing::info!("the model has run at {}x{}", size.1, size.0);
                    self.sizes.push(size);
                }
                // The frames of this size report it.
                Err(_) => self.asked.push(size),
            }
        }
    }

    /// Returns the input size for an image of (height, width), one of `images`. Where the first run at it takes long, the driver of `cx` has
    /// the model loaded beside and run at it; until then images are fitted into the last size.
    pub fn size_for(
        &mut self,
        (height, width): (usize, usize),
        images: &[(usize, usize)],
        cx: &mut Context<'_>,
    ) -> InputSize {
        let wanted = self.settings.input_size;
        let size = wanted.tensor(height, width);
        if !self.engine.searches || self.sizes.contains(&size) {
            return wanted;
        }
        let &(rows, columns) = self.sizes.last().expect("it has run at one size at least");
        let job = || {
            // One that could not be made is not asked for again: the frames of this size report why.
            (!self.asked.contains(&size)).then(|| {
                tracing::info!(
                    "images of {width}x{height} are fitted into {columns}x{rows} until the model has run at {}x{}",
                    size.1,
                    size.0
                );
                self.asked.push(size);
                self.beside(images)
            })
        };
        if cx.make_beside(job) { InputSize::Fixed(rows, columns) } else { wanted }
    }

    /// Returns the job that loads the same model and runs it for `images` of these sizes as well.
    fn beside(&self, images: &[(usize, usize)]) -> Job {
        let last = self.sizes.iter().rev().take(MOST_SIZES).rev();
        let images: Vec<_> = last.chain(images).copied().collect();
        let parameters = self.settings.parameters.clone();
        Box::new(move || {
            let failed = |why: DetectorError| {
                ParameterError::new("input_size", &parameters.input_size, why.to_string())
            };
            Ok(Box::new(Self::new(&parameters, &images, &Sessions::default()).map_err(failed)?))
        })
    }

    pub fn infer(&mut self, tensor: ArrayView4<'_, f32>) -> Result<Array2<f32>, String> {
        let output = self.engine.engine.run(tensor).map_err(|why| why.to_string())?;
        if self.head.fits(output.dim()) {
            return Ok(output);
        }
        Err(format!(
            "output is [1, {}, {}], and that of the first run was {}",
            output.nrows(),
            output.ncols(),
            self.head
        ))
    }

    /// Returns the boxes in an output of the model for an image at the place `letterbox`.
    pub fn detections(&mut self, output: &Array2<f32>, letterbox: &Letterbox) -> Vec<Detection> {
        let found = detections(output, self.head, letterbox, &self.settings);
        if !self.boxes_checked && !found.is_empty() {
            self.boxes_checked = true;
            if are_shares(&found, letterbox) {
                let why = "no box is larger than one pixel: its boxes seem to be shares of its input, and pixels are needed";
                warn_once(format!("model '{}': {why}; {EXPORT}", self.settings.parameters.model));
            }
        }
        found
    }

    /// Loads the model of `next` in place of that of `last`.
    pub fn after(
        last: &Parameters,
        next: &Parameters,
        images: &[(usize, usize)],
    ) -> Result<Self, ParameterError> {
        Self::new(&next.into(), images, &Sessions::default()).map_err(|why| match why {
            DetectorError::Parameter(why) => why,
            DetectorError::Engine(why) => {
                let loaded_with = ["model", "engine", "device", "cudnn_search", "input_size", "threads"];
                let first = last.changed(next).find(|(name, _)| loaded_with.contains(name));
                let (name, value) = first.expect("a model is loaded again where one of them has changed");
                ParameterError::new(name, value.plain(), why.to_string())
            }
        })
    }

    pub fn model_file(&self) -> String {
        let model = Path::new(&self.settings.parameters.model);
        model.file_name().unwrap_or(model.as_os_str()).to_string_lossy().into_owned()
    }
}
