//! What the figures mean, and what they were made with.

use super::html::{escape, p};
use crate::results::Results;
use crate::wording::distinct;

/// Definitions, data, configuration, versions.
pub fn section(results: &Results) -> String {
    let definitions: String = results.definitions.iter().map(|(name, text)| entry(name, text)).collect();
    let (setup, input) = (&results.setup, &results.input);
    let pairs = |map: &std::collections::BTreeMap<String, String>| {
        map.iter().map(|(from, to)| format!("{from} -> {to}")).collect::<Vec<_>>().join(", ")
    };
    let twins = input.without_twin.iter().map(|(whose, classes)| format!("{whose}: {}", classes.join(", ")));
    let devices = distinct(results.cells.iter().map(|cell| {
        let device = &cell.device;
        format!("{} on {}, {} threads, {} jobs", device.engine, device.processor, device.threads, device.jobs)
    }));
    let facts = [
        ("modulo", setup.version.clone()),
        ("source", setup.source.clone()),
        ("frames", format!("{}, {} of them labelled, {} drives", input.frames, input.labelled, input.drives)),
        ("digest of frames and labels", format!("sha256 {}", input.digest)),
        ("protocol", format!("{:?}", setup.protocol).to_lowercase()),
        ("sensor", format!("{} bits, seed {}", setup.bits, setup.seed)),
        ("difficulty", format!("{:?}", setup.difficulty).to_lowercase()),
        ("engine asked for", setup.engine.clone()),
        ("measured with", devices.join("; ")),
        ("models", pairs(&setup.models)),
        ("classes of the model to those of the labels", pairs(&setup.class_map)),
        ("classes of the labels to groups", pairs(&setup.groups)),
        ("classes without a twin", twins.collect::<Vec<_>>().join("; ")),
    ];
    let facts: String = facts.iter().map(|(name, text)| entry(name, text)).collect();
    let warnings: String = input.warnings.iter().map(|warning| p(warning)).collect();
    format!(
        "<h2>Definitions</h2>\n<dl>\n{definitions}</dl>\n<h2>Configuration</h2>\n{warnings}<dl>\n{facts}</dl>\n"
    )
}

fn entry(name: &str, text: &str) -> String {
    format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(if text.is_empty() { "-" } else { text }))
}
