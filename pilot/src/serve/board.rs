//! The calls by which a client that borrows the robot works on its lines and buses ([`crate::borrowed`]).

use super::protocol::within;
use fw_core::wire::MAX_FRAME;
use host_link::board_io::{BoardIo, IoError};
use serde::{Deserialize, Serialize};

/// Most bytes of one transfer on I2C, and of the log in one answer.
pub const MAX_BYTES: usize = 2048;
/// Longest wait of one call, microseconds; a longer one is several calls, between which a stop is served.
pub(crate) const MAX_DELAY_US: u32 = 50_000;

/// One call of a line or a bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Call {
    /// A frame; the answer has the reply.
    Spi(Vec<u8>),
    /// Writes these bytes to this address on I2C, then reads so many; the answer has those.
    I2c(u8, Vec<u8>, usize),
    /// Drives NRST.
    Reset(bool),
    /// Drives SELECT.
    Select(bool),
    /// Drives `WP_EEPROM`.
    Protect(bool),
    /// Whether `STM_READY` is high.
    Ready,
    /// Waits, microseconds.
    Delay(u32),
    /// Microseconds on the board's clock.
    Clock,
    /// New bytes of the STM's log.
    Log,
}

impl Call {
    /// # Errors
    /// Names what is out of range.
    pub(super) fn check(&self) -> Result<(), String> {
        #[allow(clippy::cast_precision_loss)] // some thousands
        let at_most = |field, len: usize, most: usize| {
            let len = u32::try_from(len).unwrap_or(u32::MAX);
            within(field, len, 0.0..=most as f64)
        };
        match self {
            Self::Spi(frame) => at_most("spi", frame.len(), MAX_FRAME),
            Self::I2c(_, write, read) => at_most("i2c", write.len().max(*read), MAX_BYTES),
            Self::Delay(us) => within("delay", *us, 0.0..=MAX_DELAY_US.into()),
            _ => Ok(()),
        }
    }

    /// Performs a call that is no frame and not of the log; bytes and number of the answer.
    ///
    /// # Errors
    /// The driver's.
    pub(super) fn perform(&self, io: &mut BoardIo) -> Result<(Vec<u8>, u64), IoError> {
        let (mut bytes, mut number) = (Vec::new(), 0);
        match self {
            Self::I2c(address, write, read) => {
                bytes = vec![0; *read];
                (io.i2c)(*address, write, &mut bytes)?;
            }
            Self::Reset(high) => (io.reset)(*high)?,
            Self::Select(high) => (io.select)(*high)?,
            Self::Protect(high) => (io.protect)(*high)?,
            Self::Ready => number = (io.ready)()?.into(),
            Self::Delay(us) => (io.delay)(*us),
            Self::Clock => number = (io.clock)(),
            Self::Spi(_) | Self::Log => {}
        }
        Ok((bytes, number))
    }
}
