//! [`Axes`]: the nodes of a launch file for each combination of what varies.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Parser;
use modulo_camera::CameraParameters;
use modulo_detector::EngineChoice;
use modulo_runtime::sensor::options::{CHIP, CodingOptions, SensorCommand, SensorOptions};
use modulo_runtime::{ParameterSet as _, Value};

use crate::GridError;
use crate::makers::SPUD_AS_PUBLISHED;
use crate::plan::{CAMERA, DETECTOR, PlannedNode, Variant, WITHOUT_EFFECT};
use crate::score::words;

/// A launch argument, or a parameter of a node as NODE.PARAMETER, with the values that it takes by turns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Varied {
    name: String,
    values: Vec<String>,
}

impl FromStr for Varied {
    type Err = String;

    /// Reads `NAME=VALUE,VALUE`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, values) = text.split_once('=').ok_or("is not NAME=VALUE,VALUE, such as alpha=2,4,8")?;
        Ok(Self::new(name.trim_end_matches(':'), values.split(',')))
    }
}

impl Varied {
    fn new<S: Into<String>>(name: impl Into<String>, values: impl IntoIterator<Item = S>) -> Self {
        Self { name: name.into(), values: values.into_iter().map(Into::into).collect() }
    }

    /// The name without that of a node.
    fn parameter(&self) -> &str {
        self.name.rsplit('.').next().unwrap_or(&self.name)
    }

    /// Whether both set the same parameter of the same nodes: a launch argument has the name of the parameter that it sets.
    fn is_same(&self, other: &Self) -> bool {
        let are_alike = self.name.contains('.') == other.name.contains('.');
        if are_alike { self.name == other.name } else { self.parameter() == other.parameter() }
    }
}

/// The parameters of the sensor that are options of the command line.
#[derive(Clone, Debug, PartialEq)]
pub struct VariedParameters;

impl SensorCommand for VariedParameters {
    const WITHOUT: &'static [&'static str] = &["bits", "psf", "gain_ratio"];

    fn varies(_: &str) -> bool {
        true
    }
}

/// The values of `unwrap.deblur` that the words of `--deblur` stand for.
type Deblur = &'static [&'static str];
const DEBLUR: [(&str, Deblur); 3] = [("both", &["false", "true"]), ("on", &["true"]), ("off", &["false"])];
/// The streams without a launch file.
const STREAMS: [&str; 4] = ["ideal", "saturated", "modulo", RECOVERED];
const RECOVERED: &str = "recovered";
/// The names of the method, as a parameter and as an argument of the launch files of the suite.
const METHOD: [&str; 2] = ["unwrap.method", "method"];

/// Short forms of `--vary`. Without a launch file, some of them have several values by default.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(next_help_heading = "Short forms of --vary")]
#[command(mut_arg("alpha", |option| option.default_value("1.5,2,3,4")))]
pub struct Axes {
    /// Parameter file of the camera with the values of the chip and the lens, such as sensors/mosaic.yaml
    #[arg(long = "sensor", value_name = "FILE", conflicts_with = CHIP)]
    pub sensor_file: Option<PathBuf>,
    /// Streams to evaluate, of those that detectors read
    /// [default without FILE: ideal,saturated,modulo,recovered]
    #[arg(long, value_delimiter = ',')]
    pub stream: Vec<String>,
    /// Unwrapping methods, and spud_as_published: SPUD as the scripts of the paper have it, on the image before
    /// quantisation and without congruence [default without FILE: auto,spud]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Whether the lens blur is removed from recovered images [default without FILE: both]
    #[arg(long, value_parser = words(DEBLUR))]
    pub deblur: Option<Deblur>,
    /// The sensors.
    #[command(flatten)]
    pub sensor: SensorOptions<VariedParameters>,
    /// Detection models: ONNX files, or demo for the embedded model
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Input sizes of the model: auto (no resizing) or WIDTHxHEIGHT [default: auto]
    #[arg(long, value_delimiter = ',')]
    pub input: Vec<String>,
    /// Inference engine
    #[arg(long, value_parser = words(EngineChoice::WORDS))]
    pub engine: Option<EngineChoice>,
    /// Device that runs the model: cpu, cuda or tensorrt, the last two with the number of a GPU where it is not the first
    #[arg(long)]
    pub device: Option<String>,
    /// How the samples of the images stand for radiance.
    #[command(flatten)]
    pub coding: CodingOptions,
    /// Seed of the noise
    #[arg(long, allow_negative_numbers = true, value_parser = clap::value_parser!(i64).range(0..))]
    pub seed: Option<i64>,
}

/// Gives the nodes of the launch file with these arguments.
pub type Resolve<'a> = dyn Fn(&[(String, String)]) -> Result<Vec<PlannedNode>, GridError> + 'a;

/// Refuses two of `varied` that set the same parameter.
fn refuse_twice(varied: &[&Varied]) -> Result<(), GridError> {
    for (place, one) in varied.iter().enumerate() {
        if let Some(Varied { name: first, .. }) = varied[..place].iter().find(|other| one.is_same(other)) {
            let why = "set the same parameter; give all its values at once, by --vary or by its short form";
            return Err(GridError::Request(format!("{first} and {} {why}", one.name)));
        }
    }
    Ok(())
}

/// One value of everything that varies, by its name.
type Combination<'a> = Vec<(&'a str, &'a str)>;

impl Axes {
    /// Returns the nodes of each combination of `varied` and of these options. Without a launch file of the user (`is_short`), what is not
    /// given has the values of the options, and the ideal image is also that of a perfect lens.
    ///
    /// # Errors
    /// That of `resolve`, and [`GridError`] of a value that is not possible.
    pub fn variants(
        &self,
        resolve: &Resolve<'_>,
        varied: &[Varied],
        is_short: bool,
    ) -> Result<Vec<Variant>, GridError> {
        let is_idle = |varied: &&Varied| {
            let parameter = varied.name.split_once('.').map(|(_, parameter)| parameter);
            varied.values.len() > 1 && parameter.is_some_and(|name| WITHOUT_EFFECT.contains(&name))
        };
        if let Some(Varied { name, .. }) = varied.iter().find(is_idle) {
            return Err(GridError::value("vary", name, "a parameter that decides boxes or images"));
        }
        let own = self.varied(is_short, varied)?;
        // A parameter of a node is set after a short form, which is that of all nodes.
        let all: Vec<&Varied> = own.iter().chain(varied).collect();
        refuse_twice(&all)?;
        let streams = match &self.stream[..] {
            [] => is_short.then(|| STREAMS.map(str::to_owned).into()),
            given => Some(given.to_vec()),
        };
        let ideal = Some(vec!["ideal".to_owned()]);
        let is_sharp = is_short && streams.iter().flatten().any(|stream| stream == "ideal");
        let mut variants = Vec::new();
        for combination in combinations(&all) {
            // The ideal image without a lens is the best that a detector can get: deblurring is compared with it.
            let sharp = [&combination[..], &[("modulo_camera.psf_sigma", "0")]].concat();
            variants.extend(self.of(resolve, &combination, streams.as_deref())?);
            variants.extend(if is_sharp { self.of(resolve, &sharp, ideal.as_deref())? } else { Vec::new() });
        }
        Ok(variants)
    }

    /// These options as what varies. What is among `varied` needs no default.
    fn varied(&self, is_short: bool, varied: &[Varied]) -> Result<Vec<Varied>, GridError> {
        let mut sensor = self.sensor.clone();
        if let Some(file) = &self.sensor_file {
            let chip = CameraParameters::read_sensor(file);
            sensor.take_chip(&chip.map_err(|why| GridError::Request(why.to_string()))?);
        }
        let text = |values: &[Value]| values.iter().map(Value::plain).collect::<Vec<_>>();
        let of_sensor =
            |(name, values): &(&str, Vec<Value>)| Varied::new(format!("{CAMERA}.{name}"), text(values));
        let mut all: Vec<Varied> = sensor.given().map(of_sensor).collect();
        let own = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        let deblur = self.deblur.map(own).unwrap_or_default();
        let alphas = sensor.sensors().into_iter().map(|sensor| sensor.alpha.to_string());
        let paths = self.model.iter().map(|path| path.display().to_string());
        let axes: [(&str, Vec<String>, Vec<String>); 5] = [
            ("modulo_camera.alpha", Vec::new(), alphas.collect()),
            (METHOD[0], self.method.clone(), own(&["auto", "spud"])),
            ("unwrap.deblur", deblur, own(DEBLUR[0].1)),
            ("detector.model", paths.collect(), own(&["demo"])),
            ("detector.input_size", self.input.clone(), own(&["auto"])),
        ];
        for (name, given, default) in axes {
            let axis = Varied::new(name, given);
            let is_there = varied.iter().chain(&all).any(|other| other.parameter() == axis.parameter());
            let needs_default = axis.values.is_empty() && is_short && !is_there;
            all.push(if needs_default { Varied::new(name, default) } else { axis });
        }
        all.retain(|axis| !axis.values.is_empty());
        let CodingOptions { white, black, knees } = &self.coding;
        let given = [
            ("detector.engine", self.engine.map(|engine| engine.word().to_owned())),
            ("detector.device", self.device.clone()),
            ("modulo_camera.seed", self.seed.map(|seed| seed.to_string())),
            ("modulo_camera.white", (*white != 0.0).then(|| white.to_string())),
            ("modulo_camera.black", (*black != 0.0).then(|| black.to_string())),
            ("modulo_camera.knees", knees.as_ref().map(ToString::to_string)),
        ];
        all.extend(given.into_iter().filter_map(|(name, value)| Some(Varied::new(name, [value?]))));
        Ok(all)
    }

    /// The variants of a combination: that of the nodes of the suite, and those whose images no node makes.
    fn of(
        &self,
        resolve: &Resolve<'_>,
        combination: &Combination<'_>,
        streams: Option<&[String]>,
    ) -> Result<Vec<Variant>, GridError> {
        let method =
            combination.iter().rev().find(|(name, _)| METHOD.contains(name)).map(|(_, value)| *value);
        let is_published = method == Some(SPUD_AS_PUBLISHED);
        let of_nodes = combination.iter().filter(|(name, _)| !is_published || !METHOD.contains(name));
        let (set, given): (Vec<_>, Vec<_>) = of_nodes.copied().partition(|(name, _)| name.contains('.'));
        let given: Vec<_> =
            given.into_iter().map(|(name, value)| (name.to_owned(), value.to_owned())).collect();
        let mut nodes = resolve(&given)?;
        set.into_iter().try_for_each(|(name, value)| override_parameter(&mut nodes, name, value))?;
        if !is_published {
            return Ok(vec![Variant { nodes, wanted: streams.map(<[_]>::to_vec) }]);
        }
        let is_wanted = streams.is_none_or(|streams| streams.iter().any(|stream| stream == RECOVERED));
        let published = is_wanted.then(|| published(&nodes)).transpose()?;
        // What no node recovers is not metered either.
        let others = |stream: &&String| ![RECOVERED, "metered"].contains(&stream.as_str());
        let wanted: Vec<_> = streams.into_iter().flatten().filter(others).cloned().collect();
        let rest = (!wanted.is_empty()).then_some(Variant { nodes, wanted: Some(wanted) });
        Ok(published.into_iter().chain(rest).collect())
    }
}

/// [`SPUD_AS_PUBLISHED`] in the place of the camera and the unwrapping of `nodes`, with a detector as theirs.
fn published(nodes: &[PlannedNode]) -> Result<Variant, GridError> {
    let first = |executable: &str| {
        let found = nodes.iter().find(|node| node.executable == executable).cloned();
        found.ok_or_else(|| GridError::Request(format!("the launch file has no {executable}")))
    };
    let (mut camera, mut detector) = (first(CAMERA)?, first(DETECTOR)?);
    camera.executable = SPUD_AS_PUBLISHED;
    // It has three chips with one gain.
    let sensor = CameraParameters::from(&camera.parameters).sensor.reset(&["mosaic", "gains"]);
    let sensor: Vec<_> = sensor.to_text().into_iter().map(|(name, text)| (name.to_owned(), text)).collect();
    camera.parameters = camera.parameters.with_text(&sensor)?;
    detector.name.name = format!("detector_{RECOVERED}");
    detector.parameters = detector.parameters.with_text(&[("input", RECOVERED), ("cameras", "[]")])?;
    Ok(Variant { nodes: vec![camera, detector], wanted: None })
}

/// Every combination of the values, the last one fastest.
fn combinations<'v>(varied: &[&'v Varied]) -> Vec<Combination<'v>> {
    varied.iter().fold(vec![Vec::new()], |all, Varied { name, values }| {
        let with = |one: &Combination<'v>| {
            let with = |value: &'v String| [&one[..], &[(name.as_str(), value.as_str())]].concat();
            values.iter().map(with).collect::<Vec<_>>()
        };
        all.iter().flat_map(with).collect()
    })
}

/// Sets `NODE.PARAMETER` of each node of this name or executable.
fn override_parameter(nodes: &mut [PlannedNode], name: &str, value: &str) -> Result<(), GridError> {
    let (node, parameter) = name.rsplit_once('.').expect("a name without a dot is that of an argument");
    let full = |own: &PlannedNode| own.name.fully_qualified().trim_start_matches('/').replace('/', ".");
    let names: Vec<String> = nodes.iter().map(full).collect();
    let is_named =
        |own: &&mut PlannedNode| own.executable == node || own.name.name == node || full(own) == node;
    let mut named = nodes.iter_mut().filter(is_named).peekable();
    if named.peek().is_none() {
        let possible = format!("a launch argument, or a parameter of one of {}", names.join(", "));
        return Err(GridError::value("--vary", name, possible));
    }
    for own in named {
        own.parameters = own.parameters.with_text(&[(parameter, value)])?;
    }
    Ok(())
}
