//! The parameters that describe the sensor and its lens, declared alike by
//! every node that must know them: the one that simulates it, those that undo it.
//!
//! No node's own parameter is here, and nothing is guessed.

use modulo_core::optics::{MAX_SIGMA, Psf};
use modulo_core::{Range, RangeError, SensorError};

use crate::parameter::{Allowed, Descriptor, Parameters, Refusal, Value};

/// Width of the converter and reach of the scene.
pub fn declare_range() -> [Descriptor; 2] {
    [
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
    ]
}

/// Blur of the lens; none by default.
pub fn declare_lens() -> [Descriptor; 2] {
    [
        Descriptor::new(
            "psf",
            Value::String("gaussian".into()),
            Allowed::Words(&["gaussian", "paper7"]),
            "blur of the lens: gaussian of psf_sigma, or the paper's fixed 7 taps (about 1.4 px)",
        ),
        Descriptor::new(
            "psf_sigma",
            Value::Double(0.0),
            Allowed::Doubles { from: 0.0, to: MAX_SIGMA },
            "sigma of the lens blur in px; 0: a perfect lens",
        ),
    ]
}

/// What [`declare_range`] declares.
///
/// # Errors
/// [`Refusal`] of the parameter that is not possible.
pub fn range(parameters: &Parameters) -> Result<Range, Refusal> {
    Range::new(bits(parameters), parameters.double("alpha")).map_err(|why| refuse(parameters, &why.into()))
}

/// Bits of the converter.
pub fn bits(parameters: &Parameters) -> u8 {
    u8::try_from(parameters.integer("bits")).unwrap_or(u8::MAX)
}

/// What [`declare_lens`] declares.
pub fn psf(parameters: &Parameters) -> Psf {
    match (parameters.string("psf"), parameters.double("psf_sigma")) {
        ("paper7", _) => Psf::Paper7,
        (_, sigma) => Psf::of_sigma(sigma),
    }
}

/// The refusal of the parameter that `why` is about.
pub fn refuse(parameters: &Parameters, why: &SensorError) -> Refusal {
    let name = match why {
        SensorError::Range(RangeError::Bits { .. }) => "bits",
        SensorError::PsfSigma { .. } => "psf_sigma",
        SensorError::Noise { name, .. } => name,
        _ => "alpha",
    };
    let value = parameters.get(name).map(ToString::to_string).unwrap_or_default();
    Refusal::new(name, value, why.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(changes: &[(&str, &str)]) -> Parameters {
        let declared = declare_range().into_iter().chain(declare_lens()).collect();
        let changes: Vec<_> = changes.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
        Parameters::declare(declared).with_text(&changes).expect("possible")
    }

    #[test]
    fn the_lens_is_what_was_asked_for() {
        assert_eq!(psf(&parameters(&[])), Psf::None);
        assert_eq!(psf(&parameters(&[("psf_sigma", "1.4")])), Psf::Gaussian { sigma: 1.4 });
        assert_eq!(psf(&parameters(&[("psf", "paper7")])), Psf::Paper7);
    }

    #[test]
    fn a_refusal_names_the_parameter_that_is_wrong() {
        let parameters = parameters(&[("bits", "12"), ("alpha", "2.5")]);
        let named = |why: SensorError| refuse(&parameters, &why).to_string();
        assert!(named(RangeError::Bits { bits: 12 }.into()).starts_with("parameter 'bits' = 12:"));
        assert!(named(RangeError::Alpha { alpha: 2.5 }.into()).starts_with("parameter 'alpha' = 2.5:"));
        assert!(named(SensorError::PsfSigma { sigma: -1.0 }).starts_with("parameter 'psf_sigma' = 0:"));
    }
}
