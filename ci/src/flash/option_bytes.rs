//! The brown-out level, an option byte: flashing does not change it, so a part may come without one.

/// `FLASH_OPTCR`, which shows the option bytes; bits 3 and 2 are the level, 3 is off (RM0383, 3.8.6).
pub const OPTCR: &str = "0x40023C14";

/// What to do about the brown-out level, by what `probe-rs read` or `OpenOCD`'s `mdw` prints of [`OPTCR`]; `None`
/// where it is 2 (2.4 V) or 3.
pub fn advice(output: &str, interface: &str) -> Option<String> {
    // Some versions print the address before the word.
    let is_word = |word: &&str| word.len() == 8 && word.bytes().all(|b| b.is_ascii_hexdigit());
    let word = output.split_whitespace().rfind(is_word);
    let Some(word) = word.and_then(|word| u32::from_str_radix(word, 16).ok()) else {
        let unread =
            "the brown-out level could not be read: `--bringup` and `robot bringup` report it";
        return Some(unread.into());
    };
    let found = match word >> 2 & 3 {
        0 | 1 => return None,
        2 => "is at level 1",
        _ => "is off",
    };
    Some(format!(
        "the brown-out reset {found}; below 2.4 V the flash reads wrongly and the motors may run: set level 2, \
         `openocd -f interface/{interface}.cfg -f target/stm32f4x.cfg -c 'init; reset halt; stm32f2x \
         options_write 0 0xE4; exit'`, and cycle the power"
    ))
}

#[test]
fn brown_out_level_below_2_or_unread_is_reported() {
    for (output, expected) in [
        ("0fffaaed\n", "is off"),
        ("40023c14: 0fffaae9\n", "is at level 1"),
        ("Info : clock speed\n0x40023c14: 0fffaae5 \n\n", ""),
        ("0fffaae1\n", ""),
        ("Error: no device found\n", "could not be read"),
    ] {
        let advice = advice(output, "cmsis-dap").unwrap_or_default();
        assert!(advice.contains(expected), "{advice}");
        assert_eq!(advice.is_empty(), expected.is_empty(), "{output}");
    }
}
