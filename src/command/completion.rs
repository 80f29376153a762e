//! A shell asks this program to complete a word: launch files, their arguments, and the topics, nodes and parameters of the running suite.

use std::ffi::OsStr;
use std::path::Path;

use clap_complete::engine::{ArgValueCompleter, CompletionCandidate, PathCompleter, ValueCompleter as _};
use modulo_detector::DetectorParameters;
use modulo_launch::{declared_arguments, launch_file, launch_files};
use modulo_middleware::parameter::client::ParameterClient;
use modulo_runtime::ParameterSet as _;
use modulo_runtime::name::{is_hidden, is_hidden_node};

use super::open_session;

/// Completes the name of a launch file of the suite, or a path.
pub fn files() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let names = launch_files().unwrap_or_default().into_iter().map(|file| file.name);
        let paths = PathCompleter::file().complete(current);
        matching(current, names).into_iter().chain(paths).collect::<Vec<_>>()
    })
}

/// Completes the name of an argument of the launch file in the command line.
pub fn arguments() -> ArgValueCompleter {
    completer(|| {
        let declared =
            words().find_map(|word| declared_arguments(&launch_file(Path::new(&word)).ok()?).ok())?;
        Some(declared.into_iter().map(|argument| format!("{}:=", argument.name)).collect())
    })
}

/// Completes the name of a parameter of the detector.
pub fn detector() -> ArgValueCompleter {
    completer(|| {
        let declared = DetectorParameters::descriptors().into_iter();
        Some(declared.map(|parameter| format!("{}:=", parameter.name)).collect())
    })
}

pub fn topics() -> ArgValueCompleter {
    completer(|| {
        let (_clock, transport) = open_session().ok()?;
        let topics = transport.settled_graph().topics().into_keys();
        Some(topics.filter(|topic| !is_hidden(topic)).collect())
    })
}

pub fn nodes() -> ArgValueCompleter {
    completer(|| {
        let (_clock, transport) = open_session().ok()?;
        let nodes = transport.settled_graph().nodes().into_iter();
        Some(nodes.filter(|node| !is_hidden_node(node)).collect())
    })
}

/// Completes the name of a parameter of the node in the command line.
pub fn parameters() -> ArgValueCompleter {
    completer(|| {
        let node = words().find(|word| word.starts_with('/'))?;
        let (_clock, transport) = open_session().ok()?;
        transport.settled_graph();
        ParameterClient::new(&transport, &node).names().ok()
    })
}

/// Returns the words of the command line behind the command: the shell gives them after `--` and the name of this program.
fn words() -> impl Iterator<Item = String> {
    std::env::args_os().skip_while(|word| word != "--").skip(3).filter_map(|word| word.into_string().ok())
}

/// Completes one of `names`, if they can be found.
fn completer(names: fn() -> Option<Vec<String>>) -> ArgValueCompleter {
    ArgValueCompleter::new(move |current: &OsStr| matching(current, names().into_iter().flatten()))
}

fn matching(current: &OsStr, names: impl Iterator<Item = String>) -> Vec<CompletionCandidate> {
    let begun = current.to_string_lossy();
    names.filter(|name| name.starts_with(&*begun)).map(CompletionCandidate::new).collect()
}
