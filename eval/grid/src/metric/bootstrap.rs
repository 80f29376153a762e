//! 95 % intervals by the bootstrap: drives, or frames if the drives are not known, are drawn with replacement.
//!
//! The draws depend only on the seed and the number of units, so that all cells of a grid use the same draws.

use modulo_core::metric::quantile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::results::Drawn;

const DRAWS: usize = 1000;

/// The definition of the intervals for the report.
pub const DEFINITION: &str = "\
    Bootstrap: drives (frames where fewer than two drives are known, because frames of one drive are near \
    duplicates) are drawn with replacement 1000 times; the interval lies between the 2.5th and the 97.5th \
    percentile of the figure. Draws without objects are left out.";

/// The units of a data set that are drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Units {
    of_frame: Vec<usize>,
    /// The kind and the number of the units.
    pub drawn: Drawn,
    seed: u64,
}

impl Units {
    /// The units of frames whose drives are `drives`, where known.
    pub fn new(drives: &[Option<String>], seed: u64) -> Self {
        let mut names: Vec<&String> = drives.iter().flatten().collect();
        names.sort();
        names.dedup();
        // Frames of one drive are nearly the same image: drawn one by one, they would make the interval too narrow. A
        // single drive gives no second sample, so that its frames are drawn nevertheless.
        let known = names.len() >= 2 && drives.iter().all(Option::is_some);
        let place = |(frame, drive): (usize, &Option<String>)| match drive {
            Some(drive) if known => names.binary_search(&drive).expect("names are those of all drives"),
            _ => frame,
        };
        let of_frame = drives.iter().enumerate().map(place).collect();
        let drawn = if known { Drawn::Drives(names.len()) } else { Drawn::Frames(drives.len()) };
        Self { of_frame, drawn, seed }
    }

    /// The interval of `figure`, which gets the number of times that each frame was drawn. `None` with fewer than two units.
    pub fn interval(&self, figure: impl Fn(&[u64]) -> Option<f64>) -> Option<[f64; 2]> {
        let (Drawn::Drives(count) | Drawn::Frames(count)) = self.drawn;
        if count < 2 {
            return None;
        }
        // Started anew for each figure: all figures of all cells use the same draws, so that their differences are not
        // noise.
        let mut random = Pcg64::seed_from_u64(self.seed);
        let mut figures: Vec<f64> = (0..DRAWS)
            .filter_map(|_| {
                let mut times = vec![0; count];
                (0..count).for_each(|_| times[random.random_range(0..count)] += 1);
                let weights: Vec<u64> = self.of_frame.iter().map(|&unit| times[unit]).collect();
                figure(&weights)
            })
            .collect();
        figures.sort_by(f64::total_cmp);
        Some([quantile(&figures, 0.025)?, quantile(&figures, 0.975)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drives(names: &[&str]) -> Vec<Option<String>> {
        names.iter().map(|name| Some((*name).to_owned())).collect()
    }

    /// Weighted share of frames of value 1.
    fn share(values: &[f64]) -> impl Fn(&[u64]) -> Option<f64> {
        let values = values.to_vec();
        move |weights| {
            let sum: f64 = values.iter().zip(weights).map(|(v, w)| v * *w as f64).sum();
            let all: u64 = weights.iter().sum();
            (all > 0).then(|| sum / all as f64)
        }
    }

    #[test]
    fn covers_what_theory_says() {
        let values: Vec<f64> = (0..400).map(|i| f64::from(i % 2)).collect();
        let units = Units::new(&vec![None; 400], 7);
        let [low, high] = units.interval(share(&values)).expect("400 units");
        // 0.5 +- 1.96 sqrt(0.25 / 400)
        assert!((low - 0.451).abs() < 0.01 && (high - 0.549).abs() < 0.01, "{low} {high}");
        assert_eq!(units.interval(share(&values)), Some([low, high]), "the same draws again");
        assert_ne!(Units::new(&vec![None; 400], 8).interval(share(&values)), Some([low, high]));
    }

    #[test]
    fn a_drive_is_drawn_as_a_whole() {
        let units = Units::new(&drives(&["a", "a", "b", "b"]), 1);
        assert_eq!(units.drawn, Drawn::Drives(2));
        let [low, high] = units.interval(share(&[1.0, 1.0, 0.0, 0.0])).expect("two drives");
        assert_eq!((low, high), (0.0, 1.0));
        let same = units.interval(|weights| Some((weights[0] == weights[1]) as u8 as f64));
        assert_eq!(same, Some([1.0, 1.0]));
    }

    #[test]
    fn one_drive_is_no_sample_so_frames_are_drawn() {
        assert_eq!(Units::new(&drives(&["a", "a", "a"]), 1).drawn, Drawn::Frames(3));
        assert_eq!(Units::new(&[None], 1).interval(|_| Some(1.0)), None);
    }
}
