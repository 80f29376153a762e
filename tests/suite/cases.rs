//! Inputs of public bug reports, with the result that their users expect: a test for each folder of `cases` in the test data.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Stdio;
use std::time::Duration;

use crate::harness::{Bench, assert_has, borrowed, data, text};

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
    bag_topic_with_space: |case| {
        case.run("bag play @/bag", 3, &["/device_0/Enable Auto Exposure/value", "--remap", "--topics"]);
        case.run("bag play @/bag --topics /ok/image", 0, &[]);
        let mut words = case.words("bag play @/bag --remap");
        words.push("/device_0/Enable Auto Exposure/value:=/exposure".to_owned());
        case.run_words(&words, 0, &[]);
    };
    bag_two_image_topics: |case| {
        case.run("launch launch/recovered.launch.yaml source:=@/bag", 2, &["source_topic:=", "/left/image_raw"]);
        case.run("launch launch/recovered.launch.yaml source:=@/bag source_topic:=/left/image_raw", 0, &[]);
        case.run("eval launch/raw.launch.yaml source:=@/bag source_topic:=/left/image_raw -o %/left", 0, &[]);
    };
    bayer_compressed: |case| {
        let images = ["raw", "compressed"].map(|kind| {
            let line = "alpha:=1 optical_black:=0 psf_sigma:=0 mosaic:=rggb --images";
            case.run(&format!("eval launch/raw.launch.yaml source:=@/{kind} {line} -o %/{kind}"), 0, &[]);
            pictures(&case.bench.path(kind))
        });
        let [raw, compressed] = images.map(|images| images.into_values().collect::<Vec<_>>());
        assert!(!raw.is_empty());
        assert!(raw == compressed, "both forms of one picture are the same colours");
    };
    coco_image_twice: |case| {
        let labels = "--coco @/ann.json --coco-images @/images";
        assert_eq!(case.scored(labels, 0, &[]), 1, "the annotations of both entries belong to the file");
    };
    coco_one_bad_annotation: |case| {
        let one = ["1 labels cannot be read and are left out"];
        for (name, code, wanted) in [("unknown_category", 3, &one[..]), ("nan", 3, &one), ("no_bbox", 0, &[])] {
            let objects = case.scored(&format!("--coco @/{name}.json --coco-images @/images"), code, wanted);
            assert_eq!(objects, if code == 0 { 2 } else { 1 }, "{name}");
            std::fs::remove_dir_all(case.bench.path("scored")).expect("removed");
        }
    };
    coco_other_size: |case| {
        let labels = "--coco @/ann.json --coco-images @/images";
        let line = "--stream ideal --alpha 1 --psf-sigma 0 --engine rten -o %/scored";
        case.run(&format!("eval {labels} {line}"), 3, &["2 frames", "a.png", "320 x 192", "160 x 96"]);
    };
    file_zstd: |case| {
        for bag in ["@/x.mcap.zstd", "@"] {
            case.run(&format!("bag info {bag}"), 1, &["zstd -d", "x.mcap.zstd"]);
        }
        case.run("bag info @/unpacked", 0, &["Messages:"]);
    };
    frames_with_decimal_times: |case| {
        let line = "alpha:=1 headroom:=1 optical_black:=0 psf_sigma:=0 --images";
        case.run(&format!("eval raw source:=@/frames {line} -o %/eval"), 0, &[]);
        let greys = pictures(&case.bench.path("eval/modulo")).into_values().map(|file| {
            image::load_from_memory(&file).expect("a picture").to_luma8().get_pixel(0, 0).0[0]
        });
        assert_eq!(greys.collect::<Vec<_>>(), [40, 90, 140, 190]);
    };
    half_period_trusted: |case| {
        let message = case.run("unwrap @/stairs.png --alpha 4 --headroom 1 -o %/stairs", 0, &["trusted"]);
        assert!(!message.contains(" yes "), "{message}");
    };
    hdr_rgbe_signature: |case| {
        case.run("simulate @/rgbe.hdr --alpha 2 -o %/rgbe", 0, &[]);
    };
    humble_mcap_no_type_hash: |case| {
        case.run("bag convert @/bag %/converted", 0, &[]);
        for bag in ["@/bag", "%/converted"] {
            let line = format!("launch launch/replay.launch.yaml bag:={bag} bits:=8 alpha:=2.0");
            let message = case.run(&line, 0, &[]);
            let arrived = message.lines().find_map(|line| line.strip_prefix("/recovered ")).expect("a row");
            assert_eq!(arrived.split_whitespace().next(), Some("6"), "{message}");
        }
    };
    jpeg_damaged: |case| {
        let names = ["half_with_end_marker.jpg", "lost_512_bytes.jpg", "zeroed_200_bytes.jpg"];
        case.run("eval launch/raw.launch.yaml source:=@ -o %/folder", 3, &names);
        case.run("eval launch/raw.launch.yaml source:=@/bag -o %/bag", 3, &[]);
    };
    kitti_16_columns: |case| {
        assert_eq!(case.scored("--kitti @/data --difficulty all", 0, &[]), 1);
    };
    kitti_raw_layout: |case| {
        for source in ["2011_09_26_drive_0001_sync", "2011_09_26_drive_0001_sync/image_02"] {
            let folder = source.replace('/', "_");
            case.run(&format!("eval raw source:=@/{source} -o %/{folder}"), 0, &[]);
            let boxes = case.bench.json(&format!("{folder}/modulo.json"));
            assert_eq!(boxes.as_object().map(|frames| frames.len()), Some(3), "{source}");
        }
    };
    launch_known_but_unknown: |case| {
        case.run("launch --check @/container.launch.yaml", 1, &["node_container", "ROS 2", "--compose"]);
        case.run("launch --check @/prefix.launch.yaml", 1, &["launch-prefix", "ROS 2"]);
    };
    lfs_pointer: |case| {
        for (line, code) in [
            ("model check @/model.onnx", 2),
            ("simulate @/a.png -o %/simulated", 1),
            ("bag info @/drive.mcap", 1),
            ("eval raw source:=@/v.mp4 -o %/eval", 2),
            ("eval raw source:=@/a.png -o %/eval", 2),
        ] {
            case.run(line, code, &["is a pointer of git LFS", "git lfs pull"]);
        }
    };
    mcap_chunk_crc: |case| {
        case.run("bag convert @/crc.mcap %/converted", 3, &["CRC"]);
        case.run("bag info %/converted", 0, &["6"]);
        case.run("bag play @/crc.mcap --rate 10", 3, &["CRC"]);
        case.run("eval launch/raw.launch.yaml source:=@/crc.mcap -o %/eval", 3, &["CRC"]);
    };
    message_compressed_db3: |case| {
        // Read or refused by name, but never passed on as it is.
        let (code, message) = case.output(&case.words("bag convert @/msg.db3 %/x"));
        if code == Some(0) {
            case.run("eval launch/raw.launch.yaml source:=%/x -o %/eval", 0, &[]);
        } else {
            assert!(matches!(code, Some(1 | 2)) && message.contains("compressed"), "{message}");
        }
    };
    onnx_external_data: |case| {
        let (code, message) = case.output(&case.words("model check @/model.onnx"));
        assert!(code == Some(0) || message.contains("file of their own"), "{message}");
    };
    recover_loses_more_than_convert: |case| {
        // Nothing is lost: the index at the end knows the length that the damaged one hides.
        case.run("bag recover @/length.mcap %/recovered", 0, &["damaged"]);
        case.run("bag convert @/length.mcap %/converted", 0, &["damaged"]);
        let [recovered, converted] = ["recovered", "converted"].map(|bag| {
            let metadata = std::fs::read_to_string(case.bench.path(bag).join("metadata.yaml")).expect("metadata");
            let count = metadata.lines().find_map(|line| line.strip_prefix("  message_count: "));
            count.and_then(|count| count.parse::<u64>().ok()).expect("a count")
        });
        assert!(recovered >= converted && converted >= 12, "{recovered} and {converted} messages");
    };
    reindexed_bag_empty_storage: |case| {
        case.run("bag info @/bag", 0, &["Messages:"]);
        case.run("bag recover @/bag %/recovered", 0, &[]);
    };
    replay_truncated_bag: |case| {
        let message = case.run("launch launch/replay.launch.yaml bag:=@/cut.mcap bits:=8 alpha:=2.0", 3, &["cut"]);
        assert!(!message.contains("crashed"), "{message}");
    };
    split_bag_part_missing: |case| {
        case.run("bag recover @/bag %/recovered", 3, &[]);
        case.run("bag info @/bag", 3, &[]);
        case.run("bag info %/recovered", 0, &[]);
    };
    truncated_bag_as_source: |case| {
        case.run("launch launch/recovered.launch.yaml source:=@/cut.mcap", 3, &["cut"]);
        case.run("eval launch/raw.launch.yaml source:=@/cut.mcap -o %/eval", 3, &["cut"]);
    };
    two_suites_one_domain: |case| {
        let launch = |more: &str| {
            let mut command = case.bench.modulo(&["launch", "launch/recovered.launch.yaml", "rate:=5", more]);
            command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary starts")
        };
        let first = launch("frames:=30");
        std::thread::sleep(Duration::from_secs(2));
        let second = launch("source:=scene://day?seed=1&frames=30");
        std::thread::sleep(Duration::from_secs(3));
        let nodes = text(&case.bench.run(&["node", "list"]));
        assert_eq!(nodes.matches("/modulo_camera").count(), 2, "{nodes}");
        for launch in [first, second] {
            let message = text(&launch.wait_with_output().expect("it ends"));
            assert!(message.contains("/modulo_camera"), "{message}");
            assert!(message.contains("ROS_DOMAIN_ID"), "the remedy: {message}");
        }
    };
    video_damaged: |case| {
        case.run("eval launch/raw.launch.yaml source:=@/damaged.mp4 -o %/eval", 3, &[]);
    };
    video_other_extension: |case| {
        case.run("eval launch/raw.launch.yaml source:=@/dash.ts -o %/eval", 0, &[]);
    };
    yolo_names_file: |case| {
        for folder in ["yml", "darknet"] {
            assert_eq!(case.scored(&format!("--yolo @/{folder}"), 0, &[]), 2, "{folder}");
            std::fs::remove_dir_all(case.bench.path("scored")).expect("removed");
        }
        case.scored("--yolo @/none", 3, &["no file with the names of the classes was found", "data.yaml", "obj.names"]);
    };
    yolo_standard_layout: |case| {
        let line = "--stream ideal --alpha 1 --psf-sigma 0 --engine rten -o %/scored";
        let named = ["has the subfolders train, val: choose --yolo ", "data/images/val"];
        for path in ["data", "data/data.yaml"] {
            case.run(&format!("eval --yolo @/{path} {line}"), 2, &named);
        }
        assert_eq!(case.scored("--yolo @/data/images/val", 0, &[]), 2);
    };
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
