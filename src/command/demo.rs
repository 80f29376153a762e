//! `modulo demo`: the suite on a scene that a normal camera clips, with nothing to download.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::Args;
use modulo_draw::{Picture, sheet};
use modulo_middleware::transport::{Incoming, Transport as _};
use modulo_runtime::output::{prepare_file, replace};
use modulo_runtime::{Address, Clock, Message, MessageKind, NodeName, Stop, Topic, Urgency};

use super::view::{Running, ViewCommand, quiet_program, serve};
use super::{open_session, stop_on_signals, usage};
use crate::{Ended, Failure};

/// The launch file of the scene and its detectors.
const FILE: &str = "demo.launch.yaml";

/// The streams that have a detector, and what the picture says of them.
const STREAMS: [(&str, &str); 3] = [
    ("saturated", "saturated: a normal camera clips what is bright, and its detector is blind there"),
    ("modulo", "modulo: each pixel starts again at 0 when it is full"),
    ("recovered", "recovered: the same exposure, its wraps counted and undone"),
];
/// The most images and moments that wait.
const QUEUE: usize = 16;
/// The program ends with an error after so many seconds without a picture: loading three detectors takes seconds.
const PATIENCE: u64 = 60;
const GLANCE: Duration = Duration::from_millis(100);

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

/// Writes the picture of the first frame of which all detectors have published their image.
fn picture(file: &Path) -> Result<Ended, Failure> {
    prepare_file(file, None).map_err(usage)?;
    let stop = stop_on_signals()?;
    let (clock, transport) = open_session()?;
    let name = NodeName::new("demo", "/", &[]).map_err(usage)?;
    let (sender, received) = sync_channel(QUEUE);
    // Before the suite starts, so that the detectors draw from the first frame on.
    let subscribe = |(at, (stream, _)): (usize, &(&str, &str))| {
        let topic = Topic::new(format!("detector_{stream}/annotated"), MessageKind::Image);
        let sender = sender.clone();
        // The later ones are not needed.
        let deliver = Box::new(move |incoming| drop(sender.try_send((at, incoming))));
        transport
            .subscribe(&name, &Address::resolve(&name, &topic).map_err(usage)?, deliver)
            .map_err(Failure::from)
    };
    let subscriptions = STREAMS.iter().enumerate().map(subscribe).collect::<Result<Vec<_>, _>>()?;
    let mut running = Running::start(suite()?.stderr(Stdio::null()))?;
    let pictures = one_of_each(&received, &*clock, &stop);
    running.stop();
    drop(subscriptions);
    let Some(pictures) = pictures? else { return Ok(Ended::Done) };
    let titled: Vec<_> = STREAMS.iter().map(|(_, title)| title).zip(pictures.map(Some)).collect();
    let drawn = sheet(&titled, &[]).ok_or_else(|| anyhow!("the images are too large to be drawn"))?;
    let folder = tempfile::tempdir().context("temporary folder")?;
    let png = folder.path().join("demo.png");
    drawn.save(&png).context("a temporary file")?;
    std::fs::read(png).and_then(|png| replace(file, &png)).with_context(|| file.display().to_string())?;
    say!("{}: what the detectors have read and found, as they have published it", file.display());
    Ok(Ended::Done)
}

/// Returns the images of one moment, of each stream one; `None` if it was asked for an end.
fn one_of_each(
    received: &Receiver<(usize, Incoming)>,
    clock: &dyn Clock,
    stop: &Stop,
) -> Result<Option<[Picture; STREAMS.len()]>, Failure> {
    let mut moments: BTreeMap<u64, [Option<Picture>; STREAMS.len()]> = BTreeMap::new();
    let end = clock.ticks_ns() + PATIENCE * 1_000_000_000;
    while stop.urgency() == Urgency::None {
        if clock.ticks_ns() > end {
            return Err(anyhow!("no moment with the images of all detectors came within {PATIENCE} s; `modulo launch {FILE}` shows why").into());
        }
        let Ok((at, incoming)) = received.recv_timeout(GLANCE) else { continue };
        let Message::Image(image) = incoming
            .open(MessageKind::Image)
            .map_err(anyhow::Error::msg)
            .context("an image of a detector")?
        else {
            continue;
        };
        let pixels = image.frame.as_u8().context("an annotated image has 8 bits")?;
        let (height, width, _) = pixels.dim();
        let picture = Picture::new(width as u32, height as u32, pixels.iter().copied().collect(), Vec::new());
        let moment = moments.entry(image.header.stamp.as_ns()).or_default();
        moment[at] = Some(picture.context("an annotated image")?);
        if let [Some(_), Some(_), Some(_)] = moment {
            return Ok(Some(std::mem::take(moment).map(|picture| picture.expect("each of them is there"))));
        }
        if moments.len() > QUEUE {
            moments.pop_first();
        }
    }
    Ok(None)
}

/// Starts the suite beside the viewer. Both end together.
fn page(port: u16) -> Result<Ended, Failure> {
    let mut running = Running::start(&mut suite()?)?;
    let address = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let with = ViewCommand { replayed: None, port, address, token: None, foxglove: None, record: None };
    let ended = serve(&with, |at| {
        let address = format!("{}&{VIEW}", at.page);
        say!(
            "A low sun over a street. Left of the wipe, a normal camera clips what is bright, and its detector misses it."
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

/// Returns the command of this program that starts the three nodes.
fn suite() -> Result<Command, Failure> {
    let mut program = quiet_program()?;
    program.args(["launch", FILE]);
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
