//! T8: silence stops the robot, and only an explicit word starts it again.
//!
//! A supervisor is brought into every state it can be in by a fresh frame, an order, a fault and a
//! tick of any kind at any time; then what must follow is demanded.

use fw_core::motion::StopDeadline;
use fw_core::robot::{Intent, Permit, Supervisor};
use fw_core::wire::{Order, State};

use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Faults, Micros};

/// Ticks come at least this often, microseconds: half the clock's range. The control tick is timed
/// by hardware every 10 ms, and the watchdog resets what does not tick.
pub const TICKS_WITHIN: u32 = 1 << 31;

/// What may have happened to a supervisor before.
#[derive(Clone, Copy, Debug)]
pub struct Past {
    /// The configured deadline, ms.
    pub deadline: u16,
    /// A first fresh frame.
    pub first: Option<Intent>,
    /// When it came.
    pub at: Micros,
    /// Faults raised.
    pub faults: Faults,
    /// A tick after that time.
    pub tick: Option<u32>,
}

impl Input for Intent {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            resumes: Input::draw(source),
            order: Input::draw(source),
            clear: Input::draw(source),
        }
    }
}

impl Input for Past {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            deadline: Input::draw(source),
            first: Input::draw(source),
            at: Input::draw(source),
            faults: Input::draw(source),
            tick: Input::draw(source),
        }
    }
}

impl Past {
    fn supervisor(&self) -> Supervisor {
        let mut supervisor = Supervisor::new(StopDeadline::new(self.deadline));
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

/// After a fresh frame at any time, whatever else happened, the first tick at or after the deadline
/// brakes, says so, and latches why; wherever the clock wraps.
// Requirement: WIRE-deadline-1
pub fn silence_brakes(past: Past, fresh: Micros, intent: Intent, early: u32, silence: u32) -> Seen {
    let allowed = u32::from(past.deadline) * 1000;
    if silence < allowed || silence >= TICKS_WITHIN || early >= allowed {
        return Seen::NOTHING;
    }
    let mut supervisor = past.supervisor();
    supervisor.on_fresh(fresh, intent);
    let in_time = supervisor.on_tick(fresh.after(early), true, true);
    let permit = supervisor.on_tick(fresh.after(silence), true, true);
    assert!(permit == Permit::Brake);
    assert!(supervisor.halted());
    let blocked = supervisor.faults().intersects(Faults::BLOCKING);
    assert!(
        supervisor.state()
            == if blocked {
                State::Faulted
            } else {
                State::Stopped
            }
    );
    assert!(in_time != Permit::Drive || supervisor.faults().intersects(Faults::LINK_LOST));
    Seen::NOTHING
        .case(0, in_time == Permit::Drive)
        .case(1, blocked)
        .case(2, fresh.after(silence).0 < fresh.0)
}

/// Once stopped, nothing but a fresh frame lets it move again: no tick at any time, however many and
/// however the clock stands, and no fault.
// Requirement: WIRE-deadline-2
pub fn stop_lasts(past: Past, one: Micros, raised: Faults, two: Micros, wanted: bool) -> Seen {
    let mut supervisor = past.supervisor();
    if !supervisor.halted() {
        return Seen::NOTHING;
    }
    let first = supervisor.on_tick(one, true, true);
    supervisor.raise(raised);
    let second = supervisor.on_tick(two, wanted, true);
    assert!(first == Permit::Brake && second == Permit::Brake);
    assert!(supervisor.halted());
    assert!(supervisor.faults() & raised == raised);
    Seen::NOTHING
        .case(0, supervisor.faults().intersects(Faults::LINK_LOST))
        .case(1, supervisor.state() == State::Stopped)
        .case(2, supervisor.state() == State::Faulted)
}

/// A stopped robot moves again only when a fresh frame says so in words: apply, 0 % or resume; and
/// never while a blocking fault is latched.
// Requirement: WIRE-deadline-2
pub fn only_a_word_resumes(past: Past, fresh: Micros, intent: Intent, after: u32) -> Seen {
    let mut supervisor = past.supervisor();
    if !supervisor.halted() {
        return Seen::NOTHING;
    }
    supervisor.on_fresh(fresh, intent);
    let permit = supervisor.on_tick(fresh.after(after), true, true);
    let word = match intent.order {
        Order::Resume => true,
        Order::None => intent.resumes,
        Order::Stop => false,
    };
    let blocked = supervisor.faults().intersects(Faults::BLOCKING);
    if !word || blocked {
        assert!(permit == Permit::Brake);
    }
    Seen::NOTHING
        .case(0, permit == Permit::Drive)
        .case(1, !word)
        .case(2, word && blocked)
}

/// A blocking fault brakes, and having it cleared before the next tick does not undo that: it takes
/// a word, as after any stop.
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
    if !supervisor.faults().intersects(Faults::BLOCKING) {
        return Seen::NOTHING;
    }
    let cured = Intent {
        resumes: false,
        order: Order::None,
        clear,
    };
    supervisor.on_fresh(fresh, cured);
    assert!(supervisor.on_tick(fresh.after(after), true, true) == Permit::Brake);
    Seen::NOTHING
        .case(0, supervisor.state() == State::Faulted)
        .case(1, supervisor.state() == State::Stopped)
}

/// A frame that comes too late does not undo the stop, even before the tick that would have noticed.
// Requirement: WIRE-deadline-2
pub fn late_frame_does_not_undo_the_stop(past: Past, fresh: Micros, silence: u32) -> Seen {
    let allowed = u32::from(past.deadline) * 1000;
    if silence < allowed || silence >= TICKS_WITHIN {
        return Seen::NOTHING;
    }
    let mut supervisor = past.supervisor();
    let apply = Intent {
        resumes: true,
        order: Order::Resume,
        clear: Faults::NONE,
    };
    supervisor.on_fresh(fresh, apply);
    supervisor.on_fresh(fresh.after(silence), Intent::default());
    assert!(supervisor.on_tick(fresh.after(silence), true, true) == Permit::Brake);
    Seen::NOTHING
        .case(0, supervisor.state() == State::Stopped)
        .case(1, supervisor.state() == State::Faulted)
}

/// Until the deadline a healthy link lets the robot drive: the stop is no accident waiting to happen.
pub fn fresh_frames_keep_it_going(deadline: u16, fresh: Micros, gaps: [u16; 2]) -> Seen {
    let allowed = u32::from(deadline) * 1000;
    let apply = Intent {
        resumes: true,
        order: Order::Resume,
        clear: Faults::NONE,
    };
    let mut supervisor = Supervisor::new(StopDeadline::new(deadline));
    supervisor.on_fresh(fresh, apply);
    let mut now = fresh;
    for gap in gaps {
        let gap = u32::from(gap) * 64;
        if gap >= allowed {
            return Seen::NOTHING;
        }
        now = now.after(gap);
        assert!(supervisor.on_tick(now, true, true) == Permit::Drive);
        supervisor.on_fresh(now, Intent::default());
    }
    assert!(supervisor.faults().is_empty() && supervisor.state() == State::Moving);
    Seen::NOTHING.case(0, now.0 < fresh.0).case(1, gaps[0] > 0)
}

crate::properties! {
    theorem T8 silence_brakes(past: Past, fresh: Micros, intent: Intent, early: u32, silence: u32) {
        cases ["it was driving", "a fault blocks as well", "across the clock's wrap"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 stop_lasts(past: Past, one: Micros, raised: Faults, two: Micros, wanted: bool) {
        cases ["for a lost link", "stopped", "faulted"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 only_a_word_resumes(past: Past, fresh: Micros, intent: Intent, after: u32) {
        cases ["resumed", "no word", "a word against a fault"];
        kani proof [unwind(4)];
        sampled 500_000;
    }
    theorem T8 fault_brakes_even_if_cleared_at_once(
        past: Past, raised: Faults, fresh: Micros, clear: Faults, after: u32
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
    theorem T8 fresh_frames_keep_it_going(deadline: u16, fresh: Micros, gaps: [u16; 2]) {
        cases ["across the clock's wrap", "some time later"];
        kani proof [unwind(3)];
        sampled 100_000;
    }
}
