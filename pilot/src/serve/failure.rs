//! An error on its way to a client, and from it to the exit code of a command.

use host_link::error::{Error, Exit};
use serde::{Deserialize, Serialize};

/// An error as clients get it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// The sentence.
    pub text: String,
    /// The exit code of a command that ends with it.
    pub exit: u8,
}

impl From<&Error> for Failure {
    fn from(error: &Error) -> Self {
        Self {
            text: error.to_string(),
            exit: error.exit().code(),
        }
    }
}

impl From<Failure> for Error {
    fn from(Failure { text, exit }: Failure) -> Self {
        let known = Exit::ALL.iter().find(|(known, _)| known.code() == exit);
        Self::Server {
            text,
            exit: known.map_or(Exit::Device, |&(exit, _)| exit),
        }
    }
}
