//! The middleware: the steps of nodes as processes that exchange messages over a transport.
//!
//! ```text
//! transport -> queue -> driver -> Node::step -> driver -> transport
//! ```
//!
//! This crate does not know what any node computes. Only `transport/zenoh` names the library of the wire.

pub mod driver;
pub mod graph;
pub mod transport;

/// The parameters of a node as ROS 2 reaches them: services, their client, and the events of changes.
pub mod parameter {
    pub mod client;
    pub mod events;
    pub mod service;
}

/// A node as a process: its memory, what ends it, and the files that outlast a crash.
pub mod process {
    pub mod memory;
    pub mod node_files;
    pub mod signals;
    pub mod sockets;
}

#[cfg(test)]
mod sample {
    modulo_runtime::parameters! {
        /// The parameters of a node, for the tests: one of each type.
        pub struct Set {
            /// A double.
            angle: f64 = 4.0 => 0.001..=1024.0,
            /// An integer.
            bits: u8 = 8 => 1..=16; fixed,
            /// A word.
            engine: u8 = 0 => [("auto", 0), ("ort", 1), ("rten", 2)],
            /// A list.
            wait_for: Vec<String> = Vec::new(),
            /// A text.
            model: String = "a.onnx".to_owned(); fixed,
            /// A switch.
            r#loop: bool = false,
            /// A share.
            share: f64 = 0.5 => 0.0..=1.0,
        }
    }
}
