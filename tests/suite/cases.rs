//! Inputs of public bug reports, with the result that their users expect: a test for each folder of `cases` in the test data.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::JoinHandle;
use std::time::Duration;

use crate::harness::{Bench, assert_has, borrowed, data, evaluated, model, signal, text};
use crate::outputs::files;
use crate::view::{parts, request, viewer};

/// A case: its folder, and a bench to run commands on it.
struct Case {
    bench: Bench,
    folder: PathBuf,
}

impl Case {
    /// Returns the words of a command line in which `@` stands for the folder of the case, and `%` for that of the results.
    fn words(&self, line: &str) -> Vec<String> {
        let [folder, results] =
            [&self.folder, self.bench.folder.path()].map(|path| path.to_str().expect("UTF-8"));
        line.split(' ').map(|word| word.replace('@', folder).replace('%', results)).collect()
    }

    fn output(&self, words: &[String]) -> (Option<i32>, String) {
        let output = self.bench.run(&borrowed(words));
        (output.status.code(), text(&output))
    }

    /// Runs a command line, and checks its exit code and that its output has each of `wanted`. Returns the output.
    fn run(&self, line: &str, code: i32, wanted: &[&str]) -> String {
        self.run_words(&self.words(line), code, wanted)
    }

    fn run_words(&self, words: &[String], code: i32, wanted: &[&str]) -> String {
        let message = self.bench.ends(code, &borrowed(words));
        assert_has(&message, wanted);
        message
    }

    /// Runs `modulo eval` with labels on images as they are, and returns the number of scored objects.
    fn scored(&self, labels: &str, code: i32, message: &[&str]) -> u64 {
        let line = format!("eval {labels} --stream ideal --alpha 1 --psf-sigma 0 --engine rten -o %/scored");
        self.run(&line, code, message);
        let results = self.bench.json("scored/results.json");
        std::fs::remove_dir_all(self.bench.path("scored")).expect("a folder of this run");
        let objects = results["cells"][0]["objects"].as_object().expect("objects by group");
        objects.values().map(|objects| objects.as_u64().expect("a count")).sum()
    }
}

/// Makes a test of each case, and the list of their names.
macro_rules! cases {
    ($($name:ident: $run:expr;)*) => {
        $(
            #[test]
            fn $name() {
                let Some(folder) = data::shared(concat!("cases/", stringify!($name))) else { return };
                let run: fn(&Case) = $run;
                run(&Case { bench: Bench::new(), folder });
            }
        )*

        const NAMES: &[&str] = &[$(stringify!($name)),*];
    };
}

#[test]
fn every_case_has_a_test() {
    let Some(folder) = data::shared("cases") else { return };
    for case in std::fs::read_dir(folder).expect("a folder") {
        let name = case.expect("an entry").file_name();
        let name = name.to_str().expect("UTF-8");
        assert!(NAMES.contains(&name), "{name} has no test");
    }
}

cases! {
    coco_one_bad_annotation: |case| {
        for (file, objects) in [("unknown_category", 1), ("no_bbox", 2), ("nan", 1)] {
            let labels = format!("--coco @/{file}.json --coco-images @/images");
            let (code, wanted) =
                if file == "no_bbox" { (0, &[][..]) } else { (3, &["1 labels cannot be read and are left out"][..]) };
            assert_eq!(case.scored(&labels, code, wanted), objects, "{file}");
        }
    };
    dng_thumbnail: |case| {
        for file in ["raw.dng", "raw.tif"] {
            for line in [format!("simulate @/{file} -o %/simulated"), format!("eval raw source:=@/{file} -o %/eval")] {
                let (code, message) = case.output(&case.words(&line));
                assert!(matches!(code, Some(1 | 2)), "{line}: {message}");
                assert_has(&message, &["DNG", "dcraw -D -4 -T"]);
            }
        }
    };
    frames_with_decimal_times: |case| {
        let line = "alpha:=1 headroom:=1 optical_black:=0 psf_sigma:=0 --images";
        case.run(&format!("eval raw source:=@/frames {line} -o %/times"), 0, &[]);
        let greys = pictures(&case.bench.path("times/modulo")).into_values().map(|file| {
            image::load_from_memory(&file).expect("a picture").to_luma8().get_pixel(0, 0).0[0]
        });
        assert_eq!(greys.collect::<Vec<_>>(), [40, 90, 140, 190]);
    };
    gif_video_remedy: |case| {
        for (source, format) in [("@/anim.gif", "GIF"), ("video:@/anim.gif", "convert it to PNG"), ("@/frame.pgm", "PGM")] {
            let message = case.run(&format!("eval raw source:={source} -o %/eval"), 2, &[format]);
            assert!(!message.contains("put 'video:'"), "{message}");
        }
    };
    kitti_raw_layout: |case| {
        for folder in ["2011_09_26_drive_0001_sync", "2011_09_26_drive_0001_sync/image_02"] {
            let out = folder.replace('/', "_");
            case.run(&format!("eval raw source:=@/{folder} -o %/{out}"), 0, &[]);
            assert_eq!(evaluated(&case.bench.path(&out), "modulo").len(), 3, "{folder}");
        }
    };
    lfs_pointer: |case| {
        let pointers = [
            "model check @/model.onnx",
            "simulate @/a.png -o %/simulated",
            "bag info @/drive.mcap",
            "eval raw source:=@/v.mp4 -o %/eval",
        ];
        for line in pointers {
            let (code, message) = case.output(&case.words(line));
            assert!(matches!(code, Some(1 | 2)), "{line}: {message}");
            assert_has(&message, &["git lfs pull"]);
        }
        let (code, message) = case.output(&case.words("model check @/best.pt"));
        assert!(matches!(code, Some(1 | 2)), "{message}");
        assert_has(&message, &["PyTorch", "yolo export model=", "best.pt format=onnx"]);
    };
    mcap_attachments_lost: |case| {
        case.run("bag info @/attach.mcap", 0, &["calib.yaml", "drive"]);
        for command in ["convert", "recover"] {
            case.run(&format!("bag {command} @/attach.mcap %/{command}"), 0, &[]);
            case.run(&format!("bag info %/{command}"), 0, &["calib.yaml", "drive"]);
        }
    };
    mjpeg_http_slow_camera: |case| {
        let jpeg = std::fs::read(case.folder.join("frame.jpg")).expect("a picture");
        for rate in [5, 10, 15] {
            let (url, camera) = camera(jpeg.clone(), rate, 4 * rate);
            let words = case.words(&format!("launch raw source:={url} input_size:=64x64"));
            let mut command = case.bench.modulo(&borrowed(&words));
            let launch = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
            let sent = camera.join().expect("no panic");
            // The camera of the suite tries again when its source has ended.
            std::thread::sleep(Duration::from_secs(1));
            signal(launch.id(), "INT");
            let message = text(&launch.wait_with_output().expect("it ends"));
            assert!(!message.contains("late"), "{rate} Hz: {message}");
            // A busy machine replaces frames by newer ones, but each arrives.
            let frames = message.lines().find_map(|line| line.split(" live: ").nth(1)?.split(' ').next()?.parse().ok());
            assert!(sent.is_ok() && frames.is_some_and(|frames: u32| frames >= 4 * rate - 1), "{rate} Hz: {message}");
        }
    };
    model_boxes_0_to_1: |case| {
        let model = "--model @/normalised.onnx --stream ideal --alpha 1 --psf-sigma 0 --optical-black 0";
        for line in ["model check @/normalised.onnx".to_owned(), format!("eval --yolo @/data {model} -o %/eval")] {
            case.run(&line, 2, &["all boxes lie between 0 and 1", "pixels are needed"]);
        }
    };
    model_names_list: |case| {
        case.run("model check @/list.onnx", 0, &["person, bicycle, car"]);
        let model = "--model @/list.onnx --stream ideal --alpha 1 --psf-sigma 0 --optical-black 0";
        case.run(&format!("eval --yolo @/data {model} -o %/eval"), 0, &["100.0"]);
    };
    output_over_input: |case| {
        let [pictures, folder, video] = ["pictures", "folder/modulo", "drive.mp4"].map(|name| case.bench.path(name));
        for copy in [&pictures, &folder] {
            std::fs::create_dir_all(copy).expect("writable");
            for picture in std::fs::read_dir(case.folder.join("pictures")).expect("a folder").flatten() {
                std::fs::copy(picture.path(), copy.join(picture.file_name())).expect("copied");
            }
        }
        std::fs::copy(case.folder.join("drive.mp4"), &video).expect("copied");
        let before = files(case.bench.folder.path());
        for line in [
            &*format!("detect %/pictures --model {} -o %/pictures", model()),
            "eval raw source:=%/folder/modulo -o %/folder --images",
        ] {
            case.run(line, 2, &["choose another path"]);
            assert!(files(case.bench.folder.path()) == before, "{line} has written something");
        }
    };
    replay_missing_bag: |case| {
        for (bag, reason) in [("/not/there", "/not/there"), ("@/other.mcap", "/modulo")] {
            let message = case.run(&format!("launch replay bag:={bag}"), 2, &[]);
            let last = message.lines().last().expect("a line");
            assert!(last.contains(reason) && !message.contains("crashed"), "{message}");
        }
    };
    runs_folder_race: |case| {
        let start = |words: &str| {
            let mut command = case.bench.modulo(&words.split(' ').collect::<Vec<_>>());
            let command = command.current_dir(case.bench.folder.path()).stdout(Stdio::null()).stderr(Stdio::null());
            command.spawn().expect("it starts")
        };
        std::fs::copy(case.folder.join("a.png"), case.bench.path("a.png")).expect("copied");
        let runs: Vec<_> = (1..=4)
            .map(|seed| start(&format!("eval raw source:=scene://day?frames=1&seed={seed}")))
            .chain((1..=3).map(|alpha| start(&format!("simulate a.png --alpha {alpha}"))))
            .collect();
        for mut run in runs {
            assert!(run.wait().expect("it ends").success());
        }
        let folders = |kind: &str| std::fs::read_dir(case.bench.path("runs").join(kind)).expect("a folder").count();
        assert_eq!((folders("eval"), folders("images")), (4, 3));
    };
    stderr_gone_panic: |case| {
        let run = |frames: u32, summary: &str, errors: Stdio| {
            let words = case.words(&format!("launch raw source:=scene://day?frames={frames} --summary %/{summary}"));
            let mut command = case.bench.modulo(&borrowed(&words));
            command.stdout(Stdio::null()).stderr(errors).spawn().expect("it starts")
        };
        let mut full = run(5, "full", full_disk());
        assert_eq!(full.wait().expect("it ends").code(), Some(0));
        let mut gone = run(20, "gone", Stdio::piped());
        drop(gone.stderr.take());
        assert_eq!(gone.wait().expect("it ends").code(), Some(0));
        for (summary, frames) in [("full", 5), ("gone", 20)] {
            assert_eq!(case.bench.json(summary)["frames"], frames);
        }
    };
    tiff_of_raw_cameras: |case| {
        for file in ["packed12", "big", "u32"] {
            let (code, message) = case.output(&case.words(&format!("simulate @/{file}.tif -o %/{file}")));
            assert!(code == Some(0) || (code == Some(1) && message.contains("such as by")), "{message}");
        }
    };
    video_joined_ts: |case| {
        let (code, message) = case.output(&case.words("eval raw source:=@/joined.ts alpha:=1 --images -o %/eval"));
        assert!(matches!(code, Some(0 | 3)), "{message}");
        let frames = pictures(&case.bench.path("eval/modulo")).len();
        assert!(frames >= 59, "{frames} frames: {message}");
    };
    viewer_reverse_proxy: |case| {
        let (_viewer, address) = viewer(&case.bench);
        let (host, token) = parts(&address);
        let upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==";
        let head = format!("GET /socket?token={token} HTTP/1.1\r\n{upgrade}\r\nOrigin: https://robot.example.com");
        assert_has(&request(host, &head), &["HTTP/1.1 403 ", "proxy_set_header Host $http_host;"]);
    };
    yolo_names_file: |case| {
        for folder in ["yml", "darknet"] {
            assert_eq!(case.scored(&format!("--yolo @/{folder}"), 0, &[]), 2, "{folder}");
        }
        case.scored("--yolo @/none", 3, &["no file with the names of the classes was found", "data.yaml", "obj.names"]);
    };
    yolo_standard_layout: |case| {
        for data in ["@/data", "@/data/data.yaml"] {
            let line = format!("eval --yolo {data} --stream ideal --alpha 1 --psf-sigma 0 -o %/eval");
            let (code, message) = case.output(&case.words(&line));
            assert!(code == Some(0) || (code == Some(2) && message.contains("images/val")), "{data}: {message}");
        }
    };
    yolov5_one_class: |case| {
        // Both commands read the rows as those of YOLOv5, and say so.
        let model = "--model @/one_class.onnx --stream ideal --alpha 1 --psf-sigma 0 --optical-black 0";
        for line in ["model check @/one_class.onnx".to_owned(), format!("eval --yolo @/data {model} -o %/eval")] {
            case.run(&line, 0, &["centre, size, objectness", "end2end"]);
        }
    };
}

/// A file for which there is never room.
fn full_disk() -> Stdio {
    std::fs::File::options().write(true).open("/dev/full").expect("Linux has it").into()
}

/// Returns the address of a camera, and the camera, which sends `count` pictures to its first reader as multipart JPEG without times.
fn camera(jpeg: Vec<u8>, rate: u32, count: u32) -> (String, JoinHandle<std::io::Result<()>>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).expect("a free port");
    let address = listener.local_addr().expect("an address");
    let camera = std::thread::spawn(move || {
        let mut reader = listener.accept()?.0;
        // Unread bytes of the request would reset the connection at its end, and with it the last picture.
        let mut request = BufReader::new(reader.try_clone()?).lines();
        while request.next().is_some_and(|line| line.is_ok_and(|line| !line.is_empty())) {}
        let kind = "multipart/x-mixed-replace; boundary=frame";
        write!(reader, "HTTP/1.0 200 OK\r\nContent-Type: {kind}\r\n\r\n")?;
        for _ in 0..count {
            write!(reader, "--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.len())?;
            reader.write_all(&jpeg)?;
            reader.write_all(b"\r\n")?;
            std::thread::sleep(Duration::from_secs(1) / rate);
        }
        Ok(())
    });
    (format!("http://{address}/stream"), camera)
}

/// Returns the PNG files below a folder, by path.
fn pictures(folder: &std::path::Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(pictures(&path));
        } else if path.extension().is_some_and(|extension| extension == "png") {
            found.insert(path.clone(), std::fs::read(path).expect("a picture"));
        }
    }
    found
}
