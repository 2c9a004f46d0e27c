//! The robot's lines and buses over a server's socket: a command that borrows the robot works on them as on
//! its own.

use crate::client::{self, Client};
use crate::serve::board::{Call, MAX_DELAY_US};
use crate::serve::protocol::{Failure, Message, Request};
use host_link::board_io::{BoardIo, Interrupt, IoError, OutputLine};
use host_link::error::Error;
use std::cell::RefCell;
use std::rc::Rc;

/// The robot of a server.
#[derive(Clone)]
pub struct Borrowed(Rc<RefCell<State>>);

struct State {
    client: Client,
    /// Why the robot was taken back.
    failure: Option<Failure>,
    now_us: u64,
}

impl Borrowed {
    /// Borrows the server's robot.
    ///
    /// # Errors
    /// Those of [`Client::request`]: another client drives.
    pub fn new(mut client: Client) -> Result<Self, Error> {
        client.request(&Request::Borrow)?;
        Ok(Self(Rc::new(RefCell::new(State {
            client,
            failure: None,
            now_us: 0,
        }))))
    }

    /// Its lines and buses.
    pub fn io(&self, interrupt: Interrupt) -> BoardIo {
        let line = |call: fn(bool) -> Call| -> OutputLine {
            let robot = self.clone();
            Box::new(move |high| robot.run(call(high)))
        };
        let [spi, i2c, ready, delay, clock, log] = [(); 6].map(|()| self.clone());
        BoardIo {
            // The server keeps the chip-select's set-up time.
            spi: Box::new(move |frame, reply, _| spi.read(Call::Spi(frame.to_vec()), reply)),
            i2c: Box::new(move |address, write, read| {
                i2c.read(Call::I2c(address, write.to_vec(), read.len()), read)
            }),
            reset: line(Call::Reset),
            select: line(Call::Select),
            protect: line(Call::Protect),
            ready: Box::new(move || Ok(ready.call(Call::Ready)?.1 != 0)),
            delay: Box::new(move |us| delay.wait(us)),
            clock: Box::new(move || clock.micros()),
            real_time: true,
            // The server reads at the configured rate.
            log: Box::new(move |_| {
                let read = log.call(Call::Log).map(|(bytes, _)| bytes);
                read.map_err(|why| Error::device("the STM's log", why, "`robot doctor` checks it"))
            }),
            interrupt,
        }
    }

    /// Gives it back.
    ///
    /// # Errors
    /// Why the server took it back before, or that the server has ended.
    pub fn give_back(self) -> Result<(), Error> {
        let state = &mut *self.0.borrow_mut();
        let returned = state.client.request(&Request::Return);
        state.failure.take().map_or(returned, |why| Err(why.into()))
    }

    fn call(&self, call: Call) -> Result<(Vec<u8>, u64), IoError> {
        let State {
            client, failure, ..
        } = &mut *self.0.borrow_mut();
        let refused = match client.ask(&Request::Board { call }) {
            Ok(Some(Message::Board {
                error: Some(why), ..
            })) => return Err(IoError::new(format_args!("{why}"))),
            Ok(Some(Message::Board { bytes, number, .. })) => return Ok((bytes, number)),
            Ok(_) => client::lost("no answer"),
            Err(error) => error,
        };
        failure.get_or_insert(Failure::from(&refused));
        Err(IoError::new(format_args!("{refused}")))
    }

    fn read(&self, call: Call, out: &mut [u8]) -> Result<(), IoError> {
        let (bytes, _) = self.call(call)?;
        let all = bytes.len() == out.len();
        all.then(|| out.copy_from_slice(&bytes))
            .ok_or_else(|| IoError::new(format_args!("short answer")))
    }

    fn run(&self, call: Call) -> Result<(), IoError> {
        self.call(call).map(drop)
    }

    fn wait(&self, mut left_us: u32) {
        while left_us > 0 {
            let us = left_us.min(MAX_DELAY_US);
            // The next transfer reports a robot that was taken back.
            let _ = self.run(Call::Delay(us));
            left_us -= us;
        }
    }

    fn micros(&self) -> u64 {
        let answer = self.call(Call::Clock);
        let State { now_us, .. } = &mut *self.0.borrow_mut();
        // Without an answer time stands still; the next transfer reports why.
        *now_us = answer.map_or(*now_us, |(_, now)| now);
        *now_us
    }
}
