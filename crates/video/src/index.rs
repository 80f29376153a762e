//! [`FrameIndex`]: the packets that a container lists, and the frames that they become.

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

use crate::damage::Packet;
use crate::listen::FrameInfo;
use crate::program::{Reports, TimeBase, command};

/// The containers of video files. Playlists, lists of images and whatever else names other files are none of them.
const FORMATS: &str = "mov,matroska,avi,flv,asf,mpegts,mpeg,mpegvideo,m4v,ogg,ivf,h264,hevc,mjpeg,jpeg_pipe,yuv4mpegpipe,nut,mxf";
/// Containers whose reader reports no errors but those of a damaged file.
const PLAIN: [&str; 2] = ["[matroska", "[flv"];
/// Containers in which a seek ends exactly at the wanted time.
const SEEKABLE: [&str; 2] = ["mov", "matroska"];

/// The frames that a container lists.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FrameIndex {
    /// The packets in the order of decoding.
    pub packets: Arc<[Packet]>,
    /// Whether the first one is a key frame, from which all others may be predicted.
    pub begins_with_key: bool,
    /// The number of the frame of each packet, in the order of presentation; `None` for one that an edit list hides. Empty if one has no time.
    numbers: Vec<Option<u64>>,
    /// Times of presentation in ns on the time base of the container, by number.
    times: Vec<i64>,
    /// Times of presentation in ns since the first frame, by number, which rise.
    stamps: Vec<u64>,
    /// Frames that are there.
    pub found: u64,
    /// Frames that the header promises, or that broke off at the end of the file, and are not there.
    pub missing: u64,
    /// The time of the container at which a seek begins to count, ns; `None` where a seek is not exact.
    pub seek_from: Option<i64>,
    pub reports: Reports,
    /// The transfer function of an HDR video.
    pub hdr: Option<&'static str>,
    /// Whether the samples are grey over their full range.
    pub is_grey: bool,
    /// Whether the samples are a colour mosaic.
    pub is_mosaic: bool,
}

impl Packet {
    fn of(line: &str) -> Self {
        let number = |key| value(line, key).and_then(|number| number.parse::<i64>().ok());
        let flags = value(line, "flags").unwrap_or_default();
        Self {
            pts: number("pts"),
            dts: number("dts"),
            pos: number("pos"),
            duration: number("duration").filter(|duration| *duration > 0),
            is_key: flags.contains('K'),
            is_hidden: flags.contains('D'),
            ..Self::default()
        }
    }

    /// Returns whether another recording begins with this packet behind `last`, as in files that were joined: time goes back, or jumps
    /// on at a key frame.
    fn joins(&self, last: &Self, base: TimeBase) -> bool {
        const SECOND_NS: i64 = 1_000_000_000;
        let step = self.dts.zip(last.dts).map(|(own, last)| own.saturating_sub(last));
        let Some(step) = step else { return false };
        let far = last.duration.map_or(i64::MAX, |duration| duration.saturating_mul(4));
        if self.is_key { step < 0 || step > far } else { base.ns(step).is_none_or(|step| step < -SECOND_NS) }
    }
}

/// Returns the options of ffmpeg that name this file.
pub(crate) fn input(path: &Path) -> Vec<OsString> {
    // With the protocol, no part of the name is taken for one.
    let mut name = OsString::from("file:");
    name.push(path);
    let options = ["-protocol_whitelist", "file", "-format_whitelist", FORMATS, "-i"].map(OsString::from);
    options.into_iter().chain([name]).collect()
}

/// Returns the value of `key` in a line of ffprobe, such as `stream|pix_fmt=gray`.
fn value<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    let found = line.split('|').find_map(|field| field.strip_prefix(key)?.strip_prefix('='));
    found.filter(|value| *value != "N/A")
}

/// Returns whether the last packet is cut, by the line of the container, and its decoder does not report that.
fn is_cut(codec: Option<&str>, format: &str) -> bool {
    // The sizes of a packet of MPEG-TS, those of Blu-ray and of broadcasts with checksums.
    const PACKETS: [u64; 3] = [188, 192, 204];
    let size = value(format, "size").and_then(|size| size.parse::<u64>().ok());
    let is_ts = value(format, "format_name") == Some("mpegts") && codec == Some("hevc");
    is_ts && size.is_some_and(|size| PACKETS.iter().all(|packet| size % packet != 0))
}

impl FrameIndex {
    /// Lists the frames of the video at `path`. An error is a reason.
    pub fn read(path: &Path) -> Result<Self, String> {
        let output = command("ffprobe")
            .args(["-loglevel", "level+error", "-select_streams", "V:0", "-of", "compact", "-show_entries"])
            .arg(
                "stream=codec_name,nb_frames,time_base,color_transfer,color_range,pix_fmt:format=format_name,start_time,size:\
                 packet=pts,dts,duration,pos,flags",
            )
            .args(input(path))
            .output()
            .map_err(|why| format!("ffprobe: {why}"))?;
        let (reports, errors) = (Reports::read(&*output.stderr), String::from_utf8_lossy(&output.stderr));
        if !output.status.success() {
            return Err(match reports.first {
                _ if reports.is_refused && reports.is_picture() => {
                    "is no video but a picture or an animation of pictures; convert it to PNG, and give that without 'video:'".to_owned()
                }
                _ if reports.is_refused => format!(
                    "is a playlist, which may name other files, or another form that is not read; possible are {FORMATS}"
                ),
                Some(reports) => format!("is no video, or is truncated (ffprobe: {reports})"),
                None => format!("is no video (ffprobe: {})", output.status),
            });
        }
        let breaks_off = errors.lines().any(|line| PLAIN.iter().any(|name| line.starts_with(name)));
        Self::parse(&String::from_utf8_lossy(&output.stdout), reports, breaks_off)
    }

    /// Reads the `compact` output of ffprobe. A file that `breaks_off` has lost a frame at least.
    fn parse(text: &str, reports: Reports, breaks_off: bool) -> Result<Self, String> {
        let of = |section: &'static str| text.lines().filter(move |line| line.starts_with(section));
        let stream = of("stream|").next().ok_or("has no video stream, only sound or other data")?;
        let base = value(stream, "time_base").and_then(TimeBase::parse);
        let base = base.ok_or("has a video stream without a time base")?;
        let mut listed: Vec<_> = of("packet|").map(Packet::of).collect();
        for at in 1..listed.len() {
            listed[at].is_joint = listed[at].joins(&listed[at - 1], base);
        }
        let format = of("format|").next().unwrap_or_default();
        let name = value(format, "format_name").unwrap_or_default();
        let promised =
            value(stream, "nb_frames").and_then(|n| n.parse().ok()).filter(|_| name.starts_with("mov"));
        if let Some(last) = listed.last_mut() {
            last.is_cut = is_cut(value(stream, "codec_name"), format);
        }
        let missing = promised
            .map_or(u64::from(breaks_off), |promised: u64| promised.saturating_sub(listed.len() as u64));
        let found = listed.iter().filter(|packet| !packet.is_hidden).count() as u64;
        if found + missing == 0 {
            return Err("has a video stream without a frame".to_owned());
        }
        let begins_with_key = listed.first().is_some_and(|first| first.is_key);
        let index = Self { begins_with_key, found, missing, reports, ..Self::of_pixels(stream) };
        let index = index.with_order(&listed, base);
        let start = value(format, "start_time").and_then(|start| start.parse::<f64>().ok());
        let is_seekable =
            SEEKABLE.iter().any(|seekable| name.starts_with(seekable)) && index.is_told_by_time();
        let seek_from = start.filter(|_| is_seekable).map(|start| (start * 1e9).round() as i64);
        Ok(Self { seek_from, packets: listed.into(), ..index })
    }

    /// Orders the frames by their times of presentation, but those of each of several joined recordings behind those of the one before.
    fn with_order(mut self, listed: &[Packet], base: TimeBase) -> Self {
        let time = |(place, packet): (usize, &Packet)| Some((place, base.ns(packet.pts?)?));
        let Some(mut timed) = listed.iter().enumerate().map(time).collect::<Option<Vec<_>>>() else {
            return self;
        };
        self.numbers = vec![None; listed.len()];
        let (mut offset, mut last, mut end) = (None, -1, 0);
        for recording in timed.chunk_by_mut(|_, (next, _)| !listed[*next].is_joint) {
            recording.sort_by_key(|(_, time)| *time);
            let shown = || recording.iter().filter(|(place, _)| !listed[*place].is_hidden);
            let start = shown().next().map_or(0, |(_, time)| *time);
            // Times that begin anew go on behind those of the recording before.
            let goes_on = |offset: &i64| start.saturating_add(*offset) >= end;
            let shift = *offset.insert(offset.filter(goes_on).unwrap_or(end.saturating_sub(start)));
            for (place, time) in shown() {
                self.numbers[*place] = Some(self.times.len() as u64);
                self.times.push(*time);
                last = time.saturating_add(shift).max(last + 1);
                self.stamps.push(last as u64);
                let duration = listed[*place].duration.and_then(|duration| base.ns(duration));
                end = last.saturating_add(duration.unwrap_or(1));
            }
        }
        self
    }

    /// Returns what the line of a stream says about its pixels.
    fn of_pixels(stream: &str) -> Self {
        let hdr = match value(stream, "color_transfer") {
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

    /// Returns whether each frame has a time of its own.
    fn is_told_by_time(&self) -> bool {
        !self.times.is_empty() && self.times.windows(2).all(|pair| pair[0] < pair[1])
    }

    /// Returns the number of a decoded frame, if it can be told.
    pub fn number(&self, info: FrameInfo) -> Option<u64> {
        let Some(pts) = info.pts_ns.filter(|_| self.is_told_by_time()) else {
            return *self.numbers.get(usize::try_from(info.packet?).ok()?)?;
        };
        // Any error of rounding is less than half of the time to the next frame.
        let behind = self.times.partition_point(|time| *time < pts);
        let near = [behind.checked_sub(1), Some(behind)].into_iter().flatten();
        let near = near.filter_map(|at| Some((self.times.get(at)?.abs_diff(pts), at as u64)));
        near.min().map(|(_, number)| number)
    }

    /// Returns the stamp of the frame of this number, ns since the first one.
    pub fn stamp(&self, number: u64) -> Option<u64> {
        self.stamps.get(usize::try_from(number).ok()?).copied()
    }

    /// Returns the time, in seconds, to which a seek begins with the frame of this number: between it and the one before.
    pub fn seek_to(&self, number: u64) -> Option<String> {
        let number = usize::try_from(number).ok()?;
        let (from, before, own) =
            (self.seek_from?, self.times.get(number.checked_sub(1)?)?, self.times.get(number)?);
        let microseconds = before.saturating_add(own.saturating_sub(*before) / 2).saturating_sub(from) / 1000;
        (microseconds > 0).then(|| format!("{microseconds}us"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(text: &str) -> Result<FrameIndex, String> {
        FrameIndex::parse(text, Reports::default(), false)
    }

    #[test]
    fn the_frames_of_a_container_are_listed_by_their_times() {
        let text = "packet|pts=512|flags=K_\npacket|pts=1536|flags=__\npacket|pts=1024|flags=__\npacket|pts=0|flags=_D\n\
                    stream|time_base=1/10240|nb_frames=6\nformat|format_name=mov,mp4|start_time=0.050000\n";
        let index = index(text).expect("frames");
        assert_eq!(index.times, [50_000_000, 100_000_000, 150_000_000]);
        assert_eq!((index.found, index.missing), (3, 2), "six were promised, one of four is not shown");
        assert_eq!(index.seek_to(2).as_deref(), Some("75000us"));
        let at = |ms: i64| index.number(FrameInfo { pts_ns: Some(ms * 1_000_000), ..FrameInfo::default() });
        assert_eq!([49, 51, 100, 900].map(at), [0, 0, 1, 2].map(Some));
        assert_eq!(index.stamp(1), Some(50_000_000));
    }

    #[test]
    fn joined_recordings_keep_their_order_and_their_stamps_rise() {
        let recording = "packet|pts=3600|dts=0|duration=3600|flags=K_\npacket|pts=10800|dts=3600|duration=3600|flags=__\n\
                         packet|pts=7200|dts=7200|duration=3600|flags=__\n";
        // Frames of one time, and a step on of ten frames at a key frame.
        let repeated = "packet|pts=14400|dts=10800|duration=3600|flags=K_\npacket|pts=14400|dts=14400|duration=3600|flags=__\n";
        let later = "packet|pts=54000|dts=50400|duration=3600|flags=K_\n";
        let text = format!(
            "{recording}{recording}{repeated}{later}stream|time_base=1/90000\nformat|format_name=mpegts\n"
        );
        let index = index(&text).expect("frames");
        let joints: Vec<_> = index.packets.iter().map(|packet| packet.is_joint).collect();
        assert_eq!(joints, [false, false, false, true, false, false, false, false, true]);
        let number = |packet| index.number(FrameInfo { packet: Some(packet), ..FrameInfo::default() });
        assert_eq!(
            [0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(number),
            [Some(0), Some(2), Some(1), Some(3), Some(5), Some(4), Some(6), Some(7), Some(8), None]
        );
        let milliseconds: Vec<_> = index.stamps.iter().map(|stamp| stamp / 1_000_000).collect();
        assert_eq!(milliseconds, [0, 40, 80, 120, 160, 200, 240, 240, 680]);
        assert!(index.stamps.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(index.seek_to(4), None);
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
