//! The STM's log on a serial device.

use crate::error::Error;
use rustix::fs::{Mode, OFlags};
use rustix::termios::{ControlModes, OptionalActions, isatty, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

/// A serial device, set to 115200 baud, raw. It is opened at the first read; earlier bytes are lost.
pub struct SerialPort {
    path: PathBuf,
    received: Option<Receiver<Result<Vec<u8>, String>>>,
    /// Follows the bytes that came before it.
    failure: Option<Error>,
}

impl SerialPort {
    /// The device's file.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            received: None,
            failure: None,
        }
    }

    /// The bytes that came since the last call; never waits.
    ///
    /// # Errors
    /// [`Error::Device`].
    pub fn read_new(&mut self) -> Result<Vec<u8>, Error> {
        let path = &self.path;
        let received = self.received.get_or_insert_with(|| spawn_reader(path));
        let mut fresh = Vec::new();
        for bytes in received.try_iter() {
            let advice = "name the Pi's serial port, and join the group dialout";
            match bytes {
                Ok(bytes) => fresh.extend(bytes),
                Err(cause) => self.failure = Some(Error::device(path.display(), cause, advice)),
            }
        }
        match self.failure.take_if(|_| fresh.is_empty()) {
            Some(failure) => {
                // The next reader tries again.
                self.received = None;
                Err(failure)
            }
            None => Ok(fresh),
        }
    }
}

/// Opens a serial device and sets it; a file that is no terminal is read as it is.
fn open(path: &Path) -> io::Result<File> {
    // Not as the terminal that controls a server without one.
    let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::CLOEXEC;
    let port = File::from(rustix::fs::open(path, flags, Mode::empty())?);
    if isatty(&port) {
        let mut settings = tcgetattr(&port)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.set_speed(BAUD)?;
        tcsetattr(&port, OptionalActions::Now, &settings)?;
    }
    Ok(port)
}

/// Of the STM's log, bits per second.
const BAUD: u32 = 115_200;

/// Polling period of a serial device without bytes.
const POLL: Duration = Duration::from_millis(2);

/// Reads in a thread, because reading a serial device blocks. The thread ends with the receiver.
fn spawn_reader(path: &Path) -> Receiver<Result<Vec<u8>, String>> {
    let (sender, receiver) = channel();
    let path = path.to_owned();
    thread::spawn(move || {
        let mut file = open(&path);
        let mut buffer = [0; 4096];
        loop {
            let read = match &mut file {
                Ok(file) => file.read(&mut buffer).map_err(|cause| cause.to_string()),
                Err(cause) => Err(cause.to_string()),
            };
            if read == Ok(0) {
                thread::sleep(POLL);
            }
            let failed = read.is_err();
            let bytes = read.map(|len| buffer.get(..len).unwrap_or_default().to_vec());
            if sender.send(bytes).is_err() || failed {
                return;
            }
        }
    });
    receiver
}

#[test]
fn serial_port_bytes_or_its_absence_arrive() {
    let read = |port: &mut SerialPort| {
        let mut reads = (0..500).map(|_| {
            thread::sleep(POLL);
            port.read_new()
        });
        let is_something = |read: &Result<Vec<u8>, Error>| !read.as_ref().is_ok_and(Vec::is_empty);
        reads.find(is_something)
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tty");
    std::fs::write(&path, b"I00000: boot\n").unwrap();
    let mut port = SerialPort::new(&path);
    assert_eq!(read(&mut port), Some(Ok(b"I00000: boot\n".to_vec())));
    // What comes after a pause.
    thread::sleep(2 * POLL);
    let mut device = File::options().append(true).open(&path).unwrap();
    std::io::Write::write_all(&mut device, b"I00001: ready\n").unwrap();
    assert_eq!(read(&mut port), Some(Ok(b"I00001: ready\n".to_vec())));
    std::fs::remove_file(&path).unwrap();
    let mut port = SerialPort::new(&path);
    let missing = read(&mut port);
    assert!(
        matches!(missing, Some(Err(Error::Device { .. }))),
        "{missing:?}"
    );
    std::fs::write(&path, b"there").unwrap();
    assert_eq!(read(&mut port), Some(Ok(b"there".to_vec())));
    std::fs::remove_file(&path).unwrap();
    let once: Vec<_> = spawn_reader(&path).iter().collect();
    assert!(matches!(once.as_slice(), [Err(_)]), "{once:?}");
}

#[test]
fn terminal_is_set_to_the_logs_speed_and_raw() {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::LocalModes;
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let name = ptsname(&controller, Vec::new()).unwrap();
    let port = open(Path::new(name.to_str().unwrap())).unwrap();
    let settings = tcgetattr(&port).unwrap();
    assert_eq!(settings.output_speed(), BAUD);
    let echoes_or_waits = LocalModes::ECHO | LocalModes::ICANON;
    assert!(!settings.local_modes.intersects(echoes_or_waits));
    let (local, reads) = (ControlModes::CLOCAL, ControlModes::CREAD);
    assert!(settings.control_modes.contains(local | reads));
    let flags = rustix::io::fcntl_getfd(&port).unwrap();
    assert!(flags.contains(rustix::io::FdFlags::CLOEXEC));
}

#[test]
fn bytes_before_a_failure_are_read_and_then_it() {
    let (sender, receiver) = channel();
    for received in [Ok(vec![1]), Ok(vec![2]), Err("unplugged".into())] {
        sender.send(received).unwrap();
    }
    let mut port = SerialPort::new("tty");
    port.received = Some(receiver);
    assert_eq!(port.read_new(), Ok(vec![1, 2]));
    assert!(matches!(port.read_new(), Err(Error::Device { .. })));
}
