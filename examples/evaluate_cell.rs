//! Evaluates one setting (a cell of the grid): unwrap, detect and score labelled frames of the procedural tunnel.
//!
//!     cargo run --release --example evaluate_cell -- [ALPHA]
//!
//! Writes `results.json` into the folder `evaluation`, as `modulo eval` does.

use clap::Parser;
use modulo_eval::grid::{Data, GridOptions, Request, detector, run};
use modulo_eval::results::Provenance;
use modulo_runtime::SystemClock;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let alpha = std::env::args().nth(1).unwrap_or_else(|| "4".into());
    let options =
        ["evaluate_cell", "--stream", "recovered", "--method", "auto", "--alpha", &alpha, "--fresh"];
    let request = Request {
        data: Data::Any(vec!["scene://tunnel?seed=3&frames=8".into()]),
        options: GridOptions::try_parse_from(options)?,
        provenance: Provenance { command: "evaluate_cell".into(), ..Provenance::default() },
        out: "evaluation".into(),
    };
    let outcome = run(&request, &detector, &SystemClock::default(), &|_| {})?;
    for cell in &outcome.cells {
        println!("{}", cell.point);
        for (group, ap) in &cell.ap50 {
            println!(
                "    AP50 {group}: {}",
                ap.map_or("no object".into(), |ap| format!("{:.1} %", 100.0 * ap))
            );
        }
        let exact = cell.exact_k.expect("a recovered stream has wrap counts");
        println!("    exact wrap counts: {:.1} %", 100.0 * exact);
        for (stage, ms) in &cell.latency_ms {
            println!("    {stage}: {:.2} ms (median of {} frames)", ms.p50, cell.frames);
        }
    }
    Ok(())
}
