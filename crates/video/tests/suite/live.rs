//! Streams over the loopback interface, served by ffmpeg: the newest frame is taken, a stream that ends is opened again, and no playlist is.

use crate::data;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::{Child, Command};
use std::sync::Arc;
use std::time::{Duration, Instant};

use modulo_core::Frame;
use modulo_images::FileFormat;
use modulo_runtime::{Clock, SystemClock};
use modulo_video::{LiveFrame, LiveVideo, VideoAddress};
use ndarray::Array3;

/// A stream at 30 Hz, which ends with this.
struct Server(Child);

impl Server {
    fn start(port: u16) -> Self {
        let options = "-nostdin -v error -re -f lavfi -i testsrc=s=320x192:r=30 -t 60 -c:v libx264 -preset ultrafast -tune zerolatency -g 15 \
                       -pix_fmt yuv420p -f mpegts -listen 1";
        let url = format!("http://127.0.0.1:{port}/live");
        Self(Command::new("ffmpeg").args(options.split_whitespace()).arg(url).spawn().expect("ffmpeg starts"))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A port that is free, if ffmpeg is there; else the test is skipped.
fn port() -> Option<u16> {
    if let Err(why) = modulo_video::version() {
        data::skip(&why);
        return None;
    }
    Some(TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("an address").port())
}

fn open(port: u16, path: &str) -> LiveVideo {
    let address =
        VideoAddress::of(&format!("http://user:s3cret@127.0.0.1:{port}/{path}")).expect("an address");
    let Some(VideoAddress::Live(address)) = address else { panic!("it is live") };
    LiveVideo::open(address, Arc::new(SystemClock::default())).expect("ffmpeg")
}

/// The next frame within `patience`.
fn next(video: &LiveVideo, patience: Duration) -> Option<LiveFrame> {
    let end = Instant::now() + patience;
    loop {
        let frame = video.newest(Duration::from_millis(100)).transpose().expect("a whole frame");
        if frame.is_some() || Instant::now() > end {
            return frame;
        }
    }
}

#[test]
fn the_newest_frame_is_taken_and_a_stream_that_ends_is_opened_again() {
    let Some(port) = port() else { return };
    let server = Server::start(port);
    let video = open(port, "live");
    let patience = Duration::from_secs(30);
    let first = next(&video, patience).expect("a frame");
    assert_eq!((first.pixels.bits, first.pixels.frame.dim()), (8, (192, 320, 3)));
    let mut last = first.stamp_ns;
    for _ in 0..10 {
        let stamp = next(&video, patience).expect("a frame").stamp_ns;
        assert!(stamp > last);
        last = stamp;
    }
    // A reader that stands still goes on with a new frame.
    std::thread::sleep(Duration::from_secs(1));
    let before = video.counts();
    let late = next(&video, patience).expect("a frame").stamp_ns;
    let age = SystemClock::default().now_ns().saturating_sub(late);
    assert!(late - last > 500_000_000 && age < 500_000_000, "{age} ns old");
    assert!(before.replaced >= 10 && before.arrived >= 20 && before.connections == 1, "{before:?}");

    drop(server);
    while next(&video, Duration::from_secs(1)).is_some() {}
    let _server = Server::start(port);
    next(&video, patience).expect("a frame of the second stream");
    assert_eq!(video.counts().connections, 2);
}

/// Motion JPEG has no times: ffmpeg makes up those of 25 Hz, and each frame of a slower camera would come later than the one before.
#[test]
fn a_slow_camera_of_motion_jpeg_is_not_late() {
    const FRAMES: u64 = 16;
    let Some(port) = port() else { return };
    let listener = TcpListener::bind(("127.0.0.1", port)).expect("the port is free");
    let server = std::thread::spawn(move || {
        let (mut camera, _) = listener.accept().expect("ffmpeg asks");
        let _ = camera.read(&mut [0; 4096]);
        let head = "HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n";
        let mut send = |bytes: &[u8]| camera.write_all(bytes).expect("ffmpeg reads");
        send(head.as_bytes());
        for number in 0..FRAMES as u8 {
            let frame = Frame::from_u8(Array3::from_elem((48, 64, 3), 10 * number)).expect("a frame");
            let picture = modulo_images::encode(&frame, FileFormat::Jpeg).expect("a JPEG");
            let part =
                format!("--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", picture.len());
            send(&[part.as_bytes(), &picture, b"\r\n"].concat());
            // 5 Hz: 15 frames come 2.4 s later than those of 25 Hz would.
            std::thread::sleep(Duration::from_millis(200));
        }
        send(b"--frame\r\n");
        camera
    });
    let video = open(port, "stream");
    let _camera = server.join().expect("one connection");
    let end = Instant::now() + Duration::from_secs(30);
    // The last one is kept back until the begin of the next one.
    while video.counts().arrived < FRAMES - 1 && Instant::now() < end {
        let _ = video.newest(Duration::from_millis(100));
    }
    let counts = video.counts();
    assert!(counts.arrived >= FRAMES - 1 && counts.connections == 1, "{counts:?}");
}

#[test]
fn a_playlist_that_names_a_file_gives_no_frame() {
    let Some(port) = port() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let secret = folder.path().join("secret.ts");
    let made = "-nostdin -v error -f lavfi -i testsrc=s=320x192:r=30 -t 20 -c:v libx264 -qp 4 -pix_fmt yuv420p -f mpegts";
    assert!(
        Command::new("ffmpeg").args(made.split(' ')).arg(&secret).status().expect("ffmpeg starts").success()
    );
    let listener = TcpListener::bind(("127.0.0.1", port)).expect("the port is free");
    let list = format!(
        "#EXTM3U\n#EXT-X-TARGETDURATION:20\n#EXTINF:20\nfile://{}\n#EXT-X-ENDLIST\n",
        secret.display()
    );
    let server = std::thread::spawn(move || {
        for _ in 0..2 {
            let (mut client, _) = listener.accept().expect("ffmpeg asks");
            let _ = client.read(&mut [0; 4096]);
            let head = format!(
                "HTTP/1.0 200 OK\r\nContent-Type: application/vnd.apple.mpegurl\r\nContent-Length: {}\r\n\r\n",
                list.len()
            );
            let _ = client.write_all((head + &list).as_bytes());
        }
    });
    let video = open(port, "live.m3u8");
    // ffmpeg has refused the list when it asks for the second time.
    server.join().expect("asked twice");
    assert_eq!(next(&video, Duration::from_millis(500)), None);
    assert_eq!(video.counts().arrived, 0);
}

#[test]
fn a_device_that_is_absent_is_refused() {
    let Ok(Some(VideoAddress::Live(address))) = VideoAddress::of("/dev/video987") else { panic!("a device") };
    let why = LiveVideo::open(address, Arc::new(SystemClock::default())).err().expect("absent").to_string();
    assert!(why.contains("/dev/video987") && why.contains("there are"), "{why}");
}
