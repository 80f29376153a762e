//! [`measure`]: the durations of cells, in a pass of their own.
//!
//! Accuracy may be computed by several jobs at a time, and an image that equals an earlier one is not detected again. Both
//! would falsify durations. Here one frame is processed at a time with the threads of the nodes' own defaults, and the
//! cells take turns frame by frame in changing order: a machine that becomes slower becomes slower for all of them.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};

use modulo_runtime::Clock;
use modulo_runtime::clock::cpu_time_ns;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use super::detect::DetectorWorker;
use super::frames::{FrameWithNeighbours, Frames, FramesWithNeighbours};
use super::pipeline::{self, FramePipeline, MakeDetector, Stages};
use super::{GridError, GridEvent, GridOptions, Request};
use crate::labels::{self, SENSE};
use crate::metric::latency;
use crate::results::{Cell, Device, FrameTime, Results, Stream};
use crate::store;

/// Number of frames of a cell whose processor time is measured, too. They are processed a second time for it.
const CPU_FRAMES: usize = 5;

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

/// Measures the times of the cells anew if some of them have none or were measured in another pass. Cells whose models this
/// request does not have keep their times.
pub fn measure(
    request: &Request,
    make: &MakeDetector,
    timer: &dyn Clock,
    frames: &mut Frames,
    results: &mut Results,
    tell: &(dyn Fn(GridEvent<'_>) + Sync),
) -> Result<(), GridError> {
    fn detector(cell: &Cell) -> (&str, &str) {
        (&cell.point.model, &cell.point.input)
    }
    let pass = |cell: &Cell| cell.frame_ms.as_ref().map(|time| time.pass.clone());
    // Only the models of this request are at hand.
    let (mut cells, others): (Vec<Cell>, Vec<Cell>) = std::mem::take(&mut results.cells)
        .into_iter()
        .partition(|cell| request.model(&cell.point.model).is_ok());
    let measured = cells.first().is_none_or(|first| pass(first).is_some())
        && cells.iter().all(|cell| pass(cell) == pass(&cells[0]));
    // Cells of earlier grids may stand between those of one detector.
    cells.sort_by(|a, b| detector(a).cmp(&detector(b)));
    let mut timed = Ok(());
    if !measured && request.options.time_frames > 0 {
        let frames_of_cell = request.options.time_frames as u64;
        tell(GridEvent::Cell { frames: (0, cells.len() as u64 * frames_of_cell), name: "times" });
        let clock = SwitchClock { wall: timer, counts_cpu: AtomicBool::new(false) };
        let done = || tell(GridEvent::Frame);
        timed = cells
            .chunk_by_mut(|a, b| detector(a) == detector(b))
            .try_for_each(|cells| measure_group(request, make, &clock, frames, cells, &done));
        labels::busy(&cells).iter().for_each(|warning| tell(GridEvent::Warning(warning)));
    }
    cells.extend(others);
    store::sort(&mut cells, &results.setup.grid);
    results.cells = cells;
    timed
}

/// A cell with its pipeline and its durations, frame by frame.
struct TimedCell<'a, 'p> {
    cell: &'a mut Cell,
    pipeline: FramePipeline<'p>,
    wall: Vec<Stages>,
    cpu: Vec<Stages>,
}

/// Measures the `cells` of one detector on the first frames of the data and calls `done` after each frame of each cell.
fn measure_group(
    request: &Request,
    make: &MakeDetector,
    clock: &SwitchClock<'_>,
    frames: &mut Frames,
    cells: &mut [Cell],
    done: &dyn Fn(),
) -> Result<(), GridError> {
    let GridOptions { threads, time_frames, .. } = request.options;
    let mut detector = DetectorWorker::open(request, make, clock, &cells[0].point, threads)?;
    let with_neighbours = cells.iter().any(|cell| cell.point.stream == Stream::MultiExposure);
    let mut timed = Vec::with_capacity(cells.len());
    for cell in cells {
        let pipeline = pipeline::open(request, clock, &cell.point, false)?;
        timed.push(TimedCell { cell, pipeline, wall: Vec::new(), cpu: Vec::new() });
    }
    let (mut sizes, mut index) = (BTreeSet::new(), 0);
    for _ in 0..time_frames.div_ceil(frames.len()) {
        for frame in FramesWithNeighbours::new(frames, with_neighbours)?.take(time_frames - index) {
            let frame = frame?;
            // The first frame of a size makes buffers and plans, which later frames of this size reuse.
            if sizes.insert(frame.frame.radiance.dim()) {
                timed
                    .iter_mut()
                    .try_for_each(|one| run_frame(&mut one.pipeline, &mut detector, &frame).map(drop))?;
            }
            // A cell after a slow one may find a warmer processor: no cell has the same neighbours on all frames.
            timed.shuffle(&mut Pcg64::seed_from_u64(index as u64));
            let mut measure =
                |one: &mut TimedCell| one.measure(&mut detector, clock, &frame, index < CPU_FRAMES);
            timed.iter_mut().try_for_each(|one| measure(one).inspect(|()| done()))?;
            index += 1;
        }
    }
    let DetectorWorker { engine, threads, .. } = detector;
    let device = Device { processor: request.provenance.processor.clone(), engine, threads };
    timed.into_iter().for_each(|one| one.store(&device, &request.provenance.pass()));
    Ok(())
}

impl TimedCell<'_, '_> {
    fn measure(
        &mut self,
        detector: &mut DetectorWorker<'_>,
        clock: &SwitchClock<'_>,
        frame: &FrameWithNeighbours,
        with_cpu: bool,
    ) -> Result<(), GridError> {
        self.wall.extend(run_frame(&mut self.pipeline, detector, frame)?);
        if with_cpu {
            clock.counts_cpu.store(true, Ordering::Relaxed);
            self.cpu.extend(run_frame(&mut self.pipeline, detector, frame)?);
            clock.counts_cpu.store(false, Ordering::Relaxed);
        }
        Ok(())
    }

    fn store(self, device: &Device, pass: &str) {
        let Self { cell, wall, cpu, .. } = self;
        let sums = |frames: &[Stages]| {
            let sum = |frame: &Stages| {
                let stages = frame.iter().filter(|(stage, _)| *stage != SENSE);
                stages.map(|(_, ns)| *ns as f64 / 1e6).sum::<f64>()
            };
            let mut sums: Vec<f64> = frames.iter().map(sum).collect();
            sums.sort_by(f64::total_cmp);
            sums
        };
        // Without an answered frame there is nothing to show, and the cell stays without times.
        let medians = (latency::median(&sums(&wall)), latency::median(&sums(&cpu)));
        let (Some((p50, interval95)), Some((cpu_ms, _))) = medians else { return };
        cell.latency_ms = latency::by_stage(wall.iter().map(Vec::as_slice));
        cell.frame_ms =
            Some(FrameTime { p50, interval95, cpu_ms, frames: wall.len(), pass: pass.to_owned() });
        cell.device = device.clone();
    }
}

/// The durations of all stages of one frame. `None` if a node gave no answer.
fn run_frame(
    pipeline: &mut FramePipeline<'_>,
    detector: &mut DetectorWorker<'_>,
    frame: &FrameWithNeighbours,
) -> Result<Option<Stages>, GridError> {
    let input = pipeline(frame.clone())?;
    let Some(image) = input.image else { return Ok(None) };
    let (found, stages) = detector.infer(frame.number, image)?;
    Ok(found.map(|_| [input.stages, stages].concat()))
}
