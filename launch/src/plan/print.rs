//! A plan as text for people: one line a process, its settings indented below.

use std::fmt;

use super::{ExecutablePlan, NodePlan, OnExit, Output, Plan, ProcessPlan, Respawn};

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.messages.iter().try_for_each(|message| writeln!(f, "log {message}"))?;
        self.nodes.iter().try_for_each(|node| node.fmt(f))?;
        self.executables.iter().try_for_each(|executable| executable.fmt(f))
    }
}

impl fmt::Display for NodePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.fully_qualified().unwrap_or_else(|| format!("{} (its own name)", self.namespace));
        writeln!(f, "node {name}: {}/{}", self.package, self.executable)?;
        self.shared_parameters.iter().try_for_each(|(name, value)| writeln!(f, "  {name} = {value}"))?;
        for file in &self.parameter_files {
            writeln!(f, "  params {}", file.display())?;
        }
        self.parameters.iter().try_for_each(|(name, value)| writeln!(f, "  {name} = {value}"))?;
        self.remaps.iter().try_for_each(|(from, to)| writeln!(f, "  {from} -> {to}"))?;
        for (what, arguments) in [("args", &self.args), ("ros_args", &self.ros_args)] {
            if !arguments.is_empty() {
                writeln!(f, "  {what} {}", arguments.join(" "))?;
            }
        }
        self.process.fmt(f)
    }
}

impl fmt::Display for ExecutablePlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "executable {}: {}", self.process.label, self.command.join(" "))?;
        self.process.fmt(f)
    }
}

/// Only what differs from the defaults.
impl fmt::Display for ProcessPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in &self.env {
            match value {
                Some(value) => writeln!(f, "  env {name}={value}")?,
                None => writeln!(f, "  env {name} is removed")?,
            }
        }
        if let Some(cwd) = &self.cwd {
            writeln!(f, "  in {}", cwd.display())?;
        }
        if self.output == Output::Log {
            writeln!(f, "  shows its errors only")?;
        }
        if let Respawn::After { delay, max_retries } = self.respawn {
            let times = max_retries.map_or("any number of".to_owned(), |n| format!("{n}"));
            writeln!(f, "  started again after a crash, {times} times, {} s later", delay.as_secs_f64())?;
        }
        if self.on_exit == OnExit::Shutdown {
            writeln!(f, "  its end is the end of all")?;
        }
        if !self.start_after.is_zero() {
            writeln!(f, "  started after {} s", self.start_after.as_secs_f64())?;
        }
        Ok(())
    }
}
