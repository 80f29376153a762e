//! The Pareto front of cost and gain.

/// Cost and gain of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Lower is better.
    pub cost: f64,
    /// Higher is better.
    pub gain: f64,
}

/// Indices of the candidates on the front, by rising cost: each has a higher gain than all that cost no more. Of equal
/// candidates the first is taken. A candidate that is not finite is left out.
pub fn front(candidates: &[Candidate]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.retain(|&i| candidates[i].cost.is_finite() && candidates[i].gain.is_finite());
    order.sort_by(|&a, &b| {
        let (a, b) = (candidates[a], candidates[b]);
        a.cost.total_cmp(&b.cost).then(b.gain.total_cmp(&a.gain))
    });
    let mut most = f64::NEG_INFINITY;
    order.retain(|&i| {
        let better = candidates[i].gain > most;
        most = most.max(candidates[i].gain);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_offer_is_on_the_front_unless_another_beats_it(
            pairs in prop::collection::vec((0u8..8, 0u8..8), 0..20),
        ) {
            let candidates: Vec<Candidate> =
                pairs.iter().map(|&(cost, gain)| Candidate { cost: cost.into(), gain: gain.into() }).collect();
            let found = front(&candidates);
            for (i, one) in candidates.iter().enumerate() {
                let beaten = candidates.iter().enumerate().any(|(j, other)| {
                    let no_worse = other.cost <= one.cost && other.gain >= one.gain;
                    no_worse && (other != one || j < i)
                });
                prop_assert_eq!(found.contains(&i), !beaten, "{:?} of {:?}", one, &candidates);
            }
            prop_assert!(found.windows(2).all(|w| candidates[w[0]].cost < candidates[w[1]].cost));
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_on_it() {
        let candidate = |cost, gain| Candidate { cost, gain };
        assert_eq!(front(&[candidate(f64::NAN, 1.0), candidate(1.0, f64::NAN), candidate(2.0, 0.0)]), [2]);
    }
}
