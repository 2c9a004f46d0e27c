//! Faults that no part of the robot notices, but the robot as a whole.

use crate::{percent, Bench};
use fw_core::types::Faults;
use fw_core::wire::{Command, Mode};

// Requirement: WIRE-fault-10, WIRE-log-2
#[test]
fn dropped_lines_are_a_fault_and_after_it_was_cleared_only_new_ones_are() {
    let mut bench = Bench::new(Mode::GuardedTuneRotate, |_| {});
    let lost = |bench: &Bench| bench.robot.faults().intersects(Faults::LOG_DROPPED);
    // A line a tick, and nobody takes them: 1 KiB is full within half a second.
    for _ in 0..100 {
        bench.frame(&percent(0.0));
        let dropped = bench.log.dropped();
        bench.tick();
        assert_eq!(lost(&bench), dropped > 0, "{dropped} by then");
        // Nothing has left: all that waits is in one piece.
        let waiting = bench.log.pending().len();
        assert!(dropped == 0 || (980..=1024).contains(&waiting), "{waiting}");
    }
    assert!(lost(&bench), "{}", bench.log.dropped());
    let _ = bench.said();
    // The last tick's own lines.
    bench.tick();
    let report = bench.frame(&Command {
        clear_faults: Faults::LOG_DROPPED,
        ..Command::default()
    });
    assert!(report.faults.intersects(Faults::LOG_DROPPED));
    for _ in 0..100 {
        bench.frame(&percent(0.0));
        bench.tick();
        assert!(bench.said().contains(": T "));
        assert!(!lost(&bench), "what was cleared stays so");
    }
    while bench.log.dropped() < 200 {
        bench.frame(&percent(0.0));
        bench.tick();
    }
    assert!(lost(&bench), "new ones count anew");
}
