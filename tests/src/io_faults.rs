//! A board whose I/O fails at a chosen call.

use std::cell::RefCell;
use std::panic::resume_unwind;
use std::rc::Rc;

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::{self, I2c, Operation};
use host_link::board_io::{BoardIo, DynOutput, IoError, erase, input, output};

/// A fault of the board's I/O.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IoFault {
    /// None: calls are counted.
    None,
    /// This call fails, the next succeeds.
    FailsOnce(usize),
    /// The process is killed before this call: it unwinds with [`ProcessKilled`], and no call made
    /// while unwinding reaches the board.
    Killed(usize),
}

/// The panic payload of a killed process.
#[derive(Debug)]
pub struct ProcessKilled;

#[derive(Debug)]
struct FaultPlan {
    fault: IoFault,
    calls: usize,
    /// The calls that polled for an end that was not reached.
    polls: Vec<usize>,
}

/// A call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CallFailed;

impl i2c::Error for CallFailed {
    fn kind(&self) -> i2c::ErrorKind {
        i2c::ErrorKind::NoAcknowledge(i2c::NoAcknowledgeSource::Unknown)
    }
}

/// Counts the calls of a board's I/O.
#[derive(Clone, Debug)]
pub struct Calls(Rc<RefCell<FaultPlan>>);

impl Calls {
    /// The numbers of the calls so far, without those between two other polls of the same wait: a
    /// fault there has the same effect.
    pub fn distinct(&self) -> Vec<usize> {
        let plan = self.0.borrow();
        let is_poll = |call: &usize| plan.polls.binary_search(call).is_ok();
        (0..plan.calls)
            .filter(|&call| call == 0 || ![call - 1, call, call + 1].iter().all(is_poll))
            .collect()
    }

    /// The latest call was a poll without success.
    fn polled(&self) {
        let mut plan = self.0.borrow_mut();
        let call = plan.calls - 1;
        plan.polls.push(call);
    }

    fn call(&self) -> Result<(), CallFailed> {
        let (call, fault) = {
            let mut plan = self.0.borrow_mut();
            plan.calls += 1;
            (plan.calls - 1, plan.fault)
        };
        match fault {
            IoFault::FailsOnce(at) if call == at => Err(CallFailed),
            // Without a panic message.
            IoFault::Killed(at) if call == at => resume_unwind(Box::new(ProcessKilled)),
            IoFault::Killed(at) if call > at => Err(CallFailed),
            _ => Ok(()),
        }
    }
}

/// One interface of the board.
pub struct FaultyIo<T> {
    inner: T,
    calls: Calls,
}

impl<T> i2c::ErrorType for FaultyIo<T> {
    type Error = CallFailed;
}

impl I2c for FaultyIo<Box<dyn I2c<Error = IoError>>> {
    fn transaction(&mut self, address: u8, parts: &mut [Operation<'_>]) -> Result<(), CallFailed> {
        self.calls.call()?;
        self.inner.transaction(address, parts).map_err(|_| {
            self.calls.polled();
            CallFailed
        })
    }
}

/// Time passes only while the process runs.
impl DelayNs for FaultyIo<Box<dyn DelayNs>> {
    fn delay_ns(&mut self, ns: u32) {
        let plan = self.calls.0.borrow();
        if !matches!(plan.fault, IoFault::Killed(at) if plan.calls > at) {
            self.inner.delay_ns(ns);
        }
    }
}

/// `io` with a fault, and the count of its calls.
pub fn with_fault(io: BoardIo, fault: IoFault) -> (BoardIo, Calls) {
    fn faulty<T>(inner: T, calls: &Calls) -> FaultyIo<T> {
        FaultyIo {
            inner,
            calls: calls.clone(),
        }
    }
    let calls = Calls(Rc::new(RefCell::new(FaultPlan {
        fault,
        calls: 0,
        polls: Vec::new(),
    })));
    let line = |mut inner: Box<DynOutput>| {
        let calls = calls.clone();
        output(move |high| {
            calls.call().map_err(IoError::new)?;
            inner.set_state(high.into())
        })
    };
    let (polls, mut ready) = (calls.clone(), io.ready);
    let board = BoardIo {
        i2c: erase(faulty(io.i2c, &calls)),
        reset: line(io.reset),
        select: line(io.select),
        protect: line(io.protect),
        ready: input(move || {
            polls.call().map_err(IoError::new)?;
            let high = ready.is_high()?;
            if !high {
                polls.polled();
            }
            Ok(high)
        }),
        delay: Box::new(faulty(io.delay, &calls)),
        ..io
    };
    (board, calls)
}
