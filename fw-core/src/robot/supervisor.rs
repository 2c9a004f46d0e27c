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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AllowedMotion {
    /// No request yet.
    Coast,
    /// They must stand still.
    Brake,
    /// The controller's duties may be applied.
    Drive,
}

/// State, latched faults and stop deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervisor {
    deadline: StopDeadline,
    /// A fresh frame has arrived since the reset.
    linked: bool,
    state: State,
    faults: Faults,
    /// Stopped by the deadline, by order or by a fault, until an explicit resume.
    halted: bool,
}

impl Supervisor {
    /// Ready, nothing latched; the deadline runs from the first fresh frame on.
    #[must_use]
    pub const fn new(deadline: StopDeadline) -> Self {
        Self {
            deadline,
            linked: false,
            state: State::Ready,
            faults: Faults::NONE,
            halted: false,
        }
    }

    /// What the robot is doing.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Whether the motors must stand still until an explicit resume.
    #[must_use]
    pub const fn halted(&self) -> bool {
        self.halted
    }

    /// Latched faults, see [`Faults::TABLE`].
    #[must_use]
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
            self.halted = true;
        }
    }

    /// Whether a fresh frame has come and the deadline since the last one has not passed by `now`.
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
        self.linked = true;
        self.faults = self.faults.difference(command.clear_faults);
        match command.order {
            Order::Stop => self.halted = true,
            Order::Resume => self.halted = false,
            Order::None => {
                if command.resumes {
                    if self.halted {
                        self.faults = self.faults.difference(Faults::LINK_LOST);
                    }
                    self.halted = false;
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
            self.halted = true;
            self.state = State::Faulted;
            return AllowedMotion::Brake;
        }
        if self.halted {
            self.state = State::Stopped;
            return AllowedMotion::Brake;
        }
        self.state = if requested && busy {
            State::Moving
        } else {
            State::Ready
        };
        if requested {
            AllowedMotion::Drive
        } else {
            AllowedMotion::Coast
        }
    }

    // Requirement: WIRE-deadline-1
    fn check_deadline(&mut self, now: Micros) {
        if self.linked && self.deadline.expired(now) && !self.halted {
            self.halted = true;
            self.faults |= Faults::LINK_LOST;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEADLINE_US: u32 = 250_000;
    const APPLY: SupervisorCommand = SupervisorCommand {
        resumes: true,
        order: Order::None,
        clear_faults: Faults::NONE,
    };

    fn supervisor() -> Supervisor {
        Supervisor::new(StopDeadline::new(250))
    }

    // Requirement: WIRE-deadline-3
    #[test]
    fn before_the_first_frame_it_waits_ready_and_coasts() {
        let mut s = supervisor();
        for second in 0..10_000_u32 {
            let now = Micros(second.wrapping_mul(1_000_000));
            assert_eq!(s.on_tick(now, false, false), AllowedMotion::Coast);
        }
        assert_eq!((s.state(), s.faults()), (State::Ready, Faults::NONE));
    }

    #[test]
    fn it_moves_only_where_something_is_requested_and_it_is_busy_with_it() {
        for (requested, busy, state, permit) in [
            (false, false, State::Ready, AllowedMotion::Coast),
            (false, true, State::Ready, AllowedMotion::Coast),
            (true, false, State::Ready, AllowedMotion::Drive),
            (true, true, State::Moving, AllowedMotion::Drive),
        ] {
            let mut s = supervisor();
            s.on_fresh(Micros(0), APPLY);
            assert_eq!(s.on_tick(Micros(10_000), requested, busy), permit);
            assert_eq!(s.state(), state, "{requested} {busy}");
        }
    }

    #[test]
    fn somebody_talks_to_it_from_the_first_frame_to_the_deadline() {
        let mut s = supervisor();
        assert!(!s.link_alive(Micros(0)));
        s.on_fresh(Micros(1000), APPLY);
        assert!(s.link_alive(Micros(1000)));
        assert!(s.link_alive(Micros(1000 + DEADLINE_US - 1)));
        assert!(!s.link_alive(Micros(1000 + DEADLINE_US)));
    }

    #[test]
    fn a_stop_lasts_until_a_word_ends_it() {
        let mut s = supervisor();
        let order = |order| SupervisorCommand {
            resumes: false,
            order,
            clear_faults: Faults::NONE,
        };
        assert!(!s.halted());
        s.on_fresh(Micros(0), order(Order::Stop));
        assert!(s.halted());
        s.on_fresh(Micros(1), order(Order::None));
        assert!(s.halted());
        s.on_fresh(Micros(2), order(Order::Resume));
        assert!(!s.halted());
        s.raise(Faults::BATTERY_CUTOFF);
        assert!(s.halted());
    }

    #[test]
    fn silence_brakes_at_the_deadline_from_every_phase_of_the_clock() {
        for start in [
            0,
            1,
            u32::MAX,
            u32::MAX - DEADLINE_US / 2,
            1 << 31,
            (1 << 31) - 1,
        ] {
            let mut s = supervisor();
            s.on_fresh(Micros(start), APPLY);
            let at = |after: u32| Micros(start.wrapping_add(after));
            assert_eq!(
                s.on_tick(at(DEADLINE_US - 1), true, true),
                AllowedMotion::Drive
            );
            assert_eq!(s.state(), State::Moving);
            assert_eq!(s.on_tick(at(DEADLINE_US), true, true), AllowedMotion::Brake);
            assert_eq!((s.state(), s.faults()), (State::Stopped, Faults::LINK_LOST));
            // It stays so however long the silence lasts, the clock's wraps included.
            for tick in 1..1_000_u32 {
                let later = at(DEADLINE_US).after(tick.wrapping_mul(17_000_000));
                assert_eq!(s.on_tick(later, true, true), AllowedMotion::Brake);
            }
        }
    }

    #[test]
    fn a_frame_just_after_the_deadline_and_before_the_tick_does_not_undo_the_stop() {
        let mut s = supervisor();
        s.on_fresh(Micros(0), APPLY);
        assert_eq!(s.on_tick(Micros(10), true, true), AllowedMotion::Drive);
        s.on_fresh(Micros(DEADLINE_US + 1), SupervisorCommand::default());
        assert_eq!(
            s.on_tick(Micros(DEADLINE_US + 2), true, true),
            AllowedMotion::Brake
        );
    }

    // Requirement: WIRE-deadline-2, WIRE-deadline-4
    #[test]
    fn only_a_word_that_resumes_ends_a_stop() {
        let stopped = || {
            let mut s = supervisor();
            s.on_fresh(Micros(0), APPLY);
            assert_eq!(
                s.on_tick(Micros(DEADLINE_US), true, true),
                AllowedMotion::Brake
            );
            s
        };
        let now = Micros(DEADLINE_US + 5);
        let mut s = stopped();
        s.on_fresh(now, SupervisorCommand::default());
        assert_eq!(s.on_tick(now, true, true), AllowedMotion::Brake);
        s.on_fresh(now, APPLY);
        assert_eq!(s.on_tick(now, true, true), AllowedMotion::Drive);
        assert_eq!(
            s.faults(),
            Faults::NONE,
            "in Normal the resume is also what clears the latch"
        );

        let mut s = stopped();
        s.on_fresh(
            now,
            SupervisorCommand {
                order: Order::Resume,
                ..SupervisorCommand::default()
            },
        );
        assert_eq!(s.on_tick(now, true, true), AllowedMotion::Drive);
        assert_eq!(
            s.faults(),
            Faults::LINK_LOST,
            "guarded: latched until cleared"
        );
    }

    #[test]
    fn an_order_to_stop_wins_over_apply_in_the_same_frame() {
        let mut s = supervisor();
        s.on_fresh(
            Micros(0),
            SupervisorCommand {
                order: Order::Stop,
                ..APPLY
            },
        );
        assert_eq!(s.on_tick(Micros(1), true, true), AllowedMotion::Brake);
        assert_eq!(s.state(), State::Stopped);
    }

    // Requirement: WIRE-status-1, WIRE-status-5
    #[test]
    fn every_blocking_fault_brakes_and_clearing_it_alone_does_not_move_the_robot() {
        for bit in 0..16 {
            let fault = Faults::from_bits(1 << bit);
            let mut s = supervisor();
            s.on_fresh(Micros(0), APPLY);
            s.raise(fault);
            if !fault.intersects(Faults::BLOCKING) {
                assert_eq!(s.on_tick(Micros(1), true, true), AllowedMotion::Drive);
                continue;
            }
            assert_eq!(s.state(), State::Faulted);
            assert_eq!(s.on_tick(Micros(1), true, true), AllowedMotion::Brake);
            s.on_fresh(Micros(2), APPLY);
            assert_eq!(
                s.on_tick(Micros(3), true, true),
                AllowedMotion::Brake,
                "apply is no cure"
            );
            s.on_fresh(
                Micros(4),
                SupervisorCommand {
                    clear_faults: fault,
                    ..SupervisorCommand::default()
                },
            );
            assert_eq!(s.on_tick(Micros(5), true, true), AllowedMotion::Brake);
            assert_eq!(s.state(), State::Stopped);
            s.on_fresh(Micros(6), APPLY);
            assert_eq!(s.on_tick(Micros(7), true, true), AllowedMotion::Drive);
        }
    }
}
