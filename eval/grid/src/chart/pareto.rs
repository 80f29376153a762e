//! The Pareto front of costs and gains.

/// Cost and gain of a choice.
pub type Candidate = (f64, f64);

/// Indices of the candidates on the front, by rising cost: each has a higher gain than all that cost no more. Of equal
/// candidates the first is taken. A candidate that is not finite is left out.
pub fn pareto_front(candidates: &[Candidate]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.retain(|&i| candidates[i].0.is_finite() && candidates[i].1.is_finite());
    // After sorting by cost, a candidate is on the front if its gain exceeds those of all candidates before it. Of
    // equal costs the higher gain comes first, so that the lower one does not enter. The sort is stable: of equal
    // candidates, the first stays the first.
    order.sort_by(|&a, &b| {
        let ((cost, gain), (other_cost, other_gain)) = (candidates[a], candidates[b]);
        cost.total_cmp(&other_cost).then(other_gain.total_cmp(&gain))
    });
    let mut most = f64::NEG_INFINITY;
    order.retain(|&i| {
        let better = candidates[i].1 > most;
        most = most.max(candidates[i].1);
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
                pairs.iter().map(|&(cost, gain)| (cost.into(), gain.into())).collect();
            let found = pareto_front(&candidates);
            for (i, one) in candidates.iter().enumerate() {
                let beaten = candidates.iter().enumerate().any(|(j, other)| {
                    let no_worse = other.0 <= one.0 && other.1 >= one.1;
                    no_worse && (other != one || j < i)
                });
                prop_assert_eq!(found.contains(&i), !beaten, "{:?} of {:?}", one, &candidates);
            }
            prop_assert!(found.windows(2).all(|w| candidates[w[0]].0 < candidates[w[1]].0));
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_on_it() {
        assert_eq!(pareto_front(&[(f64::NAN, 1.0), (1.0, f64::NAN), (2.0, 0.0)]), [2]);
    }
}
