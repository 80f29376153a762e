//! The parameters of the `unwrap` node, and what they mean.

use modulo_core::MAX_THREADS;
use modulo_core::unwrap::{self, Options, ThresholdOn, TrustLimits, Unwrap, UnwrapError};
use modulo_runtime::{Allowed, Descriptor, Parameters, Refusal, Value, imaging};

/// The node's parameters.
pub fn declare() -> Vec<Descriptor> {
    let Options { tau, threads, trust, .. } = Options::default();
    let share = |name, default, text| {
        Descriptor::new(name, Value::Double(default), Allowed::Doubles { from: 0.0, to: 1.0 }, text)
    };
    let mut declared = vec![
        Descriptor::new(
            "method",
            Value::String("auto".into()),
            Allowed::Words(unwrap::METHODS),
            "how the wraps are undone; auto: as much model as the frame needs",
        ),
        Descriptor::new(
            "threads",
            Value::Integer(threads as i64),
            Allowed::Integers { from: 1, to: MAX_THREADS as i64 },
            "threads that unwrapping may use; the result does not depend on it",
        ),
        share(
            "trust_lines",
            trust.lines,
            "auto: greatest share of steep 2 x 2 loops for which lines is trusted",
        ),
        share(
            "trust_consensus",
            trust.consensus,
            "auto: least share of every row and column that must agree for lines to be trusted",
        ),
        share(
            "trust_gradient_tree",
            trust.gradient_tree,
            "auto: greatest share of steep 2 x 2 loops for which gradient_tree is trusted",
        ),
        Descriptor::new(
            "tau",
            Value::Double(tau),
            Allowed::Doubles { from: 0.0, to: 1e6 },
            "spud: hard threshold, in units of the peak",
        ),
        Descriptor::new(
            "threshold_on",
            Value::String("phi".into()),
            Allowed::Words(&["phi", "rho"]),
            "spud: coefficients that the threshold acts on, after (phi) or before (rho) the division",
        ),
    ];
    declared.extend(imaging::declare_range());
    declared.extend(imaging::declare_lens().map(|lens| Descriptor {
        description: match lens.name {
            "psf" => {
                "blur of the lens to undo: gaussian of psf_sigma, or the paper's fixed 7 taps (about 1.4 px)"
            }
            _ => "sigma of the lens blur to undo in `recovered`, px; 0: the blur stays",
        },
        ..lens
    }));
    declared
}

/// The method that the parameters describe.
pub fn method(parameters: &Parameters) -> Result<Box<dyn Unwrap>, Refusal> {
    let threshold_on = match parameters.string("threshold_on") {
        "rho" => ThresholdOn::Rho,
        _ => ThresholdOn::Phi,
    };
    let options = Options {
        tau: parameters.double("tau"),
        threshold_on,
        threads: usize::try_from(parameters.integer("threads")).unwrap_or(usize::MAX),
        trust: TrustLimits {
            lines: parameters.double("trust_lines"),
            consensus: parameters.double("trust_consensus"),
            gradient_tree: parameters.double("trust_gradient_tree"),
        },
    };
    unwrap::by_name(parameters.string("method"), &options).map_err(|why| {
        let name = match why {
            UnwrapError::Workers(_) => "threads",
            UnwrapError::Tau { .. } => "tau",
            _ => "method",
        };
        Refusal::new(name, parameters.get(name).map(ToString::to_string).unwrap_or_default(), why.to_string())
    })
}
