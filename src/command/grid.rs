//! `modulo eval` without a launch file: runs the grid over labelled frames. `modulo eval report` shows its results.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use indicatif::ProgressBar;
use modulo_bags::source::{FrameList, is_endless};
use modulo_camera::CameraParameters;
use modulo_eval::below_100;
use modulo_eval::grid::{Data, GridError, GridEvent, GridOptions, Request, detector, draw_pictures, run};
use modulo_eval::results::{Cell, Provenance, Results};
use modulo_eval::{report as page, store};
use modulo_runtime::clock::utc;
use modulo_runtime::sensor::options::CHIP;
use modulo_runtime::{Clock, SystemClock};

use super::bench::{processor, progress_bar};
use super::launch::quoted;
use super::progress::MinuteLines;
use super::usage;
use crate::{Ended, Failure};

/// The grid of `modulo eval`.
#[derive(Args)]
#[command(next_help_heading = "Grid, without FILE")]
pub struct Grid {
    /// The labelled frames.
    #[command(flatten)]
    pub labelled: LabelledFrames,
    /// Parameter file of the camera with the values of the chip and the lens, such as sensors/mosaic.yaml
    #[arg(long, value_name = "FILE", conflicts_with_all = ["file", CHIP])]
    pub sensor: Option<PathBuf>,
    /// The settings of the grid.
    #[command(flatten)]
    pub options: GridOptions,
}

/// Labelled frames in files.
#[derive(Args)]
pub struct LabelledFrames {
    /// KITTI object folder (image_2, label_2)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["sequence", "yolo", "coco", "source"])]
    pub kitti: Option<PathBuf>,
    /// Frames of --kitti to take: a file of lines FRAME [DRIVE], or `paper` for the paper's test images
    #[arg(long, value_name = "FILE", requires = "kitti")]
    pub list: Option<PathBuf>,
    /// KITTI drives with tracking labels, one folder for each drive
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with_all = ["yolo", "coco", "source"])]
    pub sequence: Vec<PathBuf>,
    /// Images with YOLO labels: a folder (subfolders images and labels, or both side by side), the data.yaml of a data set, of which val is
    /// taken, or a list of images (.txt)
    #[arg(long, value_name = "PATH", conflicts_with_all = ["coco", "source"])]
    pub yolo: Option<PathBuf>,
    /// COCO annotation file
    #[arg(long, value_name = "JSON", conflicts_with = "source")]
    pub coco: Option<PathBuf>,
    /// Folder of the images of --coco, if they are not in the usual place
    #[arg(long, value_name = "FOLDER", requires = "coco")]
    pub coco_images: Option<PathBuf>,
}

impl LabelledFrames {
    /// Returns the options of a command line that name these frames.
    pub fn options(&self) -> Vec<OsString> {
        let Self { kitti, list, sequence, yolo, coco, coco_images } = self;
        let one = [
            ("--kitti", kitti),
            ("--list", list),
            ("--yolo", yolo),
            ("--coco", coco),
            ("--coco-images", coco_images),
        ];
        let one = one.into_iter().filter_map(|(name, path)| Some((name, path.as_ref()?)));
        one.chain(sequence.iter().map(|folder| ("--sequence", folder)))
            .flat_map(|(name, path)| [name.into(), path.clone().into_os_string()])
            .collect()
    }
}

/// Runs the cells that are not finished yet.
pub fn grid(args: &Grid, source: &[String], out: &Path) -> Result<Ended, Failure> {
    let mut options = args.options.clone();
    if let Some(file) = &args.sensor {
        options.axes.sensor.take_chip(&CameraParameters::read_sensor(file).map_err(usage)?);
    }
    let request = Request {
        data: data(&args.labelled, source)?,
        options,
        provenance: provenance(),
        out: out.to_owned(),
    };
    let progress = GridProgress::new();
    let timer = SystemClock::default();
    let results = match run(&request, &detector, &timer, &|event| progress.tell(event)) {
        // All frames are left out, each for its reason.
        Err(why @ GridError::Nothing(_, 1.., _)) => {
            note!("modulo: {why}");
            return Ok(Ended::WithLoss);
        }
        results => results.map_err(failure)?,
    };
    progress.bar.finish_and_clear();
    let page = draw_pictures(&request, &detector, &timer, &results).and_then(|pictures| {
        pictures.iter().try_for_each(|chart| page::save_pictures(out, chart))?;
        page::write(out, &results)
    });
    results.cells.iter().for_each(print_cell);
    tell_unscored(&results);
    say!("{}", page.map_err(failure)?.display());
    Ok(Ended::of(results.lost()))
}

/// The progress of a run: a bar on a terminal, else a line a minute.
struct GridProgress {
    bar: ProgressBar,
    clock: SystemClock,
    lines: Mutex<MinuteLines>,
}

impl GridProgress {
    fn new() -> Self {
        // The message is cut where the line ends.
        let bar = progress_bar("{bar:20} {pos}/{len} frames, {eta} left: {wide_msg}");
        Self { bar, clock: SystemClock::default(), lines: Mutex::default() }
    }

    fn tell(&self, event: GridEvent<'_>) {
        let Self { bar, .. } = self;
        match event {
            GridEvent::Cell { frames: (done, all), name } => {
                bar.set_length(all);
                bar.set_position(done);
                if done == 0 {
                    self.with_lines(|lines, now| lines.begin(now));
                }
                bar.set_message(name.to_owned());
            }
            GridEvent::Frame => {
                bar.inc(1);
                if bar.is_hidden() {
                    let (done, all) = (bar.position(), bar.length().unwrap_or_default());
                    let line = self.with_lines(|lines, now| lines.line(now, done, all));
                    line.iter().for_each(|line| note!("modulo: {line}"));
                }
            }
            GridEvent::Warning(warning) => bar.suspend(|| note!("modulo: {warning}")),
        }
    }

    /// Passes the lines and the present time to `with`.
    fn with_lines<T>(&self, with: impl FnOnce(&mut MinuteLines, Duration) -> T) -> T {
        // Workers finish frames in parallel.
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        with(&mut lines, Duration::from_nanos(self.clock.ticks_ns()))
    }
}

/// Prints a line if there is a cell without an AP.
fn tell_unscored(results: &Results) {
    if results.cells.iter().any(Cell::is_unscored) {
        note!(
            "modulo: no labelled object is scored, so that there is no AP; --groups names the classes that are scored, and \
             --difficulty the objects"
        );
    }
}

/// Where, when and by which command this process runs.
fn provenance() -> Provenance {
    let words = std::env::args_os().map(|word| quoted(&word.to_string_lossy()));
    let [host, load] =
        ["/proc/sys/kernel/hostname", "/proc/loadavg"].map(|file| std::fs::read_to_string(file).ok());
    let started = utc(SystemClock::default().now_ns() / 1_000_000_000);
    Provenance {
        command: words.collect::<Vec<_>>().join(" "),
        commit: env!("MODULO_COMMIT").to_owned(),
        host: host.map_or_else(|| "unknown".to_owned(), |name| name.trim().to_owned()),
        processor: processor(),
        started: started.replace(' ', "T") + "Z",
        load: load.and_then(|text| text.split(' ').next()?.parse().ok()),
        wall_s: None,
    }
}

fn data(args: &LabelledFrames, source: &[String]) -> Result<Data, Failure> {
    let list = match args.list.as_deref() {
        Some(path) if path == Path::new("paper") => Some(FrameList::paper()),
        Some(path) => Some(FrameList::read(path)?),
        None => None,
    };
    match (&args.kitti, &args.sequence[..], &args.yolo, &args.coco, source) {
        (Some(folder), ..) => Ok(Data::Kitti { folder: folder.clone(), list }),
        (None, [_, ..], ..) => Ok(Data::Sequences(args.sequence.clone())),
        (None, [], Some(folder), ..) => Ok(Data::Yolo(folder.clone())),
        (None, [], None, Some(annotations), _) => {
            Ok(Data::Coco { annotations: annotations.clone(), images: args.coco_images.clone() })
        }
        (None, [], None, None, [_, ..]) => match source.iter().find(|source| is_endless(source)) {
            Some(source) => Err(usage(anyhow!(
                "--source {source} has no end, but a grid needs one; give the number of frames, such as scene://day?frames=20"
            ))),
            None => Ok(Data::Any(source.to_vec())),
        },
        _ => Err(usage(anyhow!(
            "nothing to evaluate: give a launch file, or one of --kitti, --sequence, --yolo, --coco, --source"
        ))),
    }
}

pub fn failure(why: GridError) -> Failure {
    // What the command line names; the others come from results or from the run.
    match why {
        GridError::Request(_) | GridError::Parameter(_) | GridError::Detector(_) | GridError::Source(_) => {
            usage(why)
        }
        _ => why.into(),
    }
}

fn print_cell(cell: &Cell) {
    let percent =
        |value: Option<f64>| value.map_or("    -".to_owned(), |value| format!("{:>5}", below_100(value, 1)));
    // A group without an object in the data has no AP, which says nothing.
    let scored = cell.ap50.iter().filter(|(_, ap)| ap.is_some());
    let groups: Vec<String> = scored.map(|(group, ap)| format!("{group} {}", percent(*ap))).collect();
    say!(
        "{:<64} AP50 {}  exact k {}  infer {}",
        cell.point.to_string(),
        if groups.is_empty() { "-".to_owned() } else { groups.join(" ") },
        percent(cell.exact_k),
        // Without --time-frames, no time is measured.
        cell.latency_ms.get("infer").map_or("-".to_owned(), |infer| format!("{:.1} ms", infer.p50))
    );
}

pub fn report(folder: &Path) -> Result<Ended, Failure> {
    say!("{}", page::write(folder, &store::stored(folder)?)?.display());
    Ok(Ended::Done)
}
