//! The threads of a method stay when a parameter changes that does not concern them. One test, alone in its process,
//! which has no other threads that come and go.
#![cfg(target_os = "linux")]

use std::collections::BTreeSet;

use modulo_runtime::{Node, ParameterSet, Parameters};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};

fn threads() -> BTreeSet<std::ffi::OsString> {
    let tasks = std::fs::read_dir("/proc/self/task").expect("Linux lists its threads");
    tasks.map(|task| task.expect("a thread").file_name()).collect()
}

#[test]
fn a_change_of_alpha_keeps_the_threads() {
    let parameters = |changes: &[(&str, &str)]| {
        Parameters::declare(UnwrapParameters::descriptors()).with_text(changes).expect("possible")
    };
    let before = threads().len();
    let mut node = UnwrapNode::new(&(&parameters(&[("threads", "3")])).into()).expect("a node");
    let own = threads();
    assert!(own.len() > before, "the method has threads of its own");
    node.configure(&parameters(&[("threads", "3"), ("alpha", "3"), ("psf_sigma", "1"), ("deblur", "true")]))
        .expect("possible");
    assert_eq!(threads(), own);
    node.configure(&parameters(&[("threads", "4"), ("alpha", "3")])).expect("possible");
    assert_ne!(threads(), own);
}
