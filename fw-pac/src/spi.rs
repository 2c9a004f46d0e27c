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
//! [`due`] counts it. The newer one says what the Pi wants now.
//!
//! # Sending
//!
//! Four buffers, of which exactly one is *armed* (the DMA may read it), at most one is *standby*,
//! and the others are free. A reply is built in a free one, at leisure; it becomes armed or standby
//! by one store within a masked stretch, so both are always whole.
//!
//! Replies are numbered (as the robot numbers them on the wire, where the mode does). Number n is
//! armed and n + 1 stands by. The chip-select's rise ends the frame that carried n and arms n + 1 at
//! once, with the data it was built from. Then the robot, when it comes to it, reads the frame,
//! [`answer`]s with n + 1 built anew, and [`prepare`]s n + 2: the reply to the frame is what the Pi
//! waits for, so it comes first. A tick answers too, with the newest data.
//! A reply that comes too late, because a chip-select rose meanwhile and another number is armed by
//! now, is dropped.
//!
//! So the Pi reads data of the last tick at the latest if it leaves the robot time, and an older but
//! whole and not repeated reply if its next frame comes while the robot is busy with a tick. Only
//! where a second frame ends before the robot is through with the first is there no standby, and the
//! next frame carries its predecessor's reply once more; the armed reply is then *spent*, and the
//! first thing the robot does is to replace it.
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
use fw_core::units::Micros;
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
/// Room of a transmit buffer: the longest frame, in whole words.
const REPLY_ROOM: usize = MAX_FRAME.next_multiple_of(4);

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
    len: usize,
    number: u32,
}

/// Who owns which buffer.
#[derive(Clone, Copy)]
struct State {
    receiving: usize,
    ended: Option<Ended>,
    taken: Option<usize>,
    lost: u32,
    armed: Reply,
    /// The armed reply has gone out with a frame already.
    spent: bool,
    standby: Option<Reply>,
}

impl State {
    /// The number of the reply that should go out next.
    #[inline]
    fn turn(&self) -> u32 {
        self.armed.number.wrapping_add(u32::from(self.spent))
    }
}

static STATE: Mutex<UnsafeCell<State>> = Mutex::new(UnsafeCell::new(State {
    receiving: 0,
    ended: None,
    taken: None,
    lost: 0,
    armed: Reply {
        buffer: 0,
        len: 0,
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
    let armed = unsafe { write(0, build) };
    update(|state| {
        state.armed = armed;
        arm(state);
    });
}

/// A frame the robot has claimed and not read yet.
#[must_use]
pub struct Claim(Ended);

/// When the frame that [`claim`] would give ended.
#[inline]
pub fn ended(token: &CriticalSection) -> Option<Micros> {
    state(token).ended.map(|ended| ended.at)
}

/// The frame that ended last, for [`read`]; claim none before the one before has been read.
#[inline]
pub fn claim(token: &CriticalSection) -> Option<Claim> {
    let state = state(token);
    let ended = state.ended.take()?;
    state.taken = Some(ended.buffer);
    Some(Claim(ended))
}

/// Hands a claimed frame to `work`, with the number of bytes clocked, which may exceed the frame's
/// room, and the instant the chip-select rose.
#[inline]
#[allow(
    clippy::needless_pass_by_value,
    reason = "a claim is good for one reading"
)]
pub fn read<R>(claim: Claim, work: impl FnOnce(&[u8], usize, Micros) -> R) -> R {
    let Claim(ended) = claim;
    // SAFETY: claimed, so the DMA does not get it until it is given back below.
    let frame = unsafe { &*BUFFERS.frame(ended.buffer) };
    let result = work(
        frame.get(..ended.received).unwrap_or(frame),
        ended.received,
        ended.at,
    );
    update(|state| state.taken = None);
    result
}

/// The number of the reply that goes out next if the robot is in time: the armed one's, or the
/// following one's where the armed one is spent; whether it is; and how many frames were replaced
/// before the robot had them, since the last call.
pub fn due() -> (u32, bool, u32) {
    update(|state| (state.turn(), state.spent, core::mem::take(&mut state.lost)))
}

/// Builds reply `number` anew and arms it in place of the one armed. It is dropped where another
/// number's turn has come, and where a frame is under way, which carries the old one already; unless
/// that is a spent one, then it stands by.
///
/// # Safety
/// At the robot's priority alone.
#[inline]
pub unsafe fn answer(number: u32, build: impl FnOnce(&mut [u8; MAX_FRAME]) -> usize) {
    // SAFETY: the caller's promise.
    let reply = unsafe { write(number, build) };
    update(|state| {
        if state.turn() != number {
            return;
        }
        if SS.is_high() {
            if redirect(state.armed, reply) {
                state.armed = reply;
                state.spent = false;
            }
        } else if state.spent {
            state.standby = Some(reply);
        }
    });
}

/// Builds the reply after the one that is due, to be armed by the chip-select's next rise. It is
/// dropped where another number's turn has come.
///
/// # Safety
/// At the robot's priority alone.
#[inline]
pub unsafe fn prepare(number: u32, build: impl FnOnce(&mut [u8; MAX_FRAME]) -> usize) {
    // SAFETY: the caller's promise.
    let reply = unsafe { write(number, build) };
    update(|state| {
        if state.armed.number.wrapping_add(1) == number {
            state.standby = Some(reply);
        }
    });
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

/// Builds a reply in a free buffer. What is free stays so: from above the robot's priority a
/// standby may become the armed one, which frees another, and nothing else happens.
///
/// # Safety
/// At the robot's priority (or by boot) alone: one reply is under construction at a time.
#[inline]
unsafe fn write(number: u32, build: impl FnOnce(&mut [u8; MAX_FRAME]) -> usize) -> Reply {
    let buffer = update(|state| {
        let standby = state
            .standby
            .map_or(state.armed.buffer, |reply| reply.buffer);
        // One of 1, 2 and 3 beyond the armed one is not the standby.
        let beside = (state.armed.buffer + 1) & (REPLIES - 1);
        if beside == standby {
            (beside + 1) & (REPLIES - 1)
        } else {
            beside
        }
    });
    // SAFETY: free, and ours alone (the caller's promise); a reply's room is a frame's at least.
    let len = build(unsafe { &mut *BUFFERS.reply(buffer).cast() });
    Reply {
        buffer,
        len: len.min(MAX_FRAME),
        number,
    }
}

/// Lets the transmitting stream go on in `fresh` if nothing it has sent so far says otherwise;
/// masked. Whether it did.
fn redirect(armed: Reply, fresh: Reply) -> bool {
    Transmit::stop();
    let sent = armed.len.saturating_sub(usize::from(Transmit::remaining()));
    // SAFETY: masked and the stream is stopped, so nobody writes either buffer; within their room.
    let same = unsafe {
        let (old, new) = (BUFFERS.reply(armed.buffer), BUFFERS.reply(fresh.buffer));
        (0..sent.min(MAX_FRAME)).all(|at| old.add(at).read() == new.add(at).read())
    };
    transmit(if same { fresh } else { armed }, sent);
    same
}

/// Starts the transmitting stream at byte `from` of a reply.
#[inline]
fn transmit(reply: Reply, from: usize) {
    let Some(count) = reply.len.checked_sub(from).filter(|count| *count > 0) else {
        return;
    };
    // SAFETY: `from` + `count` is the reply's length, within its static buffer, which stays
    // unwritten while it is the armed one.
    unsafe {
        Transmit::start(
            registers().dr().as_ptr() as u32,
            BUFFERS.reply(reply.buffer).add(from) as u32,
            count as u16,
            control::channel(3) | control::WRITE | control::VERY_HIGH,
        );
    }
}

/// Resets the peripheral and arms both directions, in the order of RM0383, 20.3.9; masked or at the
/// highest priority, with both streams stopped.
#[inline]
fn arm(state: &State) {
    // SAFETY: after boot nobody but this function writes RCC, and it never interrupts itself.
    let rcc = unsafe { &*pac::RCC::ptr() };
    rcc.apb2rstr().modify(|_, w| w.spi1rst().set_bit());
    rcc.apb2rstr().modify(|_, w| w.spi1rst().clear_bit());
    let spi = registers();
    spi.cr2().write(|w| w.rxdmaen().set_bit());
    // SAFETY: the receiving buffer is static, ROOM long, and nobody else's until the stream is
    // stopped by `frame_end`.
    unsafe {
        Receive::start(
            spi.dr().as_ptr() as u32,
            BUFFERS.frame(state.receiving) as u32,
            ROOM as u16,
            control::channel(3) | control::READ | control::VERY_HIGH,
        );
    }
    transmit(state.armed, 0);
    spi.cr2().write(|w| {
        w.rxdmaen().set_bit();
        w.txdmaen().set_bit()
    });
    // Slave, mode 0, 8 bits, MSB first, NSS by hardware: all zeros but the enable.
    spi.cr1().write(|w| w.spe().set_bit());
}

/// The chip-select rose.
#[inline]
fn frame_end(at: Micros) {
    Receive::stop();
    Transmit::stop();
    let received = ROOM.saturating_sub(usize::from(Receive::remaining()));
    update(|state| {
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
    });
}

#[interrupt]
fn EXTI4() {
    let at = time::now();
    exti::clear(4);
    frame_end(at);
    exti::wake_robot();
}
