//! `modulo detect`: the boxes of a model on the pictures of a source, as files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use modulo_eval::messages::{found, image};
use modulo_eval::plan::cameras;
use modulo_images::save_png;
use modulo_runtime::SystemClock;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::output::ResultFolder;

use super::{completion, eval, pairs, start_log, usage};
use crate::{Ended, Failure};

/// The launch file of the nodes.
pub(super) const FILE: &str = "suite.launch.yaml";

#[derive(Args)]
pub struct Detect {
    /// Image, folder of images, video, bag or scene://PRESET
    pub source: String,
    /// Arguments of suite.launch.yaml as name:=value, such as score_threshold:=0.5, or input:=recovered for modulo images
    #[arg(add = completion::arguments())]
    pub arguments: Vec<String>,
    /// YOLO model in ONNX format, or demo for the embedded one
    #[arg(long, default_value = "demo")]
    pub model: String,
    /// Folder for the pictures; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Writes a picture with boxes for each frame, and prints the number of its objects by class.
pub fn detect(args: &Detect) -> Result<Ended, Failure> {
    start_log("warn");
    let more = pairs(&args.arguments)?;
    let own = [("input", "ideal"), ("source", &args.source), ("model", &args.model)];
    let own = own.into_iter().filter(|(name, _)| more.iter().all(|(other, _)| other != name));
    let own = own.map(|(name, value)| (name.to_owned(), value.to_owned()));
    let arguments: Vec<_> = own.chain(more.iter().cloned()).collect();
    let file = modulo_launch::launch_file(Path::new(FILE)).map_err(usage)?;
    let planned = eval::planned(&file, &arguments, false)?;
    let cameras = cameras(&planned, &[]).map_err(usage)?;
    let [camera] = &cameras[..] else { unreachable!("the launch file has one camera") };
    let [stream] = &camera.streams[..] else { unreachable!("the launch file has one detector") };
    let drawn = stream.annotated.as_deref().expect("a detector draws its boxes");
    let timer = SystemClock::default();
    let mut chain = Lockstep::new(&timer, vec![drawn.to_owned(), stream.detections.clone()]);
    eval::add(planned, &mut chain)?;
    let folder = ResultFolder::take(args.out.as_deref(), "detect", None).map_err(usage)?;
    let (mut frames, interval) = (0u32, u64::try_from(camera.interval.as_nanos()).context("interval")?);
    while let Some(out) = chain.tick(camera.member, u64::from(frames) * interval)? {
        let Some(picture) = image(&out, drawn) else { continue };
        frames += 1;
        let file = folder.path().join(format!("{frames:06}.png"));
        save_png(&file, &picture.frame)?;
        let mut classes = BTreeMap::new();
        for object in found(&out, &stream.detections).expect("boxes come with the picture that shows them") {
            *classes.entry(object.class).or_insert(0) += 1;
        }
        let counts: Vec<String> = classes.iter().map(|(class, count)| format!("{count} {class}")).collect();
        say!(
            "{}: {}",
            file.display(),
            if counts.is_empty() { "no object".to_owned() } else { counts.join(", ") }
        );
    }
    let lost = modulo_launch::Summary::new(&chain.finish(), []).lost(false);
    Ok(Ended::of(lost || frames == 0))
}
