//! `modulo eval FILE`: a launch file's nodes in lockstep.

use anyhow::{Context, anyhow};
use modulo_eval::{Images, Stream};
use modulo_launch::Summary;
use modulo_runtime::driver::lockstep::Lockstep;
use modulo_runtime::{MessageKind, Node, Place, SystemClock};

use super::launch::prepare;
use super::{pairs, start_log, usage};
use crate::cli::Eval;
use crate::{Ended, Failure};

/// Runs every frame of the file's camera through its nodes and writes the boxes.
pub fn eval(args: &Eval) -> Result<Ended, Failure> {
    start_log(Some("warn"));
    let plan = modulo_launch::resolve(&args.file, &pairs(&args.arguments)?).map_err(usage)?;
    let nodes = modulo_launch::compose(&plan).map_err(usage)?;
    let mut made: Vec<(Box<dyn Node>, Place)> = Vec::new();
    for node in &nodes {
        let (kind, place, parameters) = prepare(node).map_err(usage)?;
        let step = kind.make(&parameters).with_context(|| place.fully_qualified()).map_err(usage)?;
        made.push((step, place));
    }
    let source = made.iter().position(|(node, _)| node.period().is_some());
    let source = source.with_context(|| format!("{}: no node is a source of frames", args.file.display()));
    let source = source.map_err(usage)?;
    let streams = streams(&made)?;
    let images = if args.images { Images::Save } else { Images::Discard };

    let timer = SystemClock::default();
    let mut recorded: Vec<String> = streams.iter().map(|s| s.detections.clone()).collect();
    if images == Images::Save {
        recorded.extend(streams.iter().map(|s| s.images.clone()));
    }
    let mut chain = Lockstep::new(&timer, recorded);
    for (node, place) in made {
        chain.add(node, &place)?;
    }
    modulo_eval::run(&mut chain, source, &streams, images, &args.out)?;
    let summary = Summary::new(&chain.finish(), []);
    print!("{summary}");
    summary.write(&args.out.join("summary.json"))?;
    Ok(if summary.lost() { Ended::WithLoss } else { Ended::Done })
}

/// The image and box topics of every node that turns images into boxes.
fn streams(made: &[(Box<dyn Node>, Place)]) -> Result<Vec<Stream>, Failure> {
    let mut streams = Vec::new();
    for (node, place) in made {
        let input = node.inputs().into_iter().find(|t| t.kind == MessageKind::Image);
        let output = node.outputs().into_iter().find(|t| t.kind == MessageKind::Detections);
        if let (Some(input), Some(output)) = (input, output) {
            streams.push(Stream::new(&place.resolve(&input.name)?, &place.resolve(&output.name)?));
        }
    }
    if streams.is_empty() {
        return Err(usage(anyhow!("no node of the launch file turns images into boxes")));
    }
    Ok(streams)
}
