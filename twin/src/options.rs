//! Configuration of a virtual robot.

use std::num::NonZeroU64;

use plant::{GyroParams, Params, Pose2, Room};

use crate::emulator::Debugger;

/// 100 MHz at 1.7 cycles an instruction, to the nearest ten: `mips_estimate` of target/figures.json.
const MIPS: NonZeroU64 = NonZeroU64::new(60).expect("not zero");

/// How a virtual robot is built. The default is the first board with a blank EEPROM at the start of
/// the default room.
#[derive(Debug)]
pub struct Options {
    /// Seed of all random numbers of the run.
    pub seed: u64,
    /// The room.
    pub room: Room,
    /// Where the robot starts; the room's own start when `None`.
    pub start: Option<Pose2>,
    /// Motors, battery, chassis and rangefinders, and the world's imperfections: none by default.
    pub params: Params,
    /// The EEPROM's first bytes, erased past their end; `None`: no EEPROM is fitted.
    pub eeprom: Option<Vec<u8>>,
    /// The MPU6050's errors, unless the imperfections draw them; `None`: none is fitted.
    pub mpu: Option<GyroParams>,
    /// The crystal's frequency, hertz; 0: none oscillates.
    pub crystal_hz: u64,
    /// Instructions that the core retires in a microsecond of its 100 MHz clock. The default, 60, is
    /// about what [`cycles`](crate::trace::cycles) estimates for the firmware.
    pub mips: NonZeroU64,
    /// Bytes of a reply that have left the memory before the first clock, 1 ..= 3: one or two that the idle
    /// SPI slave holds, and one that the DMA does. The default, 3, is the most.
    pub spi_prefetch: u8,
    /// The factory's calibration words: voltage reference, temperature sensor at 30 and at 110 °C.
    pub calibration_words: [u16; 3],
    /// A debugger's port.
    pub debugger: Option<Debugger>,
}

impl Options {
    /// The default with these bytes at the EEPROM's begin.
    #[must_use]
    pub fn with_eeprom(bytes: Vec<u8>) -> Self {
        Self {
            eeprom: Some(bytes),
            ..Self::default()
        }
    }

    /// The same in another room.
    #[must_use]
    pub fn in_room(self, room: Room) -> Self {
        Self { room, ..self }
    }

    /// The same from another start.
    #[must_use]
    pub fn at(self, start: Pose2) -> Self {
        let start = Some(start);
        Self { start, ..self }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            seed: 1,
            room: Room::two_rooms(),
            start: None,
            params: Params::default(),
            eeprom: Some(Vec::new()),
            mpu: Some(GyroParams::default()),
            crystal_hz: 8_000_000,
            mips: MIPS,
            spi_prefetch: 3,
            // The reference's 1.21 V, and 0.76 V at 25 °C with 2.5 mV/K, converted at 3.3 V: what the
            // converter's model returns (STM32F411xC/xE datasheet, temperature sensor and internal
            // reference characteristics).
            calibration_words: [1501, 959, 1207],
            debugger: None,
        }
    }
}
