//! The parameters of the `unwrap` node, and what they mean.

use modulo_core::Range;
use modulo_core::unwrap::{self, Options, ThresholdOn, Unwrap};
use modulo_runtime::{Allowed, Descriptor, Parameters, Refusal, Value};

/// The node's parameters.
pub fn declare() -> Vec<Descriptor> {
    vec![
        Descriptor::new(
            "method",
            Value::String("lines".into()),
            Allowed::Words(unwrap::METHODS),
            "how the wraps are undone",
        ),
        Descriptor::new(
            "bits",
            Value::Integer(8),
            Allowed::Integers { from: 1, to: 16 },
            "bits of the sensor's converter; the peak is 2^bits",
        ),
        Descriptor::new(
            "alpha",
            Value::Double(4.0),
            Allowed::Doubles { from: 1e-3, to: 256.0 },
            "saturation factor: brightest radiance of the scene over the sensor's peak",
        ),
        Descriptor::new(
            "tau",
            Value::Double(0.1),
            Allowed::Doubles { from: 0.0, to: 1e6 },
            "spud: hard threshold, in units of the peak",
        ),
        Descriptor::new(
            "threshold_on",
            Value::String("phi".into()),
            Allowed::Words(&["phi", "rho"]),
            "spud: coefficients that the threshold acts on, after (phi) or before (rho) the division",
        ),
    ]
}

/// The method that the parameters describe.
pub fn method(parameters: &Parameters) -> Result<Box<dyn Unwrap>, Refusal> {
    let name = parameters.string("method");
    let threshold_on = match parameters.string("threshold_on") {
        "rho" => ThresholdOn::Rho,
        _ => ThresholdOn::Phi,
    };
    let options = Options { tau: parameters.double("tau"), threshold_on, ..Options::default() };
    unwrap::by_name(name, &options).map_err(|why| Refusal::new("method", name, why.to_string()))
}

/// Bits and alpha of the sensor.
pub fn range(parameters: &Parameters) -> Result<Range, Refusal> {
    let bits = u8::try_from(parameters.integer("bits")).unwrap_or(u8::MAX);
    let alpha = parameters.double("alpha");
    Range::new(bits, alpha).map_err(|why| Refusal::new("alpha", alpha, why.to_string()))
}
