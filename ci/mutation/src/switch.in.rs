
extern crate std as mutant_std;

/// The number of the mutant that is on; 0 is none.
#[doc(hidden)]
#[inline]
pub const fn active_mutant() -> u32 {
    const fn calculated() -> u32 {
        0
    }
    #[inline]
    fn running() -> u32 {
        use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
        static ON: AtomicU32 = AtomicU32::new(u32::MAX);
        let on = ON.load(Relaxed);
        if on != u32::MAX {
            return on;
        }
        let on = mutant_std::env::var("MUTANT").ok().and_then(|on| on.parse().ok()).unwrap_or(0);
        ON.store(on, Relaxed);
        on
    }
    core::intrinsics::const_eval_select((), calculated, running)
}

// Both sides once, before the choice: a sum of sums would double with every bracket.
#[doc(hidden)]
#[macro_export]
macro_rules! mutant_operation {
    ($l:expr, $op:tt [$($on:literal $other:tt),*], $r:expr) => {{
        let (l, r) = ($l, $r);
        match $crate::active_mutant() { $($on => l $other r,)* _ => l $op r }
    }};
}

// A comparison takes nothing away from what it compares.
#[doc(hidden)]
#[macro_export]
macro_rules! mutant_comparison {
    ($l:expr, $op:tt [$($on:literal $other:tt),*], $r:expr) => {
        match (&$l, &$r) {
            (l, r) => match $crate::active_mutant() { $($on => *l $other *r,)* _ => *l $op *r },
        }
    };
}

// The right side only where the left one does not decide.
#[doc(hidden)]
#[macro_export]
macro_rules! mutant_logic {
    ($l:expr, $op:tt [$($on:literal $other:tt),*], $r:expr) => {
        match $crate::active_mutant() { $($on => $l $other $r,)* _ => $l $op $r }
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! mutant_assignment {
    ($l:expr, $op:tt [$($on:literal $other:tt),*], $r:expr) => {{
        let r = $r;
        match $crate::active_mutant() { $($on => $l $other r,)* _ => $l $op r }
    }};
}

#[doc(hidden)]
#[macro_export]
macro_rules! mutant_sign {
    ($on:literal, $op:tt, $e:expr) => {{
        let e = $e;
        match $crate::active_mutant() { $on => e, _ => $op e }
    }};
}
