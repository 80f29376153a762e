//! [`open`]: the frames of a video file, with their times of presentation.

use std::path::Path;

use modulo_images::Coding;
use modulo_video::VideoFile;

use super::{ReadFrames, Source, SourceError, SourceFrame, SourceOptions};

/// The frames of a video file. The stamp of a frame is its time of presentation since the first frame.
struct VideoFrames {
    video: VideoFile,
    coding: Coding,
}

/// Opens the video at `path`. Of `options`, the topic and the white are not used: a video tells how many bits its samples have.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Source, SourceError> {
    let video = VideoFile::open(path)?;
    let (len, warnings) = (usize::try_from(video.frames()).ok(), video.warnings());
    let coding = options.coding.clone();
    Ok(Source { len, warnings, ..Source::over(VideoFrames { video, coding }) })
}

impl ReadFrames for VideoFrames {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let frame = self.video.next_frame()?;
        Some(frame.map_err(SourceError::from).and_then(|frame| {
            let name = format!("{:06}", frame.number);
            let radiance = frame.pixels.radiance(&self.coding, &name)?;
            Ok(SourceFrame { stamp_ns: frame.time_ns, ..SourceFrame::new(name, radiance) })
        }))
    }

    fn pass(&mut self, frames: u64) {
        self.video.skip(frames);
    }

    fn rewind(&mut self) {
        self.video.rewind();
    }
}
