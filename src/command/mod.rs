//! One file a subcommand.

/// `println!` for a reader that may leave, such as `head`: that is nobody's mistake.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}

mod bag;
mod bench;
mod doctor;
mod eval;
mod graph;
mod grid;
mod hash;
mod launch;
mod model;
mod param;
mod report;
mod run;

use std::io::IsTerminal;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::CommandFactory;
use modulo_runtime::ros_args::Logs;
use modulo_runtime::rosout::RosoutLayer;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{Clock, Stop, SystemClock, end_on_signals};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use crate::cli::{Cli, Command};
use crate::{Ended, Failure};

/// Runs the command of `cli`.
pub fn dispatch(cli: Cli) -> Result<Ended, Failure> {
    cli.hash.into_iter().for_each(hash::choose);
    match cli.command {
        Command::Launch(args) => launch::launch(&args),
        Command::Run(args) => run::run(&args),
        Command::Bag(args) => bag::bag(&args),
        Command::Eval(args) => eval::eval(&args),
        Command::Simulate(args) => bench::simulate(&args),
        Command::Bench(command) => bench::bench(&command),
        Command::Stability { out } => bench::stability(&out),
        Command::Param(args) => param::param(&args),
        Command::Topic(args) => graph::topic(&args),
        Command::Node(args) => graph::node(&args),
        Command::Model(args) => model::model(&args),
        Command::Doctor => doctor::doctor(),
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Cli::command(), "modulo", &mut std::io::stdout());
            Ok(Ended::Done)
        }
        Command::Man { folder } => {
            std::fs::create_dir_all(&folder)
                .and_then(|()| clap_mangen::generate_to(Cli::command(), &folder))
                .with_context(|| folder.display().to_string())?;
            Ok(Ended::Done)
        }
    }
}

fn usage(why: impl Into<anyhow::Error>) -> Failure {
    Failure::Usage(why.into())
}

/// Logs go to standard error; `RUST_LOG` chooses, `info` of the suite without.
fn start_log(level: Option<&str>) {
    start_log_with(level, Logs::Enabled, None);
}

/// The log of a node: `shown` on standard error or not, and on `/rosout` too.
fn start_log_with(level: Option<&str>, shown: Logs, rosout: Option<RosoutLayer>) {
    let default = format!(
        "warn,modulo={0},modulo_camera={0},modulo_unwrap={0},modulo_detector={0},\
                           modulo_runtime={0},modulo_bags={0},modulo_launch={0}",
        level.unwrap_or("info")
    );
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false);
    let lines = (shown == Logs::Enabled).then_some(lines);
    // Fails only when a log was started before, which then goes on.
    let _ = tracing_subscriber::registry().with(filter).with(lines).with(rosout).try_init();
}

fn domain() -> Result<u32, Failure> {
    let Ok(text) = std::env::var("ROS_DOMAIN_ID") else { return Ok(0) };
    let domain = text.trim().parse::<u32>().ok().filter(|domain| *domain <= 232);
    domain.ok_or_else(|| usage(anyhow!("ROS_DOMAIN_ID = '{text}': must be a number in 0 to 232")))
}

/// The machine's clock and a session in the domain of the environment.
fn open_session() -> Result<(Arc<dyn Clock>, ZenohTransport), Failure> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let transport = ZenohTransport::open(domain()?, hash::chosen()?, clock.clone())?;
    Ok((clock, transport))
}

/// `name:=value` pairs.
fn pairs(arguments: &[String]) -> Result<Vec<(String, String)>, Failure> {
    let pair = |text: &String| {
        let (name, value) = text.split_once(":=").with_context(|| format!("'{text}' is not name:=value"))?;
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
