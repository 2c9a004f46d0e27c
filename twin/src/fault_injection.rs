//! What can go wrong, on purpose.

use std::sync::PoisonError;

use plant::Faults as WorldFaults;
use rigless::mcu::Operate;
use rigless::soc::Width;

use crate::board::Board;
use crate::components::i2c_bus::CLEARING_PULSES;
use crate::components::mpu6050::Mpu6050;
use crate::components::spi_master::Step;
use crate::emulator::Ended;
use crate::virtual_board::Robot;

/// What happens to one transfer of the Pi.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// Nothing: lets one transfer pass.
    None,
    /// Bit `n` (0 = the first on the wire) arrives inverted at the STM.
    FlipToStm(usize),
    /// Bit `n` arrives inverted at the Pi.
    FlipToPi(usize),
    /// The chip select rises after `n` bits, and no more are clocked.
    TearAfter(usize),
    /// The chip select rises for 1 µs after `n` bits, in the middle of the transfer.
    GlitchAfter(usize),
    /// Another byte is clocked after the last one, this many times.
    Lengthen(usize),
}

impl Disturbance {
    /// Changes what the master plays.
    pub(crate) fn on_the_way_out(self, steps: &mut Vec<Step>) {
        let mut before = 0;
        for at in 0..steps.len() {
            let Step::Bits { mosi, hz } = &mut steps[at] else {
                continue;
            };
            let (count, hz) = (mosi.len(), *hz);
            match self {
                Self::FlipToStm(bit) if (before..before + count).contains(&bit) => {
                    mosi[bit - before] ^= true;
                }
                Self::TearAfter(bits) if before + count > bits => {
                    mosi.truncate(bits.saturating_sub(before));
                }
                Self::GlitchAfter(bits) if (before + 1..before + count).contains(&bits) => {
                    let rest = mosi.split_off(bits - before);
                    let glitch = [
                        Step::Select(false),
                        Step::Wait(1_000),
                        Step::Select(true),
                        Step::Wait(1_000),
                        Step::Bits { mosi: rest, hz },
                    ];
                    let after = steps.split_off(at + 1);
                    steps.extend(glitch);
                    steps.extend(after);
                    return;
                }
                Self::Lengthen(bytes) if !has_bits(&steps[at + 1..]) => {
                    let more = Step::bytes(&vec![0; bytes], hz);
                    steps.insert(at + 1, more);
                    return;
                }
                _ => {}
            }
            before += count;
        }
    }

    /// Changes what the master sees.
    pub(crate) fn on_the_way_back(self, miso: &mut [bool]) {
        if let Self::FlipToPi(bit) = self {
            if let Some(bit) = miso.get_mut(bit) {
                *bit ^= true;
            }
        }
    }
}

fn has_bits(steps: &[Step]) -> bool {
    steps.iter().any(|step| matches!(step, Step::Bits { .. }))
}

/// The faults of a board.
#[derive(Clone, Debug)]
pub struct Faults {
    board: Board,
}

impl Board {
    /// What can go wrong.
    #[must_use]
    pub fn faults(&self) -> Faults {
        Faults {
            board: self.clone(),
        }
    }

    pub(crate) fn next_disturbance(&self) -> Option<Disturbance> {
        self.disturbances
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop_front()
    }
}

impl Faults {
    /// Disturbs the Pi's next transfer that has none yet.
    pub fn disturb(&self, disturbance: Disturbance) {
        self.board
            .disturbances
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push_back(disturbance);
    }

    /// Changes what is broken in the physical world: a dead encoder, a missing or stuck echo,
    /// slip, a jammed wheel, a hand that turns the robot.
    pub fn world(&self, change: impl FnOnce(&mut WorldFaults) + Send + 'static) {
        self.board.world(|world| change(&mut world.faults));
    }

    /// A part on the EEPROM's bus holds the data line low until it has heard nine clock pulses.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn hold_i2c(&self) -> Result<(), Ended> {
        self.board.i2c_bus(|bus, _| bus.stick(CLEARING_PULSES))
    }

    /// A part holds the data line low for good.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn short_i2c(&self) -> Result<(), Ended> {
        self.board.i2c_bus(|bus, _| bus.stick(u32::MAX))
    }

    /// Changes the MPU6050, if one is fitted: what is wrong with it, its zero, its supply.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn mpu(&self, change: impl FnOnce(&mut Mpu6050) + Send + 'static) -> Result<(), Ended> {
        self.board.i2c_bus(|bus, _| {
            if let Some(mpu) = &mut bus.mpu {
                change(mpu);
            }
        })
    }

    /// The MPU6050 holds the data line low until it has heard so many clock pulses; `None`: it lets
    /// go.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn hold_mpu(&self, pulses: Option<u32>) -> Result<(), Ended> {
        self.board.i2c_bus(move |bus, _| match pulses {
            Some(pulses) => bus.stick_mpu(pulses),
            None => bus.release_mpu(),
        })
    }

    /// The crystal stops. Seen only by a firmware that has the clock security system on, RM0383
    /// section 6.2.7: without it the core would stand still for good.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn stop_crystal(&self) -> Result<(), Ended> {
        self.board.try_with(|scene| {
            let now = rigless::time::VirtualNanos(scene.now);
            let Robot { chip, .. } = &mut scene.session.board_mut().robot;
            chip.fail_crystal(now);
        })
    }

    /// TIM5, the timer of the firmware's ticks, stands still.
    ///
    /// # Errors
    /// When the emulation has ended.
    ///
    /// # Panics
    /// While TIM5 has no clock: nothing ticks before the firmware has started it.
    pub fn stop_ticks(&self) -> Result<(), Ended> {
        self.board.try_with(|scene| {
            let now = rigless::time::VirtualNanos(scene.now);
            let Robot { chip, .. } = &mut scene.session.board_mut().robot;
            chip.write(now, TIM5_CR1, Width::W32, 0)
                .expect("TIM5 has its clock");
        })
    }
}

/// TIM5's first control register, RM0383 table 1 and section 13.4.1.
const TIM5_CR1: u64 = 0x4000_0C00;

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Vec<Step> {
        vec![
            Step::Select(true),
            Step::bytes(&[0, 0], 1_000_000),
            Step::Select(false),
        ]
    }

    fn bits(steps: &[Step]) -> Vec<usize> {
        steps
            .iter()
            .filter_map(|step| match step {
                Step::Bits { mosi, .. } => Some(mosi.len()),
                _ => None,
            })
            .collect()
    }

    #[test]
    fn a_torn_transfer_ends_after_its_bits() {
        let mut steps = frame();
        Disturbance::TearAfter(11).on_the_way_out(&mut steps);
        assert_eq!(bits(&steps), [11]);
    }

    #[test]
    fn a_glitch_of_the_chip_select_leaves_every_bit_in_place() {
        let mut steps = frame();
        Disturbance::GlitchAfter(5).on_the_way_out(&mut steps);
        assert_eq!(bits(&steps), [5, 11]);
        assert_eq!(steps[2], Step::Select(false));
    }

    #[test]
    fn one_bit_flips_and_a_frame_grows() {
        let mut steps = frame();
        Disturbance::FlipToStm(9).on_the_way_out(&mut steps);
        assert_eq!(steps[1], Step::bytes(&[0, 0x40], 1_000_000));
        Disturbance::Lengthen(2).on_the_way_out(&mut steps);
        assert_eq!(bits(&steps), [16, 16]);
    }
}
