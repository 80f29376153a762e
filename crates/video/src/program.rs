//! [`Decoding`]: ffmpeg while it decodes a video, with what it says about each frame. [`version`]: whether the programs are there.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_core::Frame;
use modulo_runtime::secret::without_secrets;

use crate::damage::Damage;
use crate::listen::{FrameInfo, listen};
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

/// Returns the first two numbers of a version of ffmpeg; the largest ones for a build without numbers, which is a new one.
pub(crate) fn numbers(version: &str) -> (u32, u32) {
    let mut parts = version.trim_start_matches('n').split(|c: char| !c.is_ascii_digit()).map(str::parse);
    parts.next().and_then(Result::ok).zip(parts.next().and_then(Result::ok)).unwrap_or((u32::MAX, 0))
}

/// Returns the option that passes each frame on once. Its name was another one before version 5.1.
fn frame_options(version: &str) -> [&'static str; 2] {
    [if numbers(version) < (5, 1) { "-vsync" } else { "-fps_mode" }, "passthrough"]
}

/// Returns the version for a video called `name`.
///
/// # Errors
/// [`VideoError`] with the remedy where the programs are not there.
pub(crate) fn needed_version(name: impl std::fmt::Display) -> Result<String, VideoError> {
    version().map_err(|why| {
        VideoError(format!(
            "{name} needs the programs ffmpeg and ffprobe, which are not found ({why}); install them, such as by: apt install ffmpeg"
        ))
    })
}

/// Returns a command of ffmpeg that reads no terminal, writes no file by itself, and gets no signal of a terminal.
pub(crate) fn command(program: &str) -> Command {
    let mut command = Command::new(program);
    // A report that the environment asks for would hold the whole command line, with the password of a camera.
    command.env_remove("FFREPORT").env("AV_LOG_FORCE_NOCOLOR", "1");
    command.stdin(Stdio::null()).process_group(0);
    command
}

/// The errors that a program has reported.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Reports {
    /// The first one; later ones often follow from it.
    pub first: Option<String>,
    /// The name of the container in ffmpeg, if it is told.
    pub container: Option<String>,
    /// Whether it is none of those that are read.
    pub is_refused: bool,
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

    /// Returns whether the input is one picture, or an animation of pictures.
    pub fn is_picture(&self) -> bool {
        let is_picture =
            |name: &String| name.ends_with("_pipe") || ["image2", "gif", "apng"].contains(&name.as_str());
        self.container.as_ref().is_some_and(is_picture)
    }

    /// Takes a line of a program at the log level `level+...`. Returns what it says and whether that is an error.
    pub fn take<'a>(&mut self, line: &'a str) -> (&'a str, bool) {
        // Only names such as `[h264 @ 0x5581]` may stand before the level.
        let mut message = line;
        while let Some((name, rest)) = message.split_once("] ").filter(|(name, _)| name.contains(" @ 0x")) {
            if rest.contains("not on whitelist") {
                (self.container, self.is_refused) = (name.split(['[', ' ']).nth(1).map(str::to_owned), true);
            }
            message = if name.starts_with('[') { rest } else { "" };
        }
        let Some((level, message)) = message.split_once("] ") else { return (message, false) };
        let is_error = matches!(level, "[error" | "[fatal");
        // `Input #0, mpegts, from 'http://camera/'`
        if let Some((container, _)) =
            message.strip_prefix("Input #0, ").and_then(|rest| rest.split_once(", from "))
        {
            self.container = Some(container.to_owned());
        }
        // The times of joined recordings, which frames in a pipe do not have.
        if is_error && !message.starts_with("Application provided invalid") {
            self.first.get_or_insert_with(|| without_secrets(message.trim()).into_owned());
        }
        (message, is_error)
    }
}

/// Three channels, for grey videos of a restricted range as well: ffmpeg changes the range only together with the number of channels.
pub(crate) const COLOURS: &str = "rgb24|rgb48be";

/// A running ffmpeg that decodes. It is killed when this is dropped.
pub(crate) struct Decoding {
    /// The process, for somebody who may have to end it.
    pub child: Arc<Mutex<Child>>,
    frames: BufReader<ChildStdout>,
    infos: Receiver<FrameInfo>,
    reports: Option<JoinHandle<Reports>>,
}

impl Decoding {
    /// Starts to decode the first video stream of `input`, which is the options of ffmpeg for it. Each frame gets one of the pixel formats
    /// `formats`, such as [`COLOURS`].
    pub fn start<S: AsRef<OsStr>>(
        input: &[S],
        formats: &str,
        version: &str,
        damage: Damage,
    ) -> std::io::Result<Self> {
        // With a scaler of its own ffmpeg puts none before `showinfo`, which then tells the format of the video. Without the other flags it
        // repeats each colour sample of `yuv420p` in 2 x 2 pixels: edges that no lens can give, and that hide wrap counts.
        let filters =
            format!("showinfo=checksum=0,scale=flags=bicubic+accurate_rnd+full_chroma_int,format={formats}");
        let mut child = command("ffmpeg")
            // `-debug_ts` tells of each packet that is read, and of each frame that a decoder gives.
            .args(["-nostdin", "-hide_banner", "-nostats", "-debug_ts", "-loglevel", "level+info"])
            // With several threads, reports come at other packets than those that they are about.
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
        let reports = std::thread::spawn(move || listen(lines, &sender, damage));
        Ok(Self { child: Arc::new(Mutex::new(child)), frames, infos, reports: Some(reports) })
    }

    /// Returns the next frame; `None` at the end. The error is that of a stream that breaks off.
    pub fn next(&mut self) -> std::io::Result<Option<(Frame, FrameInfo)>> {
        let mut info = None;
        let bits = || {
            info = self.infos.recv_timeout(PATIENCE).ok();
            info.map(|info| info.bits)
        };
        match pam::read(&mut self.frames, bits) {
            Ok(frame) => Ok(frame.zip(info)),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_option_of_old_versions_is_another_one() {
        for (version, option) in
            [("4.4.2-0ubuntu", "-vsync"), ("5.1.9", "-fps_mode"), ("n7.1", "-fps_mode"), ("8.0", "-fps_mode")]
        {
            assert_eq!(frame_options(version)[0], option, "{version}");
        }
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
