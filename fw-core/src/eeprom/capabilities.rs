//! What a firmware was built with, and which accepted configurations ask for more.

use super::codec::broken;
use super::{Config, ConfigError};
use crate::wire::Mode;

/// The optional parts of a firmware. A configuration is the same on every robot; what this one lacks
/// must end with a word in the log and READY low, never with a robot that does something else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// The servo that swings the front rangefinder: `servo = 1` and mode 0x20.
    pub sweep: bool,
    /// The MPU6050 in the heading: `gyro = 1`.
    pub gyro: bool,
}

impl Capabilities {
    /// All of them.
    pub const ALL: Self = Self {
        sweep: true,
        gyro: true,
    };

    /// Whether this firmware can do all that an accepted configuration asks for.
    ///
    /// # Errors
    /// The first field that asks for a part it was built without.
    // Requirement: WIRE-refused-8
    pub fn meet(&self, config: &Config) -> Result<(), ConfigError> {
        let address = if config.mode == Mode::GuardedSweep && !self.sweep {
            0x000C
        } else if config.platform.servo && !self.sweep {
            0x0318
        } else if config.platform.gyro && !self.gyro {
            0x0319
        } else {
            return Ok(());
        };
        broken(config, address, LACKING)
    }
}

/// In the place of what would be accepted.
const LACKING: &str = "by the full firmware, this is the minimal one";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eeprom::{first_board, Value};
    use std::string::ToString;

    fn config(mode: Mode, servo: bool, gyro: bool) -> Config {
        let mut config = first_board();
        config.mode = mode;
        config.platform.servo = servo;
        config.platform.gyro = gyro;
        config
    }

    #[test]
    fn a_firmware_with_every_part_meets_every_configuration() {
        for &mode in Mode::ALL {
            for (servo, gyro) in [(false, false), (false, true), (true, false), (true, true)] {
                assert_eq!(Capabilities::ALL.meet(&config(mode, servo, gyro)), Ok(()));
            }
        }
    }

    // Requirement: WIRE-refused-8
    #[test]
    fn what_a_firmware_lacks_is_named_and_nothing_else_is_refused() {
        for &mode in Mode::ALL {
            for asked in 0..4 {
                let (servo, gyro) = (asked & 1 != 0, asked & 2 != 0);
                let config = config(mode, servo, gyro);
                for built in 0..4 {
                    let built = Capabilities {
                        sweep: built & 1 != 0,
                        gyro: built & 2 != 0,
                    };
                    let sweeps = mode == Mode::GuardedSweep;
                    let expected = if sweeps && !built.sweep {
                        Some(("mode", Value::Whole(0x20)))
                    } else if servo && !built.sweep {
                        Some(("servo", Value::Whole(1)))
                    } else if gyro && !built.gyro {
                        Some(("gyro", Value::Whole(1)))
                    } else {
                        None
                    };
                    let found = built.meet(&config).err();
                    assert_eq!(found.map(|error| (error.field, error.value)), expected);
                }
            }
        }
    }

    #[test]
    fn the_line_says_what_to_do() {
        let error = Capabilities {
            sweep: false,
            ..Capabilities::ALL
        }
        .meet(&config(Mode::GuardedSweep, true, false))
        .expect_err("no sweep");
        assert_eq!(
            error.to_string(),
            "EEPROM page 0x00 address 0x0C: mode is 32, accepted: by the full firmware, this is the \
             minimal one"
        );
    }
}
