//! A fixed map of the defects of a sensor: hot, dead and stuck samples that are known from a file or from earlier frames.
//!
//! Before an image is unwrapped, by whatever method, each of them gets the code between its nearest sound neighbours of the same colour and
//! gain. Afterwards it gets its own code back, with the count that brings it nearest to what was found in its place. So it takes part in
//! no vote, tree or quality metric.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use super::{Integers, Range, Recovered, Unwrap, UnwrapError};
use crate::frame::{Frame, Samples};
use crate::gains::Gains;

/// The number of frames after which the samples that were found as defects in them are counted.
const WINDOW: u8 = 30;

/// A sample that was found in this many of the [`WINDOW`] frames belongs to the map.
const NEEDED: u8 = 20;

/// The number of neighbours to each side among which a sound one is looked for.
const REACH: usize = 4;

/// The columns of a file.
const COLUMNS: &str = "x,y,channel";

/// The known defects of a sensor.
///
/// Its text form is CSV: the columns x (px to the right), y (px down) and channel (0 to 2), each from 0. A line without a channel stands for all
/// channels of the pixel. A line `# size WIDTHxHEIGHTxCHANNELS` tells the size of the images; other text behind `#` is a comment.
///
/// ```
/// use modulo_core::unwrap::DefectMap;
///
/// let map: DefectMap = "# size 1242x375x3\nx,y,channel\n17,4,0\n18,4\n".parse()?;
/// assert_eq!(map.to_string(), "# size 1242x375x3\nx,y,channel\n17,4,0\n18,4,0\n18,4,1\n18,4,2\n");
/// assert!("17;4".parse::<DefectMap>().is_err());
/// # Ok::<(), modulo_core::unwrap::DefectMapError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DefectMap {
    /// The lines of the file.
    listed: Vec<Listed>,
    /// Height, width and channels of the images, as far as they are known.
    size: Option<(usize, usize, usize)>,
    /// The indices of the defects in the interleaved samples, in ascending order.
    samples: Vec<usize>,
    /// The samples that were found in the frames of this window, with the number of frames. One that is first found when too few frames
    /// are left is not counted, which bounds it.
    counts: BTreeMap<usize, u8>,
    frames: u8,
    /// The image without defects.
    sound: Option<Frame>,
}

/// A line of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Listed {
    line: usize,
    x: usize,
    y: usize,
    channel: Option<usize>,
}

/// Error: a map of defects cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DefectMapError {
    /// A line has another form.
    #[error(
        "line {line} is '{text}', must be 'x,y' or 'x,y,channel' in whole numbers from 0, such as 17,4 or 17,4,0"
    )]
    Line {
        /// The number of the line, from 1.
        line: usize,
        /// The line.
        text: String,
    },
    /// The line of the size has another form.
    #[error(
        "line {line} has the size '{text}', must be WIDTHxHEIGHTxCHANNELS (sides of 1 to 65536 px, 1 to 3 channels), such as 1242x375x3"
    )]
    SizeLine {
        /// The number of the line, from 1.
        line: usize,
        /// The size.
        text: String,
    },
    /// A defect lies outside the image.
    #[error(
        "line {line} has the {what} {value}, but an image of {size} has {what} 0 to {most} only; use the map of this camera"
    )]
    Outside {
        /// The number of the line, from 1.
        line: usize,
        /// `x`, `y` or `channel`.
        what: &'static str,
        /// The value.
        value: usize,
        /// The size of the images.
        size: String,
        /// The largest possible value.
        most: usize,
    },
    /// The map belongs to images of another size.
    #[error(
        "the map is for images of {map} (width x height x channels), and this one has {image}; use the map of this camera"
    )]
    Size {
        /// The size in the map.
        map: String,
        /// The size of the image.
        image: String,
    },
}

impl FromStr for DefectMap {
    type Err = DefectMapError;

    fn from_str(text: &str) -> Result<Self, DefectMapError> {
        let (mut map, mut size) = (Self::default(), None);
        for (line, text) in (1..).zip(text.lines()) {
            let (entry, comment) = text.split_once('#').unwrap_or((text, ""));
            if let Some(text) = comment.trim().strip_prefix("size ") {
                size = Some(parse_size(text.trim(), line)?);
            }
            let entry = entry.trim();
            if entry.is_empty() || (map.listed.is_empty() && ["x,y", COLUMNS].contains(&entry)) {
                continue;
            }
            let numbers = entry.split(',').map(|number| number.trim().parse().ok());
            let numbers: Option<Vec<usize>> = numbers.collect();
            let (x, y, channel) = match numbers.as_deref() {
                Some(&[x, y]) => (x, y, None),
                Some(&[x, y, channel]) => (x, y, Some(channel)),
                _ => return Err(DefectMapError::Line { line, text: entry.to_owned() }),
            };
            map.listed.push(Listed { line, x, y, channel });
        }
        if let Some(size) = size {
            map.fit(size)?;
        }
        Ok(map)
    }
}

/// Writes the text form, with a line for each channel of a defect. Before the size is known, these are the lines of the file.
impl fmt::Display for DefectMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(size @ (_, width, channels)) = self.size else {
            writeln!(f, "{COLUMNS}")?;
            return self.listed.iter().try_for_each(|Listed { x, y, channel, .. }| match channel {
                None => writeln!(f, "{x},{y}"),
                Some(channel) => writeln!(f, "{x},{y},{channel}"),
            });
        };
        writeln!(f, "# size {}\n{COLUMNS}", text_of(size))?;
        self.samples.iter().try_for_each(|at| {
            let (pixel, channel) = (at / channels, at % channels);
            writeln!(f, "{},{},{channel}", pixel % width, pixel / width)
        })
    }
}

impl DefectMap {
    /// Returns the number of known defects, in samples; before the first frame of a map without a size, that of the lines of its file.
    pub fn len(&self) -> usize {
        if self.size.is_some() { self.samples.len() } else { self.listed.len() }
    }

    /// Returns whether no defect is known.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns height, width and channels of the images, once they are known.
    pub fn size(&self) -> Option<(usize, usize, usize)> {
        self.size
    }

    /// Prepares the map for images of height x width x channels. What was learned from images of another size is forgotten.
    ///
    /// # Errors
    /// [`DefectMapError::Size`] and [`DefectMapError::Outside`] for a map that was read for another size.
    pub fn fit(&mut self, size: (usize, usize, usize)) -> Result<(), DefectMapError> {
        if self.size == Some(size) {
            return Ok(());
        }
        if let Some(known) = self.size.filter(|_| !self.listed.is_empty()) {
            return Err(DefectMapError::Size { map: text_of(known), image: text_of(size) });
        }
        let (height, width, channels) = size;
        let mut samples = Vec::new();
        for &Listed { line, x, y, channel } in &self.listed {
            let bounds = [("x", x, width), ("y", y, height), ("channel", channel.unwrap_or(0), channels)];
            if let Some((what, value, count)) = bounds.into_iter().find(|(_, value, count)| value >= count) {
                let (size, most) = (text_of(size), count.saturating_sub(1));
                return Err(DefectMapError::Outside { line, what, value, size, most });
            }
            let channels_of = channel.map_or(0..channels, |channel| channel..channel + 1);
            samples.extend(channels_of.map(|channel| (y * width + x) * channels + channel));
        }
        samples.sort_unstable();
        samples.dedup();
        (self.samples, self.size) = (samples, Some(size));
        (self.frames, self.sound) = (0, None);
        self.counts.clear();
        Ok(())
    }

    /// Unwraps `y` by `method` without the known defects, which get the count that is nearest to what was found in their place, and learns
    /// those that the method finds in most frames. `gains` are those of the pixels.
    ///
    /// # Errors
    /// Those of `method`.
    ///
    /// # Panics
    /// If [`DefectMap::fit`] was not called for the size of `y`.
    pub fn unwrap(
        &mut self,
        method: &mut dyn Unwrap,
        y: &Frame,
        range: Range,
        gains: Gains,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        assert_eq!(self.size, Some(y.dim()), "the map was not prepared for this size");
        if self.samples.is_empty() {
            method.unwrap(y, range, out)?;
        } else {
            let codes = Integers::checked(y, range)?;
            self.replace(y, codes, range, gains);
            let sound = self.sound.as_ref().expect("it was made just now");
            method.unwrap(sound, range, out)?;
            self.restore(y, codes, range, gains, out);
        }
        self.learn(&out.defects);
        self.tell(out);
        Ok(())
    }

    /// Copies `y` and writes the codes between the neighbours to the places of the defects.
    fn replace(&mut self, y: &Frame, codes: Integers<'_>, range: Range, gains: Gains) {
        let mut sound = self.sound.take().unwrap_or_else(|| y.clone());
        sound.copy_from(y);
        let between = |&at: &usize| (at, self.between(codes, at, period(y, gains), range));
        let replaced = self.samples.iter().map(between);
        match sound.samples_mut() {
            Samples::U8(samples) => {
                let samples = samples.as_slice_mut().expect("the samples of a frame are in standard layout");
                replaced.for_each(|(at, code)| samples[at] = code as u8);
            }
            Samples::U16(samples) => {
                let samples = samples.as_slice_mut().expect("the samples of a frame are in standard layout");
                replaced.for_each(|(at, code)| samples[at] = code);
            }
            Samples::F32(_) => unreachable!("the codes of a modulo image are integers"),
        }
        self.sound = Some(sound);
    }

    /// Returns the code between the nearest sound neighbours in the row or in the column, whichever differ less; that of a single one beside a
    /// border, and that of the sample itself if there is none. Pixels of the same colour and gain are `period` apart.
    fn between(&self, codes: Integers<'_>, at: usize, period: usize, range: Range) -> u16 {
        let (height, width, channels) = self.size.expect("the size was checked");
        let (row, column) = (at / channels / width, at / channels % width);
        let sound = |steps: usize, distance: usize, back: bool| {
            let places = (1..=REACH).take_while(|n| n * period <= steps);
            let mut places = places.map(|n| n * period * distance * channels);
            places.find_map(|far| {
                let place = if back { at - far } else { at + far };
                self.samples.binary_search(&place).is_err().then(|| i32::from(codes.at(place)))
            })
        };
        let peak = 1 << range.bits();
        let pairs = [
            [sound(column, 1, true), sound(width - 1 - column, 1, false)],
            [sound(row, width, true), sound(height - 1 - row, width, false)],
        ];
        let means = pairs.map(|[a, b]| match (a, b) {
            (Some(a), Some(b)) => {
                let difference = ((b - a + peak / 2) & (peak - 1)) - peak / 2;
                (difference.abs(), Some(a + difference / 2))
            }
            // Half of what two neighbours can differ by at most.
            (a, b) => (peak / 4, a.or(b)),
        });
        let known = means.into_iter().filter_map(|(difference, mean)| Some((difference, mean?)));
        let mean = known.min_by_key(|(difference, _)| *difference).map(|(_, mean)| mean);
        (mean.unwrap_or_else(|| codes.at(at).into()) & (peak - 1)) as u16
    }

    /// Gives the defects their own codes back.
    fn restore(&self, y: &Frame, codes: Integers<'_>, range: Range, gains: Gains, out: &mut Recovered) {
        let (_, width, channels) = y.dim();
        let (x, k) = out.buffers();
        for &at in &self.samples {
            let (row, column) = (at / channels / width, at / channels % width);
            let gain = gains.behind(y.mosaic(), row, column) as f32;
            let code = f32::from(codes.at(at));
            (x[at], k[at]) = if gain < 1.0 {
                (((code + 0.5) / gain - 0.5).min((range.limit() as f32).next_down()), 0)
            } else {
                range.nearest(code, x[at])
            };
        }
    }

    /// Adds the known defects to those that the method has found.
    fn tell(&self, out: &mut Recovered) {
        if self.samples.is_empty() {
            return;
        }
        out.defects.extend(&self.samples);
        out.defects.sort_unstable();
        out.defects.dedup();
        if let Some(quality) = &mut out.report.quality {
            quality.defects = out.defects.len() as f32 / out.x.len() as f32;
        }
    }

    /// Counts the samples that were found in one frame.
    fn learn(&mut self, found: &[usize]) {
        for &at in found {
            if self.frames <= WINDOW - NEEDED {
                *self.counts.entry(at).or_default() += 1;
            } else if let Some(count) = self.counts.get_mut(&at) {
                *count += 1;
            }
        }
        self.frames += 1;
        if self.frames == WINDOW {
            let often = self.counts.iter().filter(|(_, count)| **count >= NEEDED);
            self.samples.extend(often.map(|(at, _)| at));
            self.samples.sort_unstable();
            self.samples.dedup();
            self.counts.clear();
            self.frames = 0;
        }
    }
}

/// Returns the distance of pixels of the same colour and gain.
fn period(y: &Frame, gains: Gains) -> usize {
    let colours = if y.mosaic().is_some() { 2 } else { 1 };
    match gains {
        Gains::One => colours,
        Gains::Checkerboard { .. } => 2 * colours,
    }
}

/// Returns a size as a file has it.
fn text_of((height, width, channels): (usize, usize, usize)) -> String {
    format!("{width}x{height}x{channels}")
}

/// Parses a size of a file.
fn parse_size(text: &str, line: usize) -> Result<(usize, usize, usize), DefectMapError> {
    let numbers: Option<Vec<usize>> = text.split('x').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        // No image is larger, and the number of its samples has no overflow.
        Some(&[width, height, channels])
            if [width, height].iter().all(|side| (1..=65536).contains(side))
                && (1..=3).contains(&channels) =>
        {
            Ok((height, width, channels))
        }
        _ => Err(DefectMapError::SizeLine { line, text: text.to_owned() }),
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::unwrap::{METHODS, Method, Options, Trust, of_gains};
    use crate::{Exposure, Mosaic, Sensor, SensorConfig};

    const DIM: (usize, usize, usize) = (60, 80, 3);

    /// A smooth scene.
    fn exposure(config: SensorConfig) -> Exposure {
        let radiance = Array3::from_shape_fn(DIM, |(i, j, c)| {
            0.5 + 0.49 * ((i as f32 / 17.0).sin() * (j as f32 / 23.0 + c as f32 / 9.0).cos())
        });
        Sensor::new(SensorConfig { alpha: 2.0, ..config }).unwrap().expose(radiance.view(), 0).unwrap()
    }

    /// Unwraps an image with `code` at some places by one method, with the map of these places. Returns the result, and whether all
    /// other counts are exact.
    fn recover(
        exposure: &Exposure,
        method: &mut dyn Unwrap,
        gains: Gains,
        places: &[(usize, usize)],
        code: u8,
    ) -> (Recovered, bool) {
        let sound = exposure.modulo();
        let mut codes = sound.as_u8().unwrap().clone();
        let lines: String = places.iter().map(|(x, y)| format!("{x},{y}\n")).collect();
        let is_defect = |(i, j, _)| places.contains(&(j, i));
        codes.indexed_iter_mut().filter(|(at, _)| is_defect(*at)).for_each(|(_, to)| *to = code);
        let mut y = Frame::from_u8(codes.clone()).unwrap();
        if let Some(mosaic) = sound.mosaic() {
            y = y.with_mosaic(mosaic).unwrap();
        }
        let (mut map, mut out): (DefectMap, _) = (lines.parse().unwrap(), Recovered::default());
        map.fit(y.dim()).unwrap();
        map.unwrap(method, &y, exposure.range(), gains, &mut out).unwrap();
        assert_eq!(out.defects.len(), map.len());
        let truth = exposure.wraps();
        let exact = out.k.indexed_iter().all(|(at, k)| is_defect(at) || *k == truth[at]);
        for (at, code) in codes.indexed_iter().filter(|(at, _)| is_defect(*at)) {
            let expected = if gains.at(at.0, at.1) < 1.0 {
                2.0 * f32::from(*code) + 0.5
            } else {
                f32::from(*code) + 256.0 * f32::from(out.k[at])
            };
            assert_eq!(out.x[at], expected.min(512f32.next_down()), "a defect keeps its code");
        }
        (out, exact)
    }

    /// A pair of hot columns, a corner, the border, and a block.
    fn places() -> Vec<(usize, usize)> {
        let columns = (0..DIM.0).flat_map(|row| [(30, row), (31, row)]);
        columns.chain([(0, 0), (79, 59), (79, 20), (12, 0), (50, 40), (51, 40), (50, 41), (51, 41)]).collect()
    }

    #[test]
    fn known_defects_of_any_kind_change_no_other_count_and_no_trust() {
        for mosaic in [None, Some(Mosaic::Rggb)] {
            let exposure = exposure(SensorConfig { mosaic, ..SensorConfig::default() });
            for code in [0, 255] {
                let mut auto = Method::Auto.build(&Options::default()).unwrap();
                let (out, exact) = recover(&exposure, auto.as_mut(), Gains::One, &places(), code);
                assert!(exact, "{mosaic:?}, stuck at {code}: {:?}", out.report);
                assert_eq!(out.report.trust, Trust::Trusted, "{mosaic:?}, stuck at {code}: {:?}", out.report);
                assert!(out.report.quality.unwrap().defects > 0.01);
            }
        }
    }

    #[test]
    fn every_method_leaves_known_defects_out() {
        let exposure = exposure(SensorConfig::default());
        for name in METHODS {
            let mut method = name.parse::<Method>().unwrap().build(&Options::default()).unwrap();
            let (_, without) = recover(&exposure, method.as_mut(), Gains::One, &[], 0);
            let (_, exact) = recover(&exposure, method.as_mut(), Gains::One, &places(), 255);
            assert!(exact || !without, "{name}");
        }
    }

    #[test]
    fn known_defects_of_two_gains_change_no_count_beside_them() {
        {
            let gains = Gains::checkerboard(2.0);
            let exposure = exposure(SensorConfig { gains, ..SensorConfig::default() });
            let mut method = of_gains(gains).unwrap();
            let (out, exact) = recover(&exposure, method.as_mut(), gains, &places(), 255);
            assert!(exact && out.report.trust == Trust::Trusted, "{:?}", out.report);
        }
    }

    /// Whether a frame shows a defect.
    type Shown = fn(usize) -> bool;

    /// A method that finds one defect in the frames of `shown`.
    struct Finds {
        shown: Shown,
        frame: usize,
    }

    impl Unwrap for Finds {
        fn name(&self) -> &'static str {
            "finds"
        }

        fn unwrap(&mut self, y: &Frame, _: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
            out.prepare(y.dim(), "finds");
            out.defects.extend((self.shown)(self.frame).then_some(7));
            self.frame += 1;
            Ok(())
        }
    }

    #[test]
    fn a_sample_that_is_found_in_most_frames_is_learned() {
        let exposure = exposure(SensorConfig::default());
        let (y, range) = (exposure.modulo(), exposure.range());
        let cases = [
            ((|_| true) as Shown, 1),
            (|n| n >= 10, 1),
            (|n| n > 10, 0),
            (|n| n % 3 == 0, 0),
            (|n| n % 3 > 0, 1),
        ];
        for (case, (shown, learned)) in cases.into_iter().enumerate() {
            let (mut map, mut method) = (DefectMap::default(), Finds { shown, frame: 0 });
            map.fit(y.dim()).unwrap();
            for _ in 0..30 {
                assert!(map.is_empty(), "case {case}");
                map.unwrap(&mut method, &y, range, Gains::One, &mut Recovered::default()).unwrap();
            }
            assert_eq!((map.len(), map.counts.len()), (learned, 0), "case {case}");
            let text = map.to_string();
            assert_eq!(text.contains("\n2,0,1\n"), learned == 1, "{text}");
            assert_eq!(text.parse::<DefectMap>().unwrap().samples, map.samples);
            // Another camera has other defects.
            map.fit((3, 3, 3)).unwrap();
            assert!(map.is_empty());
        }
    }

    #[test]
    fn a_wrong_file_is_refused_with_its_line_its_value_and_a_remedy() {
        let cases = [
            ("x,y\n1,2\n1;3\n", "line 3 is '1;3', must be 'x,y' or 'x,y,channel'"),
            ("1,2,3,4", "line 1 is '1,2,3,4'"),
            ("-1,2", "line 1 is '-1,2'"),
            ("1,2\nx,y", "line 2 is 'x,y'"),
            ("# size 12x\n", "line 1 has the size '12x', must be WIDTHxHEIGHTxCHANNELS"),
            ("# size 99999999999x99999999999x3", "line 1 has the size"),
            ("# size 0x4x3", "line 1 has the size"),
            ("# size 80x60x3\n\n80,4", "line 3 has the x 80, but an image of 80x60x3 has x 0 to 79 only"),
            ("# size 80x60x3\n4,60", "line 2 has the y 60"),
            ("# size 80x60x1\n4,5,1", "line 2 has the channel 1"),
        ];
        for (text, why) in cases {
            let said = text.parse::<DefectMap>().expect_err(text).to_string();
            assert!(said.contains(why), "{text:?}: {said}");
        }
        let mut map: DefectMap = "# of March\n x,y # px\n 5, 6 \n".parse().unwrap();
        assert_eq!((map.len(), map.to_string().as_str()), (1, "x,y,channel\n5,6\n"));
        map.fit((60, 80, 3)).unwrap();
        assert_eq!(map.len(), 3);
        let said = map.fit((61, 80, 3)).expect_err("another size").to_string();
        assert!(said.contains("80x60x3") && said.contains("80x61x3"), "{said}");
    }
}
