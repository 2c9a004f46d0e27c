//! The Normal frame as one writes it by hand for one mode of one board, in the manner of C: decoded
//! into a structure and the reply encoded from one, with no more checks than the link needs. It is what
//! `cargo xtask figures` holds the frame's real handling against; the released firmware has none of it.
//!
//! Beside it the core's own strategies for that frame, decoded and encoded and nothing else.

use core::cell::UnsafeCell;
use core::hint::black_box;
use core::ptr::{read_unaligned, write_unaligned};
use fw_core::wire::strategy::Context;
use fw_core::wire::{parse_whole, write_report, Command, Mode, Report, MAX_FRAME};

/// Bytes of the frame.
const LEN: u32 = 19;

/// What the Pi says.
#[repr(C)]
struct Order {
    x: u32,
    y: u32,
    rotation: u16,
    apply: u16,
    tune: u16,
    cell: u16,
}

/// What the STM says.
#[repr(C)]
struct Answer {
    x: u32,
    y: u32,
    rotation: u16,
    voltage: u16,
    ranges: [u16; 3],
    cell: u16,
    cells: u16,
    key_from_pi: u8,
    key_from_stm: u8,
}

/// Decodes `frame` into `order` and encodes `answer` into `reply`; 0 where the frame is wrong.
///
/// # Safety
/// `frame` must be readable for `len` bytes and `reply` writable for [`LEN`].
#[inline(never)]
#[export_name = "hand_frame"]
unsafe extern "C" fn frame(
    frame: *const u8,
    len: u32,
    order: &mut Order,
    answer: &Answer,
    reply: *mut u8,
) -> u32 {
    // SAFETY: the caller's promise; the length is looked at before anything else.
    unsafe {
        let four = |at| u32::from_be(read_unaligned(frame.add(at).cast()));
        let two = |at| u16::from_be(read_unaligned(frame.add(at).cast()));
        if len != LEN || *frame != answer.key_from_pi {
            return 0;
        }
        let battery = two(11);
        let cell = battery >> 13;
        if cell >= answer.cells {
            return 0;
        }
        order.x = four(1);
        order.y = four(5);
        let rotation = two(9);
        order.rotation = rotation & 0x7FFF;
        order.apply = rotation >> 15;
        order.tune = battery & 0x1FFF;
        order.cell = cell;

        *reply = answer.key_from_stm;
        let four = |at, value: u32| write_unaligned(reply.add(at).cast(), value.to_be());
        let two = |at, value: u16| write_unaligned(reply.add(at).cast(), value.to_be());
        four(1, answer.x);
        four(5, answer.y);
        two(9, answer.rotation);
        two(11, answer.cell << 13 | answer.voltage);
        two(13, answer.ranges[0]);
        two(15, answer.ranges[1]);
        two(17, answer.ranges[2]);
    }
    1
}

/// The same by the core's strategies.
#[inline(never)]
#[export_name = "codec_frame"]
fn strategies(
    frame: &[u8],
    context: &Context,
    command: &mut Command,
    report: &Report,
    reply: &mut [u8; MAX_FRAME],
) -> usize {
    let Some(decoded) = parse_whole(Mode::Normal, context, frame) else {
        return 0;
    };
    *command = decoded;
    write_report(Mode::Normal, context, report, reply)
}

/// Where the compiler cannot look through.
struct Place([UnsafeCell<u8>; LEN as usize]);

// SAFETY: the robot's priority alone touches it.
unsafe impl Sync for Place {}

static FRAME: Place = Place([const { UnsafeCell::new(0) }; LEN as usize]);

/// Both once, on a frame that is right; called by every tick.
pub fn tick() {
    let mut order = Order {
        x: 0,
        y: 0,
        rotation: 0,
        apply: 0,
        tune: 0,
        cell: 0,
    };
    let answer = Answer {
        x: 1,
        y: 2,
        rotation: 3,
        voltage: 4,
        ranges: [5, 6, 7],
        cell: 1,
        cells: 2,
        key_from_pi: 0,
        key_from_stm: 0x5A,
    };
    let mut reply = [0; MAX_FRAME];
    let input: *const u8 = black_box(FRAME.0.as_ptr().cast());
    // SAFETY: LEN bytes each, and the frame is never written.
    let good = unsafe {
        frame(
            input,
            LEN,
            &mut order,
            black_box(&answer),
            reply.as_mut_ptr(),
        )
    };
    black_box((&order, &reply, good));
    let context = Context {
        key_from_pi: 0,
        key_from_stm: 0x5A,
        cells: 2,
        own: 0,
        last: None,
    };
    // SAFETY: LEN bytes that nobody writes.
    let bytes = unsafe { core::slice::from_raw_parts(input, LEN as usize) };
    let mut command = Command::default();
    let report = Report::default();
    let len = strategies(
        bytes,
        black_box(&context),
        &mut command,
        black_box(&report),
        &mut reply,
    );
    black_box((&command, &reply, len));
}
