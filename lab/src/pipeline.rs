//! The time of a frame from its modulo image to its boxes, in one process and in several, beside the time of its inference.
//!
//! Each run is one of `modulo launch`, and the traces of its nodes give the times. The modes take turns, so that a machine that becomes slower becomes slower
//! for both of them.

mod processes;
mod trace;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use clap::Parser;
use nix::sys::time::TimeValLike as _;
use nix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};

use processes::{children_cpu_s, watch};
use trace::Times;

/// The first frames of a run, which fill caches and make buffers; they are not counted.
const WARM_UP: usize = 5;
/// The nodes of a ROS domain meet on this port and the number of the domain.
const MEETING_PORT: u16 = 7450;

/// Measures the time from the modulo image to the boxes in one process and in several, beside that of its inference
#[derive(Parser)]
struct Options {
    /// The program, such as target/release/modulo
    program: PathBuf,
    /// Source of the frames, as the parameter `source` of the camera takes it
    #[arg(long, default_value = "scene://tunnel?seed=3&width=1242&height=375")]
    source: String,
    /// YOLO model in ONNX format, or demo: the embedded demonstration
    #[arg(long, default_value = "demo")]
    model: String,
    /// Inference engine, as the parameter `engine` of the detector takes it
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Device that runs the model, as the parameter `device` of the detector takes it
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Saturation factor: brightest radiance divided by the peak of the sensor
    #[arg(long, default_value_t = 4.0)]
    alpha: f64,
    /// Standard deviation of the lens blur in px. 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    psf_sigma: f64,
    /// Frames per second. 0: the next frame as soon as the last one was taken, so that the camera works beside the network
    #[arg(long, default_value_t = 10.0)]
    rate: f64,
    /// Number of frames of each run, without the first five of it, which are not counted
    #[arg(long, default_value_t = 25)]
    count: usize,
    /// Number of runs of each mode
    #[arg(long, default_value_t = 4)]
    rounds: usize,
    /// Numbers of cameras, each with a camera and an unwrapping of its own, that one detector answers, such as 1,2,4,8, in place of the two modes
    #[arg(long, value_delimiter = ',')]
    cameras: Vec<usize>,
}

/// The processes that a run starts.
#[derive(Clone, Copy)]
enum Setup {
    /// A camera, an unwrapping and a detector, in one process or in three.
    Pipeline { is_composed: bool },
    /// So many cameras with an unwrapping each, and one detector, each in a process of its own.
    Cameras(usize),
}

/// The runs of one mode.
#[derive(Default)]
struct Mode {
    times: Times,
    frames_per_s: Vec<f64>,
    first_box_s: Vec<f64>,
    cpu_s_per_frame: Vec<f64>,
    rss_mb: Vec<f64>,
    dropped: usize,
    engine: String,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    let domain = free_domain()?;
    let mut modes = BTreeMap::<String, Mode>::new();
    for _ in 0..options.rounds {
        for &cameras in &options.cameras {
            let mode = modes.entry(format!("cameras {cameras}")).or_default();
            run(&options, domain, Setup::Cameras(cameras), mode)?;
        }
        for (name, is_composed) in [("composed", true), ("live", false)] {
            if options.cameras.is_empty() {
                run(
                    &options,
                    domain,
                    Setup::Pipeline { is_composed },
                    modes.entry(name.to_owned()).or_default(),
                )?;
            }
        }
    }
    let load = fs::read_to_string("/proc/loadavg").context("the load of this machine")?;
    println!("load of this machine: {}", load.trim());
    println!(
        "mode      engine   frames    p50 ms    p99 ms  infer ms    ratio  frames/s  first box s  cpu s/frame    rss MB  age p50   age p99  dropped"
    );
    for (name, mode) in &modes {
        print(name, mode);
    }
    Ok(())
}

/// Prints the figures of a mode, and the medians of its stages.
fn print(name: &str, mode: &Mode) {
    let Mode { times, frames_per_s, first_box_s, cpu_s_per_frame, rss_mb, dropped, engine } = mode;
    let stages = times.stages.iter().map(|(name, ms)| (name, quantile(ms, 0.5)));
    let stages: BTreeMap<&String, f64> = stages.collect();
    let infer = stages.iter().find(|(name, _)| name.ends_with(" infer")).map_or(f64::NAN, |(_, ms)| *ms);
    let (p50, p99) = (quantile(&times.frames_ms, 0.5), quantile(&times.frames_ms, 0.99));
    println!(
        "{name:<9} {engine:<8} {:>6} {p50:>9.2} {p99:>9.2} {infer:>9.2} {:>8.3} {:>9.2} {:>12.2} {:>12.3} {:>9.1} {:>8.2} {:>9.2} {dropped:>8}",
        times.frames_ms.len(),
        p50 / infer,
        quantile(frames_per_s, 0.5),
        quantile(first_box_s, 1.0),
        quantile(cpu_s_per_frame, 0.5),
        quantile(rss_mb, 1.0),
        quantile(&times.ages_ms, 0.5),
        quantile(&times.ages_ms, 0.99),
    );
    let stages: Vec<String> = stages.iter().map(|(name, ms)| format!("{name} {ms:.2}")).collect();
    println!("          {}", stages.join(", "));
}

/// The least of `values` that the share `q` of them does not exceed; not a number without a value.
fn quantile(values: &[f64], q: f64) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let place = (q * values.len() as f64).ceil() as usize;
    values.get(place.max(1) - 1).copied().unwrap_or(f64::NAN)
}

/// A ROS domain in which no node is running.
fn free_domain() -> anyhow::Result<u16> {
    let is_free = |domain: &u16| TcpListener::bind((Ipv4Addr::LOCALHOST, MEETING_PORT + domain)).is_ok();
    (70..100).find(is_free).context("the ROS domains 70 to 99 are all in use: end what runs in one of them")
}

/// Runs the suite once, and adds its figures to those of its mode.
fn run(options: &Options, domain: u16, setup: Setup, mode: &mut Mode) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("a folder for the files of a run")?;
    let [log, summary] = ["log.txt", "summary.json"].map(|file| folder.path().join(file));
    let out = File::create(&log).context("the log of a run")?;
    let mut command = Command::new(&options.program);
    let (file, cameras) = launched(setup, folder.path())?;
    command
        .arg("launch")
        .arg(file)
        .args(arguments(options))
        .arg("--summary")
        .arg(&summary)
        .env("MODULO_TRACE_DIR", folder.path());
    let is_composed = matches!(setup, Setup::Pipeline { is_composed: true });
    command.args(is_composed.then_some("--compose"));
    command.stdin(Stdio::null()).stdout(out.try_clone()?).stderr(out);
    command.env("ROS_DOMAIN_ID", domain.to_string());
    command.env("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=true");
    let cpu_s = children_cpu_s()?;
    let start_ms = clock_gettime(ClockId::CLOCK_MONOTONIC)?.num_nanoseconds() as f64 / 1e6;
    let mut child = command.spawn().with_context(|| options.program.display().to_string())?;
    let (status, rss_mb) = watch(&mut child, is_composed)?;
    ensure!(status.success(), "the run failed, {status}: {}", fs::read_to_string(&log)?.trim());
    let times = Times::read(&traces(folder.path())?, WARM_UP);
    ensure!(
        !times.frames_ms.is_empty(),
        "no frame but the first {WARM_UP} of a run was answered: most are replaced by newer ones; give a larger --count, or --rate 0, with \
         which none is replaced"
    );
    let summary: Value = serde_json::from_slice(&fs::read(&summary)?).context("the summary of a run")?;
    mode.engine = summary["engine"].as_str().context("no detector told its engine")?.to_owned();
    mode.frames_per_s.extend(times.frames_per_s);
    mode.first_box_s.extend(times.first_box_ms.map(|end| (end - start_ms) / 1e3));
    let frames = cameras * (options.count + WARM_UP);
    mode.cpu_s_per_frame.push((children_cpu_s()? - cpu_s) / frames as f64);
    mode.dropped += frames - WARM_UP - times.frames_ms.len();
    mode.rss_mb.push(rss_mb);
    mode.times.add(times);
    Ok(())
}

/// Returns the launch file of a run, which may be made in `folder`, and the number of its cameras.
fn launched(setup: Setup, folder: &Path) -> anyhow::Result<(PathBuf, usize)> {
    let Setup::Cameras(cameras) = setup else { return Ok((PathBuf::from("recovered.launch.yaml"), 1)) };
    let file = folder.join("cameras.launch.yaml");
    fs::write(&file, launch_file(cameras)).context("the launch file of a run")?;
    Ok((file, cameras))
}

/// The arguments of the program for a run.
fn arguments(options: &Options) -> Vec<String> {
    let Options { source, model, engine, device, alpha, psf_sigma, rate, count, .. } = options;
    vec![
        format!("source:={source}"),
        format!("frames:={}", count + WARM_UP),
        "loop:=true".to_owned(),
        format!("rate:={rate:?}"),
        format!("model:={model}"),
        format!("engine:={engine}"),
        format!("device:={device}"),
        format!("alpha:={alpha:?}"),
        format!("psf_sigma:={psf_sigma:?}"),
    ]
}

/// A launch file with so many cameras, each with its unwrapping in a namespace of its own, and one detector for all of them.
fn launch_file(cameras: usize) -> String {
    let namespaces: Vec<String> = (1..=cameras).map(|number| format!("/camera_{number}")).collect();
    let include = |namespace: &String| {
        json!({"group": [
            {"push_ros_namespace": {"namespace": namespace}},
            {"include": {
                "file": "$(find-pkg-share modulo)/launch/sensor.launch.yaml",
                "arg": [{"name": "detectors", "value": "[/detector]"}],
            }},
        ]})
    };
    let passed = ["model", "engine", "device"];
    let set = |name: &str, value: Value| json!({"name": name, "value": value});
    let mut parameters = vec![set("cameras", json!(namespaces)), set("input", json!("recovered"))];
    parameters.extend(passed.map(|name| set(name, json!(format!("$(var {name})")))));
    let node = json!({"pkg": "modulo", "exec": "detector", "name": "detector", "param": parameters});
    let mut entities: Vec<Value> = passed.map(|name| json!({"arg": {"name": name}})).into();
    entities.push(json!({"node": node}));
    entities.extend(namespaces.iter().map(include));
    // JSON is YAML.
    json!({"launch": entities}).to_string()
}

/// The lines of the traces in a folder.
fn traces(folder: &Path) -> anyhow::Result<Vec<Vec<Value>>> {
    let files = fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    let files =
        files.iter().map(|file| file.path()).filter(|path| path.extension().is_some_and(|e| e == "trace"));
    let lines = |path: PathBuf| {
        let text = fs::read_to_string(&path)?;
        text.lines()
            .map(serde_json::from_str)
            .collect::<Result<_, _>>()
            .with_context(|| path.display().to_string())
    };
    files.map(lines).collect()
}
