//! Four LEDs, active low; which of them are lit is the core's decision.

use crate::board::{LED_1, LED_2, LED_3, LED_4};
use crate::gpio::Driver;

/// Makes them outputs that show `lit`.
pub fn start(lit: u8) {
    show(lit);
    for led in [LED_1, LED_2, LED_3, LED_4] {
        led.output(Driver::PushPull);
    }
}

/// Bit 0 lights LED 1 … bit 3 LED 4.
pub fn show(lit: u8) {
    LED_1.set(lit & 1 == 0);
    LED_2.set(lit & 2 == 0);
    LED_3.set(lit & 4 == 0);
    LED_4.set(lit & 8 == 0);
}
