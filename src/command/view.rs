//! `modulo view`: the suite in a browser.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use anyhow::Context as _;
use clap::Args;
use modulo_bags::bag::BagReader;
use modulo_runtime::launcher;
use modulo_runtime::output::prepare_file;
use modulo_viewer::{RECORDING_BEGIN, ViewOptions};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::{open_session, start_log, stop_on_signals, this_program, usage};
use crate::{Ended, Failure};

#[derive(Args)]
pub struct ViewCommand {
    /// Bag to replay again and again meanwhile, as it was recorded: a folder, or an .mcap or .db3 file
    #[arg(value_name = "BAG")]
    pub replayed: Option<PathBuf>,
    /// Port of the page; 0 takes a free one
    #[arg(long, default_value_t = 8088)]
    pub port: u16,
    /// Address that is listened on. Only this machine can reach the default; 0.0.0.0 is open to the network, without encryption
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub address: IpAddr,
    /// Token that a browser needs; a new random one by default
    #[arg(long, value_parser = token)]
    pub token: Option<String>,
    /// At the end, write the last minute to this file, a page that needs no viewer: images twice a second, at most 64 MiB
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
}

/// Letters and digits need no quoting in an address, and fewer than 8 of them are soon guessed.
fn token(text: &str) -> Result<String, String> {
    let valid = text.len() >= 8 && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if valid { Ok(text.to_owned()) } else { Err("must be at least 8 letters and digits".to_owned()) }
}

pub fn view(args: &ViewCommand) -> Result<Ended, Failure> {
    let replay = |bag: &PathBuf| {
        BagReader::open(bag)?;
        Running::start(quiet_program()?.args(["bag", "play", "--loop"]).arg(bag))
    };
    let _replay = args.replayed.as_ref().map(replay).transpose()?;
    serve(args, |at| {
        say!("open {at} in a browser; SIGINT ends the viewer");
    })
}

/// Runs the viewer until a signal; tells its address when it can be reached.
pub fn serve(args: &ViewCommand, open: impl FnOnce(&str)) -> Result<Ended, Failure> {
    let prepare = |file: &PathBuf| prepare_file(file, Some(RECORDING_BEGIN));
    args.record.iter().try_for_each(prepare).map_err(usage)?;
    start_log("info");
    let stop = stop_on_signals()?;
    let options = ViewOptions {
        address: SocketAddr::new(args.address, args.port),
        token: args.token.clone(),
        record: args.record.clone(),
    };
    let (clock, transport) = open_session()?;
    let left_out = modulo_viewer::run(transport, clock, &options, &stop, open)?;
    if left_out > 0 {
        note!("{left_out} moments are not in the recording: each of them alone is larger than it may be");
    }
    Ok(Ended::of(left_out > 0))
}

/// Returns a command of this program that prints no counters.
pub fn quiet_program() -> Result<Command, Failure> {
    let mut program = Command::new(this_program()?);
    program.stdin(Stdio::null()).stdout(Stdio::null());
    Ok(program)
}

/// A process beside the viewer. It is ended when this is dropped.
pub struct Running(Child);

impl Running {
    /// Starts `command`. Ctrl-C reaches this process alone, which then ends the other one.
    pub fn start(command: &mut Command) -> Result<Self, Failure> {
        // It watches this process, which may be killed.
        command.env(launcher::PID, std::process::id().to_string());
        Ok(Self(command.process_group(0).spawn().with_context(|| format!("{command:?}"))?))
    }

    /// Asks it to end, and waits for it: `modulo launch` has time limits of its own.
    pub fn stop(&mut self) {
        // It is waited for once; before that, its number belongs to nobody else.
        if let Ok(None) = self.0.try_wait() {
            let _ = kill(Pid::from_raw(self.0.id().cast_signed()), Signal::SIGINT);
            let _ = self.0.wait();
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop();
    }
}
