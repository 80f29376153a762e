//! The command line, as clap reads it. The arguments of a command stand in the file of the command.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use modulo_eval::grid::words;
use modulo_runtime::wire::keys::Hashes;

use crate::LONG_VERSION;
use crate::command::{bag, bench, eval, graph, images, launch, model, param, run, view};

/// Commands that exchange messages with other nodes.
const GRAPH_COMMANDS: [&[&str]; 8] = [
    &["launch"],
    &["run"],
    &["bag", "record"],
    &["bag", "play"],
    &["param"],
    &["topic"],
    &["node"],
    &["view"],
];

/// The commands in the order of `modulo help`, by what one does with them.
const GROUPS: [(&str, &[&str]); 3] = [
    ("Run", &["launch", "run", "bag", "unwrap", "model", "completions"]),
    ("Look", &["view", "topic", "node", "param", "doctor"]),
    ("Measure", &["eval", "simulate", "bench", "stability"]),
];

/// Simulate a modulo camera, unwrap its images to high dynamic range and detect objects in them, as ROS 2-compatible
/// nodes
#[derive(Parser)]
#[command(name = "modulo", version, arg_required_else_help = true)]
pub struct Cli {
    /// Form of type hashes in topic keys: rihs01 as ROS 2 writes them since Iron, or none for ROS 2 Humble
    /// [default: MODULO_TYPE_HASH, else rihs01]
    #[arg(long, global = true, hide = true, value_parser = words(Hashes::WORDS))]
    pub hash: Option<Hashes>,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Subcommand)]
pub enum Command {
    /// Start the nodes of a ROS 2 launch file and supervise them
    Launch(launch::Launch),
    /// Run one node: modulo_camera, unwrap or detector
    #[command(disable_help_flag = true)]
    Run(run::Run),
    /// Record, replay, describe, convert, import and repair bags
    #[command(subcommand)]
    Bag(bag::Bag),
    /// Evaluate a launch file, or a grid of settings over labelled frames: every frame once, none dropped
    Eval(Box<eval::Eval>),
    /// Simulate the sensor on image files, unwrap the result, and compare the methods
    Simulate(images::Simulate),
    /// Unwrap modulo images of your own
    Unwrap(modulo_bench::recover::UnwrapRequest),
    /// Measure the inference engines and the whole pipeline
    #[command(subcommand)]
    Bench(bench::Bench),
    /// Run every unwrapping method on scenes that are hard to unwrap, and write a report
    Stability {
        /// Folder for index.html, results.json and the pictures
        #[arg(short, long, value_name = "FOLDER")]
        out: PathBuf,
    },
    /// Read and set parameters of running nodes
    #[command(subcommand)]
    Param(param::Param),
    /// List topics, print their messages and rates
    #[command(subcommand)]
    Topic(graph::TopicCommand),
    /// List nodes, print their publishers, subscriptions and services
    #[command(subcommand)]
    Node(graph::NodeCommand),
    /// Show the streams, boxes and latencies of a running suite on a web page, with controls for its parameters
    View(view::ViewCommand),
    /// Fetch official detection models, or check a model
    #[command(subcommand)]
    Model(model::Model),
    /// Print the chosen inference engine, how to get a faster one, how nodes meet, and what to expect of a sensor
    Doctor {
        /// Parameter file of the camera that describes a chip and its lens, such as sensors/mosaic.yaml: also print up to which alpha
        /// it is fit for real scenes
        #[arg(long, value_name = "FILE")]
        sensor: Option<PathBuf>,
    },
    /// Print a script that completes the command line in a shell
    Completions {
        /// Shell, such as bash; `modulo completions bash > ~/.local/share/bash-completion/completions/modulo` installs
        /// it
        shell: clap_complete::Shell,
    },
}

/// Reads the command line. A link named after a node runs that node. Every option takes a negative number, so that its
/// refusal names the possible range.
pub fn parse() -> Cli {
    let mut arguments: Vec<OsString> = std::env::args_os().collect();
    let called = arguments.first().map(PathBuf::from).unwrap_or_default();
    let called = called.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
    if crate::command::run::is_node(called) {
        // `ros2 run` and `ros2 launch` start a node by the name of its executable, which is such a link.
        arguments.splice(0..1, ["modulo", "run", called].map(OsString::from));
    }
    // The long version replaces only the text of --version; -V stays one line.
    let matches = with_negative_numbers(command()).long_version(LONG_VERSION).get_matches_from(arguments);
    Cli::from_arg_matches(&matches).unwrap_or_else(|why| why.exit())
}

/// Returns the command line. Its help lists the commands in groups; `--hash` is shown in the long help of commands that
/// exchange messages with other nodes.
pub fn command() -> clap::Command {
    let command = Cli::command();
    let command = command.help_template(help_template(&Cli::command()));
    // A global option is in the help of every command, so it is hidden and shown again where it has a
    // meaning.
    let hash = command.get_arguments().find(|argument| argument.get_id() == "hash");
    let hash = hash.expect("the field `hash` declares it").clone().hide(false).hide_short_help(true);
    GRAPH_COMMANDS.into_iter().fold(command, |command, path| with_argument(command, path, &hash))
}

/// Returns the help of `command` with its commands in groups: clap knows headings for options only.
fn help_template(command: &clap::Command) -> String {
    let (heading, literal) = (command.get_styles().get_header(), command.get_styles().get_literal());
    let names = || GROUPS.iter().flat_map(|(_, names)| *names);
    let widest = names().map(|name| name.len()).max().unwrap_or_default();
    let line = |name: &&str| {
        let about = command.find_subcommand(name).and_then(clap::Command::get_about);
        let about = about.expect("a test compares the groups with the commands");
        format!("  {literal}{name}{literal:#}{:1$}  {about}\n", "", widest - name.len())
    };
    let group = |(group, names): &(&str, &[&str])| {
        format!("\n{heading}{group}:{heading:#}\n{}", names.iter().map(line).collect::<String>())
    };
    format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n{}\n{heading}Options:{heading:#}\n{{options}}\n\n\
         `modulo help COMMAND` prints the help of a command.\n",
        GROUPS.iter().map(group).collect::<String>()
    )
}

pub fn help_of(name: &str) -> String {
    let (mut command, called) = (command(), format!("modulo {name}"));
    let subcommand = command.find_subcommand_mut(name).expect("a command asks for its own help");
    subcommand.clone().bin_name(called).render_help().to_string()
}

/// Adds `argument` to the subcommand that `path` leads to.
fn with_argument(command: clap::Command, path: &[&str], argument: &clap::Arg) -> clap::Command {
    match path {
        [] => command.arg(argument.clone()),
        [first, rest @ ..] => command.mut_subcommand(first, |sub| with_argument(sub, rest, argument)),
    }
}

pub(crate) fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let takes = |argument: clap::Arg| match argument.get_action().takes_values() {
        // A list such as -4,2 is not a number.
        true if argument.get_value_delimiter().is_some() => argument.allow_hyphen_values(true),
        value => argument.allow_negative_numbers(value),
    };
    command.mut_args(takes).mut_subcommands(with_negative_numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_one_group() {
        let command = Cli::command();
        let mut commands: Vec<_> = command.get_subcommands().map(clap::Command::get_name).collect();
        let mut grouped: Vec<_> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        commands.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(grouped, commands);
    }

    #[test]
    fn the_help_shows_each_group_with_its_commands() {
        let help = command().render_help().to_string();
        let mut lines = help.lines();
        for (group, names) in GROUPS {
            lines.find(|line| *line == format!("{group}:")).unwrap_or_else(|| panic!("{group} in\n{help}"));
            for name in names {
                let line = lines.next().unwrap_or_default();
                let about =
                    line.strip_prefix(&format!("  {name} ")).unwrap_or_else(|| panic!("{name} in\n{help}"));
                assert!(about.trim().len() > 10, "{line}");
            }
        }
        for part in ["Usage: modulo <COMMAND>", "  -h, --help", "modulo help COMMAND"] {
            assert!(help.contains(part), "{part} in\n{help}");
        }
        assert!(!help.contains("Commands:"), "{help}");
    }
}
