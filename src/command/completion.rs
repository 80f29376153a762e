//! A shell asks this program to complete a word: launch files, their arguments, and the topics, nodes and parameters of the running suite.

use std::ffi::OsStr;
use std::path::Path;

use clap_complete::engine::{ArgValueCompleter, CompletionCandidate, PathCompleter, ValueCompleter as _};
use modulo_launch::{declared_arguments, launch_file, launch_files};
use modulo_middleware::parameter::client::ParameterClient;
use modulo_runtime::name::{is_hidden, is_hidden_node};

use super::detect::FILE;
use super::open_session;

/// Completes the name of a launch file of the suite, or a path.
pub fn files() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let names = launch_files().unwrap_or_default().into_iter().map(|file| file.name);
        let paths = PathCompleter::file().complete(current);
        matching(current, names).into_iter().chain(paths).collect::<Vec<_>>()
    })
}

/// Completes the name of an argument of the launch file in the command line, or of the suite where there is none.
pub fn arguments() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let named = words().chain([FILE.to_owned()]);
        let mut declared =
            named.filter_map(|word| declared_arguments(&launch_file(Path::new(&word)).ok()?).ok());
        let names = declared.next().into_iter().flatten().map(|argument| format!("{}:=", argument.name));
        matching(current, names)
    })
}

/// Completes the name of a topic.
pub fn topics() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let found = open_session().ok().map(|(_clock, transport)| transport.settled_graph().topics());
        let names = found.into_iter().flatten().map(|(topic, _)| topic);
        matching(current, names.filter(|topic| !is_hidden(topic)))
    })
}

/// Completes the name of a node.
pub fn nodes() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let found = open_session().ok().map(|(_clock, transport)| transport.settled_graph().nodes());
        matching(current, found.into_iter().flatten().filter(|node| !is_hidden_node(node)))
    })
}

/// Completes the name of a parameter of the node in the command line.
pub fn parameters() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| {
        let names = |node: &str| {
            let (_clock, transport) = open_session().ok()?;
            transport.settled_graph();
            ParameterClient::new(&transport, node).names().ok()
        };
        let found = words().find(|word| word.starts_with('/')).and_then(|node| names(&node));
        matching(current, found.into_iter().flatten())
    })
}

/// Returns the words of the command line behind the command: the shell gives them after `--` and the name of this program.
fn words() -> impl Iterator<Item = String> {
    std::env::args_os().skip_while(|word| word != "--").skip(3).filter_map(|word| word.into_string().ok())
}

fn matching(current: &OsStr, names: impl Iterator<Item = String>) -> Vec<CompletionCandidate> {
    let begun = current.to_string_lossy();
    names.filter(|name| name.starts_with(&*begun)).map(CompletionCandidate::new).collect()
}
