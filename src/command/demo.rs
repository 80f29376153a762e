//! `modulo demo`: the suite on a scene that a normal camera clips, with nothing to download.

use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, anyhow};
use clap::Args;
use modulo_eval::recordings::BOXES;
use modulo_runtime::output::{prepare_file, replace};

use super::usage;
use super::view::{Running, ViewCommand, quiet_program, serve};
use crate::{Ended, Failure};

/// The launch file of the scene and its detectors.
const FILE: &str = "demo.launch.yaml";

/// What the page shows first, as the parameters of its address.
const VIEW: &str = "layout=wipe&left=/saturated&right=/recovered&topics=/saturated,/modulo,/recovered";

#[derive(Args)]
pub struct Demo {
    /// Write one picture of the three images with their boxes to this PNG file, and end; no browser is needed
    #[arg(long, value_name = "FILE")]
    pub image: Option<PathBuf>,
    /// Port of the page; 0 takes a free one
    #[arg(long, default_value_t = 8088)]
    pub port: u16,
}

/// Starts the suite and opens the page, or writes the picture.
pub fn demo(args: &Demo) -> Result<Ended, Failure> {
    match &args.image {
        Some(file) => picture(file),
        None => page(args.port),
    }
}

/// Writes the picture of the first frame.
fn picture(file: &Path) -> Result<Ended, Failure> {
    prepare_file(file, None).map_err(usage)?;
    let folder = tempfile::tempdir().context("temporary folder")?;
    let mut eval = suite("eval", &["frames:=1", "--images", "-o"])?;
    let status = eval.arg(folder.path()).stdout(Stdio::null()).status().context("modulo eval")?;
    if !status.success() {
        return Err(anyhow!("modulo eval {FILE} has failed: {status}").into());
    }
    let written = std::fs::read(folder.path().join(BOXES).join("000000.png"))
        .and_then(|picture| replace(file, &picture));
    written.with_context(|| file.display().to_string())?;
    say!(
        "{}: a normal camera clips, a modulo camera wraps, and the recovered image has it all",
        file.display()
    );
    Ok(Ended::Done)
}

/// Starts the suite beside the viewer. Both end together.
fn page(port: u16) -> Result<Ended, Failure> {
    let mut running = Running::start(&mut suite("launch", &[])?)?;
    let address = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let with = ViewCommand { replayed: None, port, address, token: None, foxglove: None, record: None };
    let ended = serve(&with, |at| {
        let address = format!("{}&{VIEW}", at.page);
        say!(
            "A low sun over a wet street. Left of the wipe, a normal camera clips what is bright, and its detector misses it."
        );
        say!(
            "Right of it, the same exposure of a modulo camera, unwrapped. Raise alpha on the page until it is no longer trusted."
        );
        say!("The page is {address} ; Ctrl-C ends the demo.");
        open_browser(&address);
    });
    running.stop();
    ended
}

/// Returns the command of this program that runs the launch file.
fn suite(command: &str, more: &[&str]) -> Result<Command, Failure> {
    let mut program = quiet_program()?;
    program.args([command, FILE]).args(more);
    Ok(program)
}

/// Opens an address in the browser of the desktop, if there is one.
fn open_browser(address: &str) {
    let has_desktop = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if has_desktop {
        // Where there is no such program, the address has been printed.
        let _ = Command::new("xdg-open").arg(address).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    }
}
