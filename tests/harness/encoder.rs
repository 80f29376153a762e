//! Videos for tests, which ffmpeg writes.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// Colours as players read them, and half of the colour samples in each direction, as encoders need them.
const FILTERS: &str = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";
const COLOURS: &str = "-color_primaries bt709 -color_trc bt709 -colorspace bt709";

/// Writes pictures of `width` x `height` px, row by row with red, green and blue of each pixel, as a video of 10 Hz.
///
/// # Panics
/// When ffmpeg does not write it.
pub fn write_video(
    path: &Path,
    (width, height): (usize, usize),
    pictures: impl IntoIterator<Item = Vec<u8>>,
) {
    let size = format!("{width}x{height}");
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-y", "-v", "error", "-f", "rawvideo", "-pixel_format", "rgb24", "-framerate", "10"])
        .args(["-video_size", &size, "-i", "pipe:0", "-vf", FILTERS])
        .args(COLOURS.split(' '))
        .arg(path)
        .stdin(Stdio::piped())
        .spawn()
        .expect("ffmpeg");
    let mut pixels = ffmpeg.stdin.take().expect("piped");
    pictures.into_iter().for_each(|picture| pixels.write_all(&picture).expect("written"));
    drop(pixels);
    assert!(ffmpeg.wait().expect("it ends").success(), "{}", path.display());
}
