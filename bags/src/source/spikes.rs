//! [`open`]: the readings of a spike camera as counts of resets.
//!
//! A pixel of such a camera resets whenever enough light has come, and each reading tells whether it has. The low bits of the number of its
//! resets within a window are the code of a modulo sensor.

use std::borrow::Cow;
use std::path::Path;

use modulo_images::has_extension;
use modulo_runtime::sensor::parameters::BlurShape;
use modulo_runtime::{SensorModel, input};
use ndarray::Array3;

use super::npz::{MOST, array};
use super::{ReadFrames, Source, SourceError, SourceFrame, SourceOptions};
use crate::FileError;

/// The remedy for an archive without an array of readings, T x H x W of 0 or 1.
const SAVE: &str =
    "copy it again, or save it by numpy.savez_compressed(FILE, spk=readings.astype('uint8', order='C'))";
/// The most readings of a frame: more resets have no exact place in `f32`.
const LONGEST: usize = 65535;

/// The frames of a spike recording: each is the sum of a window of readings.
struct SpikeFrames {
    readings: Vec<u8>,
    shape: [usize; 3],
    window: usize,
    next: usize,
    /// Full scale in resets.
    full: f32,
}

/// Splits the address `PATH.npz?window=N` of a spike recording into the path and the option; `None` for any other source.
pub(super) fn split(spec: &str) -> Option<(&Path, &str)> {
    let (path, window) = spec.rsplit_once('?').filter(|_| !Path::new(spec).exists()).unwrap_or((spec, ""));
    (!spec.contains("://") && has_extension(Path::new(path), &["npz"])).then_some((Path::new(path), window))
}

/// Opens the recording at `path`; `window` is the option of its address. Of `options`, only the white is used.
pub(super) fn open(path: &Path, window: &str, options: &SourceOptions) -> Result<Source, SourceError> {
    let file = input::read_bytes(path, MOST).map_err(|why| FileError::new(path, why))?;
    let refuse = |why: String| SourceError::of(path, &why);
    let (shape, readings) = array(&file, "spk").map_err(|why| refuse(format!("{why}; {SAVE}")))?;
    if let Some(at) = readings.iter().position(|value| *value > 1) {
        let why = format!("value {at} of spk is {}, but 0 and 1 are possible; {SAVE}", readings[at]);
        return Err(refuse(why));
    }
    let (count, most) = (shape[0], shape[0].min(LONGEST));
    let window = window.strip_prefix("window=").and_then(|number| number.parse().ok());
    let Some(window) = window.filter(|window| (1..=most).contains(window)) else {
        let why = format!("has {count} readings; give the number that a frame sums, 1 to {most}");
        return Err(refuse(format!("{why}, as in {}?window={most}", path.display())));
    };
    let mut frames = SpikeFrames { readings, shape, window, next: 0, full: options.coding.white };
    let most = std::iter::from_fn(|| frames.sum()).flatten().max().unwrap_or_default() as f32;
    (frames.next, frames.full) = (0, if frames.full > 0.0 { frames.full } else { most + 1.0 });
    if most + 0.5 >= frames.full {
        let white = frames.full;
        return Err(refuse(format!("has {most} resets in a frame, but white is {white}; give more, or 0")));
    }
    let line = format!("the last {} of {count} readings fill no window and are left out", count % window);
    let warnings = Some(line).filter(|_| count % window > 0).into_iter().collect();
    Ok(Source { len: Some(count / window), warnings, ..Source::over(frames) })
}

impl SpikeFrames {
    /// Returns the resets of the pixels in the next window.
    fn sum(&mut self) -> Option<Vec<u16>> {
        let pixels = self.shape[1] * self.shape[2];
        let window = self.readings.chunks_exact(pixels * self.window).nth(self.next)?;
        self.next += 1;
        let mut sums = vec![0; pixels];
        for reading in window.chunks_exact(pixels) {
            sums.iter_mut().zip(reading).for_each(|(sum, value)| *sum += u16::from(*value));
        }
        Some(sums)
    }
}

impl ReadFrames for SpikeFrames {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        let (name, [_, height, width], full) = (format!("{:06}", self.next), self.shape, Some(self.full));
        // A pixel with n resets has got light for n to n + 1 of them.
        let shares = self.sum()?.into_iter().map(|resets| (f32::from(resets) + 0.5) / self.full).collect();
        let radiance = Array3::from_shape_vec((height, width, 1), shares).expect("a reading has this shape");
        Some(Ok(SourceFrame { full_resets: full, ..SourceFrame::new(name, radiance) }))
    }

    fn rewind(&mut self) {
        self.next = 0;
    }
}

impl SourceFrame {
    /// Returns the radiance of this frame for a sensor. Resets that a real sensor has counted become x whatever `alpha` and `headroom` are, so that
    /// the codes are the low bits of what was counted.
    ///
    /// # Errors
    /// [`SourceError::Unreadable`] with the reason why this sensor cannot have these counts.
    pub fn radiance_for(&self, sensor: &SensorModel) -> Result<Cow<'_, Array3<f32>>, SourceError> {
        let Some(full) = self.full_resets else { return Ok(Cow::Borrowed(&self.radiance)) };
        let x = self.radiance.mapv(|share| share * full);
        let end = (sensor.headroom * sensor.alpha * f64::from(sensor.bits).exp2()) as f32;
        let why = if sensor.psf != BlurShape::Unknown || sensor.optical_black > 0 {
            "counted resets have their own lens; set psf to unknown and optical_black to 0".to_owned()
        } else if let Some(((row, column, _), resets)) = x.indexed_iter().find(|(_, x)| **x >= end) {
            let at = format!("{} resets at row {row}, column {column}", resets.floor());
            format!("{at} are not below headroom * alpha * 2^bits, {end}; set a larger alpha")
        } else {
            return Ok(Cow::Owned(x / end));
        };
        Err(SourceError::Unreadable(why))
    }
}
