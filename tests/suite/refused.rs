//! Command lines that every command refuses with exit code 2 before anything is done, and the help of `modulo run`.

use crate::harness::{Bench, assert_has};

/// Its node answers the other arguments, so that clap does not answer these.
#[test]
fn run_has_a_help_as_every_command() {
    for word in ["-h", "--help"] {
        assert_has(&Bench::new().ends(0, &["run", word]), &["Usage: modulo run <NODE>"]);
    }
}

/// Commands with a value that is out of range, and words that the refusal must contain. FILE, FOLDER and OUT stand for an
/// image, its folder and a folder for results.
const REFUSED: [(&str, &[&str]); 59] = [
    ("bench pipeline", &["modulo eval --vary", "modulo eval stability"]),
    ("simulate FILE -o OUT --alpha 0", &["'alpha' = 0", "256"]),
    ("simulate FILE -o OUT --alpha 2,-4", &["'alpha' = -4", "256"]),
    ("simulate FILE -o OUT --alpha NaN", &["'alpha' = NaN", "256"]),
    ("simulate FILE -o OUT --psf-sigma -1", &["'psf_sigma' = -1", "100"]),
    ("simulate FILE -o OUT --bits 17", &["'bits' = 17", "16"]),
    ("simulate FILE -o OUT --headroom 0", &["'headroom' = 0", "0.001 to 1"]),
    ("simulate FILE -o OUT --optical-black 65", &["'optical_black' = 65", "0 to 64"]),
    ("simulate FILE -o OUT --bits 300", &["300"]),
    ("simulate FILE -o OUT --read-noise -1", &["'read_noise' = -1", "65536"]),
    ("simulate FILE -o OUT --seed -1", &["-1", "--seed"]),
    ("simulate FILE -o OUT --white -1", &["white = -1", "0"]),
    ("simulate FILE -o OUT --method magic", &["magic", "spud"]),
    ("simulate FILE -o OUT --sensor sensors/arguments.yaml", &["/modulo_camera"]),
    ("simulate FILE -o OUT --sensor sensors/mosaic.yaml --bits 8", &["--sensor", "--bits", "cannot be used"]),
    ("simulate FOLDER -o OUT --repeats 0", &["'0'", "--repeats"]),
    ("simulate FOLDER -o OUT --threads 0", &["0 is not in 1..=64", "--threads"]),
    ("simulate FOLDER -o OUT --bits 0", &["'bits' = 0", "16"]),
    ("simulate FOLDER -o OUT --white inf", &["white = inf"]),
    ("unwrap FILE -o OUT --alpha -1", &["'alpha' = -1", "256"]),
    ("unwrap FILE -o OUT --alpha 2 --threads 65", &["65 is not in 1..=64"]),
    ("eval --source FOLDER -o OUT --alpha -4", &["'alpha' = -4", "256"]),
    ("eval --source FOLDER -o OUT --alpha 2,300", &["'alpha' = 300", "256"]),
    ("eval --source FOLDER -o OUT --psf-sigma -1", &["'psf_sigma' = -1", "100"]),
    ("eval --source FOLDER -o OUT --read-noise -1", &["'read_noise' = -1", "65536"]),
    ("eval --source FOLDER -o OUT --shot-noise -1", &["'shot_noise' = -1", "65536"]),
    ("eval --source FOLDER -o OUT --sensor no.yaml", &["no.yaml"]),
    ("eval --source FOLDER -o OUT --threads 65", &["65", "64"]),
    ("eval --source FOLDER -o OUT --jobs 1025", &["1025", "1024"]),
    ("eval --source FOLDER -o OUT --white -1", &["'white' = -1", "0"]),
    ("eval --source FOLDER -o OUT --seed -1", &["-1", "--seed"]),
    ("eval --source scene://day?frames=-1 -o OUT", &["frames", "-1"]),
    ("eval launch/recovered.launch.yaml -o OUT alpha:=-1", &["'alpha' = -1", "256"]),
    ("launch launch/recovered.launch.yaml alpha:=-1", &["'alpha' = -1", "256"]),
    ("launch launch/recovered.launch.yaml bits:=17", &["'bits' = 17", "16"]),
    ("launch launch/recovered.launch.yaml headroom:=1.1", &["'headroom' = 1.1", "0.001 to 1"]),
    ("launch launch/recovered.launch.yaml optical_black:=-1", &["'optical_black' = -1", "0 to 64"]),
    ("run unwrap --ros-args -p headroom:=1.5", &["'headroom' = 1.5", "0 to 1"]),
    ("launch launch/recovered.launch.yaml rate:=-1", &["'rate' = -1", "10000"]),
    ("launch launch/recovered.launch.yaml threads:=0", &["'threads' = 0", "64"]),
    ("launch launch/recovered.launch.yaml score_threshold:=2", &["'score_threshold' = 2"]),
    ("launch launch/recovered.launch.yaml image_bits:=17", &["'bits' = 17", "16"]),
    ("launch --compose launch/recovered.launch.yaml psf_sigma:=-1", &["'psf_sigma' = -1", "100"]),
    ("run modulo_camera --ros-args -p alpha:=0.0", &["'alpha' = 0", "256"]),
    ("run modulo_camera --ros-args -p white:=-1.0", &["'white' = -1"]),
    ("run unwrap --ros-args -p tau:=-0.5", &["'tau' = -0.5"]),
    ("run detector --ros-args -p max_det:=0", &["'max_det' = 0", "1000"]),
    ("bag play bags/samples/tunnel --rate -1", &["rate = -1"]),
    ("bag play bags/samples/tunnel --clock -1", &["--clock -1", "above 0"]),
    ("bag play bags/samples/tunnel --start-offset -1", &["--start-offset -1"]),
    ("bag record -o OUT --max-bag-size -1", &["-1", "--max-bag-size"]),
    ("topic hz /modulo --window 1", &["1", "--window"]),
    ("eval --source FOLDER -o OUT --alpha -4,2", &["'alpha' = -4: must be a finite number in 0.001 to 256"]),
    ("eval --source FOLDER -o OUT --threads -1", &["invalid value '-1' for '--threads"]),
    ("bag play bags/samples/tunnel --rate NaN", &["rate = NaN"]),
    ("bag play bags/samples/tunnel --clock 0", &["--clock 0"]),
    ("bag play bags/samples/tunnel --start-offset 9", &["start offset = 9s", "2.75s"]),
    ("bag play bags/samples/tunnel --playback-duration -1", &["--playback-duration"]),
    ("bag play bags/samples/tunnel --remap nothing", &["nothing"]),
];

#[test]
fn a_value_out_of_range_ends_with_exit_code_2() {
    let bench = Bench::new();
    bench.images(1);
    for (line, expected) in REFUSED {
        let mut line = line.replace("FILE", "@/images/000000.png").replace("FOLDER", "@/images");
        if line.contains(".launch.yaml") {
            // Were the value accepted, the run would be short.
            line += " source:=@/images model:=%";
        }
        let message = bench.says(2, &line.replace("OUT", "@/out"));
        assert!(
            expected.iter().all(|expected| message.contains(expected)),
            "{line} must name {expected:?}: {message}"
        );
        assert!(!bench.path("out").exists(), "{line} has written something");
    }
}
