//! No method allocates memory after its first frame, however different the next frame of the same size is.

// Helpers of tests may unwrap as tests do; the allocator that counts is the system's.
#![allow(clippy::unwrap_used, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use modulo_core::unwrap::{METHODS, Options, Unwrap, by_name, of_gains};
use modulo_core::{Frame, Gains, Mosaic, Range, Recovered};
use ndarray::Array3;

/// The system's allocator with a count of the allocations of this thread.
struct Counting;

thread_local! {
    static ASKED: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ASKED.set(ASKED.get() + 1);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static MEMORY: Counting = Counting;

const DIM: (usize, usize) = (75, 138);

/// A slope with an edge, and noise of up to `noise` codes over it.
fn frame(bits: u8, channels: usize, noise: u32) -> Frame {
    let mut seed = 1u32;
    let x = Array3::from_shape_fn((DIM.0, DIM.1, channels), |(i, j, c)| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let slope = (3 * i + 2 * j + 17 * c + if j > 70 && i > 30 { 90 } else { 0 }) as u32;
        (slope + (seed >> 16) % (noise + 1)) & ((1 << bits) - 1)
    });
    match bits {
        ..=8 => Frame::from_u8(x.mapv(|x| x as u8)).unwrap(),
        _ => Frame::from_u16(x.mapv(|x| x as u16)).unwrap(),
    }
}

/// Returns the number of allocations of `method` for a frame after one with `first_noise`.
fn asked(unwrap: &mut dyn Unwrap, bits: u8, channels: usize, first_noise: u32) -> u64 {
    let range = Range::new(bits, 4.0).unwrap();
    let mut out = Recovered::default();
    // The second frame is mostly noise, which needs the most edges and segments that a frame can have.
    let [first, second] = [first_noise, 255].map(|noise| frame(bits, channels, noise));
    let needs_mosaic = unwrap.name().ends_with("_gains") && channels == 1;
    let [first, second] =
        [first, second].map(|y| if needs_mosaic { y.with_mosaic(Mosaic::Rggb).unwrap() } else { y });
    unwrap.unwrap(&first, &range.into(), &mut out).unwrap();
    let before = ASKED.get();
    unwrap.unwrap(&second, &range.into(), &mut out).unwrap();
    ASKED.get() - before
}

#[test]
fn the_second_frame_needs_no_more_memory() {
    for &method in METHODS {
        // `auto` makes the memory of a method when it first uses it: its first frame has to.
        let first_noise = if method == "auto" { 255 } else { 0 };
        for (bits, channels) in [(8, 3), (8, 1), (12, 3)] {
            let mut unwrap = by_name(method, &Options::default()).unwrap();
            let count = asked(unwrap.as_mut(), bits, channels, first_noise);
            assert_eq!(count, 0, "{method}, {bits} bits, {channels} channels");
        }
    }
}

#[test]
fn two_gains_on_a_mosaic_need_no_more_memory_for_the_second_frame() {
    for bits in [8, 12] {
        let mut unwrap = of_gains(Gains::checkerboard(4.0)).unwrap();
        assert_eq!(asked(unwrap.as_mut(), bits, 1, 0), 0, "{bits} bits");
    }
}

#[test]
fn the_counter_counts() {
    let before = ASKED.get();
    let memory = std::hint::black_box(vec![1, 2, 3]);
    assert!(ASKED.get() > before, "{memory:?}");
}
