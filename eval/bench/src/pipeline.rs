//! `bench pipeline`: the time of a frame from its modulo image to its boxes, beside the time of the network by itself.
//!
//! Each mode is a run of this program of its own, and the traces of its nodes give the times. The network is measured before and
//! after each run, so that a machine that becomes slower becomes slower for both.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::Args;
use modulo_core::metric::quantile;
use serde::{Deserialize, Serialize};

use crate::{BenchError, BenchEvent, make_folder, read_json, write_json};

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";

/// The first frames of a run, which fill caches and make buffers; they are not counted.
const WARM_UP: usize = 5;
/// Time between two looks at the memory of a run.
const GLANCE: Duration = Duration::from_millis(50);
/// Clock ticks per second in `/proc/PID/stat`, which Linux fixes for all programs.
const TICKS: f64 = 100.0;
/// The ROS domain of the runs. It is neither the default of a suite nor a domain of a test.
const DOMAIN: &str = "96";

/// The settings of a benchmark of the pipeline, as options of a command line.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct PipelineRequest {
    /// Source of the frames, as the parameter `source` of the camera takes it
    #[arg(long, value_name = "SOURCE", default_value = "scene://tunnel?seed=3&width=1242&height=375")]
    pub frames: String,
    /// YOLOv10 model in ONNX format, or demo: the embedded demonstration
    #[arg(long, default_value = "demo")]
    pub model: String,
    /// Inference engine: ONNX Runtime (ort), rten, or auto for ONNX Runtime where its library is found, and rten elsewhere
    #[arg(long, default_value = "auto", value_parser = ["auto", "ort", "rten"])]
    pub engine: String,
    /// Saturation factor: brightest radiance divided by the peak of the sensor
    #[arg(long, default_value_t = 4.0)]
    pub alpha: f64,
    /// Standard deviation of the lens blur in px. 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    pub psf_sigma: f64,
    /// Number of frames of each run
    #[arg(long, default_value_t = 100)]
    pub count: usize,
    /// Frames per second. 0: the next frame as soon as the last one was taken, so that the camera works beside the network
    #[arg(long, default_value_t = 10.0)]
    pub rate: f64,
    /// Folder for results.json
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// The way in which the nodes run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Node after node on the same thread, by function calls.
    Lockstep,
    /// All nodes in one process.
    Composed,
    /// Each node in a process of its own; images in shared memory.
    Live,
}

/// The durations of one mode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PipelineRow {
    /// The way in which the nodes run.
    pub mode: Mode,
    /// The inference engine that ran.
    pub engine: String,
    /// Number of frames that were counted.
    pub frames: usize,
    /// Median time from the arrival of a modulo image at the unwrap node to the end of its boxes' sending, ms.
    pub p50_ms: f64,
    /// The 99th percentile of this time, ms.
    pub p99_ms: f64,
    /// Time of the network by itself on a tensor that is ready, ms: the mean of its medians before and after the run.
    pub bare_p50_ms: f64,
    /// Processor time of the whole run, its start and the simulated sensor included, over the number of frames, s.
    pub cpu_s_per_frame: f64,
    /// Largest resident memory of the process of the detector, MB.
    pub rss_mb: f64,
    /// Median duration by stage, ms.
    pub stage_ms: BTreeMap<String, f64>,
}

/// Runs all modes of `launch_file` with `program`, which is this program, and writes the results. `bare` returns the median
/// time in ms of the network by itself.
///
/// # Errors
/// [`BenchError`] when a run fails, its files cannot be read, or `bare` fails.
pub fn pipeline(
    request: &PipelineRequest,
    (program, launch_file): (&Path, &Path),
    bare: &mut dyn FnMut() -> Result<f64, BenchError>,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<Vec<PipelineRow>, BenchError> {
    if request.count == 0 {
        let possible = "at least 1";
        return Err(BenchError::Number { what: "count", value: 0, possible });
    }
    make_folder(&request.out)?;
    let modes = [(Mode::Lockstep, "lockstep"), (Mode::Composed, "composed"), (Mode::Live, "live")];
    let mut rows: Vec<PipelineRow> = Vec::new();
    let mut before = bare()?;
    for (done, (mode, next)) in modes.into_iter().enumerate() {
        tell(BenchEvent::Step { done, total: modes.len(), next });
        let mut row = run(request, (program, launch_file), mode)?;
        let after = bare()?;
        row.bare_p50_ms = f64::midpoint(before, after);
        before = after;
        rows.push(row);
    }
    write_json(&request.out.join(RESULTS), &rows)?;
    Ok(rows)
}

/// Runs one mode.
fn run(
    request: &PipelineRequest,
    (program, launch_file): (&Path, &Path),
    mode: Mode,
) -> Result<PipelineRow, BenchError> {
    let temporary = tempfile::tempdir().map_err(|why| BenchError::Io(std::env::temp_dir(), why))?;
    let folder = temporary.path().to_owned();
    let cpu = children_cpu_s();
    let log = fs::File::create(folder.join("log.txt")).map_err(|why| BenchError::Io(folder.clone(), why))?;
    let errors = log.try_clone().map_err(|why| BenchError::Io(folder.clone(), why))?;
    let mut command = Command::new(program);
    command
        .arg(command_of(mode))
        .arg(launch_file)
        .args(arguments(request, mode, &folder))
        .stdin(Stdio::null())
        .stdout(log)
        .stderr(errors);
    command.env("MODULO_TRACE_DIR", &folder).env("ROS_DOMAIN_ID", DOMAIN);
    command.env("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=true");
    let mut child = command.spawn().map_err(|why| BenchError::Io(program.to_owned(), why))?;
    let (success, rss_mb) = watch(&mut child, mode).map_err(|why| BenchError::Io(program.to_owned(), why))?;
    if !success {
        let log = fs::read_to_string(folder.join("log.txt")).unwrap_or_else(|why| why.to_string());
        return Err(BenchError::Run(format!("the run failed: {}", log.trim())));
    }
    let cpu_s = children_cpu_s() - cpu;
    let engine = read_json::<RunSummary>(&folder.join("summary.json"))?.engine;
    let engine = engine.ok_or_else(|| BenchError::Run("no detector told its engine".to_owned()))?;
    let Times { mut total, stages } = times(&folder)?;
    total.sort_by(f64::total_cmp);
    if total.is_empty() {
        let why = format!("no frame was answered after the first {WARM_UP}; choose a larger --count");
        return Err(BenchError::Run(why));
    }
    let at = |values: &[f64], share| quantile(values, share).expect("there is a value");
    let stage_ms = stages.into_iter().map(|(name, mut values)| {
        values.sort_by(f64::total_cmp);
        (name, at(&values, 0.5))
    });
    Ok(PipelineRow {
        mode,
        engine,
        frames: total.len(),
        p50_ms: at(&total, 0.5),
        p99_ms: at(&total, 0.99),
        bare_p50_ms: 0.0,
        cpu_s_per_frame: cpu_s / request.count as f64,
        rss_mb,
        stage_ms: stage_ms.collect(),
    })
}

fn command_of(mode: Mode) -> &'static str {
    match mode {
        Mode::Lockstep => "eval",
        Mode::Composed | Mode::Live => "launch",
    }
}

/// The arguments of a run that leaves its summary in `folder`.
fn arguments(request: &PipelineRequest, mode: Mode, folder: &Path) -> Vec<OsString> {
    let PipelineRequest { frames, model, engine, alpha, psf_sigma, count, rate, .. } = request;
    let mut arguments: Vec<OsString> = [
        format!("source:={frames}"),
        format!("frames:={count}"),
        "loop:=true".to_owned(),
        format!("rate:={rate:?}"),
        format!("model:={model}"),
        format!("engine:={engine}"),
        format!("alpha:={alpha:?}"),
        format!("psf_sigma:={psf_sigma:?}"),
    ]
    .map(OsString::from)
    .into();
    match mode {
        Mode::Lockstep => arguments.extend(["-o".into(), folder.into()]),
        Mode::Composed | Mode::Live => {
            arguments.extend(["--summary".into(), folder.join("summary.json").into()]);
        }
    }
    arguments.extend((mode == Mode::Composed).then(|| "--compose".into()));
    arguments
}

/// The part of the summary of a run that is used here.
#[derive(Deserialize)]
struct RunSummary {
    engine: Option<String>,
}

/// Waits for the end of a run; returns whether it succeeded, and the largest resident memory of its detector, MB.
fn watch(child: &mut Child, mode: Mode) -> std::io::Result<(bool, f64)> {
    let mut rss_mb = 0.0;
    loop {
        let process = if mode == Mode::Live { detector_of(child.id()) } else { Some(child.id()) };
        // The largest value so far is kept by the system; a process that has just ended has none.
        rss_mb = process.and_then(peak_rss_mb).unwrap_or(rss_mb);
        if let Some(status) = child.try_wait()? {
            return Ok((status.success(), rss_mb));
        }
        thread::sleep(GLANCE);
    }
}

/// Returns the process of the detector among the children of `launcher`.
fn detector_of(launcher: u32) -> Option<u32> {
    let tasks = fs::read_dir(format!("/proc/{launcher}/task")).ok()?;
    let children = tasks.flatten().filter_map(|task| fs::read_to_string(task.path().join("children")).ok());
    let children: Vec<u32> = children
        .flat_map(|text| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
        .filter_map(|pid| pid.parse().ok())
        .collect();
    children.into_iter().find(|pid| {
        let arguments = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        arguments.split(|&byte| byte == 0).nth(2) == Some(b"detector")
    })
}

fn peak_rss_mb(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kb| kb / 1000.0)
}

/// Returns the processor time of all processes that this one has waited for, and of theirs, s.
fn children_cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").expect("Linux has this file for each process");
    // The name of the program, which may hold spaces, ends at the last bracket.
    let fields = stat.rsplit_once(") ").map_or("", |(_, fields)| fields);
    let ticks = fields.split(' ').skip(13).take(2).filter_map(|field| field.parse::<f64>().ok());
    ticks.sum::<f64>() / TICKS
}

/// The durations of a run, ms.
#[derive(Default)]
struct Times {
    /// From the arrival of each modulo image to the end of its boxes' sending.
    total: Vec<f64>,
    /// The durations of each stage of unwrap and detector, one for each frame.
    stages: BTreeMap<String, Vec<f64>>,
}

/// A line of a trace. Only spans have all fields.
#[derive(Deserialize)]
struct TraceLine {
    name: Option<String>,
    ts: Option<f64>,
    dur: Option<f64>,
    args: Option<SpanArguments>,
}

#[derive(Deserialize)]
struct SpanArguments {
    frame: Option<String>,
}

/// Reads the traces in `folder`, and leaves out the first frames.
fn times(folder: &Path) -> Result<Times, BenchError> {
    let mut frames = BTreeMap::<String, [Option<f64>; 2]>::new();
    let mut spans = Vec::new();
    for (place, node) in ["unwrap", "detector"].into_iter().enumerate() {
        for TraceLine { name, ts, dur, args, .. } in trace(folder, node)? {
            let (Some(name), Some(ts), Some(dur)) = (name, ts, dur) else { continue };
            let Some(frame) = args.and_then(|arguments| arguments.frame) else { continue };
            let [begin, end] = frames.entry(frame.clone()).or_default();
            if place == 0 {
                *begin = Some(begin.map_or(ts, |begin| begin.min(ts)));
            } else {
                *end = Some(end.map_or(ts + dur, |end| end.max(ts + dur)));
            }
            // The span of the whole step contains those of its stages.
            if name != "step" {
                spans.push((frame, format!("{node} {name}"), dur / 1e3));
            }
        }
    }
    // Names of frames are stamps in ns, whose order as texts is that of time.
    let counted: BTreeMap<_, _> = frames
        .into_iter()
        .filter_map(|(frame, times)| Some((frame, (times[1]? - times[0]?) / 1e3)))
        .skip(WARM_UP)
        .collect();
    let mut stages = BTreeMap::<String, Vec<f64>>::new();
    for (_, name, ms) in spans.into_iter().filter(|(frame, ..)| counted.contains_key(frame)) {
        stages.entry(name).or_default().push(ms);
    }
    Ok(Times { total: counted.into_values().collect(), stages })
}

/// Reads the lines of the trace of a node.
fn trace(folder: &Path, node: &str) -> Result<Vec<TraceLine>, BenchError> {
    let failed = |why| BenchError::Io(folder.to_owned(), why);
    let mut lines = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().expect("an entry of a folder has a name").to_string_lossy().into_owned();
        if !(name.starts_with(node) && name.ends_with(".trace")) {
            continue;
        }
        for line in fs::read_to_string(&path).map_err(failed)?.lines() {
            lines.push(serde_json::from_str(line).map_err(|why| BenchError::Json(path.clone(), why))?);
        }
    }
    Ok(lines)
}
