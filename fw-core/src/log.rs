//! The UART log: `<I|W|E><count>: <text>\n` with a five-digit counter, in a queue that never blocks.

/// How much a line matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// `I`: for information.
    Info,
    /// `W`: the robot goes on, somebody should look.
    Warn,
    /// `E`: the robot stopped or refuses to start.
    Error,
}
