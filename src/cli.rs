//! The command line, as clap reads it. The arguments of a command stand in the file of the command.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser};
use clap_complete::CompleteEnv;
use modulo_runtime::input::in_home;

use crate::LONG_VERSION;
use crate::command::{bag, demo, detect, eval, graph, images, launch, model, param, run, terminal, view};

/// Simulate a modulo camera, unwrap its images to high dynamic range and detect objects in them, as ROS 2 nodes
#[derive(Parser)]
#[command(
    name = "modulo",
    version,
    arg_required_else_help = true,
    after_help = "As in ROS 2: modulo run, topic, node and param.\n\
                  To complete words in bash or zsh: source <(COMPLETE=bash modulo), with the name of the shell."
)]
pub enum Cli {
    /// Show what a modulo camera sees at a low sun, on a web page or as a picture
    Demo(demo::Demo),
    /// Write the pictures of a source with the boxes of its objects
    Detect(detect::Detect),
    /// Start and supervise the nodes of a ROS 2 launch file
    Launch(launch::Launch),
    /// Show the streams, boxes, times and parameters of a running suite on a web page
    View(view::ViewCommand),
    /// Evaluate a launch file, or a grid of settings, over every frame once
    Eval(Box<eval::Eval>),
    /// Simulate the sensor on image files, and unwrap the result
    Simulate(images::Simulate),
    /// Unwrap modulo images of your own
    Unwrap(modulo_eval::images::recover::UnwrapRequest),
    /// Record, replay, describe, convert and repair bags
    #[command(subcommand)]
    Bag(bag::Bag),
    /// Fetch or check detection models
    #[command(subcommand)]
    Model(model::Model),
    /// Print the inference engine, video and network of this machine
    Doctor {
        /// Parameter file of the camera that describes a chip and its lens, such as sensors/mosaic.yaml: also print up to which alpha
        /// it is fit for real scenes
        #[arg(long, value_name = "FILE")]
        sensor: Option<PathBuf>,
        /// Bag with images /modulo of a chip, in which the light rises by the same step from frame to frame: also print how its pixels
        /// reset themselves, each value with its error. The codes have the bits of the file of --sensor, or 8
        #[arg(long, value_name = "BAG")]
        ramp: Option<PathBuf>,
        /// Print what is found as JSON
        #[arg(long)]
        json: bool,
    },
    /// Run one node: modulo_camera, unwrap or detector
    #[command(disable_help_flag = true, hide = true)]
    Run(run::Run),
    /// List topics, print their messages and rates
    #[command(subcommand, hide = true)]
    Topic(graph::TopicCommand),
    /// List nodes, print their publishers, subscriptions and services
    #[command(subcommand, hide = true)]
    Node(graph::NodeCommand),
    /// Read and set parameters of running nodes
    #[command(subcommand, hide = true)]
    Param(param::Param),
}

/// Reads the command line. A link named after a node runs that node. Every option takes a negative number, so that its
/// refusal names the possible range. `None` where the environment has asked for words for a shell, which have been printed.
///
/// # Errors
/// The refusal of the command line, or the help that it asks for.
pub fn parse() -> Result<Option<Cli>, clap::Error> {
    let folder = std::env::current_dir().ok();
    match CompleteEnv::with_factory(Cli::command).try_complete(std::env::args_os(), folder.as_deref()) {
        Ok(false) => {}
        Ok(true) => return Ok(None),
        Err(why) if why.kind() == ErrorKind::Io => {
            // The library does not tell which error it was: a line more meets it again.
            terminal::say(format_args!(""));
            return Ok(None);
        }
        Err(why) => return Err(why),
    }
    let mut arguments: Vec<OsString> = std::env::args_os().collect();
    let called = arguments.first().map(PathBuf::from).unwrap_or_default();
    let called = called.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
    if crate::command::run::is_node(called) {
        // `ros2 run` and `ros2 launch` start a node by the name of its executable, which is such a link.
        arguments.splice(0..1, ["modulo", "run", called].map(OsString::from));
    }
    if arguments.get(1).is_some_and(|word| word == "bench") {
        let gone = "bench is gone: modulo eval --vary detector.engine=ort,rten --time-frames 100 compares engines, and modulo eval stability methods\n";
        return Err(clap::Error::raw(ErrorKind::InvalidSubcommand, gone));
    }
    // The long version replaces only the text of --version; -V stays one line.
    let command = with_short_help(with_home(with_negative_numbers(Cli::command())));
    let matches = command.long_version(LONG_VERSION).try_get_matches_from(arguments)?;
    Cli::from_arg_matches(&matches).map(Some)
}

pub fn help_of(name: &str) -> String {
    let (mut command, called) = (Cli::command(), format!("modulo {name}"));
    let subcommand = command.find_subcommand_mut(name).expect("a command asks for its own help");
    subcommand.clone().bin_name(called).render_help().to_string()
}

/// The options that -h leaves to --help, since few commands need them.
const RARE: &str = "\
    shot_noise full_well_electrons prnu hot_pixels modulus reset_loss reset_spread psf gain_ratio headroom black_level metering \
    metering_target exposure_delay exposure_step white black knees seed repeats threads device \
    jobs time_frames class_map groups fresh list coco_images bag topics verbose deblur token compression \
    difficulty gains read_noise mosaic hang_timeout max_restarts trace";

/// Gives each option with a text of several sentences or clauses the first one for -h. --help has all of the text, and -h says where it has
/// more options. The commands below the first ones have no command `help` beside the option.
fn with_short_help(command: clap::Command) -> clap::Command {
    let is_rare = |argument: &&clap::Arg| RARE.split(' ').any(|rare| rare == argument.get_id().as_str());
    let shorten = |argument: clap::Arg| {
        let is_rare = is_rare(&&argument);
        let argument = argument.hide_short_help(is_rare);
        let full = argument.get_help().map(ToString::to_string).unwrap_or_default();
        let ends = [". ", "; ", ": ", " (", " ["].map(|mark| full.find(mark));
        let short = full[..ends.into_iter().flatten().min().unwrap_or(full.len())].to_owned();
        // A flag has the possible values true and false for clap itself.
        let values =
            argument.get_possible_values().into_iter().filter(|_| argument.get_action().takes_values());
        let values: Vec<String> = values.map(|value| value.get_name().to_owned()).collect();
        match (values.is_empty(), short == full) {
            (true, true) => argument,
            (true, false) => argument.help(short).long_help(full),
            (false, _) => {
                let full = format!("{full}\n\n[possible values: {}]", values.join(", "));
                argument.help(short).long_help(full).hide_possible_values(true)
            }
        }
    };
    let command = match command.is_disable_help_flag_set() {
        true => command,
        false => command.disable_help_flag(true).arg(
            clap::Arg::new("help")
                .short('h')
                .long("help")
                .action(clap::ArgAction::Help)
                .help("Print the most used help, and all of it with --help"),
        ),
    };
    let command = match command.get_arguments().filter(is_rare).count() {
        0 => command,
        1 => command.after_help("--help has one more option.").after_long_help(""),
        rare => command.after_help(format!("--help has {rare} more options.")).after_long_help(""),
    };
    let below = |command: clap::Command| with_short_help(command.disable_help_subcommand(true));
    command.mut_args(shorten).mut_subcommands(below)
}

pub(crate) fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let takes = |argument: clap::Arg| match argument.get_action().takes_values() {
        // A list such as -4,2 is not a number.
        true if argument.get_value_delimiter().is_some() => argument.allow_hyphen_values(true),
        value => argument.allow_negative_numbers(value),
    };
    command.mut_args(takes).mut_subcommands(with_negative_numbers)
}

/// Lets each path begin with `~`, which a shell leaves as it is behind `=`.
fn with_home(command: clap::Command) -> clap::Command {
    let of_path = clap::value_parser!(PathBuf).type_id();
    let expand = |argument: clap::Arg| match argument.get_value_parser().type_id() == of_path {
        true => argument.value_parser(PathBufValueParser::new().map(|path| in_home(&path))),
        false => argument,
    };
    command.mut_args(expand).mut_subcommands(with_home)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_possible() {
        with_short_help(with_negative_numbers(Cli::command())).debug_assert();
    }

    /// A name in [`RARE`] that no option has would hide nothing.
    #[test]
    fn each_rare_option_exists() {
        fn names(command: &clap::Command, all: &mut Vec<String>) {
            all.extend(command.get_arguments().map(|argument| argument.get_id().to_string()));
            command.get_subcommands().for_each(|below| names(below, all));
        }
        let mut all = Vec::new();
        names(&Cli::command(), &mut all);
        let missing: Vec<&str> =
            RARE.split(' ').filter(|rare| !all.iter().any(|name| name == rare)).collect();
        assert_eq!(missing, [""; 0]);
    }
}
