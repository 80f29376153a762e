//! Uses the vector instructions that this machine has beyond the compiler's baseline.
//!
//! This is the only module with `unsafe`. Code is written once for all machines. Here it is compiled a second
//! time with AVX2 and FMA, and that copy runs where the processor has both. No intrinsic is called.

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

/// Calls `work` in a copy that is compiled for AVX2 and FMA, where the processor has both; use [`widest!`].
#[inline]
pub(crate) fn run_widest<R>(work: impl FnOnce() -> R) -> R {
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
    #[test]
    fn gives_what_the_work_gives() {
        let values: Vec<u32> = (0..1000).collect();
        assert_eq!(widest!(values.iter().map(|v| v * 3).sum::<u32>()), 1_498_500);
    }
}
