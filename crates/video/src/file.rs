//! [`VideoFile`]: the frames of a video file, each one once.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use modulo_core::Frame;
use modulo_images::open_regular;

use crate::program::{COLOURS, Decoding, FrameInfo, Reports, TimeBase, command, needed_version};
use crate::{Pixels, VideoError};

/// The containers of video files. Playlists, lists of images and whatever else names other files are none of them.
const FORMATS: &str =
    "mov,matroska,avi,flv,asf,mpegts,mpeg,mpegvideo,m4v,ogg,ivf,h264,hevc,mjpeg,yuv4mpegpipe,nut,mxf";
/// Containers in which a seek ends exactly at the wanted time.
const SEEKABLE: [&str; 2] = ["mov", "matroska"];

/// The frames of a video file, in the order of presentation.
pub struct VideoFile {
    path: PathBuf,
    version: String,
    index: FrameIndex,
    /// Number of the next frame, from 0.
    next: u64,
    decoding: Option<Decoding>,
    /// A frame that was decoded before its turn, since the one before it is missing.
    early: Option<(Frame, FrameInfo)>,
    /// Why there are no further frames.
    over: Option<String>,
    /// The number of the first frame that this run of ffmpeg gives.
    begin: u64,
}

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

/// The frames that a container lists.
#[derive(Clone, Debug, Default, PartialEq)]
struct FrameIndex {
    /// Times of presentation in ns on the time base of the container, ascending; empty if a frame has none.
    times: Vec<i64>,
    /// Frames that are there.
    found: u64,
    /// Frames that the header promises, or that broke off at the end of the file, and are not there.
    missing: u64,
    /// The time of the container at which a seek begins to count, ns; `None` where a seek is not exact.
    seek_from: Option<i64>,
    reports: Reports,
    /// The transfer function of an HDR video.
    hdr: Option<&'static str>,
    /// Whether the samples are grey over their full range.
    is_grey: bool,
    /// Whether the samples are a colour mosaic.
    is_mosaic: bool,
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
        Ok(Self { path, version, index, next: 0, decoding: None, early: None, over: None, begin: 0 })
    }

    /// Returns the number of frames, those that are missing included.
    pub fn frames(&self) -> u64 {
        self.index.found + self.index.missing
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

    /// Goes on behind the next `frames` frames. ffmpeg seeks to the next one where the container allows it, and otherwise decodes those
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
        Some(decoded.and_then(|(frame, info)| {
            if self.index.is_behind(number, info) {
                self.early = Some((frame, info));
                return Err(self.missing(number));
            }
            if info.is_damaged {
                let of = format!("frame {} of {}", number + 1, self.frames());
                let why = "is damaged, or is predicted from a damaged one, as ffmpeg reports";
                return Err(VideoError::failed(self.path.display(), format!("{of} {why}")));
            }
            let since = |pts: i64| {
                u64::try_from(pts.saturating_sub(self.index.times.first().copied().unwrap_or(0))).ok()
            };
            let pixels = Pixels { frame, bits: info.bits };
            Ok(VideoFrame { pixels, number, time_ns: info.pts_ns.and_then(since) })
        }))
    }

    fn missing(&self, number: u64) -> VideoError {
        let cause = self.over.iter().chain(&self.index.reports.first).next();
        let cause = cause.map(|cause| format!(" ({cause})")).unwrap_or_default();
        let of = format!("frame {} of {}", number + 1, self.frames());
        VideoError::failed(self.path.display(), format!("{of} is missing or cannot be decoded{cause}"))
    }

    /// Decodes the next frame; `None` when there are no more.
    fn decode(&mut self) -> Result<Option<(Frame, FrameInfo)>, VideoError> {
        loop {
            let mut decoding = self.decoding.take().map_or_else(|| self.start(), Ok)?;
            let is_first = self.begin == self.next;
            match decoding.next() {
                Ok(Some((_, info))) if is_first && self.next > 0 && self.index.is_behind(self.next, info) => {
                    // The seek went too far, as in a file whose index is wrong.
                    if self.index.seek_from.take().is_none() {
                        self.decoding = Some(decoding);
                        return Ok(None);
                    }
                }
                Ok(Some(frame)) => {
                    self.decoding = Some(decoding);
                    return Ok(Some(frame));
                }
                ended => {
                    let (reports, signal) = decoding.end();
                    // A process that was killed before its first frame would be killed again.
                    if signal.is_some() && !is_first {
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

    /// Starts ffmpeg at the next frame.
    fn start(&mut self) -> Result<Decoding, VideoError> {
        self.begin = self.next;
        let (mut options, mut first) = (vec![OsString::from("-copyts")], "null".to_owned());
        match self.index.seek_to(self.next) {
            _ if self.next == 0 => {}
            Some(seconds) => options.extend(["-ss".into(), seconds.into()]),
            None => first = format!(r"select=gte(n\,{})", self.next),
        }
        // Made grey by ffmpeg, codes keep their values; as three colours, most of them are off by one.
        let formats = if self.index.is_grey { "gray|gray16be" } else { COLOURS };
        let filters = [&first, formats];
        let started = Decoding::start(&[options, input(&self.path)].concat(), filters, &self.version, 2);
        started.map_err(|why| VideoError::failed(self.path.display(), why))
    }
}

/// Returns the options of ffmpeg that name this file.
fn input(path: &Path) -> Vec<OsString> {
    // With the protocol, no part of the name is taken for one.
    let mut name = OsString::from("file:");
    name.push(path);
    let options = ["-protocol_whitelist", "file", "-format_whitelist", FORMATS, "-i"].map(OsString::from);
    options.into_iter().chain([name]).collect()
}

/// Returns the value of `key` in a line of ffprobe, such as `stream|pix_fmt=gray`.
fn value(line: &str, key: &str) -> Option<String> {
    let found = line.split('|').find_map(|field| field.strip_prefix(key)?.strip_prefix('='));
    found.filter(|value| *value != "N/A").map(str::to_owned)
}

impl FrameIndex {
    /// Lists the frames of the video at `path`. An error is a reason.
    fn read(path: &Path) -> Result<Self, String> {
        let output = command("ffprobe")
            .args(["-loglevel", "level+error", "-select_streams", "V:0", "-of", "compact", "-show_entries"])
            .arg("stream=nb_frames,time_base,color_transfer,color_range,pix_fmt:format=format_name,start_time:packet=pts,flags")
            .args(input(path))
            .output()
            .map_err(|why| format!("ffprobe: {why}"))?;
        let (reports, text) = (Reports::read(&*output.stderr), String::from_utf8_lossy(&output.stderr));
        if !output.status.success() {
            return Err(match reports.first {
                _ if text.contains("not on whitelist") => format!(
                    "is a playlist, which may name other files, or another form that is not read; possible are {FORMATS}"
                ),
                Some(reports) => format!("is no video, or is truncated (ffprobe: {reports})"),
                None => format!("is no video (ffprobe: {})", output.status),
            });
        }
        Self::parse(&String::from_utf8_lossy(&output.stdout), reports)
    }

    /// Reads the `compact` output of ffprobe.
    fn parse(text: &str, reports: Reports) -> Result<Self, String> {
        let of = |section: &'static str| text.lines().filter(move |line| line.starts_with(section));
        let stream = of("stream|").next().ok_or("has no video stream, only sound or other data")?;
        let base = value(stream, "time_base").and_then(|base| TimeBase::parse(&base));
        let base = base.ok_or("has a video stream without a time base")?;
        let packets = of("packet|").count() as u64;
        // Packets with D are decoded for others and not shown, as an edit list has it.
        let shown: Vec<_> =
            of("packet|").filter(|line| !value(line, "flags").is_some_and(|f| f.contains('D'))).collect();
        let times: Option<Vec<i64>> =
            shown.iter().map(|line| value(line, "pts")?.parse().ok().and_then(|pts| base.ns(pts))).collect();
        let mut times = times.unwrap_or_default();
        times.sort_unstable();
        let format = of("format|").next().unwrap_or_default();
        let name = value(format, "format_name").unwrap_or_default();
        let promised =
            value(stream, "nb_frames").and_then(|n| n.parse().ok()).filter(|_| name.starts_with("mov"));
        let breaks_off = reports.first.as_ref().is_some_and(|reports| reports.contains("ended prematurely"));
        let missing =
            promised.map_or(u64::from(breaks_off), |promised: u64| promised.saturating_sub(packets));
        let found = shown.len() as u64;
        if found + missing == 0 {
            return Err("has a video stream without a frame".to_owned());
        }
        let start = value(format, "start_time").and_then(|start| start.parse::<f64>().ok());
        let is_seekable = SEEKABLE.iter().any(|seekable| name.starts_with(seekable)) && !times.is_empty();
        let seek_from = start.filter(|_| is_seekable).map(|start| (start * 1e9).round() as i64);
        Ok(Self { times, found, missing, seek_from, reports, ..Self::of_pixels(stream) })
    }

    /// Returns what the line of a stream says about its pixels.
    fn of_pixels(stream: &str) -> Self {
        let hdr = match value(stream, "color_transfer").as_deref() {
            Some("smpte2084") => Some("PQ"),
            Some("arib-std-b67") => Some("HLG"),
            _ => None,
        };
        let pixels = value(stream, "pix_fmt").unwrap_or_default();
        // Those of a restricted range are spread by ffmpeg only where it makes colours.
        let is_grey =
            pixels.starts_with("gray") && value(stream, "color_range").is_none_or(|range| range != "tv");
        Self { hdr, is_grey, is_mosaic: pixels.starts_with("bayer"), ..Self::default() }
    }

    /// Returns whether a decoded frame comes later than that of this number.
    fn is_behind(&self, number: u64, info: FrameInfo) -> bool {
        let at = |number: u64| self.times.get(usize::try_from(number).ok()?).copied();
        match (info.pts_ns, at(number), at(number + 1)) {
            (Some(pts), Some(own), Some(next)) => pts > own.saturating_add(next.saturating_sub(own) / 2),
            _ => false,
        }
    }

    /// Returns the time, in seconds, to which a seek begins with the frame of this number: between it and the one before.
    fn seek_to(&self, number: u64) -> Option<String> {
        let number = usize::try_from(number).ok()?;
        let (from, before, own) =
            (self.seek_from?, self.times.get(number.checked_sub(1)?)?, self.times.get(number)?);
        let microseconds = before.saturating_add(own.saturating_sub(*before) / 2).saturating_sub(from) / 1000;
        // Frames of one time cannot be told apart by it.
        (own > before && microseconds > 0).then(|| format!("{microseconds}us"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(text: &str) -> Result<FrameIndex, String> {
        FrameIndex::parse(text, Reports::default())
    }

    #[test]
    fn the_frames_of_a_container_are_listed_by_their_times() {
        let text = "packet|pts=512|flags=K_\npacket|pts=1536|flags=__\npacket|pts=1024|flags=__\npacket|pts=0|flags=_D\n\
                    stream|time_base=1/10240|nb_frames=6\nformat|format_name=mov,mp4|start_time=0.050000\n";
        let index = index(text).expect("frames");
        assert_eq!(index.times, [50_000_000, 100_000_000, 150_000_000]);
        assert_eq!((index.found, index.missing), (3, 2), "six were promised, one of four is not shown");
        assert_eq!(index.seek_to(2).as_deref(), Some("75000us"));
        let at = |ms: i64| FrameInfo { pts_ns: Some(ms * 1_000_000), bits: 8, is_damaged: false };
        assert!(index.is_behind(0, at(100)) && !index.is_behind(0, at(51)) && !index.is_behind(2, at(900)));
    }

    #[test]
    fn what_has_no_frames_says_so() {
        for (text, reports) in [
            ("format|format_name=mov,mp4|start_time=0\n", "no video stream"),
            ("stream|time_base=1/10|nb_frames=N/A\nformat|format_name=avi\n", "without a frame"),
            ("stream|time_base=0/0\n", "time base"),
        ] {
            let why = index(text).expect_err("no frame");
            assert!(why.contains(reports), "{why}");
        }
    }
}
