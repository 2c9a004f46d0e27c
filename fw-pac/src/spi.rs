//! SPI1, slave to the Pi: whole frames in, whole frames out, whatever happens on the wire.
//!
//! Both directions run by DMA while the chip-select is low, without the processor. The rising edge of
//! chip-select ([`end_frame`]) stops both streams, reads the received length and arms
//! the next buffers. Arming resets the peripheral, so every frame begins at bit 0 of byte 0: partial bits of
//! a torn frame, an overrun and the byte that the transmitter held ready are dropped. From the edge to the
//! last store of [`arm`] pass some 2 µs; the next frame may begin after 20.
//!
//! Which buffer is whose is decided by [`Handover`], which also says when the armed reply may be replaced.

use crate::board::{MISO, MOSI, SCK, SS};
use crate::dma::{Stream, control};
use crate::gpio::{Driver, Pull};
use crate::priority::{FrameEnd, Owned};
use crate::registers::Registers;
use crate::time;
use core::cell::UnsafeCell;
use core::marker::PhantomData;
use cortex_m::interrupt::free;
use fw_core::types::Micros;
use fw_core::wire::MAX_FRAME;
use fw_core::wire::handover::{
    ClaimedFrame, DmaBuffers, GAP_US, Handover, RX_BUFFERS, Reply, SAME_PREFIX, TX_BUFFERS,
    begin_alike,
};
use stm32f4::stm32f411::{RCC, SPI1};

type Receive = Stream<2, 0>;
type Transmit = Stream<2, 3>;

/// Bytes of a receive buffer: more than twice the longest frame, so that a long frame shows its length.
const RX_LEN: usize = 64;
/// Bytes of a transmit buffer: the longest frame, and a power of two for the index.
const TX_LEN: usize = MAX_FRAME.next_power_of_two();

/// Bytes that the idle transmitter may hold ready: two in the SPI, and the DMA's own where its counter
/// includes it.
const IDLE_FETCH: usize = 3;

/// Number of the first reply: the wire counts from 1.
const FIRST_REPLY: u32 = 1;

/// The owners of the buffers, and the length of every reply in bytes.
struct State {
    handover: Handover,
    len: usize,
}

static STATE: Owned<1, State> = Owned::new(State {
    handover: Handover::new(FIRST_REPLY),
    len: 0,
});

/// Changes the state; no frame ends meanwhile. For the values of this module that the slave lends: they
/// are the robot's, and no change begins another.
#[inline]
fn update<R>(change: impl FnOnce(&mut State) -> R) -> R {
    // SAFETY: the robot's priority or boot, as above.
    unsafe { FrameEnd::raised(|token| change(STATE.borrow(token))) }
}

/// Buffers that the DMA and the program use in turn, as [`Handover`] says.
#[repr(align(4))]
struct Buffers<const COUNT: usize, const LEN: usize>(UnsafeCell<[[u8; LEN]; COUNT]>);

// SAFETY: `Handover` gives each buffer one owner: the DMA, none, or the robot's priority (the claimed frame
// and the one free buffer that is in use).
unsafe impl<const COUNT: usize, const LEN: usize> Sync for Buffers<COUNT, LEN> {}

impl<const COUNT: usize, const LEN: usize> Buffers<COUNT, LEN> {
    const fn new() -> Self {
        Self(UnsafeCell::new([[0; LEN]; COUNT]))
    }

    /// Buffer `index`, 0 ..= `COUNT` − 1.
    #[inline]
    fn get(&self, index: u8) -> *mut [u8; LEN] {
        let first: *mut [u8; LEN] = self.0.get().cast();
        first.wrapping_add(index.into())
    }
}

static RX: Buffers<{ RX_BUFFERS as usize }, RX_LEN> = Buffers::new();
static TX: Buffers<{ TX_BUFFERS as usize }, TX_LEN> = Buffers::new();

/// A free buffer for the reply after the armed one. There is one at a time: it borrows the slave.
#[must_use]
pub struct FreeTxBuffer<'a> {
    reply: Reply,
    slave: PhantomData<&'a mut SpiSlave>,
}

impl FreeTxBuffer<'_> {
    /// The number of the reply to build.
    #[inline]
    pub fn number(&self) -> u32 {
        self.reply.number
    }

    /// The buffer's bytes.
    #[inline]
    pub fn bytes(&mut self) -> &mut [u8; MAX_FRAME] {
        // SAFETY: free, and this value is the only one of its kind; `TX_LEN` is at least a frame's.
        unsafe { &mut *TX.get(self.reply.buffer).cast() }
    }

    /// Submits the buffer's bytes as the standby.
    #[inline]
    pub fn submit(self) {
        update(|state| state.handover.stand_by(self.reply));
    }
}

/// A free buffer to rebuild the armed reply in, and that one's.
#[must_use]
pub struct FreshReply<'a>(FreeTxBuffer<'a>, u8);

impl FreshReply<'_> {
    /// The number of the armed reply.
    #[inline]
    pub fn number(&self) -> u32 {
        self.0.number()
    }

    /// The buffer's bytes.
    #[inline]
    pub fn bytes(&mut self) -> &mut [u8; MAX_FRAME] {
        self.0.bytes()
    }

    /// What the armed reply begins with.
    #[inline]
    pub fn begin(&self) -> [u8; SAME_PREFIX] {
        // SAFETY: a whole transmit buffer, which only [`Self::submit`] and the owner of a free one write.
        unsafe { *TX.get(self.1).cast() }
    }

    /// Copies the buffer's bytes over the armed reply, where no frame can tell: see [`SAME_PREFIX`].
    #[inline]
    pub fn submit(self) {
        update(|state| {
            let fresh = TX.get(self.0.reply.buffer);
            let armed = TX.get(state.handover.dma_buffers().transmit);
            // SAFETY: `fresh` is free and `armed` only read by the DMA; neither is written.
            let alike = unsafe { begin_alike(*fresh.cast(), *armed.cast()) };
            let Some(armed) = state.handover.refresh(self.0.reply, alike) else {
                return;
            };
            #[allow(clippy::cast_ptr_alignment, reason = "`Buffers` is aligned to words")]
            let (to, from): (*mut u32, *const u32) = (TX.get(armed).cast(), fresh.cast());
            free(|_| {
                let fetched = state.len.saturating_sub(Transmit::remaining().into());
                // The pin last: SAME_PREFIX covers what is fetched between this read and the stores.
                if fetched <= IDLE_FETCH && SS.is_high() {
                    for word in 0..TX_LEN / 4 {
                        // SAFETY: both are whole transmit buffers, and not the same one.
                        unsafe { to.add(word).write_volatile(from.add(word).read()) };
                    }
                }
            });
        });
    }
}

/// A frame that the robot has taken: it reads it, builds the answer and [`Claim::answer`]s.
#[must_use]
pub struct Claim<'a> {
    claimed: ClaimedFrame,
    slave: PhantomData<&'a mut SpiSlave>,
}

impl Claim<'_> {
    /// The frame's bytes, and the buffer for its answer.
    #[inline]
    pub fn buffers(&mut self) -> (&[u8], &mut [u8; MAX_FRAME]) {
        // SAFETY: claimed, so the DMA does not get it until `answer` returns it; the answer's buffer is
        // free, and this value is its only user.
        let (frame, answer) = unsafe {
            (
                &*RX.get(self.claimed.frame.buffer),
                &mut *TX.get(self.claimed.answer.buffer).cast(),
            )
        };
        let clocked = usize::from(self.claimed.frame.clocked).min(RX_LEN);
        (frame.get(..clocked).unwrap_or(frame), answer)
    }

    /// The number of the answer.
    #[inline]
    pub fn number(&self) -> u32 {
        self.claimed.answer.number
    }

    /// The instant of the rising edge of chip-select.
    #[inline]
    pub fn at(&self) -> Micros {
        self.claimed.frame.at
    }

    /// Frames that were replaced before the robot took them, since the last claim.
    #[inline]
    pub fn lost(&self) -> u32 {
        self.claimed.lost
    }

    /// Returns the frame's buffer and submits the answer. Its own symbol, for the same reason as
    /// `robot_frame`.
    #[inline(never)]
    #[unsafe(export_name = "robot_answer")]
    pub fn answer(self) {
        update(|state| {
            // A chip-select that fell within the gap: its frame goes on undisturbed.
            let now = if SS.is_high() {
                time::now()
            } else {
                self.at().after(GAP_US)
            };
            if let Some(dma) = state.handover.answer(self.claimed.answer, now) {
                Receive::stop();
                Transmit::stop();
                arm(dma, state.len);
            }
        });
    }
}

/// The robot's end of the link. Its one value is the right to claim frames and to build replies.
pub struct SpiSlave(());

#[allow(clippy::unused_self, reason = "the value is the right")]
impl SpiSlave {
    /// The slave, once: there is one SPI1.
    pub fn new(_: SPI1) -> Self {
        Self(())
    }

    /// Connects the pins and arms the first reply, which `build` writes like the standby after it; boot's,
    /// with interrupts masked.
    pub fn start(&mut self, mut build: impl FnMut(u32, &mut [u8; MAX_FRAME]) -> usize) {
        SS.alternate(5, Driver::PushPull, Pull::PullUp);
        SCK.alternate(5, Driver::PushPull, Pull::Floating);
        MOSI.alternate(5, Driver::PushPull, Pull::Floating);
        MISO.alternate(5, Driver::PushPull, Pull::Floating);
        MISO.fast();
        let data = SPI1::registers().dr().as_ptr();
        Receive::connect(data);
        Transmit::connect(data);
        let dma = update(|state| state.handover.dma_buffers());
        // SAFETY: interrupts are masked and the DMA stands; `TX_LEN` is at least a frame's.
        let len = build(FIRST_REPLY, unsafe { &mut *TX.get(dma.transmit).cast() });
        let mut standby = self.free_tx_buffer();
        build(standby.number(), standby.bytes());
        standby.submit();
        update(|state| {
            state.len = len.min(MAX_FRAME);
            arm(dma, state.len);
        });
    }

    /// When the frame that [`Self::claim`] would return ended.
    #[inline]
    pub fn ended_at(&self, token: &mut FrameEnd) -> Option<Micros> {
        STATE.borrow(token).handover.ended_at()
    }

    /// The frame that ended last.
    #[inline]
    // Requirement: WIRE-spi-2
    pub fn claim(&mut self, token: &mut FrameEnd) -> Option<Claim<'_>> {
        let claimed = STATE.borrow(token).handover.claim()?;
        Some(Claim {
            claimed,
            slave: PhantomData,
        })
    }

    /// A buffer for the armed reply, unless a frame has carried it.
    #[inline]
    pub fn fresh_reply(&mut self) -> Option<FreshReply<'_>> {
        let (reply, armed) = update(|state| {
            let armed = state.handover.dma_buffers().transmit;
            state.handover.fresh_reply().map(|reply| (reply, armed))
        })?;
        let slave = PhantomData;
        Some(FreshReply(FreeTxBuffer { reply, slave }, armed))
    }

    /// Bytes of the armed reply that the transmitter holds ready, where no frame is under way: for bring-up.
    #[allow(dead_code, reason = "bring-up alone")]
    pub fn prefetched(&self) -> Option<u32> {
        let fetched = update(|state| state.len.saturating_sub(Transmit::remaining().into()));
        SS.is_high().then_some(fetched as u32)
    }

    /// A buffer for the reply after the armed one.
    #[inline]
    pub fn free_tx_buffer(&mut self) -> FreeTxBuffer<'_> {
        FreeTxBuffer {
            reply: update(|state| state.handover.next_reply()),
            slave: PhantomData,
        }
    }
}

const STREAM: u32 = control::channel(3) | control::VERY_HIGH;

/// Resets the peripheral and starts both directions, in the order of RM0383, 20.3.9; with no end of
/// a frame in between and both streams stopped. `len` is a reply's.
// Requirement: DOC-2.1-5, WIRE-spi-4
#[inline(never)]
fn arm(dma: DmaBuffers, len: usize) {
    // After boot only this function writes RCC, and no other peripheral of this bus is ever in reset.
    let rcc = RCC::registers();
    rcc.apb2rstr().write(|w| w.spi1rst().set_bit());
    rcc.apb2rstr().reset();
    let spi = SPI1::registers();
    spi.cr2().write(|w| w.rxdmaen().set_bit());
    // SAFETY: the receiving buffer is the DMA's until the stream is stopped; the armed reply stays
    // unwritten until then.
    unsafe {
        Receive::receive(RX.get(dma.receive), RX_LEN as u16, STREAM);
        let reply = &*TX.get(dma.transmit);
        Transmit::send(reply.get(..len.min(TX_LEN)).unwrap_or(reply), STREAM);
    }
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
pub fn end_frame(at: Micros, token: &mut FrameEnd) {
    Receive::stop();
    Transmit::stop();
    let clocked = RX_LEN.saturating_sub(Receive::remaining().into()) as u8;
    let state = STATE.borrow(token);
    let dma = state.handover.end_frame(clocked, at);
    arm(dma, state.len);
}
