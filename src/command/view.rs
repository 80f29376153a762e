//! `modulo view`: the suite in a browser.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use clap::Args;
use modulo_viewer::ViewOptions;

use super::{open_session, start_log, stop_on_signals};
use crate::{Ended, Failure};

/// `modulo view`
#[derive(Args)]
pub struct ViewCommand {
    /// Port of the page; 0 takes a free one
    #[arg(long, default_value_t = 8088)]
    pub port: u16,
    /// Address that is listened on. Only this machine can reach the default; 0.0.0.0 is open to the network, without encryption
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub address: IpAddr,
    /// Token that a browser needs; a new random one by default
    #[arg(long, value_parser = token)]
    pub token: Option<String>,
}

/// Runs the command.
pub fn view(args: &ViewCommand) -> Result<Ended, Failure> {
    start_log("info");
    let stop = stop_on_signals()?;
    let options =
        ViewOptions { address: SocketAddr::new(args.address, args.port), token: args.token.clone() };
    let (clock, transport) = open_session()?;
    let open = |address: &str| say!("open {address} in a browser; SIGINT ends the viewer");
    modulo_viewer::run(transport, clock, &options, &stop, open)?;
    Ok(Ended::Done)
}

/// Letters and digits need no quoting in an address, and fewer than 8 of them are soon guessed.
fn token(text: &str) -> Result<String, String> {
    let valid = text.len() >= 8 && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if valid { Ok(text.to_owned()) } else { Err("must be at least 8 letters and digits".to_owned()) }
}
