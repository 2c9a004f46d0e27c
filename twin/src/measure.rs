//! What a run costs: arrivals at instructions.

/// An arrival at a watched instruction, before it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hit {
    /// The instruction.
    pub address: u64,
    /// Nanoseconds of virtual time.
    pub at: u64,
    /// Instructions retired before it.
    pub instructions: u64,
}
