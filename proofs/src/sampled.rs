//! The sampling driver: a property on inputs drawn from pseudo-random bytes, simplified on failure.

use core::cell::Cell;
use core::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use crate::input::Biased;
use crate::property::Seen;

/// Bytes an input is drawn from; a configuration takes some 500. Bytes beyond would read as zero and
/// fix a property's last inputs, so drawing all of them fails.
const BYTES: usize = 4096;

/// Runs `property` on `count` inputs. Panics with the simplest input found that breaks it, or with
/// the case that none of them met.
pub(crate) fn sample<T: Debug>(
    count: u32,
    cases: &[&str],
    draw: impl Fn(&mut Biased<'_>) -> T,
    property: impl Fn(T) -> Seen,
) {
    // A fixed seed: every run tries the same inputs.
    let mut random = fastrand::Rng::with_seed(0x5EED);
    let mut bytes = vec![0; BYTES];
    let mut seen = Seen::NOTHING;
    let evaluate = |bytes: &[u8]| {
        let mut source = Biased::new(bytes);
        let input = draw(&mut source);
        assert!(!source.is_spent(), "{BYTES} bytes are too few to draw from");
        property(input)
    };
    for _ in 0..count {
        random.fill(&mut bytes);
        if let Some(met) = quietly(|| evaluate(&bytes)) {
            seen = seen.and(met);
        } else {
            simplify(&mut bytes, |bytes| quietly(|| evaluate(bytes)).is_none());
            println!("fails for {:#?}", draw(&mut Biased::new(&bytes)));
            let _ = evaluate(&bytes);
        }
    }
    every_case_was_met(seen, cases);
}

/// Sets ever shorter chunks of `bytes` to zero as long as the input `fails`.
fn simplify(bytes: &mut [u8], fails: impl Fn(&[u8]) -> bool) {
    for length in [1024, 128, 16, 1] {
        for at in (0..bytes.len()).step_by(length) {
            let chunk = bytes[at..at + length].to_vec();
            bytes[at..at + length].fill(0);
            if !fails(bytes) {
                bytes[at..at + length].copy_from_slice(&chunk);
            }
        }
    }
}

/// The value of `evaluate`, or `None` where it panics; the panic is not printed.
fn quietly(evaluate: impl FnOnce() -> Seen) -> Option<Seen> {
    thread_local! {
        static QUIET: Cell<bool> = const { Cell::new(false) };
    }
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let print = take_hook();
        set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                print(panic);
            }
        }));
    });
    QUIET.set(true);
    let value = catch_unwind(AssertUnwindSafe(evaluate)).ok();
    QUIET.set(false);
    value
}

/// The tests' own cover check: a case that no input met leaves a part of the property untested.
pub(crate) fn every_case_was_met(seen: Seen, cases: &[&str]) {
    for (number, case) in (0..).zip(cases) {
        assert!(seen.has(number), "no input met the case: {case}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::Input as _;

    #[test]
    #[should_panic(expected = "1 is odd")]
    fn failing_sample_is_simplified() {
        sample(
            100,
            &[],
            |source| u8::draw(source),
            |value| {
                assert!(value % 2 == 0, "{} is odd", value % 2);
                Seen::NOTHING
            },
        );
    }
}
