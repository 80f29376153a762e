//! [`Workers`]: the threads that a caller allows; by default only its own.
//!
//! Results never depend on the number of threads: they share the work by parts of the image. All methods of a process that allow the
//! same number share one pool.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use rayon::iter::{IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator};
use rayon::slice::ParallelSliceMut;

/// The largest number of threads.
pub const MAX_THREADS: usize = 64;

/// The pools that methods use, one for each number of threads.
static POOLS: Mutex<Vec<Weak<rayon::ThreadPool>>> = Mutex::new(Vec::new());

/// The caller's own thread, or a pool.
pub(crate) struct Workers {
    pool: Option<Arc<rayon::ThreadPool>>,
}

/// Error: the threads are not available.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorkersError {
    /// The number of threads is out of range.
    #[error("threads is {0}, 1 to {MAX_THREADS} are possible")]
    Threads(usize),
    /// The operating system refused to start this number of threads, with this error.
    #[error("{0} threads cannot be started: {1}")]
    Refused(usize, String),
}

impl Workers {
    /// Takes the pool of `threads` threads, 1 to [`MAX_THREADS`], or starts it; for 1 none is started.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(WorkersError::Threads(threads));
        }
        // A pool of one thread would do the same work and add a hand-over to each call.
        if threads == 1 {
            return Ok(Self { pool: None });
        }
        let refused = |why: rayon::ThreadPoolBuildError| WorkersError::Refused(threads, why.to_string());
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        pools.retain(|pool| pool.strong_count() > 0);
        let mut alive = pools.iter().filter_map(Weak::upgrade);
        if let Some(pool) = alive.find(|pool| pool.current_num_threads() == threads) {
            return Ok(Self { pool: Some(pool) });
        }
        let builder =
            rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|at| format!("worker-{at}"));
        let pool = Arc::new(builder.build().map_err(refused)?);
        pools.push(Arc::downgrade(&pool));
        Ok(Self { pool: Some(pool) })
    }

    /// Calls `work` with every item and its index, in parallel if there are threads.
    pub fn each<T: Send>(&self, items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
        match &self.pool {
            None => items.iter_mut().enumerate().for_each(|(index, item)| work(index, item)),
            Some(pool) => {
                pool.install(|| items.par_iter_mut().enumerate().for_each(|(index, item)| work(index, item)));
            }
        }
    }

    /// Calls `work` with chunks of `size` items of both slices, which have equal lengths, and the index of the chunk.
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
    fn all_methods_of_a_process_share_one_pool() {
        let threads = || {
            let tasks = std::fs::read_dir("/proc/self/task").expect("Linux").flatten();
            let name = |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("comm"));
            tasks.filter_map(|task| name(task).ok()).filter(|name| name.starts_with("worker-")).count()
        };
        let options = crate::unwrap::Options { threads: 23, ..Default::default() };
        let before = threads();
        let methods: Vec<_> =
            crate::unwrap::METHODS.iter().map(|name| crate::unwrap::by_name(name, &options)).collect();
        assert!(methods.iter().all(Result::is_ok));
        // Other tests of this process start and end pools of few threads.
        let started = threads() - before.min(threads());
        assert!((10..40).contains(&started), "{started} threads for {} methods", methods.len());
    }

    #[test]
    fn no_thread_is_refused() {
        assert_eq!(Workers::new(0).err(), Some(WorkersError::Threads(0)));
        assert!(Workers::new(MAX_THREADS + 1).is_err());
    }
}
