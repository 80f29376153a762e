//! `modulo run NODE`: one node in this process, on the wire.

use std::sync::Arc;

use anyhow::Context;
use modulo_runtime::driver::live::{self, Subject};
use modulo_runtime::parameter::saved::SavedParameters;
use modulo_runtime::ros_args::{Logs, RosArgs};
use modulo_runtime::rosout::{self, LogQueue};
use modulo_runtime::signals::end_on_signals;
use modulo_runtime::{Descriptor, NodeReport, Place, Stop, SystemClock, launcher};

use super::{hash, open_session, start_log_with, usage};
use crate::cli::Run;
use crate::registry::{self, Kind};
use crate::{Ended, Failure};

/// Runs one node until it is done or told to end.
pub fn run(args: &Run) -> Result<Ended, Failure> {
    let kind = registry::kind(&args.node).map_err(usage)?;
    let (ros, own) = RosArgs::parse(&args.arguments).map_err(usage)?;
    if own.iter().any(|argument| argument == "--help" || argument == "-h") {
        print_help(kind);
        return Ok(Ended::Done);
    }
    let own = match &own[..] {
        [option, value, rest @ ..] if option == "--hash" => {
            hash::choose(hash::parse(value)?);
            rest
        }
        own => own,
    };
    if let Some(argument) = own.first() {
        return Err(usage(anyhow::anyhow!("{}: '{argument}' is unknown; try --help", kind.name)));
    }
    let place = ros.place(kind.name).map_err(usage)?;
    let log = start_log(&ros, &place);
    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    launcher::end_with_launcher(&stop).context("watch of the launcher")?;

    let settings = ros.parameters_for(&place).map_err(usage)?;
    let named = place.fully_qualified();
    let refused = |why: anyhow::Error| usage(why.context(named.clone()));
    let parameters = kind.parameters().with_text(&settings).map_err(|why| refused(why.into()))?;
    let saved = launcher::folder(launcher::STATE_DIR).map(|folder| SavedParameters::new(&folder, &place));
    let parameters = match &saved {
        Some(saved) => saved.restore(parameters),
        None => parameters,
    };
    let node = kind.make(&parameters).map_err(refused)?;

    let (clock, transport) = open_session()?;
    let rosout = log.map(|log| log.publish(&place, &transport)).transpose()?;
    let subject = Subject { node, parameters, place, saved };
    let report = live::run(subject, &transport, &clock, stop)?;
    drop(rosout);
    transport.close();
    leave_report(&report)?;
    Ok(Ended::Done)
}

/// Starts the log; what goes to `/rosout` waits in the queue.
fn start_log(ros: &RosArgs, place: &Place) -> Option<LogQueue> {
    let (layer, queue) = match ros.rosout_logs {
        Logs::Enabled => Some(rosout::layer(Arc::new(SystemClock::default()))).unzip(),
        Logs::Disabled => (None, None),
    };
    start_log_with(ros.log_level_of(&place.name), ros.stdout_logs, layer);
    queue
}

/// The launcher adds up what its nodes leave here.
fn leave_report(report: &NodeReport) -> Result<(), Failure> {
    let Some(folder) = launcher::folder(launcher::REPORT_DIR) else { return Ok(()) };
    let name = report.node.trim_matches('/').replace('/', ".");
    let file = folder.join(format!("{name}.json"));
    let text = serde_json::to_string(report).context("node report")?;
    std::fs::write(&file, text).with_context(|| format!("node report {}", file.display()))?;
    Ok(())
}

fn print_help(kind: &Kind) {
    say!("{}: {}\n", kind.name, kind.about);
    say!("Usage: modulo run {0} [--ros-args -p NAME:=VALUE ...]\n\nParameters:", kind.name);
    for descriptor in kind.parameters().descriptors() {
        let Descriptor { name, default, allowed, read_only, description } = descriptor;
        let fixed = if *read_only { ", fixed at the start" } else { "" };
        say!("  {name} ({}, {allowed}, default {default}{fixed})\n      {description}", default.type_name());
    }
}
