//! `modulo eval` without a launch file: runs the grid over labelled frames.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use modulo_bags::source::FrameList;
use modulo_eval::grid::{
    Data, GridError, GridEvent, Request, Suite, draw_pictures, merge as merge_shards, run,
};
use modulo_eval::report as page;
use modulo_eval::results::{Cell, Results};
use modulo_runtime::SystemClock;

use super::bench::{processor, progress_bar};
use super::{report, usage};
use crate::cli::eval;
use crate::{Ended, Failure};

/// Runs the cells that are not finished yet.
pub fn grid(args: &eval::Grid, source: &[String], out: &Path) -> Result<Ended, Failure> {
    let request = Request {
        data: data(args, source)?,
        options: args.options.clone(),
        processor: processor(),
        out: out.to_owned(),
    };
    let bar = progress_bar("{bar:30} {pos}/{len} frames, {eta} left: {msg}");
    let tell = |event: GridEvent<'_>| match event {
        GridEvent::Resumed { cells: 0 } => {}
        GridEvent::Resumed { cells } => {
            bar.suspend(|| eprintln!("modulo: {cells} cells are finished already"))
        }
        GridEvent::Cell { frames: (done, all), name } => {
            bar.set_length(all);
            bar.set_position(done);
            bar.set_message(name.to_owned());
        }
        GridEvent::Frame => bar.inc(1),
        GridEvent::Warning(warning) => bar.suspend(|| eprintln!("modulo: {warning}")),
    };
    let outcome = run(&request, &Suite, &SystemClock::default(), &tell).map_err(failure)?;
    bar.finish_and_clear();
    outcome.results.cells.iter().for_each(print_cell);
    if outcome.results.cells.len() == outcome.results.setup.grid.len() {
        let timer = SystemClock::default();
        let pictures = draw_pictures(&request, &Suite, &timer, &outcome.results).map_err(failure)?;
        page::save_pictures(out, &pictures).map_err(failure)?;
    }
    report::report(out)?;
    Ok(if outcome.lost() { Ended::WithLoss } else { Ended::Done })
}

/// Joins shards.
pub fn merge(out: &Path, folders: &[PathBuf]) -> Result<Ended, Failure> {
    let results = merge_shards(out, folders).map_err(failure)?;
    let Results { setup, input, cells, .. } = &results;
    report::report(out)?;
    say!("{} of {} cells", cells.len(), setup.grid.len());
    let whole = cells.len() == setup.grid.len() && input.warnings.is_empty();
    Ok(if whole { Ended::Done } else { Ended::WithLoss })
}

fn data(args: &eval::Grid, source: &[String]) -> Result<Data, Failure> {
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
        (None, [], None, None, [source]) => Ok(Data::Any(source.clone())),
        _ => Err(usage(anyhow!(
            "nothing to evaluate: give a launch file, or one of --kitti, --sequence, --yolo, --coco, --source"
        ))),
    }
}

fn failure(why: GridError) -> Failure {
    match why {
        GridError::Empty { .. }
        | GridError::Value { .. }
        | GridError::Table { .. }
        | GridError::Parameter(_) => usage(why),
        why => why.into(),
    }
}

fn print_cell(cell: &Cell) {
    let percent =
        |value: Option<f64>| value.map_or("    -".to_owned(), |value| format!("{:5.1}", 100.0 * value));
    let groups: Vec<String> =
        cell.ap50.iter().map(|(group, ap)| format!("{group} {}", percent(*ap))).collect();
    say!(
        "{:<64} AP50 {}  exact k {}  infer {:.1} ms",
        cell.point.to_string(),
        groups.join(" "),
        percent(cell.exact_k),
        cell.latency_ms.get("infer").map_or(0.0, |infer| infer.p50)
    );
}
