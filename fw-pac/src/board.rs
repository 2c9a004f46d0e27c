//! The first board's nets (document, figure 2.3), and nothing but names.

use crate::gpio::{Pin, Port};

/// Battery tap of cell 1, ADC1 IN0.
pub const CELL_1: Pin = Pin::new(Port::A, 0);
/// Battery tap of cells 1 and 2, ADC1 IN1.
pub const CELL_2: Pin = Pin::new(Port::A, 1);
/// Battery taps this board wires.
pub const TAPS: usize = 2;

/// Right motor, L298P IN2: high with IN1 low drives forward.
pub const RIGHT_IN2: Pin = Pin::new(Port::A, 2);
/// Right motor, L298P IN1.
pub const RIGHT_IN1: Pin = Pin::new(Port::A, 3);
/// Right motor's enable, TIM4 CH3.
pub const RIGHT_EN: Pin = Pin::new(Port::B, 8);
/// Left motor, L298P IN2. PC13–PC15 drive 3 mA at most, ample for a logic input.
pub const LEFT_IN2: Pin = Pin::new(Port::C, 14);
/// Left motor, L298P IN1.
pub const LEFT_IN1: Pin = Pin::new(Port::C, 15);
/// Left motor's enable, TIM4 CH4.
pub const LEFT_EN: Pin = Pin::new(Port::B, 9);

/// The Pi's chip-select: SPI1 NSS and EXTI4.
pub const SS: Pin = Pin::new(Port::A, 4);
/// SPI1 SCK.
pub const SCK: Pin = Pin::new(Port::A, 5);
/// SPI1 MISO.
pub const MISO: Pin = Pin::new(Port::A, 6);
/// SPI1 MOSI.
pub const MOSI: Pin = Pin::new(Port::A, 7);

/// USART1 TX, the log.
pub const TX: Pin = Pin::new(Port::A, 9);
/// USART1 RX, unused.
pub const RX: Pin = Pin::new(Port::A, 10);

/// LED 1, active low.
pub const LED_1: Pin = Pin::new(Port::A, 12);
/// LED 2, active low.
pub const LED_2: Pin = Pin::new(Port::A, 11);
/// LED 3, active low.
pub const LED_3: Pin = Pin::new(Port::C, 4);
/// LED 4, active low.
pub const LED_4: Pin = Pin::new(Port::B, 14);

/// Left encoder, TIM2 CH1.
pub const ENCODER_LEFT_2: Pin = Pin::new(Port::A, 15);
/// Left encoder, TIM2 CH2.
pub const ENCODER_LEFT_1: Pin = Pin::new(Port::B, 3);
/// Right encoder, TIM3 CH1.
pub const ENCODER_RIGHT_1: Pin = Pin::new(Port::C, 6);
/// Right encoder, TIM3 CH2.
pub const ENCODER_RIGHT_2: Pin = Pin::new(Port::C, 7);

/// Right rangefinder's echo, EXTI0.
pub const ECHO_RIGHT: Pin = Pin::new(Port::B, 0);
/// Right rangefinder's trigger.
pub const TRIGGER_RIGHT: Pin = Pin::new(Port::C, 5);
/// Front rangefinder's echo, EXTI9.
pub const ECHO_FRONT: Pin = Pin::new(Port::C, 9);
/// Front rangefinder's trigger.
pub const TRIGGER_FRONT: Pin = Pin::new(Port::C, 8);
/// Left rangefinder's echo, EXTI12.
pub const ECHO_LEFT: Pin = Pin::new(Port::C, 12);
/// Left rangefinder's trigger.
pub const TRIGGER_LEFT: Pin = Pin::new(Port::C, 11);

/// The swept rangefinder's servo, TIM1 CH1.
pub const SERVO: Pin = Pin::new(Port::A, 8);

/// `STM_READY`: high once configured; the board pulls it down.
pub const READY: Pin = Pin::new(Port::B, 1);
/// I2C1 SCL.
pub const SCL: Pin = Pin::new(Port::B, 6);
/// I2C1 SDA.
pub const SDA: Pin = Pin::new(Port::B, 7);
/// High while the Pi has the EEPROM's bus; the board pulls it down.
pub const SELECT: Pin = Pin::new(Port::B, 12);
