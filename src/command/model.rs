//! `modulo model`: fetch an official export or ONNX Runtime, check any model. `modulo doctor`: the engine, ffmpeg, the transport and the environment on
//! this machine; it changes nothing, and ends with exit code 0, since a person judges the result, unless it cannot read a file that it is given.

use std::net::TcpListener;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Subcommand};
use indicatif::ProgressBar;
use modulo_bags::source::{BagSource, SourceOptions};
use modulo_camera::CameraParameters;
use modulo_core::unwrap::{Method, Options, WORK_OF_NOISE};
use modulo_core::{Frame, Range, Recovered, ResetRamp, Resets};
use modulo_detector::{
    CudnnSearch, EngineChoice, EngineDevice, EngineOptions, ModelInfo, Speed, describe, gpu_libraries, gpus,
    onnxruntime_library, onnxruntime_places,
};
use modulo_eval::score::words;
use modulo_middleware::transport::zenoh::meeting_port;
use modulo_models::{FetchError, FetchRequest, Fetched, LICENCE, Wheel, fetch, official};
use modulo_runtime::output::prepare_folder;
use modulo_runtime::{Clock as _, SensorModel, SystemClock};
use modulo_unwrap::UnwrapParameters;
use ndarray::Array3;
use serde_json::json;

use super::launch::quoted;
use super::progress::style;
use super::{domain, start_log, this_program, usage};
use crate::{Ended, Failure};

/// Class names that are shown.
const SHOWN: usize = 8;

#[derive(Subcommand)]
pub enum Model {
    /// Download an official YOLOv10 export, checked by sha256 (weights: AGPL-3.0)
    Fetch(ModelFetch),
    /// Download ONNX Runtime, the faster inference engine, checked by sha256, and put its library where this program finds it
    Runtime(ModelRuntime),
    /// Print the input, output, engine and speed of a model
    Check(ModelCheck),
}

#[derive(Args)]
pub struct ModelFetch {
    /// Name of the export: yolov10n, yolov10s, yolov10m, yolov10b, yolov10l or yolov10x
    pub name: String,
    /// Folder for the file NAME.onnx
    #[arg(short, long, value_name = "FOLDER", default_value = "./")]
    pub out: PathBuf,
    /// Another URL of the file, such as that of a mirror
    #[arg(long)]
    pub url: Option<String>,
    /// Expected sha256 of the file, in place of the known one
    #[arg(long, value_name = "HEX")]
    pub sha256: Option<String>,
}

#[derive(Args)]
pub struct ModelRuntime {
    /// What ONNX Runtime computes with: the processor (cpu), also OpenVINO's kernels for it (openvino), or also CUDA and TensorRT (gpu), whose
    /// own libraries must be there already
    #[arg(long, default_value = "cpu", value_parser = ["cpu", "openvino", "gpu"])]
    pub build: String,
    /// Folder for the libraries; without it the folder of this program
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Another URL of the wheel, such as that of a mirror
    #[arg(long)]
    pub url: Option<String>,
}

#[derive(Args)]
pub struct ModelCheck {
    /// Path of the ONNX file
    pub file: PathBuf,
    /// Inference engine: ONNX Runtime (ort), ONNX Runtime with OpenVINO (openvino, or openvino_f32 with 32 bits), rten, or auto
    /// for ort where its library is found, and rten elsewhere
    #[arg(long, default_value = "auto", value_parser = words(EngineChoice::WORDS))]
    pub engine: EngineChoice,
    /// Device that runs the model: cpu, cuda or tensorrt, the last two with the number of a GPU where it is not the first
    #[arg(long, default_value = "cpu")]
    pub device: EngineDevice,
    /// Print it as JSON
    #[arg(long)]
    pub json: bool,
}

pub fn model(args: &Model) -> Result<Ended, Failure> {
    start_log("warn");
    match args {
        Model::Fetch(args) => fetch_official(args),
        Model::Runtime(args) => fetch_runtime(args),
        Model::Check(args) => check(args),
    }
}

fn fetch_official(args: &ModelFetch) -> Result<Ended, Failure> {
    let (url, bytes, sha256) = official(&args.name, args.sha256.as_deref()).map_err(usage)?;
    let url = args.url.as_ref().unwrap_or(&url);
    let file = args.out.join(format!("{}.onnx", args.name));
    note!("{}: the weights are licensed {LICENCE} by their authors, not as this program", args.name);
    match download(&FetchRequest { url, file: &file, sha256, bytes })? {
        Fetched::Downloaded => say!("{}", file.display()),
        Fetched::AlreadyThere => say!("{} (was there already)", file.display()),
    }
    Ok(Ended::Done)
}

/// Puts the libraries of ONNX Runtime into a folder.
fn fetch_runtime(args: &ModelRuntime) -> Result<Ended, Failure> {
    let wheel = Wheel::find(&args.build, std::env::consts::ARCH).map_err(usage)?;
    let folder = match &args.out {
        Some(folder) => folder.clone(),
        None => this_program()?.parent().context("the program lies in no folder")?.to_owned(),
    };
    prepare_folder(&folder).context("--out FOLDER names another folder").map_err(usage)?;
    let (file, url) = (folder.join(wheel.file_name()), args.url.as_deref().unwrap_or(wheel.url));
    let fetched = download(&FetchRequest { url, file: &file, sha256: wheel.sha256, bytes: None })?;
    let library = wheel.unpack(&file, &folder)?.canonicalize().context("the new library")?;
    // A wheel that the user has copied here belongs to the user.
    if fetched == Fetched::Downloaded {
        std::fs::remove_file(&file).context(file.display().to_string())?;
    }
    match args.out {
        Some(_) => say!("export ORT_DYLIB_PATH={}", quoted(&library.display().to_string())),
        None => say!("{}", library.display()),
    }
    Ok(Ended::Done)
}

/// Fetches a file with a bar that shows how far it is, on a terminal only.
fn download(request: &FetchRequest<'_>) -> Result<Fetched, FetchError> {
    let bar = ProgressBar::no_length();
    bar.set_style(style("{wide_bar} {bytes}/{total_bytes} {bytes_per_sec} {eta}"));
    let progress = |got, total: Option<u64>| {
        if let Some(total) = total {
            bar.set_length(total);
        }
        bar.set_position(got);
    };
    let fetched = fetch(request, &progress);
    bar.finish_and_clear();
    fetched
}

fn check(args: &ModelCheck) -> Result<Ended, Failure> {
    let options = EngineOptions {
        engine: args.engine,
        device: args.device,
        cudnn_search: CudnnSearch::Heuristic,
        threads: 0,
    };
    let mut info = describe(&args.file, options).map_err(usage)?;
    let ms = |speed: &Speed| speed.median_ns as f64 / 1e6;
    if args.json {
        let speed =
            |speed: &Speed| json!({"height": speed.height, "width": speed.width, "median_ms": ms(speed)});
        let speeds: Vec<_> = info.measure(&SystemClock::default())?.iter().map(speed).collect();
        say!(
            "{}",
            json!({
                "model": args.file, "input": info.input, "size": info.size, "output": info.output, "form": info.form, "classes": info.classes,
                "engine": info.engine, "note": info.note, "threads": info.threads, "speed": speeds
            })
        );
        return Ok(Ended::Done);
    }
    print_info(&args.file, &info);
    for speed in info.measure(&SystemClock::default())? {
        let (ms, runs) = (ms(&speed), ModelInfo::RUNS);
        say!("speed    {ms:.1} ms at {}x{}, median of {runs} runs", speed.width, speed.height);
    }
    Ok(Ended::Done)
}

fn print_info(file: &Path, info: &ModelInfo) {
    let (height, width) =
        info.size.map_or(("H".into(), "W".into()), |(height, width)| (height.to_string(), width.to_string()));
    let names = info.classes.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = if info.classes.len() > SHOWN { ", ..." } else { "" };
    say!("model    {}", file.display());
    say!("input    {} [1, 3, {height}, {width}]", info.input);
    say!("output   {} {}", info.output, info.form);
    say!("classes  {}: {names}{more}", info.classes.len());
    say!("engine   {} ({}), {} threads", info.engine, info.note, info.threads);
}

/// Environment variables that change how sessions meet.
const ZENOH_VARIABLES: [&str; 2] = ["ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"];

/// Prints the found and missing parts of the environment, a remedy for each missing one, what to expect of the sensor that the file
/// at `sensor` describes, and how the pixels of the bag `ramp` reset themselves.
pub fn doctor(sensor: Option<&Path>, ramp: Option<&Path>, json: bool) -> Result<Ended, Failure> {
    let sensor = sensor.map(CameraParameters::read_sensor).transpose().map_err(usage)?;
    let range = sensor.clone().unwrap_or_default().range().map_err(usage)?;
    let peak = f64::from(range.peak());
    let resets = ramp.map(|bag| resets(bag, range).map_err(|why| why.context(bag.display().to_string())));
    let resets = resets.transpose().map_err(usage)?;
    if json {
        say!("{}", findings(sensor.as_ref(), resets.map(|resets| (resets, peak))));
        return Ok(Ended::Done);
    }
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    say!("modulo   {} on {os} {arch}", env!("CARGO_PKG_VERSION"));
    let threads = std::thread::available_parallelism().map_or(1, |threads| threads.get());
    say!("threads  {threads}");
    let budget = UnwrapParameters::default().budget;
    let here = budget * relative_work();
    say!("budget   the default budget of unwrap, {budget:.0} ms, is {here:.0} ms on one core here");
    engine();
    video();
    transport();
    if let Some(sensor) = sensor {
        match sensor.fit_up_to() {
            None => say!("sensor   of an unknown lens: nothing is known of the alpha up to which it is fit"),
            Some(alpha) => {
                say!("sensor   fit up to alpha {alpha}: nearly all counts of real pictures are found")
            }
        }
        if let Some([every, most]) = sensor.proved_up_to() {
            say!(
                "proof    every scene is decoded up to alpha {every}, and most pictures are up to alpha {most}"
            );
        }
    }
    if let Some(resets) = resets {
        print_resets(resets, peak);
    }
    Ok(Ended::Done)
}

/// Prints the resets of a chip with this peak as lines of its sensor file.
fn print_resets(Resets { modulus, loss, error, spread, samples, frames }: Resets, peak: f64) {
    say!(
        "resets   of {samples} samples, {frames:.1} frames from one to the next; as parameters of the camera:"
    );
    say!("    modulus: {:.4} # +- {:.4}", modulus / peak, error / peak);
    say!("    reset_loss: {:.2} # +- {error:.2}", loss.max(0.0));
    say!("    reset_spread: {:.4} # +- {:.4}", spread[0], spread[1]);
}

/// Measures how the pixels of a chip reset themselves, on its images `/modulo` in a bag. One that misses a frame is refused.
fn resets(bag: &Path, range: Range) -> anyhow::Result<Resets> {
    let options = SourceOptions { topic: Some("/modulo".to_owned()), ..SourceOptions::default() };
    let mut images = BagSource::open(bag, &options)?;
    if let Some(loss) = images.losses.first() {
        anyhow::bail!("a part of the ramp is lost: {loss}");
    }
    let mut ramp = ResetRamp::new(range);
    while let Some(image) = images.next_image() {
        ramp.push(&image?.pixels)?;
    }
    Ok(ramp.measured()?)
}

/// Returns what doctor finds, for JSON.
fn findings(sensor: Option<&SensorModel>, resets: Option<(Resets, f64)>) -> serde_json::Value {
    let library = onnxruntime_library().ok();
    let domain = domain().ok();
    let port = domain.map(meeting_port);
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "os": std::env::consts::OS,
        "architecture": std::env::consts::ARCH,
        "threads": std::thread::available_parallelism().map_or(1, |threads| threads.get()),
        "budget_ms": UnwrapParameters::default().budget * relative_work(),
        "engine": if library.is_some() { "ort" } else { "rten" },
        "onnxruntime": library,
        "gpus": gpus(),
        "ffmpeg": modulo_video::version().ok(),
        "domain": domain,
        "meeting_port": port,
        "meeting_port_is_free": port.map(|port| TcpListener::bind(("127.0.0.1", port)).is_ok()),
        "fit_up_to_alpha": sensor.and_then(SensorModel::fit_up_to),
        "proved_up_to_alpha": sensor.and_then(SensorModel::proved_up_to),
        "resets": resets.map(|(Resets { modulus, loss, error, spread, samples, frames }, peak)| json!({
            "modulus": [modulus / peak, error / peak], "reset_loss": [loss.max(0.0), error], "reset_spread": spread,
            "samples": samples, "frames": frames
        })),
    })
}

/// Returns how long the work takes here that the parameter `budget` of unwrap counts, as a share of what it counts.
fn relative_work() -> f64 {
    const SIDE: usize = 512;
    let mut random = 1_u32;
    let codes = Array3::from_shape_simple_fn((SIDE, SIDE, 1), || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 24) as u8
    });
    let (y, range) = (Frame::from_u8(codes).expect("an image"), Range::new(8, 4.0).expect("possible"));
    let mut method = Method::GradientTree.build(&Options::default()).expect("one thread is there");
    let (mut out, clock) = (Recovered::default(), SystemClock::default());
    // The first image takes the memory, and the faster one of the others is not disturbed.
    let times = [(); 3].map(|()| {
        let start = clock.ticks_ns();
        method.unwrap(&y, &range.into(), &mut out).expect("codes of 8 bits");
        (clock.ticks_ns() - start) as f64
    });
    times[1].min(times[2]) / (WORK_OF_NOISE * (SIDE * SIDE) as f64)
}

fn engine() {
    let library = onnxruntime_library();
    match &library {
        Ok(place) => say!("engine   auto takes ort, ONNX Runtime from {place}"),
        Err(_) => say!("engine   auto takes rten, built in; no ONNX Runtime library was found"),
    }
    say!("looked   in this order:");
    for place in onnxruntime_places() {
        let chosen = library.as_ref().is_ok_and(|library| Path::new(library) == place);
        // A bare file name is looked up by the dynamic loader in folders that this program does not know.
        let by_loader = place.parent().is_none_or(|folder| folder.as_os_str().is_empty());
        let found = match (chosen, by_loader) {
            (true, _) => "taken",
            (false, true) => "through the system's loader",
            (false, false) if place.exists() => "there, not taken",
            (false, false) => "not there",
        };
        say!("         {} ({found})", place.display());
    }
    if library.is_err() {
        say!("faster   modulo model runtime fetches this library");
    }
    gpu(library.ok().as_deref());
}

/// Prints the GPUs, and the libraries that were found for them beside the ONNX Runtime at `library`.
fn gpu(library: Option<&str>) {
    let gpus = gpus();
    if gpus.is_empty() {
        return say!("gpu      none with a driver of NVIDIA");
    }
    gpus.iter().for_each(|gpu| say!("gpu      {gpu}"));
    let libraries = library.map(|library| gpu_libraries(Path::new(library))).unwrap_or_default();
    if libraries.is_empty() {
        say!("cuda     not found beside ONNX Runtime; the system's loader is asked for it");
    }
    libraries.iter().for_each(|library| say!("cuda     {}", library.display()));
}

fn video() {
    match modulo_video::version() {
        Ok(version) => {
            say!("video    ffmpeg {version}: videos, rtsp, http and /dev/video are read")
        }
        Err(why) => {
            say!("video    none is read ({why}); install ffmpeg, such as by: apt install ffmpeg")
        }
    }
}

fn transport() {
    let number = match domain() {
        Ok(number) => number,
        Err(Failure::Usage(why) | Failure::Run(why)) => return say!("domain   {why:#}"),
    };
    let is_set = std::env::var_os("ROS_DOMAIN_ID").is_some_and(|domain| !domain.is_empty());
    let from = if is_set { "ROS_DOMAIN_ID" } else { "ROS_DOMAIN_ID is not set" };
    say!("domain   {number} ({from})");
    for name in ZENOH_VARIABLES {
        match std::env::var(name) {
            Ok(value) => say!("zenoh    {name} = {value}"),
            Err(_) => say!("zenoh    {name} is not set"),
        }
    }
    let port = meeting_port(number);
    // Only a try to listen tells whether the port is free. The socket is closed again at once.
    match TcpListener::bind(("127.0.0.1", port)) {
        Ok(_) => say!("meeting  127.0.0.1:{port} is free: the next node listens there"),
        Err(why) => {
            say!("meeting  127.0.0.1:{port} is taken, by nodes of this domain or another program ({why})")
        }
    }
}
