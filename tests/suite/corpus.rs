//! The inputs of the fuzz targets that are kept: small seeds, and what once broke a property.
//!
//! `MODULO_MUTATIONS=N` also gives each target N inputs that are made of them by chance.

#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

#[test]
fn kept_inputs_of_the_fuzzers_keep_the_properties() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let mutations = std::env::var("MODULO_MUTATIONS").map_or(100, |count| count.parse().expect("a number"));
    let only = std::env::var("MODULO_TARGET").unwrap_or_default();
    for (name, target) in fuzz::TARGETS.iter().filter(|(name, _)| name.contains(&only)) {
        let folders = ["corpus", "regressions"].map(|kind| root.join(kind).join(name));
        let mut files: Vec<_> = folders
            .iter()
            .filter_map(|folder| folder.read_dir().ok())
            .flatten()
            .flatten()
            .map(|f| f.path())
            .collect();
        files.sort();
        assert!(!files.is_empty(), "{name} has no seed in fuzz/corpus");
        let kept: Vec<Vec<u8>> = files.iter().map(|file| std::fs::read(file).expect("readable")).collect();
        for (file, bytes) in files.iter().zip(&kept) {
            assert!(catch_unwind(|| target(bytes)).is_ok(), "{name}: {}", file.display());
        }
        let mut chance = Chance(1);
        for _ in 0..mutations {
            let bytes = chance.mutated(&kept);
            if catch_unwind(AssertUnwindSafe(|| target(&bytes))).is_err() {
                let broken = std::env::temp_dir().join(format!("broken-{name}"));
                std::fs::write(&broken, &bytes).expect("writable");
                panic!("{name}: {} breaks a property", broken.display());
            }
        }
    }
}

/// splitmix64
struct Chance(u64);

impl Chance {
    /// Below `end`.
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end.max(1) as u64) as usize
    }

    /// One of `kept` with a few bytes changed, removed, repeated, or taken from another one.
    fn mutated(&mut self, kept: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = kept[self.below(kept.len())].clone();
        for _ in 0..=self.below(4) {
            let (at, length) = (self.below(bytes.len() + 1), 1 + self.below(8));
            let end = (at + length).min(bytes.len());
            match self.below(6) {
                0 => bytes[at..end].fill([0, 1, 0x7f, 0x80, 0xff][self.below(5)]),
                1 => bytes[at..end].iter_mut().for_each(|byte| *byte ^= 1 << self.below(8)),
                2 => drop(bytes.drain(at..end)),
                3 => {
                    let part = bytes[at..end].to_vec();
                    bytes.splice(at..at, part).for_each(drop);
                }
                4 => bytes[at..end].iter_mut().for_each(|byte| *byte = self.below(256) as u8),
                _ => {
                    let other = &kept[self.below(kept.len())];
                    let from = self.below(other.len());
                    let part = other[from..(from + 8 * length).min(other.len())].to_vec();
                    bytes.splice(at..end, part).for_each(drop);
                }
            }
        }
        bytes
    }
}
