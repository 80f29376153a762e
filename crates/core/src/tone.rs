//! Converts radiance to integers for a screen, a detector or an HDR file.
//!
//! One tone curve serves all channels. It depends only on the sensor and on the transfer function of the pictures that it sees,
//! never on the image: there is no automatic exposure.

use std::borrow::Cow;

use ndarray::{Array3, ArrayRef3};

use crate::frame::{Frame, FrameError, Samples, in_order};
use crate::range::{HALF_A_CODE, Range};
use crate::simd::{floor, mapped, widest};
use crate::transfer::Transfer;

/// The floats from here on, up to twice this number, are whole numbers, and their lowest bits count up.
const WHOLE: f32 = (1u32 << 23) as f32;

/// Returns `round(255 * x / (headroom * alpha * 2^b))`, clamped to 0..255, as a frame of 8 bits.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) does not have the shape of an image.
pub fn linear8(x: &ArrayRef3<f32>, range: Range) -> Result<Frame, FrameError> {
    picture(x, range, Transfer::Linear)
}

/// Returns the picture of 8 bits that `transfer` has for the radiance `x` of whole codes: as [`linear8`], or
/// `round(255 * encode((x + 1/2) / (headroom * alpha * 2^b)))`, where the half undoes the bias of rounding down. The picture that a sensor saw
/// is returned, up to blur, noise and quantisation. NaN becomes 0.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) does not have the shape of an image.
pub fn picture(x: &ArrayRef3<f32>, range: Range, transfer: Transfer) -> Result<Frame, FrameError> {
    Frame::from_u8(shown(x, range, transfer, |x| x))
}

/// Returns the codes of 8 bits of `radiance(x)` for each sample of `x`, as in [`picture`].
#[inline(always)]
pub(crate) fn shown(
    x: &ArrayRef3<f32>,
    range: Range,
    transfer: Transfer,
    radiance: impl Fn(f32) -> f32,
) -> Array3<u8> {
    match ToneTable::of(range, transfer) {
        // Where a curve is steep, half a count is more than a code.
        Some(table) => mapped(x, |x| table.code(radiance(x) + HALF_A_CODE)),
        // Other numbers than whole codes need double precision: near a half they would round differently in single precision.
        None => {
            let scale = 255.0 / range.white();
            mapped(x, |x| to_u8(radiance(x), scale))
        }
    }
}

/// Returns the picture of the radiance `y + k * 2^b`, as [`picture`] does; `y` and `k` are those of an unwrapped image.
///
/// # Errors
/// [`FrameError`] when `y` has floats or another shape than `k`.
pub fn picture_of_counts(
    y: &Frame,
    k: &Array3<u8>,
    range: Range,
    transfer: Transfer,
) -> Result<Frame, FrameError> {
    let k = in_order(k.view());
    let codes = match y.samples() {
        Samples::U8(y) => shown_counts(in_order(y.view()), k, range, transfer),
        Samples::U16(y) => shown_counts(in_order(y.view()), k, range, transfer),
        Samples::F32(_) => Vec::new(),
    };
    Frame::from_u8(Array3::from_shape_vec(y.dim(), codes).unwrap_or_default())
}

fn shown_counts<T: Copy + Into<f32>>(y: &[T], k: &[u8], range: Range, transfer: Transfer) -> Vec<u8> {
    #[inline(always)]
    fn codes<T: Copy + Into<f32>>(y: &[T], k: &[u8], range: Range, code: impl Fn(f32) -> u8) -> Vec<u8> {
        let (peak, mut codes) = (range.peak(), vec![0; k.len().min(y.len())]);
        let samples = codes.iter_mut().zip(y).zip(k);
        widest!(samples.for_each(|((out, &y), &k)| *out = code(y.into() + f32::from(k) * peak)));
        codes
    }
    match (ToneTable::of(range, transfer), Single::of(range)) {
        (Some(table), _) => codes(y, k, range, |x| table.code(x + HALF_A_CODE)),
        (None, Some(single)) => codes(y, k, range, |x| single.code(x)),
        (None, None) => codes(y, k, range, |x| to_u8(x, 255.0 / range.white())),
    }
}

/// The scale of [`linear8`] in single precision, with twice as many samples in a vector, for whole codes.
struct Single(f32);

impl Single {
    /// Returns the scale; `None` if single precision rounds a whole code of this range differently.
    fn of(range: Range) -> Option<Self> {
        /// The greatest white for which checking all codes costs little.
        const MOST: f64 = 16384.0;
        let (white, scale) = (range.white(), 255.0 / range.white());
        let single = Self(scale as f32);
        let agrees = |x: u32| single.code(x as f32) == to_u8(x as f32, scale);
        // Beyond the white, every code is 255.
        let all = || widest!((0..=white.ceil() as u32).fold(true, |all, x| all & agrees(x)));
        (white <= MOST && all()).then_some(single)
    }

    /// Returns the code of the whole number `x`.
    #[inline(always)]
    fn code(&self, x: f32) -> u8 {
        /// Carries halves up, and is far below the distance of any other code from a half.
        const ABOVE: f32 = 1.0 / 4096.0;
        ((x * self.0 + ABOVE).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
    }
}

/// The codes of 8 bits of all radiance of a sensor: a power for each sample would take longer than unwrapping.
pub(crate) struct ToneTable {
    codes: Vec<u8>,
    /// Entries for one code unit, a power of two: half code units are exact up to `headroom * alpha * 2^b = 65536`.
    per_unit: f32,
}

impl ToneTable {
    /// The largest number of entries.
    const MOST: f64 = 131_072.0;

    /// Returns the table of `transfer`; `None` if the codes are proportional to radiance, which takes no table.
    pub(crate) fn of(range: Range, transfer: Transfer) -> Option<Self> {
        if transfer == Transfer::Linear {
            return None;
        }
        let per_unit = (Self::MOST / range.white()).log2().floor().exp2();
        let entries = range.white() * per_unit;
        let mut codes = Vec::with_capacity(entries.ceil() as usize);
        for code in 0..u8::MAX {
            // The least radiance that rounds to the next code.
            let end = entries * transfer.decode((f64::from(code) + 0.5) / 255.0);
            codes.resize(end.ceil() as usize, code);
        }
        codes.resize(entries.ceil() as usize, u8::MAX);
        Some(Self { codes, per_unit: per_unit as f32 })
    }

    /// Returns the code of the radiance `x` in code units.
    pub(crate) fn code(&self, x: f32) -> u8 {
        // The conversion with `as` clamps to 0 and above, and sends NaN to 0.
        let entry = (x * self.per_unit) as u32 as usize;
        self.codes[entry.min(self.codes.len() - 1)]
    }
}

/// Returns the HDR image in code units. Where all of the range fits 16 bits (`alpha * 2^b <= 65536`) it is
/// `round(x)`, clamped to 0..65535, as a frame of 16 bits, else x itself as a frame of floats.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) does not have the shape of an image or, if the range does not
/// fit 16 bits, is not finite.
pub fn hdr(x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
    // `as` clamps and sends NaN to 0.
    if range.limit() <= 65536.0 {
        Frame::from_u16(x.mapv(|x| (f64::from(x) + 0.5) as u16))
    } else {
        Frame::from_f32(x.clone())
    }
}

/// Returns the frame with 8 bits: `255 / most * sample` in single precision, rounded to the nearest code (of two, the even one), and clamped to
/// 0..255, where `most` > 0 is the sample that becomes white. A frame that is so already is not copied.
pub fn eight_bits(frame: &Frame, most: f32) -> Cow<'_, Frame> {
    let scale = 255.0 / most;
    #[inline(always)]
    fn code(sample: f32, scale: f32) -> u8 {
        // The conversion with `as` has no vector instruction.
        ((sample * scale).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
    }
    let codes = match frame.samples() {
        Samples::U8(_) if most == 255.0 => return Cow::Borrowed(frame),
        Samples::U8(samples) => {
            let table: [u8; 256] = std::array::from_fn(|sample| code(sample as f32, scale));
            in_order(samples.view()).iter().map(|&sample| table[usize::from(sample)]).collect()
        }
        Samples::U16(samples) => scaled(in_order(samples.view()), |&sample| code(sample.into(), scale)),
        Samples::F32(samples) => scaled(in_order(samples.view()), |&sample| code(sample, scale)),
    };
    let codes = Array3::from_shape_vec(frame.dim(), codes).expect("one code for each sample");
    Cow::Owned(Frame::from_u8(codes).expect("the shape is that of a frame"))
}

#[inline(always)]
fn scaled<T>(samples: &[T], code: impl Fn(&T) -> u8) -> Vec<u8> {
    let mut codes = vec![0; samples.len()];
    widest!(codes.iter_mut().zip(samples).for_each(|(out, sample)| *out = code(sample)));
    codes
}

/// Writes a row of 8-bit pixels, `W x 3` interleaved, as three planes of `W` samples in [0, 1]: `x / 255`.
///
/// Where a plane is shorter than the row, the rest of the row is left out.
pub fn unit_planes(row: &[u8], [red, green, blue]: [&mut [f32]; 3]) {
    widest!(for (pixel, ((red, green), blue)) in
        row.as_chunks::<3>().0.iter().zip(red.iter_mut().zip(green).zip(blue))
    {
        *red = unit(pixel[0]);
        *green = unit(pixel[1]);
        *blue = unit(pixel[2]);
    });
}

/// Returns `code / 255`, rounded as a division is, which would take three times as long.
#[inline(always)]
fn unit(code: u8) -> f32 {
    /// 1 / 255 in two parts, the first one of so few bits that its product with a code is exact.
    const HIGH: f32 = f32::from_bits((1.0f32 / 255.0).to_bits() & !0xFF);
    const LOW: f32 = (1.0 / 255.0 - HIGH as f64) as f32;
    let code = f32::from(code);
    code * HIGH + code * LOW
}

/// Scales one sample by `scale`, which is `255 / (headroom * alpha * 2^b)`, clamped to 0..255; NaN becomes 0, as `max` returns the number.
#[inline(always)]
#[expect(clippy::manual_clamp, reason = "`clamp` would keep NaN")]
pub(crate) fn to_u8(x: f32, scale: f64) -> u8 {
    floor((f64::from(x) * scale + 0.5).max(0.0).min(255.0)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_linear_scale_for_all_channels() {
        let x = Array3::from_shape_vec((1, 2, 3), vec![0.0, 256.0, 511.9, 1024.0, 5000.0, -3.0]).unwrap();
        let got = linear8(&x, Range::new(8, 4.0).unwrap()).unwrap();
        assert_eq!(got.to_f32().into_raw_vec_and_offset().0, [0.0, 64.0, 127.0, 255.0, 255.0, 0.0]);
        let got = linear8(&x, Range::new(8, 4.0).unwrap().with_headroom(0.5).unwrap()).unwrap();
        assert_eq!(got.to_f32().into_raw_vec_and_offset().0, [0.0, 128.0, 255.0, 255.0, 255.0, 0.0]);
    }

    const CURVES: [Transfer; 3] = [Transfer::Srgb, Transfer::Gamma22, Transfer::Rec709];

    /// Returns the codes that a curve has for the radiance `x`.
    fn codes(x: Vec<f32>, range: Range, transfer: Transfer) -> Vec<u8> {
        let x = Array3::from_shape_vec((1, x.len(), 1), x).unwrap();
        picture(&x, range, transfer).unwrap().as_u8().unwrap().iter().copied().collect()
    }

    #[test]
    fn each_code_of_a_picture_returns() {
        // Of the code 1, a power of 2.2 leaves less radiance than an entry of the table.
        let all: Vec<u8> = (2..=255).collect();
        let all_ranges = [(12, 4.0, 1.0), (16, 4.0, 1.0), (12, 3.3, 1.0), (12, 4.0, 0.97), (16, 2.0, 0.8)];
        for (transfer, (bits, alpha, headroom)) in
            CURVES.into_iter().flat_map(|transfer| all_ranges.map(|range| (transfer, range)))
        {
            let range = Range::new(bits, alpha).unwrap().with_headroom(headroom).unwrap();
            let radiance =
                |code: &u8| (range.white() * transfer.decode(f64::from(*code) / 255.0)) as f32 - HALF_A_CODE;
            assert_eq!(
                codes(all.iter().map(radiance).collect(), range, transfer),
                all,
                "{transfer:?} {bits} {alpha} {headroom}"
            );
        }
    }

    #[test]
    fn a_curve_is_that_of_its_definition_for_whole_codes() {
        for (transfer, alpha) in CURVES.into_iter().flat_map(|t| [(t, 0.3), (t, 1.5), (t, 4.0), (t, 256.0)]) {
            let range = Range::new(8, alpha).unwrap();
            let x: Vec<f32> = (0..range.limit().ceil() as u32).map(|x| x as f32).collect();
            let defined =
                |x: &f32| (255.0 * transfer.encode((f64::from(*x) + 0.5) / range.limit())).round() as u8;
            let defined: Vec<u8> = x.iter().map(defined).collect();
            assert!(defined.is_sorted());
            assert_eq!(codes(x, range, transfer), defined, "{transfer:?} {alpha}");
        }
    }

    #[test]
    fn a_picture_of_counts_is_that_of_their_radiance() {
        let ranges = [(1, 2.0), (8, 0.3), (8, 4.0), (8, 3.7), (12, 4.0), (12, 3.3), (16, 256.0)];
        let transfers = [Transfer::Linear].into_iter().chain(CURVES);
        for (transfer, (bits, alpha)) in transfers.flat_map(|transfer| ranges.map(|range| (transfer, range)))
        {
            let range = Range::new(bits, alpha).unwrap();
            let number = |i: usize, j: usize, c: usize| (i * 7919 + j * 104_729 + c * 31) % (1 << 16);
            let y = Array3::from_shape_fn((40, 50, 3), |(i, j, c)| (number(i, j, c) % (1 << bits)) as u16);
            let k = Array3::from_shape_fn((40, 50, 3), |(i, j, c)| {
                (number(j, i, c) % (1 + usize::from(range.max_wraps()))) as u8
            });
            let x = y.mapv(f32::from) + k.mapv(f32::from) * range.peak();
            let expected = picture(&x, range, transfer).unwrap();
            if bits <= 8 {
                let y = Frame::from_u8(y.mapv(|y| y as u8)).unwrap();
                assert_eq!(
                    picture_of_counts(&y, &k, range, transfer).unwrap(),
                    expected,
                    "{transfer:?} {alpha}"
                );
            }
            let y = Frame::from_u16(y).unwrap();
            assert_eq!(picture_of_counts(&y, &k, range, transfer).unwrap(), expected, "{transfer:?} {alpha}");
        }
        let (y, k) = (Frame::from_u8(Array3::zeros((2, 3, 1))).unwrap(), Array3::zeros((2, 2, 1)));
        assert!(picture_of_counts(&y, &k, Range::new(8, 4.0).unwrap(), Transfer::Linear).is_err());
    }

    #[test]
    fn a_curve_clamps_what_is_out_of_range() {
        let x = vec![f32::NAN, f32::NEG_INFINITY, -3.0, 1024.0, 1e30, f32::INFINITY];
        for transfer in CURVES {
            assert_eq!(codes(x.clone(), Range::new(8, 4.0).unwrap(), transfer), [0, 0, 0, 255, 255, 255]);
        }
    }

    proptest::proptest! {
        #[test]
        fn whole_codes_are_shown_as_any_others(
            bits in 1u8..=14,
            alpha in 0.3..40f64,
            headroom in 0.5..=1.0,
            codes in proptest::collection::vec(-300f32..70_000.0, 40),
            is_whole: bool,
        ) {
            let range = Range::new(bits, alpha).unwrap().with_headroom(headroom).unwrap();
            let shown = |x: Vec<f32>| {
                let x = Array3::from_shape_vec((1, x.len(), 1), x).unwrap();
                linear8(&x, range).unwrap().as_u8().unwrap().iter().copied().collect::<Vec<_>>()
            };
            let x: Vec<f32> = codes.into_iter().map(|x| if is_whole { x.floor() } else { x }).collect();
            let defined: Vec<u8> = x.iter().map(|&x| to_u8(x, 255.0 / range.white())).collect();
            proptest::prop_assert_eq!(shown(x), defined);
            // Halves between two codes are among them.
            let all: Vec<f32> = (0..=range.white().ceil().min(70_000.0) as u32).map(|x| x as f32).collect();
            let defined: Vec<u8> = all.iter().map(|&x| to_u8(x, 255.0 / range.white())).collect();
            proptest::prop_assert_eq!(shown(all), defined);
        }
    }

    #[test]
    fn a_unit_is_the_rounded_quotient() {
        for code in 0..=u8::MAX {
            assert_eq!(unit(code), f32::from(code) / 255.0, "{code}");
        }
    }

    #[test]
    fn the_largest_sample_becomes_white() {
        let wide = |samples: Vec<u16>| Array3::from_shape_vec((1, samples.len(), 1), samples).unwrap();
        let samples: Vec<u16> = (0..=u16::MAX).collect();
        let codes = |frame: &Frame, most| -> Vec<u8> {
            eight_bits(frame, most).as_u8().unwrap().iter().copied().collect()
        };
        for most in (1..=16).map(|bits| (1u32 << bits) as f32 - 1.0).chain([0.5, 993.28]) {
            let code = |sample: f32| (255.0 / most * sample).round_ties_even().clamp(0.0, 255.0) as u8;
            let defined = samples.iter().map(|&sample| code(sample.into())).collect::<Vec<_>>();
            let eight = Frame::from_u8(wide(samples[..256].to_vec()).mapv(|sample| sample as u8)).unwrap();
            assert_eq!(codes(&eight, most), defined[..256], "{most}");
            assert_eq!(codes(&Frame::from_u16(wide(samples.clone())).unwrap(), most), defined, "{most}");
            let floats =
                Frame::from_f32(wide(samples.clone()).mapv(|sample| f32::from(sample) - 9.0)).unwrap();
            assert_eq!(codes(&floats, most)[9..], defined[..65527], "{most}");
            assert_eq!((code(most), codes(&floats, most)[0]), (255, 0));
        }
        let same = Frame::from_u8(Array3::zeros((2, 3, 1))).unwrap();
        assert!(matches!(eight_bits(&same, 255.0), Cow::Borrowed(_)));
    }

    #[test]
    fn hdr_keeps_code_units_and_never_clips_the_range() {
        let x = Array3::from_shape_vec((1, 5, 1), vec![0.4, 0.5, 1023.0, 65_535.0, 262_143.0]).unwrap();
        for (bits, alpha, depth, want) in [
            (8, 256.0, 16, [0.0, 1.0, 1023.0, 65_535.0, 65_535.0]),
            (16, 1.0, 16, [0.0, 1.0, 1023.0, 65_535.0, 65_535.0]),
            (16, 1.001, 32, [0.4, 0.5, 1023.0, 65_535.0, 262_143.0]),
            (16, 4.0, 32, [0.4, 0.5, 1023.0, 65_535.0, 262_143.0]),
        ] {
            let got = hdr(&x, Range::new(bits, alpha).unwrap()).unwrap();
            assert_eq!((got.depth(), got.to_f32().into_raw_vec_and_offset().0), (depth, want.to_vec()));
        }
    }
}
