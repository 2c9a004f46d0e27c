//! Names of the part's pins.

/// The ports the LQFP64 part has.
pub const PORTS: [&str; 6] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOH"];

/// A pin of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pin {
    /// Its port's index in [`PORTS`].
    pub port: usize,
    /// 0 to 15.
    pub number: u8,
}

/// The pin `P<port><number>`.
///
/// # Panics
/// When the part has no such port or pin; the names are constants of this crate.
pub const fn pin(port: char, number: u8) -> Pin {
    let port = match port {
        'A' => 0,
        'B' => 1,
        'C' => 2,
        'D' => 3,
        'E' => 4,
        'H' => 5,
        _ => panic!("ports A to E and H"),
    };
    assert!(number < 16, "a port has sixteen pins");
    Pin { port, number }
}
