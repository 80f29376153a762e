//! [`VideoAddress`]: what a text names, a video file or a live camera.

use std::fmt;
use std::path::{Path, PathBuf};

use modulo_images::has_extension;
use modulo_runtime::input::in_home;
use modulo_runtime::secret::without_secrets;

use crate::VideoError;

/// File name extensions of videos, in lower case. Any other file is a video with [`PREFIX`] before its path.
const EXTENSIONS: [&str; 26] = [
    "mp4", "m4v", "mkv", "avi", "mov", "webm", "ts", "mts", "m2ts", "mpg", "mpeg", "vob", "flv", "wmv",
    "asf", "ogv", "3gp", "h264", "264", "hevc", "h265", "mjpeg", "mjpg", "ivf", "mxf", "y4m",
];
/// Before the path of a video whose name has another extension.
const PREFIX: &str = "video:";
/// Schemes of live cameras, and the protocols that ffmpeg may use for each. None of them reads a local file.
const SCHEMES: [(&str, &str); 4] = [
    ("rtsp", "rtsp,rtp,udp,tcp"),
    ("rtsps", "rtsps,rtsp,tls,tcp"),
    ("http", "http,tcp"),
    ("https", "https,tls,tcp"),
];

/// A video.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VideoAddress {
    /// The path of a file.
    File(PathBuf),
    /// A camera or a stream of a network.
    Live(LiveAddress),
}

/// The address of a live camera. It is shown without its password.
#[derive(Clone, PartialEq, Eq)]
pub struct LiveAddress {
    url: String,
    protocols: Option<&'static str>,
}

impl VideoAddress {
    /// Returns the video that `spec` names: a file with the extension of a video, `video:PATH`, `rtsp://`, `rtsps://`, `http://`,
    /// `https://` or `/dev/videoN`. `None` for anything else.
    ///
    /// # Errors
    /// [`VideoError`] of a URL with another scheme behind `video:`, or with a blank.
    pub fn of(spec: &str) -> Result<Option<Self>, VideoError> {
        let (path, is_forced) = spec.strip_prefix(PREFIX).map_or((spec, false), |path| (path, true));
        if path.starts_with("/dev/video") {
            return Ok(Some(Self::Live(LiveAddress { url: path.to_owned(), protocols: None })));
        }
        if let Some((scheme, _)) = path.split_once("://") {
            let refuse = |why| VideoError::failed(without_secrets(spec), why);
            let known = SCHEMES.iter().find(|(known, _)| scheme.eq_ignore_ascii_case(known));
            return match known {
                Some(_) if path.contains(|c: char| c.is_whitespace() || c.is_control()) => {
                    Err(refuse("a blank cannot be in a URL; write it as %20"))
                }
                Some((_, protocols)) => Ok(Some(Self::Live(LiveAddress {
                    // ffmpeg knows protocols in lower case only.
                    url: format!("{}{}", scheme.to_ascii_lowercase(), &path[scheme.len()..]),
                    protocols: Some(protocols),
                }))),
                None if is_forced => Err(refuse("rtsp, rtsps, http and https are the schemes of a video")),
                None => Ok(None),
            };
        }
        let path = in_home(Path::new(path));
        let is_video = is_forced || has_extension(&path, &EXTENSIONS);
        Ok((is_video && !path.is_dir()).then_some(Self::File(path)))
    }
}

impl LiveAddress {
    /// Returns the options of ffmpeg that name this input.
    pub(crate) fn input(&self) -> Vec<String> {
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        let options = match self.protocols {
            None => words(&["-f", "v4l2"]),
            Some(protocols) => {
                let mut options = words(&["-protocol_whitelist", protocols]);
                if self.url.starts_with("rtsp") {
                    // Packets of UDP that are lost damage the picture, and many firewalls stop them.
                    options.extend(words(&["-rtsp_transport", "tcp"]));
                } else {
                    options.extend(words(&["-format_whitelist", LIVE_FORMATS]));
                }
                options
            }
        };
        [options, vec!["-i".to_owned(), self.url.clone()]].concat()
    }

    /// Returns the path of a device; `None` for a URL.
    pub(crate) fn device(&self) -> Option<&Path> {
        self.protocols.is_none().then(|| Path::new(&self.url))
    }
}

/// The containers of streams by HTTP. A playlist is none of them.
pub(crate) const LIVE_FORMATS: &str = "mpegts,mpjpeg,mjpeg,jpeg_pipe,flv,matroska,mov,ogg,h264,hevc,nut";

impl fmt::Display for LiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&without_secrets(&self.url))
    }
}

impl fmt::Debug for LiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LiveAddress({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(spec: &str) -> Option<VideoAddress> {
        VideoAddress::of(spec).expect("an address or none")
    }

    #[test]
    fn videos_are_told_by_their_name() {
        for spec in ["a.mp4", "/x/B.MKV", "a.b.webm", "dash.ts", "video:clip.dat", "video:a.mp4"] {
            let path = spec.strip_prefix("video:").unwrap_or(spec);
            assert_eq!(of(spec), Some(VideoAddress::File(path.into())), "{spec}");
        }
        for spec in ["clip.dat", "a.png", "scene://day", "topic:/a.mp4/image", "/", "concat:a.mp4|b.mp3"] {
            assert_eq!(of(spec), None, "{spec}");
        }
    }

    #[test]
    fn only_the_protocols_of_cameras_reach_ffmpeg() {
        for (spec, protocols) in [
            ("rtsp://cam/1", Some("rtsp,rtp,udp,tcp")),
            ("HTTPS://cam", Some("https,tls,tcp")),
            ("/dev/video0", None),
        ] {
            let Some(VideoAddress::Live(address)) = of(spec) else { panic!("{spec} is live") };
            assert_eq!(address.protocols, protocols);
            assert!(protocols.is_none_or(|protocols| !protocols.contains("file")));
        }
        for spec in ["video:file:///etc/passwd", "video:concat://a", "rtsp://cam/1 -f null"] {
            assert!(VideoAddress::of(spec).is_err(), "{spec}");
        }
        assert_eq!(of("udp://10.0.0.1:5000"), None);
    }

    #[test]
    fn a_password_is_never_shown() {
        let Some(VideoAddress::Live(address)) = of("rtsp://admin:s3cret@cam/1?token=s3cret") else {
            panic!("live")
        };
        let why =
            VideoAddress::of("rtsp://admin:s3cret@cam/1 ?token=s3cret").expect_err("a blank").to_string();
        for shown in [format!("{address}"), format!("{address:?}"), why] {
            assert!(!shown.contains("s3cret") && shown.contains("cam/1"), "{shown}");
        }
    }
}
