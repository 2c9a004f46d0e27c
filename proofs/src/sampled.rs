//! The sampling driver: a property on drawn inputs, shrunk by proptest when one fails.

use core::fmt::Debug;

use proptest::strategy::{NewTree, Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};

use crate::input::Biased;
use crate::property::Seen;

/// Bytes an input is drawn from; a configuration takes some 500. What lies beyond would read as zero,
/// and a property's last inputs would hardly ever be anything else: drawing that much fails.
const NOISE: usize = 4096;

/// Runs `property` on `count` inputs. Panics with the simplest input found that breaks it, or with
/// the case that none of them met.
pub(crate) fn sample<T: Debug>(
    count: u32,
    cases: &[&str],
    draw: impl Fn(&mut Biased<'_>) -> T,
    property: impl Fn(T) -> Seen,
) {
    let config = Config {
        cases: count,
        max_shrink_iters: 20_000,
        failure_persistence: None,
        ..Config::default()
    };
    // The same inputs every time: a gate that fails only sometimes is no gate.
    let random = TestRng::deterministic_rng(RngAlgorithm::XorShift);
    let mut runner = TestRunner::new_with_rng(config, random);
    let seen = core::cell::Cell::new(Seen::NOTHING);
    quiet();
    SHRINKING.set(true);
    let run = runner.run(&Noise, |noise| {
        let mut source = Biased::new(&noise);
        let input = draw(&mut source);
        assert!(!source.is_spent(), "{NOISE} bytes are too few to draw from");
        let met = property(input);
        seen.set(seen.get().and(met));
        Ok::<(), TestCaseError>(())
    });
    SHRINKING.set(false);
    match run {
        Ok(()) => every_case_was_met(seen.get(), cases),
        Err(TestError::Fail(reason, noise)) => {
            panic!("{reason}\nfor {:#?}", draw(&mut Biased::new(&noise)))
        }
        Err(TestError::Abort(reason)) => panic!("{reason}"),
    }
}

thread_local! {
    static SHRINKING: core::cell::Cell<bool> = const { core::cell::Cell::new(false) };
}

/// Shrinking makes a property fail many times over; only the last failure is worth a word.
fn quiet() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let loud = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !SHRINKING.get() {
                loud(panic);
            }
        }));
    });
}

/// The test's own cover check: a case that nothing met means that the property said nothing of it.
pub(crate) fn every_case_was_met(seen: Seen, cases: &[&str]) {
    for (number, case) in (0..).zip(cases) {
        assert!(seen.has(number), "no input met the case: {case}");
    }
}

/// Random bytes that shrink towards zeros.
#[derive(Debug)]
struct Noise;

impl Strategy for Noise {
    type Tree = NoiseTree;
    type Value = Vec<u8>;

    fn new_tree(&self, runner: &mut TestRunner) -> NewTree<Self> {
        use proptest::prelude::Rng as _;
        let mut bytes = vec![0; NOISE];
        runner.rng().fill_bytes(&mut bytes);
        Ok(NoiseTree {
            bytes,
            at: 0,
            before: None,
        })
    }
}

/// Simplifies one byte after the other: to zero, else to ever smaller halves.
#[derive(Debug)]
struct NoiseTree {
    bytes: Vec<u8>,
    at: usize,
    before: Option<u8>,
}

impl ValueTree for NoiseTree {
    type Value = Vec<u8>;

    fn current(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    fn simplify(&mut self) -> bool {
        while let Some(byte) = self.bytes.get_mut(self.at) {
            if *byte != 0 {
                self.before = Some(*byte);
                *byte = 0;
                return true;
            }
            self.at += 1;
        }
        false
    }

    fn complicate(&mut self) -> bool {
        let (Some(byte), Some(before)) = (self.bytes.get_mut(self.at), self.before) else {
            return false;
        };
        // Between what passed and what failed, a step nearer to what failed.
        *byte += (before - *byte).div_ceil(2);
        if *byte == before {
            self.at += 1;
            self.before = None;
        }
        true
    }
}
