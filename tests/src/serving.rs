//! The release ELF's robot, served to clients at a quarter of real time, so that a loaded computer keeps up.

use std::thread;

use pilot::mapping::BODY_MM;
use pilot::serve::control::{self, Options};
use pilot::serve::hub::Hub;
use twin::Board;
use twin::plant::Sides;

use crate::exploration::{READY_MS, settings};
use crate::test_board::{BRIDGES, Rig, take_writes};

/// Serves a robot in Guarded Velocity in the default room while the scenario runs.
pub fn serve(scenario: impl FnOnce(&Hub, &Board) + Send) {
    let image = settings().expect("accepted").image().clone();
    // On a thread of its own, which keeps to one processor: clients, a browser among them, may use all.
    let rig = thread::spawn(move || Rig::configured(image.0.to_vec()));
    let rig = rig.join().expect("a robot");
    for (_, port, _) in BRIDGES {
        rig.trace_writes(port);
    }
    let (hub, events) = Hub::new();
    let mut io = rig.io();
    let end = io.interrupt.raised_on_drop();
    let options = Options {
        rate_hz: 40,
        ready_timeout_ms: READY_MS,
        body_mm: BODY_MM,
        speed: Some(0.25),
        journal: None,
    };
    let board = rig.board.clone();
    thread::scope(|scope| {
        let scenario = scope.spawn(move || {
            let _end = end;
            scenario(&hub, &board);
        });
        control::run(&mut io, &options, events).expect("a robot that answers");
        if let Err(panic) = scenario.join() {
            std::panic::resume_unwind(panic);
        }
    });
}

/// Virtual time from `since_us` until both motors get nothing, microseconds. Of the firmware's own writes:
/// this thread may look at the board long after them.
pub fn stopped_after(board: &Board, since_us: u64) -> u64 {
    while board.truth().duty != Sides::default() {
        let after_us = board.now_us().saturating_sub(since_us);
        assert!(after_us < 5_000_000, "the motors do not stop");
        thread::sleep(std::time::Duration::from_millis(2));
    }
    let mut writes = take_writes(board).into_iter();
    let stop = writes.rfind(|write| {
        let mut bridges = BRIDGES.iter();
        bridges.any(|&(_, port, inputs)| port == write.address && write.value & inputs != 0)
    });
    (stop.expect("the inputs fell").at_ns / 1000).saturating_sub(since_us)
}

/// Waits until both wheels turn.
pub fn await_motion(board: &Board) {
    let ends_us = board.now_us() + 10_000_000;
    loop {
        let duty = board.truth().duty;
        if duty.left != 0.0 && duty.right != 0.0 {
            return;
        }
        assert!(board.now_us() < ends_us, "the motors do not start");
        thread::sleep(std::time::Duration::from_millis(2));
    }
}
