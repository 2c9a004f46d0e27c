//! What interrupts capture for the robot, and the order in which it takes that.
//!
//! The latest tick waits in a cell, each sensor's echo in [`Echoes`], frames in the link's buffers.
//! Captures happen at any time, so the firmware masks them while it looks at the first two.
//!
//! A sensor's edges count from its trigger to the end of its echo, which without an object comes after
//! the next sensor's trigger; any other edge is noise. An echo shorter than the interrupt's latency shows
//! no rising edge and is ignored too: 2 µs are 0.3 mm.

use crate::robot::TickInput;
use crate::types::{Micros, RangefinderId};
use core::cell::Cell;

/// One echo, on the robot's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CapturedEcho {
    /// The sensor.
    pub which: RangefinderId,
    /// Rising edge: the burst has left.
    pub rise: Micros,
    /// Falling edge: it has come back.
    pub fall: Micros,
}

/// State of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// Not triggered, or its echo has been taken.
    Idle,
    /// Triggered, no edge yet.
    Triggered,
    /// The echo's pin rose.
    Rising(Micros),
    /// And fell, at the second time; the robot has not taken it yet.
    Received(Micros, Micros),
}

/// Every sensor's edges until the robot takes the echo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Echoes([Cell<Progress>; 3]);

impl Default for Echoes {
    fn default() -> Self {
        Self::new()
    }
}

impl Echoes {
    /// No sensor is triggered.
    pub const fn new() -> Self {
        Self([
            Cell::new(Progress::Idle),
            Cell::new(Progress::Idle),
            Cell::new(Progress::Idle),
        ])
    }

    /// A sensor is being triggered: its echo counts until it is over or the sensor is triggered again.
    #[inline]
    pub fn trigger(&self, which: RangefinderId) {
        self.progress(which).set(Progress::Triggered);
    }

    /// An edge of a sensor's echo at `at`, after which its line is `high`. Whether the echo is complete: then
    /// the robot must be woken.
    #[inline]
    pub fn on_edge(&self, which: RangefinderId, at: Micros, high: bool) -> bool {
        let progress = self.progress(which);
        match progress.get() {
            Progress::Triggered if high => progress.set(Progress::Rising(at)),
            Progress::Rising(rise) if !high => {
                progress.set(Progress::Received(rise, at));
                return true;
            }
            _ => {}
        }
        false
    }

    /// A complete echo, once.
    #[inline]
    pub fn take(&self) -> Option<CapturedEcho> {
        let received = |which| {
            let progress = self.progress(which);
            let Progress::Received(rise, fall) = progress.get() else {
                return None;
            };
            progress.set(Progress::Idle);
            Some(CapturedEcho { which, rise, fall })
        };
        received(RangefinderId::Front)
            .or_else(|| received(RangefinderId::Right))
            .or_else(|| received(RangefinderId::Left))
    }

    #[inline]
    fn progress(&self, which: RangefinderId) -> &Cell<Progress> {
        let [front, ..] = &self.0;
        self.0.get(which as usize).unwrap_or(front)
    }
}

/// An event for the robot.
#[derive(Debug, PartialEq, Eq)]
pub enum Event<Frame> {
    /// An echo has ended.
    Echo(CapturedEcho),
    /// A frame has ended.
    Frame(Frame),
    /// A tick.
    Tick(TickInput),
}

/// Everything that awaits the robot, as [`next_event`] looks at it.
pub trait Pending {
    /// The robot's hold of a frame.
    type Frame;

    /// When the frame that [`Self::claim`] would return ended.
    fn frame_ended_at(&mut self) -> Option<Micros>;

    /// Runs `f` on the tick that was latched last and on the echoes. Nothing is captured meanwhile, but
    /// something may have been since the last call.
    fn captured<R>(&mut self, f: impl FnOnce(&Cell<Option<TickInput>>, &Echoes) -> R) -> R;

    /// The frame that ended last, for the robot.
    fn claim(self) -> Option<Self::Frame>;
}

/// An echo, or else the older of a frame and a tick, so that the core's clock never runs backwards. No
/// frame may end meanwhile; a tick that is latched after the comparison is younger than that frame.
#[inline]
pub fn next_event<P: Pending>(mut pending: P) -> Option<Event<P::Frame>> {
    let frame = pending.frame_ended_at();
    let captured = pending.captured(|tick, echoes| {
        if let Some(echo) = echoes.take() {
            return Some(Event::Echo(echo));
        }
        let latched = tick.get()?.now;
        let first = frame.is_none_or(|frame| latched.since(frame) > u32::MAX / 2);
        first.then(|| tick.take().map(Event::Tick))?
    });
    captured.or_else(|| pending.claim().map(Event::Frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame that ended at `frame`, if any.
    struct Waiting<'a> {
        tick: &'a Cell<Option<TickInput>>,
        echoes: &'a Echoes,
        frame: Option<u32>,
    }

    impl Pending for Waiting<'_> {
        type Frame = u32;

        fn frame_ended_at(&mut self) -> Option<Micros> {
            self.frame.map(Micros)
        }

        fn captured<R>(&mut self, f: impl FnOnce(&Cell<Option<TickInput>>, &Echoes) -> R) -> R {
            f(self.tick, self.echoes)
        }

        fn claim(self) -> Option<u32> {
            self.frame
        }
    }

    #[test]
    fn event_is_an_echo_then_the_older_of_frame_and_tick() {
        let (tick, echoes) = (&Cell::default(), &Echoes::default());
        let next = |frame| {
            next_event(Waiting {
                tick,
                echoes,
                frame,
            })
        };
        assert_eq!(next(None), None);
        assert_eq!(next(Some(7)), Some(Event::Frame(7)));
        for (now, frame, tick_first) in [
            (6, Some(7), true),
            // A tick of the same microsecond was latched after the frame's end.
            (7, Some(7), false),
            (8, Some(7), false),
            (u32::MAX, Some(2), true),
            (2, Some(u32::MAX), false),
            (1 << 31, Some(0), true),
            ((1 << 31) - 1, Some(0), false),
            (7, None, true),
        ] {
            let sample = TickInput {
                now: Micros(now),
                ..TickInput::default()
            };
            tick.set(Some(sample));
            echoes.trigger(RangefinderId::Left);
            assert!(!echoes.on_edge(RangefinderId::Left, Micros(1), true));
            assert!(echoes.on_edge(RangefinderId::Left, Micros(9), false));
            let echo = CapturedEcho {
                which: RangefinderId::Left,
                rise: Micros(1),
                fall: Micros(9),
            };
            assert_eq!(next(frame), Some(Event::Echo(echo)));
            let expected = match frame {
                Some(frame) if !tick_first => Event::Frame(frame),
                _ => Event::Tick(sample),
            };
            assert_eq!(next(frame), Some(expected), "{now} {frame:?}");
            assert_eq!(tick.take().is_none(), tick_first);
        }
    }

    #[test]
    fn echo_counts_from_its_trigger_to_its_end() {
        let sensors = RangefinderId::ALL;
        let echoes = Echoes::new();
        let edge = |which, at, high| echoes.on_edge(which, Micros(at), high);
        for which in sensors {
            // Not triggered; triggered, but its line falls first.
            assert!(!edge(which, 1, true) && !edge(which, 2, false));
            echoes.trigger(which);
            assert!(!edge(which, 3, false) && !edge(which, 4, true) && !edge(which, 5, true));
        }
        for (at, which) in (6..).zip(sensors.into_iter().rev()) {
            assert_eq!(echoes.take(), None);
            assert!(edge(which, at, false));
            assert!(!edge(which, 9, true) && !edge(which, 9, false));
            let (rise, fall) = (Micros(4), Micros(at));
            assert_eq!(echoes.take(), Some(CapturedEcho { which, rise, fall }));
            assert!(!edge(which, 9, true) && !edge(which, 9, false));
        }
        // A trigger ends an echo under way, and one that was not taken.
        for falls in [false, true] {
            echoes.trigger(RangefinderId::Front);
            assert!(!edge(RangefinderId::Front, 10, true));
            assert_eq!(falls, falls && edge(RangefinderId::Front, 11, false));
            echoes.trigger(RangefinderId::Front);
            assert!(!edge(RangefinderId::Front, 12, false));
            assert_eq!(echoes.take(), None);
        }
        for which in sensors.into_iter().rev() {
            echoes.trigger(which);
            assert!(!edge(which, 20, true) && edge(which, 21, false));
        }
        let order = sensors.map(|_| echoes.take().map(|echo| echo.which));
        assert_eq!(order, sensors.map(Some));
    }
}
