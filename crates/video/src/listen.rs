//! [`listen`]: what ffmpeg says while it decodes, as [`FrameInfo`].

use std::io::{BufReader, Read};
use std::sync::mpsc::SyncSender;

use crate::damage::{Damage, Shown};
use crate::program::{Reports, TimeBase, next_line};

/// What ffmpeg says about a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FrameInfo {
    /// Time of presentation in ns, on the time base of the container; `None` in one without times.
    pub pts_ns: Option<i64>,
    /// The number of its packet, if it is one of those that are known beforehand.
    pub packet: Option<u64>,
    /// Bits of a sample before ffmpeg has made 8 or 16 of them.
    pub bits: u32,
    /// Whether ffmpeg has reported damage in it, or in a frame from which it may be predicted.
    pub is_damaged: bool,
}

/// Containers without times, for which ffmpeg makes up those of a constant rate.
const TIMELESS: [&str; 5] = ["mpjpeg", "mjpeg", "jpeg_pipe", "h264", "hevc"];

/// Reads what ffmpeg says until it ends.
pub(crate) fn listen(lines: impl Read, infos: &SyncSender<FrameInfo>, damage: Damage) -> Reports {
    let (mut lines, mut listener) = (BufReader::new(lines), Listener { damage, ..Listener::default() });
    while let Ok(Some(line)) = next_line(&mut lines) {
        if let Some(info) = listener.take(&line) {
            // A reader that is gone needs no more.
            let _ = infos.send(info);
        }
    }
    listener.reports
}

/// Errors about what is beside the pictures, which some encoders always cause, or about a packet that is not given.
const HARMLESS: [&str; 5] = ["APP fields", "SEI", "VUI", "sps_id", "ended prematurely"];

/// A part of ffmpeg.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Container,
    Decoder,
}

#[derive(Default)]
struct Listener {
    reports: Reports,
    damage: Damage,
    base: Option<TimeBase>,
    /// The decoder, such as `h264 (native)`.
    decoder: String,
}

impl Listener {
    /// Takes a line. Returns what it says about a frame that is shown.
    fn take(&mut self, line: &str) -> Option<FrameInfo> {
        if let Some(rest) = line.strip_prefix("[Parsed_showinfo_") {
            return self.take_shown(rest.split_once("] [info] ")?.1);
        }
        let (message, is_error) = self.reports.take(line);
        // `Stream #0:0 -> #0:0 (h264 (native) -> pam (native))`
        if let Some((_, codecs)) = message.trim().split_once(" -> #0:0 (") {
            self.decoder = codecs.split(" -> ").next().unwrap_or_default().to_owned();
        }
        let is_harmless = HARMLESS.iter().any(|harmless| message.contains(harmless));
        self.report(message, if is_error && !is_harmless { self.blamed(line, message) } else { None });
        None
    }

    /// Takes what the filter says that sees each frame.
    fn take_shown(&mut self, message: &str) -> Option<FrameInfo> {
        if message.starts_with("config in time_base:") {
            self.base = time_base(message).or(self.base);
        }
        let info = message.starts_with("n:").then(|| self.frame(message));
        // A thread of ffmpeg may say something within the line of another one, which has words with colons alone: about a packet or a frame
        // with an arrow, or an error.
        if info.is_some() || message.starts_with("color_") {
            let is_foreign =
                |word: &str| !word.contains(':') && word != "NOPTS" && word.parse::<i64>().is_err();
            let has_arrow = message.contains("- ") || message.contains("> ");
            let is_error = !has_arrow && message.split_whitespace().any(is_foreign);
            self.report(message, is_error.then_some(Part::Decoder));
        }
        info
    }

    /// Returns the part of ffmpeg of which a line has an error, if that may damage frames.
    fn blamed(&self, line: &str, message: &str) -> Option<Part> {
        // Such as `h264` in `[h264 @ 0x5581]`, or `flv` in `[in#0/flv @ 0x5581]`; what has no name is ffmpeg itself.
        let name = line.strip_prefix('[').and_then(|line| line.split_once(" @ 0x")?.0.rsplit('/').next());
        let is_decoder = |name: &str| {
            self.decoder.split([' ', '(', ')']).any(|word| !word.is_empty() && name.contains(word))
        };
        if name.map_or_else(|| message.contains("decod"), is_decoder) {
            return Some(Part::Decoder);
        }
        (name.is_some() && name == self.reports.container.as_deref()).then_some(Part::Container)
    }

    /// Takes what is not about a frame that is shown, and the part of ffmpeg that it is an error of.
    fn report(&mut self, message: &str, blamed: Option<Part>) {
        if let Some((_, packet)) = message.split_once("demuxer -> ") {
            self.damage.read(number(packet, " pkt_pts:"));
        } else if let Some((_, frame)) = message.split_once("decoder -> ") {
            self.damage.decoded(number(frame, " frame_pts:").or_else(|| number(frame, "pts:")));
        } else if let Some((_, packet)) = message.split_once("Packet corrupt (") {
            // `stream = 0, dts = 387000).`
            let dts = word(packet, "dts = ").and_then(|dts| dts.trim_end_matches(['.', ')']).parse().ok());
            dts.into_iter().for_each(|dts| self.damage.find(dts));
        } else if message.contains("corrupt input packet") {
            self.damage.lose_next();
        } else if message.contains("corrupt decoded frame") {
            self.damage.lose_frame();
        } else if blamed == Some(Part::Decoder) || message.contains("concealing ") {
            self.damage.lose_decoded();
        } else if blamed == Some(Part::Container) {
            self.damage.lose_read();
        }
    }

    /// Reads `n:   0 pts:    300 pts_time:0.3 pos: 48 ... fmt:yuv420p10le ... iskey:1 type:I`, with blanks behind some colons.
    fn frame(&mut self, message: &str) -> FrameInfo {
        let pts = number(message, " pts:");
        let kind = word(message, " type:").unwrap_or_default();
        let (packet, is_damaged) = self.damage.shown(Shown {
            pts,
            pos: number(message, " pos:").filter(|pos| *pos >= 0),
            is_key: message.contains(" iskey:1"),
            is_predicted: matches!(kind, "P" | "B" | "S" | "p"),
        });
        let bits = word(message, " fmt:").map_or(8, bits_of);
        let is_timeless = self.reports.container.as_deref().is_some_and(|name| TIMELESS.contains(&name));
        let pts_ns = pts.filter(|_| !is_timeless).and_then(|pts| self.base?.ns(pts));
        FrameInfo { pts_ns, packet, bits, is_damaged }
    }
}

/// Returns the word behind `key`.
fn word<'a>(message: &'a str, key: &str) -> Option<&'a str> {
    message.split_once(key)?.1.split_whitespace().next()
}

/// Returns the number behind `key`.
fn number(message: &str, key: &str) -> Option<i64> {
    word(message, key)?.parse().ok()
}

/// Reads `config in time_base: 1/12800, frame_rate: 25/1`.
fn time_base(message: &str) -> Option<TimeBase> {
    TimeBase::parse(message.split_once("time_base:")?.1.split(',').next()?)
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

    fn listener(version: &str) -> Listener {
        Listener { damage: Damage::new([].into(), version, false), ..Listener::default() }
    }

    #[test]
    fn times_are_exact() {
        let mut listener = listener("5.1.9");
        let mut take = |line: &str| listener.take(&format!("[Parsed_showinfo_0 @ 0x5] [info] {line}"));
        assert_eq!(take("config in time_base: 1001/30000, frame_rate: 30000/1001"), None);
        let message =
            "n:   0 pts: 3600000 pts_time:120120  pos:  3534 fmt:yuv420p sar:1/1 s:64x48 i:P iskey:1 type:I";
        let info = FrameInfo { pts_ns: Some(120_120_000_000_000), bits: 8, ..FrameInfo::default() };
        assert_eq!(take(message), Some(info));
        let grey = take("n: 1 pts: NOPTS pts_time:NOPTS fmt:gray10le iskey:0 type:P").expect("a frame");
        assert_eq!((grey.pts_ns, grey.bits, grey.is_damaged), (None, 10, false));
        assert_eq!(time_base("config in time_base: 0/0, frame_rate: 0/0"), None);
    }

    /// The times of the damaged frames, if ffmpeg says these lines about a packet: of the container before it is read, and else while it is
    /// decoded.
    fn damaged(version: &str, about: usize, report: &str) -> Vec<i64> {
        let mut listener = listener(version);
        listener.take("[info]   Stream #0:0 -> #0:0 (h264 (native) -> pam (native))");
        let mut take = |line: &str| listener.take(line);
        let (mut damaged, mut shown) = (Vec::new(), 0);
        for packet in 0..24 {
            // Four groups of six frames. The frame of the second packet is shown behind two others.
            let pts = 6 * (packet / 6) + [0, 3, 1, 2, 4, 5][packet % 6];
            let lines =
                [format!("[info] demuxer -> ist_index:0 type:video pkt_pts:{pts} "), report.to_owned()];
            let is_of_container = report.contains("input");
            let lines = lines.iter().take(if packet == about { 2 } else { 1 });
            let lines: Vec<_> = if is_of_container { lines.rev().collect() } else { lines.collect() };
            assert!(lines.into_iter().all(|line| take(line).is_none()));
            // The decoder keeps two frames back.
            let end = if packet == 23 { 24 } else { (packet as i64 - 1).max(0) };
            for pts in shown..end {
                let (key, kind) = if pts % 6 == 0 { (1, 'I') } else { (0, 'P') };
                take(&format!("[info] decoder -> ist_index:0 type:video frame_pts:{pts} keyframe:{key}"));
                let said = format!("[info] n: {pts} pts: {pts} fmt:yuv420p iskey:{key} type:{kind}");
                let info = take(&format!("[Parsed_showinfo_0 @ 0x5] {said}")).expect("a frame");
                damaged.extend(info.is_damaged.then_some(pts));
            }
            shown = end;
        }
        damaged
    }

    #[test]
    fn frames_are_damaged_from_a_packet_up_to_the_next_key_frame() {
        let group = |number: i64| (6 * number..6 * number + 6).collect::<Vec<_>>();
        for (about, report, expected) in [
            // The frame at 9 was decoded before, and is shown later.
            (8, "[h264 @ 0x1] [error] error while decoding MB 8 2, bytestream 4164", vec![7, 8, 10, 11]),
            (8, "[h264 @ 0x1] [info] concealing 80 DC, 80 AC, 80 MV errors in P frame", vec![7, 8, 10, 11]),
            (12, "[error] Error while decoding stream #0:0: Invalid data found", group(2)),
            (11, "[warning] a.ts: corrupt input packet in stream 0", vec![11, 12, 13, 14, 15, 16, 17]),
            (9, "[warning] corrupt decoded frame in stream 0", vec![7, 8, 10, 11]),
            (8, "[h264 @ 0x1] [error] SEI type 5 truncated", vec![]),
            (8, "[mov,mp4 @ 0x1] [error] stream 1, timescale not set", vec![]),
            (8, "[error] a.ts: Input/output error", vec![]),
        ] {
            assert_eq!(damaged("5.1.9", about, report), expected, "{report}");
        }
        // A thread of its own reads packets before they are decoded, and lines of two threads may become one.
        for report in [
            "[vist#0:0/h264 @ 0x1] [dec:h264 @ 0x2] [error] error while decoding MB 8 2",
            "[Parsed_showinfo_0 @ 0x5] [info] color_range:unknown color_space:unknownconcealing 80 DC errors",
        ] {
            assert_eq!(damaged("n7.1", 8, report), group(1), "{report}");
        }
    }

    #[test]
    fn no_frame_counts_before_the_first_key_frame() {
        let mut listener = listener("5.1.9");
        let mut is_damaged = |pts: i64, key: u8, kind: char| {
            listener.take(&format!("[info] demuxer -> ist_index:0 type:video pkt_pts:{pts} "));
            let line = format!("[Parsed_showinfo_0 @ 0x5] [info] n: 0 pts: {pts} iskey:{key} type:{kind}");
            listener.take(&line).expect("a frame").is_damaged
        };
        assert_eq!(
            [(0, 0, 'P'), (1, 0, 'B'), (2, 1, 'I'), (3, 0, 'P')]
                .map(|(pts, key, kind)| is_damaged(pts, key, kind)),
            [true, true, false, false]
        );
    }
}
