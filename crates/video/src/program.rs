//! [`Decoding`]: ffmpeg while it decodes a video, with what it says about each frame. [`version`]: whether the programs are there.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_core::Frame;
use modulo_runtime::secret::without_secrets;

use crate::{VideoError, pam};

/// What is said about frames that are not read yet. ffmpeg is only a few frames ahead, since frames go through a pipe.
const AHEAD: usize = 1024;
/// What is said about a frame comes before it, but through another pipe.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longer lines of the programs are cut.
const LONGEST_LINE: u64 = 4096;

/// Returns the version of ffmpeg, such as `5.1.9`.
///
/// # Errors
/// The reason why ffmpeg or ffprobe cannot be started.
pub fn version() -> Result<String, String> {
    let mut versions = ["ffprobe", "ffmpeg"].into_iter().map(|program| {
        let output = command(program).arg("-version").output().map_err(|why| format!("{program}: {why}"))?;
        let text = String::from_utf8_lossy(&output.stdout);
        let version = text.split_whitespace().nth(2).filter(|_| output.status.success());
        version.map(str::to_owned).ok_or_else(|| format!("{program} -version: {}", output.status))
    });
    // Both are needed; those of one installation have the same version.
    versions.try_fold(String::new(), |_, version| version)
}

/// Returns the option that passes each frame on once. Its name was another one before version 5.1.
pub(crate) fn frame_options(version: &str) -> [&'static str; 2] {
    let mut parts = version.split(|c: char| !c.is_ascii_digit()).map(str::parse::<u32>);
    let is_old =
        matches!((parts.next(), parts.next()), (Some(Ok(major)), Some(Ok(minor))) if (major, minor) < (5, 1));
    [if is_old { "-vsync" } else { "-fps_mode" }, "passthrough"]
}

/// Returns the version for a video called `name`.
///
/// # Errors
/// [`VideoError::NoProgram`].
pub(crate) fn needed_version(name: impl std::fmt::Display) -> Result<String, VideoError> {
    version().map_err(|why| VideoError::NoProgram(name.to_string(), why))
}

/// Returns a command of ffmpeg that reads no terminal, writes no file by itself, and gets no signal of a terminal.
pub(crate) fn command(program: &str) -> Command {
    let mut command = Command::new(program);
    // A report that the environment asks for would hold the whole command line, with the password of a camera.
    command.env_remove("FFREPORT").env("AV_LOG_FORCE_NOCOLOR", "1");
    command.stdin(Stdio::null()).process_group(0);
    command
}

/// What ffmpeg says about a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FrameInfo {
    /// Time of presentation in ns, on the time base of the container.
    pub pts_ns: Option<i64>,
    /// Bits of a sample before ffmpeg has made 8 or 16 of them.
    pub bits: u32,
    /// Whether ffmpeg has reported damage in it, or in a frame from which it may be predicted.
    pub is_damaged: bool,
}

/// Which frames are damaged, by what ffmpeg reports while it decodes them on one thread.
#[derive(Clone, Copy, Debug)]
struct Damage {
    /// Key frames that are to come before frames are whole again; 0 for whole frames.
    keys: u32,
    /// `keys` at damage of which it is not known in which frame it is.
    most: u32,
    /// Whether the next frame is reported as a corrupt one.
    is_next: bool,
    /// Whether a frame was shown that is no key frame.
    is_predicting: bool,
}

impl Damage {
    /// Takes a report that is not about a frame that is shown.
    fn take(&mut self, message: &str, is_error: bool) {
        /// Errors about what is beside the pictures, which some encoders always cause.
        const HARMLESS: [&str; 4] = ["APP fields", "SEI", "VUI", "sps_id"];
        let tells = |what| message.contains(what);
        self.is_next |= tells("corrupt decoded frame");
        let is_damage = message.starts_with("concealing ")
            || ["corrupt decoded frame", "corrupt input packet", "Packet corrupt"].into_iter().any(tells);
        if is_damage || (is_error && !HARMLESS.iter().any(|harmless| message.contains(harmless))) {
            self.keys = self.most;
        }
        // The damaged frame is not shown, and none is predicted from it.
        let is_gone =
            ["Error while decoding stream", "Error submitting packet to decoder"].into_iter().any(tells);
        if is_gone && !self.is_predicting {
            self.keys = 0;
        }
    }

    /// Returns whether the frame that is shown now is damaged. A decoder hides damage, but all frames up to the next key frame are
    /// predicted from what it hides.
    fn of_frame(&mut self, is_key: bool) -> bool {
        self.is_predicting |= !is_key;
        if std::mem::take(&mut self.is_next) {
            self.keys = 1;
            return true;
        }
        self.keys -= u32::from(is_key && self.keys > 0);
        self.keys > 0
    }
}

/// The errors that a program has reported.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Reports {
    /// The first one; later ones often follow from it.
    pub first: Option<String>,
}

impl Reports {
    /// Takes all lines of a program.
    pub fn read(mut lines: impl BufRead) -> Self {
        let mut reports = Self::default();
        while let Ok(Some(line)) = next_line(&mut lines) {
            reports.take(&line);
        }
        reports
    }

    /// Takes a line of a program at the log level `level+...`. Returns what it says and whether that is an error.
    pub fn take<'a>(&mut self, line: &'a str) -> (&'a str, bool) {
        // Only names such as `[h264 @ 0x5581]` may stand before the level.
        let mut message = line;
        while let Some((name, rest)) = message.split_once("] ").filter(|(name, _)| name.contains(" @ 0x")) {
            message = if name.starts_with('[') { rest } else { "" };
        }
        let Some((level, message)) = message.split_once("] ") else { return (message, false) };
        let is_error = matches!(level, "[error" | "[fatal");
        if is_error {
            self.first.get_or_insert_with(|| without_secrets(message.trim()).into_owned());
        }
        (message, is_error)
    }
}

/// Three channels, for grey videos of a restricted range as well: ffmpeg changes the range only together with the number of channels.
pub(crate) const COLOURS: &str = "rgb24|rgb48be";

/// A running ffmpeg that decodes. It is killed when this is dropped.
pub(crate) struct Decoding {
    child: Arc<Mutex<Child>>,
    frames: BufReader<ChildStdout>,
    infos: Receiver<FrameInfo>,
    reports: Option<JoinHandle<Reports>>,
}

impl Decoding {
    /// Starts to decode the first video stream of `input`, which is the options of ffmpeg for it. Each frame passes the filter
    /// `first`, such as `null`, and gets one of the pixel formats `formats`, such as [`COLOURS`]. After damage frames are whole again with key frame number `keys`: 1 if a decoder keeps no frame back,
    /// else 2, since a key frame from before the damage may be shown after it.
    pub fn start<S: AsRef<OsStr>>(
        input: &[S],
        [first, formats]: [&str; 2],
        version: &str,
        keys: u32,
    ) -> std::io::Result<Self> {
        // With a scaler of its own ffmpeg puts none before `showinfo`, which then tells the format of the video.
        let filters = format!("{first},showinfo=checksum=0,scale=flags=bicubic,format={formats}");
        let mut child = command("ffmpeg")
            .args(["-nostdin", "-hide_banner", "-nostats", "-loglevel", "level+info"])
            // With several threads, reports come at other frames than those that they are about.
            .args(["-threads", "1"])
            .args(input)
            // `V`: a picture on the cover of a song is no video.
            .args(["-map", "0:V:0", "-vf", &filters])
            .args(frame_options(version))
            .args(["-c:v", "pam", "-f", "image2pipe", "pipe:1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let frames = BufReader::new(child.stdout.take().expect("it is piped"));
        let lines = child.stderr.take().expect("it is piped");
        let (sender, infos) = sync_channel(AHEAD);
        let reports = std::thread::spawn(move || listen(lines, &sender, keys));
        Ok(Self { child: Arc::new(Mutex::new(child)), frames, infos, reports: Some(reports) })
    }

    /// Returns the process, for somebody who may have to end it.
    pub fn child(&self) -> Arc<Mutex<Child>> {
        self.child.clone()
    }

    /// Returns the next frame; `None` at the end. The error is that of a stream that breaks off.
    pub fn next(&mut self) -> std::io::Result<Option<(Frame, FrameInfo)>> {
        let mut info = FrameInfo::default();
        let bits = || {
            info = self.infos.recv_timeout(PATIENCE).unwrap_or_default();
            info.bits
        };
        match pam::read(&mut self.frames, bits) {
            Ok(frame) => Ok(frame.map(|frame| (frame, info))),
            Err(why) => {
                // What goes on behind something that is no frame would wait for a reader.
                kill(&self.child);
                Err(why)
            }
        }
    }

    /// Returns what the process has reported, and the signal that ended it if one did; for a process whose frames are over.
    pub fn end(mut self) -> (Reports, Option<i32>) {
        // Nobody waits for a place in the channel any more.
        self.infos = sync_channel(0).1;
        let reports = self.reports.take().and_then(|reports| reports.join().ok()).unwrap_or_default();
        let status = self.child.lock().unwrap_or_else(PoisonError::into_inner).wait();
        (reports, status.ok().and_then(|status| status.signal()))
    }
}

impl Drop for Decoding {
    fn drop(&mut self) {
        kill(&self.child);
    }
}

/// Ends a process, if it has not ended.
pub(crate) fn kill(child: &Mutex<Child>) {
    let mut child = child.lock().unwrap_or_else(PoisonError::into_inner);
    // Both fail only for a process that has ended.
    let _ = child.kill();
    let _ = child.wait();
}

/// Reads what ffmpeg says until it ends.
fn listen(lines: ChildStderr, infos: &SyncSender<FrameInfo>, keys: u32) -> Reports {
    let (mut lines, mut reports, mut base) = (BufReader::new(lines), Reports::default(), TimeBase(1, 1));
    let mut damage = Damage { keys: 0, most: keys, is_next: false, is_predicting: false };
    let mut decoder = String::new();
    while let Ok(Some(line)) = next_line(&mut lines) {
        let message = line.starts_with("[Parsed_showinfo_").then(|| line.split_once("] [info] ")).flatten();
        match message {
            Some((_, message)) if message.starts_with("config in time_base:") => {
                base = time_base(message).unwrap_or(base)
            }
            Some((_, message)) if message.starts_with("n:") => {
                let is_damaged = damage.of_frame(message.contains(" iskey:1"));
                // A reader that is gone needs no more.
                let _ = infos.send(FrameInfo { is_damaged, ..frame_info(message, base) });
            }
            Some(_) => {}
            None => {
                let (message, is_error) = reports.take(&line);
                // `Stream #0:0 -> #0:0 (h264 (native) -> pam (native))`
                if let Some((_, codecs)) = message.trim().split_once(" -> #0:0 (") {
                    decoder = codecs.split(" -> ").next().unwrap_or_default().to_owned();
                }
                damage.take(message, is_error && is_of(&line, &decoder));
            }
        }
    }
    reports
}

/// Returns whether a line comes from `decoder`, such as `h264 (native)`, or from ffmpeg itself, and not from what reads the container.
fn is_of(line: &str, decoder: &str) -> bool {
    let Some((name, _)) = line.strip_prefix('[').and_then(|line| line.split_once(" @ 0x")) else {
        return !decoder.is_empty();
    };
    decoder.split([' ', '(', ')']).any(|word| !word.is_empty() && name.contains(word))
}

/// Reads a line; a long one in parts. `None` at the end.
pub(crate) fn next_line(lines: &mut impl BufRead) -> std::io::Result<Option<String>> {
    let mut line = Vec::new();
    let read = lines.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line)?;
    Ok((read > 0).then(|| String::from_utf8_lossy(&line).trim_end().to_owned()))
}

/// A time base in seconds: the numerator and the denominator, both above 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TimeBase(i32, i32);

impl TimeBase {
    /// Reads `1/12800`.
    pub fn parse(text: &str) -> Option<Self> {
        let (numerator, denominator) = text.split_once('/')?;
        let base = Self(numerator.trim().parse().ok()?, denominator.trim().parse().ok()?);
        (base.0 > 0 && base.1 > 0).then_some(base)
    }

    /// Returns a time in ns; `None` for one that is too far away.
    pub fn ns(self, time: i64) -> Option<i64> {
        let ns = i128::from(time) * 1_000_000_000 * i128::from(self.0) / i128::from(self.1);
        i64::try_from(ns).ok()
    }
}

/// Reads `config in time_base: 1/12800, frame_rate: 25/1`.
fn time_base(message: &str) -> Option<TimeBase> {
    TimeBase::parse(message.split_once("time_base:")?.1.split(',').next()?)
}

/// Reads `n:   0 pts:    300 pts_time:0.3 ... fmt:yuv420p10le ...`, with blanks behind the colons.
fn frame_info(message: &str, base: TimeBase) -> FrameInfo {
    let value = |key: &str| message.split_once(key)?.1.split_whitespace().next();
    let pts = value(" pts:").and_then(|pts| pts.parse().ok());
    let bits = value(" fmt:").map_or(8, bits_of);
    FrameInfo { pts_ns: pts.and_then(|pts| base.ns(pts)), bits, is_damaged: false }
}

/// Returns the bits of a sample in a pixel format of ffmpeg, such as 10 for `yuv420p10le`. Formats of more than 8 bits end with the
/// order of their bytes, behind a number that ends with the bits.
fn bits_of(format: &str) -> u32 {
    let Some(name) = format.strip_suffix("le").or_else(|| format.strip_suffix("be")) else { return 8 };
    let digits = name.len() - name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    match name[name.len() - digits..].parse::<u32>() {
        Ok(bits) if (9..=16).contains(&(bits % 100)) => bits % 100,
        // rgb48, rgba64, grayf32
        Ok(32 | 48 | 64) => 16,
        // rgb565
        _ => 8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_have_bits() {
        for (format, bits) in [
            ("yuv420p", 8),
            ("nv12", 8),
            ("rgb565le", 8),
            ("bgr444le", 8),
            ("yuv420p10le", 10),
            ("gray12be", 12),
            ("p010le", 10),
            ("p016le", 16),
            ("y210le", 10),
            ("rgb48be", 16),
            ("gbrpf32le", 16),
            ("gbrp9le", 9),
        ] {
            assert_eq!(bits_of(format), bits, "{format}");
        }
    }

    #[test]
    fn times_are_exact() {
        let base = time_base("config in time_base: 1001/30000, frame_rate: 30000/1001").expect("a time base");
        let message =
            "n:   0 pts: 3600000 pts_time:120120  pos:  3534 fmt:yuv420p sar:1/1 s:64x48 i:P iskey:0 type:P";
        let info = FrameInfo { pts_ns: Some(120_120_000_000_000), bits: 8, is_damaged: false };
        assert_eq!(frame_info(message, base), info);
        assert_eq!(frame_info("n: 1 pts: NOPTS pts_time:NOPTS fmt:gray10le", base).pts_ns, None);
        assert_eq!(time_base("config in time_base: 0/0, frame_rate: 0/0"), None);
    }

    #[test]
    fn the_option_of_old_versions_is_another_one() {
        for (version, option) in
            [("4.4.2-0ubuntu", "-vsync"), ("5.1.9", "-fps_mode"), ("n7.1", "-fps_mode"), ("8.0", "-fps_mode")]
        {
            assert_eq!(frame_options(version)[0], option, "{version}");
        }
    }

    #[test]
    fn frames_are_damaged_up_to_the_next_key_frame() {
        let mut damage = Damage { keys: 0, most: 2, is_next: false, is_predicting: false };
        let mut reports = Reports::default();
        let decoder = "h264 (native)";
        let mut shown = |line: &str| {
            let (message, is_error) = reports.take(line);
            if let "K" | "P" = message {
                return Some(damage.of_frame(message == "K"));
            }
            damage.take(message, is_error && is_of(line, decoder));
            None
        };
        let of_others = [
            "[mov,mp4 @ 0x1] [error] stream 1, timescale not set",
            "[h264 @ 0x1] [error] SEI type 5 truncated",
        ];
        assert!(of_others.into_iter().all(|line| shown(line).is_none()));
        // A frame that is gone damages no other one while all are key frames.
        shown("[error] Error while decoding stream #0:0: Invalid data found when processing input");
        assert_eq!(["K", "P"].map(&mut shown), [Some(false); 2]);
        // The first key frame may be from before the damage.
        shown("[h264 @ 0x1] [error] error while decoding MB 8 2, bytestream 4164");
        assert_eq!(["P", "K", "P", "K", "P"].map(&mut shown), [true, true, true, false, false].map(Some));
        shown("[h264 @ 0x1] [info] concealing 80 DC, 80 AC, 80 MV errors in P frame");
        assert_eq!(shown("P"), Some(true));
        // ffmpeg names the frame, in version 7 with two names in front.
        shown("[vist#0:0/h264 @ 0x1] [dec:h264 @ 0x2] [warning] corrupt decoded frame");
        assert_eq!(["P", "P", "K", "P"].map(&mut shown), [true, true, false, false].map(Some));
    }

    #[test]
    fn errors_are_told_without_passwords() {
        let mut reports = Reports::default();
        reports.take("[info] Input #0, mov, from '[error] no'");
        reports.take("[mov @ 0x55] [warning] [error] no");
        reports.take("[rtsp @ 0x55] [error] method DESCRIBE failed: 401");
        reports.take("[error] rtsp://a:secret@cam/1: Unauthorized");
        assert_eq!(reports.first.as_deref(), Some("method DESCRIBE failed: 401"));
        let mut reports = Reports::default();
        reports.take("[fatal] rtsp://a:secret@cam/1: Unauthorized");
        assert_eq!(reports.first.as_deref(), Some("rtsp://***@cam/1: Unauthorized"));
    }
}
