//! [`Settings`] → text, commented so that the file explains itself.

use super::{Settings, format};
use fw_core::eeprom::fields::HELP;
use serde::Serialize;
use std::fmt::Write;

const HEAD: &str = "\
# Configuration of the robot: what `robot eeprom write` puts into its EEPROM.
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
pub fn render(settings: &Settings) -> String {
    let mut text = String::from(HEAD);
    let mut section = String::new();
    for field in format::all() {
        let unused = field.tap > settings.config().cells();
        if unused || format::is_optional(field) && !settings.platform_page() {
            continue;
        }
        let key = format::key(field);
        let (of, name) = key.rsplit_once('.').unwrap_or_default();
        if of != section {
            of.clone_into(&mut section);
            text.push('\n');
            if !about(of).is_empty() {
                let _ = writeln!(text, "# {}", about(of));
            }
            let _ = writeln!(text, "[{of}]");
        }
        let entry = format!("{name} = {}", format::text(field, settings.get(field)));
        let help = HELP.get(usize::from(field.index)).unwrap_or(&"");
        let _ = writeln!(text, "{entry:<40} # {help}");
    }
    text
}

/// One field that differs between two settings, as the file writes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Change {
    /// `section.key`.
    pub key: String,
    /// EEPROM address.
    pub address: u16,
    /// Old value.
    pub before: String,
    /// New value.
    pub after: String,
}

/// The fields in which `after` differs from `before`.
pub fn changes(before: &Settings, after: &Settings) -> Vec<Change> {
    let changed = format::all().filter(|field| before.get(field) != after.get(field));
    let change = |field| Change {
        key: format::key(field),
        address: field.address,
        before: format::text(field, before.get(field)),
        after: format::text(field, after.get(field)),
    };
    changed.map(change).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{Error, Exit};
    use fw_core::eeprom::Image;
    use std::path::Path;

    fn parse(text: &str) -> Result<Settings, Error> {
        Settings::parse(text, Path::new("test.toml"))
    }

    fn first() -> Settings {
        Settings::first_board().unwrap()
    }

    #[test]
    fn sample_file_is_rendered_sample() {
        let file = include_str!("../../config/first-board.toml");
        let sample = Settings::sample().unwrap();
        assert_eq!(parse(file).unwrap(), sample);
        assert_eq!(file, render(&sample), "run `robot eeprom init` again");
    }

    #[test]
    fn settings_in_the_documents_are_accepted() {
        let file = include_str!("../../config/first-board.toml");
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
        let names = ["README.md", "docs/board.md", "docs/pilot.md"];
        let texts = names.map(|name| std::fs::read_to_string(format!("{root}/{name}")).unwrap());
        let code = texts.iter().flat_map(|text| text.split('`'));
        let settings = code.filter_map(|code| Some((code, code.split_once(" = ")?.0)));
        let is_key = |key: &str| {
            key.bytes()
                .all(|byte| byte == b'_' || byte.is_ascii_lowercase())
        };
        let settings: Vec<_> = settings.filter(|(_, key)| is_key(key)).collect();
        assert!(settings.len() > 3, "{settings:?}");
        for (setting, key) in settings {
            let (before, line) = file.split_once(&format!("\n{key} = ")).expect(setting);
            let after = line.split_once('\n').unwrap().1;
            parse(&format!("{before}\n{setting}\n{after}")).expect(setting);
        }
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
        let mut image = Image::FIRST_BOARD;
        image.make_original();
        let original = Settings::from_image(&image).unwrap();
        let text = render(&original);
        assert!(!text.contains("[platform]"));
        assert_eq!(parse(&text).unwrap(), original);
        assert!(original.image().0[0x300..].iter().all(|&byte| byte == 0xFF));
        assert_eq!(Settings::from_image(original.image()).unwrap(), original);
        // A change on page 0x03 writes all of it.
        let track = fw_core::eeprom::fields::TRACK;
        let written = original.with(&[(track, 130_000)]).unwrap();
        assert!(written.platform_page() && written.get(track) == 130_000);
        let changes_made = changes(&original, &written);
        let [change] = changes_made.as_slice() else {
            panic!("{changes_made:?}");
        };
        assert_eq!(change.key, "platform.track_mm");
        assert_eq!(change.address, track.address);
        assert_eq!((&*change.before, &*change.after), ("125.0", "130.0"));
        let written = Settings::from_image(&original.platform_written()).unwrap();
        assert!(written.platform_page() && changes(&original, &written).is_empty());
    }

    /// Reads the first board's file with a change on a line, which must be rejected; the complaint and
    /// the line's number.
    fn complaint(from: &str, to: &str) -> (Error, usize) {
        let text = render(&first());
        let line = text.lines().position(|line| line.contains(from));
        let line = line.expect("a part of the sample") + 1;
        (parse(&text.replacen(from, to, 1)).unwrap_err(), line)
    }

    #[test]
    fn complaints_name_key_value_range_and_line() {
        let mode = "link.mode = \"Normla\": accepted is \"Normal\" (0x00)";
        let cells = "battery.cells = 300: accepted is a whole number from 1 to 8";
        let servo = "platform.servo = 0: accepted is true or false";
        for (from, to, expected) in [
            ("cells = 2", "cells = 300", cells),
            ("cells = 2", "cellz = 2", "unknown key battery.cellz"),
            (
                "[pid.forward]",
                "[pod.forward]",
                "unknown key pod: accepted here are link, pid, battery, platform",
            ),
            ("mode = \"Normal\"", "mode = \"Normla\"", mode),
            ("servo = false", "servo = 0", servo),
            ("_ms = 250", "_ms = 70000", "a whole number from 20 to 2000"),
            (
                "_mm = 125.0",
                "_mm = -1",
                "_mm = -1: accepted is 20.0 to 2000.0",
            ),
            ("front_deg = 0.0", "front_deg = 361", "-360 to 360"),
            ("key_from_pi = 0x96", "key_from_pi = 0x96 7", ""),
        ] {
            let (error, expected_line) = complaint(from, to);
            let Error::Content { faults, .. } = error else {
                panic!("{error:?}");
            };
            let what = &faults[0].what;
            assert_eq!(faults[0].line, Some(expected_line), "{what}");
            assert!(what.contains(expected), "{what}");
        }
        let section = parse("link = 3").unwrap_err().to_string();
        let expected = "link must be a section, [link]";
        assert!(section.contains(expected), "{section}");
        // The last tap of two cells counts.
        for (line, key) in [
            ("adc_max_word = 4095", "battery.adc_max_word"),
            ("upper_ohm = 33000", "battery.tap_2.upper_ohm"),
        ] {
            let missing = complaint(line, "").0.to_string();
            let text = render(&first());
            let (_, entry) = text.split_once(line).unwrap();
            let help = entry.lines().next().unwrap().trim_start_matches([' ', '#']);
            let expected = format!("{key} is missing: {help}");
            assert!(missing.contains(&expected), "{missing}");
        }
        // A wrong value is not also one that another key forbids.
        let text = render(&first()).replace("mode = \"Normal\"", "mode = 0x20");
        let of = |servo| match parse(&text.replace("servo = false", servo)) {
            Err(Error::Content { faults, .. }) => faults.len(),
            other => panic!("{other:?}"),
        };
        assert_eq!(["servo = false", "servo = 0"].map(of), [1, 1]);
        let by_number = render(&first()).replace("mode = \"Normal\"", "mode = 0");
        assert_eq!(parse(&by_number).unwrap(), first());
    }

    #[test]
    fn change_of_the_files_first_field_is_named() {
        let field = format::all().next().unwrap();
        let changed = first().with(&[(field, 0x11)]).unwrap();
        assert_eq!(changes(&first(), &changed)[0].key, format::key(field));
    }

    #[test]
    fn several_faults_come_in_one_run() {
        let text = render(&first())
            .replace("cells = 2", "cells = 300")
            .replace("servo = false", "servo = 0")
            .replace("p = 6.5088", "p = nan")
            .replace("track_mm = 125.0", "track_mm = 0.0")
            .replace("cutoff_v = 3.0", "cutoff_v = 5.0")
            .replace("mode =", "modus =");
        let error = parse(&text).unwrap_err().to_string() + "\n";
        for expected in [
            "link.mode is missing",
            "unknown key link.modus",
            "battery.cells = 300: accepted",
            "platform.servo = 0: accepted is true or false",
            "pid.forward.p = nan: accepted is 0.0 to 10000.0",
            "platform.track_mm = 0.0: accepted is 20.0 to 2000.0",
            "battery_cutoff_v = 5.0: accepted is at most battery_warn",
            "    servo = 0  ",
            "\n            ^\n",
        ] {
            assert_eq!(error.matches(expected).count(), 1, "{expected}: {error}");
        }
        // By their lines; what has none comes last.
        let places = ["link.modus", "cells = 300", "servo = 0", "is missing"];
        let places = places.map(|part| error.find(part));
        assert!(places.is_sorted(), "{error}");
    }

    #[test]
    fn figures_no_robot_may_drive_with_are_rejected_with_their_line() {
        for (key, good, bad, accepted) in [
            ("battery.cells", "2", "0", "a whole number from 1 to 8"),
            ("battery.cells", "2", "9", "a whole number from 1 to 8"),
            ("pid.forward.p", "6.5088", "nan", "0.0 to 10000.0"),
            ("battery.adc_max_word", "4095", "0", "a whole number from"),
            ("platform.track_mm", "125.0", "0.0", "20.0 to 2000.0"),
        ] {
            let (_, name) = key.rsplit_once('.').unwrap();
            let [from, to] = [good, bad].map(|value| format!("{name} = {value}"));
            let (error, line) = complaint(&from, &to);
            let expected = format!("test.toml, line {line}: {key} = {bad}: accepted is {accepted}");
            let is_named = error.to_string().starts_with(&expected);
            assert!(is_named && error.exit() == Exit::BadFile, "{error:?}");
        }
    }
}
