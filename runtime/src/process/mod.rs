//! A node as a process: its command line, its launcher, the signals that end it, and the files that outlast a crash.

pub mod launcher;
pub mod report_file;
pub mod ros_args;
pub mod saved_state;
pub mod stop;
