//! SPI1, the Pi's slave: whole frames in, whole frames out, whatever the wire does.
//!
//! # One frame per chip-select
//!
//! Both directions run by DMA while the chip-select is low; nothing of a frame needs the processor.
//! The chip-select's rise ([`frame_end`], the highest priority there is) stops both streams, reads
//! how many bytes came, resets the peripheral, swaps the buffers and starts both streams again. The
//! reset costs a few cycles and makes every frame begin at bit 0 of byte 0: partial bits of a torn
//! frame, an overrun, a byte the transmitter held ready, all of it is gone. From the edge to the
//! last store of `arm` pass some 2 µs; the next frame may begin after 20.
//!
//! # Receiving
//!
//! Two buffers, longer than the longest frame so that a long frame is seen to be long. One is
//! armed, the other holds the frame that ended last until the robot's priority copies it out, in one
//! masked stretch ([`take`]). A frame that ends before its predecessor was copied out replaces it,
//! and [`take_lost`] counts the predecessor: the newer one says what the Pi wants now.
//!
//! # Sending
//!
//! Three buffers, always whole, of which exactly one is *armed* (the DMA may read it), at most one
//! is *standby*, and at least one is free. A buffer is written only while it is neither armed nor
//! standby, and names itself standby or armed by one store within a masked stretch.
//!
//! - The chip-select's rise arms the standby, if there is one; else the armed one once more.
//! - The robot builds a reply and [`offer`]s it. With the chip-select high it replaces the armed one
//!   there and then; with it low, a frame is under way and the reply becomes the standby, armed by
//!   the rise that ends that frame.
//!
//! Replacing the armed reply is safe without knowing when the Pi will pull the chip-select: the
//! stream is stopped, and its count tells how many bytes the transmitter has already taken out of
//! the armed buffer (one: the byte it holds ready; more if a frame has just begun). Only if those
//! bytes are the same in the new reply does the stream go on in the new one, after them; otherwise
//! it goes on in the old one where it was. Either way the Pi reads one whole reply. All replies of a
//! configuration begin with the same key, so the comparison fails only if the chip-select fell in
//! the last fraction of a microsecond. The pause itself is some 40 cycles, less than half of a byte
//! at 8 MHz, and the transmitter holds a byte ready meanwhile.

use crate::board::{MISO, MOSI, SCK, SS};
use crate::dma::{control, Stream};
use crate::gpio::{Driver, Pull};
use crate::{exti, time};
use core::cell::{Cell, UnsafeCell};
use cortex_m::interrupt::{free, CriticalSection, Mutex};
use fw_core::units::Micros;
use fw_core::wire::MAX_FRAME;
use stm32f4::stm32f411 as pac;
use stm32f4::stm32f411::interrupt;

type Receive = Stream<2, 0>;
type Transmit = Stream<2, 3>;

/// Room of a receive buffer, bytes: more than twice the longest frame.
const ROOM: usize = 64;
/// Transmit buffers; the fourth keeps the index a mask.
const REPLIES: usize = 4;

/// A frame as it came in.
pub struct Frame {
    /// Its first bytes, as many as came.
    pub bytes: [u8; MAX_FRAME],
    /// How many bytes were clocked; may exceed `bytes`.
    pub received: usize,
    /// When the chip-select rose.
    pub at: Micros,
}

/// A frame that ended and awaits the robot.
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
}

/// Who owns which buffer.
#[derive(Clone, Copy)]
struct State {
    /// The receive buffer under the DMA, 0 or 1.
    receiving: usize,
    ended: Option<Ended>,
    lost: u32,
    armed: Reply,
    standby: Option<Reply>,
}

static STATE: Mutex<Cell<State>> = Mutex::new(Cell::new(State {
    receiving: 0,
    ended: None,
    lost: 0,
    armed: Reply { buffer: 0, len: 0 },
    standby: None,
}));

struct Buffers {
    frames: UnsafeCell<[[u8; ROOM]; 2]>,
    replies: UnsafeCell<[[u8; MAX_FRAME]; REPLIES]>,
}

// SAFETY: `State` says which buffer the DMA has; the program touches the others only, and only
// masked, so no two contexts ever touch one at a time.
unsafe impl Sync for Buffers {}

static BUFFERS: Buffers = Buffers {
    frames: UnsafeCell::new([[0; ROOM]; 2]),
    replies: UnsafeCell::new([[0; MAX_FRAME]; REPLIES]),
};

impl Buffers {
    fn frame(&self, index: usize) -> *mut u8 {
        // SAFETY: the mask keeps the offset within the two frames.
        unsafe { self.frames.get().cast::<u8>().add((index & 1) * ROOM) }
    }

    fn reply(&self, index: usize) -> *mut u8 {
        // SAFETY: the mask keeps the offset within the four replies.
        unsafe {
            self.replies
                .get()
                .cast::<u8>()
                .add((index & (REPLIES - 1)) * MAX_FRAME)
        }
    }
}

fn registers() -> &'static pac::spi1::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; `arm` is their
    // one user, at boot and from the frame's end.
    unsafe { &*pac::SPI1::ptr() }
}

/// Hands the pins to SPI1 and arms the first reply.
pub fn start(reply: &[u8; MAX_FRAME], len: usize) {
    SS.alternate(5, Driver::PushPull, Pull::Up);
    SCK.alternate(5, Driver::PushPull, Pull::None);
    MOSI.alternate(5, Driver::PushPull, Pull::None);
    MISO.alternate(5, Driver::PushPull, Pull::None);
    MISO.fast();
    free(|token| {
        let cell = STATE.borrow(token);
        let mut state = cell.get();
        // SAFETY: masked, and nothing is armed yet.
        state.armed = unsafe { store(0, reply, len) };
        cell.set(state);
        arm(&state);
    });
}

/// The frame that ended last, if the robot has not had it yet.
pub fn take() -> Option<Frame> {
    free(|token| {
        let cell = STATE.borrow(token);
        let mut state = cell.get();
        let ended = state.ended.take()?;
        cell.set(state);
        let mut bytes = [0; MAX_FRAME];
        // SAFETY: masked; the buffer is not the receiving one, so the DMA does not have it. Frames
        // are longer than MAX_FRAME's bytes.
        unsafe {
            BUFFERS
                .frame(ended.buffer)
                .copy_to_nonoverlapping(bytes.as_mut_ptr(), MAX_FRAME);
        }
        Some(Frame {
            bytes,
            received: ended.received,
            at: ended.at,
        })
    })
}

/// When the frame that [`take`] would give ended.
pub fn ended(token: &CriticalSection) -> Option<Micros> {
    STATE.borrow(token).get().ended.map(|ended| ended.at)
}

/// Frames replaced before the robot had them, since the last call.
pub fn take_lost() -> u32 {
    free(|token| {
        let cell = STATE.borrow(token);
        let mut state = cell.get();
        let lost = core::mem::take(&mut state.lost);
        if lost != 0 {
            cell.set(state);
        }
        lost
    })
}

/// Makes `reply` what the Pi reads next, or, if a frame is under way, after that one.
pub fn offer(reply: &[u8; MAX_FRAME], len: usize) {
    free(|token| {
        let cell = STATE.borrow(token);
        let mut state = cell.get();
        let standby = state.standby.map(|standby| standby.buffer);
        let used = |index: &usize| *index != state.armed.buffer && Some(*index) != standby;
        // One armed and one standby of four leave two.
        let Some(buffer) = (0..REPLIES).find(used) else {
            return;
        };
        // SAFETY: masked; the buffer is neither armed nor standby.
        let fresh = unsafe { store(buffer, reply, len) };
        if SS.is_high() && redirect(state.armed, fresh) {
            state.armed = fresh;
            state.standby = None;
        } else {
            state.standby = Some(fresh);
        }
        cell.set(state);
    });
}

/// Copies a reply into its buffer.
///
/// # Safety
/// The buffer must be neither armed nor standby, and interrupts masked.
unsafe fn store(buffer: usize, reply: &[u8; MAX_FRAME], len: usize) -> Reply {
    // SAFETY: within the buffer by type; nobody else touches it (the caller's promise).
    unsafe {
        reply
            .as_ptr()
            .copy_to_nonoverlapping(BUFFERS.reply(buffer), MAX_FRAME);
    }
    Reply {
        buffer,
        len: len.min(MAX_FRAME),
    }
}

/// Lets the transmitting stream go on in `fresh` if nothing it has sent so far says otherwise;
/// masked. Whether it did.
fn redirect(armed: Reply, fresh: Reply) -> bool {
    Transmit::stop();
    let sent = armed.len.saturating_sub(usize::from(Transmit::remaining()));
    // SAFETY: masked and the stream is stopped, so nobody writes either buffer.
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
    free(|token| {
        let cell = STATE.borrow(token);
        let mut state = cell.get();
        if let Some(standby) = state.standby.take() {
            state.armed = standby;
        }
        if state.ended.is_some() {
            state.lost = state.lost.saturating_add(1);
        }
        state.ended = Some(Ended {
            buffer: state.receiving,
            received,
            at,
        });
        state.receiving ^= 1;
        cell.set(state);
        arm(&state);
    });
}

#[interrupt]
fn EXTI4() {
    let at = time::now();
    exti::clear(4);
    frame_end(at);
    exti::wake_robot();
}
