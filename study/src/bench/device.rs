//! The machine's name for itself.

/// The processor's model from `/proc/cpuinfo`, else its architecture.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    match model {
        Some((_, name)) => name.split_whitespace().collect::<Vec<_>>().join(" "),
        None => std::env::consts::ARCH.to_owned(),
    }
}

/// Processors that this process may use; 1 where the system does not say.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
