//! Times a forward and an inverse cosine transform of three planes, by this crate and by rustdct, and all of SPUD.
//!
//! `cargo run --release -p modulo-core --example time_dct [-- HEIGHT WIDTH [RUNS]]` prints the least and the
//! median duration of all runs in ms, on one thread.

use std::time::Instant;

use modulo_core::dct::Dct2;
use modulo_core::unwrap::{Options, Recovered, by_name};
use modulo_core::{Frame, Range};
use ndarray::Array3;

#[path = "../tests/library/mod.rs"]
mod library;

use library::{Direction, Library};

const CHANNELS: usize = 3;

/// Returns integers that rise and fall, with a texture.
fn scene(height: usize, width: usize) -> Array3<u16> {
    let triangle = |t: usize, p: usize| (t % (2 * p)).abs_diff(p);
    Array3::from_shape_fn((height, width, CHANNELS), |(i, j, c)| {
        (2 * triangle(3 * i + j + 17 * c, 150) + 3 * triangle(2 * j + i + 40 * c, 97) + (7 * i + 3 * j) % 5)
            as u16
    })
}

fn time(name: &str, runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name:<28} least {:7.2} ms, middle {:7.2} ms", times[0], times[runs / 2]);
    times[0]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<usize> = std::env::args().skip(1).map(|word| word.parse()).collect::<Result<_, _>>()?;
    let at = |index: usize, default: usize| numbers.get(index).copied().unwrap_or(default);
    let (height, width, runs) = (at(0, 375), at(1, 1242), at(2, 60).max(1));
    let x = scene(height, width);
    let mut plane: Vec<f32> = x.iter().step_by(CHANNELS).map(|&x| f32::from(x)).collect();

    let mut dct = Dct2::new(height, width);
    let mut result = Ok(());
    let ours = time("dct pair", runs, || {
        for _ in 0..CHANNELS {
            result = dct.forward(&mut plane).and_then(|()| dct.inverse(&mut plane));
        }
    });
    result?;
    let mut library = Library::new(height, width);
    let theirs = time("dct pair, rustdct", runs, || {
        for _ in 0..CHANNELS {
            library.transform(&mut plane, Direction::Forward);
            library.transform(&mut plane, Direction::Inverse);
        }
    });
    println!("rustdct / ours {:.2}", theirs / ours);

    let y = Frame::from_u8(x.mapv(|x| x as u8))?;
    let range = Range::new(8, 4.0)?;
    let mut out = Recovered::default();
    for threads in [1, 2] {
        let mut spud = by_name("spud", &Options { threads, ..Options::default() })?;
        let mut result = Ok(());
        time(&format!("spud, {threads} threads"), runs, || result = spud.unwrap(&y, range, &mut out));
        result?;
    }
    Ok(())
}
