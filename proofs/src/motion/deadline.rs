//! T8: silence stops the robot, and only an explicit command restarts it.
//!
//! What came before is a fresh frame, a fault and a tick at most, of any kind and time: longer histories are those
//! of `proofs/tests/deadline_model.rs`.

use fw_core::motion::StopDeadline;
use fw_core::robot::{AllowedMotion, Halt, Supervisor, SupervisorCommand};
use fw_core::wire::{Order, State};

use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Faults, Micros, Milliseconds};

/// Largest time between ticks, microseconds: half the clock's range. The hardware's tick is 10 ms, and
/// the watchdog enforces it.
pub const TICKS_WITHIN: u32 = 1 << 31;

/// Short history of a supervisor.
#[derive(Clone, Copy, Debug)]
pub struct Past {
    /// The configured deadline, ms.
    pub deadline: u16,
    /// A first fresh frame.
    pub first: Option<SupervisorCommand>,
    /// Its time.
    pub at: Micros,
    /// Faults raised.
    pub faults: Faults,
    /// A tick so many microseconds after it.
    pub tick: Option<u32>,
}

structures! {
    SupervisorCommand { resumes, order, clear_faults }
    Past { deadline, first, at, faults, tick }
}

impl Past {
    fn supervisor(&self) -> Supervisor {
        let mut supervisor = Supervisor::new(StopDeadline::new(Milliseconds(self.deadline)));
        if let Some(intent) = self.first {
            supervisor.on_fresh(self.at, intent);
        }
        supervisor.raise(self.faults);
        if let Some(after) = self.tick {
            let _ = supervisor.on_tick(self.at.after(after), true, true);
        }
        supervisor
    }
}

/// After a fresh frame, the first tick at or after the deadline brakes and latches the fault, for any
/// [`Past`], stopped or driving, and across the clock's wrap.
// Requirement: WIRE-deadline-1
pub fn silence_brakes(
    past: Past,
    fresh: Micros,
    intent: SupervisorCommand,
    early: u32,
    silence: u32,
) -> Seen {
    let allowed = u32::from(past.deadline) * 1000;
    given!(silence >= allowed && silence < TICKS_WITHIN && early < allowed);
    let mut supervisor = past.supervisor();
    supervisor.on_fresh(fresh, intent);
    let in_time = supervisor.on_tick(fresh.after(early), true, true);
    let permit = supervisor.on_tick(fresh.after(silence), true, true);
    assert!(permit == AllowedMotion::Brake);
    assert!(supervisor.halted());
    let blocked = supervisor.faults().intersects(Faults::BLOCKING);
    assert!(blocked != (supervisor.halt() == Halt::Silence));
    assert!(blocked == (supervisor.state() == State::Faulted));
    assert!(blocked != (supervisor.state() == State::Stopped));
    assert!(supervisor.faults().intersects(Faults::LINK_LOST));
    Seen::NOTHING
        .case(0, in_time == AllowedMotion::Drive)
        .case(1, blocked)
        .case(2, fresh.after(silence).0 < fresh.0)
}

/// A stop ends only with a fresh frame: not with any tick, clock value or fault.
// Requirement: WIRE-deadline-2
pub fn stop_lasts(past: Past, one: Micros, raised: Faults, two: Micros, requested: bool) -> Seen {
    let mut supervisor = past.supervisor();
    given!(supervisor.halted());
    let first = supervisor.on_tick(one, true, true);
    supervisor.raise(raised);
    let second = supervisor.on_tick(two, requested, true);
    assert!(first == AllowedMotion::Brake && second == AllowedMotion::Brake);
    assert!(supervisor.halted());
    assert!(supervisor.faults() & raised == raised);
    Seen::NOTHING
        .case(0, supervisor.faults().intersects(Faults::LINK_LOST))
        .case(1, supervisor.state() == State::Stopped)
        .case(2, supervisor.state() == State::Faulted)
}

/// A stop ends only with an explicit command in a fresh frame (apply, 0 % or resume), and never while a
/// blocking fault is latched.
// Requirement: WIRE-deadline-2
pub fn only_an_explicit_command_resumes(
    past: Past,
    fresh: Micros,
    intent: SupervisorCommand,
    after: u32,
) -> Seen {
    let mut supervisor = past.supervisor();
    given!(supervisor.halted());
    supervisor.on_fresh(fresh, intent);
    let permit = supervisor.on_tick(fresh.after(after), true, true);
    let command = resumes(intent);
    let blocked = supervisor.faults().intersects(Faults::BLOCKING);
    if !command || blocked {
        assert!(permit == AllowedMotion::Brake);
    }
    seen!(permit == AllowedMotion::Drive, !command, command && blocked)
}

/// A restarted firmware stands, whatever the first frame clears, unless that frame resumes it.
// Requirement: WIRE-safe-2
pub fn restarted_robot_stands_until_resumed(
    deadline: u16,
    fresh: Micros,
    first: SupervisorCommand,
    after: u32,
) -> Seen {
    let mut supervisor = Supervisor::new(StopDeadline::new(Milliseconds(deadline)));
    supervisor.raise(Faults::RESTARTED);
    supervisor.on_fresh(fresh, first);
    let permit = supervisor.on_tick(fresh.after(after), true, true);
    let command = resumes(first);
    assert!(permit == AllowedMotion::Brake || command);
    let cleared = !supervisor.faults().intersects(Faults::RESTARTED);
    seen!(
        permit == AllowedMotion::Drive,
        !command && cleared,
        first.order == Order::Stop
    )
}

/// Whether a frame tells a stopped robot to go on.
fn resumes(command: SupervisorCommand) -> bool {
    command.order == Order::Resume || (command.order == Order::None && command.resumes)
}

/// A blocking fault brakes even if it is cleared before the next tick: like any stop it ends with an
/// explicit command.
// Requirement: WIRE-status-1
pub fn fault_brakes_even_if_cleared_at_once(
    past: Past,
    raised: Faults,
    fresh: Micros,
    clear: Faults,
    after: u32,
) -> Seen {
    let mut supervisor = past.supervisor();
    supervisor.raise(raised);
    given!(supervisor.faults().intersects(Faults::BLOCKING));
    let cured = SupervisorCommand {
        resumes: false,
        order: Order::None,
        clear_faults: clear,
    };
    supervisor.on_fresh(fresh, cured);
    assert!(supervisor.on_tick(fresh.after(after), true, true) == AllowedMotion::Brake);
    Seen::NOTHING
        .case(0, supervisor.state() == State::Faulted)
        .case(1, supervisor.state() == State::Stopped)
}

/// A frame after the deadline does not undo the stop, even before the next tick.
// Requirement: WIRE-deadline-2
pub fn late_frame_does_not_undo_the_stop(past: Past, fresh: Micros, silence: u32) -> Seen {
    let allowed = u32::from(past.deadline) * 1000;
    given!(silence >= allowed && silence < TICKS_WITHIN);
    let mut supervisor = past.supervisor();
    let apply = SupervisorCommand {
        resumes: true,
        order: Order::Resume,
        clear_faults: Faults::NONE,
    };
    supervisor.on_fresh(fresh, apply);
    supervisor.on_fresh(fresh.after(silence), SupervisorCommand::default());
    assert!(supervisor.on_tick(fresh.after(silence), true, true) == AllowedMotion::Brake);
    Seen::NOTHING
        .case(0, supervisor.state() == State::Stopped)
        .case(1, supervisor.state() == State::Faulted)
}

/// The fault of silence is latched exactly when a deadline passed since it was cleared, by a frame that
/// clears it or that resumes in a mode without orders: not before the first frame, not twice.
// Requirement: WIRE-deadline-1, WIRE-deadline-4
pub fn silence_is_latched_until_cleared(
    past: Past,
    fresh: Micros,
    silence: u32,
    intent: SupervisorCommand,
    after: u32,
) -> Seen {
    let allowed = u32::from(past.deadline) * 1000;
    given!(silence < TICKS_WITHIN && after < allowed);
    let mut supervisor = past.supervisor();
    supervisor.on_fresh(fresh, SupervisorCommand::default());
    let before = supervisor.faults();
    let late = fresh.after(silence);
    supervisor.on_fresh(late, intent);
    let resumed = intent.order == Order::None && intent.resumes;
    let cleared = resumed || intent.clear_faults.intersects(Faults::LINK_LOST);
    let lost = before.intersects(Faults::LINK_LOST) || silence >= allowed;
    assert!(supervisor.faults().intersects(Faults::LINK_LOST) == (lost && !cleared));
    let _ = supervisor.on_tick(late.after(after), true, true);
    assert!(supervisor.faults().intersects(Faults::LINK_LOST) == (lost && !cleared));
    let others = Faults::ALL_BITS.difference(Faults::LINK_LOST);
    assert!(supervisor.faults() & others == before.difference(intent.clear_faults) & others);
    seen!(silence >= allowed && !cleared, lost && cleared, !lost)
}

/// Frames within the deadline never stop the robot.
pub fn fresh_frames_keep_it_going(deadline: u16, fresh: Micros, gaps: [u16; 2]) -> Seen {
    let allowed = u32::from(deadline) * 1000;
    let apply = SupervisorCommand {
        resumes: true,
        order: Order::Resume,
        clear_faults: Faults::NONE,
    };
    let mut supervisor = Supervisor::new(StopDeadline::new(Milliseconds(deadline)));
    supervisor.on_fresh(fresh, apply);
    let mut now = fresh;
    for gap in gaps {
        let gap = u32::from(gap) * 64;
        given!(gap < allowed);
        now = now.after(gap);
        assert!(supervisor.on_tick(now, true, true) == AllowedMotion::Drive);
        supervisor.on_fresh(now, SupervisorCommand::default());
    }
    assert!(supervisor.faults().is_empty() && supervisor.state() == State::Moving);
    Seen::NOTHING.case(0, now.0 < fresh.0).case(1, gaps[0] > 0)
}

crate::properties! {
    theorem T8 silence_brakes(past: Past, fresh: Micros, intent: SupervisorCommand, early: u32, silence: u32) {
        cases ["it was driving", "a fault blocks as well", "across the clock's wrap"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 stop_lasts(past: Past, one: Micros, raised: Faults, two: Micros, requested: bool) {
        cases ["for a lost link", "stopped", "faulted"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 only_an_explicit_command_resumes(past: Past, fresh: Micros, intent: SupervisorCommand, after: u32) {
        cases ["resumed", "no command", "a command against a fault"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 restarted_robot_stands_until_resumed(
        deadline: u16, fresh: Micros, first: SupervisorCommand, after: u32
    ) {
        cases ["resumed", "cleared alone", "stopped"];
        kani proof [unwind(4)];
        sampled 100_000;
    }
    theorem T8 fault_brakes_even_if_cleared_at_once(
        past: Past, raised: Faults, fresh: Micros, clear_faults: Faults, after: u32
    ) {
        cases ["still latched", "cleared"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    theorem T8 late_frame_does_not_undo_the_stop(past: Past, fresh: Micros, silence: u32) {
        cases ["stopped", "faulted"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    theorem T8 silence_is_latched_until_cleared(
        past: Past, fresh: Micros, silence: u32, intent: SupervisorCommand, after: u32
    ) {
        cases ["latched", "cleared", "in time"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    theorem T8 fresh_frames_keep_it_going(deadline: u16, fresh: Micros, gaps: [u16; 2]) {
        cases ["across the clock's wrap", "some time later"];
        kani proof [unwind(3)];
        sampled 100_000;
    }
}
