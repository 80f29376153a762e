//! [`Encoder`]: pictures to a video file.

use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Stdio};
use std::thread::JoinHandle;

use crate::VideoError;
use crate::program::{Reports, command, needed_version};

/// Filters that make the sides even, as most encoders need them, and luma and chroma by BT.709, as players read them.
const FILTERS: &str =
    "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";
const COLOURS: [&str; 6] = ["-color_primaries", "bt709", "-color_trc", "bt709", "-colorspace", "bt709"];

/// A video file that is written. One that is dropped before [`Encoder::finish`] is not complete.
pub struct Encoder {
    path: PathBuf,
    child: Child,
    pixels: Option<ChildStdin>,
    reports: Option<JoinHandle<Reports>>,
    /// Bytes of a picture.
    size: usize,
}

impl Encoder {
    /// Starts a new video at `path`, whose extension names the container, of pictures of `width` x `height` px at `rate` Hz. A file that is
    /// there is replaced.
    ///
    /// # Errors
    /// [`VideoError`] when ffmpeg is not there.
    pub fn create(path: &Path, (width, height): (u32, u32), rate: f64) -> Result<Self, VideoError> {
        needed_version(path.display())?;
        let mut file = std::ffi::OsString::from("file:");
        file.push(path);
        let size = format!("{width}x{height}");
        let mut child = command("ffmpeg")
            .args(["-y", "-hide_banner", "-loglevel", "level+error"])
            .args(format!("-f rawvideo -pixel_format rgb24 -video_size {size} -framerate {rate}").split(' '))
            .args(["-i", "pipe:0", "-vf", FILTERS])
            .args(COLOURS)
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|why| VideoError::failed(path.display(), why))?;
        let lines = BufReader::new(child.stderr.take().expect("it is piped"));
        let reports = std::thread::spawn(move || Reports::read(lines));
        let (pixels, size) = (child.stdin.take(), width as usize * height as usize * 3);
        Ok(Self { path: path.to_owned(), child, pixels, reports: Some(reports), size })
    }

    /// Adds a picture, row by row with red, green and blue of each pixel.
    ///
    /// # Errors
    /// [`VideoError`] of a picture of another size, and when ffmpeg cannot write, such as on a full disk.
    pub fn add(&mut self, rgb: &[u8]) -> Result<(), VideoError> {
        if rgb.len() != self.size {
            let why = format!("picture of {} bytes in a video of {} bytes a picture", rgb.len(), self.size);
            return Err(VideoError::failed(self.path.display(), why));
        }
        match self.pixels.as_mut().map(|pixels| pixels.write_all(rgb)) {
            Some(Ok(())) => Ok(()),
            Some(Err(why)) => {
                Err(self.end().err().unwrap_or_else(|| VideoError::failed(self.path.display(), why)))
            }
            None => Err(VideoError::failed(self.path.display(), "ffmpeg has ended")),
        }
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`VideoError`] when it cannot be written.
    pub fn finish(mut self) -> Result<(), VideoError> {
        self.end()
    }

    /// Waits for ffmpeg to complete the file.
    fn end(&mut self) -> Result<(), VideoError> {
        drop(self.pixels.take());
        let reports = self.reports.take().and_then(|reports| reports.join().ok()).unwrap_or_default();
        let status = self.child.wait().map_err(|why| VideoError::failed(self.path.display(), why))?;
        if status.success() {
            return Ok(());
        }
        let why = reports.first.unwrap_or_else(|| status.to_string());
        Err(VideoError::failed(self.path.display(), format!("the video cannot be written (ffmpeg: {why})")))
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Both fail only for a process that has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
