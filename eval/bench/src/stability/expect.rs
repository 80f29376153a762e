//! [`Expect`]: what a method is expected to make of a scene, and the [`Verdict`] on what it made.
//!
//! Expectations are lower bounds: a method that gets better never breaks one, one that gets worse does.

use modulo_core::unwrap::Trust;

use super::measure::Score;
use super::report::Verdict;

/// From this share of exact k on a scene counts as recovered, and a claim of trust as justified.
pub const RECOVERED: f64 = 0.999;

/// What is expected of one method on one scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expect {
    /// Every k is right.
    Exact,
    /// This share of k, 0 to 1, is right, or more.
    AtLeast(f64),
    /// Every k is right but for one constant a channel.
    UpToOffset,
    /// Known to fail, for the reason given; still at least this share of k, 0 to 1, is right.
    Fails(f64, &'static str),
}

/// Whether y tells enough for k to be known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Evidence {
    /// Nothing in principle stands against it.
    Present,
    /// y is also, code for code, the modulo image of another scene in range that is nowhere steeper; says which.
    Absent(&'static str),
}

impl Expect {
    /// Holds `score` against the expectation.
    pub fn judge(self, score: &Score) -> Verdict {
        let below = |least: f64| {
            (score.exact < least)
                .then(|| format!("{} exact, {} expected", percent(score.exact), percent(least)))
        };
        let broken = match self {
            Self::Exact => below(1.0),
            Self::AtLeast(share) | Self::Fails(share, _) => below(share),
            Self::UpToOffset => (score.up_to_offset < 1.0)
                .then(|| format!("{} exact up to an offset, 100 % expected", percent(score.up_to_offset))),
        };
        match broken {
            Some(how) => Verdict::Broken(how),
            None if self.is_failure() && score.exact >= RECOVERED => Verdict::Better,
            None => Verdict::Held,
        }
    }

    /// Whether the absolute k is not expected to be found.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::UpToOffset | Self::Fails(..))
    }

    /// In words, one phrase.
    pub fn words(self) -> String {
        match self {
            Self::Exact => "exact".to_owned(),
            Self::AtLeast(share) => format!("at least {}", percent(share)),
            Self::UpToOffset => "exact up to one offset a channel".to_owned(),
            Self::Fails(share, _) => format!("fails, at least {}", percent(share)),
        }
    }

    /// Why it fails, where it does so for a reason of its own.
    pub fn reason(self) -> Option<&'static str> {
        if let Self::Fails(_, why) = self { Some(why) } else { None }
    }
}

/// The rule on trust: whoever vouches for k is right, unless nobody can know better.
pub fn judge_trust(score: &Score, evidence: Evidence) -> Verdict {
    let vouched = score.report.trust == Trust::Trusted;
    if vouched && score.exact < RECOVERED && evidence == Evidence::Present {
        return Verdict::Broken(format!("vouches for k, of which {} is exact", percent(score.exact)));
    }
    Verdict::Held
}

/// `share` in per cent, two digits, never rounded up: only 1 is "100 %".
pub fn percent(share: f64) -> String {
    let hundredths = (share * 1e4).floor() / 100.0;
    if hundredths.fract() == 0.0 { format!("{hundredths} %") } else { format!("{hundredths:.2} %") }
}

#[cfg(test)]
mod tests {
    use modulo_core::unwrap::Report;

    use super::*;

    fn score(exact: f64, up_to_offset: f64, trust: Trust) -> Score {
        Score { exact, up_to_offset, psnr: None, report: Report { trust, ..Report::default() } }
    }

    #[test]
    fn worse_is_broken_and_better_is_said() {
        let worse = |expect: Expect, exact| {
            matches!(expect.judge(&score(exact, exact, Trust::Unknown)), Verdict::Broken(_))
        };
        assert!(worse(Expect::Exact, 0.99999) && !worse(Expect::Exact, 1.0));
        assert!(worse(Expect::AtLeast(0.9), 0.89) && !worse(Expect::AtLeast(0.9), 0.9));
        assert!(worse(Expect::Fails(0.5, ""), 0.49) && !worse(Expect::Fails(0.5, ""), 0.5));
        assert_eq!(Expect::Fails(0.5, "").judge(&score(0.9991, 1.0, Trust::Unknown)), Verdict::Better);
        assert_eq!(Expect::UpToOffset.judge(&score(0.0, 1.0, Trust::Unknown)), Verdict::Held);
        assert_eq!(Expect::UpToOffset.judge(&score(1.0, 1.0, Trust::Unknown)), Verdict::Better);
        assert!(worse(Expect::UpToOffset, 0.9));
    }

    #[test]
    fn only_absent_evidence_excuses_false_trust() {
        let wrong = score(0.99, 1.0, Trust::Trusted);
        assert!(matches!(judge_trust(&wrong, Evidence::Present), Verdict::Broken(_)));
        assert_eq!(judge_trust(&wrong, Evidence::Absent("flat")), Verdict::Held);
        assert_eq!(judge_trust(&score(0.99, 1.0, Trust::Contradicted), Evidence::Present), Verdict::Held);
        assert_eq!(judge_trust(&score(0.99, 1.0, Trust::Unknown), Evidence::Present), Verdict::Held);
        assert_eq!(judge_trust(&score(1.0, 1.0, Trust::Trusted), Evidence::Present), Verdict::Held);
    }

    #[test]
    fn only_all_is_a_hundred() {
        assert_eq!(percent(1.0), "100 %");
        assert_eq!(percent(0.999999), "99.99 %");
        assert_eq!(percent(0.5), "50 %");
    }
}
