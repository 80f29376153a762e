//! [`measure`]: the durations of cells, in a pass of their own.
//!
//! Accuracy may be computed by several jobs at a time, and an image that equals an earlier one is not detected again. Both
//! would falsify durations. Here one frame is processed at a time with the threads of the nodes' own defaults, and the
//! cells take turns frame by frame in changing order: a machine that becomes slower becomes slower for all of them.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use clap::builder::RangedU64ValueParser;
use modulo_detector::Sessions;
use modulo_runtime::Clock;
use modulo_runtime::clock::{cpu_time_ns, utc};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use crate::GridError;
use crate::chain::Chain;
use crate::feeds::Feed;
use crate::frames::{Frames, HandedFrame, Walk};
use crate::labels::SENSE;
use crate::messages::found;
use crate::metric::latency;
use crate::plan::Cell;
use crate::progress::GridEvent;
use crate::results::{CellTimes, Device, FrameTime, Point, Results};
use crate::store::Folder;

/// Number of frames of a cell whose processor time is measured, too. They are processed a second time for it.
const CPU_FRAMES: usize = 5;

/// The times that are measured.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct Timing {
    /// Number of frames on which the times of each cell are measured, after all cells are run; the first frames of the data,
    /// all of them again where there are fewer. 0: no times, and no chart of accuracy against time
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub time_frames: usize,
    /// Threads of one inference where times are measured. 0: one for each core, as the detector node has it
    #[arg(long, default_value_t = 0, value_parser = RangedU64ValueParser::<usize>::new().range(..=64))]
    pub threads: usize,
}

/// (stage, nanoseconds) in the order of the stages.
type Stages = Vec<(&'static str, u64)>;

/// Counts wall time, or the processor time of all threads of this process.
struct SwitchClock<'a> {
    wall: &'a dyn Clock,
    counts_cpu: AtomicBool,
}

impl Clock for SwitchClock<'_> {
    fn now_ns(&self) -> u64 {
        self.wall.now_ns()
    }

    fn ticks_ns(&self) -> u64 {
        if self.counts_cpu.load(Ordering::Relaxed) { cpu_time_ns() } else { self.wall.ticks_ns() }
    }
}

/// The name of a pass: the machine, and the time of the start.
fn pass(clock: &dyn Clock) -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_else(|_| "unknown".into());
    format!("{} {}Z", host.trim(), utc(clock.now_ns() / 1_000_000_000).replace(' ', "T"))
}

/// The model of the processor, or its architecture.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    match model {
        Some((_, name)) => name.split_whitespace().collect::<Vec<_>>().join(" "),
        None => std::env::consts::ARCH.to_owned(),
    }
}

/// Measures the times of the cells of `feeds` if some of them have none or were measured in another pass, and stores them. Returns whether it
/// did.
pub fn measure(
    timing: &Timing,
    folder: &Folder,
    timer: &dyn Clock,
    feeds: &mut [Feed<'_>],
    (results, tell): (&Results, &(dyn Fn(GridEvent<'_>) + Sync)),
) -> Result<bool, GridError> {
    let known = |own: &Cell<'_>| {
        let cell = results.cells.iter().find(|cell| cell.point == own.key.point)?;
        Some(cell.frame_ms.as_ref()?.pass.clone())
    };
    let mut passes = feeds.iter().flat_map(|feed| &feed.cells).map(known);
    let first = passes.next().flatten();
    if first.is_some() && passes.all(|pass| pass == first) {
        return Ok(false);
    }
    let count = feeds.iter().map(|feed| feed.cells.len()).sum::<usize>();
    tell(GridEvent::Cell { frames: (0, (count * timing.time_frames) as u64), name: "times" });
    let clock = SwitchClock { wall: timer, counts_cpu: AtomicBool::new(false) };
    let (pass, processor, mut timed) = (pass(timer), processor(), Vec::new());
    for Feed { frames, cells, .. } in feeds {
        let detector = |cell: &Cell<'_>| (cell.key.point.model.clone(), cell.key.point.input.clone());
        for group in cells.chunk_by(|a, b| detector(a) == detector(b)) {
            timed.extend(measure_group(timing, &clock, frames, group, &|| tell(GridEvent::Frame))?);
        }
    }
    for (_, CellTimes { frame_ms, device, .. }) in &mut timed {
        (frame_ms.pass, device.processor) = (pass.clone(), processor.clone());
    }
    folder.put_times(&timed)?;
    Ok(true)
}

/// A cell with its nodes and its durations, frame by frame.
struct TimedCell<'c> {
    cell: &'c Cell<'c>,
    chain: Chain<'c>,
    wall: Vec<Stages>,
    cpu: Vec<Stages>,
}

/// Measures the `cells` of one detector on the first frames of the data and calls `done` after each frame of each cell.
fn measure_group(
    timing: &Timing,
    clock: &SwitchClock<'_>,
    frames: &mut Frames,
    cells: &[Cell<'_>],
    done: &dyn Fn(),
) -> Result<Vec<(Point, CellTimes)>, GridError> {
    let (sessions, mut timed) = (Sessions::default(), Vec::with_capacity(cells.len()));
    let cells: Vec<[&Cell<'_>; 1]> = cells.iter().map(|cell| [cell]).collect();
    for cell in &cells {
        let mut chain = Chain::new(cell, clock, false)?;
        chain.complete(Some(&sessions), timing.threads)?;
        timed.push(TimedCell { cell: cell[0], chain, wall: Vec::new(), cpu: Vec::new() });
    }
    let (mut sizes, mut index, is_still) = (BTreeSet::new(), 0, frames.is_still);
    let slice = frames.inspect(0..timing.time_frames);
    while index < timing.time_frames && !slice.frames.is_empty() {
        for frame in Walk::new(frames, &slice, false).take(timing.time_frames - index) {
            let (_, frame) = frame?;
            // The first frame of a size makes buffers and plans, which later frames of this size reuse.
            if sizes.insert(frame.frame.radiance.dim()) {
                timed.iter_mut().try_for_each(|one| one.run(&frame, is_still).map(drop))?;
            }
            // A cell after a slow one may find a warmer processor: no cell has the same neighbours on all frames.
            timed.shuffle(&mut Pcg64::seed_from_u64(index as u64));
            for one in &mut timed {
                one.measure(clock, (&frame, is_still), index < CPU_FRAMES)?;
                done();
            }
            index += 1;
        }
    }
    Ok(timed.into_iter().filter_map(TimedCell::times).collect())
}

impl TimedCell<'_> {
    fn measure(
        &mut self,
        clock: &SwitchClock<'_>,
        (frame, is_still): (&HandedFrame, bool),
        with_cpu: bool,
    ) -> Result<(), GridError> {
        let stages = self.run(frame, is_still)?;
        self.wall.extend(stages);
        if with_cpu {
            clock.counts_cpu.store(true, Ordering::Relaxed);
            let stages = self.run(frame, is_still);
            clock.counts_cpu.store(false, Ordering::Relaxed);
            self.cpu.extend(stages?);
        }
        Ok(())
    }

    /// The durations of all stages of one frame. `None` if a node gave no answer.
    fn run(&mut self, frame: &HandedFrame, is_still: bool) -> Result<Option<Stages>, GridError> {
        let out = self.chain.tick(frame, is_still)?;
        Ok(found(&out, &self.cell.stream.detections).map(|_| self.chain.stages().to_vec()))
    }

    /// The times; without an answered frame there are none.
    fn times(self) -> Option<(Point, CellTimes)> {
        let Self { cell, wall, cpu, chain } = self;
        let sums = |frames: &[Stages]| {
            let sum = |frame: &Stages| {
                let stages = frame.iter().filter(|(stage, _)| *stage != SENSE);
                stages.map(|(_, ns)| *ns as f64 / 1e6).sum::<f64>()
            };
            let mut sums: Vec<f64> = frames.iter().map(sum).collect();
            sums.sort_by(f64::total_cmp);
            sums
        };
        let (p50, interval95) = latency::median(&sums(&wall))?;
        let (cpu_ms, _) = latency::median(&sums(&cpu))?;
        let status = chain.status();
        let of =
            |wanted: &str| status.iter().find(|(name, _)| name == wanted).map(|(_, value)| value.clone());
        let device = Device {
            engine: of("engine").expect("the status of a detector names its engine"),
            threads: of("threads")
                .and_then(|threads| threads.parse().ok())
                .expect("the status of a detector has the number of its threads"),
            ..Device::default()
        };
        let frame_ms = FrameTime { p50, interval95, cpu_ms, frames: wall.len(), ..FrameTime::default() };
        let latency_ms = latency::by_stage(wall.iter().map(Vec::as_slice));
        Some((cell.key.point.clone(), CellTimes { latency_ms, frame_ms, device }))
    }
}
