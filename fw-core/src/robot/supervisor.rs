//! Whether the robot may move: state, latched faults, stop deadline.
//!
//! A pure state machine of three inputs (a fresh command, a tick, a fault raised) and one output: the
//! [`AllowedMotion`] of the tick. Nothing else decides whether a wheel may turn.

use crate::motion::StopDeadline;
use crate::types::{Faults, Micros};
use crate::wire::{Order, State};

/// The supervisor's part of a fresh valid frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SupervisorCommand {
    /// The frame alone may end a stop: apply in Normal, 0 % in the bare tuning modes. The guarded
    /// modes leave it false and send [`Order::Resume`].
    pub resumes: bool,
    /// Guarded modes.
    pub order: Order,
    /// Guarded modes: faults to clear.
    pub clear_faults: Faults,
}

/// What a tick may do with the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AllowedMotion {
    /// No request yet.
    Coast,
    /// They must stand still.
    Brake,
    /// The controller's duties may be applied.
    Drive,
}

/// Why the motors must stand still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Halt {
    /// They need not.
    None,
    /// By order, by a fault or after a restart.
    Ordered,
    /// No fresh frame came in time.
    Silence,
}

/// State, latched faults and stop deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Supervisor {
    deadline: StopDeadline,
    /// A fresh frame has arrived since the reset.
    linked: bool,
    state: State,
    faults: Faults,
    /// Until an explicit resume.
    halt: Halt,
}

impl Supervisor {
    /// Ready, nothing latched; the deadline runs from the first fresh frame on.
    pub const fn new(deadline: StopDeadline) -> Self {
        Self {
            deadline,
            linked: false,
            state: State::Ready,
            faults: Faults::NONE,
            halt: Halt::None,
        }
    }

    /// What the robot is doing.
    pub const fn state(&self) -> State {
        self.state
    }

    /// Whether the motors must stand still until an explicit resume.
    pub const fn halted(&self) -> bool {
        !matches!(self.halt, Halt::None)
    }

    /// Why they must.
    pub const fn halt(&self) -> Halt {
        self.halt
    }

    /// Latched faults, see [`Faults::TABLE`].
    pub const fn faults(&self) -> Faults {
        self.faults
    }

    /// Latches faults. A blocking one takes effect at once: the next tick brakes, even if the Pi clears
    /// the fault before that; leaving the stop takes an explicit resume.
    // Requirement: WIRE-status-1
    pub const fn raise(&mut self, faults: Faults) {
        self.faults = self.faults.union(faults);
        if self.faults.intersects(Faults::BLOCKING) {
            self.state = State::Faulted;
            self.halt = Halt::Ordered;
        }
    }

    /// Whether a fresh frame has come and the deadline since the last one has not passed by `now`.
    // Requirement: WIRE-deadline-3
    #[must_use]
    pub fn link_alive(&mut self, now: Micros) -> bool {
        !self.deadline.expired(now)
    }

    /// A fresh valid frame arrived: the only thing that feeds the deadline.
    // Requirement: WIRE-deadline-2, WIRE-deadline-4
    pub fn on_fresh(&mut self, now: Micros, command: SupervisorCommand) {
        // A frame after the deadline but before the next tick does not undo the stop.
        self.check_deadline(now);
        self.deadline.fresh(now);
        // The sender may still command what it did before the restart: only an explicit resume moves the robot.
        // Requirement: WIRE-safe-2
        if !self.linked && self.faults.intersects(Faults::RESTARTED) {
            self.halt = Halt::Ordered;
        }
        self.linked = true;
        self.faults = self.faults.difference(command.clear_faults);
        match command.order {
            Order::Stop => self.halt = Halt::Ordered,
            Order::Resume => self.halt = Halt::None,
            Order::None => {
                if command.resumes {
                    self.faults = self.faults.difference(Faults::LINK_LOST);
                    self.halt = Halt::None;
                }
            }
        }
    }

    /// One tick: what the motors may do, given that the Pi has `requested` a motion and that they are
    /// `busy` with it.
    // Requirement: WIRE-status-5
    pub fn on_tick(&mut self, now: Micros, requested: bool, busy: bool) -> AllowedMotion {
        self.check_deadline(now);
        if self.faults.intersects(Faults::BLOCKING) {
            // Clearing the fault must not move the robot.
            self.halt = Halt::Ordered;
            return AllowedMotion::Brake;
        }
        // Requirement: WIRE-deadline-2
        if self.halted() {
            self.state = State::Stopped;
            return AllowedMotion::Brake;
        }
        self.state = if requested && busy {
            State::Moving
        } else {
            State::Ready
        };
        // Requirement: WIRE-deadline-3
        if requested {
            AllowedMotion::Drive
        } else {
            AllowedMotion::Coast
        }
    }

    // Requirement: WIRE-deadline-1
    #[allow(clippy::inline_always, reason = "every frame calls it")]
    #[inline(always)]
    fn check_deadline(&mut self, now: Micros) {
        if self.linked && self.deadline.expired(now) {
            self.halt = Halt::Silence;
            self.faults |= Faults::LINK_LOST;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::Milliseconds;

    const APPLY: SupervisorCommand = SupervisorCommand {
        resumes: true,
        order: Order::None,
        clear_faults: Faults::NONE,
    };
    const ALIVE: SupervisorCommand = SupervisorCommand {
        resumes: false,
        ..APPLY
    };

    /// A fresh frame at 0, then one tick.
    fn after(command: SupervisorCommand, tick: u32) -> (Supervisor, AllowedMotion) {
        let mut supervisor = Supervisor::new(StopDeadline::new(Milliseconds(250)));
        supervisor.on_fresh(Micros(0), command);
        let allowed = supervisor.on_tick(Micros(tick), true, true);
        (supervisor, allowed)
    }

    #[test]
    fn motion_needs_request_and_busy_motors() {
        for (requested, busy, state, allowed) in [
            (false, false, State::Ready, AllowedMotion::Coast),
            (false, true, State::Ready, AllowedMotion::Coast),
            (true, false, State::Ready, AllowedMotion::Drive),
            (true, true, State::Moving, AllowedMotion::Drive),
        ] {
            let (mut supervisor, _) = after(APPLY, 1);
            assert_eq!(supervisor.on_tick(Micros(2), requested, busy), allowed);
            assert_eq!(supervisor.state(), state);
        }
    }

    #[test]
    fn halt_is_by_silence_only_without_a_fresh_frame() {
        let ordered = |order| SupervisorCommand { order, ..ALIVE };
        let (mut supervisor, _) = after(APPLY, 1);
        let mut lasts = |now: u32, command: Option<SupervisorCommand>| {
            if let Some(command) = command {
                supervisor.on_fresh(Micros(now), command);
            }
            let _ = supervisor.on_tick(Micros(now), true, true);
            supervisor.halt()
        };
        assert_eq!(lasts(249_999, None), Halt::None);
        assert_eq!(lasts(250_000, None), Halt::Silence);
        // The fault stays latched.
        assert_eq!(lasts(300_000, Some(ordered(Order::Resume))), Halt::None);
        assert_eq!(lasts(310_000, Some(ordered(Order::Stop))), Halt::Ordered);
        assert_eq!(lasts(320_000, Some(ordered(Order::Resume))), Halt::None);
        // Late, and before a tick.
        assert_eq!(lasts(600_000, Some(ALIVE)), Halt::Silence);
    }

    // Requirement: WIRE-safe-2
    #[test]
    fn restarted_firmware_drives_once_it_is_resumed() {
        let clears = SupervisorCommand {
            clear_faults: Faults::RESTARTED,
            ..ALIVE
        };
        for (first, allowed) in [
            (ALIVE, AllowedMotion::Brake),
            (clears, AllowedMotion::Brake),
            (APPLY, AllowedMotion::Drive),
        ] {
            let mut supervisor = Supervisor::new(StopDeadline::new(Milliseconds(250)));
            supervisor.raise(Faults::RESTARTED);
            let before = supervisor.on_tick(Micros(0), false, false);
            assert_eq!(before, AllowedMotion::Coast);
            supervisor.on_fresh(Micros(1), first);
            assert_eq!(supervisor.on_tick(Micros(2), true, true), allowed);
            supervisor.on_fresh(Micros(3), APPLY);
            supervisor.on_fresh(Micros(4), ALIVE);
            let last = supervisor.on_tick(Micros(5), true, true);
            assert_eq!(last, AllowedMotion::Drive);
        }
    }

    // Requirement: WIRE-status-1, WIRE-status-5
    #[test]
    fn blocking_fault_brakes_until_cleared_and_resumed() {
        for bit in 0..16 {
            let fault = Faults::from_bits(1 << bit);
            let (mut supervisor, _) = after(APPLY, 1);
            supervisor.raise(fault);
            if !fault.intersects(Faults::BLOCKING) {
                let allowed = supervisor.on_tick(Micros(3), true, true);
                assert_eq!(allowed, AllowedMotion::Drive);
                continue;
            }
            let clear = SupervisorCommand {
                clear_faults: fault,
                ..ALIVE
            };
            assert_eq!(
                (supervisor.state(), supervisor.halted()),
                (State::Faulted, true)
            );
            let mut cleared = supervisor;
            cleared.on_fresh(Micros(2), clear);
            assert_eq!(cleared.on_tick(Micros(3), true, true), AllowedMotion::Brake);
            let mut tick = |command: Option<SupervisorCommand>| {
                if let Some(command) = command {
                    supervisor.on_fresh(Micros(2), command);
                }
                let allowed = supervisor.on_tick(Micros(3), true, true);
                (allowed, supervisor.state())
            };
            for (command, expected) in [
                (None, (AllowedMotion::Brake, State::Faulted)),
                (Some(APPLY), (AllowedMotion::Brake, State::Faulted)),
                (Some(clear), (AllowedMotion::Brake, State::Stopped)),
                (Some(APPLY), (AllowedMotion::Drive, State::Moving)),
            ] {
                assert_eq!(tick(command), expected);
            }
        }
    }
}
