//! The orthonormal two-dimensional cosine transform of any size, its filter, and the inverse.
//!
//! From short to long: `fft` composes Fourier transforms from those of its radices, `cosine` makes a cosine transform of them, `rows`
//! transforms the rows of an image, and `grid` its columns and the whole. All work on the vectors of `lanes`. A length with a large prime
//! factor is left to the library rustdct (`library`). For a pair of transforms of 1242 x 375 x 3 samples that one takes 54 ms at
//! opt-level 1, and these take 12 ms (x86-64, least of up to 100 calls on a loaded machine). `cargo bench -p modulo-core -- dct_pair least_squares` times
//! the library beside the whole method. A plan owns its scratch, so a transform allocates nothing.

mod cosine;
mod fft;
mod grid;
mod lanes;
mod library;
mod rows;

pub(crate) use grid::ImageDct;
pub(crate) use lanes::LANES;
pub(crate) use rows::{SampleRun, SpectralFilter};

/// Loads a run of sixteen samples of a row-major plane, with 0 beyond the end of the row.
#[inline(always)]
pub(crate) fn load_run<T: Copy + Default>(plane: &[T], width: usize, run: SampleRun) -> [T; LANES] {
    let SampleRun { row, sample } = run;
    let row = &plane[row * width..][..width];
    // Only the last run of a row can be short. Its copy is out of line, so that all others stay one load.
    match row[sample..].first_chunk() {
        Some(samples) => *samples,
        None => tail(&row[sample..]),
    }
}

#[cold]
#[inline(never)]
fn tail<T: Copy + Default>(rest: &[T]) -> [T; LANES] {
    std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or_default())
}
