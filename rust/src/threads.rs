//! Pools of threads that survive a fork.
//!
//! A fork copies the memory of a process, not its threads. In a child (of Python's `multiprocessing`, or a worker of a
//! `DataLoader`) work that is given to the parent's pool would wait for ever, so the child starts a pool of its own.

use std::mem;
use std::num::NonZeroUsize;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::ThreadPool;

use crate::error::{Error, Result};

/// The pool of all that asks for no number of threads: one for each core.
pub(crate) static SHARED: Threads = Threads { count: None, started: Mutex::new(None) };

/// A number of threads, and their pool in the process that asks for it.
#[derive(Debug)]
pub(crate) struct Threads {
    /// None: one for each core.
    count: Option<NonZeroUsize>,
    started: Mutex<Option<Started>>,
}

#[derive(Debug)]
struct Started {
    process: u32,
    pool: Arc<ThreadPool>,
}

impl Threads {
    /// Starts so many threads.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for 0 threads, or for more than the system allows.
    pub(crate) fn start(count: usize) -> Result<Self> {
        let Some(count) = NonZeroUsize::new(count) else {
            return Err(Error::Argument("threads must be at least 1, got 0".to_owned()));
        };
        let threads = Self { count: Some(count), started: Mutex::new(None) };
        threads.pool()?;
        Ok(threads)
    }

    /// Returns the threads of this process.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where the system does not start them.
    pub(crate) fn pool(&self) -> Result<Arc<ThreadPool>> {
        let mut started = self.started.lock().unwrap_or_else(PoisonError::into_inner);
        match started.take() {
            Some(here) if here.process == process::id() => {
                let pool = Arc::clone(&here.pool);
                *started = Some(here);
                return Ok(pool);
            }
            parents => mem::forget(parents), // its threads are not here to be stopped
        }
        let builder = rayon::ThreadPoolBuilder::new().num_threads(self.count.map_or(0, NonZeroUsize::get));
        let pool = builder.build().map_err(|error| {
            let count =
                self.count.map_or_else(|| "one thread for each core".to_owned(), |count| format!("{count} threads"));
            Error::Argument(format!("{count} could not be started: {error}"))
        })?;
        let pool = Arc::new(pool);
        *started = Some(Started { process: process::id(), pool: Arc::clone(&pool) });
        Ok(pool)
    }

    /// Returns how many there are, where a number was asked for.
    pub(crate) fn count(&self) -> Option<usize> {
        self.count.map(NonZeroUsize::get)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pool_is_started_once_in_a_process() {
        let threads = Threads::start(2).unwrap();
        let (first, again) = (threads.pool().unwrap(), threads.pool().unwrap());
        assert!(Arc::ptr_eq(&first, &again));
        assert_eq!(first.current_num_threads(), 2);
        assert_eq!(threads.count(), Some(2));
    }

    #[test]
    fn a_pool_of_another_process_is_left_alone() {
        let threads = Threads::start(2).unwrap();
        let parents = threads.pool().unwrap();
        threads.started.lock().unwrap().as_mut().unwrap().process ^= 1;
        let ours = threads.pool().unwrap();
        assert!(!Arc::ptr_eq(&parents, &ours));
        assert_eq!(ours.install(rayon::current_num_threads), 2);
        assert_eq!(Arc::strong_count(&parents), 2); // it was forgotten, not dropped
    }

    #[test]
    fn no_threads_are_an_error() {
        assert_eq!(Threads::start(0).unwrap_err().to_string(), "threads must be at least 1, got 0");
    }
}
