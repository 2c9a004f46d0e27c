//! Any configuration file: refused with the place and what is accepted, or settings that go into an
//! EEPROM image, out of it, and into a file again, unchanged.
#![no_main]

use fw_core::eeprom::Image;
use host_link::error::Error;
use host_link::settings::{Settings, render};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::Bytes;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let choice = bytes.byte();
    if choice == 0 {
        check(&String::from_utf8_lossy(bytes.rest()), None);
        return;
    }
    // A good file with some values replaced.
    let mut image = Image::FIRST_BOARD;
    if choice & 1 != 0 {
        image.make_original();
    }
    let good = render(&Settings::from_image(&image).expect("accepted"));
    let mut lines: Vec<String> = good.lines().map(str::to_owned).collect();
    let entries: Vec<usize> = (0..lines.len())
        .filter(|&line| lines[line].contains(" = "))
        .collect();
    let mut first = usize::MAX;
    for _ in 0..choice % 4 {
        let line = entries[usize::from(bytes.byte()) % entries.len()];
        let length = bytes.byte() % 32;
        let value = String::from_utf8_lossy(bytes.some(length.into())).into_owned();
        let key = lines[line]
            .split(" = ")
            .next()
            .unwrap_or_default()
            .to_owned();
        lines[line] = format!("{key} = {value}");
        first = first.min(line);
    }
    check(&lines.join("\n"), Some(first));
});

/// `touched` is the first line, from 0, that is not of a good file.
fn check(text: &str, touched: Option<usize>) {
    match Settings::parse(text, Path::new("robot.toml")) {
        Ok(settings) => {
            let image = settings.image();
            let back = Settings::from_image(image).expect("what a file says is a good image");
            assert!(back == settings, "the image says something else");
            let again = Settings::parse(&render(&back), Path::new("again.toml"));
            assert!(again.as_ref() == Ok(&settings), "{again:?}");
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains("robot.toml"), "{text}");
            match error {
                Error::Content { faults, .. } => {
                    assert!(!faults.is_empty());
                    for fault in faults {
                        assert!(!fault.what.is_empty());
                        if let (Some(touched), Some(line)) = (touched, fault.line) {
                            assert!(line > touched, "{text}: a line that was good");
                        }
                    }
                }
                Error::Rejected(location, what) => {
                    assert!(location.ends_with(')'), "no field is named: {text}");
                    let accepted = [", accepted: ", ", accepted is "];
                    assert!(accepted.iter().any(|is| what.contains(is)), "{text}");
                }
                other => panic!("{other}"),
            }
        }
    }
}
