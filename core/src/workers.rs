//! [`Workers`]: the threads that a caller allows, none of them by default.
//!
//! Results never depend on how many there are: work is cut by the image, not by
//! the threads.

use rayon::iter::{IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator};
use rayon::slice::ParallelSliceMut;

/// Most threads that can be asked for.
pub const MAX_THREADS: usize = 256;

/// One thread (the caller's own), or a pool.
pub(crate) struct Workers {
    pool: Option<rayon::ThreadPool>,
}

/// Why there are no such workers.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorkersError {
    /// No thread, or too many.
    #[error("threads is {threads}, 1 to {MAX_THREADS} are possible")]
    Threads {
        /// Asked for.
        threads: usize,
    },
    /// The system refused.
    #[error("{threads} threads cannot be started: {why}")]
    Refused {
        /// Asked for.
        threads: usize,
        /// What the system said.
        why: String,
    },
}

impl Workers {
    /// `threads` in 1 to [`MAX_THREADS`]; 1 starts none.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(WorkersError::Threads { threads });
        }
        if threads == 1 {
            return Ok(Self { pool: None });
        }
        let refused =
            |why: rayon::ThreadPoolBuildError| WorkersError::Refused { threads, why: why.to_string() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(refused)?;
        Ok(Self { pool: Some(pool) })
    }

    /// The caller's own thread.
    pub fn current_thread() -> Self {
        Self { pool: None }
    }

    /// `work` on every item with its index, side by side where there are threads.
    pub fn each<T: Send>(&self, items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
        match &self.pool {
            None => items.iter_mut().enumerate().for_each(|(index, item)| work(index, item)),
            Some(pool) => {
                pool.install(|| items.par_iter_mut().enumerate().for_each(|(index, item)| work(index, item)));
            }
        }
    }

    /// `work` on `size` items of both at a time, with the index of their chunk; both are of one length.
    pub fn each_chunk<A: Send, B: Send>(
        &self,
        (a, b): (&mut [A], &mut [B]),
        size: usize,
        work: impl Fn(usize, &mut [A], &mut [B]) + Sync,
    ) {
        match &self.pool {
            None => {
                let chunks = a.chunks_mut(size).zip(b.chunks_mut(size)).enumerate();
                chunks.for_each(|(index, (a, b))| work(index, a, b));
            }
            Some(pool) => pool.install(|| {
                let chunks = a.par_chunks_mut(size).zip(b.par_chunks_mut(size)).enumerate();
                chunks.for_each(|(index, (a, b))| work(index, a, b));
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_worked_on_once() {
        for threads in [1, 2, 5] {
            let mut items = vec![1; 37];
            Workers::new(threads).unwrap().each(&mut items, |index, item| *item += index);
            assert_eq!(items, (1..38).collect::<Vec<_>>(), "{threads} threads");
        }
    }

    #[test]
    fn chunks_keep_their_place() {
        for threads in [1, 3] {
            let (mut a, mut b) = ([0; 10], [0; 10]);
            Workers::new(threads).unwrap().each_chunk((&mut a, &mut b), 4, |index, a, b| {
                a.fill(index);
                b.fill(index + a.len());
            });
            assert_eq!((a, b), ([0, 0, 0, 0, 1, 1, 1, 1, 2, 2], [4, 4, 4, 4, 5, 5, 5, 5, 4, 4]));
        }
    }

    #[test]
    fn no_thread_is_refused() {
        assert_eq!(Workers::new(0).err(), Some(WorkersError::Threads { threads: 0 }));
        assert!(Workers::new(MAX_THREADS + 1).is_err());
    }
}
