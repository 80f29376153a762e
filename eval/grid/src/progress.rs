//! [`GridEvent`]: what a run tells of its progress to a [`Listener`].

/// Progress of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridEvent<'a> {
    /// Work on some cells begins.
    Cell {
        /// Number of processed frames, and of all frames, over all cells of this slice.
        frames: (u64, u64),
        /// Description of the cells.
        name: &'a str,
    },
    /// A frame of the cells is finished.
    Frame,
    /// A problem that does not end the run, or what the folder already holds.
    Warning(&'a str),
}

/// What a run tells of itself, and asks.
pub struct Listener<'a> {
    /// Takes the progress.
    pub tell: &'a (dyn Fn(GridEvent<'_>) + Sync),
    /// Whether the run is to stop after the frames that it is at.
    pub stopped: &'a (dyn Fn() -> bool + Sync),
}
