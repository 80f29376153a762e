//! [`AnnotatedVideo`]: the annotated images of an evaluation as a video.

use std::path::{Path, PathBuf};

use modulo_draw::RgbImage;
use modulo_video::{Encoder, VideoError};

/// Rate of a video of one frame, Hz.
const NOMINAL_RATE: f64 = 10.0;
/// Width and height of a picture that shows whether a video can be written, px.
const PROBE: (u32, u32) = (64, 64);
/// The possible rates, Hz.
const RATES: (f64, f64) = (0.1, 240.0);

/// A video of pictures of one size. Its rate is that of the first two pictures.
pub struct AnnotatedVideo {
    path: PathBuf,
    /// The first picture with its stamp, until the second one comes.
    first: Option<(RgbImage, u64)>,
    encoder: Option<Encoder>,
}

impl AnnotatedVideo {
    /// Prepares a video at `path`, whose extension names the container. A file that is there is replaced, also by nothing.
    ///
    /// # Errors
    /// [`VideoError`] when ffmpeg is not there, or writes no such video.
    pub fn create(path: &Path) -> Result<Self, VideoError> {
        // A video of one black picture, which does not stay: a path or a container that is not possible is known now.
        let mut probe = Encoder::create(path, PROBE, NOMINAL_RATE)?;
        let written = probe.add(&[0; 3 * (PROBE.0 * PROBE.1) as usize]).and_then(|()| probe.finish());
        if path.is_file() {
            // What is left where this fails is replaced by the video.
            let _ = std::fs::remove_file(path);
        }
        written?;
        Ok(Self { path: path.to_owned(), first: None, encoder: None })
    }

    /// Adds a picture of the frame of `stamp`, ns.
    ///
    /// # Errors
    /// [`VideoError`] when it cannot be written, and for a picture of another size.
    pub fn add(&mut self, picture: RgbImage, stamp: u64) -> Result<(), VideoError> {
        if let Some((first, before)) = self.first.take() {
            let seconds = stamp.saturating_sub(before) as f64 / 1e9;
            self.start(&first, (1.0 / seconds).clamp(RATES.0, RATES.1))?;
        }
        match &mut self.encoder {
            Some(encoder) => encoder.add(&picture)?,
            None => self.first = Some((picture, stamp)),
        }
        Ok(())
    }

    /// Starts the file with its first picture.
    fn start(&mut self, first: &RgbImage, rate: f64) -> Result<(), VideoError> {
        self.encoder.insert(Encoder::create(&self.path, first.dimensions(), rate)?).add(first)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`VideoError`] when it cannot be written, and when there was no picture.
    pub fn finish(mut self) -> Result<(), VideoError> {
        if let Some((first, _)) = self.first.take() {
            self.start(&first, NOMINAL_RATE)?;
        }
        match self.encoder {
            Some(encoder) => encoder.finish(),
            None => {
                let why = "no frame has an annotated image, so that there is no video";
                Err(VideoError::Failed(self.path.display().to_string(), why.to_owned()))
            }
        }
    }
}
