//! Any image of any sensor through every method: no panic, and what comes out
//! is congruent with what went in and within the sensor's range.
//!
//! `cargo fuzz run unwrap`

#![no_main]

use libfuzzer_sys::fuzz_target;
use modulo_core::unwrap::{METHODS, Options, Recovered, by_name};
use modulo_core::{Frame, Range};
use ndarray::Array3;

/// Seven bytes of header, then samples, repeated until the image is full.
fn image(data: &[u8]) -> Option<(Frame, Range, Options)> {
    let (&[bits, whole, part, height, width, channels, threads], samples) = data.split_first_chunk()?;
    let bits = bits % 16 + 1;
    let range = Range::new(bits, f64::from(whole) + (f64::from(part) + 1.0) / 256.0).ok()?;
    let dim =
        (usize::from(height) % 64 + 1, usize::from(width) % 64 + 1, if channels % 2 == 0 { 1 } else { 3 });
    if samples.is_empty() {
        return None;
    }
    let mut bytes = samples.iter().cycle().map(|&byte| u16::from(byte));
    let mut sample =
        || (bytes.next().unwrap_or(0) | bytes.next().unwrap_or(0) << 8) & ((1u32 << bits) - 1) as u16;
    let pixels = Array3::from_shape_simple_fn(dim, &mut sample);
    let frame =
        if bits <= 8 { Frame::from_u8(pixels.mapv(|value| value as u8)) } else { Frame::from_u16(pixels) };
    Some((frame.ok()?, range, Options { threads: usize::from(threads) % 3 + 1, ..Options::default() }))
}

fuzz_target!(|data: &[u8]| {
    let Some((y, range, options)) = image(data) else { return };
    let mut out = Recovered::default();
    for name in METHODS {
        let mut method = by_name(name, &options).expect("a listed method");
        method.unwrap(&y, range, &mut out).expect("every code is possible");
        let y = y.to_f32();
        assert!(out.k.iter().all(|&k| k <= range.most_wraps()), "{name}: k out of range");
        let congruent =
            out.x.iter().zip(&out.k).zip(&y).all(|((x, &k), y)| *x == y + f32::from(k) * range.peak());
        assert!(congruent, "{name}: x is not y + k * peak");
    }
});
