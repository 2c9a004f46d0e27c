//! The processor that the threads of a board share.

use std::sync::{Mutex, PoisonError};

use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

/// The processor of each thread that keeps to one.
static KEPT: Mutex<Vec<usize>> = Mutex::new(Vec::new());

/// Keeps this thread, and those that it starts from now on, to one processor for as long as it runs.
///
/// The emulator's thread and the one that drives the board take turns; on one processor a turn wakes no
/// other processor, and an exploration takes a quarter less time. Of the threads of a process that keep
/// to one, each gets a processor that the fewest of them have. A system that refuses changes nothing.
pub fn keep_to_one() {
    thread_local! {
        static PLACE: Place = Place::take();
    }
    PLACE.with(|_| ());
}

struct Place(Option<usize>);

impl Place {
    fn take() -> Self {
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let (allowed, here) = (sched_getaffinity(None).unwrap_or_default(), sched_getcpu());
        let threads = |cpu| kept.iter().filter(|kept| **kept == cpu).count();
        let cpus = (0..CpuSet::MAX_CPU).filter(|&cpu| allowed.is_set(cpu));
        let Some(cpu) = cpus.min_by_key(|&cpu| (threads(cpu), cpu != here)) else {
            return Self(None);
        };
        let mut one = CpuSet::new();
        one.set(cpu);
        if sched_setaffinity(None, &one).is_err() {
            return Self(None);
        }
        kept.push(cpu);
        Self(Some(cpu))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = kept.iter().position(|kept| Some(*kept) == self.0) {
            kept.swap_remove(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_share_processors_evenly_and_give_them_back() {
        let allowed = sched_getaffinity(None).unwrap();
        let places: Vec<_> = std::thread::scope(|scope| {
            let takes = (0..2 * allowed.count()).map(|_| scope.spawn(Place::take));
            let takes: Vec<_> = takes.collect();
            takes.into_iter().map(|take| take.join().unwrap()).collect()
        });
        let of = |cpu| places.iter().filter(|place| place.0 == Some(cpu)).count();
        for cpu in 0..CpuSet::MAX_CPU {
            assert_eq!(of(cpu), 2 * usize::from(allowed.is_set(cpu)), "{cpu}");
        }
        drop(places);
        assert_eq!(*KEPT.lock().unwrap(), []);
        let kept = std::thread::spawn(|| {
            keep_to_one();
            keep_to_one();
            assert_eq!(KEPT.lock().unwrap().len(), 1);
            std::thread::spawn(|| sched_getaffinity(None).unwrap().count())
        });
        assert_eq!(kept.join().unwrap().join().unwrap(), 1);
        assert_eq!(*KEPT.lock().unwrap(), []);
    }
}
