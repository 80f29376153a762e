//! Cameras for a high dynamic range against each other: the images of every one, what a detector finds in them, and how
//! right their radiance is.
//!
//! Each camera shows two pictures, one whose white is the end of the range, and one that is metered after the capture,
//! by the function that the stream `/metered` uses. The three captures of a frame are three consecutive frames of the
//! drive with the longest exposure last; moving objects leave ghosts, since the captures are not aligned.

mod camera;

use std::fs;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context, anyhow, ensure};
use camera::{CAPTURES, Chip, FIXED_WHITE, METERED, RIVALS, Rival, Seen};
use clap::Parser;
use modulo_bags::source::{SourceFrame, SourceOptions, open};
use modulo_core::Frame;
use modulo_draw::{LabelledBox, Picture, class_colour, sheet};
use modulo_images::{read_image, save_png};
use modulo_lab::nearest::{COUNTED, change_of, frames_of, is_nearest_found, objects_found, share};
use modulo_lab::{Program, ap50, bbox, jsons, percent, write_labels, write_picture};
use ndarray::Array3;
use serde_json::Value;

/// Renders what cameras for a high dynamic range see, and prints the accuracy of a detector on their pictures and of
/// their radiance
#[derive(Parser)]
struct Options {
    #[command(flatten)]
    program: Program,
    /// New folder for the images, the results and the worst frames
    out: PathBuf,
    /// Sources of labelled frames, as `modulo eval --source` takes them
    #[arg(long, required = true)]
    source: Vec<String>,
    /// Cameras to compare, all if none is named; ideal is always one of them
    #[arg(long, value_delimiter = ',', value_parser = RIVALS.map(|rival| rival.name))]
    rival: Vec<String>,
    /// Brightest radiance of the scenes over the peak of the modulo sensor
    #[arg(long, default_value_t = 4.0)]
    alpha: f64,
    /// Full scale of a picture over the end of the range
    #[arg(long, default_value_t = 0.97)]
    headroom: f64,
    /// Standard deviation of the blur of the lens, px
    #[arg(long, default_value_t = 1.4)]
    psf_sigma: f64,
    /// Electrons of a full well at 8 bits; 0 without shot noise
    #[arg(long, default_value_t = 0.0)]
    full_well_electrons: f64,
    /// Standard deviation of the read noise, code units
    #[arg(long, default_value_t = 0.0)]
    read_noise: f64,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    fs::create_dir_all(options.out.join("worst")).with_context(|| options.out.display().to_string())?;
    let is_wanted = |rival: &Rival| {
        let is_named = options.rival.iter().any(|name| name == rival.name);
        options.rival.is_empty() || is_named || rival.name == RIVALS[0].name
    };
    let rivals: Vec<Rival> = RIVALS.into_iter().filter(is_wanted).collect();
    let Options { alpha, headroom, psf_sigma, full_well_electrons, read_noise, .. } = options;
    let chip = Chip::new(alpha, headroom, psf_sigma, full_well_electrons, read_noise)?;
    let mut figures = vec![Figures::default(); rivals.len()];
    for (number, spec) in options.source.iter().enumerate() {
        let frames = frames(spec)?;
        let folder = Folder { out: &options.out, drive: format!("{number}_{}", light_of(spec)) };
        let found = in_parallel(&rivals, |rival| render(&chip, rival, &frames, &folder))?;
        figures.iter_mut().zip(found).for_each(|(all, of_drive)| all.add(&of_drive));
    }
    println!(
        "camera,bits,captures,frames,vehicles,persons,vehicles_metered,persons_metered,nearest,nearest_metered,\
         brighter_metered,clipped,noisy,stops,snr_below_db,snr_above_db"
    );
    let mut ideal = None;
    for (rival, figures) in rivals.iter().zip(&figures) {
        let views = [score(&options, *rival, FIXED_WHITE)?, score(&options, *rival, METERED)?];
        println!("{},{},{}", row(*rival, &views), figures.of_radiance(), snr(&chip, *rival)?.join(","));
        for (view, ideal) in views.iter().zip(ideal.get_or_insert_with(|| views.clone())) {
            if let (Some(view), Some(ideal)) = (view, ideal) {
                view.draw_worst(ideal, &options.out)?;
            }
        }
    }
    Ok(())
}

/// Returns the figures of the detector on the pictures of a camera with a fixed white, and on its metered ones.
fn row(rival: Rival, views: &[Option<View>; 2]) -> String {
    let frames = views.iter().flatten().next().map_or(0, |view| view.frames.len());
    let [fixed, metered] = views.each_ref().map(Option::as_ref);
    let figure = |view: Option<&View>, of: fn(&View) -> String| view.map_or_else(|| "-".to_owned(), of);
    let vehicles = |view| figure(view, |view| ap50(&view.cell, "vehicle"));
    let persons = |view| figure(view, |view| ap50(&view.cell, "person"));
    [
        rival.name.to_owned(),
        rival.bits.to_string(),
        rival.captures.to_string(),
        frames.to_string(),
        vehicles(fixed),
        persons(fixed),
        vehicles(metered),
        persons(metered),
        figure(fixed, View::nearest),
        figure(metered, View::nearest),
        figure(metered, View::brighter),
    ]
    .join(",")
}

/// Returns the change of the light in the address of a source, by which the frames of its folder are told apart.
fn light_of(spec: &str) -> &str {
    let light = |light: &&str| spec.contains(light);
    ["light=tunnels", "light=trees"].into_iter().find(light).unwrap_or("steady")
}

fn frames(spec: &str) -> anyhow::Result<Vec<SourceFrame>> {
    let mut source = open(spec, &SourceOptions::default())?;
    let frames = std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>()?;
    ensure!(!frames.is_empty(), "{spec}: has no frames");
    Ok(frames)
}

/// Calls `make` for every camera, on as many threads as there are processors, and returns the results in the order of
/// the cameras.
fn in_parallel<T: Send>(
    rivals: &[Rival],
    make: impl Fn(Rival) -> anyhow::Result<T> + Sync,
) -> anyhow::Result<Vec<T>> {
    let threads = thread::available_parallelism().map_or(1, NonZero::get).min(rivals.len());
    let made = thread::scope(|scope| {
        let of_thread = |thread: usize| {
            let (make, mine) = (&make, rivals.iter().enumerate().skip(thread).step_by(threads));
            scope.spawn(move || {
                mine.map(|(at, rival)| Ok((at, make(*rival)?))).collect::<anyhow::Result<Vec<_>>>()
            })
        };
        let threads: Vec<_> = (0..threads).map(of_thread).collect();
        threads.into_iter().map(|thread| thread.join().map_err(|_| anyhow!("a thread panicked"))?).collect()
    });
    let made: anyhow::Result<Vec<Vec<(usize, T)>>> = made;
    let mut made: Vec<(usize, T)> = made?.into_iter().flatten().collect();
    made.sort_by_key(|(at, _)| *at);
    Ok(made.into_iter().map(|(_, made)| made).collect())
}

/// The folder of the pictures of a drive.
struct Folder<'a> {
    out: &'a Path,
    drive: String,
}

impl Folder<'_> {
    fn of(&self, rival: Rival, view: &str) -> PathBuf {
        self.out.join(rival.name).join(view).join(&self.drive)
    }
}

/// Writes the pictures and labels of a camera on a drive.
fn render(chip: &Chip, rival: Rival, frames: &[SourceFrame], folder: &Folder<'_>) -> anyhow::Result<Figures> {
    let (mut camera, mut figures) = (chip.camera(rival)?, Figures::default());
    for (seed, now) in (0u64..).zip(frames) {
        let at = seed as usize;
        let neighbour = |at: usize| &frames[at.min(frames.len() - 1)].radiance;
        let scenes = [neighbour(at.saturating_sub(1)), &now.radiance, neighbour(at + 1)];
        let seen = camera.see(scenes, seed)?;
        figures.count(&seen, &chip.truth(&now.radiance)?);
        for (view, picture) in &seen.pictures {
            let folder = folder.of(rival, view);
            // A name of digits, because the frames of a drive are evaluated in the order of their names.
            let name = format!("{seed:06}");
            write_picture(&folder, &name, picture)?;
            write_labels(&folder, &name, now.ground_truth.as_deref().unwrap_or_default())?;
        }
    }
    Ok(figures)
}

/// How right the radiance of the samples is.
#[derive(Clone, Copy, Default)]
struct Figures {
    samples: f64,
    clipped: f64,
    noisy: f64,
    squared_stops: f64,
}

impl Figures {
    /// Counts the samples of a frame. A sample is noisy if its error is more than a tenth of its radiance: its
    /// signal-to-noise ratio is below 10.
    fn count(&mut self, seen: &Seen, truth: &Array3<f32>) {
        for ((x, truth), is_clipped) in seen.x.iter().zip(truth).zip(&seen.clipped) {
            let x = (x + 0.5).max(0.0);
            self.samples += 1.0;
            self.clipped += f64::from(*is_clipped);
            self.noisy += f64::from(!is_clipped && (x - truth).abs() > 0.1 * truth);
            self.squared_stops += f64::from(((x + 1.0) / (truth + 1.0)).log2().powi(2));
        }
    }

    fn add(&mut self, other: &Self) {
        self.samples += other.samples;
        self.clipped += other.clipped;
        self.noisy += other.noisy;
        self.squared_stops += other.squared_stops;
    }

    /// Returns the clipped and the noisy samples in percent, and the root mean square of the error in stops.
    fn of_radiance(&self) -> String {
        let share = |count: f64| 100.0 * count / self.samples;
        let stops = (self.squared_stops / self.samples).sqrt();
        format!("{:.2},{:.2},{stops:.3}", share(self.clipped), share(self.noisy))
    }
}

/// Returns the signal-to-noise ratios of a ramp of light a tenth of the peak below and above the peak, in dB; `-` where
/// a camera clips.
fn snr(chip: &Chip, rival: Rival) -> anyhow::Result<[String; 2]> {
    let (peak, white) = chip.peak_and_white();
    let ramp =
        Array3::from_shape_fn((128, white as usize, 3), |(_, column, _)| (column as f32 + 0.5) / white);
    let (seen, truth) = (chip.camera(rival)?.see([&ramp; CAPTURES], 1)?, chip.truth(&ramp)?);
    Ok([0.9, 1.1].map(|level| {
        let near = |truth: f32| (truth / (level * peak) - 1.0).abs() < 0.05;
        let (mut count, mut signal, mut noise) = (0.0, 0.0, 0.0);
        for ((x, &truth), is_clipped) in seen.x.iter().zip(&truth).zip(&seen.clipped) {
            if near(truth) && !is_clipped {
                count += 1.0;
                signal += f64::from(truth).powi(2);
                noise += f64::from(x + 0.5 - truth).powi(2);
            }
        }
        if count == 0.0 { "-".to_owned() } else { format!("{:.1}", 10.0 * (signal / noise).log10()) }
    }))
}

/// The boxes that the detector found in the pictures of a camera.
#[derive(Clone)]
struct View {
    rival: Rival,
    name: &'static str,
    cell: Value,
    /// The frames in the order of the evaluation, with what was found in each.
    frames: Vec<(Value, Value)>,
}

/// Evaluates the pictures of a camera; `None` if it has no such picture.
fn score(options: &Options, rival: Rival, name: &'static str) -> anyhow::Result<Option<View>> {
    let pictures = options.out.join(rival.name).join(name);
    let Ok(drives) = fs::read_dir(&pictures) else { return Ok(None) };
    let mut drives: Vec<PathBuf> = drives.flatten().map(|drive| drive.path()).collect();
    drives.sort();
    let mut arguments = Vec::new();
    for drive in &drives {
        arguments
            .extend(["--source", drive.to_str().ok_or_else(|| anyhow!("{}: is no text", drive.display()))?]);
    }
    let results = options.out.join(format!("results_{}_{name}", rival.name));
    let found = options.program.evaluate(&arguments, &results)?;
    let frames = frames_of(&jsons(&results.join("frames"))?);
    let cells = jsons(&results.join("cells"))?;
    let of_frames = cells.iter().flat_map(|(_, cell)| cell["frames"].as_array().into_iter().flatten());
    let place = |found: &Value| found["place"].as_u64();
    let with_frame = |found: &Value| Some((frames.get(&place(found)?)?.clone(), found.clone()));
    let mut frames: Vec<(Value, Value)> = of_frames.filter_map(with_frame).collect();
    frames.sort_by_key(|(_, found)| place(found));
    Ok(Some(View { rival, name, cell: found["cells"][0].clone(), frames }))
}

impl View {
    /// Returns the share of the frames whose nearest object is found, in percent.
    fn nearest(&self) -> String {
        self.share(|_| true)
    }

    /// Returns that of the four frames from the first one of a change to brighter light.
    fn brighter(&self) -> String {
        self.share(|frame| {
            change_of(frame).is_some_and(|(change, since)| change == "brighter" && (0..4).contains(&since))
        })
    }

    fn share(&self, is_taken: impl Fn(&Value) -> bool) -> String {
        let taken = self.frames.iter().filter(|(frame, _)| is_taken(frame));
        let found: Vec<Option<bool>> = taken.map(|(frame, found)| is_nearest_found(frame, found)).collect();
        percent(share(&found))
    }

    /// Draws the frame in which most objects are missed that are found in the `ideal` picture, below that; nothing if
    /// none is missed.
    fn draw_worst(&self, ideal: &Self, out: &Path) -> anyhow::Result<()> {
        let missed = |at: &usize| {
            let count =
                |view: &Self| view.frames.get(*at).map_or(0, |(frame, found)| objects_found(frame, found));
            count(ideal).saturating_sub(count(self))
        };
        let Some(at) = (0..self.frames.len()).rev().max_by_key(missed).filter(|at| missed(at) > 0) else {
            return Ok(());
        };
        let pictures =
            [ideal, self].map(|view| view.picture(out, at)).into_iter().collect::<Result<Vec<_>, _>>()?;
        let image =
            sheet(&pictures, &[]).ok_or_else(|| anyhow!("{}: is too large to be drawn", self.rival.name))?;
        let (width, height) = image.dimensions();
        let image = Array3::from_shape_vec((height as usize, width as usize, 3), image.into_raw())?;
        let file = format!("{}_{}.png", self.rival.name, self.name);
        Ok(save_png(&out.join("worst").join(file), &Frame::from_u8(image)?)?)
    }

    /// Returns the picture of a frame with its boxes, and its name.
    fn picture(&self, out: &Path, at: usize) -> anyhow::Result<(String, Option<Picture>)> {
        let (frame, found) = &self.frames[at];
        let drive =
            frame["drive"].as_str().map_or_else(|| self.only_drive(out), |drive| Ok(PathBuf::from(drive)))?;
        let name = frame["name"].as_str().unwrap_or_default();
        let image = read_image(&drive.join("image_2").join(format!("{name}.png")))?;
        let (height, width, _) = image.dim();
        let rgb = image.as_u8().context("the picture has 8 bits")?.iter().copied().collect();
        let labelled = |row: &Value| {
            let (score, class, bbox) = (row[1].as_f64()?, row[2].as_str()?, bbox(&row[0])?);
            let corners = [bbox.x1, bbox.y1, bbox.x2, bbox.y2];
            let colour = class_colour(class);
            (score >= COUNTED).then(|| LabelledBox { corners, colour, label: String::new() })
        };
        let boxes = found["boxes"].as_array().into_iter().flatten().filter_map(labelled).collect();
        let caption =
            format!("{}, {}: {} objects found", self.rival.name, self.name, objects_found(frame, found));
        Ok((caption, Some(Picture::new(width as u32, height as u32, rgb, boxes)?)))
    }

    /// Returns the folder of the pictures where there is one drive, which the results do not name.
    fn only_drive(&self, out: &Path) -> anyhow::Result<PathBuf> {
        let drives = fs::read_dir(out.join(self.rival.name).join(self.name))?;
        let drive = drives.flatten().next();
        drive.map(|drive| drive.path()).context("the pictures of this camera were removed")
    }
}
