//! A gamepad by the kernel's joystick interface, `/dev/input/js0` (the kernel's
//! `Documentation/input/joydev/joystick-api.rst`), as most gamepads number their controls.

use host_link::error::Error;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

/// An event: time (ms), value, kind, number of the button or axis.
const EVENT: usize = 8;
const BUTTON: u8 = 1;
const AXIS: u8 = 2;
/// In the kind of the events that tell how everything stood at the beginning.
const INITIAL: u8 = 0x80;
/// Buttons before this one stop; the two from it on, at the shoulders, are dead man's handles.
const SHOULDER: u8 = 4;
/// A stick within this part of its travel is at rest.
const REST: f64 = 0.1;

/// A gamepad's left stick and buttons.
pub struct Gamepad {
    path: PathBuf,
    events: Receiver<Result<[u8; EVENT], String>>,
    /// Left stick, as the kernel counts: right and back are positive.
    stick: [i16; 2],
    shoulders: [bool; 2],
}

impl Gamepad {
    /// Opens a joystick device.
    ///
    /// # Errors
    /// [`Error::Device`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        let file = File::open(path).map_err(|cause| device(path, cause.to_string()))?;
        Ok(Self::reading(path, file))
    }

    /// Reads in a thread, because reading waits for events. It ends at the first event after this gamepad.
    fn reading(path: &Path, mut file: impl Read + Send + 'static) -> Self {
        let (sender, events) = channel();
        thread::spawn(move || {
            loop {
                let mut event = [0; EVENT];
                let read = file.read_exact(&mut event);
                let read = read.map(|()| event).map_err(|cause| match cause.kind() {
                    ErrorKind::UnexpectedEof => "it is gone".into(),
                    _ => cause.to_string(),
                });
                let failed = read.is_err();
                if sender.send(read).is_err() || failed {
                    return;
                }
            }
        });
        Self {
            path: path.to_path_buf(),
            events,
            stick: [0; 2],
            shoulders: [false; 2],
        }
    }

    /// Takes what happened since the last time; whether a button to stop was pressed.
    ///
    /// # Errors
    /// [`Error::Device`] once the gamepad is gone.
    pub fn poll(&mut self) -> Result<bool, Error> {
        let mut stop = false;
        loop {
            match self.events.try_recv() {
                Ok(Ok(event)) => stop |= self.take(event),
                Ok(Err(cause)) => return Err(device(&self.path, cause)),
                Err(TryRecvError::Empty) => return Ok(stop),
                Err(TryRecvError::Disconnected) => {
                    return Err(device(&self.path, "it is gone".into()));
                }
            }
        }
    }

    fn take(&mut self, [_, _, _, _, low, high, kind, number]: [u8; EVENT]) -> bool {
        let value = i16::from_ne_bytes([low, high]);
        match (kind & !INITIAL, number) {
            (AXIS, 0 | 1) => self.stick[usize::from(number)] = value,
            (BUTTON, 0..SHOULDER) => return value != 0 && kind & INITIAL == 0,
            (BUTTON, 4 | 5) => self.shoulders[usize::from(number - SHOULDER)] = value != 0,
            _ => {}
        }
        false
    }

    /// Ahead and to the left, −1 to 1, while a dead man's handle is held.
    // Requirement: SERVE-teleop-1
    pub fn held(&self) -> Option<(f64, f64)> {
        let part = |value: i16| {
            let part = (-f64::from(value) / f64::from(i16::MAX)).clamp(-1.0, 1.0);
            if part.abs() < REST { 0.0 } else { part }
        };
        let [right, back] = self.stick;
        let held = self.shoulders.contains(&true);
        held.then(|| (part(back), part(right)))
    }
}

fn device(path: &Path, cause: String) -> Error {
    let name = format!("the gamepad {}", path.display());
    let advice = "connect it, name its joystick device with --gamepad, and join the group input";
    Error::device(name, cause, advice)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::io::{PipeWriter, Write, pipe};
    use std::time::Duration;

    /// A gamepad and what its events are written to.
    pub(crate) fn gamepad() -> (Gamepad, PipeWriter) {
        let (reader, writer) = pipe().unwrap();
        (Gamepad::reading(Path::new("js0"), reader), writer)
    }

    /// Writes an event and waits until the gamepad has read it.
    pub(crate) fn write(to: &mut PipeWriter, kind: u8, number: u8, value: i16) {
        let [low, high] = value.to_ne_bytes();
        to.write_all(&[0, 0, 0, 0, low, high, kind, number])
            .unwrap();
        thread::sleep(Duration::from_millis(50));
    }

    // Requirement: SERVE-teleop-1
    #[test]
    fn stick_counts_while_a_shoulder_is_held() {
        let (mut gamepad, mut events) = gamepad();
        for (kind, number, value, stop, held) in [
            (BUTTON | INITIAL, 0, 1, false, None),
            (AXIS, 1, -32767, false, None),
            (BUTTON, SHOULDER, 1, false, Some((1.0, 0.0))),
            (AXIS, 0, -3000, false, Some((1.0, 0.0))),
            (AXIS, 0, i16::MIN, false, Some((1.0, 1.0))),
            (AXIS, 1, 32767, false, Some((-1.0, 1.0))),
            (AXIS, 2, 5, false, Some((-1.0, 1.0))),
            (BUTTON, 3, 1, true, Some((-1.0, 1.0))),
            (BUTTON, 5, 1, false, Some((-1.0, 1.0))),
            (BUTTON, 4, 0, false, Some((-1.0, 1.0))),
            (BUTTON, 5, 0, false, None),
        ] {
            write(&mut events, kind, number, value);
            assert_eq!(
                (gamepad.poll(), gamepad.held()),
                (Ok(stop), held),
                "{kind} {number}"
            );
        }
        drop(events);
        thread::sleep(Duration::from_millis(50));
        assert!(matches!(gamepad.poll(), Err(Error::Device { .. })));
        let missing = Gamepad::open(Path::new("/nonexistent/js0"));
        assert!(matches!(missing, Err(Error::Device { .. })));
    }
}
