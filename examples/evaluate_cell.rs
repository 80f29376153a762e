//! Evaluates one setting: unwrap, detect and score labelled frames of the procedural tunnel.
//!
//!     cargo run --release --example evaluate_cell -- [ALPHA]
//!
//! Writes boxes and `results.json` into the folder `evaluation`, as `modulo eval` does.

use modulo_camera::CameraParameters;
use modulo_detector::DetectorParameters;
use modulo_eval::plan::{CAMERA, DETECTOR, PlannedNode, UNWRAP, Variant};
use modulo_eval::progress::Listener;
use modulo_eval::run::{Request, run};
use modulo_eval::store;
use modulo_runtime::{NodeName, ParameterSet as _, Parameters, SystemClock};
use modulo_unwrap::UnwrapParameters;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let alpha = std::env::args().nth(1).unwrap_or_else(|| "4".into());
    let node =
        |executable, declared, set: &[(&str, &str)]| -> Result<PlannedNode, Box<dyn std::error::Error>> {
            let name = NodeName::new(executable, "/", &[])?;
            Ok(PlannedNode { executable, name, parameters: Parameters::declare(declared).with_text(set)? })
        };
    let source = [("source", "scene://tunnel?seed=3&frames=8"), ("alpha", &alpha)];
    let nodes = vec![
        node(CAMERA, CameraParameters::descriptors(), &source)?,
        node(UNWRAP, UnwrapParameters::descriptors(), &[])?,
        node(DETECTOR, DetectorParameters::descriptors(), &[("input", "recovered")])?,
    ];
    let request = Request {
        variants: vec![Variant { nodes, wanted: None, more: Default::default() }],
        data: None,
        places: 0..usize::MAX,
        jobs: 0,
        timing: Default::default(),
        score: Default::default(),
        fresh: true,
        out: "evaluation".into(),
    };
    let listener = Listener { tell: &|_| {}, stopped: &|| false };
    let results = run(&request, &SystemClock::default(), &listener)?;
    store::save(&request.out, &results)?;
    for cell in &results.cells {
        println!("{}", cell.point);
        for (group, ap) in &cell.ap50 {
            println!(
                "    AP50 {group}: {}",
                ap.map_or("no object".into(), |ap| format!("{:.1} %", 100.0 * ap))
            );
        }
        let exact = cell.exact_k.expect("a recovered stream has wrap counts");
        println!("    exact wrap counts: {:.1} %", 100.0 * exact);
    }
    Ok(())
}
