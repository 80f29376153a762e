//! `bench pipeline`: the time of a frame from its modulo image to its boxes, beside the time of the network by itself.
//!
//! Each mode is a run of this program of its own, and the traces of its nodes give the times. The network is measured after each
//! run.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::Args;
use modulo_runtime::output::ResultFolder;
use serde::Serialize;
use serde_json::Value;

use crate::{BenchError, BenchEvent, RESULTS, quantile, read_json, write_json};

/// Number of turns that the modes take, so that a machine that becomes slower becomes slower for all of them.
const ROUNDS: usize = 4;
/// The first frames of a run, which fill caches and make buffers; they are not counted.
const WARM_UP: usize = 5;
/// Time between two looks at the memory of a run.
const GLANCE: Duration = Duration::from_millis(200);
/// Clock ticks per second in `/proc/PID/stat`, which Linux fixes for all programs.
const TICKS: f64 = 100.0;

/// The settings of a benchmark of the pipeline, as options of a command line.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct PipelineRequest {
    /// Source of the frames, as the parameter `source` of the camera takes it
    #[arg(long, value_name = "SOURCE", default_value = "scene://tunnel?seed=3&width=1242&height=375")]
    pub frames: String,
    /// YOLO model in ONNX format, or demo: the embedded demonstration
    #[arg(long, default_value = "demo")]
    pub model: String,
    /// Saturation factor: brightest radiance divided by the peak of the sensor
    #[arg(long, default_value_t = 4.0)]
    pub alpha: f64,
    /// Standard deviation of the lens blur in px. 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    pub psf_sigma: f64,
    /// Number of frames of each mode
    #[arg(long, default_value_t = 100)]
    pub count: usize,
    /// Folder for results.json; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Inference engine: ONNX Runtime (ort), ONNX Runtime with OpenVINO (openvino, or openvino_f32 with 32 bits), rten, or auto
    /// for ort where its library is found, and rten elsewhere
    #[arg(long, default_value = "auto", value_parser = ["auto", "ort", "openvino", "openvino_f32", "rten"])]
    pub engine: String,
    /// Device that runs the model: cpu, cuda or tensorrt, the last two with the number of a GPU where it is not the first
    #[arg(long, default_value = "cpu")]
    pub device: String,
    /// Frames per second. 0: the next frame as soon as the last one was taken, so that the camera works beside the network
    #[arg(long, default_value_t = 10.0)]
    pub rate: f64,
}

/// The way in which the nodes run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
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
    /// Frames answered per second, from the first counted frame of a run to its last one.
    pub frames_per_s: f64,
    /// Median time from the arrival of a modulo image at the unwrap node to the end of its boxes' sending, ms.
    pub p50_ms: f64,
    /// The 99th percentile of this time, ms.
    pub p99_ms: f64,
    /// Median time of the network by itself on a tensor that is ready, ms, measured after each run at the same pace: a processor
    /// that was idle in between is slower.
    pub bare_p50_ms: f64,
    /// Time from the start of the program to the end of the sending of its first boxes, s: that of the slowest run.
    pub first_box_s: Option<f64>,
    /// Processor time of the whole run, its start and the simulated sensor included, over the number of frames, s.
    pub cpu_s_per_frame: f64,
    /// Largest resident memory of the process of the detector, MB.
    pub rss_mb: f64,
    /// Median duration by stage, ms.
    pub stage_ms: BTreeMap<String, f64>,
}

/// The program under test, and the bare network beside which it runs.
pub struct PipelineBench<'a> {
    /// Path of this program.
    pub program: &'a Path,
    /// The launch file of its suite.
    pub launch_file: &'a Path,
    /// The ROS domain of the runs, which nobody else uses.
    pub domain: u32,
    /// Returns the ticks of the clock of the traces, ns.
    pub now_ns: fn() -> u64,
    /// Returns durations of the network by itself on a tensor that is ready, ms, with a run in each period.
    pub bare: &'a mut dyn FnMut(Duration) -> Result<Vec<f64>, BenchError>,
}

/// Runs all modes by turns, and writes the results.
///
/// # Errors
/// [`BenchError`] when a run fails, its files cannot be read, or `bare` fails.
pub fn pipeline(
    request: &PipelineRequest,
    bench: &mut PipelineBench<'_>,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<Vec<PipelineRow>, BenchError> {
    let PipelineRequest { count, rate, out, .. } = request;
    if *count < ROUNDS {
        let possible = "at least 4, the number of turns";
        return Err(BenchError::number("count", *count, possible));
    }
    if *rate > 0.0 {
        check_count(*count, *rate, quantile((bench.bare)(Duration::ZERO)?, 0.5))?;
    }
    let out = ResultFolder::take(out.as_deref(), "pipeline", None)?;
    let frames = frames_of_run(*count);
    let modes = [(Mode::Composed, "composed"), (Mode::Live, "live")];
    let mut runs = modes.map(|_| Vec::new());
    for round in 0..ROUNDS {
        for (place, (mode, next)) in modes.into_iter().enumerate() {
            tell(BenchEvent::Step { done: round * modes.len() + place, total: ROUNDS * modes.len(), next });
            let folder = temporary_folder()?;
            let mut run = run(request, mode, frames, bench, folder.path())?;
            if run.times.frames.is_empty() {
                return Err(BenchError::Run(format!(
                    "the mode {next} answered no more than the first {WARM_UP} of {frames} frames, which are not counted; choose a larger \
                     --count, or --rate 0, with which no frame is replaced"
                )));
            }
            run.bare_ms = (bench.bare)(period(*rate))?;
            runs[place].push(run);
        }
    }
    let rows = modes.iter().zip(runs).map(|(&(mode, _), runs)| row(mode, runs));
    let rows = rows.collect::<Result<Vec<_>, _>>()?;
    write_json(&out.path().join(RESULTS), &rows)?;
    Ok(rows)
}

/// Returns the number of frames of a run, of which there are [`ROUNDS`] in each mode.
fn frames_of_run(count: usize) -> usize {
    count.div_ceil(ROUNDS) + WARM_UP
}

/// Refuses a number of frames of which a network that takes `bare_ms` would answer only those that are not counted: with `rate` frames per
/// second, a frame that comes while it works is replaced by the next one.
fn check_count(count: usize, rate: f64, bare_ms: f64) -> Result<(), BenchError> {
    let frames_of_answer = (bare_ms * rate / 1e3).max(1.0);
    let needed = (WARM_UP as f64 + 1.0) * frames_of_answer;
    if frames_of_run(count) as f64 >= needed {
        return Ok(());
    }
    // Twice as many, since the pipeline takes longer than the network.
    let enough = (2.0 * needed).ceil() as usize * ROUNDS;
    Err(BenchError::Request(format!(
        "--count {count} is too small with --rate {rate}: the network takes {bare_ms:.0} ms, so that most frames are replaced by newer \
         ones, and the first {WARM_UP} answers of a run are not counted; give --count {enough}, or --rate 0, with which no frame is replaced"
    )))
}

/// The time between two frames; zero where the next frame comes when the last one is done.
fn period(rate: f64) -> Duration {
    if rate > 0.0 { Duration::from_secs_f64(rate.recip()) } else { Duration::ZERO }
}

/// One run of one mode, and the network by itself right after it.
struct ModeRun {
    engine: String,
    times: Times,
    bare_ms: Vec<f64>,
    first_box_s: Option<f64>,
    cpu_s_per_frame: f64,
    rss_mb: f64,
}

pub(crate) fn temporary_folder() -> Result<tempfile::TempDir, BenchError> {
    tempfile::tempdir().map_err(|why| BenchError::Io(std::env::temp_dir(), why))
}

/// Joins the runs of one mode; there is at least one.
fn row(mode: Mode, runs: Vec<ModeRun>) -> Result<PipelineRow, BenchError> {
    let count = runs.len() as f64;
    let mean = |value: fn(&ModeRun) -> f64| runs.iter().map(value).sum::<f64>() / count;
    let total = || runs.iter().flat_map(|run| run.times.total());
    let mut stages = BTreeMap::<String, Vec<f64>>::new();
    for (name, durations) in runs.iter().flat_map(|run| &run.times.stages) {
        stages.entry(name.clone()).or_default().extend(durations);
    }
    Ok(PipelineRow {
        mode,
        engine: runs[0].engine.clone(),
        frames: total().count(),
        frames_per_s: mean(|run| run.times.frames_per_s()),
        p50_ms: quantile(total(), 0.5),
        p99_ms: quantile(total(), 0.99),
        bare_p50_ms: quantile(runs.iter().flat_map(|run| run.bare_ms.iter().copied()), 0.5),
        first_box_s: runs.iter().filter_map(|run| run.first_box_s).reduce(f64::max),
        cpu_s_per_frame: mean(|run| run.cpu_s_per_frame),
        rss_mb: runs.iter().map(|run| run.rss_mb).fold(0.0, f64::max),
        stage_ms: stages.into_iter().map(|(name, values)| (name, quantile(values, 0.5))).collect(),
    })
}

/// Runs the suite on `frames` frames of its source, and leaves the files of the run in `folder`.
fn run(
    request: &PipelineRequest,
    mode: Mode,
    frames: usize,
    bench: &PipelineBench<'_>,
    folder: &Path,
) -> Result<ModeRun, BenchError> {
    let cpu = children_cpu_s();
    let log = fs::File::create(folder.join("log.txt")).map_err(|why| BenchError::Io(folder.into(), why))?;
    let errors = log.try_clone().map_err(|why| BenchError::Io(folder.into(), why))?;
    let results = folder.join("results");
    fs::create_dir(&results).map_err(|why| BenchError::Io(results.clone(), why))?;
    let mut command = Command::new(bench.program);
    command.arg("launch").arg(bench.launch_file).args(arguments(request, mode, frames, &results));
    command.stdin(Stdio::null()).stdout(log).stderr(errors);
    command.env("MODULO_TRACE_DIR", folder).env("ROS_DOMAIN_ID", bench.domain.to_string());
    command.env("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=true");
    let start_ms = (bench.now_ns)() as f64 / 1e6;
    let failed = |why| BenchError::Io(bench.program.to_owned(), why);
    let mut child = command.spawn().map_err(failed)?;
    let (success, rss_mb) = watch(&mut child, mode).map_err(failed)?;
    if !success {
        let log = fs::read_to_string(folder.join("log.txt")).unwrap_or_else(|why| why.to_string());
        return Err(BenchError::Run(format!("the run failed: {}", log.trim())));
    }
    let cpu_s = children_cpu_s() - cpu;
    let summary: Value = read_json(&results.join("summary.json"))?;
    let engine = summary["engine"].as_str();
    let engine = engine.ok_or_else(|| BenchError::Run("no detector told its engine".to_owned()))?;
    let times = times(folder)?;
    Ok(ModeRun {
        engine: engine.to_owned(),
        first_box_s: times.first_end_ms.map(|end| (end - start_ms) / 1e3),
        times,
        bare_ms: Vec::new(),
        cpu_s_per_frame: cpu_s / frames as f64,
        rss_mb,
    })
}

/// The arguments of a run that leaves its summary in `folder`.
fn arguments(request: &PipelineRequest, mode: Mode, count: usize, folder: &Path) -> Vec<OsString> {
    let PipelineRequest { frames, model, alpha, psf_sigma, engine, device, rate, .. } = request;
    let mut arguments: Vec<OsString> = [
        format!("source:={frames}"),
        format!("frames:={count}"),
        "loop:=true".to_owned(),
        format!("rate:={rate:?}"),
        format!("model:={model}"),
        format!("engine:={engine}"),
        format!("device:={device}"),
        format!("alpha:={alpha:?}"),
        format!("psf_sigma:={psf_sigma:?}"),
    ]
    .map(OsString::from)
    .into();
    arguments.extend(["--summary".into(), folder.join("summary.json").into()]);
    arguments.extend((mode == Mode::Composed).then(|| "--compose".into()));
    arguments
}

/// Waits for the end of a run; returns whether it succeeded, and the largest resident memory of its detector, MB.
pub(crate) fn watch(child: &mut Child, mode: Mode) -> std::io::Result<(bool, f64)> {
    let (mut rss_mb, mut process) = (0.0, (mode != Mode::Live).then_some(child.id()));
    loop {
        // Found once, since each look at the processes takes time from them.
        process = process.or_else(|| detector_of(child.id()));
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
    // A space follows each number.
    let children: String =
        tasks.flatten().filter_map(|task| fs::read_to_string(task.path().join("children")).ok()).collect();
    children.split_whitespace().filter_map(|pid| pid.parse().ok()).find(|pid| {
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

#[derive(Default)]
struct Times {
    /// The arrival of each counted modulo image, and the end of its boxes' sending.
    frames: Vec<(f64, f64)>,
    /// The end of the sending of the first boxes.
    first_end_ms: Option<f64>,
    /// The durations of each stage of unwrap and detector, one for each counted frame.
    stages: BTreeMap<String, Vec<f64>>,
}

impl Times {
    fn total(&self) -> impl Iterator<Item = f64> {
        self.frames.iter().map(|(begin, end)| end - begin)
    }

    fn frames_per_s(&self) -> f64 {
        let ends = || self.frames.iter().map(|&(_, end)| end);
        match (ends().reduce(f64::min), ends().reduce(f64::max)) {
            (Some(first), Some(last)) if last > first => {
                1e3 * (self.frames.len() - 1) as f64 / (last - first)
            }
            _ => 0.0,
        }
    }
}

/// Reads the traces in `folder`, and leaves out the first frames.
fn times(folder: &Path) -> Result<Times, BenchError> {
    let mut frames = BTreeMap::<String, [Option<f64>; 2]>::new();
    let mut spans = Vec::new();
    for (place, node) in ["unwrap", "detector"].into_iter().enumerate() {
        for line in trace(folder, node)? {
            // Only spans have all fields.
            let (name, frame) = (line["name"].as_str(), line["args"]["frame"].as_str());
            let (ts, dur) = (line["ts"].as_f64(), line["dur"].as_f64());
            let (Some(name), Some(frame), Some(ts), Some(dur)) = (name, frame, ts, dur) else { continue };
            let [begin, end] = frames.entry(frame.to_owned()).or_default();
            if place == 0 {
                *begin = Some(begin.map_or(ts, |begin| begin.min(ts)));
            } else {
                *end = Some(end.map_or(ts + dur, |end| end.max(ts + dur)));
            }
            // The span of the whole step contains those of its stages.
            if name != "step" {
                spans.push((frame.to_owned(), format!("{node} {name}"), dur / 1e3));
            }
        }
    }
    let ends = frames.values().filter_map(|times| times[1]);
    let first_end_ms = ends.reduce(f64::min).map(|end| end / 1e3);
    // Names of frames are stamps in ns, whose order as texts is that of time.
    let counted: BTreeMap<_, _> = frames
        .into_iter()
        .filter_map(|(frame, [begin, end])| Some((frame, (begin? / 1e3, end? / 1e3))))
        .skip(WARM_UP)
        .collect();
    let mut stages = BTreeMap::<String, Vec<f64>>::new();
    for (_, name, ms) in spans.into_iter().filter(|(frame, ..)| counted.contains_key(frame)) {
        stages.entry(name).or_default().push(ms);
    }
    Ok(Times { frames: counted.into_values().collect(), first_end_ms, stages })
}

fn trace(folder: &Path, node: &str) -> Result<Vec<Value>, BenchError> {
    let failed = |why| BenchError::Io(folder.to_owned(), why);
    let mut lines = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().expect("an entry of a folder has a name").to_string_lossy().into_owned();
        if !(name.starts_with(node) && name.ends_with(".trace")) {
            continue;
        }
        for line in fs::read_to_string(&path).map_err(failed)?.lines() {
            lines.push(serde_json::from_str(line).map_err(|why| BenchError::Io(path.clone(), why.into()))?);
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_of_which_no_answer_would_be_counted_is_refused_with_a_sufficient_one() {
        // A run of 8 frames at 10 Hz lasts 0.8 s: time for 8 answers of 50 ms, and for 2 of 400 ms.
        check_count(10, 10.0, 50.0).expect("enough");
        let why = check_count(10, 10.0, 400.0).expect_err("too few").to_string();
        assert!(why.contains("--count 10") && why.contains("400 ms") && why.contains("--count 192"), "{why}");
        check_count(192, 10.0, 400.0).expect("the remedy holds");
    }
}
