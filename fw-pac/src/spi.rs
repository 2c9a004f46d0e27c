//! SPI1, slave to the Pi: whole frames in, whole frames out, whatever happens on the wire.
//!
//! # One frame per chip-select
//!
//! Both directions run by DMA while the chip-select is low, without the processor. The rising edge of
//! chip-select ([`end_frame`], the highest priority) stops both streams, reads the received length, resets
//! the peripheral, changes the buffers and restarts both streams. The reset takes a few cycles and makes
//! every frame begin at bit 0 of byte 0: it drops the partial bits of a torn frame, an overrun, and the
//! byte that the transmitter held ready. From the edge to the last store of [`arm`] pass some 2 µs; the
//! next frame may begin after 20.
//!
//! # Receiving
//!
//! Three buffers, longer than the longest frame so that a long frame shows its length. At most one is
//! *taken* (the robot reads it in place), at most one has *ended* (its frame awaits the robot) and one is
//! *receiving* (the DMA's). A frame that ends while another still awaits the robot replaces that one, and
//! [`Claim::lost`] counts it.
//!
//! # Sending
//!
//! Four buffers, of which exactly one is *armed* (the DMA may read it), at most one is *standby*, and the
//! others are free. A reply is built in a free one; one store within a masked stretch makes it armed or
//! standby, so both are always whole.
//!
//! Replies are numbered. The rising edge of chip-select ends the frame that carried reply n, the armed
//! one: it is *transmitted*, and n + 1 is due. The robot reads the frame and submits n + 1, which replaces
//! n as the armed one some microseconds later.
//!
//! Only a tick keeps the robot from a frame for longer than the 20 µs until the next one may begin, so it
//! first submits n + 1 in advance, as the standby. If a frame ends during the tick, the standby is armed
//! at once. After its work the tick submits the due reply anew, with the newest data. A reply that comes
//! too late, because meanwhile another number is due, is dropped.
//!
//! So the Pi reads data of the last tick, or of the one before it if its frames came before and during a
//! tick. Only where a second frame ends before the robot has handled the first is there no standby, and
//! the next frame carries its predecessor's reply once more.
//!
//! # Replacing the armed reply
//!
//! The stream is stopped, and its count tells how many bytes the transmitter has already taken: one, held
//! ready, or more if a frame has just begun. Only if those bytes are equal in both replies does the stream
//! go on in the new one; otherwise it goes on in the old one. Either way the Pi reads one whole reply. All
//! replies of a configuration begin with the same key, so they differ only if the chip-select fell within
//! the last fraction of a microsecond. The pause is some 60 cycles, half a byte at 8 MHz, and the
//! transmitter holds a byte ready meanwhile; with the chip-select low there is no attempt.

use crate::board::{MISO, MOSI, SCK, SS};
use crate::dma::{control, Stream};
use crate::gpio::{Driver, Pull};
use crate::registers::Registers;
use core::cell::UnsafeCell;
use core::marker::PhantomData;
use cortex_m::interrupt::{free, CriticalSection, Mutex};
use fw_core::types::Micros;
use fw_core::wire::MAX_FRAME;
use stm32f4::stm32f411::{RCC, SPI1};

type Receive = Stream<2, 0>;
type Transmit = Stream<2, 3>;

/// Bytes of a receive buffer: more than twice the longest frame.
const RX_LEN: usize = 64;
/// Receive buffers.
const RX_BUFFERS: usize = 3;
/// Transmit buffers; a power of two keeps the index a mask.
const TX_BUFFERS: usize = 4;
/// Bytes of a transmit buffer: the longest frame, and a power of two for the index, too.
const TX_LEN: usize = MAX_FRAME.next_power_of_two();

/// Number of the first reply: the wire counts from 1.
const FIRST_REPLY: u32 = 1;

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

/// The owner of each buffer.
#[derive(Clone, Copy)]
struct State {
    receiving: usize,
    ended: Option<Ended>,
    taken: Option<usize>,
    lost: u32,
    /// Bytes of every reply.
    len: usize,
    armed: Reply,
    /// A frame has carried the armed reply.
    transmitted: bool,
    standby: Option<Reply>,
}

impl State {
    /// The number of the reply that should go out next.
    #[inline]
    fn due(&self) -> u32 {
        self.armed.number.wrapping_add(u32::from(self.transmitted))
    }

    /// A buffer that is neither armed nor standby. It stays so: from above the robot's priority a
    /// standby may become the armed one, which frees another, and nothing else happens.
    #[inline]
    fn free_tx_buffer<'a>(&self) -> FreeTxBuffer<'a> {
        let standby = self.standby.map_or(self.armed.buffer, |reply| reply.buffer);
        // One of 1 and 2 beyond the armed one is not the standby.
        let beside = (self.armed.buffer + 1) % TX_BUFFERS;
        FreeTxBuffer {
            buffer: if beside == standby {
                (beside + 1) % TX_BUFFERS
            } else {
                beside
            },
            due: self.due(),
            transmitted: self.transmitted,
            slave: PhantomData,
        }
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
    transmitted: false,
    standby: None,
}));

/// Changes the state; masked, so that no handler sees half a change.
#[inline]
fn update<R>(cs: &CriticalSection, change: impl FnOnce(&mut State) -> R) -> R {
    // SAFETY: masked, so there is one change at a time; no change begins another.
    change(unsafe { &mut *STATE.borrow(cs).get() })
}

/// Buffers that the DMA and the program use in turn, as [`State`] says.
#[repr(align(4))]
struct Buffers<const COUNT: usize, const LEN: usize>(UnsafeCell<[[u8; LEN]; COUNT]>);

// SAFETY: `State` gives each buffer one owner: the DMA (receiving, armed), nobody (ended, standby), or the
// robot's priority (taken, and the one free buffer that is in use).
unsafe impl<const COUNT: usize, const LEN: usize> Sync for Buffers<COUNT, LEN> {}

impl<const COUNT: usize, const LEN: usize> Buffers<COUNT, LEN> {
    const ZERO: Self = Self(UnsafeCell::new([[0; LEN]; COUNT]));

    /// Buffer `index`, 0 ..= `COUNT` − 1.
    #[inline]
    fn get(&self, index: usize) -> *mut [u8; LEN] {
        let first: *mut [u8; LEN] = self.0.get().cast();
        first.wrapping_add(index)
    }
}

static RX: Buffers<RX_BUFFERS, RX_LEN> = Buffers::ZERO;
static TX: Buffers<TX_BUFFERS, TX_LEN> = Buffers::ZERO;

/// A reply's bytes in its buffer.
#[inline]
fn reply(buffer: usize, len: usize) -> &'static [u8] {
    // SAFETY: armed or free, and the caller does not write it at the same time.
    let bytes = unsafe { &*TX.get(buffer) };
    bytes.get(..len).unwrap_or(bytes)
}

/// A free buffer for a reply, and which reply is due. There is one at a time: it borrows the slave.
#[must_use]
pub struct FreeTxBuffer<'a> {
    buffer: usize,
    /// The number of the reply that goes out next if the robot is in time.
    pub due: u32,
    /// A frame has carried the armed reply: only the due one is of use.
    pub transmitted: bool,
    slave: PhantomData<&'a mut SpiSlave>,
}

impl FreeTxBuffer<'_> {
    /// The buffer's bytes.
    #[inline]
    pub fn bytes(&mut self) -> &mut [u8; MAX_FRAME] {
        // SAFETY: free, and this value is the only one of its kind; `TX_LEN` is at least a frame's.
        unsafe { &mut *TX.get(self.buffer).cast() }
    }

    /// Submits the buffer's bytes as reply `number`.
    #[inline]
    pub fn submit(self, number: u32) {
        free(|cs| update(cs, |state| submit(state, number, self.buffer)));
    }
}

/// A frame that the robot has taken: it reads it, builds the reply in `reply` and [`Claim::answer`]s.
#[must_use]
pub struct Claim<'a> {
    ended: Ended,
    /// Frames that were replaced before the robot took them, since the last claim.
    pub lost: u32,
    /// For the reply.
    pub reply: FreeTxBuffer<'a>,
}

impl Claim<'_> {
    /// The frame's bytes, and the buffer for its reply.
    #[inline]
    pub fn buffers(&mut self) -> (&[u8], &mut [u8; MAX_FRAME]) {
        // SAFETY: taken, so the DMA does not get it until `answer` returns it.
        let frame = unsafe { &*RX.get(self.ended.buffer) };
        (
            frame.get(..self.clocked()).unwrap_or(frame),
            self.reply.bytes(),
        )
    }

    /// The number of bytes clocked, at most a receive buffer's.
    #[inline]
    pub fn clocked(&self) -> usize {
        self.ended.received
    }

    /// The instant of the rising edge of chip-select.
    #[inline]
    pub fn at(&self) -> Micros {
        self.ended.at
    }

    /// Returns the frame's buffer and submits the reply, which is the due one.
    #[inline]
    pub fn answer(self) {
        free(|cs| {
            update(cs, |state| {
                state.taken = None;
                submit(state, self.reply.due, self.reply.buffer);
            });
        });
    }
}

/// The robot's end of the link. Its one value is the right to claim frames and to build replies.
pub struct SpiSlave(());

impl SpiSlave {
    /// The slave, once: there is one SPI1.
    pub fn new(_: SPI1) -> Self {
        Self(())
    }

    /// Connects the pins and arms the first reply, which `build` writes; boot's, with interrupts masked.
    pub fn start(&mut self, build: impl FnOnce(u32, &mut [u8; MAX_FRAME]) -> usize) {
        SS.alternate(5, Driver::PushPull, Pull::PullUp);
        SCK.alternate(5, Driver::PushPull, Pull::Floating);
        MOSI.alternate(5, Driver::PushPull, Pull::Floating);
        MISO.alternate(5, Driver::PushPull, Pull::Floating);
        MISO.fast();
        let data = SPI1::registers().dr().as_ptr();
        Receive::connect(data);
        Transmit::connect(data);
        let mut first = self.free_tx_buffer();
        let len = build(FIRST_REPLY, first.bytes());
        let buffer = first.buffer;
        free(|cs| {
            update(cs, |state| {
                state.len = len.min(MAX_FRAME);
                state.armed = Reply {
                    buffer,
                    number: FIRST_REPLY,
                };
                arm(state);
            });
        });
    }

    /// When the frame that [`Self::claim`] would return ended.
    #[inline]
    pub fn ended_at(&self, cs: &CriticalSection) -> Option<Micros> {
        update(cs, |state| state.ended.map(|ended| ended.at))
    }

    /// The frame that ended last.
    #[inline]
    // Requirement: WIRE-spi-2
    pub fn claim(&mut self, cs: &CriticalSection) -> Option<Claim<'_>> {
        update(cs, |state| {
            let ended = state.ended.take()?;
            state.taken = Some(ended.buffer);
            Some(Claim {
                ended,
                lost: core::mem::take(&mut state.lost),
                reply: state.free_tx_buffer(),
            })
        })
    }

    /// A buffer for a reply that is not the answer to a claimed frame.
    #[inline]
    pub fn free_tx_buffer(&mut self) -> FreeTxBuffer<'_> {
        free(|cs| update(cs, |state| state.free_tx_buffer()))
    }
}

/// Takes a whole reply: armed if it is due and no frame is under way; standby if it is the one after an
/// armed reply that has not been transmitted, or due while a frame carries a transmitted one. Dropped
/// where its turn is over or a frame under way carries an older version of it.
#[inline]
fn submit(state: &mut State, number: u32, buffer: usize) {
    let fresh = Reply { buffer, number };
    if number == state.due() {
        if SS.is_high() && swap_tx_buffer(state.armed.buffer, buffer, state.len) {
            state.armed = fresh;
            state.transmitted = false;
            return;
        }
        if !state.transmitted {
            return;
        }
    } else if state.transmitted || number != state.armed.number.wrapping_add(1) {
        return;
    }
    state.standby = Some(fresh);
}

/// Lets the transmitting stream go on in the fresh buffer if the bytes it has taken of the armed one are
/// the same in both; masked. Whether it did.
#[inline]
fn swap_tx_buffer(armed: usize, fresh: usize, len: usize) -> bool {
    Transmit::stop();
    let remaining = usize::from(Transmit::remaining()).min(len);
    let (old, new) = (reply(armed, len), reply(fresh, len));
    let (old_taken, old_rest) = old.split_at(old.len() - remaining);
    let (new_taken, new_rest) = new.split_at(new.len() - remaining);
    let same = old_taken.iter().zip(new_taken).all(|(old, new)| old == new);
    if remaining > 0 {
        Transmit::send(if same { new_rest } else { old_rest }, SENDING);
    }
    same
}

const RECEIVING: u32 = control::channel(3) | control::VERY_HIGH;
const SENDING: u32 = control::channel(3) | control::VERY_HIGH;

/// Resets the peripheral and starts both directions, in the order of RM0383, 20.3.9; masked or at the
/// highest priority, with both streams stopped.
// Requirement: DOC-2.1-5, WIRE-spi-4
#[inline]
fn arm(state: &State) {
    // After boot only this function writes RCC, and no other peripheral of this bus is ever in reset.
    let rcc = RCC::registers();
    rcc.apb2rstr().write(|w| w.spi1rst().set_bit());
    rcc.apb2rstr().reset();
    let spi = SPI1::registers();
    spi.cr2().write(|w| w.rxdmaen().set_bit());
    // SAFETY: the receiving buffer is the DMA's until `end_frame` has stopped the stream.
    unsafe { Receive::receive(RX.get(state.receiving), RX_LEN as u16, RECEIVING) };
    Transmit::send(reply(state.armed.buffer, state.len), SENDING);
    spi.cr2().write(|w| {
        w.rxdmaen().set_bit();
        w.txdmaen().set_bit()
    });
    // Slave, mode 0, 8 bits, MSB first, NSS by hardware: all zeros but the enable.
    spi.cr1().write(|w| w.spe().set_bit());
}

/// Ends a frame at the rising edge of chip-select.
// Requirement: WIRE-spi-1, WIRE-spi-5
#[inline]
pub fn end_frame(at: Micros, cs: &CriticalSection) {
    Receive::stop();
    Transmit::stop();
    let received = RX_LEN.saturating_sub(Receive::remaining().into());
    update(cs, |state| {
        match state.standby.take() {
            Some(standby) => {
                state.armed = standby;
                state.transmitted = false;
            }
            None => state.transmitted = true,
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
            Some(taken) => (RX_BUFFERS - buffer).wrapping_sub(taken),
            None if buffer == RX_BUFFERS - 1 => 0,
            None => buffer + 1,
        };
        arm(state);
    });
}
