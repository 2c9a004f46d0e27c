//! A Normal frame's decoding and encoding written for one mode of one board, in the manner of C, and the
//! core's own codec for the same frame, for the core: `cargo xtask figures` compares their instructions.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("reference-codec runs on the robot's core: `cargo xtask figures` builds and runs it");
    std::process::exit(2);
}

#[cfg(target_os = "none")]
mod core_program {
    use core::hint::black_box;
    use fw_core::wire::strategy::Context;
    use fw_core::wire::{Command, MAX_FRAME, Mode, Report, parse_command, write_report};

    /// Bytes of the frame.
    const LEN: usize = 19;
    const KEY_FROM_PI: u8 = 0x96;
    const KEY_FROM_STM: u8 = 0x5A;

    /// The Pi's values.
    #[derive(Default)]
    struct Order {
        x: u32,
        y: u32,
        rotation: u16,
        apply: u16,
        tune: u16,
        cell: u16,
    }

    /// The STM's values.
    struct Answer {
        x: u32,
        y: u32,
        rotation: u16,
        voltage: u16,
        ranges: [u16; 3],
        cell: u16,
        cells: u16,
    }

    /// Decodes `frame` into `order` and encodes `answer` into `reply`; false where the frame is wrong.
    #[inline(never)]
    fn reference_codec(
        frame: &[u8],
        order: &mut Order,
        answer: &Answer,
        reply: &mut [u8; LEN],
    ) -> bool {
        let Ok(frame) = <&[u8; LEN]>::try_from(frame) else {
            return false;
        };
        let four =
            |at| u32::from_be_bytes([frame[at], frame[at + 1], frame[at + 2], frame[at + 3]]);
        let two = |at| u16::from_be_bytes([frame[at], frame[at + 1]]);
        let battery = two(11);
        let cell = battery >> 13;
        if frame[0] != KEY_FROM_PI || cell >= answer.cells {
            return false;
        }
        let rotation = two(9);
        *order = Order {
            x: four(1),
            y: four(5),
            rotation: rotation & 0x7FFF,
            apply: rotation >> 15,
            tune: battery & 0x1FFF,
            cell,
        };
        reply[0] = KEY_FROM_STM;
        reply[1..5].copy_from_slice(&answer.x.to_be_bytes());
        reply[5..9].copy_from_slice(&answer.y.to_be_bytes());
        let words = [
            answer.rotation,
            answer.cell << 13 | answer.voltage,
            answer.ranges[0],
            answer.ranges[1],
            answer.ranges[2],
        ];
        for (pair, word) in reply[9..].chunks_exact_mut(2).zip(words) {
            pair.copy_from_slice(&word.to_be_bytes());
        }
        true
    }

    /// The same by the core's strategies.
    #[inline(never)]
    fn core_codec(
        frame: &[u8],
        context: &Context,
        command: &mut Command,
        report: &Report,
        reply: &mut [u8; MAX_FRAME],
    ) -> usize {
        let Ok(decoded) = parse_command(Mode::Normal, context, frame, 0) else {
            return 0;
        };
        *command = decoded;
        write_report(Mode::Normal, context, report, reply)
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let mut frame = [0; LEN];
        frame[0] = KEY_FROM_PI;
        let answer = Answer {
            x: 1,
            y: 2,
            rotation: 3,
            voltage: 4,
            ranges: [5, 6, 7],
            cell: 1,
            cells: 2,
        };
        let context = Context {
            key_from_pi: KEY_FROM_PI,
            key_from_stm: KEY_FROM_STM,
            cells: 2,
            own: 0,
            last: None,
        };
        let (mut order, mut command) = (Order::default(), Command::default());
        let report = Report::default();
        let (mut short, mut long) = ([0; LEN], [0; MAX_FRAME]);
        loop {
            let frame = black_box(&frame[..]);
            black_box(reference_codec(
                frame,
                &mut order,
                black_box(&answer),
                &mut short,
            ));
            black_box((&order.x, &order.y, &order.rotation, &order.apply));
            black_box((&order.tune, &order.cell, &short));
            let (context, report) = (black_box(&context), black_box(&report));
            black_box(core_codec(frame, context, &mut command, report, &mut long));
            black_box((&command, &long));
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
        loop {
            core::hint::spin_loop();
        }
    }
}
