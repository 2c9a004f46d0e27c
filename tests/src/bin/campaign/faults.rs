//! The faults of the campaign, and what must report each.

use fw_core::types::Faults;
use plant::Rng;
use twin::{Board, I2cController, Mpu6050Fault};

/// The faults that reset the part.
pub const RESTARTING: [&str; 5] = ["no ticks", "reset by pin", "brown-out", CRYSTAL, HALTED];
/// The one in which nothing else is reported.
pub const HALTED: &str = "core halted";

/// The one for which the ELF must be changed.
pub const CRYSTAL: &str = "crystal dies";

/// Faults that another one hides: lines that a blocked log has no room for are counted alone.
pub const HIDDEN: [(&str, &str); 2] = [
    ("front sensor unplugged", "log blocked"),
    ("echo lines crossed", "log blocked"),
];

/// Whether it is a gyroscope that lies: after a reset it has no bias that it could be off from.
pub fn lies_after_reset(kind: &Kind) -> bool {
    matches!(
        kind.1,
        Cause::Gyro(Mpu6050Fault::Offset(_) | Mpu6050Fault::Jumps(_))
    )
}

/// What happens to the Pi's frames.
#[derive(Clone, Copy, PartialEq)]
pub enum Frames {
    Flood,
    Silent,
    Torn,
    Short,
    Long,
    Corrupt,
}

/// What must report a fault.
#[derive(Clone, Copy)]
pub enum Sign {
    /// Nothing: the robot copes, or cannot know.
    None,
    /// One of these faults.
    Latched(Faults),
    /// One of these faults, where the wheel that the first names was driven for long enough.
    Driven(Faults),
    /// A line of the log.
    Log(&'static str),
}

/// What a fault changes.
#[derive(Clone, Copy)]
pub enum Cause {
    Frames(Frames),
    World(fn(&mut plant::Faults)),
    Gyro(Mpu6050Fault),
    /// How it begins and how it ends.
    Wires(fn(&Board), fn(&Board)),
    /// What happens each millisecond, and then at its end.
    Each(fn(&Board, bool)),
}

impl Cause {
    /// Begins a fault of the board or its world, or ends it.
    pub fn set(self, board: &Board, on: bool) {
        match self {
            Self::Frames(_) => {}
            Self::World(change) if on => board.set_faults(change),
            Self::World(_) => board.set_faults(|all| *all = plant::Faults::default()),
            Self::Gyro(fault) => {
                let fault = if on { fault } else { Mpu6050Fault::None };
                board.set_mpu(move |mpu| mpu.fault = fault);
            }
            Self::Wires(begin, end) => (if on { begin } else { end })(board),
            Self::Each(act) => act(board, on),
        }
    }
}

/// What a fault leaves beside its sign.
#[derive(Clone, Copy, PartialEq)]
pub enum After {
    Nothing,
    /// A reset ends it or what reports it.
    Reset,
    /// The pose may be wrong.
    Pose,
}

/// A fault that the virtual board can have.
pub struct Kind(pub &'static str, pub Cause, pub Sign, pub After);

use After::{Nothing, Pose, Reset};
use Cause::{Each, Frames as On, Gyro, Wires, World};

const LOST: Sign = Sign::Latched(Faults::LINK_LOST);
const NO_GYRO: Sign = Sign::Latched(Faults::GYRO_LOST);

const fn stalled(wheel: Faults) -> Sign {
    Sign::Driven(wheel.union(Faults::SLIP))
}

fn hold(board: &Board, pulses: u32) {
    board.i2c_bus(move |bus, _| bus.sda_held_by_mpu = pulses);
}

/// Flips a bit of a gain.
fn flip(board: &Board) {
    board.i2c_bus(|bus, _| {
        if let Some(eeprom) = &mut bus.eeprom {
            eeprom.bytes_mut()[0x105] ^= 1;
        }
    });
}

/// A cell of a gain is read wrongly every other time, or holds again.
fn weaken(board: &Board, weak: bool) {
    board.i2c_bus(move |bus, _| {
        if let Some(eeprom) = &mut bus.eeprom {
            eeprom.weak = weak.then_some((0x105, false));
        }
    });
}

/// A device on the bus stretches the clock for a while.
fn stretch(board: &Board, on: bool) {
    board.stretch_i2c(on);
    if on {
        board.run_us(300);
        board.stretch_i2c(false);
    }
}

/// The supply falls below the level of the brown-out reset, 2.4 V, and comes back.
fn brown_out(board: &Board) {
    board.hold_reset(true);
    board.brown_out();
    board.dip_supply(2_300, 1_000);
    board.hold_reset(false);
}

/// A short pulse on the RESET line.
pub fn reset(board: &Board) {
    board.hold_reset(true);
    board.run_us(1_000);
    board.hold_reset(false);
}

/// Every fault alone and every pair, in an order that the seed draws; the gyroscope has one at a time, and none that
/// interrupts by an error while that interrupt stands for the dead crystal's.
pub fn combinations(seed: u64) -> Vec<(usize, usize)> {
    let of_gyro = |kind: usize| matches!(KINDS[kind].1, Cause::Gyro(_));
    let of_bus = |kind: usize| of_gyro(kind) || matches!(KINDS[kind].1, Cause::Each(_));
    let crystal = |kind: usize| KINDS[kind].0 == CRYSTAL;
    let mut all: Vec<_> = (0..KINDS.len())
        .flat_map(|a| (a..KINDS.len()).map(move |b| (a, b)))
        .filter(|&(a, b)| a == b || !(of_gyro(a) && of_gyro(b)))
        .filter(|&(a, b)| !(crystal(a) && of_bus(b) || of_bus(a) && crystal(b)))
        .collect();
    let mut random = Rng::new(seed);
    for end in (1..all.len()).rev() {
        all.swap(end, random.below(end + 1));
    }
    all
}

macro_rules! kinds {
    ($($name:literal: $cause:expr, $sign:expr, $after:expr;)*) => {
        /// Every fault that the virtual board can have while it runs.
        pub const KINDS: &[Kind] = &[$(Kind($name, $cause, $sign, $after)),*];
    };
}

kinds! {
    "silent host": On(Frames::Silent), LOST, Reset;
    "torn frames": On(Frames::Torn), LOST, Reset;
    "short frames": On(Frames::Short), LOST, Reset;
    "long frames": On(Frames::Long), LOST, Reset;
    "corrupt frames": On(Frames::Corrupt), LOST, Reset;
    "flood of frames": On(Frames::Flood), Sign::None, Nothing;
    // To the gyroscope a wheel that does not count slips, for two seconds.
    "left encoder dead": World(|f| f.dead_encoder.left = true), stalled(Faults::LEFT_STALLED), Pose;
    "right encoder dead": World(|f| f.dead_encoder.right = true), stalled(Faults::RIGHT_STALLED), Pose;
    "left encoder's channel dead": World(|f| f.dead_channel.left = true), stalled(Faults::LEFT_STALLED), Pose;
    "right encoder's channel dead": World(|f| f.dead_channel.right = true), stalled(Faults::RIGHT_STALLED), Pose;
    "left encoder noisy": World(|f| f.noisy_encoder.left = true), Sign::None, Nothing;
    "left wheel blocked": World(|f| f.jammed.left = true), Sign::Driven(Faults::LEFT_STALLED), Nothing;
    "right wheel blocked": World(|f| f.jammed.right = true), Sign::Driven(Faults::RIGHT_STALLED), Nothing;
    "left wheel slips": World(|f| f.slip.left = 0.8), Sign::None, Pose;
    "robot turned": World(|f| f.twist_deg_s = 60.0), Sign::None, Pose;
    "front echo missing": World(|f| f.missing_echo[0] = true), Sign::None, Nothing;
    "front sensor unplugged": World(|f| f.unplugged[0] = true), Sign::Log("front rangefinder silent"), Nothing;
    "echo lines crossed": World(|f| f.crossed_echoes = true), Sign::Log("front rangefinder silent"), Nothing;
    "front echo stuck": World(|f| f.stuck_mm[0] = Some(120.0)), Sign::None, Nothing;
    "gyro silent": Gyro(Mpu6050Fault::Silent), NO_GYRO, Nothing;
    "gyro refuses": Gyro(Mpu6050Fault::RefusesAfter(0)), NO_GYRO, Nothing;
    "gyro frozen": Gyro(Mpu6050Fault::Frozen), NO_GYRO, Nothing;
    // A wheel seems to slip, for two seconds.
    "gyro off by 60 deg/s": Gyro(Mpu6050Fault::Offset(60)), Sign::Latched(Faults::SLIP.union(Faults::GYRO_LOST)), Pose;
    "gyro jumps by 90 deg/s": Gyro(Mpu6050Fault::Jumps(90)), Sign::Latched(Faults::SLIP.union(Faults::GYRO_LOST)), Pose;
    "data line held": Wires(|b| hold(b, u32::MAX), |b| hold(b, 1)), NO_GYRO, Reset;
    "clock line held": Wires(|b| b.stretch_i2c(true), |b| b.stretch_i2c(false)), NO_GYRO, Reset;
    // Together with a reset at boot too.
    "slow bus": Each(stretch), Sign::None, Nothing;
    "bus errors": Each(|b, _| b.raise_bus_error()), Sign::None, Nothing;
    "arbitration lost": Each(|b, _| _ = b.lose_arbitration()), Sign::None, Nothing;
    "supply low": Wires(|b| b.set_supply(2_500), |b| b.set_supply(3_300)), Sign::Latched(Faults::SUPPLY_LOW), Nothing;
    "brown-out": Wires(brown_out, |_| ()), Sign::Log("boot after brown-out"), Nothing;
    // For good.
    "crystal dies": Wires(Board::stop_crystal, |_| ()), Sign::Latched(Faults::CLOCK_FALLBACK), Nothing;
    "no conversions": Wires(Board::stop_conversions, |_| ()), Sign::Latched(Faults::BATTERY_CUTOFF), Reset;
    "battery sags": World(|f| f.cells_v = Some([2.7, 2.7])), Sign::Latched(Faults::BATTERY_CUTOFF), Reset;
    "first tap open": World(|f| f.cells_v = Some([0.0, 7.4])), Sign::Latched(Faults::BATTERY_CUTOFF), Reset;
    "log blocked": Wires(|b| b.block_log(true), |b| b.block_log(false)), Sign::None, Nothing;
    "no ticks": Wires(Board::stop_ticks, |_| ()), Sign::Log("boot after watchdog reset"), Reset;
    // By a debugger, which leaves the watchdog running.
    "core halted": Wires(|b| b.halt_core(true), |b| b.halt_core(false)), Sign::Log("boot after watchdog reset"), Reset;
    "reset by pin": Wires(reset, |_| ()), Sign::Log("boot after reset by pin"), Nothing;
    // Read at the next start alone, which then rejects the configuration.
    "EEPROM bit flipped": Wires(flip, flip), Sign::None, Reset;
    "EEPROM bit weak": Wires(|b| weaken(b, true), |b| weaken(b, false)), Sign::None, Reset;
    "EEPROM with the Pi": Wires(|b| b.switch_i2c(I2cController::Pi), |b| b.switch_i2c(I2cController::Stm)),
        Sign::None, Nothing;
}
