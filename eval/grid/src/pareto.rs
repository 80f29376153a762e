//! The Pareto front: what nothing else beats in both respects.

/// What a choice costs and what it gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// Less is better.
    pub cost: f64,
    /// More is better.
    pub gain: f64,
}

/// Indices of the offers on the front, by rising cost: each gives more than all that cost no more. Of equal offers the
/// first is taken; one that is not finite never is.
pub fn front(offers: &[Offer]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..offers.len()).collect();
    order.retain(|&i| offers[i].cost.is_finite() && offers[i].gain.is_finite());
    order.sort_by(|&a, &b| {
        let (a, b) = (offers[a], offers[b]);
        a.cost.total_cmp(&b.cost).then(b.gain.total_cmp(&a.gain))
    });
    let mut most = f64::NEG_INFINITY;
    order.retain(|&i| {
        let better = offers[i].gain > most;
        most = most.max(offers[i].gain);
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
            let offers: Vec<Offer> =
                pairs.iter().map(|&(cost, gain)| Offer { cost: cost.into(), gain: gain.into() }).collect();
            let found = front(&offers);
            for (i, one) in offers.iter().enumerate() {
                let beaten = offers.iter().enumerate().any(|(j, other)| {
                    let no_worse = other.cost <= one.cost && other.gain >= one.gain;
                    no_worse && (other != one || j < i)
                });
                prop_assert_eq!(found.contains(&i), !beaten, "{:?} of {:?}", one, &offers);
            }
            prop_assert!(found.windows(2).all(|w| offers[w[0]].cost < offers[w[1]].cost));
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_on_it() {
        let offer = |cost, gain| Offer { cost, gain };
        assert_eq!(front(&[offer(f64::NAN, 1.0), offer(1.0, f64::NAN), offer(2.0, 0.0)]), [2]);
    }
}
