//! [`VideoFile`]: the frames of a video file, each one once.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use modulo_core::Frame;
use modulo_images::open_regular;

use crate::damage::Damage;
use crate::index::{FrameIndex, input};
use crate::listen::FrameInfo;
use crate::program::{COLOURS, Decoding, needed_version};
use crate::{Pixels, VideoError};

/// The frames of a video file, in the order of presentation.
pub struct VideoFile {
    path: PathBuf,
    version: String,
    index: FrameIndex,
    /// Number of the next frame, from 0.
    next: u64,
    decoding: Option<Decoding>,
    /// A frame that was decoded before its turn, since the one before it is missing.
    early: Option<Decoded>,
    /// Why there are no further frames.
    over: Option<String>,
    /// The number that is wanted first from this run of ffmpeg.
    begin: u64,
    /// The number of the next frame that ffmpeg gives, where nothing else tells it.
    upcoming: u64,
}

/// A frame that ffmpeg has given, with its number.
type Decoded = (u64, Frame, FrameInfo);

/// A frame of a video file.
#[derive(Clone, Debug, PartialEq)]
pub struct VideoFrame {
    /// Its pixels.
    pub pixels: Pixels,
    /// Number of the frame in the file, from 0.
    pub number: u64,
    /// Time of presentation in ns since the first frame; `None` in a container without times.
    pub time_ns: Option<u64>,
}

impl VideoFile {
    /// Opens the video at `path`, and lists its frames without decoding them.
    ///
    /// # Errors
    /// [`VideoError`] when ffmpeg is not there, and for a file that is no video, is empty, has no video stream, or is a playlist.
    pub fn open(path: &Path) -> Result<Self, VideoError> {
        let name = path.display();
        open_regular(path).map_err(|why| VideoError::failed(&name, why))?;
        if path.metadata().is_ok_and(|file| file.len() == 0) {
            return Err(VideoError::failed(&name, "is empty; a video is needed"));
        }
        let version = needed_version(&name)?;
        let index = FrameIndex::read(path).map_err(|why| VideoError::failed(&name, why))?;
        let path = path.to_owned();
        let (decoding, early, over) = (None, None, None);
        Ok(Self { path, version, index, next: 0, decoding, early, over, begin: 0, upcoming: 0 })
    }

    /// Returns the number of frames, those that are missing included.
    pub fn frames(&self) -> u64 {
        self.index.found + self.index.missing
    }

    /// Returns the mean rate of the frames in Hz; `None` in a container without times, and for less than two frames.
    pub fn rate(&self) -> Option<f64> {
        let last = self.index.found.checked_sub(1)?;
        let ns = self.index.stamp(last).filter(|ns| *ns > 0)?;
        Some(last as f64 * 1e9 / ns as f64)
    }

    /// Returns a line for each way in which the pixels may be other than those of other videos.
    pub fn warnings(&self) -> Vec<String> {
        let hdr = self.index.hdr.map(|hdr| {
            format!(
                "is an HDR video ({hdr}), whose codes are read like those of other videos, so that its bright parts are too dark; convert \
                 it to BT.709 first"
            )
        });
        let mosaic = self.index.is_mosaic.then(|| {
            "is a raw mosaic, which ffmpeg turns into colours; to sense it as the mosaic that it is, store it as grey (-pix_fmt gray12le, \
             for example), or as images of one channel"
                .to_owned()
        });
        [hdr, mosaic].into_iter().flatten().map(|line| format!("{}: {line}", self.path.display())).collect()
    }

    /// Resumes after the next `frames` frames. ffmpeg seeks to the next one where the container allows it, and otherwise decodes those
    /// before it.
    pub fn skip(&mut self, frames: u64) {
        self.next = self.next.saturating_add(frames).min(self.frames());
        (self.decoding, self.early) = (None, None);
    }

    /// Goes back to the first frame.
    pub fn rewind(&mut self) {
        (self.next, self.over) = (0, None);
        (self.decoding, self.early) = (None, None);
    }

    /// Returns the next frame; `None` at the end. A frame that is missing, damaged or cannot be decoded is an error, and the next call goes on behind
    /// it. An ffmpeg that was killed is started again.
    pub fn next_frame(&mut self) -> Option<Result<VideoFrame, VideoError>> {
        if self.next >= self.frames() {
            return None;
        }
        let decoded = match self.over {
            Some(_) => None,
            None => self.early.take().map_or_else(|| self.decode(), |early| Ok(Some(early))).transpose(),
        };
        let number = self.next;
        self.next += 1;
        let Some(decoded) = decoded else { return Some(Err(self.missing(number))) };
        Some(decoded.and_then(|(own, frame, info)| {
            if own > number {
                self.early = Some((own, frame, info));
                return Err(self.missing(number));
            }
            if info.is_damaged {
                let of = format!("frame {} of {}", number + 1, self.frames());
                let why = "is damaged, or is predicted from a damaged one, as ffmpeg reports";
                return Err(VideoError::failed(self.path.display(), format!("{of} {why}")));
            }
            let time_ns = info.pts_ns.and_then(|pts| self.index.stamp(number).or(pts.try_into().ok()));
            Ok(VideoFrame { pixels: Pixels { frame, bits: info.bits }, number, time_ns })
        }))
    }

    fn missing(&self, number: u64) -> VideoError {
        let cause = self.over.iter().chain(&self.index.reports.first).next();
        let cause = cause.map(|cause| format!(" ({cause})")).unwrap_or_default();
        let of = format!("frame {} of {}", number + 1, self.frames());
        VideoError::failed(self.path.display(), format!("{of} is missing or cannot be decoded{cause}"))
    }

    /// Decodes the next frame, or one behind it; `None` when there are no more.
    fn decode(&mut self) -> Result<Option<Decoded>, VideoError> {
        loop {
            let mut decoding = self.decoding.take().map_or_else(|| self.start(), Ok)?;
            match decoding.next() {
                Ok(Some((frame, info))) => {
                    let number = self.index.number(info).unwrap_or(self.upcoming);
                    let is_first = self.begin > 0 && self.upcoming == self.begin;
                    self.upcoming = number + 1;
                    // The seek went too far, as in a file whose index is wrong.
                    if is_first && number > self.next && self.index.seek_from.take().is_some() {
                        continue;
                    }
                    self.decoding = Some(decoding);
                    // Those before it were skipped, or come too late.
                    if number >= self.next {
                        return Ok(Some((number, frame, info)));
                    }
                }
                ended => {
                    let (reports, signal) = decoding.end();
                    // A process that was killed before its first frame would be killed again.
                    if signal.is_some() && self.begin < self.next {
                        tracing::warn!("{}: ffmpeg was killed, and is started again", self.path.display());
                        continue;
                    }
                    let why = ended.err().map(|why| why.to_string());
                    self.over =
                        Some(reports.first.or(why).unwrap_or_else(|| "the video ends before it".to_owned()));
                    return Ok(None);
                }
            }
        }
    }

    /// Starts ffmpeg at the next frame where the container allows it, or else at the first one.
    fn start(&mut self) -> Result<Decoding, VideoError> {
        let mut options = vec![OsString::from("-copyts")];
        let seek = self.index.seek_to(self.next);
        self.begin = self.next;
        self.upcoming = if seek.is_some() { self.next } else { 0 };
        let (packets, has_begun) = match seek {
            Some(seconds) => {
                options.extend(["-ss".into(), seconds.into()]);
                ([].into(), true)
            }
            None => (self.index.packets.clone(), self.index.begins_with_key),
        };
        let damage = Damage::new(packets, &self.version, has_begun);
        // Made grey by ffmpeg, codes keep their values; as three colours, most of them are off by one.
        let formats = if self.index.is_grey { "gray|gray16be" } else { COLOURS };
        let options = [options, input(&self.path)].concat();
        Decoding::start(&options, formats, &self.version, damage)
            .map_err(|why| VideoError::failed(self.path.display(), why))
    }
}
