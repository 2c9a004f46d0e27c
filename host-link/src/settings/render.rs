//! [`Settings`] → text, commented so that the file explains itself.

use super::fields::{self, Access, Field};
use super::{number, Settings};
use fw_core::eeprom::Config;
use serde::Serialize;
use std::fmt::Write;

const HEAD: &str = "\
# Configuration of the robot: what `host-link eeprom write` puts into its EEPROM.
# Doubles of the PIDs are stored as they stand here; other figures to the resolution given.
";

/// What stands above each section.
fn about(section: &str) -> &'static str {
    match section {
        "link" => "The SPI link: EEPROM page 0x00.",
        "pid.forward" => {
            "Forward and backward PID: page 0x01. Samples are 10 ms; output is % of duty."
        }
        "pid.rotation" => "Rotation PID: page 0x01.",
        "battery" => "Battery: page 0x02.",
        "battery.tap_1" => "Dividers, one per tap; tap 1 is nearest to ground.",
        "platform" => {
            "The platform: page 0x03. Keys left out take the first board's figures; without this\n\
             # section page 0x03 stays unwritten, as in an original EEPROM."
        }
        _ => "",
    }
}

/// The file's text. Reading it back gives the same settings.
#[must_use]
pub fn render(settings: &Settings) -> String {
    let mut config = settings.config.clone();
    let mut text = String::from(HEAD);
    let mut section = "";
    for field in fields::all() {
        if field.optional() && !settings.platform_page {
            break;
        }
        if field.tap().is_some_and(|tap| tap > config.cells) {
            continue;
        }
        if field.section() != section {
            section = field.section();
            text.push('\n');
            if !about(section).is_empty() {
                let _ = writeln!(text, "# {}", about(section));
            }
            let _ = writeln!(text, "[{section}]");
        }
        let entry = format!("{} = {}", field.name(), value(field, &mut config));
        let _ = writeln!(text, "{entry:<40} # {}", field.help);
    }
    text
}

/// One field that differs between two settings, as the file writes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Change {
    /// `section.key`.
    pub key: &'static str,
    /// EEPROM address.
    pub address: u16,
    /// Old value.
    pub before: String,
    /// New value.
    pub after: String,
}

/// The fields in which `after` differs from `before`.
#[must_use]
pub fn changes(before: &Settings, after: &Settings) -> Vec<Change> {
    let (mut old, mut new) = (before.config.clone(), after.config.clone());
    fields::all()
        .map(|field| Change {
            key: field.key,
            address: field.address,
            before: value(field, &mut old),
            after: value(field, &mut new),
        })
        .filter(|change| change.before != change.after)
        .collect()
}

fn value(field: &Field, config: &mut Config) -> String {
    match field.access {
        Access::Mode(place) => format!("\"{}\"", place(config).name()),
        Access::Flag(place) => place(config).to_string(),
        Access::Byte(place) if field.section() == "link" => format!("0x{:02X}", place(config)),
        Access::Byte(place) => place(config).to_string(),
        Access::Long(place) => place(config).to_string(),
        Access::Word(1.0, place) => place(config).to_string(),
        Access::Word(scale, place) => number::text((*place(config)).into(), scale),
        Access::ScaledLong(scale, place) => number::text(*place(config), scale),
        Access::Bearing(place) => number::bearing_text(*place(config)),
        // `{:?}` is the shortest text that reads back as the same double, always with a point.
        Access::Binary64(place) => format!("{:?}", f64::from_bits(place(config).0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use fw_core::eeprom::first_board;
    use std::path::Path;

    fn parse(text: &str) -> Result<Settings, Error> {
        Settings::parse(text, Path::new("test.toml"))
    }

    fn first() -> Settings {
        Settings {
            config: first_board(),
            platform_page: true,
        }
    }

    #[test]
    fn the_sample_file_is_the_first_board() {
        let sample = include_str!("../../config/first-board.toml");
        assert_eq!(parse(sample).unwrap(), first());
        assert_eq!(
            sample,
            render(&first()),
            "run `host-link eeprom init` again"
        );
    }

    #[test]
    fn the_json_has_the_files_sections_and_numbers() {
        let json = first().json();
        assert_eq!(json["link"]["mode"], "Normal");
        assert_eq!(json["pid"]["forward"]["p"], 6.5088);
        assert_eq!(json["battery"]["tap_2"]["upper_ohm"], 33_000);
        assert_eq!(json["platform"]["gyro"], false);
    }

    #[test]
    fn an_original_configuration_leaves_page_3_unwritten() {
        let original = Settings {
            platform_page: false,
            ..first()
        };
        let text = render(&original);
        assert!(!text.contains("[platform]"));
        assert_eq!(parse(&text).unwrap(), original);
        assert!(original.image()[0x300..].iter().all(|&byte| byte == 0xFF));
        assert_eq!(Settings::from_image(&original.image()).unwrap(), original);
    }

    fn complaint(from: &str, to: &str) -> Error {
        let text = render(&first());
        assert!(text.contains(from), "{from} is not in the sample");
        parse(&text.replacen(from, to, 1)).unwrap_err()
    }

    fn line_of(part: &str) -> usize {
        render(&first())
            .lines()
            .position(|line| line.contains(part))
            .unwrap()
            + 1
    }

    #[test]
    fn complaints_name_key_value_range_and_line() {
        for (from, to, expected) in [
            (
                "cells = 2",
                "cells = 300",
                "battery.cells = 300: accepted is a whole number from 0 to 255",
            ),
            ("cells = 2", "cellz = 2", "unknown key battery.cellz"),
            (
                "mode = \"Normal\"",
                "mode = \"Normla\"",
                "link.mode = \"Normla\": accepted is \"Normal\" (0x00)",
            ),
            (
                "servo = false",
                "servo = 0",
                "platform.servo = 0: accepted is true or false",
            ),
            (
                "stop_deadline_ms = 250",
                "stop_deadline_ms = 70000",
                "accepted is 0 to 65535",
            ),
            ("key_from_pi = 0x96", "key_from_pi = 0x96 7", ""),
        ] {
            let line = line_of(from);
            match complaint(from, to) {
                Error::Content {
                    line: Some(named),
                    what,
                    ..
                } => {
                    assert_eq!(named, line, "{what}");
                    assert!(what.contains(expected), "{what}");
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn a_missing_key_is_named() {
        let error = complaint("adc_max_word = 4095", "");
        assert!(
            error
                .to_string()
                .contains("battery.adc_max_word is missing"),
            "{error}"
        );
    }

    #[test]
    fn figures_no_robot_may_drive_with_are_rejected_with_their_line() {
        for (from, to, key) in [
            ("cells = 2", "cells = 0", "battery.cells"),
            ("p = 6.5088", "p = nan", "pid.forward.p"),
            (
                "adc_max_word = 4095",
                "adc_max_word = 0",
                "battery.adc_max_word",
            ),
            ("track_mm = 125.0", "track_mm = 0.0", "platform.track_mm"),
        ] {
            let line = line_of(from);
            match complaint(from, to) {
                Error::Rejected { location, .. } => {
                    assert!(
                        location.contains(&format!("line {line} ({key})")),
                        "{location}"
                    );
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
