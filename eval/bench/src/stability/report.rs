//! What a run found, as `results.json` has it.

use std::collections::BTreeMap;

use serde::Serialize;

use super::case::Family;
use super::expect::RECOVERED;

/// A run.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The sum of it.
    pub outcome: Outcome,
    /// By scene.
    pub scenes: Vec<SceneRow>,
    /// What must be refused.
    pub refusals: Vec<RejectionRow>,
}

/// Expectations, counted.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Outcome {
    /// As expected.
    pub held: usize,
    /// `scene, method: what` of the documented failures that are none any more.
    pub better: Vec<String>,
    /// `scene, method: what` of the expectations that broke; the command fails when there is one.
    pub broken: Vec<String>,
    /// Results that a method vouched for, and that are recovered.
    pub vouched: usize,
    /// Recovered results of the methods that ever vouch for one.
    pub could_vouch: usize,
}

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneRow {
    /// Of the case.
    pub name: String,
    /// Of the case.
    pub family: Family,
    /// What the scene is.
    pub what: String,
    /// Why the methods do what they do on it.
    pub why: &'static str,
    /// Unobservable scenes: the other scene that y shows as well.
    pub twin: Option<&'static str>,
    /// b.
    pub bits: u8,
    /// The saturation factor.
    pub alpha: f64,
    /// Rows, columns, channels.
    pub shape: (usize, usize, usize),
    /// By method.
    pub trials: Vec<Trial>,
}

/// One method on one scene.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// The method.
    pub method: &'static str,
    /// What was expected, in words.
    pub expected: String,
    /// Why it is expected to fail, where it is.
    pub reason: Option<&'static str>,
    /// Share of exact k, 0 to 1.
    pub exact: f64,
    /// Share of exact k up to one offset a channel, 0 to 1.
    pub up_to_offset: f64,
    /// dB, the peak being `alpha * 2^b`; `None` without any error.
    pub psnr_db: Option<f64>,
    /// As [`modulo_core::unwrap::Report`] has it.
    pub rung: &'static str,
    /// As [`modulo_core::unwrap::Report`] has it.
    pub trusted: Option<bool>,
    /// The fields of [`modulo_core::unwrap::Signal`] by name.
    pub signal: Option<BTreeMap<&'static str, f32>>,
    /// What came of it.
    pub verdict: Verdict,
    /// Within the folder of the run.
    pub picture: Option<String>,
}

/// What came of an expectation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As expected.
    Held,
    /// A documented failure that is none any more: the documentation is to be changed.
    Better,
    /// Worse than expected; says by how much.
    Broken(String),
}

/// Something that must be refused.
#[derive(Clone, Debug, Serialize)]
pub struct RejectionRow {
    /// What was offered, and to whom.
    pub what: String,
    /// The error, or that there was none.
    pub said: String,
    /// Whether the error names the thing and the value.
    pub held: bool,
}

impl Verdict {
    /// The worse of two.
    pub fn both(first: Self, second: Self) -> Self {
        match (&first, &second) {
            (Self::Broken(a), Self::Broken(b)) => Self::Broken(format!("{a}; {b}")),
            (_, Self::Broken(_)) | (Self::Held, _) => second,
            _ => first,
        }
    }
}

impl Report {
    /// Counts what came of `scenes` and `refusals`.
    pub fn new(scenes: Vec<SceneRow>, refusals: Vec<RejectionRow>) -> Self {
        let mut outcome = Outcome::default();
        for (scene, trial) in
            scenes.iter().flat_map(|scene| scene.trials.iter().map(move |trial| (scene, trial)))
        {
            let place = format!("{}, {}", scene.name, trial.method);
            match &trial.verdict {
                Verdict::Held => outcome.held += 1,
                Verdict::Better => {
                    outcome.better.push(format!("{place}: expected was \"{}\"", trial.expected))
                }
                Verdict::Broken(how) => outcome.broken.push(format!("{place}: {how}")),
            }
            let recovered = trial.exact >= RECOVERED;
            outcome.could_vouch += usize::from(recovered && trial.trusted.is_some());
            outcome.vouched += usize::from(recovered && trial.trusted == Some(true));
        }
        for rejection in &refusals {
            match rejection.held {
                true => outcome.held += 1,
                false => outcome.broken.push(format!("{}: {}", rejection.what, rejection.said)),
            }
        }
        Self { outcome, scenes, refusals }
    }
}
