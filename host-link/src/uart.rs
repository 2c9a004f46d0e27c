//! Sources of the STM's log: a serial device that is configured already, or the virtual board's UART.

use crate::error::Error;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{channel, Receiver};
use std::thread;
use std::time::Duration;

/// The STM's log.
pub trait LogSource {
    /// The bytes that came since the last call; never waits.
    ///
    /// # Errors
    /// [`Error::Device`].
    fn read_new(&mut self) -> Result<Vec<u8>, Error>;
}

/// A serial device, 115200 baud, raw, as `stty` left it. It is opened at the first read; earlier bytes
/// are lost.
pub struct SerialPort {
    path: PathBuf,
    received: Option<Receiver<Result<Vec<u8>, String>>>,
}

impl SerialPort {
    /// The device's file.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            received: None,
        }
    }
}

impl LogSource for SerialPort {
    fn read_new(&mut self) -> Result<Vec<u8>, Error> {
        let path = &self.path;
        let received = self.received.get_or_insert_with(|| spawn_reader(path));
        let mut fresh = Vec::new();
        for bytes in received.try_iter() {
            fresh.extend(bytes.map_err(|cause| Error::Device {
                name: path.display().to_string(),
                cause,
                advice: format!(
                    "name the Pi's serial port with --uart, join the group dialout, and run \
                     `stty -F {} 115200 raw -echo`",
                    path.display()
                ),
            })?);
        }
        Ok(fresh)
    }
}

/// Polling period of a serial device without bytes.
const POLL: Duration = Duration::from_millis(2);

/// Reads in a thread, because reading a serial device blocks. The thread ends with the receiver.
fn spawn_reader(path: &Path) -> Receiver<Result<Vec<u8>, String>> {
    let (sender, receiver) = channel();
    let path = path.to_owned();
    thread::spawn(move || {
        let mut file = match File::open(&path) {
            Ok(file) => file,
            Err(cause) => {
                let _ = sender.send(Err(cause.to_string()));
                return;
            }
        };
        let mut buffer = [0; 4096];
        loop {
            let read = match file.read(&mut buffer) {
                Ok(0) => {
                    thread::sleep(POLL);
                    Ok(Vec::new())
                }
                Ok(len) => Ok(buffer.get(..len).unwrap_or_default().to_vec()),
                Err(cause) => Err(cause.to_string()),
            };
            let failed = read.is_err();
            if sender.send(read).is_err() || failed {
                return;
            }
        }
    });
    receiver
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_for(mut tty: SerialPort) -> Result<Vec<u8>, Error> {
        for _ in 0..500 {
            let fresh = tty.read_new()?;
            if !fresh.is_empty() {
                return Ok(fresh);
            }
            thread::sleep(POLL);
        }
        Ok(Vec::new())
    }

    #[test]
    fn serial_port_bytes_arrive() {
        let path = std::env::temp_dir().join(format!("robot-tty-{}", std::process::id()));
        std::fs::write(&path, b"I00000: boot\n").unwrap();
        assert_eq!(read_for(SerialPort::new(&path)).unwrap(), b"I00000: boot\n");
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn serial_port_missing_is_an_error() {
        let outcome = read_for(SerialPort::new("/nowhere/at/all"));
        assert!(matches!(outcome, Err(Error::Device { .. })), "{outcome:?}");
    }
}
