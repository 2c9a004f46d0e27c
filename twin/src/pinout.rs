//! The pin of the STM32F411 that each component of the board is connected to (schematic of figure
//! 2.3 of the document).

use crate::pin::{Pin, pin};

/// SPI1's chip select, EXTI4.
pub const NSS: Pin = pin('A', 4);
/// SPI1's clock.
pub const SCK: Pin = pin('A', 5);
/// SPI1's output.
pub const MISO: Pin = pin('A', 6);
/// SPI1's input.
pub const MOSI: Pin = pin('A', 7);
/// TIM1 channel 1: the servo of the swept rangefinder.
pub const SERVO: Pin = pin('A', 8);
/// USART1's output: the log.
pub const TX: Pin = pin('A', 9);
/// High once the firmware is configured; pulled down on the board.
pub const READY: Pin = pin('B', 1);
/// I2C1's clock, pulled up.
pub const SCL: Pin = pin('B', 6);
/// I2C1's data, pulled up.
pub const SDA: Pin = pin('B', 7);
/// Senses the I2C switch: high = the EEPROM is connected to the Pi.
pub const SELECT: Pin = pin('B', 12);
/// The motion sensor's interrupt.
pub const MPU_IRQ: Pin = pin('B', 13);
/// LEDs 1 to 4, lit when low.
pub const LEDS: [Pin; 4] = [pin('A', 12), pin('A', 11), pin('C', 4), pin('B', 14)];

/// One half of the motor bridge.
#[derive(Clone, Copy, Debug)]
pub struct BridgePins {
    /// The enable, chopped by TIM4.
    pub enable: Pin,
    /// TIM4's channel on it.
    pub channel: u8,
    /// High to go backward.
    pub in1: Pin,
    /// High to go forward.
    pub in2: Pin,
}

/// The left motor: TIM4 CH4.
pub const LEFT_BRIDGE: BridgePins = BridgePins {
    enable: pin('B', 9),
    channel: 4,
    in1: pin('C', 15),
    in2: pin('C', 14),
};
/// The right motor: TIM4 CH3.
pub const RIGHT_BRIDGE: BridgePins = BridgePins {
    enable: pin('B', 8),
    channel: 3,
    in1: pin('A', 3),
    in2: pin('A', 2),
};

/// One encoder: two pins, and the timer (0 = TIM2) whose channels 1 and 2 they are.
#[derive(Clone, Copy, Debug)]
pub struct EncoderPins {
    /// The channel that leads when the count rises, and the other one.
    pub pins: [Pin; 2],
    /// The timer's index: 0 is TIM2, 1 is TIM3.
    pub timer: usize,
    /// The alternate function that connects them.
    pub function: u8,
}

/// Left (TIM2), right (TIM3): the order of the plant.
pub const ENCODERS: [EncoderPins; 2] = [
    EncoderPins {
        pins: [pin('A', 15), pin('B', 3)],
        timer: 0,
        function: 1,
    },
    EncoderPins {
        pins: [pin('C', 6), pin('C', 7)],
        timer: 1,
        function: 2,
    },
];

/// A rangefinder's pins.
#[derive(Clone, Copy, Debug)]
pub struct RangefinderPins {
    /// A pulse of 10 µs starts a measurement.
    pub trigger: Pin,
    /// High as long as the sound travels.
    pub echo: Pin,
}

/// Front, right, left: the order of the frame and of the plant.
pub const RANGEFINDERS: [RangefinderPins; 3] = [
    RangefinderPins {
        trigger: pin('C', 8),
        echo: pin('C', 9),
    },
    RangefinderPins {
        trigger: pin('C', 5),
        echo: pin('B', 0),
    },
    RangefinderPins {
        trigger: pin('C', 11),
        echo: pin('C', 12),
    },
];
