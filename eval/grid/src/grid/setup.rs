//! The part of the results that all cells of a grid share: settings, definitions, classes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use modulo_detector::describe;
use sha2::{Digest, Sha256};

use super::frames::Frames;
use super::pipeline::{BITS, quality};
use super::{Axes, GridError, Request};
use crate::classes::{ClassMap, Groups, Table, of_labels};
use crate::metric::{average, bootstrap, difficulty, latency, paper};
use crate::results::{Point, Setup};

/// The setup of `request` with the cells at `points`. Reads the files of the models.
pub fn setup(
    request: &Request,
    map: &ClassMap,
    groups: &Groups,
    points: &[Point],
) -> Result<Setup, GridError> {
    let options = &request.options;
    let model = |path: &PathBuf| Ok((Axes::model_name(path), sha256(path)?));
    Ok(Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        protocol: options.protocol,
        source: request.data.name(),
        bits: BITS,
        seed: options.seed,
        difficulty: request.difficulty(),
        engine: options.engine.to_string(),
        class_map: map.table.clone(),
        groups: groups.table().clone(),
        models: options.axes.model.iter().map(model).collect::<Result<_, GridError>>()?,
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

/// The definition of each figure, by its name.
pub fn definitions() -> Table {
    [
        ("ap50", average::DEFINITION),
        ("ap50_95", "Mean over groups of the mean AP at the ten IoU thresholds 0.50, 0.55, ..., 0.95."),
        ("classes", "As ap50, for one class of the labels. Other classes of its group that the model cannot find are ignored."),
        ("difficulty", difficulty::DEFINITION),
        ("exact_k, psnr_db, ssim", quality::DEFINITION),
        ("interval95", bootstrap::DEFINITION),
        ("latency_ms", latency::DEFINITION),
        ("paper", paper::DEFINITION),
    ]
    .map(|(name, text)| (name.to_owned(), text.split_whitespace().collect::<Vec<_>>().join(" ")))
    .into()
}

/// For each model the classes of the labels that it can find.
pub type MappedClasses = BTreeMap<String, BTreeSet<String>>;

/// Finds the mapped classes of each model, and notes in `frames.input` the classes without a counterpart.
pub fn mapped_classes(
    request: &Request,
    map: &ClassMap,
    frames: &mut Frames,
) -> Result<MappedClasses, GridError> {
    let labels: BTreeSet<String> =
        of_labels(frames.truths.iter().flatten()).into_iter().map(str::to_owned).collect();
    let mut all = MappedClasses::new();
    for model in &request.options.axes.model {
        let name = Axes::model_name(model);
        let own = describe(model, request.options.engine, request.threads())?.classes;
        let found: BTreeSet<String> =
            own.iter().filter_map(|class| map.mapped(class)).map(str::to_owned).collect();
        // A model without class names may find every class.
        let mapped =
            if own.is_empty() { labels.clone() } else { labels.intersection(&found).cloned().collect() };
        let without = &mut frames.input.without_twin;
        without.insert(format!("labels, for {name}"), labels.difference(&mapped).cloned().collect());
        without.insert(name.clone(), own.into_iter().filter(|class| map.mapped(class).is_none()).collect());
        all.insert(name, mapped);
    }
    Ok(all)
}
