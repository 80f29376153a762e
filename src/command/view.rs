//! `modulo view`: the suite in a browser.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use anyhow::Context as _;
use clap::Args;
use modulo_bags::bag::BagReader;
use modulo_core::{Detection, Frame};
use modulo_detector::{Detector, DetectorParameters};
use modulo_runtime::output::prepare_file;
use modulo_runtime::{ParameterSet as _, launcher};
use modulo_viewer::{RECORDING_BEGIN, ViewAddresses, ViewOptions};
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
    /// Also serve Foxglove and Lichtblick over WebSocket, on this port of the same address; 0 takes a free one. They see all
    /// images and parameters without the token, but set parameters only with it
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "8765")]
    pub foxglove: Option<u16>,
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
        say!("open {} in a browser; SIGINT ends the viewer", at.page);
        if let Some(address) = &at.foxglove {
            say!(
                "open {address} in Foxglove; set the parameter `token` there to {} to change others",
                at.token
            );
        }
    })
}

/// Runs the viewer until a signal; tells its addresses when it can be reached.
pub fn serve(args: &ViewCommand, open: impl FnOnce(&ViewAddresses)) -> Result<Ended, Failure> {
    let prepare = |file: &PathBuf| prepare_file(file, Some(RECORDING_BEGIN));
    args.record.iter().try_for_each(prepare).map_err(usage)?;
    start_log("info");
    let stop = stop_on_signals()?;
    let options = ViewOptions {
        address: SocketAddr::new(args.address, args.port),
        token: args.token.clone(),
        foxglove: args.foxglove,
        record: args.record.clone(),
    };
    let (clock, transport) = open_session()?;
    let left_out = modulo_viewer::run(transport, clock, &options, &stop, Box::new(found_again()), open)?;
    if left_out > 0 {
        note!("{left_out} moments are not in the recording: each of them alone is larger than it may be");
    }
    Ok(Ended::of(left_out > 0))
}

/// Returns what finds the objects of a picture again by the model, the size and the threshold of a detector.
fn found_again() -> impl FnMut(&BTreeMap<String, String>, &Frame) -> Result<Vec<Detection>, String> {
    let mut last: Option<(DetectorParameters, Detector)> = None;
    move |values, picture| {
        let names = ["input_size", "score_threshold", "max_det", "nms_iou", "classes", "class_map"];
        let named = [("model_path", "model")].into_iter().chain(names.map(|name| (name, name)));
        // Recordings of earlier versions lack some values.
        let given = named.filter_map(|(value, name)| Some((name, values.get(value)?.as_str())));
        // Where the size follows the images, their sizes stand behind the word.
        let wanted: Vec<(&str, &str)> = given
            .map(|(name, text)| {
                (name, if name == "input_size" { text.split(' ').next().unwrap_or_default() } else { text })
            })
            .collect();
        let parameters = DetectorParameters::from_text(&wanted).map_err(|why| why.to_string())?;
        if last.as_ref().is_none_or(|(of, _)| *of != parameters) {
            let detector = Detector::new(&parameters).map_err(|why| why.to_string())?;
            last = Some((parameters, detector));
        }
        last.as_mut().expect("it was set above").1.find(picture)
    }
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
