//! [`Axes`]: the nodes of a launch file for each combination of what varies.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Parser;
use modulo_runtime::sensor::options::{SensorCommand, SensorOptions};
use modulo_runtime::{ParameterSet as _, Value};

use crate::GridError;
use crate::makers::OF_PAPER;
use crate::paper::SPUD_AS_PUBLISHED;
use crate::plan::{CAMERA, PlannedNode, Variant, WITHOUT_EFFECT};
use crate::research;
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
    /// One value of `name`.
    pub fn one(name: &str, value: String) -> Self {
        Self::new(name, [value])
    }

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
/// The two ways of a frame to the detector, and whether it is that of the paper.
const PROTOCOLS: [(&str, bool); 2] = [("suite", false), ("paper", true)];
/// The names of the method, as a parameter and as an argument of the launch files of the suite.
const METHOD: [&str; 2] = ["unwrap.method", "method"];

/// Short forms of `--vary`. Without a launch file, some of them have several values by default.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(mut_arg("alpha", |option| option.default_value("1.5,2,3,4")))]
pub struct Axes {
    /// Streams to evaluate, of those that detectors read; also multi_exposure and multi_exposure_still, three merged captures of a normal camera
    /// [default without FILE: ideal,saturated,modulo,recovered]
    #[arg(long, value_delimiter = ',')]
    pub stream: Vec<String>,
    /// Unwrapping methods, and spud_as_published: SPUD as the scripts of the paper have it, on the image before
    /// quantisation and without congruence [default without FILE: auto,spud; spud_as_published,spud for the paper]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Whether the lens blur is removed from recovered images [default without FILE: both; off for the paper]
    #[arg(long, value_parser = words(DEBLUR))]
    pub deblur: Option<Deblur>,
    /// The sensors.
    #[command(flatten)]
    pub sensor: SensorOptions<VariedParameters>,
    /// Detection models: ONNX files, or demo for the embedded model
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Input sizes of the model: auto (no resizing) or WIDTHxHEIGHT [default: auto; 640x640 for the paper]
    #[arg(long, value_delimiter = ',')]
    pub input: Vec<String>,
    /// How a frame reaches the detector: through the nodes of the suite, or as in the scripts of the paper
    #[arg(long = "protocol", action = clap::ArgAction::Set, default_value = "suite", value_parser = words(PROTOCOLS))]
    pub is_paper: bool,
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
        if self.is_paper {
            self.check_paper()?;
        }
        let is_idle = |varied: &&Varied| {
            let parameter = varied.name.split_once('.').map(|(_, parameter)| parameter);
            varied.values.len() > 1 && parameter.is_some_and(|name| WITHOUT_EFFECT.contains(&name))
        };
        if let Some(Varied { name, .. }) = varied.iter().find(is_idle) {
            return Err(GridError::value("vary", name, "a parameter that decides boxes or images"));
        }
        let own = self.varied(is_short, varied);
        // A parameter of a node is set after a short form, which is that of all nodes.
        let all: Vec<&Varied> = own.iter().chain(varied).collect();
        refuse_twice(&all)?;
        let streams = match &self.stream[..] {
            [] => is_short.then(|| OF_PAPER.map(str::to_owned).into()),
            given => Some(given.to_vec()),
        };
        let ideal = Some(vec!["ideal".to_owned()]);
        let is_sharp = is_short && !self.is_paper && streams.iter().flatten().any(|stream| stream == "ideal");
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
    fn varied(&self, is_short: bool, varied: &[Varied]) -> Vec<Varied> {
        let text = |values: &[Value]| values.iter().map(Value::plain).collect::<Vec<_>>();
        let of_sensor =
            |(name, values): &(&str, Vec<Value>)| Varied::new(format!("{CAMERA}.{name}"), text(values));
        let mut all: Vec<Varied> = self.sensor.given().map(of_sensor).collect();
        let own = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        let deblur = self.deblur.map(own).unwrap_or_default();
        let alphas = self.sensor.sensors(&["alpha"]).into_iter().map(|sensor| sensor.alpha.to_string());
        let paths = self.model.iter().map(|path| path.display().to_string());
        let (method, deblurs, input) = match self.is_paper {
            true => (SPUD_AS_PUBLISHED, DEBLUR[2].1, "640x640"),
            false => ("auto", DEBLUR[0].1, "auto"),
        };
        let axes: [(&str, Vec<String>, Vec<String>); 5] = [
            ("modulo_camera.alpha", Vec::new(), alphas.collect()),
            (METHOD[0], self.method.clone(), own(&[method, "spud"])),
            ("unwrap.deblur", deblur, own(deblurs)),
            ("detector.model", paths.collect(), own(&["demo"])),
            ("detector.input_size", self.input.clone(), own(&[input])),
        ];
        for (name, given, default) in axes {
            let axis = Varied::new(name, given);
            let is_there = varied.iter().chain(&all).any(|other| other.parameter() == axis.parameter());
            let needs_default = axis.values.is_empty() && is_short && !is_there;
            all.push(if needs_default { Varied::new(name, default) } else { axis });
        }
        all.retain(|axis| !axis.values.is_empty());
        all
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
        research::variants(nodes, (method.unwrap_or_default(), self.is_paper), streams)
    }

    /// The scripts of the paper have a fixed lens and no noise. Other values would be ignored, which the results would not
    /// show.
    fn check_paper(&self) -> Result<(), GridError> {
        let paper = research::sensor_of_paper(1.0).declared();
        let other = |(name, values): &&(&str, Vec<Value>)| {
            *name != "alpha"
                && values
                    .iter()
                    .any(|value| !paper.iter().any(|(own, of_paper)| own.name == *name && of_paper == value))
        };
        let Some((name, values)) = self.sensor.given().find(other) else { return Ok(()) };
        let possible = "that of the paper: blur 1.4 px (7 taps), headroom 1, no black columns, no noise, one gain, no mosaic";
        Err(GridError::value(
            "the sensor",
            format!("{} {}", name.replace('_', " "), values[0].plain()),
            possible,
        ))
    }
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
