//! Evaluation in lockstep: bag in, numbers out.
