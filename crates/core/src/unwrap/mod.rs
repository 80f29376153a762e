//! The unwrapping methods, which recover radiance from a modulo image: one trait for all.
//!
//! Every result is congruent with its input, `x_hat = y + k * 2^b`, so that a method can be wrong only about k.

mod auto;
mod budget;
mod congruence;
mod defects;
mod edges;
mod fitness;
mod gradient_sums;
mod gradient_tree;
mod green_sums;
mod growth;
mod itoh;
mod judge;
mod jumps;
mod lattice;
mod lines;
mod margin_tree;
mod mosaic;
mod mosaic_image;
mod offset;
mod other_colour;
mod poisson;
mod proof;
mod smoothed_tree;
mod smoothing;
mod spud;
mod tree;
mod wrapped;

use std::str::FromStr;

use ndarray::Array3;

pub use crate::range::{Range, RangeError};
pub use auto::{Auto, TrustLimits};
pub use budget::WORK_OF_NOISE;
pub use fitness::fit_up_to;
pub use gradient_tree::GradientTree;
pub use itoh::Itoh;
pub use lines::Lines;
pub use offset::OffsetEvidence;
pub use poisson::ThresholdOn;
pub use proof::proved_up_to;
pub use spud::{LeastSquares, Spud};
pub use tree::Tree;

use self::judge::Judged;
use self::mosaic::MosaicUnwrap;
use crate::frame::{Frame, FrameError, SamplePosition, Samples, copy_channel, in_order, position_of};
use crate::gains::{Gains, TwoGains};
use crate::optics::Psf;
use crate::simd::widest;
use crate::workers::WorkersError;

/// Declares the methods, one line each: its type, its name, and its constructor.
macro_rules! methods {
    ($($method:ident $name:literal $make:expr,)*) => {
        /// An unwrapping method.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Method {
            $(#[doc = concat!("[`", stringify!($method), "`]")] $method,)*
        }

        /// The names of all methods.
        pub const METHODS: &[&str] = &[$($name),*];

        impl Method {
            /// Every method with its name.
            pub const ALL: [(&'static str, Self); METHODS.len()] = [$(($name, Self::$method)),*];

            /// Makes the method with these options, for images with and without a colour mosaic. The types of the methods
            /// themselves take a mosaic for an image of one colour.
            ///
            /// # Errors
            /// [`UnwrapError::Tau`] for a negative or NaN threshold, [`UnwrapError::Workers`] when the threads
            /// are not available.
            pub fn build(self, options: &Options) -> Result<Box<dyn Unwrap>, UnwrapError> {
                let make: fn(&Options) -> Result<Box<dyn Unwrap>, UnwrapError> = match self {
                    $(Self::$method => $make,)*
                };
                let is_auto = self == Self::Auto;
                let method = MosaicUnwrap::new(make(options)?, is_auto, options)?;
                Ok(Box::new(Judged::of_one_gain(Box::new(method), is_auto, options.successive)))
            }
        }
    };
}

methods! {
    Auto "auto" |options| Ok(Box::new(Auto::new(options)?)),
    Spud "spud" |options| Ok(Box::new(Spud::with_threads(options.tau, options.threshold_on, options.threads)?)),
    LeastSquares "least_squares" |options| Ok(Box::new(LeastSquares::new(options.threads)?)),
    Itoh "itoh" |_| Ok(Box::new(Itoh::default())),
    Lines "lines" |_| Ok(Box::new(Lines::default())),
    Tree "tree" |_| Ok(Box::new(Tree::default())),
    GradientTree "gradient_tree" |options| Ok(Box::new(GradientTree::new(options.threads)?)),
}

impl FromStr for Method {
    type Err = UnwrapError;

    fn from_str(name: &str) -> Result<Self, UnwrapError> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found.map(|(_, method)| *method).ok_or_else(|| UnwrapError::Method { name: name.to_owned() })
    }
}

/// A method that finds the wrap counts of a modulo image.
///
/// ```
/// use modulo_core::unwrap::{Method, Options, Trust};
/// use modulo_core::{Psf, Recovered, Sensor, SensorConfig};
/// use ndarray::Array3;
///
/// let radiance = Array3::from_shape_fn((32, 64, 1), |(i, j, _)| (i + j) as f32 / 100.0);
/// let config = SensorConfig { alpha: 4.0, psf: Psf::of_sigma(1.4), ..SensorConfig::default() };
/// let exposure = Sensor::new(config)?.expose(radiance.view(), 0)?;
///
/// let mut recovered = Recovered::default();
/// let mut method = Method::Auto.build(&Options::default())?;
/// method.unwrap(&exposure.modulo(), &exposure.scene(), &mut recovered)?;
/// assert_eq!(recovered.k, exposure.wraps());
/// assert_eq!(recovered.report.trust, Trust::Trusted);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Unwrap: Send {
    /// Returns the name of the method, as in [`METHODS`].
    fn name(&self) -> &'static str;

    /// Writes radiance and wrap counts of `y` (values below 2^b), an image of `scene`, into `out`, whose buffers are reused when the
    /// shape is the same.
    ///
    /// # Errors
    /// [`UnwrapError::Float`] when `y` has float samples, [`UnwrapError::Code`] when a value of `y` is 2^b or more.
    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError>;
}

/// What is known of an image, and what may be done for it. A [`Range`] alone is a scene behind an unknown lens, without a limit of the work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene {
    /// The bits of the sensor, its saturation factor, and what shows the absolute level.
    pub range: Range,
    /// The blur of the lens; `None`: it is not known. [`Psf::None`] is a perfect lens.
    pub lens: Option<Psf>,
    /// The largest standard deviation of the noise of a sample, in code units; `None`: it is not known.
    pub noise: Option<f64>,
    /// The work that `auto` may do, 0 or above: the time of its candidates in ms on one core of a server of 2023. It is counted
    /// beforehand and not measured, so that the result is the same on every machine. Infinite: no limit.
    pub work: f64,
    /// Whether the radiance is needed. A method may leave it out otherwise; [`Recovered::fill`] computes it from the counts.
    pub radiance: bool,
}

impl From<Range> for Scene {
    fn from(range: Range) -> Self {
        Self { range, lens: None, noise: None, work: f64::INFINITY, radiance: true }
    }
}

/// The result of unwrapping one image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recovered {
    /// The radiance x_hat in code units, H x W x C, a colour mosaic where y is one: exactly `y + k * 2^b`, and at pixels of low gain `(y + 1/2) / gain - 1/2`.
    /// It is empty where it was left out, see [`Scene::radiance`].
    pub x: Array3<f32>,
    /// The wrap counts, H x W x C, `0 <= k <= ceil(alpha) - 1`.
    pub k: Array3<u8>,
    /// The indices of the samples (row-major and interleaved, ascending) that were left out as defects: hot, dead or stuck ones.
    pub defects: Vec<usize>,
    /// The report of the method on its result.
    pub report: Report,
    /// The number of second differences of x above [`edges::NEAR_HALF`] along rows and columns, where the method has counted them.
    pub(crate) near_half: Option<u64>,
    /// The [confidence](Recovered::confidence) of the pixels where a part of the counts is proved, else empty.
    pub(crate) proved: Vec<u8>,
    /// The memory of x where it is left out.
    spare: Array3<f32>,
}

/// The report of a method on its own result.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// The name of the method used, as in [`METHODS`], [`PASS_THROUGH`], [`PROOF`], [`SMOOTHED_TREE`], [`GROWTH`], [`GRADIENT_SUMS`] or
    /// [`TwoGains::NAME`](crate::TwoGains::NAME); empty before the first image.
    pub method: &'static str,
    /// The quality metrics of y, if the method computes them.
    pub quality: Option<QualityMetrics>,
    /// Whether the method claims that k is right.
    pub trust: Trust,
    /// The evidence for the absolute offset of a trusted result; `None` if the method needs none or the result is not trusted.
    pub offset: Option<OffsetEvidence>,
    /// Whether `auto` has left out what could have found a better result, since its work exceeded [`Scene::work`].
    pub is_over_budget: bool,
}

impl Report {
    /// Returns the evidence for the absolute offset for tables and messages: its name, `unknown` where there is none, and `None` for a
    /// result whose counts do not agree with each other or that needs no evidence.
    pub fn offset_evidence(&self) -> Option<&'static str> {
        match self.trust {
            Trust::Relative => Some("unknown"),
            _ => self.offset.map(OffsetEvidence::name),
        }
    }

    /// Returns why the method does not claim that the counts are right, for tables and messages; `None` if it claims it or makes no claim.
    pub fn reason(&self) -> Option<&'static str> {
        match self.trust {
            Trust::Unknown | Trust::Trusted => None,
            Trust::Relative => Some("the absolute level is unknown: no dark reference"),
            Trust::Untrusted if self.is_over_budget => Some(
                "the wrap counts contradict each other, and the work limit ended the search for better ones",
            ),
            Trust::Untrusted => Some("the wrap counts contradict each other"),
            Trust::Unobservable => Some(
                "a wrong wrap count may leave no trace: the lens is too sharp for this alpha, or unknown in an image without \
                 edges, or the image is too small",
            ),
        }
    }
}

/// Whether a method claims that the wrap counts that it found are right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trust {
    /// The method makes no claim.
    #[default]
    Unknown,
    /// The method claims that the counts are right.
    Trusted,
    /// The method claims that the differences between the counts are right, and no more: nothing shows the absolute offset, and all counts may be
    /// too small by the same number.
    Relative,
    /// The counts contradict each other. Most of them may be right all the same.
    Untrusted,
    /// The counts do not contradict each other, but in an image so small, of so few bits, or behind a lens so sharp a wrong count may
    /// leave no trace.
    Unobservable,
}

impl Trust {
    /// Returns the claim for tables and messages: `true` or `false`, and `None` if the method makes no claim.
    pub fn claim(self) -> Option<bool> {
        match self {
            Self::Unknown => None,
            Self::Trusted => Some(true),
            Self::Relative | Self::Untrusted | Self::Unobservable => Some(false),
        }
    }
}

/// The name for a result of `auto` in which all k are 0.
pub const PASS_THROUGH: &str = "pass_through";

/// The name for a result of `auto` of which every count is proved, but for the samples that are left out as defects: behind this lens, with this noise and from these black columns, no scene within the
/// range has these codes with other counts.
pub const PROOF: &str = "proof";

/// The name for a result of `auto` by `gradient_tree` on a smoothed modulo image.
pub const SMOOTHED_TREE: &str = "smoothed_tree";

/// The name for a result of `auto` whose largest part without a contradiction has grown over the rest.
pub const GROWTH: &str = "growth";

/// The name for a result of `auto` on a mosaic, whose gradients of green have the least sums of costs along paths.
pub const GRADIENT_SUMS: &str = "gradient_sums";

/// Measures of how far y departs from the assumptions of `lines`, over all channels; they need no ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QualityMetrics {
    /// The fraction of the 2 x 2 loops around which the wrapped differences do not sum to 0. For gradient sums, the fraction of the
    /// differences between green neighbours that contradict the counts.
    pub residues: f32,
    /// The fraction of the 2 x 2 loops whose wrapped mixed difference `|M_b(d_x d_y y)|` is above 3/8 of the peak
    /// (96 of 256).
    pub steep: f32,
    /// The fraction of the samples whose count was out of range and was clamped: they contradict the others. `auto` leaves 0 where it does
    /// without the result of `lines`.
    pub clamped: f32,
    /// The second differences of the result along rows and columns that are above one peak, per sample. Only `auto`
    /// and `lines` compute them; other methods leave 0.
    pub jumps: f32,
    /// The fraction of the samples that were left out as defects: hot, dead or stuck ones. Only `auto` looks for them; other
    /// methods leave 0.
    pub defects: f32,
}

/// The options of all methods; each method reads its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The threshold of SPUD in units of the peak, >= 0.
    pub tau: f64,
    /// The coefficients that SPUD's threshold applies to.
    pub threshold_on: ThresholdOn,
    /// The number of threads that a method may use, 1 to [`MAX_THREADS`](crate::MAX_THREADS); the result does not
    /// depend on it.
    pub threads: usize,
    /// The limits at which `auto` trusts a result.
    pub trust: TrustLimits,
    /// Whether the images are successive frames of one camera, so that `auto` may take the absolute offset of a frame that shows none
    /// from the last trusted frame.
    pub successive: bool,
}

impl Default for Options {
    /// Returns the options of the paper: tau = 0.1 on phi, and one thread, for single images.
    fn default() -> Self {
        let trust = TrustLimits::default();
        Self { tau: 0.1, threshold_on: ThresholdOn::Phi, threads: 1, trust, successive: false }
    }
}

/// Error: the image was not unwrapped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnwrapError {
    /// No method has this name.
    #[error("method {name:?} is unknown, possible are {}", METHODS.join(", "))]
    Method {
        /// The name that was asked for.
        name: String,
    },
    /// The threshold is out of range.
    #[error("tau is {tau}, a finite number of at least 0 is needed (units of the peak)")]
    Tau {
        /// The threshold.
        tau: f64,
    },
    /// The image has no pixel, or a wrong number of channels.
    #[error(transparent)]
    Shape(#[from] FrameError),
    /// The threads are not available.
    #[error(transparent)]
    Workers(#[from] WorkersError),
    /// The samples are floats, but those of a modulo image are integers.
    #[error("the codes are 32-bit floats, integers of 8 or 16 bits are needed: the sensor's modulo image")]
    Float,
    /// The samples are too narrow for the codes of the sensor.
    #[error("the codes have 8-bit samples, 16-bit samples are needed for {bits} bits")]
    Narrow {
        /// The bits of the range.
        bits: u8,
    },
    /// A sample is out of the range of the sensor's converter.
    #[error("the code at ({at}) is {value}, 0 to {most} is possible with {bits} bits")]
    Code {
        /// The position of the sample.
        at: SamplePosition,
        /// The value of the sample.
        value: f32,
        /// The largest value in range.
        most: f32,
        /// The bits of the range.
        bits: u8,
    },
}

/// Makes the method called `name`, one of [`METHODS`].
///
/// # Errors
/// [`UnwrapError::Method`] lists the names; [`UnwrapError::Tau`] for a negative or NaN threshold.
pub fn by_name(name: &str, options: &Options) -> Result<Box<dyn Unwrap>, UnwrapError> {
    name.parse::<Method>()?.build(options)
}

/// Makes the method for the gains of a sensor; `None` for a sensor with one gain, whose images any of the [`METHODS`] unwraps.
pub fn of_gains(gains: Gains) -> Option<Box<dyn Unwrap>> {
    TwoGains::new(gains).map(|method| Box::new(Judged::of_two_gains(Box::new(method))) as Box<dyn Unwrap>)
}

impl Recovered {
    /// Resizes the buffers for an image of `dim` in standard layout; old values stay until they are overwritten.
    pub(crate) fn prepare(&mut self, dim: (usize, usize, usize), method: &'static str) {
        if self.x.is_empty() {
            std::mem::swap(&mut self.x, &mut self.spare);
        }
        // The fields are public: a caller may have put in an array of another layout.
        if self.x.dim() != dim || !self.x.is_standard_layout() {
            self.x = Array3::zeros(dim);
        }
        if self.k.dim() != dim || !self.k.is_standard_layout() {
            self.k = Array3::zeros(dim);
        }
        self.defects.clear();
        self.proved.clear();
        self.near_half = None;
        self.report = Report { method, ..Report::default() };
    }

    /// Leaves x out, after [`Recovered::prepare`].
    fn leave_out(&mut self) {
        self.spare = std::mem::take(&mut self.x);
    }

    /// Computes x as `y + k * 2^b` where it was left out; `y` is the image that was unwrapped.
    ///
    /// # Panics
    /// If `y` has another shape than the result.
    pub fn fill(&mut self, y: &Frame, range: Range) {
        if !self.x.is_empty() {
            return;
        }
        assert_eq!(y.dim(), self.k.dim(), "the image that was unwrapped has the shape of its counts");
        self.x = match std::mem::take(&mut self.spare) {
            spare if spare.dim() == y.dim() => spare,
            _ => Array3::zeros(y.dim()),
        };
        let near_half = self.near_half;
        Integers::of(y, range).expect("the image was unwrapped").write_radiance(range, self);
        self.near_half = near_half;
    }

    /// Returns x and k, row-major and interleaved, after [`Recovered::prepare`].
    pub(crate) fn buffers(&mut self) -> (&mut [f32], &mut [u8]) {
        self.near_half = None;
        let (x, k) = (self.x.as_slice_mut(), self.k.as_slice_mut());
        (x.expect("prepare has made the layout standard"), k.expect("prepare has made the layout standard"))
    }
}

/// The samples of a modulo image, row-major and interleaved.
#[derive(Clone, Copy)]
pub(crate) enum Integers<'a> {
    U8(&'a [u8]),
    U16(&'a [u16]),
}

/// Evaluates an expression for the samples of [`Integers`], whatever their width.
macro_rules! of_width {
    ($integers:expr, $samples:ident => $result:expr) => {
        match $integers {
            Integers::U8($samples) => $result,
            Integers::U16($samples) => $result,
        }
    };
}
use of_width;

impl<'a> Integers<'a> {
    /// Returns the samples of `y`, of any value.
    fn of(y: &'a Frame, range: Range) -> Result<Self, UnwrapError> {
        match y.samples() {
            Samples::U8(_) if range.bits() > 8 => Err(UnwrapError::Narrow { bits: range.bits() }),
            Samples::U8(y) => Ok(Self::U8(in_order(y.view()))),
            Samples::U16(y) => Ok(Self::U16(in_order(y.view()))),
            Samples::F32(_) => Err(UnwrapError::Float),
        }
    }

    /// Returns the samples of `y`, all of which are below 2^b.
    pub(crate) fn checked(y: &'a Frame, range: Range) -> Result<Self, UnwrapError> {
        let (samples, most) = (Self::of(y, range)?, range.peak() - 1.0);
        // Integers are compared at the speed of memory, and not at all where no sample can be too large.
        let largest = match samples {
            Self::U8(_) if range.bits() == 8 => 0,
            Self::U16(_) if range.bits() == 16 => 0,
            Self::U8(y) => widest!(y.iter().fold(0, |largest, &y| y.max(largest))).into(),
            Self::U16(y) => widest!(y.iter().fold(0, |largest, &y| y.max(largest))),
        };
        if f32::from(largest) > most {
            of_width!(samples, codes => check_codes(codes, y.dim(), range, most)?);
        }
        Ok(samples)
    }

    /// Returns the sample at `index`.
    fn at(self, index: usize) -> u16 {
        match self {
            Self::U8(samples) => samples[index].into(),
            Self::U16(samples) => samples[index],
        }
    }

    /// Writes all samples to `words`.
    fn widen(self, words: &mut Vec<u16>) {
        words.clear();
        match self {
            Self::U8(samples) => words.extend(samples.iter().map(|&code| u16::from(code))),
            Self::U16(samples) => words.extend_from_slice(samples),
        }
    }

    /// Writes the radiance of `out` from its counts.
    fn write_radiance(self, range: Range, out: &mut Recovered) {
        of_width!(self, y => write_radiance(y, range, out));
    }

    /// Copies one of `channels` into `plane`, row-major.
    fn take(self, channels: usize, channel: usize, plane: &mut Vec<f32>) {
        of_width!(self, samples => copy_channel(samples, channels, channel, plane));
    }
}

fn write_radiance<T: Copy + Into<f32>>(y: &[T], range: Range, out: &mut Recovered) {
    let (x, k) = out.buffers();
    let samples = x.iter_mut().zip(y).zip(&*k);
    widest!(samples.for_each(|((x, &y), &k)| *x = y.into() + f32::from(k) * range.peak()));
}

/// Returns an error for samples (of an image of shape `dim`) outside `[0, most]` or NaN.
fn check_codes<T>(y: &[T], dim: (usize, usize, usize), range: Range, most: f32) -> Result<(), UnwrapError>
where
    T: Copy + Into<f32>,
{
    let wrong = |&&value: &&T| !(0.0..=most).contains(&value.into());
    // Counting has no early way out and so runs at the speed of memory.
    if y.iter().filter(wrong).count() == 0 {
        return Ok(());
    }
    let (index, &value) = y.iter().enumerate().find(|(_, value)| wrong(value)).expect("one was counted");
    Err(UnwrapError::Code { at: position_of(index, dim), value: value.into(), most, bits: range.bits() })
}

#[cfg(test)]
mod tests {
    use super::{Report, Trust};

    #[test]
    fn only_a_claim_that_is_refused_has_a_reason() {
        let reason = |trust, is_over_budget| Report { trust, is_over_budget, ..Report::default() }.reason();
        assert_eq!(reason(Trust::Unknown, false), None);
        assert_eq!(reason(Trust::Trusted, false), None);
        assert_eq!(reason(Trust::Relative, false), Some("the absolute level is unknown: no dark reference"));
        assert_eq!(reason(Trust::Untrusted, false), Some("the wrap counts contradict each other"));
        assert!(reason(Trust::Unobservable, false).is_some_and(|why| why.contains("may leave no trace")));
        assert!(
            reason(Trust::Untrusted, true)
                .is_some_and(|why| why.ends_with("the work limit ended the search for better ones"))
        );
    }
}
