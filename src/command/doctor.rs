//! `modulo doctor`: the engine, the transport and the environment on this machine. It changes nothing and always ends with exit code 0, since a person judges the result.

use std::net::TcpListener;
use std::path::Path;

use modulo_detector::{onnxruntime_library, onnxruntime_places};
use modulo_runtime::transport::zenoh::meeting_port;

use super::domain;
use crate::{Ended, Failure};

/// Environment variables that change how sessions meet.
const ZENOH_VARIABLES: [&str; 2] = ["ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"];

/// Prints the found and missing parts of the environment, and a remedy for each missing one.
pub fn doctor() -> Result<Ended, Failure> {
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    say!("modulo   {} on {os} {arch}", env!("CARGO_PKG_VERSION"));
    let threads = std::thread::available_parallelism().map_or(1, |threads| threads.get());
    say!("threads  {threads}");
    engine();
    transport();
    Ok(Ended::Done)
}

fn engine() {
    let taken = onnxruntime_library();
    match &taken {
        Ok(place) => say!("engine   auto takes ort, ONNX Runtime from {place}"),
        Err(_) => say!("engine   auto takes rten, built in; no ONNX Runtime library was found"),
    }
    say!("looked   in this order:");
    for place in onnxruntime_places() {
        let chosen = taken.as_ref().is_ok_and(|taken| Path::new(taken) == place);
        // A bare file name is looked up by the dynamic loader in folders that this program does not know.
        let by_loader = place.parent().is_none_or(|folder| folder.as_os_str().is_empty());
        let found = match (chosen, by_loader) {
            (true, _) => "taken",
            (false, true) => "through the system's loader",
            (false, false) if place.exists() => "there, not taken",
            (false, false) => "not there",
        };
        say!("         {} ({found})", place.display());
    }
    if taken.is_err() {
        say!("faster   python tools/install_onnxruntime.py, then the export line that it prints");
    }
}

fn transport() {
    let number = match domain() {
        Ok(number) => number,
        Err(Failure::Usage(why) | Failure::Run(why)) => {
            say!("domain   {why:#}");
            return;
        }
    };
    let from = if std::env::var_os("ROS_DOMAIN_ID").is_some() {
        "ROS_DOMAIN_ID"
    } else {
        "ROS_DOMAIN_ID is not set"
    };
    say!("domain   {number} ({from})");
    for name in ZENOH_VARIABLES {
        match std::env::var(name) {
            Ok(value) => say!("zenoh    {name} = {value}"),
            Err(_) => say!("zenoh    {name} is not set"),
        }
    }
    let port = meeting_port(number);
    // Only a try to listen tells whether the port is free. The socket is closed again at once.
    match TcpListener::bind(("127.0.0.1", port)) {
        Ok(_) => say!("meeting  127.0.0.1:{port} is free: the next node listens there"),
        Err(why) => {
            say!("meeting  127.0.0.1:{port} is taken, by nodes of this domain or another program ({why})")
        }
    }
}
