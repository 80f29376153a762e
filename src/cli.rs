//! The command line, as clap reads it.

pub mod bag;
pub mod eval;
pub mod graph;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use modulo_detector::EngineChoice;
use modulo_eval::grid::words;
use modulo_runtime::transport::keys::Hashes;

/// Version of the suite.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Version, commit, target and inference engines of this binary.
pub const LONG_VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    "\ncommit:  ",
    env!("MODULO_COMMIT"),
    "\ntarget:  ",
    env!("MODULO_TARGET"),
    "\nengines: rten (built in), ort (ONNX Runtime, loaded at run time where its library is found)"
);

/// Commands that exchange messages with other nodes.
const ON_THE_GRAPH: [&[&str]; 7] =
    [&["launch"], &["run"], &["bag", "record"], &["bag", "play"], &["param"], &["topic"], &["node"]];

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
    Launch(Launch),
    /// Run one node: modulo_camera, unwrap or detector
    #[command(disable_help_flag = true)]
    Run(Run),
    /// Record, replay, describe, convert, import and repair bags
    #[command(subcommand)]
    Bag(bag::Bag),
    /// Evaluate a launch file, or a grid of settings over labelled frames: every frame once, none dropped
    Eval(Box<eval::Eval>),
    /// Simulate the sensor on image files and unwrap the result
    Simulate(modulo_bench::simulate::SimulationRequest),
    /// Measure the unwrapping methods
    #[command(subcommand)]
    Bench(Bench),
    /// Run all methods on the scenes on which methods fail, and show the results
    Stability {
        /// Folder for index.html, results.json and the pictures
        #[arg(short, long, value_name = "FOLDER")]
        out: PathBuf,
    },
    /// Read and set parameters of running nodes
    #[command(subcommand)]
    Param(Param),
    /// List topics, print their messages and rates
    #[command(subcommand)]
    Topic(graph::Topic),
    /// List nodes, print their publishers, subscriptions and services
    #[command(subcommand)]
    Node(graph::Node),
    /// Fetch official detection models, or check a model
    #[command(subcommand)]
    Model(Model),
    /// Print the chosen inference engine, how to get a faster one, and how nodes meet
    Doctor,
    /// Print a script that completes the command line in a shell
    Completions {
        /// Shell, such as bash; `modulo completions bash > ~/.local/share/bash-completion/completions/modulo` installs
        /// it
        shell: clap_complete::Shell,
    },
    /// Write a manual page for each command
    Man {
        /// Folder for the pages, such as ~/.local/share/man/man1
        folder: PathBuf,
    },
}

/// `modulo launch`
#[derive(Args)]
pub struct Launch {
    /// Launch file (ROS 2 YAML). Without it, the launch files that are found are listed
    pub file: Option<PathBuf>,
    /// Arguments as name:=value
    pub arguments: Vec<String>,
    /// Run all nodes in this one process
    #[arg(long)]
    pub compose: bool,
    /// Write the summary to this file as JSON
    #[arg(long, value_name = "FILE")]
    pub summary: Option<PathBuf>,
    /// End with exit code 3 also when newer images replaced older ones
    #[arg(long)]
    pub strict: bool,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short, conflicts_with_all = ["print", "check", "show_args"])]
    pub verbose: bool,
    /// Say what the file would start, and end
    #[arg(long, conflicts_with_all = ["compose", "summary"])]
    pub print: bool,
    /// Say every mistake in the file with its line, or that there is none, and end
    #[arg(long, conflicts_with_all = ["compose", "summary", "print", "show_args"])]
    pub check: bool,
    /// List the file's arguments, and end
    #[arg(long, short = 's', conflicts_with_all = ["compose", "summary", "print"])]
    pub show_args: bool,
}

/// `modulo run`
#[derive(Args)]
pub struct Run {
    /// Name of the node: modulo_camera, unwrap or detector
    pub node: String,
    /// --ros-args ... as ROS 2 writes them, or --help
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}

/// `modulo bench`
#[derive(Subcommand)]
pub enum Bench {
    /// Measure the time and the accuracy of every method, and draw a chart of both
    Unwrap(modulo_bench::benchmark::BenchmarkRequest),
    /// Draw the charts of the results in a folder again
    Chart {
        /// Folder with results.json and meta.json
        folder: PathBuf,
    },
}

/// `modulo param`
#[derive(Subcommand)]
pub enum Param {
    /// List the parameters of a node, or of all nodes
    List {
        /// Fully qualified node name, such as /detector
        node: Option<String>,
        /// Also print the types
        #[arg(long)]
        param_type: bool,
    },
    /// Print the value of a parameter
    Get {
        /// Fully qualified node name
        node: String,
        /// Name of the parameter
        name: String,
        /// Print the value without its type
        #[arg(long)]
        hide_type: bool,
    },
    /// Print the type, meaning and range of parameters
    Describe {
        /// Fully qualified node name
        node: String,
        /// Names of the parameters
        #[arg(required = true)]
        names: Vec<String>,
    },
    /// Print all values as a file for --params-file
    Dump {
        /// Fully qualified node name
        node: String,
    },
    /// Change the value of a parameter, which the node may refuse
    Set {
        /// Fully qualified node name
        node: String,
        /// Name of the parameter
        name: String,
        /// New value
        #[arg(allow_hyphen_values = true)]
        value: String,
    },
}

/// `modulo model`
#[derive(Subcommand)]
pub enum Model {
    /// Download an official YOLOv10 export, checked by sha256 (weights: AGPL-3.0)
    Fetch(ModelFetch),
    /// Print the input, output, engine and speed of a model
    Check(ModelCheck),
}

/// `modulo model fetch`
#[derive(Args)]
pub struct ModelFetch {
    /// Name of the export: yolov10n, yolov10s, yolov10m, yolov10b, yolov10l or yolov10x
    pub name: String,
    /// Folder for the file NAME.onnx
    #[arg(short, long, value_name = "FOLDER", default_value = "./")]
    pub out: PathBuf,
    /// Another URL of the file, such as that of a mirror
    #[arg(long)]
    pub url: Option<String>,
    /// Expected sha256 of the file, in place of the known one
    #[arg(long, value_name = "HEX")]
    pub sha256: Option<String>,
}

/// `modulo model check`
#[derive(Args)]
pub struct ModelCheck {
    /// Path of the ONNX file
    pub file: PathBuf,
    /// Inference engine: ONNX Runtime (ort), rten, or auto for ONNX Runtime where its library is found, and rten
    /// elsewhere
    #[arg(long, default_value = "auto", value_parser = words(EngineChoice::WORDS))]
    pub engine: EngineChoice,
}

/// Reads the command line. A link named after a node runs that node. Every option takes a negative number, so that its
/// refusal names the possible range.
pub fn parse() -> Cli {
    let mut arguments: Vec<OsString> = std::env::args_os().collect();
    let called = arguments.first().map(PathBuf::from).unwrap_or_default();
    let called = called.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
    if crate::registry::KINDS.iter().any(|kind| kind.name == called) {
        arguments.splice(0..1, ["modulo", "run", called].map(OsString::from));
    }
    let matches = with_negative_numbers(command()).long_version(LONG_VERSION).get_matches_from(arguments);
    Cli::from_arg_matches(&matches).unwrap_or_else(|why| why.exit())
}

/// Returns the command line. `--hash` is shown in the long help of commands that exchange messages with other nodes.
pub fn command() -> clap::Command {
    let command = Cli::command();
    let hash = command.get_arguments().find(|argument| argument.get_id() == "hash");
    let hash = hash.expect("the field `hash` declares it").clone().hide(false).hide_short_help(true);
    ON_THE_GRAPH.into_iter().fold(command, |command, path| with_argument(command, path, &hash))
}

/// Adds `argument` to the subcommand that `path` leads to.
fn with_argument(command: clap::Command, path: &[&str], argument: &clap::Arg) -> clap::Command {
    match path {
        [] => command.arg(argument.clone()),
        [first, rest @ ..] => command.mut_subcommand(first, |sub| with_argument(sub, rest, argument)),
    }
}

fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let takes = |argument: clap::Arg| match argument.get_action().takes_values() {
        // A list such as -4,2 is not a number.
        true if argument.get_value_delimiter().is_some() => argument.allow_hyphen_values(true),
        value => argument.allow_negative_numbers(value),
    };
    command.mut_args(takes).mut_subcommands(with_negative_numbers)
}
