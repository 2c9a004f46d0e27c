//! The AT24CS64 on the I2C bus: 8 KiB behind two address bytes (datasheet 8870).
//!
//! A write fills the 32-byte page it starts in, wrapping inside it; the stop starts the write
//! cycle, during which the part does not acknowledge its address. With the write-protect pin high
//! it acknowledges the address and its two address bytes, refuses the data and writes nothing. A
//! read continues through the array and wraps at its end. Not modelled: the serial number behind
//! address 0x58.

/// Bytes of the array.
pub const SIZE: usize = 8192;
/// Bytes of a page.
pub const PAGE: usize = 32;
/// The address on the bus.
pub const ADDRESS: u8 = 0x50;
/// The longest write cycle, nanoseconds (datasheet table 5-4, tWR).
pub const WRITE_CYCLE_NS: u64 = 5_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// The word address is to come.
    Address,
    /// Its second byte is to come; this was the first.
    AddressLow(u8),
    Data,
    Reading,
}

/// The part.
#[derive(Clone, Debug)]
pub struct Eeprom {
    bytes: Vec<u8>,
    pointer: usize,
    phase: Phase,
    /// The page as it will be written, and which of its bytes are new.
    latch: Vec<(usize, u8)>,
    busy_until: u64,
    /// The write-protect pin is high.
    pub write_protected: bool,
    /// A cell that no longer holds its charge: its address, and whether its lowest bit was wrong when it was last
    /// read, as it is every other time.
    pub weak: Option<(usize, bool)>,
    writes: u64,
}

impl Eeprom {
    /// A part with these contents, erased (0xFF) past their end.
    pub fn new(bytes: &[u8]) -> Self {
        let mut contents = bytes.to_vec();
        contents.resize(SIZE, 0xFF);
        Self {
            bytes: contents,
            pointer: 0,
            phase: Phase::Idle,
            latch: Vec::new(),
            busy_until: 0,
            write_protected: true,
            weak: None,
            writes: 0,
        }
    }

    /// The contents.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The contents, to be changed other than by the bus.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// Write cycles so far.
    pub fn writes(&self) -> u64 {
        self.writes
    }

    /// Whether a read is under way, in which a lost clock leaves the part driving the data line.
    pub fn is_reading(&self) -> bool {
        self.phase == Phase::Reading
    }

    /// A start with `address` at `now`. Returns the acknowledge.
    pub fn start(&mut self, now: u64, address: u8, read: bool) -> bool {
        if address != ADDRESS || now < self.busy_until {
            self.phase = Phase::Idle;
            return false;
        }
        // A repeated start drops what was not yet ended by a stop.
        self.latch.clear();
        self.phase = if read { Phase::Reading } else { Phase::Address };
        true
    }

    /// A byte from the controller. Returns the acknowledge.
    pub fn write(&mut self, byte: u8) -> bool {
        match self.phase {
            Phase::Address => self.phase = Phase::AddressLow(byte),
            Phase::AddressLow(high) => {
                self.pointer = usize::from(u16::from_be_bytes([high, byte])) % SIZE;
                self.phase = Phase::Data;
            }
            Phase::Data if !self.write_protected => {
                self.latch.push((self.pointer, byte));
                let page = self.pointer / PAGE * PAGE;
                self.pointer = page + (self.pointer + 1) % PAGE;
            }
            Phase::Data | Phase::Idle | Phase::Reading => return false,
        }
        true
    }

    /// A byte to the controller.
    pub fn read(&mut self) -> u8 {
        let mut byte = self.bytes[self.pointer];
        if let Some((_, wrong)) = self.weak.as_mut().filter(|weak| weak.0 == self.pointer) {
            *wrong = !*wrong;
            byte ^= u8::from(*wrong);
        }
        self.pointer = (self.pointer + 1) % SIZE;
        byte
    }

    /// A stop at `now`.
    pub fn stop(&mut self, now: u64) {
        if !self.latch.is_empty() {
            for (at, byte) in self.latch.drain(..) {
                self.bytes[at] = byte;
            }
            self.busy_until = now + WRITE_CYCLE_NS;
            self.writes += 1;
        }
        self.phase = Phase::Idle;
    }

    /// The bus was switched away: nothing latched is written.
    pub fn abort(&mut self) {
        self.latch.clear();
        self.phase = Phase::Idle;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blank() -> Eeprom {
        let mut eeprom = Eeprom::new(&[]);
        eeprom.write_protected = false;
        eeprom
    }

    fn send(eeprom: &mut Eeprom, now: u64, bytes: &[u8]) -> Vec<bool> {
        assert!(eeprom.start(now, ADDRESS, false));
        let acknowledged = bytes.iter().map(|&byte| eeprom.write(byte)).collect();
        eeprom.stop(now);
        acknowledged
    }

    fn receive(eeprom: &mut Eeprom, now: u64, at: u16, count: usize) -> Vec<u8> {
        assert!(eeprom.start(now, ADDRESS, false));
        for byte in at.to_be_bytes() {
            assert!(eeprom.write(byte));
        }
        assert!(eeprom.start(now, ADDRESS, true));
        let bytes = (0..count).map(|_| eeprom.read()).collect();
        eeprom.stop(now);
        bytes
    }

    #[test]
    fn write_wraps_inside_its_page() {
        let mut eeprom = blank();
        send(&mut eeprom, 0, &[0x00, 0x3E, 1, 2, 3, 4]);
        let later = WRITE_CYCLE_NS;
        assert_eq!(receive(&mut eeprom, later, 0x3E, 2), [1, 2]);
        assert_eq!(receive(&mut eeprom, later, 0x20, 3), [3, 4, 0xFF]);
        assert_eq!(receive(&mut eeprom, later, 0x40, 1), [0xFF]);
    }

    #[test]
    fn write_cycle_is_not_acknowledged() {
        let mut eeprom = blank();
        send(&mut eeprom, 1000, &[0, 0, 7]);
        assert!(!eeprom.start(1000 + WRITE_CYCLE_NS - 1, ADDRESS, false));
        assert!(eeprom.start(1000 + WRITE_CYCLE_NS, ADDRESS, false));
        assert!(!eeprom.start(1000 + WRITE_CYCLE_NS, 0x68, false));
    }

    #[test]
    fn read_continues_and_wraps_at_end_of_array() {
        let mut eeprom = Eeprom::new(&(0..SIZE).map(|n| n.to_le_bytes()[0]).collect::<Vec<_>>());
        assert_eq!(receive(&mut eeprom, 0, 0x1FFE, 4), [0xFE, 0xFF, 0, 1]);
        assert!(eeprom.start(0, ADDRESS, true));
        assert_eq!(
            eeprom.read(),
            2,
            "the pointer stays where the last read ended"
        );
    }

    #[test]
    fn write_protect_refuses_data() {
        let mut eeprom = Eeprom::new(&[9]);
        assert_eq!(send(&mut eeprom, 0, &[0, 0, 7]), [true, true, false]);
        assert_eq!(receive(&mut eeprom, 0, 0, 1), [9]);
        assert_eq!(eeprom.writes(), 0);
    }

    #[test]
    fn write_without_stop_is_lost() {
        let mut eeprom = blank();
        eeprom.start(0, ADDRESS, false);
        for byte in [0, 0, 7] {
            eeprom.write(byte);
        }
        eeprom.start(0, ADDRESS, true);
        eeprom.stop(0);
        assert_eq!(receive(&mut eeprom, 0, 0, 1), [0xFF]);
    }
}
