//! [`VideoSource`]: the frames of a video file, with their times of presentation.

use std::path::Path;

use modulo_images::Coding;
use modulo_video::VideoFile;

use super::{Source, SourceError, SourceFrame, SourceOptions};

/// The frames of a video file. The stamp of a frame is its time of presentation since the first frame.
pub struct VideoSource {
    video: VideoFile,
    coding: Coding,
}

impl VideoSource {
    /// Opens the video at `path`. Of `options`, the topic and the white are not used: a video tells how many bits its samples have.
    ///
    /// # Errors
    /// [`SourceError::Video`] when ffmpeg is not there, and for a file that is no video.
    pub fn open(path: &Path, options: &SourceOptions) -> Result<Self, SourceError> {
        Ok(Self { video: VideoFile::open(path)?, coding: options.coding.clone() })
    }
}

impl Source for VideoSource {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let frame = self.video.next_frame()?;
        Some(frame.map_err(SourceError::from).and_then(|frame| {
            let name = format!("{:06}", frame.number);
            let radiance = frame.pixels.radiance(&self.coding, &name)?;
            Ok(SourceFrame { stamp_ns: frame.time_ns, ..SourceFrame::new(name, radiance) })
        }))
    }

    fn skip(&mut self, frames: u64) {
        self.video.skip(frames);
    }

    fn len(&self) -> Option<usize> {
        usize::try_from(self.video.frames()).ok()
    }

    fn warnings(&self) -> Vec<String> {
        self.video.warnings()
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        self.video.rewind();
        Ok(())
    }
}
