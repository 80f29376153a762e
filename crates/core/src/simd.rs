//! Uses the vector instructions that this machine has beyond the compiler's baseline.
//!
//! This is the only module of the crate with `unsafe`. Code is written once for all machines. Here it is compiled again with AVX2 and FMA,
//! and with AVX-512, and the widest copy that the processor has runs. No intrinsic is called.

use ndarray::{Array3, ArrayRef3};

/// Evaluates an expression with the widest vector instructions of this machine.
///
/// Only code that is inlined into the expression profits: plain loops, and functions and closures that are
/// `#[inline(always)]`. The result is the same on every machine, provided that the expression fixes the order of its
/// floating-point operations and asks for fused multiply-add explicitly or not at all.
macro_rules! widest {
    ($work:expr) => {
        $crate::simd::run_widest(
            #[inline(always)]
            || $work,
        )
    };
}
pub(crate) use widest;

/// Returns the array of `value` of each sample, computed with the widest vector instructions.
#[inline(always)]
pub(crate) fn mapped<T: Copy + Default>(x: &ArrayRef3<f32>, value: impl Fn(f32) -> T) -> Array3<T> {
    // `mapv` is not inlined, and would run in the copy for the compiler's baseline.
    let Some(samples) = x.as_slice() else { return x.mapv(value) };
    let mut out = vec![T::default(); samples.len()];
    widest!(out.iter_mut().zip(samples).for_each(|(out, &x)| *out = value(x)));
    Array3::from_shape_vec(x.dim(), out).expect("one value for each sample")
}

/// Returns `floor(x)` of `0 <= x < 2^32`. The conversion by `as`, which saturates, has no vector
/// instruction; the operations here have.
#[inline(always)]
pub(crate) fn floor(x: f64) -> u32 {
    /// The doubles from here on are whole numbers, and their low 32 bits count up from 0.
    const WHOLE: f64 = (1u64 << 52) as f64;
    let nearest = x + WHOLE;
    // The sum is rounded to the nearest whole number, which may be the one above.
    (nearest.to_bits() as u32).wrapping_sub(u32::from(nearest - WHOLE > x))
}

/// Calls `work` in the widest copy that the processor has. Only code that is inlined into `work`, which is `#[inline(always)]` itself,
/// profits, as in the macro `widest` of this crate.
#[inline]
pub fn run_widest<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("fma")
    {
        #[expect(unsafe_code, reason = "calling a function compiled for features the baseline lacks")]
        // SAFETY: the processor was just seen to have all five features; AVX-512 includes AVX2.
        return unsafe { with_avx512(work) };
    }
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        #[expect(unsafe_code, reason = "calling a function compiled for features the baseline lacks")]
        // SAFETY: the processor was just seen to have both features.
        return unsafe { with_avx2(work) };
    }
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
fn with_avx512<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(test)]
mod tests {
    proptest::proptest! {
        #[test]
        fn floors_as_the_conversion_does(x in 0.0..4_294_967_296f64, whole: u32, above in 0u32..3) {
            let near = (f64::from(whole) + 0.5).to_bits() + u64::from(above) - 1;
            for x in [x, f64::from(whole), f64::from(whole) + 0.5, f64::from_bits(near)] {
                proptest::prop_assert_eq!(super::floor(x), x as u32, "{}", x);
            }
        }
    }
}
