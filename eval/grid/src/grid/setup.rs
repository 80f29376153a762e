//! What is the same for all cells of a grid, as the results say it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use modulo_detector::describe;
use sha2::{Digest, Sha256};

use super::frames::Frames;
use super::{Axes, BITS, GridError, Request};
use crate::classes::{ClassMap, Table, of_labels};
use crate::metric::{average, bootstrap, difficulty, latency, paper};
use crate::results::{Point, Protocol, Setup};

/// The map that classes go through.
pub fn class_map(request: &Request) -> ClassMap {
    match (&request.class_map, request.protocol) {
        (Some(map), _) => map.clone(),
        (None, Protocol::Paper) => ClassMap::paper(),
        (None, Protocol::Suite) => request.data.class_map(),
    }
}

/// The setup of `request` with these cells.
///
/// # Errors
/// [`GridError`] when a model's file cannot be read.
pub fn setup(request: &Request, map: &ClassMap, points: &[Point]) -> Result<Setup, GridError> {
    let model = |path: &std::path::PathBuf| Ok((Axes::model_name(path), sha256(path)?));
    Ok(Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        protocol: request.protocol,
        source: request.data.name(),
        bits: BITS,
        seed: request.seed,
        difficulty: request.difficulty.unwrap_or_else(|| request.data.difficulty()),
        engine: request.engine.to_string(),
        class_map: map.table.clone(),
        groups: request.groups.table().clone(),
        models: request.axes.models.iter().map(model).collect::<Result<_, GridError>>()?,
        grid: points.to_vec(),
    })
}

fn sha256(model: &Path) -> Result<String, GridError> {
    let bytes = match modulo_detector::embedded(model) {
        Some(bytes) => bytes.to_vec(),
        None => std::fs::read(model).map_err(|why| GridError::io(model, why))?,
    };
    Ok(modulo_models::hex(&Sha256::digest(bytes)))
}

/// What the figures mean.
pub fn definitions() -> Table {
    [
        ("ap50", average::definition()),
        ("ap50_95", "Mean over groups of the mean AP at the ten IoU thresholds 0.50, 0.55, ..., 0.95."),
        (
            "classes",
            "As ap50, of one class of the labels alone. Labels of its group that the model has no twin for \
                     are ignored.",
        ),
        ("difficulty", difficulty::definition()),
        ("exact_k, psnr_db, ssim", super::recovery::definition()),
        ("interval95", bootstrap::definition()),
        ("latency_ms", latency::definition()),
        ("paper", paper::definition()),
    ]
    .map(|(name, text)| (name.to_owned(), text.split_whitespace().collect::<Vec<_>>().join(" ")))
    .into()
}

/// For each model the classes of the labels that it can find.
pub type Twins = BTreeMap<String, BTreeSet<String>>;

/// Finds the twins, and notes in `frames.input` what has none.
///
/// # Errors
/// [`GridError`] when a model does not load.
pub fn twins(request: &Request, map: &ClassMap, frames: &mut Frames) -> Result<Twins, GridError> {
    let labels: BTreeSet<String> =
        of_labels(frames.truths.iter().flatten()).into_iter().map(str::to_owned).collect();
    let mut twins = Twins::new();
    for model in &request.axes.models {
        let (name, own) =
            (Axes::model_name(model), describe(model, request.engine, request.threads)?.classes);
        let found: BTreeSet<String> =
            own.iter().filter_map(|class| map.twin(class)).map(str::to_owned).collect();
        // A model without names may mean anything.
        let twin =
            if own.is_empty() { labels.clone() } else { labels.intersection(&found).cloned().collect() };
        let without = &mut frames.input.without_twin;
        without.insert(format!("labels, for {name}"), labels.difference(&twin).cloned().collect());
        without.insert(name.clone(), own.into_iter().filter(|class| map.twin(class).is_none()).collect());
        twins.insert(name, twin);
    }
    Ok(twins)
}
