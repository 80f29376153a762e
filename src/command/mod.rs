//! The commands, one file for each, with its arguments.

/// Prints a line of the result, as `println!` does.
macro_rules! say {
    ($($text:tt)*) => {{
        $crate::command::terminal::say(format_args!($($text)*));
    }};
}

/// Prints a line of the log, as `note!` does.
macro_rules! note {
    ($($text:tt)*) => {
        $crate::command::terminal::note(format_args!($($text)*))
    };
}

pub mod bag;
mod camera_end;
pub mod colour;
pub mod completion;
pub mod demo;
pub mod detect;
#[cfg(test)]
#[path = "tests/documents.rs"]
mod documents;
pub mod eval;
pub mod graph;
pub mod images;
pub mod launch;
pub mod model;
pub mod param;
mod progress;
pub mod run;
pub mod terminal;
pub mod view;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use modulo_middleware::graph::logger::ApplyLevel;
use modulo_middleware::graph::rosout::RosoutLayer;
use modulo_middleware::process::signals::end_on_signals;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_runtime::ros_args::check_security;
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::{Clock, Stop, SystemClock};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{Directive, LevelFilter};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::reload;
use tracing_subscriber::util::SubscriberInitExt;

use crate::cli::Cli;
use crate::{Ended, Failure};

/// The environment variable of the form of type hashes: `rihs01` as ROS 2 writes them since Iron, or `none` for ROS 2 Humble.
const HASHES_VARIABLE: &str = "MODULO_TYPE_HASH";

/// Runs the command of `cli`.
pub fn dispatch(cli: Cli) -> Result<Ended, Failure> {
    match cli {
        Cli::Demo(args) => demo::demo(&args),
        Cli::Detect(args) => detect::detect(&args),
        Cli::Launch(args) => launch::launch(&args),
        Cli::Run(args) => run::run(&args),
        Cli::Bag(args) => bag::bag(&args),
        Cli::Eval(args) => eval::eval(&args),
        Cli::Simulate(args) => images::simulate(args),
        Cli::Unwrap(request) => images::unwrap(&request),
        Cli::Param(args) => param::param(&args),
        Cli::Topic(args) => graph::topic(&args),
        Cli::Node(args) => graph::node(&args),
        Cli::View(args) => view::view(&args),
        Cli::Model(args) => model::model(&args),
        Cli::Doctor { sensor, ramp, json } => model::doctor(sensor.as_deref(), ramp.as_deref(), json),
    }
}

fn usage(why: impl Into<anyhow::Error>) -> Failure {
    Failure::Usage(why.into())
}

/// Starts the log on standard error with the lines of the suite from `level` on.
fn start_log(level: &str) {
    drop(start_log_with(level, LevelFilter::TRACE, None));
}

/// Starts the log of a node: the lines from `level` on go to `/rosout`, and those that also pass `screen` to standard
/// error. Lines of libraries are shown with the level `debug` only. `RUST_LOG` adds directives: a level of its own concerns
/// the libraries, and `modulo=LEVEL` the suite. Returns a function that changes the level.
fn start_log_with(level: &str, screen: LevelFilter, rosout: Option<RosoutLayer>) -> ApplyLevel {
    // A library logs what it works around by itself, which a user of the suite cannot act on.
    let libraries = |level| if level == "debug" { "warn" } else { "off" };
    // rmw_zenoh sets RUST_LOG=warn in each process with a node, and so in all that `ros2 launch` starts. It must not hide the
    // lines of the suite, whose level ROS users set with `--log-level`.
    let more = std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default();
    // The library would print what it does not understand, and panic where that is not possible.
    let is_directive = |text: &&str| text.trim().is_empty() || text.parse::<Directive>().is_ok();
    let (more, unknown): (Vec<&str>, Vec<&str>) = more.split(',').partition(is_directive);
    let more = more.join(",");
    // The names of all crates of the suite begin with `modulo`. Of two directives for one target the later one holds.
    let directives = format!("{},modulo={level},{more}", libraries(level));
    let (filter, handle) = reload::Layer::new(EnvFilter::builder().parse_lossy(directives));
    let apply = move |level| {
        let directives = format!("{},{more},modulo={level}", libraries(level));
        // Fails only when another log was started before this one.
        let _ = handle.reload(EnvFilter::builder().parse_lossy(directives));
    };
    // For console, CLICOLOR_FORCE is stronger than NO_COLOR.
    let colourless = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let colour = !colourless && console::colors_enabled_stderr();
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| terminal::LogWriter)
        .with_ansi(colour)
        .with_target(false)
        .with_filter(screen);
    // Fails only when a log was started before, which then goes on.
    let _ = tracing_subscriber::registry().with(filter).with(lines).with(rosout).try_init();
    unknown.iter().for_each(|text| {
        tracing::warn!("RUST_LOG: '{text}' is left out, a directive is such as modulo=debug")
    });
    Box::new(apply)
}

fn domain() -> Result<u32, Failure> {
    // Empty is not set, as in ROS 2.
    let Some(text) = std::env::var_os("ROS_DOMAIN_ID").filter(|text| !text.is_empty()) else { return Ok(0) };
    let text = text.to_string_lossy();
    // ROS 2 allows these numbers: the ports of DDS end with them.
    let domain = text.trim().parse::<u32>().ok().filter(|domain| *domain <= 232);
    domain.ok_or_else(|| usage(anyhow!("ROS_DOMAIN_ID = '{text}': must be a number in 0 to 232")))
}

/// The machine's clock and a session in the domain of the environment.
fn open_session() -> Result<(Arc<dyn Clock>, ZenohTransport), Failure> {
    let variable = |name: &str| std::env::var(name).ok();
    let (enable, strategy) = (variable("ROS_SECURITY_ENABLE"), variable("ROS_SECURITY_STRATEGY"));
    if let Some(message) = check_security(enable.as_deref(), strategy.as_deref()).map_err(usage)? {
        tracing::warn!("{message}");
    }
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let transport = ZenohTransport::open(domain()?, hashes()?, clock.clone())?;
    Ok((clock, transport))
}

fn this_program() -> Result<PathBuf, Failure> {
    Ok(std::env::current_exe().context("this program")?)
}

/// `name:=value` pairs.
fn pairs(arguments: &[String]) -> Result<Vec<(String, String)>, Failure> {
    let pair = |text: &String| {
        let (name, value) = text.split_once(":=").ok_or_else(|| match text.split_once('=') {
            Some((name, value)) => anyhow!("'{text}' is not name:=value; write {name}:={value}"),
            None => anyhow!("'{text}' is not name:=value"),
        })?;
        Ok((name.to_owned(), value.to_owned()))
    };
    arguments.iter().map(pair).collect::<anyhow::Result<_>>().map_err(usage)
}

/// Returns a stop that SIGINT and SIGTERM ask for an end.
fn stop_on_signals() -> Result<Stop, Failure> {
    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    Ok(stop)
}

/// Returns the form of type hashes that the environment asks for.
fn hashes() -> Result<Hashes, Failure> {
    let Some(text) = std::env::var(HASHES_VARIABLE).ok().filter(|text| !text.is_empty()) else {
        return Ok(Hashes::default());
    };
    let found = Hashes::WORDS.into_iter().find(|(word, _)| *word == text);
    found.map(|(_, hashes)| hashes).ok_or_else(|| {
        let why = "is not a form of type hashes: rihs01 and none are possible";
        usage(anyhow!("{HASHES_VARIABLE}: '{text}' {why}"))
    })
}
