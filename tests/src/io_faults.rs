//! Wires on which a chosen call goes wrong, in front of any others.

use std::cell::RefCell;
use std::panic::resume_unwind;
use std::rc::Rc;

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{self, InputPin, OutputPin};
use embedded_hal::i2c::{self, I2c, Operation};
use host_link::board_io::{erase, BoardIo, DynOutput, IoError};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// Nothing: calls are counted.
    None,
    /// This call fails, the next works again.
    Fails(usize),
    /// From this call on nothing answers on the EEPROM's bus; the lines still work.
    BusDies(usize),
    /// The process dies before this call: it unwinds with [`Died`], and nothing that is called on the
    /// way out reaches the board.
    Dies(usize),
}

/// The payload of a process that died.
#[derive(Debug)]
pub struct Died;

#[derive(Debug)]
struct Plan {
    mishap: Mishap,
    calls: usize,
    /// Which calls only looked whether something is over, and it was not.
    waited: Vec<usize>,
}

/// A call did not get through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trouble;

impl digital::Error for Trouble {
    fn kind(&self) -> digital::ErrorKind {
        digital::ErrorKind::Other
    }
}

impl i2c::Error for Trouble {
    fn kind(&self) -> i2c::ErrorKind {
        i2c::ErrorKind::NoAcknowledge(i2c::NoAcknowledgeSource::Unknown)
    }
}

/// Counts the calls of a machine's wires.
#[derive(Clone, Debug)]
pub struct Calls(Rc<RefCell<Plan>>);

impl Calls {
    /// The numbers of the calls so far, without those in the middle of a wait: a look that found
    /// nothing between two others that found nothing is the same to everybody.
    #[must_use]
    pub fn telling(&self) -> Vec<usize> {
        let plan = self.0.borrow();
        let waits = |call: &usize| plan.waited.binary_search(call).is_ok();
        (0..plan.calls)
            .filter(|&call| call == 0 || ![call - 1, call, call + 1].iter().all(waits))
            .collect()
    }

    /// The latest call found that it has to wait.
    fn waited(&self) {
        let mut plan = self.0.borrow_mut();
        let call = plan.calls - 1;
        plan.waited.push(call);
    }

    fn call(&self, bus: bool) -> Result<(), Trouble> {
        let (call, mishap) = {
            let mut plan = self.0.borrow_mut();
            plan.calls += 1;
            (plan.calls - 1, plan.mishap)
        };
        match mishap {
            Mishap::Fails(at) if call == at => Err(Trouble),
            Mishap::BusDies(at) if call >= at && bus => Err(Trouble),
            // No message: it is what the test wants.
            Mishap::Dies(at) if call == at => resume_unwind(Box::new(Died)),
            Mishap::Dies(at) if call > at => Err(Trouble),
            _ => Ok(()),
        }
    }
}

/// One of the wires.
pub struct Wire<T> {
    inner: T,
    calls: Calls,
}

impl<T> digital::ErrorType for Wire<T> {
    type Error = Trouble;
}

impl OutputPin for Wire<Box<DynOutput>> {
    fn set_low(&mut self) -> Result<(), Trouble> {
        self.calls.call(false)?;
        self.inner.set_low().map_err(|_| Trouble)
    }

    fn set_high(&mut self) -> Result<(), Trouble> {
        self.calls.call(false)?;
        self.inner.set_high().map_err(|_| Trouble)
    }
}

impl InputPin for Wire<Box<dyn InputPin<Error = IoError>>> {
    fn is_high(&mut self) -> Result<bool, Trouble> {
        self.calls.call(false)?;
        let high = self.inner.is_high().map_err(|_| Trouble)?;
        if !high {
            self.calls.waited();
        }
        Ok(high)
    }

    fn is_low(&mut self) -> Result<bool, Trouble> {
        self.is_high().map(|high| !high)
    }
}

impl<T> i2c::ErrorType for Wire<T> {
    type Error = Trouble;
}

impl I2c for Wire<Box<dyn I2c<Error = IoError>>> {
    fn transaction(&mut self, address: u8, parts: &mut [Operation<'_>]) -> Result<(), Trouble> {
        self.calls.call(true)?;
        self.inner.transaction(address, parts).map_err(|_| {
            self.calls.waited();
            Trouble
        })
    }
}

/// Time passes only while the process lives.
impl DelayNs for Wire<Box<dyn DelayNs>> {
    fn delay_ns(&mut self, ns: u32) {
        let plan = self.calls.0.borrow();
        if !matches!(plan.mishap, Mishap::Dies(at) if plan.calls > at) {
            self.inner.delay_ns(ns);
        }
    }
}

/// `io` with a mishap ahead of it, and the count of its calls.
#[must_use]
pub fn with_mishap(io: BoardIo, mishap: Mishap) -> (BoardIo, Calls) {
    fn wire<T>(inner: T, calls: &Calls) -> Wire<T> {
        Wire {
            inner,
            calls: calls.clone(),
        }
    }
    let calls = Calls(Rc::new(RefCell::new(Plan {
        mishap,
        calls: 0,
        waited: Vec::new(),
    })));
    let faulty = BoardIo {
        i2c: erase(wire(io.i2c, &calls)),
        reset: erase(wire(io.reset, &calls)),
        select: erase(wire(io.select, &calls)),
        protect: erase(wire(io.protect, &calls)),
        ready: erase(wire(io.ready, &calls)),
        delay: Box::new(wire(io.delay, &calls)),
        ..io
    };
    (faulty, calls)
}
