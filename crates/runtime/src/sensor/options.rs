//! [`SensorOptions`]: the parameters of a sensor as options of a command line, as they are declared.

use std::marker::PhantomData;

use clap::builder::{PossibleValuesParser, TypedValueParser as _, ValueParser};
use clap::parser::ValueSource;
use clap::{Arg, ArgGroup, ArgMatches, Args, Command, FromArgMatches};

use modulo_images::{Coding, Knees};

use super::parameters::SensorModel;
use crate::parameter::{Allowed, Descriptor, ParameterSet as _, Parameters, Value};

/// The group of the options of the chip and the lens, which a sensor file sets.
pub const CHIP: &str = "chip";

/// Which parameters of [`SensorModel`] are options of a command.
pub trait SensorCommand {
    /// The parameters that are no options. They have their default, or the value of a sensor file.
    const WITHOUT: &'static [&'static str] = &[];

    /// Returns the sensor whose parameters are the defaults.
    fn defaults() -> SensorModel {
        SensorModel::default()
    }

    /// Returns whether this option takes several values.
    fn varies(_parameter: &str) -> bool {
        false
    }
}

/// The values of the parameters of a sensor on the command line of `C`.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorOptions<C> {
    /// The values of each parameter, at least one.
    values: Vec<(&'static str, Vec<Value>)>,
    /// The parameters that were given, and do not have their defaults for want of a value.
    given: Vec<&'static str>,
    command: PhantomData<C>,
}

impl<C> SensorOptions<C> {
    /// Returns the sensor with the first value of each parameter.
    pub fn first(&self) -> SensorModel {
        self.sensors().remove(0)
    }

    /// Returns the parameters that were given, with their values.
    pub fn given(&self) -> impl Iterator<Item = &(&'static str, Vec<Value>)> {
        self.values.iter().filter(|(name, _)| self.given.contains(name))
    }

    /// Returns the sensor of each alpha; other parameters have their first value.
    pub fn sensors(&self) -> Vec<SensorModel> {
        let first = self.values.iter().map(|(name, values)| ((*name).to_owned(), values[0].clone()));
        let first: Vec<(String, Value)> = first.collect();
        let sensor = Parameters::declare(SensorModel::descriptors());
        let with = |sensor: &Parameters, pairs: &[_]| {
            sensor.with(pairs, false).expect("the command line has refused all other values")
        };
        let (sensor, alphas) =
            (with(&sensor, &first), self.values.iter().filter(|(name, _)| *name == "alpha"));
        let of = |alpha: &Value| (&with(&sensor, &[("alpha".to_owned(), alpha.clone())])).into();
        alphas.flat_map(|(_, values)| values).map(of).collect()
    }

    /// Takes the chip and the lens of `sensor`.
    pub fn take_chip(&mut self, sensor: &SensorModel) {
        let chip = SensorModel::of_chip();
        for (own, (declared, value)) in self.values.iter_mut().zip(sensor.declared()) {
            if chip.contains(&declared.name) {
                own.1 = vec![value];
                self.given.push(declared.name);
            }
        }
    }
}

/// How the samples of the images of a command stand for radiance, as options of its command line.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct CodingOptions {
    /// Value that becomes full scale, for EXR, HDR and 16-bit images. 0: the 99.9th percentile of the first EXR or HDR
    /// image (modulo simulate: of each), and 65536 for 16-bit images
    #[arg(long, default_value_t = 0.0)]
    pub white: f32,
    /// Value without light (the black level), whose radiance is 0
    #[arg(long, default_value_t = 0.0)]
    pub black: f32,
    /// Knee points of companded codes, CODE:VALUE with rising codes and linear values, such as
    /// 1023:1023,2559:4095,3455:32767,3967:65535; the last value is full scale
    #[arg(long)]
    pub knees: Option<Knees>,
}

impl CodingOptions {
    /// Returns the coding of images that `sensor` sees.
    pub fn of(&self, sensor: &SensorModel) -> Coding {
        let Self { white, black, knees } = self.clone();
        Coding { white, black, knees, transfer: sensor.transfer, mosaic: sensor.mosaic }
    }
}

fn option<C: SensorCommand>((parameter, default): (Descriptor, Value)) -> Arg {
    let Descriptor { name, description, .. } = parameter;
    let help = description.trim_end_matches('.');
    let default = default.plain();
    let (help, parser) = match &parameter.allowed {
        Allowed::Words(words) => {
            let words = PossibleValuesParser::new(words.clone()).map(Value::String);
            (help.to_owned(), ValueParser::new(words))
        }
        range => {
            let help = format!("{help} [{range}]");
            (help, ValueParser::new(move |text: &str| parameter.read(text)))
        }
    };
    let option = Arg::new(name).long(name.replace('_', "-")).value_name(name.to_uppercase()).help(help);
    let option = option.value_parser(parser).default_value(default).allow_negative_numbers(true);
    if !C::varies(name) {
        return option;
    }
    option.value_delimiter(',').value_name(format!("{},...", name.to_uppercase()))
}

impl<C: SensorCommand> Args for SensorOptions<C> {
    fn augment_args(command: Command) -> Command {
        let mut parameters = C::defaults().declared();
        parameters.retain(|(parameter, _)| !C::WITHOUT.contains(&parameter.name));
        let chip = SensorModel::of_chip().into_iter().filter(|name| !C::WITHOUT.contains(name));
        let chip = ArgGroup::new(CHIP).multiple(true).args(chip);
        command.args(parameters.into_iter().map(option::<C>)).group(chip)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<C: SensorCommand> FromArgMatches for SensorOptions<C> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let values = |(Descriptor { name, .. }, default)| {
            let given = if C::WITHOUT.contains(&name) { None } else { matches.get_many::<Value>(name) };
            (name, given.map_or_else(|| vec![default], |given| given.cloned().collect()))
        };
        let mut values: Vec<_> = C::defaults().declared().into_iter().map(values).collect();
        // A width is that of a Gaussian, also where another shape is the default.
        let is_given = |name: &str| {
            !C::WITHOUT.contains(&name) && matches.value_source(name) == Some(ValueSource::CommandLine)
        };
        if is_given("psf_sigma") && !is_given("psf") {
            let shapes = values.iter_mut().filter(|(name, _)| *name == "psf");
            shapes.for_each(|(_, shape)| *shape = vec![Value::String("gaussian".to_owned())]);
        }
        let given = values.iter().map(|(name, _)| *name).filter(|name| is_given(name)).collect();
        Ok(Self { values, given, command: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
