//! The machine that the emulator runs: the microcontroller on its board.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::device::{ErasedDevice, Level, ResetCause};
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::board_model::BoardModel;
use crate::components::uart_receiver::UartReceiver;
use crate::pinout;
use crate::soc::Stm32f411;

/// The rail, millivolts.
pub const RAIL_MV: u32 = 3300;

const MILLION: NonZeroU64 = NonZeroU64::new(1_000_000).expect("not zero");
/// The core's clock, hertz.
const CORE_HZ: NonZeroU64 = NonZeroU64::new(100_000_000).expect("not zero");

/// The microcontroller, and everything on its board that advances with virtual time.
#[derive(Debug)]
pub struct McuOnBoard {
    /// The microcontroller.
    pub chip: Stm32f411,
    /// The board around it.
    pub board: BoardModel,
}

impl McuOnBoard {
    /// Whether the firmware drives READY high; the board pulls it down.
    pub fn is_ready(&self) -> bool {
        self.chip.output(pinout::READY) == Some(Level::High)
    }
}

impl Mcu for McuOnBoard {
    fn bus(&self) -> &Bus {
        self.chip.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.chip.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.chip.reset(at, cause);
        self.board.i2c.lock().stm_reset();
        self.board.connect(&mut self.chip, at);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.chip.poll(now);
        self.board.step(&mut self.chip, now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        self.chip.split(slot)
    }
}

/// The machine.
#[derive(Debug)]
pub struct VirtualBoard {
    /// Its one target.
    pub mcu: McuOnBoard,
    /// Instructions that the core retires in a second of virtual time, also while it still runs from the
    /// 16 MHz oscillator.
    instructions_per_second: NonZeroU64,
}

/// The factory's option bytes, without a brown-out reset (RM0383, 3.8.6).
pub const FACTORY_OPTIONS: u64 = 0x0FFF_AAED;
/// With it at level 2, 2.4 V.
const OPTIONS: u64 = FACTORY_OPTIONS & !(1 << 3);

impl VirtualBoard {
    /// The microcontroller on `board`, at `mips` instructions a microsecond; without a crystal
    /// its oscillator never starts.
    ///
    /// # Errors
    /// A part whose description contradicts itself.
    pub fn new(board: BoardModel, crystal_hz: u64, mips: NonZeroU64) -> Result<Self, Error> {
        let mut chip = Stm32f411::new()?;
        chip.rcc.attach_crystals(crystal_hz, 0);
        chip.set_supply(VirtualNanos(0), RAIL_MV);
        chip.set_option_bytes(OPTIONS);
        chip.usart[0].attach(UartReceiver::default());
        chip.i2c[0].inner.attach(board.i2c.clone());
        let mut mcu = McuOnBoard { chip, board };
        mcu.board.connect(&mut mcu.chip, VirtualNanos(0));
        Ok(Self {
            mcu,
            instructions_per_second: MILLION.saturating_mul(mips),
        })
    }
}

impl Store for VirtualBoard {}

impl Board for VirtualBoard {
    fn name(&self) -> &'static str {
        "virtual-board"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f411"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = u32::from(Operate::cpu(&self.mcu).interrupt_lines);
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: CORE_HZ,
            interrupt_lines: NonZeroU32::new(lines).expect("a part with interrupts"),
            // PM0214 section 4.3: four priority bits.
            priority_bits: 4,
            // PM0214 section 4.5: the reference clock is the core's over eight.
            refclk_divider: NonZeroU32::new(8).expect("not zero"),
            instructions_per_second: self.instructions_per_second,
            boot: "flash",
        }
        .spec_with_parts(
            &rigless::cpu::armv7m::windows(self.mcu.bus()),
            armv7m::Fpu::FpV4Sp,
            armv7m::MpuRegions::Eight,
        );
        vec![Target::new("stm32f411", &mut self.mcu, core)]
    }
}

#[cfg(test)]
mod tests;
