//! Looking at the robot, and driving it by keys or a gamepad with a dead man's handle, as a client of a server.

use crate::client::Client;
use crate::gamepad::Gamepad;
use crate::serve::protocol::{Message, Request};
use host_link::board_io::Interrupt;
use host_link::error::Error;
use std::time::{Duration, Instant};

/// A key that was not pressed again for so long counts as released.
pub const RELEASED: Duration = Duration::from_millis(300);
/// Time between two commands while a key is held.
const RENEW: Duration = Duration::from_millis(100);
/// The lease of a command, ms: a terminal that hangs stops the robot, too.
const LEASE_MS: u32 = 400;

/// What a key means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Ahead.
    Ahead,
    /// Back.
    Back,
    /// Turns counter-clockwise.
    Left,
    /// Turns clockwise.
    Right,
    /// Stops the robot, whichever client drives it.
    Stop,
    /// Ends.
    Leave,
}

/// Drives while a key or the gamepad's handle is held.
pub struct DeadMan {
    forward_mm_s: f64,
    yaw_rate_deg_s: f64,
    velocity: (f64, f64),
    pressed: Option<Instant>,
    sent: Option<Instant>,
    gamepad: Option<Gamepad>,
    /// The gamepad's handle was held when the robot was stopped, or from the beginning on.
    must_let_go: bool,
    is_by_gamepad: bool,
}

impl DeadMan {
    /// With the speeds of the keys, mm/s and degrees/s, of which a gamepad's stick gives a part.
    pub const fn new(forward_mm_s: f64, yaw_rate_deg_s: f64, gamepad: Option<Gamepad>) -> Self {
        Self {
            forward_mm_s,
            yaw_rate_deg_s,
            velocity: (0.0, 0.0),
            pressed: None,
            sent: None,
            gamepad,
            must_let_go: true,
            is_by_gamepad: false,
        }
    }

    /// Takes what the gamepad did; whether it stops the robot.
    ///
    /// # Errors
    /// [`Error::Device`] once it is gone.
    // Requirement: SERVE-teleop-1
    pub fn poll(&mut self, now: Instant) -> Result<bool, Error> {
        let Some(gamepad) = &mut self.gamepad else {
            return Ok(false);
        };
        let stop = gamepad.poll()?;
        if stop {
            self.press(Key::Stop, now);
            return Ok(true);
        }
        match gamepad.held() {
            Some(_) if self.must_let_go => {}
            Some((ahead, left)) => {
                self.velocity = (ahead * self.forward_mm_s, left * self.yaw_rate_deg_s);
                self.pressed = Some(now);
                self.is_by_gamepad = true;
            }
            None => {
                self.must_let_go = false;
                if std::mem::take(&mut self.is_by_gamepad) {
                    self.pressed = now.checked_sub(RELEASED);
                }
            }
        }
        Ok(false)
    }

    /// Takes a key.
    pub fn press(&mut self, key: Key, now: Instant) {
        let velocity = match key {
            Key::Ahead => (self.forward_mm_s, 0.0),
            Key::Back => (-self.forward_mm_s, 0.0),
            Key::Left => (0.0, self.yaw_rate_deg_s),
            Key::Right => (0.0, -self.yaw_rate_deg_s),
            Key::Stop | Key::Leave => {
                self.pressed = None;
                (self.must_let_go, self.is_by_gamepad) = (true, false);
                return;
            }
        };
        if self.pressed.is_none() || velocity != self.velocity {
            self.sent = None;
        }
        (self.velocity, self.pressed) = (velocity, Some(now));
    }

    /// The velocity to command now, mm/s and degrees/s, if one is due: zero once the key is released.
    // Requirement: SERVE-teleop-1
    pub fn due(&mut self, now: Instant) -> Option<(f64, f64)> {
        if now.duration_since(self.pressed?) >= RELEASED {
            self.pressed = None;
            return Some((0.0, 0.0));
        }
        let is_fresh = |sent| now.duration_since(sent) < RENEW;
        if self.sent.is_some_and(is_fresh) {
            return None;
        }
        self.sent = Some(now);
        Some(self.velocity)
    }
}

/// What [`run`] shows.
pub enum Shown<'a> {
    /// A message of the server.
    Message(&'a Message),
    /// Why the server refused a command.
    Refused(&'a str),
    /// Nothing new.
    Nothing,
}

/// Follows the robot and, with `dead_man`, drives it, until [`Key::Leave`]. `turn` shows something about every
/// 10 ms and gives the keys since the last time.
///
/// # Errors
/// [`Error::Interrupted`] after Ctrl-C, those of the client and of `turn`. The robot is stopped first.
// Requirement: SERVE-teleop-1
pub fn run(
    client: &mut Client,
    interrupt: &Interrupt,
    mut dead_man: Option<DeadMan>,
    mut turn: impl FnMut(Shown<'_>) -> Result<Vec<Key>, Error>,
) -> Result<(), Error> {
    client.request(&Request::Watch { every: 2 })?;
    let mut drives = false;
    let mut follow = || {
        let mut keys = Vec::new();
        loop {
            interrupt.check()?;
            let message = client.message()?;
            let shown = message.as_ref().map_or(Shown::Nothing, Shown::Message);
            keys.extend(turn(shown)?);
            for key in keys.drain(..) {
                match key {
                    Key::Leave => return Ok(()),
                    Key::Stop => client.request(&Request::Stop)?,
                    _ => {}
                }
                if let Some(dead_man) = &mut dead_man {
                    dead_man.press(key, Instant::now());
                }
            }
            if let Some(dead_man) = &mut dead_man
                && dead_man.poll(Instant::now())?
            {
                client.request(&Request::Stop)?;
            }
            let due = dead_man.as_mut().and_then(|one| one.due(Instant::now()));
            if let Some((forward_mm_s, yaw_rate_deg_s)) = due {
                let command = Request::Drive {
                    forward_mm_s,
                    yaw_rate_deg_s,
                    lease_ms: LEASE_MS,
                };
                let outcome = client.request(&command);
                drives = outcome.is_ok() && (forward_mm_s, yaw_rate_deg_s) != (0.0, 0.0);
                if let Err(why) = outcome {
                    keys = turn(Shown::Refused(&why.to_string()))?;
                }
            }
        }
    };
    let outcome = follow();
    // What it has not stopped itself may be another client's motion.
    if drives {
        // Without a server the connection's end stops it.
        let _ = client.request(&Request::Stop);
    }
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gamepad;

    // Requirement: SERVE-teleop-1
    #[test]
    fn released_key_commands_zero_once() {
        let (mut dead_man, begun) = (DeadMan::new(150.0, 45.0, None), Instant::now());
        let at = |ms| begun + Duration::from_millis(ms);
        assert_eq!(dead_man.due(at(0)), None);
        dead_man.press(Key::Ahead, at(0));
        for (ms, due) in [
            (0, Some((150.0, 0.0))),
            (90, None),
            (100, Some((150.0, 0.0))),
            (290, Some((150.0, 0.0))),
            (299, None),
            (300, Some((0.0, 0.0))),
            (310, None),
            (900, None),
        ] {
            assert_eq!(dead_man.due(at(ms)), due, "{ms}");
        }
        dead_man.press(Key::Back, at(1000));
        assert_eq!(dead_man.due(at(1000)), Some((-150.0, 0.0)));
        dead_man.press(Key::Left, at(1010));
        assert_eq!(dead_man.due(at(1010)), Some((0.0, 45.0)));
        dead_man.press(Key::Right, at(1300));
        assert_eq!(dead_man.due(at(1599)), Some((0.0, -45.0)));
        dead_man.press(Key::Stop, at(1600));
        assert_eq!(dead_man.due(at(1600)), None);
    }

    // Requirement: SERVE-teleop-1
    #[test]
    fn gamepad_drives_while_held_and_must_be_let_go_after_a_stop() {
        let (stick, handle, button) = ((2, 1), (1, 4), (1, 0));
        let (gamepad, mut events) = gamepad::tests::gamepad();
        let begun = Instant::now();
        let mut dead_man = DeadMan::new(150.0, 45.0, Some(gamepad));
        for (ms, (kind, number), value, stop, due) in [
            // Held from the beginning on.
            (0, handle, 1, false, None),
            (100, stick, -32767, false, None),
            (200, handle, 0, false, None),
            (300, handle, 1, false, Some((150.0, 0.0))),
            (1000, stick, 32767, false, Some((-150.0, 0.0))),
            (1010, handle, 0, false, Some((0.0, 0.0))),
            (1100, handle, 1, false, Some((-150.0, 0.0))),
            (1200, button, 1, true, None),
            (1300, button, 0, false, None),
            (1400, handle, 0, false, None),
            (1500, handle, 1, false, Some((-150.0, 0.0))),
        ] {
            gamepad::tests::write(&mut events, kind, number, value);
            let now = begun + Duration::from_millis(ms);
            assert_eq!(dead_man.poll(now), Ok(stop), "{ms}");
            assert_eq!(dead_man.due(now), due, "{ms}");
        }
        // Without the gamepad nothing is held.
        drop(events);
        std::thread::sleep(Duration::from_millis(50));
        assert!(dead_man.poll(begun).is_err());
    }
}
