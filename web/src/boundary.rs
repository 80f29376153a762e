//! The functions that the page calls: they exchange numbers and the addresses of bytes. This is the only file with `unsafe`, which
//! declares that no other function has an exported name.
#![expect(unsafe_code, reason = "the compiler cannot check that exported names are unique")]

use std::cell::RefCell;

use modulo_core::candidates::Candidate;
use modulo_core::{Psf, SensorConfig};

use crate::boxes::Detector;
use crate::capture::Capture;
use crate::picture::Picture;
use crate::shown::{Stream, figures};

/// What remains from call to call.
#[derive(Default)]
struct Page {
    bytes: Vec<u8>,
    picture: Option<Picture>,
    capture: Option<Capture>,
    detector: Option<Detector>,
}

thread_local! {
    static PAGE: RefCell<Page> = RefCell::default();
}

/// Works on the page; an error becomes the bytes of the page, and 0 is returned instead of 1.
fn with_page<E: std::fmt::Display>(work: impl FnOnce(&mut Page) -> Result<(), E>) -> u32 {
    PAGE.with_borrow_mut(|page| match work(page) {
        Ok(()) => 1,
        Err(why) => {
            page.bytes = why.to_string().into_bytes();
            0
        }
    })
}

/// Makes room for `length` bytes, and returns their address.
#[unsafe(no_mangle)]
pub extern "C" fn reserve(length: usize) -> *mut u8 {
    PAGE.with_borrow_mut(|page| {
        page.bytes = vec![0; length];
        page.bytes.as_mut_ptr()
    })
}

/// Returns the number of the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn length() -> usize {
    PAGE.with_borrow(|page| page.bytes.len())
}

/// Returns the address of the bytes, which the next call may change.
#[unsafe(no_mangle)]
pub extern "C" fn address() -> *const u8 {
    PAGE.with_borrow(|page| page.bytes.as_ptr())
}

/// Opens the file in the bytes. Returns the side of the squares by which it is reduced, or 0.
#[unsafe(no_mangle)]
pub extern "C" fn open() -> u32 {
    let opened = with_page(|page| {
        let file = std::mem::take(&mut page.bytes);
        Picture::open(&file, "This file").map(|picture| page.picture = Some(picture))
    });
    opened * PAGE.with_borrow(|page| page.picture.as_ref().map_or(0, |picture| picture.reduction as u32))
}

/// Renders the scene of the preset with this number.
#[unsafe(no_mangle)]
pub extern "C" fn render(preset: usize) {
    PAGE.with_borrow_mut(|page| page.picture = Some(Picture::render(preset)));
}

/// Exposes a sensor to the picture; its lens has a blur of `sigma` px, and the read noise is in digital numbers.
#[unsafe(no_mangle)]
pub extern "C" fn expose(bits: u8, alpha: f64, sigma: f64, read_noise: f64, optical_black: usize) -> u32 {
    let psf = Psf::of_sigma(sigma);
    let config = SensorConfig { bits, alpha, psf, read_noise, optical_black, ..SensorConfig::PLAIN };
    with_page(|page| {
        let Some(picture) = &page.picture else { return Ok(()) };
        Capture::new(picture, config).map(|capture| page.capture = Some(capture))
    })
}

/// Finds the wrap counts of the exposure.
#[unsafe(no_mangle)]
pub extern "C" fn recover() -> u32 {
    with_page(|page| page.capture.as_mut().map_or(Ok(()), Capture::recover))
}

/// Writes an image into the bytes, with the number of its stream: in the form 0 for the screen, 1 for the detector, 2 as the codes that `modulo
/// simulate` writes.
#[unsafe(no_mangle)]
pub extern "C" fn image(stream: usize, form: u32) -> u32 {
    with_page(|page| {
        let (Some(picture), Some(capture)) = (&page.picture, &page.capture) else { return Ok(()) };
        let stream = Stream::ALL[stream];
        let made = match form {
            0 => stream.shown(picture, capture),
            1 => stream.for_detector(capture),
            _ => stream.bytes(capture),
        };
        made.map(|bytes| page.bytes = bytes)
    })
}

/// Writes the figures into the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn numbers() {
    PAGE.with_borrow_mut(|page| {
        let (Some(picture), Some(capture)) = (&page.picture, &page.capture) else { return };
        page.bytes = figures(picture, capture).iter().flat_map(|figure| figure.to_le_bytes()).collect();
    });
}

/// Writes the name of the method into the bytes.
#[unsafe(no_mangle)]
pub extern "C" fn method() {
    PAGE.with_borrow_mut(|page| {
        page.bytes =
            page.capture.as_ref().map_or(Vec::new(), |capture| capture.recovered.report.method.into());
    });
}

/// Finds the boxes in the image in the bytes, which is one for the detector. Writes the class, the score and the corners of each one into them.
#[unsafe(no_mangle)]
pub extern "C" fn detect(height: usize, width: usize) -> u32 {
    with_page(|page| {
        if page.detector.is_none() {
            page.detector = Some(Detector::new()?);
        }
        let Some(detector) = &page.detector else { return Ok(()) };
        let found = detector.find(&page.bytes, (height, width))?;
        let numbers = |one: &Candidate| {
            [one.class as f64]
                .into_iter()
                .chain([one.score, one.bbox.x1, one.bbox.y1, one.bbox.x2, one.bbox.y2].map(f64::from))
        };
        page.bytes = found.iter().flat_map(numbers).flat_map(f64::to_le_bytes).collect();
        Ok::<_, String>(())
    })
}
