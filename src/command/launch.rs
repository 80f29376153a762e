//! `modulo launch FILE`: separate processes, or one with `--compose`.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use modulo_launch::plan::OnExit;
use modulo_launch::{ComposedNode, NodePlan, Plan, Summary, Supervision};
use modulo_runtime::driver::composed::{self, Member};
use modulo_runtime::end_on_signals;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::{Clock, NodeName, Parameters, Stop, SystemClock};

use super::{hash, pairs, start_log, usage};
use crate::cli::Launch;
use crate::registry::{self, Kind};
use crate::{Ended, Failure};

/// Starts what the file says and prints the summary at the end.
pub fn launch(args: &Launch) -> Result<Ended, Failure> {
    start_log(None);
    if args.show_args {
        return show_args(&args.file);
    }
    if args.check {
        return check(args);
    }
    let plan = modulo_launch::resolve(&args.file, &pairs(&args.arguments)?).map_err(usage)?;
    if args.print {
        say!("{plan}");
        return Ok(Ended::Done);
    }
    let (summary, failure) = if args.compose { (run_composed(&plan)?, None) } else { run_processes(plan)? };
    if let Some(file) = &args.summary {
        summary.write(file)?;
    }
    // The summary ends with a line break of its own.
    say!("{}", summary.to_string().trim_end());
    match failure {
        Some(why) => Err(Failure::Run(why)),
        None if summary.lost(args.strict) => Ok(Ended::WithLoss),
        None => Ok(Ended::Done),
    }
}

fn show_args(file: &Path) -> Result<Ended, Failure> {
    for argument in modulo_launch::declared_arguments(file).map_err(usage)? {
        let default = argument.default.map_or("required".to_owned(), |text| format!("default '{text}'"));
        say!("{} ({default})", argument.name);
        if let Some(description) = argument.description {
            say!("    {description}");
        }
        if !argument.choices.is_empty() {
            say!("    one of {}", argument.choices.join(", "));
        }
    }
    Ok(Ended::Done)
}

/// What the file says, and whether its nodes take the parameters that it gives.
fn check(args: &Launch) -> Result<Ended, Failure> {
    let file = args.file.display();
    let mistakes = match modulo_launch::check(&args.file, &pairs(&args.arguments)?) {
        Ok(plan) => {
            let mistakes: Vec<String> = plan.nodes.iter().flat_map(refusals).collect();
            if mistakes.is_empty() {
                say!("{file}: ok, {} nodes, {} executables", plan.nodes.len(), plan.executables.len());
                return Ok(Ended::Done);
            }
            mistakes
        }
        Err(mistakes) => mistakes.all().iter().map(ToString::to_string).collect(),
    };
    mistakes.iter().for_each(|mistake| say!("{mistake}"));
    Err(Failure::Run(anyhow!("{file}: {} mistakes", mistakes.len())))
}

/// Every parameter of a node of the suite that it would refuse.
fn refusals(node: &NodePlan) -> Vec<String> {
    if node.package != modulo_launch::SUITE {
        return Vec::new();
    }
    let (file, line) = &node.declared_at;
    let at = |why: anyhow::Error| format!("{}:{line}: {why:#}", file.display());
    let settings = || -> anyhow::Result<_> {
        let kind = registry::kind(&node.executable)?;
        let (ros, _) = RosArgs::parse(&modulo_launch::ros_arguments(node))?;
        let node_name = ros.node_name(kind.name)?;
        Ok((kind.parameters(), ros.parameters_for(&node_name)?))
    };
    match settings() {
        Ok((declared, settings)) => {
            let refused = settings.iter().filter_map(|s| declared.with_text(std::slice::from_ref(s)).err());
            refused.map(|why| at(why.into())).collect()
        }
        Err(why) => vec![at(why)],
    }
}

/// The summary, and which processes failed, if one did.
fn run_processes(mut plan: Plan) -> Result<(Summary, Option<anyhow::Error>), Failure> {
    let word = hash::chosen()?.word();
    for node in &mut plan.nodes {
        node.process.env.entry(hash::VARIABLE.to_owned()).or_insert(Some(word.to_owned()));
    }
    let supervision = Supervision::on_terminal()?;
    let runtime = tokio::runtime::Runtime::new().context("tokio runtime")?;
    let outcome = runtime.block_on(modulo_launch::run(plan, &supervision))?;
    let failed = outcome.processes.iter().filter(|p| p.end.is_failure());
    let names: Vec<_> = failed.map(|p| format!("{} {}", p.label, p.end)).collect();
    let failure = (!names.is_empty()).then(|| anyhow!("failed: {}", names.join(", ")));
    Ok((outcome.summary(), failure))
}

fn run_composed(plan: &Plan) -> Result<Summary, Failure> {
    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    let members = members(plan)?;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let reports = composed::run(members, &clock, &stop)?;
    Ok(Summary::new(&reports, []))
}

/// The plan's nodes, made in this process.
fn members(plan: &Plan) -> Result<Vec<Member>, Failure> {
    let nodes = modulo_launch::compose(plan).map_err(usage)?;
    let member = |(node, on_exit): (&ComposedNode, OnExit)| {
        let (kind, node_name, parameters) = prepare(node)?;
        let step = kind.make(&parameters).with_context(|| node_name.fully_qualified())?;
        let on_exit = match on_exit {
            OnExit::Shutdown => composed::MemberExit::Shutdown,
            OnExit::Continue => composed::MemberExit::Continue,
        };
        Ok(Member { node: step, parameters, node_name, on_exit })
    };
    let on_exits = plan.nodes.iter().map(|node| node.process.on_exit);
    nodes.iter().zip(on_exits).map(member).collect::<anyhow::Result<_>>().map_err(usage)
}

/// Kind, node_name and parameters of one node of a plan.
pub fn prepare(node: &ComposedNode) -> anyhow::Result<(&'static Kind, NodeName, Parameters)> {
    let kind = registry::kind(&node.kind)?;
    let node_name = NodeName::new(&node.name, &node.namespace, &node.remaps)?;
    let parameters =
        kind.parameters().with_text(&node.parameters).with_context(|| node_name.fully_qualified())?;
    Ok((kind, node_name, parameters))
}
