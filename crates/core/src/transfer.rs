//! [`Transfer`]: the relation between the codes of a picture and the radiance that they stand for.

/// A transfer function: how the codes of pictures stand for radiance. Both are fractions of full scale, in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transfer {
    /// Codes are proportional to radiance.
    #[default]
    Linear,
    /// The function of sRGB (IEC 61966-2-1), which most pictures have.
    Srgb,
    /// A power of 2.2.
    Gamma22,
    /// The function of ITU-R BT.709, with the constants of BT.2020, which are the same ones with more digits.
    Rec709,
}

/// The constant by which the power of BT.709 is scaled. It makes the power meet the straight line without a step.
const REC709_SCALE: f64 = 1.099_296_826_809_44;
/// The radiance at which the straight line of BT.709 ends.
const REC709_END: f64 = 0.018_053_968_510_807;

impl Transfer {
    /// Every function with its word.
    pub const WORDS: [(&'static str, Self); 4] = [
        ("linear", Self::Linear),
        ("srgb", Self::Srgb),
        ("gamma22", Self::Gamma22),
        ("rec709", Self::Rec709),
    ];

    /// Returns the word of this function.
    pub fn word(self) -> &'static str {
        let named = Self::WORDS.iter().find(|(_, function)| *function == self);
        named.map(|(word, _)| *word).expect("the list has every function")
    }

    /// Returns the radiance of a code. Values outside [0, 1] are clamped, and NaN becomes 0.
    pub fn decode(self, code: f64) -> f64 {
        let code = unit(code);
        match self {
            Self::Linear => code,
            Self::Srgb if code <= 0.040_45 => code / 12.92,
            Self::Srgb => ((code + 0.055) / 1.055).powf(2.4),
            Self::Gamma22 => code.powf(2.2),
            Self::Rec709 if code < 4.5 * REC709_END => code / 4.5,
            Self::Rec709 => ((code + REC709_SCALE - 1.0) / REC709_SCALE).powf(1.0 / 0.45),
        }
    }

    /// Returns the code of a radiance, which [`Transfer::decode`] leads back to it. Values outside [0, 1] are clamped, and NaN
    /// becomes 0.
    pub fn encode(self, radiance: f64) -> f64 {
        let radiance = unit(radiance);
        match self {
            Self::Linear => radiance,
            Self::Srgb if radiance <= 0.040_45 / 12.92 => 12.92 * radiance,
            Self::Srgb => 1.055 * radiance.powf(1.0 / 2.4) - 0.055,
            Self::Gamma22 => radiance.powf(1.0 / 2.2),
            Self::Rec709 if radiance < REC709_END => 4.5 * radiance,
            Self::Rec709 => REC709_SCALE * radiance.powf(0.45) - (REC709_SCALE - 1.0),
        }
    }

    /// Returns the codes, 0 to `most`, that a picture has for the radiance `0, 1, ..., most`.
    pub(crate) fn codes(self, most: u16) -> Vec<u16> {
        let scale = f64::from(most);
        (0..=most).map(|radiance| (scale * self.encode(f64::from(radiance) / scale)).round() as u16).collect()
    }
}

/// Clamps to [0, 1]; NaN becomes 0, as `max` returns the number.
#[expect(clippy::manual_clamp, reason = "`clamp` would keep NaN")]
fn unit(value: f64) -> f64 {
    value.max(0.0).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Transfer; 4] = [Transfer::Linear, Transfer::Srgb, Transfer::Gamma22, Transfer::Rec709];

    #[test]
    fn each_code_leads_to_its_radiance_and_back() {
        for (transfer, most) in ALL.into_iter().flat_map(|transfer| [(transfer, 255u16), (transfer, 65535)]) {
            for code in 0..=most {
                let fraction = f64::from(code) / f64::from(most);
                let back = transfer.encode(transfer.decode(fraction));
                assert!((back - fraction).abs() < 1e-7, "{transfer:?} {code}: {back}");
            }
        }
    }

    #[test]
    fn both_ways_are_monotone_from_0_to_1() {
        for transfer in ALL {
            for way in [Transfer::decode, Transfer::encode] {
                let values: Vec<f64> =
                    (0..=200_000).map(|n| way(transfer, f64::from(n) / 200_000.0)).collect();
                assert!(values.is_sorted(), "{transfer:?}");
                assert!(values[0].abs() < 1e-12 && (values[200_000] - 1.0).abs() < 1e-12, "{transfer:?}");
            }
        }
    }

    #[test]
    fn figures_of_the_standards() {
        for (transfer, code, radiance) in [
            (Transfer::Srgb, 0.5, 0.214_041),
            (Transfer::Srgb, 0.02, 0.001_548),
            (Transfer::Gamma22, 0.5, 0.217_638),
            (Transfer::Rec709, 0.5, 0.259_719),
            (Transfer::Rec709, 0.045, 0.01),
        ] {
            let decoded = transfer.decode(code);
            assert!((decoded - radiance).abs() < 1e-5, "{transfer:?} {code}: {decoded}");
        }
    }

    #[test]
    fn what_is_no_fraction_is_clamped() {
        for (transfer, way) in
            ALL.into_iter().flat_map(|t| [(t, Transfer::decode as fn(_, _) -> _), (t, Transfer::encode)])
        {
            for (value, clamped) in
                [(f64::NAN, 0.0), (-1.0, 0.0), (f64::NEG_INFINITY, 0.0), (1.5, 1.0), (f64::INFINITY, 1.0)]
            {
                let got = way(transfer, value);
                assert!((got - clamped).abs() < 1e-12, "{transfer:?} {value}: {got}");
            }
        }
    }

    #[test]
    fn words_are_those_of_the_functions() {
        assert_eq!(ALL.map(Transfer::word), Transfer::WORDS.map(|(word, _)| word));
    }
}
