//! [`TrustFollower`]: the choice between the recovered image and another stream, by the trust of the unwrapper. A single
//! frame decides nothing, and the choice changes at most once a second.

/// Frames in a row that change the choice.
const IN_A_ROW: u32 = 5;
/// Shortest time between two changes.
const PAUSE_NS: u64 = 1_000_000_000;

/// The choice of `input: auto`; at first the recovered image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrustFollower {
    /// Whether another stream than the recovered one is the choice.
    pub falls_back: bool,
    /// Frames in a row that speak against the choice.
    against: u32,
    /// Time of the last change, ns.
    changed_ns: Option<u64>,
}

impl TrustFollower {
    /// Takes note of a frame that is trusted or not, at the time `now_ns`; returns whether the choice has changed. A
    /// frame may be that of a recording, so that the time may go back.
    pub fn note(&mut self, trusted: bool, now_ns: u64) -> bool {
        if trusted != self.falls_back {
            self.against = 0;
            return false;
        }
        self.against = self.against.saturating_add(1);
        let recent = self.changed_ns.is_some_and(|at| now_ns.abs_diff(at) < PAUSE_NS);
        if self.against < IN_A_ROW || recent {
            return false;
        }
        *self = Self { falls_back: !self.falls_back, against: 0, changed_ns: Some(now_ns) };
        true
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FRAME_NS: u64 = 100_000_000;

    /// Returns the frames, one each 100 ms, at which the choice changes.
    fn changes(trusted: impl IntoIterator<Item = bool>) -> Vec<u64> {
        let mut follower = TrustFollower::default();
        let frames = (0..).zip(trusted);
        frames.filter(|(at, trusted)| follower.note(*trusted, at * FRAME_NS)).map(|(at, _)| at).collect()
    }

    #[test]
    fn only_frames_in_a_row_change_the_choice_and_not_within_a_second() {
        let runs = |runs: &[(bool, usize)]| {
            changes(runs.iter().flat_map(|(trusted, count)| std::iter::repeat_n(*trusted, *count)))
        };
        assert_eq!(runs(&[(true, 9), (false, 4), (true, 1), (false, 4)]), [0; 0]);
        assert_eq!(runs(&[(false, 5), (true, 4), (false, 1), (true, 20)]), [4, 14]);
        assert_eq!(runs(&[(false, 5), (true, 30)]), [4, 14], "a second after the last change");
    }

    proptest! {
        #[test]
        fn two_changes_are_a_second_apart(frames in prop::collection::vec(any::<bool>(), 0..300)) {
            let changes = changes(frames);
            prop_assert!(changes.windows(2).all(|pair| pair[1] - pair[0] >= 10), "{:?}", changes);
        }
    }
}
