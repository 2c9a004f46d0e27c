//! The SPI lines between the Pi and the microcontroller.

use rigless::device::Level;
use rigless::time::VirtualNanos;

use super::BoardModel;
use crate::components::spi_master::SpiAction;
use crate::pinout;
use crate::soc::{Role, Stm32f411};

/// Edges of the chip select that are kept while nothing traces them.
const SELECTS_KEPT: usize = 16;

/// The alternate function that connects SPI1 to its pins.
const SPI_FUNCTION: Role = Role::Function(5);

impl BoardModel {
    /// Plays the Pi's SPI steps.
    pub(super) fn run_spi(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        while let Some(action) = self.next_action(chip, now) {
            match action {
                SpiAction::Select(selected) => {
                    self.nss = Level::from(!selected);
                    if self.selects.len() == SELECTS_KEPT {
                        self.selects.pop_front();
                    }
                    self.selects.push_back((now.0, selected));
                    chip.drive_pin(now, pinout::NSS, Some(self.nss));
                    self.route_nss(chip, now);
                }
                SpiAction::Clock(bit) => {
                    let [sck, mosi, miso] = [pinout::SCK, pinout::MOSI, pinout::MISO]
                        .map(|pin| chip.role(pin) == SPI_FUNCTION);
                    self.route_nss(chip, now);
                    if let (true, Some(&(at, true))) = (sck, self.selects.back()) {
                        chip.check_spi(now, self.spi.rate(), now.0 - at);
                    }
                    let clock = |chip: &mut Stm32f411| {
                        chip.drive_spi(now, |spi, registers, context| {
                            spi.clock(bit && mosi, registers, context)
                        })
                    };
                    let output = if sck { clock(chip) } else { None };
                    // The Pi pulls an undriven MISO down.
                    self.spi.receive(output.unwrap_or(false) && miso);
                }
            }
        }
    }

    /// How many of the master's clocks may pass before the slave does something visible.
    pub(super) fn clocks_ahead(chip: &Stm32f411) -> usize {
        let registers = chip.spi_registers();
        if chip.spi.is_selected(registers) {
            chip.spi.clocks_to_act(registers) as usize - 1
        } else {
            0
        }
    }

    /// The next action due by `now`, once the clock at which the slave acts is due.
    fn next_action(&mut self, chip: &Stm32f411, now: VirtualNanos) -> Option<SpiAction> {
        if self.spi.next_event(Self::clocks_ahead(chip))? > now.0 {
            return None;
        }
        self.spi.take(now.0)
    }

    fn route_nss(&self, chip: &mut Stm32f411, now: VirtualNanos) {
        let routed = chip.role(pinout::NSS) == SPI_FUNCTION;
        let level = routed.then_some(self.nss);
        chip.drive_spi(now, |spi, registers, context| {
            spi.set_nss(level, registers, context);
        });
    }
}
