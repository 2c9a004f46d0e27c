//! The STM's log on a serial device.

use crate::error::Error;
use rustix::fs::{Mode, OFlags};
use rustix::termios::{ControlModes, OptionalActions, isatty, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// A serial device, raw, at the rate that is asked for. The first read at a rate opens it; earlier bytes are lost.
pub struct SerialPort {
    path: PathBuf,
    port: Option<Box<dyn Read>>,
    baud: u32,
}

/// Most bytes that are read at a time: a file that is no terminal may have no end.
const AT_ONCE: u64 = 1 << 16;

impl SerialPort {
    /// The device's file.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        let (path, port, baud) = (path.into(), None, BOOT_BAUD);
        Self { path, port, baud }
    }

    /// The bytes that came since the last call at this rate; never waits.
    ///
    /// # Errors
    /// [`Error::Device`].
    pub fn read_new(&mut self, baud: u32) -> Result<Vec<u8>, Error> {
        if self.baud != baud {
            (self.baud, self.port) = (baud, None);
        }
        let mut fresh = Vec::new();
        match self.read(&mut fresh) {
            // What came before a failure is returned first.
            Err(cause) if cause.kind() != ErrorKind::WouldBlock && fresh.is_empty() => {
                // The next call opens it again.
                self.port = None;
                let advice = "name the Pi's serial port, and join the group dialout";
                Err(Error::device(self.path.display(), cause, advice))
            }
            _ => Ok(fresh),
        }
    }

    fn read(&mut self, fresh: &mut Vec<u8>) -> io::Result<usize> {
        let port = match &mut self.port {
            Some(port) => port,
            closed => closed.insert(Box::new(open(&self.path, self.baud)?)),
        };
        port.take(AT_ONCE).read_to_end(fresh)
    }
}

/// Opens a serial device and sets it; a file that is no terminal is read as it is.
fn open(path: &Path, baud: u32) -> io::Result<File> {
    // Not as the terminal that controls a server without one.
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
    let port = File::from(rustix::fs::open(path, flags, Mode::empty())?);
    if isatty(&port) {
        let mut settings = tcgetattr(&port)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.set_speed(baud)?;
        tcsetattr(&port, OptionalActions::Now, &settings)?;
    }
    Ok(port)
}

/// Of the STM's log until it has read its configuration, bits per second.
pub const BOOT_BAUD: u32 = 115_200;

#[test]
fn serial_port_bytes_or_its_absence_arrive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tty");
    std::fs::write(&path, b"I00000: boot\n").unwrap();
    let mut port = SerialPort::new(&path);
    assert_eq!(port.read_new(BOOT_BAUD), Ok(b"I00000: boot\n".to_vec()));
    assert_eq!(port.read_new(BOOT_BAUD), Ok(Vec::new()));
    let mut device = File::options().append(true).open(&path).unwrap();
    std::io::Write::write_all(&mut device, b"I00001: ready\n").unwrap();
    assert_eq!(port.read_new(BOOT_BAUD), Ok(b"I00001: ready\n".to_vec()));
    std::fs::remove_file(&path).unwrap();
    let mut port = SerialPort::new(&path);
    let missing = port.read_new(BOOT_BAUD);
    assert!(matches!(missing, Err(Error::Device { .. })), "{missing:?}");
    std::fs::write(&path, b"there").unwrap();
    assert_eq!(port.read_new(BOOT_BAUD), Ok(b"there".to_vec()));
}

#[test]
fn terminal_is_set_to_the_logs_speed_and_raw() {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::LocalModes;
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let name = ptsname(&controller, Vec::new()).unwrap();
    let path = Path::new(name.to_str().unwrap());
    let port = open(path, 9_600).unwrap();
    let settings = tcgetattr(&port).unwrap();
    assert_eq!(settings.output_speed(), 9_600);
    let echoes_or_waits = LocalModes::ECHO | LocalModes::ICANON;
    assert!(!settings.local_modes.intersects(echoes_or_waits));
    let (local, reads) = (ControlModes::CLOCAL, ControlModes::CREAD);
    assert!(settings.control_modes.contains(local | reads));
    let flags = rustix::io::fcntl_getfd(&port).unwrap();
    assert!(flags.contains(rustix::io::FdFlags::CLOEXEC));
    // Without bytes it does not wait.
    let mut port = SerialPort::new(path);
    assert_eq!(port.read_new(BOOT_BAUD), Ok(Vec::new()));
    rustix::io::write(&controller, b"I00000: boot").unwrap();
    assert_eq!(port.read_new(BOOT_BAUD), Ok(b"I00000: boot".to_vec()));
    for baud in [57_600, 57_600, 1_234_567] {
        assert_eq!(port.read_new(baud), Ok(Vec::new()));
        assert_eq!(tcgetattr(&controller).unwrap().output_speed(), baud);
    }
}

#[test]
fn bytes_before_a_failure_are_read_and_then_it() {
    struct Unplugged;
    impl Read for Unplugged {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::Error::other("unplugged"))
        }
    }
    let mut port = SerialPort::new("/nonexistent/tty");
    port.port = Some(Box::new([1, 2].as_slice().chain(Unplugged)));
    assert_eq!(port.read_new(BOOT_BAUD), Ok(vec![1, 2]));
    let failure = port.read_new(BOOT_BAUD).unwrap_err().to_string();
    assert!(failure.contains("unplugged"), "{failure}");
    let gone = port.read_new(BOOT_BAUD).unwrap_err().to_string();
    assert!(gone.contains("No such file"), "{gone}");
}
