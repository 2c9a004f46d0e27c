//! The computer: device files, rights and groups, and what enables them.

use super::Findings;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;

/// What each device is for, and how to get it.
const DEVICES: [(&str, &str, &str); 4] = [
    (
        "SPI device",
        "spi=on",
        "enable SPI (`raspi-config nonint do_spi 0`), and join the group spi",
    ),
    (
        "I2C device",
        "i2c_arm=on",
        "enable I2C (`raspi-config nonint do_i2c 0`), and join the group i2c",
    ),
    (
        "GPIO chip",
        "",
        "name the Pi's chip with --gpiochip, and join the group gpio",
    ),
    (
        "log device",
        "enable_uart=1",
        "enable the serial port (`raspi-config nonint do_serial_hw 0`), and join the group dialout",
    ),
];

/// Checks the devices SPI, I2C, GPIO and UART; `boot` is the folder of the boot loader's `config.txt`.
pub fn check(devices: [&Path; 4], boot: &Path, findings: &mut Findings) {
    let config = ["firmware/config.txt", "config.txt"]
        .into_iter()
        .find_map(|name| fs::read_to_string(boot.join(name)).ok());
    for (path, (check, overlay, advice)) in devices.into_iter().zip(DEVICES) {
        let name = path.display();
        match File::options().read(true).write(true).open(path) {
            Ok(_) => findings.pass(check, format!("{name} can be used")),
            Err(cause) => {
                let disabled = config.as_deref().is_some_and(|text| !is_set(text, overlay));
                let found = match cause.kind() {
                    ErrorKind::NotFound if disabled => {
                        format!("there is no {name}, and config.txt has no `{overlay}`")
                    }
                    ErrorKind::NotFound => format!("there is no {name}"),
                    ErrorKind::PermissionDenied => format!("no right to use {name}"),
                    _ => format!("{name}: {cause}"),
                };
                findings.fail(check, found, advice);
            }
        }
    }
}

/// Whether a line of config.txt sets it, alone or behind `dtparam=`.
fn is_set(config: &str, overlay: &str) -> bool {
    let mut lines = config
        .lines()
        .map(|line| line.trim().trim_start_matches("dtparam="));
    lines.any(|line| line.split(',').any(|part| part == overlay))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::Outcome;

    #[test]
    fn missing_device_names_overlay_and_group() {
        let boot = tempfile::tempdir().unwrap();
        let boot = boot.path();
        fs::write(boot.join("config.txt"), "dtparam=spi=on,i2c_arm=off\n").unwrap();
        let (absent, present) = (boot.join("spidev0.0"), Path::new("/dev/null"));
        let mut findings = Findings::default();
        check([&absent, &absent, present, present], boot, &mut findings);
        assert_eq!(findings.failed(), ["SPI device", "I2C device"]);
        let found = |index: usize| &findings.0[index].found;
        assert!(!found(0).contains("config.txt") && found(1).contains("`i2c_arm=on`"));
        assert!(findings.0[1].advice.unwrap().contains("group i2c"));
        assert_eq!(findings.0[2].outcome, Outcome::Passed);
    }
}
