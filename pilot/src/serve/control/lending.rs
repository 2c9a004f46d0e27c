//! The robot's lines and buses in the hands of a client: its calls are performed, its frames observed, so that
//! those who watch see what it does.

use super::requests::refused;
use super::{Options, READY_MS, Server};
use crate::serve::board::{Call, MAX_BYTES};
use crate::serve::hub::{ClientId, Event};
use crate::serve::protocol::{Activity, Failure, Message, Request};
use host_link::board_io::BoardIo;
use host_link::eeprom::repair;
use host_link::error::{Error, Exit};
use host_link::session::Session;
use host_link::settings::Settings;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// Without a call for so long, those who watch get the last frame again.
const IDLE: Duration = Duration::from_millis(50);
/// A client that was stopped cleans up by calls at shorter distances; otherwise it waits for a person.
const GRACE: Duration = Duration::from_secs(2);
/// Unread bytes of the log that are kept for the client.
const MAX_LOG: usize = 1 << 16;

/// A robot that is lent.
#[derive(Default)]
pub(super) struct Loan {
    /// Bytes of the log that the client has not read.
    pub(super) log: Vec<u8>,
    /// Why its frames are refused: the robot was stopped.
    stopped: Option<Failure>,
    /// The configuration may have changed since the last frame.
    reconfigured: bool,
}

impl Loan {
    pub(super) fn keep_log(&mut self, bytes: &[u8]) {
        self.log.extend_from_slice(bytes);
        let over = self.log.len().saturating_sub(MAX_LOG);
        self.log.drain(..over);
    }
}

impl Server {
    /// Performs the calls of the client that has the lease until it returns the robot, has gone, or makes none
    /// after it was stopped; then stops and repairs what it left.
    ///
    /// # Errors
    /// [`Error::Interrupted`]; those of [`repair::repair`].
    // Requirement: SERVE-borrow-1, SERVE-drive-2
    pub(super) fn lend(&mut self, io: &mut BoardIo, options: &Options) -> Result<(), Error> {
        self.activity = Activity::Command;
        self.loan = Some(Loan {
            reconfigured: true,
            ..Loan::default()
        });
        let config = Settings::first_board()?.config().clone();
        let mut session = Session::with_config(io, config, options.rate_hz);
        if let Some(lease) = &self.lease {
            self.reply(lease.client, &Ok(()));
        }
        let (mut returned, mut called) = (false, Instant::now());
        let interrupted = loop {
            let interrupted = session.io().interrupt.check();
            let borrower = self.lease.as_ref().map(|lease| lease.client);
            match self.events.recv_timeout(IDLE) {
                Ok(Event::Asked(id, Ok(Request::Board { call }))) if Some(id) == borrower => {
                    if self.must_reread(&call) {
                        session = session.reread();
                    }
                    self.call(id, &call, &mut session);
                    called = Instant::now();
                }
                Ok(Event::Asked(id, Ok(Request::Return))) if Some(id) == borrower => {
                    returned = true;
                    self.reply(id, &Ok(()));
                }
                Ok(event) => self.handle_event(event),
                Err(RecvTimeoutError::Timeout) => self.publish(&[]),
                Err(RecvTimeoutError::Disconnected) => returned = true,
            }
            self.check_lease();
            let loan = self.loan.as_ref();
            let stopped = loan.is_some_and(|loan| loan.stopped.is_some());
            let gone = !borrower.is_some_and(|id| self.clients.contains_key(&id))
                || stopped && called.elapsed() > GRACE;
            let ended = returned || gone || interrupted.is_err();
            let cancelled = self.cancelled.take();
            let drives = self.loan.as_ref().is_some_and(|loan| !loan.reconfigured);
            if drives && !returned && (ended || cancelled.is_some()) {
                session.stop();
            }
            if let (Some(loan), Some(why)) = (&mut self.loan, &cancelled) {
                loan.stopped = Some(Failure::from(why));
            }
            if ended {
                break interrupted;
            }
        };
        let loan = self.loan.take().unwrap_or_default();
        if let Some(lease) = self.lease.take()
            && let Some(client) = self.clients.get_mut(&lease.client)
        {
            client.loan_ended = loan.stopped;
        }
        self.next = None;
        self.activity = Activity::Idle;
        if let Some(journal) = &options.journal {
            repair::repair(io, journal, !returned, READY_MS)?;
        }
        interrupted
    }

    /// Whether a frame follows a reset: the STM has read its configuration again.
    fn must_reread(&mut self, call: &Call) -> bool {
        let Some(loan) = &mut self.loan else {
            return false;
        };
        match call {
            // Its heading and position begin again at zero, and so does the map.
            Call::Reset(false) => {
                loan.reconfigured = true;
                self.pose = None;
            }
            Call::Spi(_) => return std::mem::take(&mut loan.reconfigured),
            _ => {}
        }
        false
    }

    fn call(&mut self, id: ClientId, call: &Call, session: &mut Session<'_>) {
        let Some(loan) = &mut self.loan else {
            return;
        };
        let mut report = None;
        let outcome = match (call, &loan.stopped) {
            (Call::Spi(_), Some(why)) => {
                let why = why.clone().into();
                return self.reply(id, &Err(why));
            }
            (Call::Spi(frame), None) => session.relay(frame).map(|(reply, accepted)| {
                report = accepted;
                (reply, 0)
            }),
            (Call::Log, _) => {
                let fresh = session.poll_log();
                loan.keep_log(&fresh);
                let read = loan.log.drain(..loan.log.len().min(MAX_BYTES)).collect();
                self.publish_log(&fresh);
                let unread = session.log_error();
                unread.map_or(Ok((read, 0)), |why| Err(refused(why, Exit::Device)))
            }
            _ => {
                let outcome = call.perform(session.io());
                outcome.map_err(|cause| refused(&cause.to_string(), Exit::Device))
            }
        };
        if matches!(call, Call::Spi(_)) {
            if let Err(why) = self.frame(session, report.as_ref()) {
                self.cancelled = Some(why);
            }
        } else {
            self.pacer.wait(session.now_us());
        }
        let (bytes, number, error) = match outcome {
            Ok((bytes, number)) => (bytes, number, None),
            Err(Error::Spi(cause)) => (Vec::new(), 0, Some(cause)),
            Err(error) => (Vec::new(), 0, Some(error.to_string())),
        };
        // After the frame: the next call must not come while it is shown.
        self.send_to(
            id,
            &Message::Board {
                bytes,
                number,
                error,
            },
        );
        self.reply(id, &Ok(()));
    }
}

#[test]
fn log_of_a_loan_keeps_the_newest_bytes() {
    let mut loan = Loan::default();
    loan.keep_log(&vec![1; MAX_LOG]);
    loan.keep_log(&[2; 3]);
    assert_eq!((loan.log.len(), loan.log[0]), (MAX_LOG, 1));
    assert_eq!(loan.log[MAX_LOG - 4..], [1, 2, 2, 2]);
}
