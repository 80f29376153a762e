//! `modulo detect`: the boxes of a model on the pictures of a source, as they are, as files.

use std::collections::{BTreeMap, HashMap};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::iter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use modulo_bags::source::{Picture, Pictures, SourceOptions, is_endless, is_rendered, of_radiance};
use modulo_core::{Detection, Transfer};
use modulo_detector::{ClassNumbers, DEMO, DEMO_LIMIT, Detector, DetectorParameters, drawn};
use modulo_images::{Coding, White, save_png};
use modulo_runtime::output::ResultFolder;
use modulo_runtime::secret::without_secrets;
use modulo_runtime::{ParameterSet as _, Stop, SystemClock, Urgency};
use modulo_video::{LiveAddress, LiveFrame, LiveVideo, VideoAddress, VideoError, VideoFile};
use serde_json::Value;

use super::{completion, pairs, start_log, stop_on_signals, usage};
use crate::{Ended, Failure};

/// Parameters of the detector that say which stream of a camera it reads.
const OF_STREAMS: [&str; 4] = ["input", "fallback", "cameras", "bits"];
/// How long a frame of a live camera is waited for before a signal is looked for.
const PATIENCE: Duration = Duration::from_millis(200);

#[derive(Args)]
pub struct Detect {
    /// Image, folder of images and all folders below it, video, live camera, bag or scene://PRESET
    pub source: String,
    /// Parameters of the detector as name:=value, such as score_threshold:=0.5, or input_size:=640x640 for large photographs; white:=4096 for
    /// codes of 12 bits in images of 16 bits; source_topic:=NAME for a bag with several image topics
    #[arg(add = completion::detector())]
    pub arguments: Vec<String>,
    /// YOLO model in ONNX format; demo is the embedded one, which knows rendered scenes only
    #[arg(long, default_value = DEMO)]
    pub model: String,
    /// Folder for the pictures; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Also write the boxes of each picture into a text file in the folder labels, as save_txt of ultralytics does: class, centre and size
    #[arg(long)]
    pub save_txt: bool,
    /// Write the score behind each box of --save-txt
    #[arg(long, requires = "save_txt")]
    pub save_conf: bool,
    /// Also write all boxes as COCO results into predictions.json
    #[arg(long)]
    pub save_coco: bool,
}

type Each = Box<dyn Iterator<Item = Result<Picture, String>>>;

/// Writes each picture with its boxes under its own name, and prints the number of its objects by class.
pub fn detect(args: &Detect) -> Result<Ended, Failure> {
    start_log("warn");
    if let Some(other) = args.arguments.iter().find(|word| !word.contains('=')) {
        let why = "is a second source, and one is read; give the folder of all pictures";
        return Err(usage(anyhow!("{other}: {why}")));
    }
    let (parameters, options) = settings(args, pairs(&args.arguments)?).map_err(usage)?;
    let shown = without_secrets(&args.source);
    if parameters.model == DEMO && !is_rendered(&args.source) {
        return Err(usage(anyhow!("{shown}: {DEMO_LIMIT}, and add --model yolov10n.onnx")));
    }
    let stop = stop_on_signals()?;
    let Opened { mut pictures, mut lost, has_end } = opened(args, &options, &stop).map_err(usage)?;
    let mut detector = Detector::new(&parameters).map_err(usage)?;
    let folder = ResultFolder::take(args.out.as_deref(), "detect", None).map_err(usage)?;
    let mut files = Files::create(folder.path(), args, detector.class_numbers())?;
    while stop.urgency() == Urgency::None
        && let Some(picture) = pictures.next()
    {
        let looked_at = picture.and_then(|picture| Ok((detector.find(&picture.pixels)?, picture)));
        match looked_at {
            Ok((found, picture)) => files.write(&picture, &found)?,
            Err(why) => {
                tracing::warn!("left out: {}", without_secrets(&why));
                lost += 1;
            }
        }
    }
    let is_cut = has_end && stop.urgency() != Urgency::None && pictures.next().is_some();
    if is_cut {
        note!("ended by a signal before the last picture");
    }
    files.finish(lost).map(|is_empty| Ended::of(is_empty || is_cut || lost > 0))
}

/// A source that is open.
struct Opened {
    pictures: Each,
    /// The number of its parts that cannot be read.
    lost: usize,
    /// Whether the pictures end; if they do not, a signal ends the command.
    has_end: bool,
}

fn opened(args: &Detect, options: &SourceOptions, stop: &Stop) -> anyhow::Result<Opened> {
    if let Ok(Some(VideoAddress::Live(address))) = VideoAddress::of(&args.source) {
        return Ok(Opened { pictures: frames_of(address, stop.clone())?, lost: 0, has_end: false });
    }
    let (pictures, lost) = recorded(args, options)?;
    Ok(Opened { pictures, lost, has_end: !is_endless(&args.source) })
}

/// Returns the parameters of the detector, and how the source is read.
fn settings(
    args: &Detect,
    arguments: Vec<(String, String)>,
) -> anyhow::Result<(DetectorParameters, SourceOptions)> {
    let (mut own, mut options) = (vec![("model".to_owned(), args.model.clone())], SourceOptions::default());
    for (name, value) in arguments {
        match &*name {
            "source_topic" => options.topic = Some(value),
            "white" => {
                let white = value.parse().with_context(|| format!("white:={value}: must be a number"))?;
                options.coding = Coding { white, ..Coding::default() };
                White::new(options.coding.clone())?;
            }
            name if OF_STREAMS.contains(&name) => bail!(
                "{name}:={value}: is for the streams of a camera, and detect looks at pictures as they are; use modulo eval \
                 suite.launch.yaml source:={} input:=STREAM --images",
                without_secrets(&args.source)
            ),
            _ => own.push((name, value)),
        }
    }
    Ok((DetectorParameters::from_text(&own)?, options))
}

/// Opens a source that is not live. Returns its pictures and the number of its parts that cannot be read.
fn recorded(args: &Detect, options: &SourceOptions) -> anyhow::Result<(Each, usize)> {
    let mut pictures = Pictures::open(&args.source, options)?;
    // The results of earlier runs in the folder where the program runs are no input.
    if let Ok(runs) = fs::canonicalize("runs/detect") {
        pictures
            .files
            .retain(|(_, file)| fs::canonicalize(file).map_or(true, |file| !file.starts_with(&runs)));
    }
    let mut known = HashMap::new();
    for (name, file) in &pictures.files {
        let key = if args.save_coco { coco_id(name) } else { name.display().to_string().into() };
        if let Some(other) = known.insert(key, file) {
            bail!(
                "{} and {}: their results would have one name; rename one of them, or put it into a folder of its own",
                other.display(),
                file.display()
            );
        }
    }
    pictures.warnings.iter().chain(&pictures.losses).for_each(|line| tracing::warn!("{line}"));
    let lost = pictures.losses.len();
    Ok((Box::new(pictures.map(|picture| picture.map_err(|why| why.to_string()))), lost))
}

/// Opens a live camera, whose newest frame comes next until a stop is asked for.
fn frames_of(address: LiveAddress, stop: Stop) -> anyhow::Result<Each> {
    let video = LiveVideo::open(address, Arc::new(SystemClock::default()))?;
    let newest = move || {
        while stop.urgency() == Urgency::None {
            if let Some(frame) = video.newest(PATIENCE) {
                return Some(frame);
            }
        }
        None
    };
    let picture = |(number, frame): (usize, Result<LiveFrame, VideoError>)| {
        let frame = frame.map_err(|why| why.to_string())?;
        let name = format!("{number:06}");
        let radiance = frame.pixels.radiance(&Coding::default(), &name).map_err(|why| why.to_string())?;
        Ok(Picture { name: name.into(), pixels: of_radiance(&radiance, Transfer::Linear) })
    };
    Ok(Box::new(iter::from_fn(newest).enumerate().map(picture)))
}

/// Returns the id of an image in COCO: its name, or the number that is its name.
fn coco_id(name: &Path) -> Value {
    let name = name.display().to_string();
    let is_number = name.bytes().all(|byte| byte.is_ascii_digit());
    name.parse::<u64>().ok().filter(|_| is_number).map_or_else(|| name.clone().into(), Value::from)
}

/// The files of the results.
struct Files<'a> {
    folder: &'a Path,
    args: &'a Detect,
    numbers: ClassNumbers,
    coco: Option<BufWriter<File>>,
    pictures: usize,
    objects: usize,
}

impl<'a> Files<'a> {
    fn create(folder: &'a Path, args: &'a Detect, numbers: ClassNumbers) -> anyhow::Result<Self> {
        let coco = args.save_coco.then(|| File::create(folder.join("predictions.json")).map(BufWriter::new));
        let coco = coco.transpose().with_context(|| folder.display().to_string())?;
        Ok(Self { folder, args, numbers, coco, pictures: 0, objects: 0 })
    }

    /// Writes the files of a picture, and prints its objects.
    fn write(&mut self, picture: &Picture, found: &[Detection]) -> anyhow::Result<()> {
        let name = self.free_name(&picture.name);
        let file = self.place("", &name, "png")?;
        save_png(&file, &drawn(&picture.pixels, found).map_err(anyhow::Error::msg)?)?;
        if self.args.save_txt {
            let (height, width, _) = picture.pixels.dim();
            let text = self.numbers.yolo(found, (height, width), self.args.save_conf);
            let file = self.place("labels", &name, "txt")?;
            fs::write(&file, text).with_context(|| file.display().to_string())?;
        }
        if let Some(coco) = &mut self.coco {
            let entries = self.numbers.coco(found, &coco_id(&name), &format!("{}.png", name.display()));
            let written = (self.objects..).zip(entries).try_for_each(|(number, entry)| {
                write!(coco, "{}\n{entry}", if number == 0 { "[" } else { "," })
            });
            written.context("predictions.json")?;
        }
        self.pictures += 1;
        self.objects += found.len();
        let mut classes = BTreeMap::new();
        found.iter().for_each(|object| *classes.entry(&object.class).or_insert(0) += 1);
        let counts: Vec<String> = classes.iter().map(|(class, count)| format!("{count} {class}")).collect();
        let counts = if counts.is_empty() { "no object".to_owned() } else { counts.join(", ") };
        say!("{}: {counts}", file.display());
        Ok(())
    }

    /// Returns `name`, with a number behind it where a frame of the same stamp has it.
    fn free_name(&self, name: &Path) -> PathBuf {
        let numbered = |number: u32| match number {
            0 => name.to_owned(),
            _ => PathBuf::from(format!("{}_{number}", name.display())),
        };
        let is_free = |name: &PathBuf| !with_extension(&self.folder.join(name), "png").exists();
        (0..).map(numbered).find(is_free).expect("there are more numbers than files")
    }

    /// Returns the path of a result of the picture `name`, whose folder is made.
    fn place(&self, below: &str, name: &Path, extension: &str) -> anyhow::Result<PathBuf> {
        let file = with_extension(&self.folder.join(below).join(name), extension);
        let folder = file.parent().expect("it lies in the folder of the results");
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        Ok(file)
    }

    /// Says what was written, and what was `lost`. Returns whether there was no picture.
    fn finish(self, lost: usize) -> Result<bool, Failure> {
        if let Some(mut coco) = self.coco {
            let end = if self.objects == 0 { "[]\n" } else { "\n]\n" };
            coco.write_all(end.as_bytes()).and_then(|()| coco.flush()).context("predictions.json")?;
        }
        if lost > 0 {
            note!("left out, as they cannot be read: {lost}");
        }
        let (pictures, objects) = (counted(self.pictures, "picture"), counted(self.objects, "object"));
        note!("{pictures}, {objects}: {}", self.folder.display());
        if let Ok(Some(VideoAddress::File(path))) = VideoAddress::of(&self.args.source)
            && let Ok(video) = VideoFile::open(&path)
            && let Some(rate) = video.rate()
        {
            let (folder, rate) = (self.folder.display(), (rate * 1e3).round() / 1e3);
            let size = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
            note!(
                "a video of them: ffmpeg -framerate {rate} -pattern_type glob -i '{folder}/*.png' -pix_fmt yuv420p -vf '{size}' \
                 '{folder}/boxes.mp4'"
            );
        }
        Ok(self.pictures == 0)
    }
}

/// Returns `1 picture` or `2 pictures`.
fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Returns the path with an extension behind its name, which may have points of its own.
fn with_extension(path: &Path, extension: &str) -> PathBuf {
    let mut path = OsString::from(path);
    path.push(".");
    path.push(extension);
    path.into()
}
