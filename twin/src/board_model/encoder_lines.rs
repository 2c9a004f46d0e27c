//! The lines between the encoders and the microcontroller.

use rigless::device::Level;
use rigless::time::VirtualNanos;

use super::BoardModel;
use crate::components::encoder::Encoder;
use crate::pin::Pin;
use crate::pinout::ENCODERS;
use crate::soc::{Role, Stm32f411};

impl BoardModel {
    /// Drives the encoders' edges that are due.
    pub(super) fn step_encoders(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for (nth, encoder) in ENCODERS.into_iter().enumerate() {
            while let Some(edge) = self.encoders[nth].take(now.0) {
                let before = Encoder::levels(self.counts[nth]);
                let mut after = Encoder::levels(edge.count);
                self.counts[nth] = edge.count;
                let faults = &self.world.faults;
                let [dead, noisy] =
                    [faults.dead_channel, faults.noisy_encoder].map(|of| [of.left, of.right][nth]);
                for (channel, level) in after.iter_mut().enumerate() {
                    // Open collectors: without the part's pull-up nothing makes a line high.
                    if channel == 1 && dead || chip.pull(encoder.pins[channel]) != 1 {
                        *level = Level::Low;
                    }
                }
                for channel in 0..2 {
                    if before[channel] != after[channel] {
                        chip.drive_pin(now, encoder.pins[channel], Some(after[channel]));
                    }
                }
                let routed = |&pin: &Pin| chip.role(pin) == Role::Function(encoder.function);
                if encoder.pins.iter().all(routed) {
                    if noisy {
                        self.drive_timer_inputs(chip, now, nth, after);
                        self.drive_timer_inputs(chip, now, nth, before);
                    }
                    self.drive_timer_inputs(chip, now, nth, after);
                }
            }
        }
    }

    pub(super) fn drive_timer_inputs(
        &mut self,
        chip: &mut Stm32f411,
        now: VirtualNanos,
        nth: usize,
        levels: [Level; 2],
    ) {
        for (channel, (input, level)) in (1..).zip(self.timer_inputs[nth].iter_mut().zip(levels)) {
            if *input != level {
                *input = level;
                chip.drive_timer(now, ENCODERS[nth].timer, channel, level);
            }
        }
    }
}
