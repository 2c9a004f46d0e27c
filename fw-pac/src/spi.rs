//! SPI1, the Pi's slave: whole frames in, whole frames out, whatever the wire does.
//!
//! # One frame per chip-select
//!
//! Both directions run by DMA while the chip-select is low; nothing of a frame needs the processor.
//! The chip-select's rise ([`frame_end`], the highest priority there is) stops both streams, reads
//! how many bytes came, resets the peripheral, changes the buffers and starts both streams again.
//! The reset costs a few cycles and makes every frame begin at bit 0 of byte 0: partial bits of a
//! torn frame, an overrun, a byte the transmitter held ready, all of it is gone. From the edge to
//! the last store of [`arm`] pass some 2 µs; the next frame may begin after 20.
//!
//! # Receiving
//!
//! Three buffers, longer than the longest frame so that a long frame is seen to be long. At any
//! time at most one is *taken* (the robot reads it in place), at most one has *ended* (its frame
//! awaits the robot) and one is *receiving* (the DMA has it). These are never the same one, and
//! three are enough: a frame that ends while another still awaits the robot replaces that one, and
//! [`Claim::lost`] counts it. The newer one says what the Pi wants now.
//!
//! # Sending
//!
//! Four buffers, of which exactly one is *armed* (the DMA may read it), at most one is *standby*,
//! and the others are free. A reply is built in a free one, at leisure; it becomes armed or standby
//! by one store within a masked stretch, so both are always whole.
//!
//! Replies are numbered (as the robot numbers them on the wire, where the mode does). The
//! chip-select's rise ends the frame that carried n, the armed one: it is *spent*, and n + 1 is due.
//! The robot reads the frame and [`offer`]s n + 1, which is armed in place of n some microseconds
//! later: one reply is built for a frame, and it knows that frame.
//!
//! Only a tick keeps the robot from a frame for longer than the 20 µs until the next one may begin.
//! Before its work it therefore offers n + 1 in advance while n is armed and not spent: that one
//! stands by. If a frame ends during the tick, n + 1 is armed at once, with the data it was built
//! from. After its work the tick offers the reply that is due anew, with the newest data.
//! A reply that comes too late, because a chip-select rose meanwhile and another number is due by
//! now, is dropped.
//!
//! So the Pi reads data of the last tick, or of the one before it if its frames came before and
//! during a tick. Only where a second frame ends before the robot is through with the first is there
//! no standby, and the next frame carries its predecessor's reply once more.
//!
//! # Replacing the armed reply
//!
//! It is safe without knowing when the Pi will pull the chip-select. The stream is stopped, and its
//! count tells how many bytes the transmitter has already taken out of the armed buffer: one, the
//! byte it holds ready, or more if a frame has just begun. Only if those bytes are the same in the
//! new reply does the stream go on in the new one, behind them; otherwise it goes on in the old one
//! where it was. Either way the Pi reads one whole reply. All replies of a configuration begin with
//! the same key, so they differ only if the chip-select fell within the last fraction of a
//! microsecond. The pause is some 60 cycles, half a byte at 8 MHz, and the transmitter holds a byte
//! ready meanwhile; with the chip-select low on entry there is no attempt at all.

use crate::board::{MISO, MOSI, SCK, SS};
use crate::dma::{control, Stream};
use crate::gpio::{Driver, Pull};
use crate::{exti, time};
use core::cell::UnsafeCell;
use cortex_m::interrupt::{free, CriticalSection, Mutex};
use fw_core::types::Micros;
use fw_core::wire::MAX_FRAME;
use stm32f4::stm32f411 as pac;
use stm32f4::stm32f411::interrupt;

type Receive = Stream<2, 0>;
type Transmit = Stream<2, 3>;

/// Room of a receive buffer, bytes: more than twice the longest frame.
const ROOM: usize = 64;
/// Receive buffers.
const FRAMES: usize = 3;
/// Transmit buffers; a power of two keeps the index a mask.
const REPLIES: usize = 4;
/// Room of a transmit buffer: the longest frame, and a power of two for the index, too.
const REPLY_ROOM: usize = MAX_FRAME.next_power_of_two();

/// A frame that ended.
#[derive(Clone, Copy)]
struct Ended {
    buffer: usize,
    received: usize,
    at: Micros,
}

/// A reply in its buffer.
#[derive(Clone, Copy)]
struct Reply {
    buffer: usize,
    number: u32,
}

/// Who owns which buffer.
#[derive(Clone, Copy)]
struct State {
    receiving: usize,
    ended: Option<Ended>,
    taken: Option<usize>,
    lost: u32,
    /// Bytes of every reply.
    len: usize,
    armed: Reply,
    /// The armed reply has gone out with a frame already.
    spent: bool,
    standby: Option<Reply>,
}

impl State {
    /// The number of the reply that should go out next.
    #[inline]
    fn due(&self) -> u32 {
        self.armed.number.wrapping_add(u32::from(self.spent))
    }

    /// A buffer that is neither armed nor standby. It stays so: from above the robot's priority a
    /// standby may become the armed one, which frees another, and nothing else happens.
    #[inline]
    fn vacant(&self) -> usize {
        let standby = self.standby.map_or(self.armed.buffer, |reply| reply.buffer);
        // One of 1 and 2 beyond the armed one is not the standby.
        let beside = (self.armed.buffer + 1) & (REPLIES - 1);
        if beside == standby {
            (beside + 1) & (REPLIES - 1)
        } else {
            beside
        }
    }

    #[inline]
    fn vacancy(&self) -> Vacancy {
        Vacancy {
            buffer: self.vacant(),
            due: self.due(),
            spent: self.spent,
        }
    }
}

/// A free buffer for a reply, and which reply is due.
///
/// There is one at a time: it is taken at the robot's priority and given back by [`offer`].
#[must_use]
pub struct Vacancy {
    buffer: usize,
    /// The number of the reply that goes out next if the robot is in time.
    pub due: u32,
    /// The armed reply has gone out already: nothing but the due one is of use.
    pub spent: bool,
}

impl Vacancy {
    /// The buffer.
    #[inline]
    pub fn buffer(&mut self) -> &mut [u8; MAX_FRAME] {
        // SAFETY: free, and whoever has the vacancy has it alone; a reply's room is a frame's at
        // least.
        unsafe { &mut *BUFFERS.reply(self.buffer).cast() }
    }
}

static STATE: Mutex<UnsafeCell<State>> = Mutex::new(UnsafeCell::new(State {
    receiving: 0,
    ended: None,
    taken: None,
    lost: 0,
    len: 0,
    armed: Reply {
        buffer: 0,
        number: 0,
    },
    spent: false,
    standby: None,
}));

#[repr(align(4))]
struct Buffers {
    frames: UnsafeCell<[[u8; ROOM]; FRAMES]>,
    replies: UnsafeCell<[[u8; REPLY_ROOM]; REPLIES]>,
}

// SAFETY: `State` says who has which buffer: the DMA (receiving, armed, standby), the robot's
// priority (taken, and whichever reply is free), nobody else; no two ever have the same.
unsafe impl Sync for Buffers {}

static BUFFERS: Buffers = Buffers {
    frames: UnsafeCell::new([[0; ROOM]; FRAMES]),
    replies: UnsafeCell::new([[0; REPLY_ROOM]; REPLIES]),
};

impl Buffers {
    #[inline]
    fn frame(&self, index: usize) -> *mut [u8; ROOM] {
        // SAFETY: the offset stays within the frames.
        unsafe {
            self.frames
                .get()
                .cast::<[u8; ROOM]>()
                .add(index.min(FRAMES - 1))
        }
    }

    #[inline]
    fn reply(&self, index: usize) -> *mut u8 {
        // SAFETY: the mask keeps the offset within the replies.
        unsafe {
            self.replies
                .get()
                .cast::<[u8; REPLY_ROOM]>()
                .add(index & (REPLIES - 1))
                .cast()
        }
    }
}

fn registers() -> &'static pac::spi1::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; `arm` is their
    // one user, at boot and from the frame's end.
    unsafe { &*pac::SPI1::ptr() }
}

/// Hands the pins to SPI1 and arms the first reply, number 0.
///
/// # Safety
/// Once, by boot, before the interrupts are enabled.
pub unsafe fn start(build: impl FnOnce(&mut [u8; MAX_FRAME]) -> usize) {
    SS.alternate(5, Driver::PushPull, Pull::Up);
    SCK.alternate(5, Driver::PushPull, Pull::None);
    MOSI.alternate(5, Driver::PushPull, Pull::None);
    MISO.alternate(5, Driver::PushPull, Pull::None);
    MISO.fast();
    // SAFETY: nobody else is there yet (the caller's promise).
    let len = build(unsafe { &mut *BUFFERS.reply(0).cast() });
    let data = registers().dr().as_ptr() as u32;
    // SAFETY: SPI1's data register, for good.
    unsafe {
        Receive::connect(data);
        Transmit::connect(data);
    }
    update(|state| {
        state.len = len.min(MAX_FRAME);
        arm(state);
    });
}

/// A frame the robot has claimed: it reads it, builds the answer in `reply` and [`Claim::answer`]s.
#[must_use]
pub struct Claim {
    ended: Ended,
    /// Frames that were replaced before the robot had them, since the last claim.
    pub lost: u32,
    /// For the answer.
    pub reply: Vacancy,
}

/// When the frame that [`claim`] would give ended.
#[inline]
pub fn ended(token: &CriticalSection) -> Option<Micros> {
    state(token).ended.map(|ended| ended.at)
}

/// The frame that ended last; claim none before the one before has been answered.
#[inline]
// Requirement: WIRE-spi-2
pub fn claim(token: &CriticalSection) -> Option<Claim> {
    let state = state(token);
    let ended = state.ended.take()?;
    state.taken = Some(ended.buffer);
    Some(Claim {
        ended,
        lost: core::mem::take(&mut state.lost),
        reply: state.vacancy(),
    })
}

impl Claim {
    /// The frame's bytes, and the room for its answer.
    #[inline]
    pub fn both(&mut self) -> (&[u8], &mut [u8; MAX_FRAME]) {
        // SAFETY: claimed, so the DMA does not get it until `answer` gives it back.
        let frame = unsafe { &*BUFFERS.frame(self.ended.buffer) };
        let bytes = frame.get(..self.ended.received).unwrap_or(frame);
        (bytes, self.reply.buffer())
    }

    /// The number of bytes clocked, which may exceed the frame's room.
    #[inline]
    pub fn clocked(&self) -> usize {
        self.ended.received
    }

    /// The instant the chip-select rose.
    #[inline]
    pub fn at(&self) -> Micros {
        self.ended.at
    }

    /// Gives the frame back and offers the reply, which must be the one that was due.
    #[inline]
    pub fn answer(self) {
        update(|state| {
            state.taken = None;
            give(state, self.reply.due, self.reply.buffer);
        });
    }
}

/// Room for a reply that is not the answer to a frame.
///
/// # Safety
/// At the robot's priority alone, while it has no other and no claim.
#[inline]
pub unsafe fn vacancy() -> Vacancy {
    update(|state| state.vacancy())
}

/// Offers reply `number`, built in the vacancy.
#[inline]
#[allow(
    clippy::needless_pass_by_value,
    reason = "a vacancy is good for one reply"
)]
pub fn offer(number: u32, vacancy: Vacancy) {
    update(|state| give(state, number, vacancy.buffer));
}

/// A whole reply: armed if it is due and no frame is under way; standing by if it is the one to
/// follow a reply that is armed and not spent, or due while a frame carries a spent one. Dropped
/// where its turn is over or a frame under way carries an older build of it.
#[inline]
fn give(state: &mut State, number: u32, buffer: usize) {
    let reply = Reply { buffer, number };
    if number == state.due() {
        if SS.is_high() && redirect(state.armed.buffer, buffer, state.len) {
            state.armed = reply;
            state.spent = false;
            return;
        }
        if !state.spent {
            return;
        }
    } else if state.spent || number != state.armed.number.wrapping_add(1) {
        return;
    }
    state.standby = Some(reply);
}

/// Masked, so that nobody sees half a change.
#[inline]
fn update<R>(change: impl FnOnce(&mut State) -> R) -> R {
    free(|token| change(state(token)))
}

/// Who owns which buffer, while masked.
#[inline]
#[allow(
    clippy::mut_from_ref,
    reason = "the token stands for the one masked stretch"
)]
fn state(token: &CriticalSection) -> &mut State {
    // SAFETY: masked, so there is one user; none of them calls another while it holds this.
    unsafe { &mut *STATE.borrow(token).get() }
}

/// Lets the transmitting stream go on in the fresh buffer if nothing it has sent of the armed one says
/// otherwise; masked. Whether it did.
#[inline]
fn redirect(armed: usize, fresh: usize, len: usize) -> bool {
    Transmit::stop();
    let left = usize::from(Transmit::remaining()).min(len);
    let sent = len - left;
    let (old, new) = (BUFFERS.reply(armed), BUFFERS.reply(fresh));
    // SAFETY: masked and the stream is stopped, so nobody writes either buffer; within their room.
    let same = unsafe { (0..sent).all(|at| old.add(at).read() == new.add(at).read()) };
    if left > 0 {
        let from = if same { new } else { old };
        // SAFETY: `sent` + `left` is the reply's length, within its static buffer, which stays
        // unwritten while it is the armed one; the stream was this one's before.
        unsafe { Transmit::restart(from.add(sent) as u32, left as u16, SENDING) };
    }
    same
}

/// The settings of the receiving stream.
const RECEIVING: u32 = control::channel(3) | control::READ | control::VERY_HIGH;
/// The settings of the transmitting stream.
const SENDING: u32 = control::channel(3) | control::WRITE | control::VERY_HIGH;

/// Resets the peripheral and arms both directions, in the order of RM0383, 20.3.9; masked or at the
/// highest priority, with both streams stopped.
// Requirement: DOC-2.1-5, WIRE-spi-4
#[inline]
fn arm(state: &State) {
    // SAFETY: after boot nobody but this function writes RCC, it never interrupts itself, and no other
    // peripheral of this bus is ever in reset.
    let rcc = unsafe { &*pac::RCC::ptr() };
    rcc.apb2rstr().write(|w| w.spi1rst().set_bit());
    rcc.apb2rstr().reset();
    let spi = registers();
    spi.cr2().write(|w| w.rxdmaen().set_bit());
    // SAFETY: the receiving buffer is static, ROOM long, and nobody else's until the stream is
    // stopped by `frame_end`; the armed reply stays unwritten while it is that.
    unsafe {
        Receive::restart(
            BUFFERS.frame(state.receiving) as u32,
            ROOM as u16,
            RECEIVING,
        );
        Transmit::restart(
            BUFFERS.reply(state.armed.buffer) as u32,
            state.len as u16,
            SENDING,
        );
    }
    spi.cr2().write(|w| {
        w.rxdmaen().set_bit();
        w.txdmaen().set_bit()
    });
    // Slave, mode 0, 8 bits, MSB first, NSS by hardware: all zeros but the enable.
    spi.cr1().write(|w| w.spe().set_bit());
}

/// The chip-select rose.
// Requirement: WIRE-spi-1, WIRE-spi-5
#[inline]
fn frame_end(at: Micros, alone: &CriticalSection) {
    Receive::stop();
    Transmit::stop();
    let received = ROOM.saturating_sub(usize::from(Receive::remaining()));
    let state = state(alone);
    match state.standby.take() {
        Some(standby) => {
            state.armed = standby;
            state.spent = false;
        }
        None => state.spent = true,
    }
    if state.ended.is_some() {
        state.lost = state.lost.saturating_add(1);
    }
    let buffer = state.receiving;
    state.ended = Some(Ended {
        buffer,
        received,
        at,
    });
    state.receiving = match state.taken {
        // The three are 0, 1 and 2.
        Some(taken) => (FRAMES - buffer).wrapping_sub(taken),
        None if buffer == FRAMES - 1 => 0,
        None => buffer + 1,
    };
    arm(state);
}

// Requirement: DOC-3.1-1
#[interrupt]
fn EXTI4() {
    let at = time::now();
    exti::clear(4);
    // SAFETY: nothing interrupts this priority but what ends in the safe state for good: it is as
    // good as masked.
    frame_end(at, unsafe { &CriticalSection::new() });
    exti::wake_robot();
}
