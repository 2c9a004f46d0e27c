//! The emulator on a thread of its own, and the handle that moves it along.
//!
//! The emulator runs until an instant it was asked to reach and then waits for word: another
//! instant, or a piece of work to do on the board where it stands. Everything that happens is
//! decided by virtual time, so how the two threads interleave changes nothing.

use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{channel, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use rigless::emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop, Watch};
use rigless::image::Image;
use rigless::session::Session;
use rigless::time::VirtualNanos;

use crate::trace::{Event, What};
use crate::virtual_board::VirtualBoard;

/// The board at a stop, for a piece of work.
pub struct Scene<'a> {
    /// The run, with the board and what the emulator reports.
    pub session: &'a mut Session<VirtualBoard>,
    /// The core.
    pub host: &'a mut dyn Host,
    /// Where the run stands, nanoseconds of virtual time.
    pub now: u64,
    /// Instructions retired so far.
    pub instructions: u64,
    /// What was followed.
    pub followed: &'a mut Followed,
}

/// What a measurement follows, and what it saw.
#[derive(Debug, Default)]
pub struct Followed {
    /// Registers whose writes are recorded.
    pub registers: Vec<u64>,
    /// Whether the chip select's edges are.
    pub select: bool,
    /// What happened.
    pub events: Vec<Event>,
}

type Work = Box<dyn FnOnce(&mut Scene<'_>) + Send>;

enum Order {
    Do(Work),
    RunUntil(u64),
}

/// The emulation has ended, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended(pub String);

impl std::fmt::Display for Ended {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "the emulation has ended: {}", self.0)
    }
}

impl std::error::Error for Ended {}

struct Conductor {
    orders: Receiver<Order>,
    /// Where the run stands at each stop it was asked for.
    reached: Sender<u64>,
    followed: Followed,
}

impl Driver<VirtualBoard> for Conductor {
    fn on_settled(
        &mut self,
        session: &mut Session<VirtualBoard>,
        _host: &mut dyn Host,
        settled: Settled,
    ) {
        let followed = &mut self.followed;
        match settled {
            Settled::Access { access, value }
                if access.kind == AccessKind::Write
                    && followed.registers.contains(&access.address) =>
            {
                followed.events.push(Event {
                    what: What::Wrote {
                        address: access.address,
                        value,
                    },
                    at_ns: access.virtual_time.0,
                    instructions: access.instruction_count,
                });
            }
            Settled::Hit(hit) => followed.events.push(Event {
                what: What::Arrived {
                    address: hit.address,
                },
                at_ns: hit.at.0,
                instructions: hit.instruction_count,
            }),
            Settled::Stop(stop) if followed.select => {
                let selects = session.board_mut().robot.around.selects.drain(..);
                followed
                    .events
                    .extend(selects.map(|(at_ns, selected)| Event {
                        what: What::Select(selected),
                        at_ns,
                        instructions: stop.instruction_count,
                    }));
            }
            _ => {}
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<VirtualBoard>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        self.reached.send(stop.at.0).ok()?;
        loop {
            match self.orders.recv().ok()? {
                Order::Do(work) => work(&mut Scene {
                    session,
                    host,
                    now: stop.at.0,
                    instructions: stop.instruction_count,
                    followed: &mut self.followed,
                }),
                Order::RunUntil(until) if until > stop.at.0 => return Some(VirtualNanos(until)),
                Order::RunUntil(_) => self.reached.send(stop.at.0).ok()?,
            }
        }
    }
}

struct Line {
    orders: Option<Sender<Order>>,
    reached: Receiver<u64>,
    now: u64,
    /// Ends the run wherever it is, in a debugger's hands too.
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), String>>>,
    ended: Option<Ended>,
}

/// A running emulation. It stands still except inside [`Emulation::run_until`].
pub struct Emulation {
    line: Mutex<Line>,
}

impl std::fmt::Debug for Emulation {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Emulation").finish_non_exhaustive()
    }
}

/// The debugger's end: where it connects, and whether the core waits for it.
#[derive(Debug)]
pub struct Debugger {
    /// The bound listener.
    pub listener: TcpListener,
    /// Hold the core before its first instruction.
    pub wait: bool,
}

impl Emulation {
    /// Starts `board` with `images` in its flash and stands before its first instruction.
    ///
    /// # Errors
    /// An image the part cannot hold.
    pub fn start(
        board: VirtualBoard,
        images: Vec<Image>,
        debugger: Option<Debugger>,
    ) -> Result<Self, Ended> {
        let session = Session::new(Box::new(board), 0, VirtualNanos(0))
            .map_err(|error| Ended(error.to_string()))?;
        let (orders, received) = channel();
        let (reached, reports) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("virtual board".into())
            .spawn(move || {
                let mut start = Start::new(&images);
                if let Some(debugger) = &debugger {
                    start.debugger = Some(&debugger.listener);
                    start.wait_for_debugger = debugger.wait;
                }
                start.interrupt = Some(&stopped);
                let conductor = Conductor {
                    orders: received,
                    reached,
                    followed: Followed::default(),
                };
                emulator::run(session, &start, conductor)
                    .map(drop)
                    .map_err(|error| error.to_string())
            })
            .map_err(|error| Ended(error.to_string()))?;
        let emulation = Self {
            line: Mutex::new(Line {
                orders: Some(orders),
                reached: reports,
                now: 0,
                stop,
                thread: Some(thread),
                ended: None,
            }),
        };
        emulation.with_line(Line::wait)?;
        Ok(emulation)
    }

    fn with_line<T>(&self, act: impl FnOnce(&mut Line) -> Result<T, Ended>) -> Result<T, Ended> {
        let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ended) = &line.ended {
            return Err(ended.clone());
        }
        act(&mut line)
    }

    /// Does `work` on the board where it stands, and answers with its result.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Scene<'_>) -> T + Send + 'static,
    ) -> Result<T, Ended> {
        self.with_line(|line| {
            let (answer, answered) = channel();
            line.order(Order::Do(Box::new(move |scene| {
                // A caller that is gone wants no answer.
                let _ = answer.send(work(scene));
            })))?;
            answered.recv().map_err(|_| line.end())
        })
    }

    /// Runs until `until` nanoseconds of virtual time.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn run_until(&self, until: u64) -> Result<(), Ended> {
        self.with_line(|line| {
            line.order(Order::RunUntil(until))?;
            line.wait()
        })
    }

    /// Runs for `ns` nanoseconds of virtual time.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn run_for(&self, ns: u64) -> Result<(), Ended> {
        self.with_line(|line| {
            line.order(Order::RunUntil(line.now + ns))?;
            line.wait()
        })
    }

    /// Where the run stands, nanoseconds of virtual time.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn now(&self) -> Result<u64, Ended> {
        self.with_line(|line| Ok(line.now))
    }

    /// Watches an instruction, or no longer does; its arrivals are kept in [`Scene::followed`].
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn watch(&self, address: u64, watched: bool) -> Result<(), Ended> {
        self.with(move |scene| {
            let watch = Watch::Instruction(address);
            if watched {
                scene.session.watch(watch);
            } else {
                scene.session.unwatch(watch);
            }
        })
    }
}

impl Line {
    fn order(&mut self, order: Order) -> Result<(), Ended> {
        let sent = self
            .orders
            .as_ref()
            .is_some_and(|orders| orders.send(order).is_ok());
        if sent {
            Ok(())
        } else {
            Err(self.end())
        }
    }

    fn wait(&mut self) -> Result<(), Ended> {
        match self.reached.recv() {
            Ok(now) => {
                self.now = now;
                Ok(())
            }
            Err(_) => Err(self.end()),
        }
    }

    /// The thread is gone: why.
    fn end(&mut self) -> Ended {
        self.orders = None;
        let reason = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Ok(()))) | None => "the firmware or the debugger ended the run".to_owned(),
            Some(Ok(Err(error))) => error,
            Some(Err(panic)) => panic
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| panic.downcast_ref::<&str>().map(|&text| text.to_owned()))
                .unwrap_or_else(|| "a model of the board failed".to_owned()),
        };
        let ended = Ended(reason);
        self.ended = Some(ended.clone());
        ended
    }
}

impl Drop for Emulation {
    fn drop(&mut self) {
        let line = self.line.get_mut().unwrap_or_else(PoisonError::into_inner);
        line.orders = None;
        line.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = line.thread.take() {
            // What the thread had to say, its callers were told.
            let _ = thread.join();
        }
    }
}
