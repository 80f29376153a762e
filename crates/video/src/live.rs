//! [`LiveVideo`]: the newest frame of a camera or a stream.

use std::process::Child;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_core::Frame;
use modulo_runtime::Clock;

use crate::address::LIVE_FORMATS;
use crate::damage::Damage;
use crate::listen::FrameInfo;
use crate::program::{COLOURS, Decoding, Reports, kill, needed_version};
use crate::{LiveAddress, Pixels, VideoError};

/// The pause before the second connection, which doubles up to the longest one with each that brings no frame.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const LONGEST_PAUSE: Duration = Duration::from_secs(4);
/// A connection is given up after this time without a frame, ns.
const SILENCE_NS: u64 = 8_000_000_000;
/// A connection whose frames come this much later than its fastest one is given up, with the frames that wait in it, ns.
const LATEST_NS: i64 = 1_500_000_000;
/// The fastest frame is found anew in this time, since the clocks of camera and machine drift apart, ns.
const DRIFT_NS: u64 = 600_000_000_000;
/// Options of ffmpeg that keep no frame back: it waits for no other frame, and little is read before the first one.
const PROMPT: &str =
    "-fflags nobuffer -flags low_delay -probesize 1000000 -analyzeduration 500000 -fpsprobesize 0";

/// A live camera. Its frames are read on a thread of its own, and each one replaces the one before.
pub struct LiveVideo {
    shared: Arc<Shared>,
    reader: Option<JoinHandle<()>>,
}

/// A frame of a live camera.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveFrame {
    /// Its pixels.
    pub pixels: Pixels,
    /// Time of its arrival, ns since the epoch.
    pub stamp_ns: u64,
}

/// The counts of a live camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounts {
    /// Frames that have arrived.
    pub arrived: u64,
    /// Frames that a newer one replaced before they were taken.
    pub replaced: u64,
    /// Connections that brought a frame.
    pub connections: u64,
}

struct Shared {
    clock: Arc<dyn Clock>,
    address: LiveAddress,
    version: String,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    newest: Option<Result<LiveFrame, VideoError>>,
    counts: LiveCounts,
    /// The ffmpeg of this connection, and the ticks of its last frame or its start.
    child: Option<(Arc<Mutex<Child>>, u64)>,
    ends: bool,
}

impl LiveVideo {
    /// Starts to read the camera at `address`. One that does not answer is tried again without an end.
    ///
    /// # Errors
    /// [`VideoError`] when ffmpeg is not there, and for a device that does not exist.
    pub fn open(address: LiveAddress, clock: Arc<dyn Clock>) -> Result<Self, VideoError> {
        if let Some(device) = address.device()
            && !device.exists()
        {
            return Err(VideoError::failed(&address, format!("no such device; there are {}", devices())));
        }
        let version = needed_version(&address)?;
        let shared = Shared { clock, address, version, state: Mutex::default(), changed: Condvar::new() };
        let shared = Arc::new(shared);
        let of_thread = shared.clone();
        Ok(Self { shared, reader: Some(std::thread::spawn(move || of_thread.read())) })
    }

    /// Returns the newest frame that was not returned before, and waits up to `patience` for it. The error is a damaged frame.
    pub fn newest(&self, patience: Duration) -> Option<Result<LiveFrame, VideoError>> {
        let state = self.shared.state();
        let waits = |state: &mut State| state.newest.is_none();
        let waited = self.shared.changed.wait_timeout_while(state, patience, waits);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.newest.is_none() {
            // Neither ffmpeg nor a read of a pipe ends by itself when a camera is silent.
            let now = self.shared.clock.ticks_ns();
            let silent = state.child.as_ref().filter(|(_, sign)| now.saturating_sub(*sign) > SILENCE_NS);
            let silent = silent.map(|(child, _)| child.clone());
            if let Some(child) = silent {
                tracing::warn!("{}: no frame for {} s", self.shared.address, SILENCE_NS / 1_000_000_000);
                state.child = None;
                drop(state);
                kill(&child);
                return None;
            }
        }
        state.newest.take()
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> LiveCounts {
        self.shared.state().counts
    }
}

impl Drop for LiveVideo {
    fn drop(&mut self) {
        let mut state = self.shared.state();
        state.ends = true;
        let child = state.child.take();
        drop(state);
        self.shared.changed.notify_all();
        if let Some((child, _)) = child {
            kill(&child);
        }
        // The thread has nothing to return, and a panic in it was printed.
        let _ = self.reader.take().map(JoinHandle::join);
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads frames of one connection after the other until the video is dropped.
    fn read(&self) {
        let mut pause = FIRST_PAUSE;
        loop {
            let (frames, why) = self.read_connection();
            if frames > 0 {
                pause = FIRST_PAUSE;
            }
            let state = self.state();
            if state.ends {
                return;
            }
            tracing::warn!("{}: {why}; trying again in {} ms", self.address, pause.as_millis());
            // A frame that is taken meanwhile wakes nobody here.
            let waited = self.changed.wait_timeout_while(state, pause, |state| !state.ends);
            if waited.unwrap_or_else(PoisonError::into_inner).0.ends {
                return;
            }
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
    }

    /// Reads frames until the connection ends. Returns their number and the reason of the end.
    fn read_connection(&self) -> (u64, String) {
        let options = PROMPT.split(' ').map(str::to_owned).chain(self.address.input());
        let (options, damage) = (options.collect::<Vec<_>>(), Damage::new([].into(), &self.version, false));
        let mut decoding = match Decoding::start(&options, COLOURS, &self.version, damage) {
            Ok(decoding) => decoding,
            Err(why) => return (0, format!("ffmpeg cannot be started: {why}")),
        };
        let mut state = self.state();
        if state.ends {
            return (0, String::new());
        }
        state.child = Some((decoding.child.clone(), self.clock.ticks_ns()));
        drop(state);
        let (mut frames, mut lateness, mut whole) = (0, Lateness::default(), self.clock.ticks_ns());
        while let Ok(Some((frame, info))) = decoding.next() {
            let ticks = self.clock.ticks_ns();
            let late = info.pts_ns.map_or(0, |pts| lateness.of(ticks, pts));
            if late > LATEST_NS {
                let ms = late / 1_000_000;
                let why = "late, as from a machine with too much to do, and are left out";
                return (frames, format!("frames come {ms} ms {why}"));
            }
            frames += 1;
            if !info.is_damaged {
                whole = ticks;
            } else if ticks.saturating_sub(whole) > SILENCE_NS {
                return (frames, "all frames are damaged".to_owned());
            }
            self.put(self.stamped(frame, info), ticks, frames == 1);
        }
        let (reported, signal) = decoding.end();
        let why = if signal.is_some() { "ffmpeg was killed".to_owned() } else { end_of(reported, frames) };
        (frames, why)
    }

    /// Returns a frame with its stamp; the error is a damaged one.
    fn stamped(&self, frame: Frame, info: FrameInfo) -> Result<LiveFrame, VideoError> {
        if info.is_damaged {
            let why = "a frame is damaged, or is predicted from a damaged one";
            return Err(VideoError::failed(&self.address, why));
        }
        Ok(LiveFrame { pixels: Pixels { frame, bits: info.bits }, stamp_ns: self.clock.now_ns() })
    }

    fn put(&self, frame: Result<LiveFrame, VideoError>, ticks: u64, is_first: bool) {
        let mut state = self.state();
        state.counts.arrived += 1;
        state.counts.connections += u64::from(is_first);
        state.counts.replaced += u64::from(state.newest.replace(frame).is_some());
        if let Some((_, sign)) = &mut state.child {
            *sign = ticks;
        }
        drop(state);
        self.changed.notify_all();
    }
}

/// Returns why a stream of so many frames has ended, by what ffmpeg has reported.
fn end_of(reported: Reports, frames: u64) -> String {
    const STILL: &str = "is a still picture, not a stream; give the address of the video of the camera, such as one of RTSP or of motion \
                         JPEG";
    match reported.first {
        _ if frames <= 1 && reported.is_picture() => STILL.to_owned(),
        _ if reported.is_refused => {
            format!("is a playlist or another form that is not read; possible are {LIVE_FORMATS}")
        }
        why => why.unwrap_or_else(|| "the stream has ended".to_owned()),
    }
}

/// How late frames come, beside the fastest one.
#[derive(Default)]
struct Lateness {
    /// The least difference of arrival and presentation, ns, in the present span of time and in the one before.
    least: [Option<i64>; 2],
    /// Begin of the present span, ticks.
    since: u64,
}

impl Lateness {
    /// Returns by how many ns a frame is later than the fastest one, if it came at `ticks` and is presented at `pts`.
    fn of(&mut self, ticks: u64, pts: i64) -> i64 {
        if ticks.saturating_sub(self.since) > DRIFT_NS {
            self.least = [None, self.least[0]];
            self.since = ticks;
        }
        let delay = i64::try_from(ticks).unwrap_or(i64::MAX).saturating_sub(pts);
        self.least[0] = Some(self.least[0].map_or(delay, |least| least.min(delay)));
        delay.saturating_sub(self.least.into_iter().flatten().min().unwrap_or(delay))
    }
}

/// Returns the video devices of this machine.
fn devices() -> String {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten().map(|entry| entry.path());
    let videos = entries.map(|path| path.display().to_string()).filter(|path| path.starts_with("/dev/video"));
    let mut videos: Vec<_> = videos.collect();
    videos.sort();
    if videos.is_empty() { "none".to_owned() } else { videos.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_still_picture_is_named() {
        let end = |lines: &str, frames| end_of(Reports::read(lines.as_bytes()), frames);
        let refused = |name: &str| {
            format!(
                "[{name} @ 0x5] [error] Format not on whitelist 'mpegts'\n[error] http://a: Invalid argument\n"
            )
        };
        for (lines, frames) in [
            (refused("image2"), 0),
            (refused("png_pipe"), 0),
            (refused("gif"), 0),
            ("[info] Input #0, jpeg_pipe, from 'http://a':\n".to_owned(), 1),
        ] {
            let why = end(&lines, frames);
            assert!(why.starts_with("is a still picture, not a stream; give"), "{lines}: {why}");
        }
        assert!(end(&refused("hls"), 0).starts_with("is a playlist"));
        for (container, frames) in [("jpeg_pipe", 2), ("mpjpeg", 1), ("mov,mp4", 1)] {
            let lines = format!("[info] Input #0, {container}, from 'http://a':\n");
            assert_eq!(end(&lines, frames), "the stream has ended", "{container}");
        }
    }

    #[test]
    fn lateness_is_counted_from_the_fastest_frame() {
        let mut lateness = Lateness::default();
        let second = 1_000_000_000;
        assert_eq!(lateness.of(10 * second, 0), 0);
        assert_eq!(lateness.of(11 * second, second as i64 + 500), 0, "faster than the first one");
        assert_eq!(lateness.of(13 * second, 2 * second as i64 + 500), second as i64);
        // A clock that drifts by 100 ppm is a second off after three hours, and no frame is late for that.
        let mut lateness = Lateness::default();
        for minute in 0..300_u64 {
            let late = lateness.of(minute * 60 * second + minute * 6_000_000, (minute * 60 * second) as i64);
            assert!(late < LATEST_NS / 10, "minute {minute}: {late}");
        }
    }
}
