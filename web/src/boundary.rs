//! The functions that the page calls: they exchange numbers and the addresses of bytes. This is the only file with `unsafe`, which
//! declares that no other function has an exported name.
#![expect(unsafe_code, reason = "the compiler cannot check that exported names are unique")]

use std::cell::RefCell;

use modulo_core::{Psf, SensorConfig};

use crate::capture::Capture;
use crate::picture::{self, Picture};
use crate::shown;

/// What remains from call to call.
#[derive(Default)]
struct Page {
    bytes: Vec<u8>,
    picture: Option<Picture>,
    capture: Option<Capture>,
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

/// Opens the file in the bytes, or the sample if there are none. Returns the side of the squares by which it is reduced, or 0.
#[unsafe(no_mangle)]
pub extern "C" fn open() -> u32 {
    let opened = with_page(|page| {
        let file = std::mem::take(&mut page.bytes);
        let opened = if file.is_empty() { Ok(picture::sample()) } else { picture::open(&file, "This file") };
        opened.map(|picture| page.picture = Some(picture))
    });
    opened * PAGE.with_borrow(|page| page.picture.as_ref().map_or(0, |picture| picture.reduction as u32))
}

/// Exposes a sensor to the picture; its lens has a blur of `sigma` px, and the read noise is in digital numbers.
#[unsafe(no_mangle)]
pub extern "C" fn expose(bits: u8, alpha: f64, sigma: f64, read_noise: f64, optical_black: usize) -> u32 {
    let psf = Psf::of_sigma(sigma);
    let config = SensorConfig { bits, alpha, psf, read_noise, optical_black, ..SensorConfig::PLAIN };
    with_page(|page| {
        let Some(picture) = &page.picture else { return Ok(()) };
        Capture::new(&picture.radiance, config).map(|capture| page.capture = Some(capture))
    })
}

/// Finds the wrap counts of the exposure.
#[unsafe(no_mangle)]
pub extern "C" fn recover() -> u32 {
    with_page(|page| page.capture.as_mut().map_or(Ok(()), Capture::recover))
}

/// Writes an output into the bytes: 0 the figures; for the screen, 1 the normal, 2 the modulo and 3 the recovered image; the codes that `modulo
/// simulate` writes, 4 of the modulo and 5 of the recovered image; 6 the name of the method.
#[unsafe(no_mangle)]
pub extern "C" fn output(number: u32) -> u32 {
    with_page(|page| {
        let made = page.capture.as_ref().map(|capture| shown::output(capture, number)).transpose();
        made.map(|bytes| page.bytes = bytes.unwrap_or_default())
    })
}
