//! Integer hash noise, the only source of randomness in a scene.
//!
//! All functions use only `+ - * /` on `f32` and wrapping integer arithmetic, so that a scene has the same bytes
//! on every machine: no `sin`, no `exp`, no state that scenes share.

/// Mixes three numbers into 32 evenly distributed bits.
pub(super) fn hash(a: u32, b: u32, c: u32) -> u32 {
    let mut h = a ^ b.wrapping_mul(0x9E37_79B9) ^ c.wrapping_mul(0x85EB_CA6B).rotate_left(15);
    for _ in 0..2 {
        h = (h ^ (h >> 16)).wrapping_mul(0x7FEB_352D);
        h = (h ^ (h >> 15)).wrapping_mul(0x846C_A68B);
    }
    h ^ (h >> 16)
}

/// Converts 32 bits to a number in `[0, 1)`.
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 / 16_777_216.0
}

/// Returns smooth value noise in `[0, 1)` with one lattice cell for each unit.
pub(super) fn noise(x: f32, y: f32, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (tx, ty) = (ease(x - fx), ease(y - fy));
    // Negative lattice coordinates wrap to large ones, which the hash accepts as any other.
    let (ix, iy) = (fx as i32 as u32, fy as i32 as u32);
    let at = |dx: u32, dy: u32| unit(hash(ix.wrapping_add(dx), iy.wrapping_add(dy), seed));
    let top = mix(at(0, 0), at(1, 0), tx);
    let bottom = mix(at(0, 1), at(1, 1), tx);
    mix(top, bottom, ty)
}

/// Interpolates from `a` at `t = 0` to `b` at `t = 1`.
pub(super) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Rises smoothly from 0 (at or below `low`) to 1 (at or above `high`); `low < high`.
pub(super) fn ramp(low: f32, high: f32, x: f32) -> f32 {
    ease(((x - low) / (high - low)).clamp(0.0, 1.0))
}

/// Returns a sine of period 1, made of two parabolas, in `[-1, 1]`.
pub(super) fn wave(t: f32) -> f32 {
    // Two parabolas stand for a sine, whose last digits differ between mathematical libraries.
    let t = t - t.floor();
    if t < 0.5 { 16.0 * t * (0.5 - t) } else { -16.0 * (t - 0.5) * (1.0 - t) }
}

fn ease(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// A stream of random numbers; the same key gives the same stream.
pub(super) struct Random {
    key: u32,
    drawn: u32,
}

impl Random {
    /// Makes the stream number `what` in the world `seed`.
    pub(super) fn new(seed: u32, what: u32) -> Self {
        Self { key: hash(seed, what, 0x5CE7_E000), drawn: 0 }
    }

    /// Returns a uniform number in `[0, 1)`.
    pub(super) fn unit(&mut self) -> f32 {
        // Each number is a hash of its position, so a stream has no state that another one could disturb.
        self.drawn = self.drawn.wrapping_add(1);
        unit(hash(self.key, self.drawn, 0))
    }

    /// Returns a uniform number in `[low, high)`.
    pub(super) fn between(&mut self, low: f32, high: f32) -> f32 {
        mix(low, high, self.unit())
    }

    /// Returns one of `choices`, all with the same probability.
    pub(super) fn pick<T: Copy, const N: usize>(&mut self, choices: &[T; N]) -> T {
        // The number is below 1, but its product may round up to N.
        let index = (self.unit() * N as f32) as usize;
        choices[index.min(N - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn chance_stays_in_its_range(seed: u32, what: u32, x in -1e4f32..1e4, y in -1e4f32..1e4) {
            prop_assert!((0.0..1.0).contains(&Random::new(seed, what).unit()));
            prop_assert!((0.0..1.0).contains(&noise(x, y, seed)));
            prop_assert!(wave(x).abs() <= 1.0);
        }
    }

    #[test]
    fn numbers_are_uniform() {
        let mut random = Random::new(1, 2);
        let mean = (0..10_000).map(|_| random.unit()).sum::<f32>() / 10_000.0;
        assert!((mean - 0.5).abs() < 0.02, "mean of 10000 numbers is {mean}");
    }
}
