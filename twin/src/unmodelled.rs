//! What the models of a run could not stand for.

use rigless::session::Session;

use crate::virtual_board::VirtualBoard;

/// Everything the firmware touched that no model covers, and what a model objects to: one line
/// each. A run of a finished firmware has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Unmodelled {
    /// The lines.
    pub lines: Vec<String>,
}

impl Unmodelled {
    pub(crate) fn of(session: &Session<VirtualBoard>) -> Self {
        let mut lines = Vec::new();
        for unmapped in session.unmapped() {
            lines.push(format!(
                "nothing at {:#010x}, first from {:#010x}",
                unmapped.address, unmapped.program_counter
            ));
        }
        for (address, fault) in session.refused() {
            lines.push(format!("refused at {address:#010x}: {fault}"));
        }
        for (address, access) in session.unimplemented() {
            lines.push(format!(
                "no model of {} {} at {address:#010x}: {} reads, {} writes, first from {:#010x}",
                access.instance,
                access.register,
                access.reads,
                access.writes,
                access.program_counter
            ));
        }
        for (address, access) in session.undefined() {
            lines.push(format!(
                "no register of {} at {address:#010x}, first from {:#010x}",
                access.instance, access.program_counter
            ));
        }
        for (instance, number) in session.unrouted() {
            lines.push(format!("interrupt {number} of {instance} reaches no line"));
        }
        for told in session.told() {
            lines.push(format!(
                "{} {}: {} (first at {} ns)",
                told.instance, told.register, told.reason, told.at.0
            ));
        }
        Self { lines }
    }

    /// Whether there is nothing to report.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// How many things there are to report.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lines.len()
    }
}

impl std::fmt::Display for Unmodelled {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for line in &self.lines {
            writeln!(formatter, "{line}")?;
        }
        Ok(())
    }
}
