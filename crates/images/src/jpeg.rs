//! [`check`]: whether a JPEG is whole, up to the last bit of its compressed data.
//!
//! A decoder fills what is missing with grey, and goes on with wrong pixels behind a break. Here each code is followed: damage
//! shifts the codes behind it, so that a scan has too few or too many of them, or one that does not exist. JPEG has no checksum:
//! damage that gives as many other codes is not found. Source: ITU-T T.81, Annexes B, F and G.

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

/// The result of a step; the error is what is wrong with the file.
type Step<T> = Result<T, &'static str>;

const TRUNCATED: &str = "it is truncated: its end marker is missing";
const HEADER: &str = "a segment of its header is not readable";
const EARLY: &str = "its compressed data end early";
const LATE: &str = "compressed data are left over";
const NO_CODE: &str = "its compressed data hold a code that does not exist";
const RESTART: &str = "a restart marker is missing";
const NO_SCAN: &str = "a scan is missing";

/// The most bits of a difference of DC; the other coefficients have fewer.
const MOST_BITS: u32 = 11;
/// A picture has fewer scans; the decoder refuses more.
const MOST_SCANS: u32 = 100;
/// The decoder refuses larger pictures.
const MOST_PIXELS: usize = (1 << 29) / 3;

/// Checks a JPEG from its start marker to its end marker. What the decoder refuses is not checked.
///
/// # Errors
/// A text that says which compressed data are missing, broken or left over, with the remedy.
pub(crate) fn check(bytes: &[u8]) -> Result<(), String> {
    follow(bytes).map_err(|why| format!("this JPEG is damaged: {why}; copy or record the file again"))
}

fn follow(bytes: &[u8]) -> Step<()> {
    let mut picture = Picture::default();
    let (mut place, mut scans) = (2, 0);
    loop {
        let marker = next_marker(bytes, place).ok_or(TRUNCATED)?;
        place = marker.1;
        match marker.0 {
            // Behind the end marker cameras write other data. A thumbnail within a segment has an end marker of its own.
            0xd9 => return picture.check_scans(),
            // These markers have no segment.
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let rest = bytes.get(place..).unwrap_or_default();
        let length = rest.first_chunk().map(|length| usize::from(u16::from_be_bytes(*length)));
        let length = length.filter(|length| *length <= rest.len()).ok_or(TRUNCATED)?;
        let segment = rest.get(2..length).ok_or(HEADER)?;
        place += length;
        match marker.0 {
            0xc4 => picture.read_tables(segment).ok_or(HEADER)?,
            0xc0..=0xc2 => picture.read_frame(segment, marker.0 == 0xc2).ok_or(HEADER)?,
            // Lossless and arithmetic coding.
            0xc3 | 0xc5..=0xcf => return Ok(()),
            0xdd => picture.interval = u16::from_be_bytes(*segment.first_chunk().ok_or(HEADER)?).into(),
            0xda if scans == MOST_SCANS => return Ok(()),
            0xda => {
                scans += 1;
                if picture.tables.iter().all(Option::is_none) {
                    picture.read_tables(&standard_tables()).ok_or(HEADER)?;
                }
                place += picture.follow_scan(segment, &bytes[place..])?;
            }
            _ => {}
        }
    }
}

/// Returns the tables of Annex K, which Motion JPEG leaves out and the encoder writes.
fn standard_tables() -> Vec<u8> {
    let (mut file, mut tables, mut place) = (Vec::new(), Vec::new(), 2);
    let written = JpegEncoder::new(&mut file).encode(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
    written.expect("a vector takes all bytes");
    while let Some((marker, segment)) = next_marker(&file, place).filter(|(marker, _)| *marker != 0xda) {
        let length = usize::from(u16::from_be_bytes([file[segment], file[segment + 1]]));
        place = segment + length;
        if marker == 0xc4 {
            tables.extend(&file[segment + 2..place]);
        }
    }
    tables
}

/// Returns the next marker from `place` on, and the place behind it.
fn next_marker(bytes: &[u8], place: usize) -> Option<(u8, usize)> {
    // In compressed data, FF 00 is a byte FF; FF FF is padding.
    let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff);
    let at = place + bytes.get(place..)?.windows(2).position(is_marker)?;
    Some((bytes[at + 1], at + 2))
}

/// The tables and the layout of the picture, as its segments describe them.
#[derive(Default)]
struct Picture {
    /// Tables of DC (the first four) and of AC.
    tables: [Option<Huffman>; 8],
    components: Vec<Component>,
    is_progressive: bool,
    /// Blocks of 8 x 8 px across and down in each unit that holds all components.
    unit: (usize, usize),
    /// Width and height in px.
    sides: (usize, usize),
    /// Units between two restart markers; 0 without them.
    interval: usize,
}

struct Component {
    id: u8,
    /// Its blocks across and down in a unit.
    sampling: (usize, usize),
    /// Blocks in a row of units.
    stride: usize,
    /// The coefficients of each block that are not 0 so far, as bits; in a progressive picture.
    known: Vec<u64>,
    /// The coefficients that have come with their last bit.
    done: u64,
}

/// A component within a scan.
struct Part {
    component: usize,
    dc: usize,
    ac: usize,
}

/// The coefficients of a scan, from `first` to `last`, and what of them.
struct Band {
    first: u32,
    last: u32,
    /// Whether the scan adds one more bit to them.
    refines: bool,
    low: u32,
}

impl Picture {
    /// Checks that all coefficients of all components have come.
    fn check_scans(&self) -> Step<()> {
        let is_done = !self.components.is_empty() && self.components.iter().all(|c| c.done == u64::MAX);
        is_done.then_some(()).ok_or(NO_SCAN)
    }

    /// Reads a segment of Huffman tables; `None` when it is none.
    fn read_tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let [head, rest @ ..] = segment {
            let counts: &[u8; 16] = rest.first_chunk()?;
            let count = counts.iter().map(|&count| usize::from(count)).sum();
            let values = rest.get(16..)?.get(..count)?;
            let place = usize::from(head >> 4) * 4 + usize::from(head & 15);
            *self.tables.get_mut(place)? = Some(Huffman::new(counts, values)?);
            segment = &rest[16 + count..];
        }
        Some(())
    }

    /// Reads the segment of a frame; `None` when it is none.
    fn read_frame(&mut self, segment: &[u8], is_progressive: bool) -> Option<()> {
        let [_, h0, h1, w0, w1, count, rows @ ..] = segment else { return None };
        let side = |high: &u8, low: &u8| usize::from(u16::from_be_bytes([*high, *low]));
        let (width, height) = (side(w0, w1), side(h0, h1));
        let rows = rows.as_chunks::<3>().0;
        let sampling = |row: &[u8; 3]| (usize::from(row[1] >> 4), usize::from(row[1] & 15));
        let is_known = rows.len() == usize::from(*count) && self.components.is_empty();
        if !is_known
            || rows.iter().any(|row| !matches!(sampling(row), (1..=4, 1..=4)))
            || width * height > MOST_PIXELS
        {
            return None;
        }
        let unit =
            (rows.iter().map(|row| sampling(row).0).max()?, rows.iter().map(|row| sampling(row).1).max()?);
        (self.is_progressive, self.sides, self.unit) = (is_progressive, (width, height), unit);
        let (across, down) = self.units();
        self.components = rows
            .iter()
            .map(|row| {
                let sampling = sampling(row);
                let stride = across * sampling.0;
                let blocks = if is_progressive { stride * down * sampling.1 } else { 0 };
                Component { id: row[0], sampling, stride, known: vec![0; blocks], done: 0 }
            })
            .collect();
        Some(())
    }

    /// Returns the number of units across and down.
    fn units(&self) -> (usize, usize) {
        (self.sides.0.div_ceil(8 * self.unit.0), self.sides.1.div_ceil(8 * self.unit.1))
    }

    /// Reads the header of a scan; `None` when it is none of this picture.
    fn read_scan(&self, segment: &[u8]) -> Option<(Vec<Part>, Band)> {
        let [count, rest @ ..] = segment else { return None };
        let (rows, band) = rest.split_at_checked(2 * usize::from(*count))?;
        let part = |row: &[u8; 2]| {
            let component = self.components.iter().position(|component| component.id == row[0])?;
            let table = |number: u8| Some(usize::from(number)).filter(|number| *number < 4);
            Some(Part { component, dc: table(row[1] >> 4)?, ac: 4 + table(row[1] & 15)? })
        };
        let parts: Vec<Part> = rows.as_chunks().0.iter().map(part).collect::<Option<_>>()?;
        let [first, last, bits, ..] = *band else { return None };
        let band = match self.is_progressive {
            true => Band {
                first: first.into(),
                last: last.into(),
                refines: bits >> 4 > 0,
                low: (bits & 15).into(),
            },
            false => Band { first: 0, last: 63, refines: false, low: 0 },
        };
        let is_possible = !parts.is_empty() && band.first <= band.last && band.last < 64;
        // Only DC of several components may share a scan of a progressive picture.
        let is_possible = is_possible && (!self.is_progressive || (band.first == 0) == (band.last == 0));
        (is_possible && (!self.is_progressive || band.first == 0 || parts.len() == 1))
            .then_some((parts, band))
    }

    /// Follows a scan with this header, whose codes begin `bytes`, and returns the place of the marker behind it.
    fn follow_scan(&mut self, header: &[u8], bytes: &[u8]) -> Step<usize> {
        let (parts, band) = self.read_scan(header).ok_or(HEADER)?;
        let mut bits = Bits { bytes, ..Bits::default() };
        let blocks = |component: &Component| {
            let side = |side: usize, own: usize, most: usize| (side * own).div_ceil(most).div_ceil(8);
            let (own, most) = (component.sampling, self.unit);
            (side(self.sides.0, own.0, most.0), side(self.sides.1, own.1, most.1))
        };
        // A scan of one component has its blocks in rows, without those that only fill units.
        let is_single = parts.len() == 1;
        let (across, down) =
            if is_single { blocks(&self.components[parts[0].component]) } else { self.units() };
        for unit in 0..across * down {
            if self.interval > 0 && unit > 0 && unit % self.interval == 0 {
                bits.restart(unit / self.interval - 1)?;
            }
            let (row, column) = (unit / across, unit % across);
            for part in &parts {
                let component = &mut self.components[part.component];
                let (wide, high) = if is_single { (1, 1) } else { component.sampling };
                for block in 0..wide * high {
                    let place = (row * high + block / wide) * component.stride + column * wide + block % wide;
                    let tables = [part.dc, part.ac].map(|table| self.tables[table].as_ref());
                    bits.block(tables, &band, component.known.get_mut(place).unwrap_or(&mut 0))?;
                }
            }
        }
        for part in parts.iter().filter(|_| band.low == 0) {
            self.components[part.component].done |= u64::MAX >> (63 - band.last) & u64::MAX << band.first;
        }
        bits.end()
    }
}

struct Huffman {
    /// For each length of codes: the first code, as the first of 16 bits, that is longer.
    ends: [u32; 16],
    /// For each length: what is added to a code to find its value.
    shifts: [i32; 16],
    values: Vec<u8>,
}

impl Huffman {
    /// Makes a table of the number of codes of each length; `None` if a value has two codes, or there are more codes than bits for them.
    fn new(counts: &[u8; 16], values: &[u8]) -> Option<Self> {
        if (1..values.len()).any(|place| values[place..].contains(&values[place - 1])) {
            return None;
        }
        let mut table = Self { ends: [0; 16], shifts: [0; 16], values: values.to_owned() };
        let (mut code, mut place) = (0_u32, 0);
        for (length, &count) in counts.iter().enumerate() {
            table.shifts[length] = place - code as i32;
            place += i32::from(count);
            code += u32::from(count);
            if code > 2 << length {
                return None;
            }
            table.ends[length] = code << (15 - length);
            code *= 2;
        }
        Some(table)
    }
}

/// The bits of compressed data up to the next marker.
#[derive(Default)]
struct Bits<'a> {
    bytes: &'a [u8],
    place: usize,
    /// The next `left` bits are the low ones.
    buffer: u64,
    left: u32,
    /// Blocks that have no further coefficient in this scan.
    run: u32,
}

impl Bits<'_> {
    /// Takes bytes until 16 bits are there, or a marker is next.
    fn fill(&mut self) {
        while self.left < 16 {
            let step = match self.bytes[self.place..] {
                [0xff, 0x00, ..] => 2,
                [0xff, ..] | [] => return,
                _ => 1,
            };
            self.buffer = self.buffer << 8 | u64::from(self.bytes[self.place]);
            (self.place, self.left) = (self.place + step, self.left + 8);
        }
    }

    fn take(&mut self, count: u32) -> Step<u32> {
        self.fill();
        self.left = self.left.checked_sub(count).ok_or(self.early())?;
        Ok((self.buffer >> self.left) as u32 & ((1 << count) - 1))
    }

    /// Returns why there are no more bits.
    fn early(&self) -> &'static str {
        if self.bytes.len() - self.place < 2 { TRUNCATED } else { EARLY }
    }

    fn symbol(&mut self, table: Option<&Huffman>) -> Step<u32> {
        self.fill();
        let table = table.ok_or(HEADER)?;
        let next =
            (if self.left < 16 { self.buffer << (16 - self.left) } else { self.buffer >> (self.left - 16) })
                as u32
                & 0xffff;
        let length = table.ends.iter().position(|&end| next < end);
        let length = length.ok_or(if self.left < 16 { self.early() } else { NO_CODE })?;
        let place = table.shifts[length] + (next >> (15 - length)) as i32;
        self.take(length as u32 + 1)?;
        table.values.get(place as usize).map(|&value| value.into()).ok_or(HEADER)
    }

    /// Follows the codes of a block. `known` are its coefficients that are not 0.
    fn block(&mut self, [dc, ac]: [Option<&Huffman>; 2], band: &Band, known: &mut u64) -> Step<()> {
        if band.first == 0 && band.refines {
            self.take(1)?;
        } else if band.first == 0 {
            let bits = self.symbol(dc)?;
            self.take(Some(bits).filter(|bits| *bits <= MOST_BITS).ok_or(NO_CODE)?)?;
        }
        let mut place = band.first.max(1);
        while self.run == 0 && place <= band.last {
            let symbol = self.symbol(ac)?;
            let (zeros, bits) = (symbol >> 4, symbol & 15);
            if bits >= MOST_BITS {
                return Err(NO_CODE);
            }
            if bits == 0 && zeros < 15 {
                // Only progressive pictures have runs of blocks.
                if zeros > 0 && band.first == 0 {
                    return Err(NO_CODE);
                }
                self.run = (1 << zeros) + self.take(zeros)?;
                break;
            }
            self.take(bits)?;
            place = self.pass(place, zeros, band, *known)?;
            if bits > 0 && place > band.last {
                return Err(NO_CODE);
            }
            if bits > 0 {
                *known |= 1 << place;
            }
            place += 1;
        }
        if self.run > 0 {
            self.run -= 1;
            self.pass(place, 64, band, *known)?;
        }
        Ok(())
    }

    /// Passes `zeros` coefficients that are 0 so far from `place` on, and takes a bit for each other one between them. Returns the
    /// place behind.
    fn pass(&mut self, place: u32, zeros: u32, band: &Band, known: u64) -> Step<u32> {
        if !band.refines {
            return Ok(place + zeros);
        }
        let mut zeros = zeros;
        for place in place..=band.last {
            if known >> place & 1 == 1 {
                self.take(1)?;
            } else if zeros == 0 {
                return Ok(place);
            } else {
                zeros -= 1;
            }
        }
        Ok(band.last + 1)
    }

    /// Resumes after the restart marker of this number.
    fn restart(&mut self, number: usize) -> Step<()> {
        let place = self.end()?;
        let (marker, behind) = next_marker(self.bytes, place).ok_or(TRUNCATED)?;
        if usize::from(marker) != 0xd0 + number % 8 {
            return Err(RESTART);
        }
        *self = Self { bytes: self.bytes, place: behind, ..Self::default() };
        Ok(())
    }

    /// Returns the place behind the data, of which at most the rest of a byte is left over.
    fn end(&mut self) -> Step<usize> {
        self.fill();
        if self.left < 8 && self.run == 0 { Ok(self.place) } else { Err(LATE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gradient of 28 x 20 px that libjpeg has written: progressive, subsampled, with a restart marker behind every two units.
    const PROGRESSIVE: &[u8] = include_bytes!("../tests/progressive.jpg");

    /// A gradient of 48 x 32 px, in one scan.
    fn baseline() -> Vec<u8> {
        let picture =
            image::RgbImage::from_fn(48, 32, |x, y| image::Rgb([5 * x, 7 * y, 2 * (x + y)].map(|v| v as u8)));
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        encoder.encode_image(&picture).expect("encoded");
        bytes
    }

    #[test]
    fn a_jpeg_that_ends_early_with_an_end_marker_is_named() {
        for whole in [baseline(), PROGRESSIVE.to_owned()] {
            check(&whole).expect("whole");
            check(&[&whole[..], &[0; 40]].concat()).expect("cameras write other data behind the end");
            for length in 4..whole.len() - 2 {
                let cut = [&whole[..length], &[0xff, 0xd9]].concat();
                let why = check(&cut).expect_err("cut");
                assert!(
                    why.contains("JPEG") && why.contains("copy or record the file again"),
                    "{length}: {why}"
                );
            }
        }
    }

    #[test]
    fn bytes_that_are_lost_or_zero_are_named() {
        for whole in [baseline(), PROGRESSIVE.to_owned()] {
            let scan = whole.windows(2).position(|pair| pair == [0xff, 0xda]).expect("a scan") + 14;
            let places = scan..whole.len() - 12;
            let is_seen = |damaged: &dyn Fn(usize) -> Vec<u8>| {
                places
                    .clone()
                    .filter(|place| damaged(*place) != whole && check(&damaged(*place)).is_err())
                    .count()
            };
            let lost = is_seen(&|place| [&whole[..place], &whole[place + 8..]].concat());
            let zero = is_seen(&|place| [&whole[..place], &[0; 8], &whole[place + 8..]].concat());
            // A decoder falls into step again behind a few bytes, and then often has as many blocks as before.
            assert!(
                lost * 10 > places.len() * 8 && zero * 2 > places.len(),
                "{lost} and {zero} of {}",
                places.len()
            );
        }
    }

    #[test]
    fn motion_jpeg_leaves_its_tables_out() {
        let whole = baseline();
        let (mut bare, mut place) = (b"\xff\xd8\xff\xe0\0\x0eAVI1\0\0\0\0\0\0\0\0".to_vec(), 2);
        while let Some((marker, segment)) = next_marker(&whole, place).filter(|(marker, _)| *marker != 0xda) {
            place = segment + usize::from(u16::from_be_bytes([whole[segment], whole[segment + 1]]));
            if !matches!(marker, 0xc4 | 0xe0) {
                bare.extend(&whole[segment - 2..place]);
            }
        }
        bare.extend(&whole[place..]);
        assert!(bare.len() + 300 < whole.len(), "the tables are gone");
        let [bare, whole] = [bare, whole].map(|file| crate::decode(&file, "frame").expect("whole"));
        assert_eq!(bare, whole);
    }

    #[test]
    fn restart_markers_have_their_order() {
        let place = PROGRESSIVE.windows(2).position(|pair| pair == [0xff, 0xd1]).expect("a restart marker");
        let mut swapped = PROGRESSIVE.to_owned();
        swapped[place + 1] = 0xd2;
        assert!(check(&swapped).expect_err("out of order").contains(RESTART));
    }
}
