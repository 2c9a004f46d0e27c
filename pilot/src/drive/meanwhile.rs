//! Work that may take longer than the stop deadline, while frames go on.

use host_link::error::Error;
use host_link::session::{CommandRequest, Session, VelocityRequest};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// A velocity is good for so long after the report that it follows from, microseconds.
const GOOD_US: u64 = 100_000;

/// Does `work` on another thread. Where it takes longer than a frame, frames go on: with this velocity at
/// first, then at rest. `watch` follows each of them. On a virtual robot, whose clock stands still meanwhile,
/// there are none, nor a thread.
///
/// # Errors
/// Those of [`Session::exchange`] and of `watch`, with which the robot is stopped at once.
pub fn meanwhile<T: Send>(
    session: &mut Session<'_>,
    mut velocity: Option<VelocityRequest>,
    work: impl FnOnce() -> T + Send,
    mut watch: impl FnMut(&mut Session<'_>) -> Result<(), Error>,
) -> Result<T, Error> {
    if !session.io().real_time {
        return Ok(work());
    }
    let good_us = session.now_us() + GOOD_US;
    thread::scope(|scope| {
        let (sender, receiver) = channel();
        scope.spawn(move || drop(sender.send(work())));
        loop {
            let wait = Duration::from_micros(session.until_next_us());
            match receiver.recv_timeout(wait) {
                Ok(done) => return Ok(done),
                // It panicked, and so will the end of the scope.
                Err(RecvTimeoutError::Disconnected) => return Err(Error::Interrupted),
                Err(RecvTimeoutError::Timeout) if session.until_next_us() > 0 => continue,
                Err(RecvTimeoutError::Timeout) => {}
            }
            if let (Some(velocity), true) = (&mut velocity, session.now_us() >= good_us) {
                // The sweep goes on.
                (velocity.forward_mm_s, velocity.yaw_rate_deg_s) = (0.0, 0.0);
            }
            let request = CommandRequest {
                velocity,
                ..CommandRequest::default()
            };
            let exchanged = session.exchange(&request);
            if let Err(error) = exchanged.and_then(|_| watch(session)) {
                session.stop();
                return Err(error);
            }
        }
    })
}
