//! The emulator on a thread of its own, and the handle that advances it.
//!
//! The emulator runs to a requested instant and then waits for a command: another instant, or work
//! to do on the stopped board. Virtual time alone decides what happens, so the interleaving of the
//! two threads changes nothing.

use std::net::TcpListener;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use rigless::emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop, Watch};
use rigless::image::Image;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use crate::trace::{EventKind, Tracer};
use crate::virtual_board::{McuOnBoard, VirtualBoard};

/// The board between two runs, for work on it.
pub struct StoppedBoard<'a> {
    /// The run, with the board and what the emulator reports.
    pub session: &'a mut Session<VirtualBoard>,
    /// The core and its memory.
    pub host: &'a mut dyn Host,
    /// Nanoseconds of virtual time.
    pub now: u64,
    /// Instructions retired so far.
    pub instructions: u64,
    /// What is traced.
    pub tracer: &'a mut Tracer,
}

impl StoppedBoard<'_> {
    /// The microcontroller and the board around it.
    pub fn mcu(&mut self) -> &mut McuOnBoard {
        &mut self.session.board_mut().mcu
    }

    /// From now on exceptions through the vector table at `table` take time.
    pub fn time_exceptions(&mut self, table: u64) {
        let vector = |nth| self.host.read(table + 4 * nth, Width::W32).ok();
        let vectors = VECTORS.filter_map(vector).filter(|vector| vector % 2 != 0);
        self.tracer.handlers = vectors.map(|vector| vector - 1).collect();
        for &handler in &self.tracer.handlers {
            self.session.watch(Watch::Instruction(handler));
        }
    }

    /// Holds the core, or lets it go on.
    pub fn hold_core(&mut self, held: bool) {
        self.tracer.held = held;
        self.host.hold(held);
    }

    /// [`StoppedBoard::now`] in the emulator's type.
    pub const fn at(&self) -> VirtualNanos {
        VirtualNanos(self.now)
    }
}

/// Entries of the vector table behind the stack and the reset: NMI to the last interrupt, SPI5 (RM0383, table 37).
const VECTORS: Range<u64> = 2..16 + 86;

type Work<T> = Box<dyn FnOnce(&mut StoppedBoard<'_>) -> T + Send>;

enum Command {
    Do(Work<()>),
    /// Runs until the instant that the work returns.
    RunUntil(Work<u64>),
}

/// The emulation has ended, and why: a model failed, or a debugger ended the run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the emulation has ended: {0}")]
pub struct EmulationEnded(pub String);

impl EmulationEnded {
    pub(crate) fn because(error: impl std::fmt::Display) -> Self {
        Self(error.to_string())
    }
}

struct EmulatorDriver {
    commands: Receiver<Command>,
    /// The virtual time of each requested stop.
    stops: Sender<u64>,
    tracer: Tracer,
    /// The end of a stall, see [`Tracer::stall`].
    stalled_until: Option<VirtualNanos>,
}

impl Driver<VirtualBoard> for EmulatorDriver {
    fn on_settled(
        &mut self,
        session: &mut Session<VirtualBoard>,
        host: &mut dyn Host,
        settled: Settled,
    ) {
        let tracer = &mut self.tracer;
        match settled {
            Settled::Access { access, value } => {
                let address = access.address;
                session.board_mut().mcu.chip.check_access(&access, value);
                if tracer.triggers.contains(&address) {
                    tracer.take_snapshot(&access, value, host);
                }
                if access.kind == AccessKind::Write && tracer.registers.contains(&address) {
                    let kind = EventKind::Write { address, value };
                    tracer.record(kind, access.virtual_time, access.instruction_count);
                }
            }
            Settled::Hit(hit) => {
                let address = hit.address;
                let ns = tracer.stall_ns(address);
                if ns > 0 {
                    let until = VirtualNanos(hit.at.0 + ns);
                    self.stalled_until = Some(until);
                    session.pause_at(Some(until));
                    host.hold(true);
                }
                if tracer.instructions.contains(&address) {
                    let kind = EventKind::Reached { address };
                    tracer.record(kind, hit.at, hit.instruction_count);
                }
            }
            Settled::Stop(stop) => {
                if self.stalled_until.take_if(|end| *end <= stop.at).is_some() {
                    host.hold(tracer.held);
                }
                if tracer.chip_select {
                    for (at_ns, selected) in session.board_mut().mcu.board.selects.drain(..) {
                        let kind = EventKind::ChipSelect(selected);
                        tracer.record(kind, VirtualNanos(at_ns), stop.instruction_count);
                    }
                }
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
        self.stops.send(stop.at.0).ok()?;
        let mut stopped = StoppedBoard {
            session,
            host,
            now: stop.at.0,
            instructions: stop.instruction_count,
            tracer: &mut self.tracer,
        };
        loop {
            match self.commands.recv().ok()? {
                Command::Do(work) => work(&mut stopped),
                Command::RunUntil(work) => match work(&mut stopped) {
                    until if until > stop.at.0 => return Some(VirtualNanos(until)),
                    _ => self.stops.send(stop.at.0).ok()?,
                },
            }
        }
    }
}

#[derive(Debug)]
struct Handle {
    commands: Option<Sender<Command>>,
    stops: Receiver<u64>,
    now: u64,
    /// Ends the run wherever it is, in a debugger's hands too.
    interrupt: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), String>>>,
    ended: Option<EmulationEnded>,
}

/// A running emulation. It stands still except inside [`Emulator::run_until`].
#[derive(Debug)]
pub struct Emulator {
    handle: Mutex<Handle>,
}

/// The debugger's end: where it connects, and whether the core waits for it.
#[derive(Debug)]
pub struct Debugger {
    /// The bound listener.
    pub listener: TcpListener,
    /// Hold the core before its first instruction.
    pub wait: bool,
}

impl Emulator {
    /// Starts `board` with `images` in its flash, stopped before its first instruction.
    ///
    /// # Errors
    /// An image the part cannot hold.
    pub fn start(
        board: VirtualBoard,
        images: Vec<Image>,
        debugger: Option<Debugger>,
    ) -> Result<Self, EmulationEnded> {
        let session =
            Session::new(Box::new(board), 0, VirtualNanos(0)).map_err(EmulationEnded::because)?;
        let (commands, received) = channel();
        let (reports, stops) = channel();
        let interrupt = Arc::new(AtomicBool::new(false));
        let interrupted = Arc::clone(&interrupt);
        let thread = std::thread::Builder::new()
            .name("virtual board".into())
            .spawn(move || {
                let mut start = Start::new(&images);
                if let Some(debugger) = &debugger {
                    start.debugger = Some(&debugger.listener);
                    start.wait_for_debugger = debugger.wait;
                }
                start.interrupt = Some(&interrupted);
                let driver = EmulatorDriver {
                    commands: received,
                    stops: reports,
                    tracer: Tracer::default(),
                    stalled_until: None,
                };
                emulator::run(session, &start, driver)
                    .map(drop)
                    .map_err(|error| error.to_string())
            })
            .map_err(EmulationEnded::because)?;
        let emulator = Self {
            handle: Mutex::new(Handle {
                commands: Some(commands),
                stops,
                now: 0,
                interrupt,
                thread: Some(thread),
                ended: None,
            }),
        };
        emulator.with_handle(Handle::wait_for_stop)?;
        Ok(emulator)
    }

    fn with_handle<T>(
        &self,
        act: impl FnOnce(&mut Handle) -> Result<T, EmulationEnded>,
    ) -> Result<T, EmulationEnded> {
        let mut handle = self.handle.lock().unwrap_or_else(PoisonError::into_inner);
        match &handle.ended {
            Some(ended) => Err(ended.clone()),
            None => act(&mut handle),
        }
    }

    /// Does `work` on the stopped board, and returns its result.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn stopped<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut StoppedBoard<'_>) -> T + Send + 'static,
    ) -> Result<T, EmulationEnded> {
        self.with_handle(|handle| handle.answer_of(work))
    }

    /// Runs until the instant that `before` returns, nanoseconds of virtual time, and returns what `after`
    /// does. The other thread is waited for once: that takes longer than many a run.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn run_until<T: Send + 'static>(
        &self,
        before: impl FnOnce(&mut StoppedBoard<'_>) -> u64 + Send + 'static,
        after: impl FnOnce(&mut StoppedBoard<'_>) -> T + Send + 'static,
    ) -> Result<T, EmulationEnded> {
        self.with_handle(|handle| {
            handle.send(Command::RunUntil(Box::new(before)))?;
            let answer = handle.answer_of(after)?;
            handle.wait_for_stop()?;
            Ok(answer)
        })
    }

    /// Nanoseconds of virtual time.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn now(&self) -> Result<u64, EmulationEnded> {
        self.with_handle(|handle| Ok(handle.now))
    }
}

impl Handle {
    fn send(&mut self, command: Command) -> Result<(), EmulationEnded> {
        let sent = self.commands.as_ref().map(|to| to.send(command).is_ok());
        sent.unwrap_or(false)
            .then_some(())
            .ok_or_else(|| self.end())
    }

    /// Lets the other thread do `work`, and waits for its result.
    fn answer_of<T: Send + 'static>(
        &mut self,
        work: impl FnOnce(&mut StoppedBoard<'_>) -> T + Send + 'static,
    ) -> Result<T, EmulationEnded> {
        let (answer, answered) = channel();
        self.send(Command::Do(Box::new(move |stopped| {
            let _ = answer.send(work(stopped));
        })))?;
        answered.recv().map_err(|_| self.end())
    }

    fn wait_for_stop(&mut self) -> Result<(), EmulationEnded> {
        self.now = self.stops.recv().map_err(|_| self.end())?;
        Ok(())
    }

    /// The thread has ended: why.
    fn end(&mut self) -> EmulationEnded {
        self.commands = None;
        let reason = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Ok(()))) | None => "the firmware or the debugger ended the run".to_owned(),
            Some(Ok(Err(error))) => error,
            Some(Err(panic)) => panic
                .downcast_ref::<String>()
                .cloned()
                .or_else(|| panic.downcast_ref::<&str>().map(|&text| text.to_owned()))
                .unwrap_or_else(|| "a model of the board panicked".to_owned()),
        };
        self.ended.insert(EmulationEnded(reason)).clone()
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let handle = self.handle.get_mut();
        let handle = handle.unwrap_or_else(PoisonError::into_inner);
        handle.commands = None;
        handle.interrupt.store(true, Ordering::Relaxed);
        if let Some(thread) = handle.thread.take() {
            let _ = thread.join();
        }
    }
}
