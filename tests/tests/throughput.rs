//! The link's bars.

use robot_tests::test_board::{ELF, elf};
use robot_tests::throughput::long_run;

/// Worst distance of two ticks from the period, microseconds.
const JITTER_US: f64 = 2.0;

// Requirement: DOC-3.1-1, DOC-4.1-2, WIRE-spi-5, WIRE-spi-6
#[test]
fn frames_at_40_hz_to_5_khz_are_all_answered() {
    for rate in [40, 333, 1_999, 4_999] {
        let run = long_run(&elf(ELF), 12_000_000, rate, 1).expect("a driving robot");
        println!("{rate} Hz: {run:?}");
        assert_eq!(run.lost, 0, "{rate} Hz: {run:?}");
        // Below the rate of the ticks the reply is as old as the frame before.
        assert!(run.stale == 0 || rate < 100, "{rate} Hz: {run:?}");
        assert!(run.jitter_us <= JITTER_US, "{rate} Hz: {run:?}");
    }
}
