//! [`StabilityReport`]: the results of a run, as `results.json` has them.

use std::collections::BTreeMap;

use serde::Serialize;

use super::case::Case;
use super::expect::{Judgement, RECOVERED};

#[derive(Serialize)]
pub struct StabilityReport {
    pub outcome: StabilityOutcome,
    pub scenes: Vec<SceneRow>,
}

/// Numbers of expectations that held and broke.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StabilityOutcome {
    /// Number of expectations that held.
    pub held: usize,
    /// `scene, method: what` for each documented failure that no longer occurs.
    pub better: Vec<String>,
    /// `scene, method: what` for each broken expectation. The command fails if there is one.
    pub broken: Vec<String>,
    /// Number of recovered results that their method trusts.
    pub trusted: usize,
    /// Number of recovered results of methods that make a statement of trust.
    pub judged: usize,
}

/// The results of all methods on one scene.
#[derive(Serialize)]
pub struct SceneRow {
    #[serde(flatten)]
    pub scene: &'static Case,
    /// Rows, columns, channels.
    pub shape: (usize, usize, usize),
    pub trials: Vec<Trial>,
}

/// The result of one method on one scene.
#[derive(Serialize)]
pub struct Trial {
    pub method: &'static str,
    /// The expectation in words.
    pub expected: String,
    /// The reason of an expected failure.
    pub reason: Option<&'static str>,
    /// Share of the samples with the true k, 0 to 1.
    pub exact: f64,
    /// The same share after one best offset for each channel.
    pub up_to_offset: f64,
    /// PSNR in dB with the peak `alpha * 2^b`. `None` without any error.
    pub psnr_db: Option<f64>,
    /// The method that produced the result, see [`modulo_core::unwrap::Report`].
    pub method_used: &'static str,
    /// Whether the method trusts its result. `None` if it makes no statement.
    pub trusted: Option<bool>,
    /// The fields of [`modulo_core::unwrap::QualityMetrics`] by name.
    pub signal: Option<BTreeMap<&'static str, f32>>,
    pub verdict: Judgement,
    /// Path of the picture within the folder of the run.
    pub picture: String,
}

impl StabilityReport {
    /// Counts the verdicts of `scenes`.
    pub fn new(scenes: Vec<SceneRow>) -> Self {
        let mut outcome = StabilityOutcome::default();
        for (scene, trial) in
            scenes.iter().flat_map(|scene| scene.trials.iter().map(move |trial| (scene, trial)))
        {
            let place = format!("{}, {}", scene.scene.name, trial.method);
            match &trial.verdict {
                Judgement::Held => outcome.held += 1,
                Judgement::Better => {
                    outcome.better.push(format!("{place}: expected was \"{}\"", trial.expected))
                }
                Judgement::Broken(how) => outcome.broken.push(format!("{place}: {how}")),
            }
            // Trust is counted only over recovered results: a method that never trusts is safe, but of no use.
            let recovered = trial.exact >= RECOVERED;
            outcome.judged += usize::from(recovered && trial.trusted.is_some());
            outcome.trusted += usize::from(recovered && trial.trusted == Some(true));
        }
        Self { outcome, scenes }
    }
}
