//! A grid of evaluations: every combination of stream, method, lens, alpha, noise, model and input size over the
//! same labelled frames, each through the suite's own steps in lockstep.
//!
//! Cells do not depend on each other: what is done is kept, a killed run goes
//! on, and shards are put together by [`merge`]. Nothing here goes through a
//! transport; the clock that is lent measures stages and decides nothing.

mod axes;
mod chain;
mod error;
mod exposures;
mod eye;
mod frames;
mod merge;
mod moment;
mod nodes;
mod paper;
mod recovery;
mod run;
mod score;
mod seen;
mod setup;
mod show;

use std::path::PathBuf;

use modulo_detector::EngineChoice;

pub use axes::Axes;
pub use error::GridError;
pub use exposures::CAPTURES;
pub use merge::merge;
pub use nodes::{Nodes, Suite};
pub use run::run;
pub use show::show;

use crate::classes::{ClassMap, Groups};
use crate::data::Data;
use crate::results::{Difficulty, Protocol, Results};

/// Bits of the simulated sensor.
const BITS: u8 = 8;
/// Least score of a detection: AP needs the doubtful ones too.
const LEAST_SCORE: f64 = 0.001;

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct Request {
    /// The labelled frames.
    pub data: Data,
    /// What is varied.
    pub axes: Axes,
    /// The way of a frame to the detector.
    pub protocol: Protocol,
    /// Model's classes to the labels'; `None`: as the data asks for.
    pub class_map: Option<ClassMap>,
    /// Classes of the labels to groups.
    pub groups: Groups,
    /// Objects that count; `None`: as the data asks for.
    pub difficulty: Option<Difficulty>,
    /// The inference engine.
    pub engine: EngineChoice,
    /// Threads of one inference, 1 or more.
    pub threads: usize,
    /// Frames worked on side by side, 1 or more.
    pub jobs: usize,
    /// Name of the processor, for the results.
    pub processor: String,
    /// Of noise and bootstrap.
    pub seed: u64,
    /// The cells that are this process's.
    pub shard: Shard,
    /// Folder for the results.
    pub out: PathBuf,
}

/// Part `index` of `of`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// 1 to `of`.
    pub index: usize,
    /// At least 1.
    pub of: usize,
}

impl Shard {
    /// All cells.
    pub const WHOLE: Self = Self { index: 1, of: 1 };

    fn has(self, cell: usize) -> bool {
        cell % self.of.max(1) + 1 == self.index
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    /// Reads `i/n`.
    fn from_str(text: &str) -> Result<Self, String> {
        let pair = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match pair {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index, of }),
            _ => Err("must be i/n with 1 <= i <= n, such as 2/8".to_owned()),
        }
    }
}

/// What a grid tells while it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// So many cells were there already.
    Resumed {
        /// Cells.
        cells: usize,
    },
    /// A cell begins.
    Cell {
        /// Frames of all cells that are over, and of all cells that are to be done.
        frames: (u64, u64),
        /// For people.
        name: &'a str,
    },
    /// A frame of it is over.
    Frame,
    /// Something is doubtful.
    Warning(&'a str),
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// As in the folder.
    pub results: Results,
    /// Frames without an answer, over all cells.
    pub unanswered: usize,
}

impl Outcome {
    /// Whether something was left out.
    pub fn lost(&self) -> bool {
        self.unanswered > 0 || !self.results.input.warnings.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_in_one_shard() {
        for of in 1..5 {
            for cell in 0..20 {
                assert_eq!((1..=of).filter(|&index| Shard { index, of }.has(cell)).count(), 1);
            }
        }
    }

    #[test]
    fn a_shard_is_counted_from_one() {
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, of: 8 }));
        for bad in ["", "0/2", "3/2", "1", "1/0", "a/b", "-1/2"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }
}
