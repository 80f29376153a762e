//! The wider vectors that this machine has and the compiler's baseline has not.
//!
//! The one module with `unsafe`. Code is written once, for no machine in
//! particular; here it is compiled a second time with AVX2 and FMA and that
//! copy runs where the processor has them. No intrinsic is called anywhere.

/// Runs `work` on the widest vectors of this machine.
///
/// Only what is inlined into `work` gains: closures and functions that are
/// `#[inline(always)]`. Results are the same on every machine as long as
/// `work` leaves the order of floating-point operations to nobody but itself
/// and asks for fused multiply-add explicitly or not at all.
#[inline]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gives_what_the_work_gives() {
        let values: Vec<u32> = (0..1000).collect();
        assert_eq!(widest(|| values.iter().map(|v| v * 3).sum::<u32>()), 1_498_500);
    }
}
