//! The byte tables of `docs/interfaces.md` (document, 5.1 and 5.2), written a second time: offsets
//! and conditions as the page states them, without the chain, so that an error in the chain cannot
//! be in here too.

use fw_core::wire::strategy::Context;
use fw_core::wire::{CellCode, Command, MAX_FRAME, Mode, Order, PoseCode, Report, Sequence, State};

/// The bytes of a frame; those beyond the mode's length are not looked at.
pub type Frame = [u8; MAX_FRAME];

/// Where the fields of a mode's frame stand.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Sequence at 1, status at 3, CRC in the last two bytes.
    pub guarded: bool,
    /// The double, or else the position.
    pub double: Option<usize>,
    /// The position, where there is no double.
    pub position: usize,
    /// The battery.
    pub battery: usize,
    /// The first rangefinder's reading, and how many there are.
    pub ranges: (usize, usize),
    /// The bearing.
    pub bearing: Option<usize>,
    /// The gyroscope's angle; the velocity stands where the position is, and the last two readings
    /// behind the bearing.
    pub gyro: Option<usize>,
    /// Bytes in all.
    pub len: usize,
}

/// The table of a mode.
pub const fn table(mode: Mode) -> Table {
    let plain = Table {
        guarded: false,
        double: None,
        position: 1,
        battery: 11,
        ranges: (13, 3),
        bearing: None,
        gyro: None,
        len: 19,
    };
    match mode {
        Mode::Normal => plain,
        Mode::TuneRotate | Mode::TuneMove => Table {
            double: Some(1),
            battery: 9,
            ranges: (0, 0),
            len: 11,
            ..plain
        },
        Mode::GuardedNormal => Table {
            guarded: true,
            position: 6,
            battery: 16,
            ranges: (18, 3),
            len: 26,
            ..plain
        },
        Mode::GuardedTuneRotate | Mode::GuardedTuneMove => Table {
            guarded: true,
            double: Some(6),
            battery: 14,
            ranges: (0, 0),
            len: 18,
            ..plain
        },
        Mode::GuardedSweep => Table {
            guarded: true,
            position: 6,
            battery: 16,
            ranges: (18, 1),
            bearing: Some(20),
            len: 24,
            ..plain
        },
        Mode::GuardedVelocity => Table {
            guarded: true,
            position: 6,
            gyro: Some(16),
            battery: 20,
            ranges: (22, 3),
            bearing: Some(24),
            len: 32,
            ..plain
        },
    }
}

/// Two bytes, the upper one first.
pub const fn word(frame: &Frame, at: usize) -> u16 {
    (frame[at] as u16) << 8 | frame[at + 1] as u16
}

/// Four bytes, the uppermost one first.
const fn long(frame: &Frame, at: usize) -> i32 {
    ((word(frame, at) as u32) << 16 | word(frame, at + 2) as u32) as i32
}

/// Eight bytes, the lowest one first.
const fn double(frame: &Frame, at: usize) -> u64 {
    let mut bits = 0;
    let mut place = 8;
    while place > 0 {
        place -= 1;
        bits = bits << 8 | frame[at + place] as u64;
    }
    bits
}

/// The bits of 100.0.
const HUNDRED: u64 = 100.0_f64.to_bits();

/// Whether a double is a number.
const fn is_number(bits: u64) -> bool {
    bits >> 52 & 0x7FF != 0x7FF
}

/// Whether `own` is 1 to 127 steps after `last`.
pub const fn is_fresh(last: Option<u8>, own: u8) -> bool {
    match last {
        None => true,
        Some(last) => {
            let ahead = (own as u16 + 0x100 - last as u16) & 0xFF;
            ahead >= 1 && ahead <= 127
        }
    }
}

const fn pose(frame: &Frame, at: usize) -> PoseCode {
    PoseCode {
        x: long(frame, at),
        y: long(frame, at + 4),
        rotation: word(frame, at + 8) & 0x7FFF,
    }
}

const fn cell(frame: &Frame, at: usize) -> CellCode {
    CellCode {
        cell: frame[at] >> 5,
        voltage: word(frame, at) & 0x1FFF,
    }
}

/// Whether a frame of the Pi is right in everything but its CRC.
pub const fn command_is_right(mode: Mode, context: &Context, frame: &Frame) -> bool {
    let table = table(mode);
    if frame[0] != context.key_from_pi || frame[table.battery] >> 5 >= context.cells {
        return false;
    }
    if table.guarded && (!is_fresh(context.last, frame[1]) || frame[5] > 2) {
        return false;
    }
    match table.double {
        Some(at) => {
            let percent = double(frame, at);
            is_number(percent) && percent & !(1 << 63) <= HUNDRED
        }
        None => table.gyro.is_none() || word(frame, table.position + 8) == 0,
    }
}

/// Whether a frame of the STM is right in everything but its CRC.
pub const fn report_is_right(mode: Mode, context: &Context, frame: &Frame) -> bool {
    let table = table(mode);
    if frame[0] != context.key_from_stm || frame[table.battery] >> 5 >= context.cells {
        return false;
    }
    if table.guarded && (!is_fresh(context.last, frame[1]) || frame[5] & 0x3F > 4) {
        return false;
    }
    match table.double {
        Some(at) => is_number(double(frame, at)),
        None => true,
    }
}

/// Whether `command` is what a right frame of the Pi says; what the mode does not carry has its
/// default.
pub fn command_says(mode: Mode, frame: &Frame, command: &Command) -> bool {
    let table = table(mode);
    let default = Command::default();
    let driven = if let Some(at) = table.double {
        command.percent.0 == double(frame, at)
            && command.expected == default.expected
            && !command.apply
    } else if table.gyro.is_some() {
        command.velocity.forward == long(frame, table.position)
            && command.velocity.yaw_rate == long(frame, table.position + 4)
            && command.percent == default.percent
            && command.expected == default.expected
            && !command.apply
    } else {
        command.expected == pose(frame, table.position)
            && command.percent == default.percent
            && command.apply == (frame[table.position + 8] >> 7 == 1)
    };
    let sweep = table.bearing.map_or(0, |at| word(frame, at));
    let guard = if table.guarded {
        let order = match frame[5] {
            0 => Order::None,
            1 => Order::Stop,
            _ => Order::Resume,
        };
        command.sequence
            == (Sequence {
                own: frame[1],
                seen: frame[2],
            })
            && command.clear_faults.bits() == word(frame, 3)
            && command.order == order
    } else {
        command.sequence == default.sequence
            && command.clear_faults.is_empty()
            && command.order == default.order
    };
    driven
        && guard
        && (table.gyro.is_some() || command.velocity == default.velocity)
        && command.sweep == sweep
        && command.tune == cell(frame, table.battery)
}

/// Whether `report` is what a right frame of the STM says; what the mode does not carry has its
/// default.
pub fn report_says(mode: Mode, frame: &Frame, report: &Report) -> bool {
    let table = table(mode);
    let default = Report::default();
    let measured = match table.double {
        Some(at) => report.measurement.0 == double(frame, at) && report.pose == default.pose,
        None => {
            report.measurement == default.measurement && report.pose == pose(frame, table.position)
        }
    };
    let guard = if table.guarded {
        let state = match frame[5] & 0x3F {
            0 => State::Booting,
            1 => State::Ready,
            2 => State::Moving,
            3 => State::Stopped,
            _ => State::Faulted,
        };
        report.sequence
            == (Sequence {
                own: frame[1],
                seen: frame[2],
            })
            && report.faults.bits() == word(frame, 3)
            && report.state == state
            && report.obstacle_limited == (frame[5] & 0x40 != 0)
            && report.clipped == (frame[5] & 0x80 != 0)
    } else {
        report.sequence == default.sequence
            && report.faults.is_empty()
            && report.state == default.state
            && !report.obstacle_limited
            && !report.clipped
    };
    let (first, count) = table.ranges;
    let range = |which: usize| {
        if which < count {
            let behind_bearing = which > 0 && table.bearing.is_some();
            word(frame, first + 2 * (which + usize::from(behind_bearing)))
        } else {
            0xFFFF
        }
    };
    let gyro = match table.gyro {
        Some(at) => long(frame, at),
        None => i32::MIN,
    };
    let bearing = match table.bearing {
        Some(at) => word(frame, at),
        None => 0,
    };
    measured
        && guard
        && report.cell == cell(frame, table.battery)
        && report.ranges[0].0 == range(0)
        && report.ranges[1].0 == range(1)
        && report.ranges[2].0 == range(2)
        && report.bearing == bearing
        && report.gyro.0 == gyro
}
