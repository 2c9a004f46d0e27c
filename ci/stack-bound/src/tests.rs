//! Hand-assembled routines and their bounds.

use crate::decode::{Decoder, Effect, LR, PC, SP, it_block};
use crate::{Error, Options, Program, Report};

const CODE: u32 = 0x0800_0200;
const RAM: u32 = 0x2000_0000;

/// A program of these routines `f0`, `f1`, … from `CODE` on, 0x100 bytes apart, with `words` at
/// `CODE + 0x1000`; the first one is the reset handler.
fn program(routines: &[&[u16]], words: &[u32]) -> Program {
    let mut program = Program::new(RAM..RAM + 0x2000, &[CODE | 1]);
    for (nth, (at, code)) in (CODE..).step_by(0x100).zip(routines).enumerate() {
        program.add_code(at, &format!("f{nth}"), code).unwrap();
    }
    let words = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    program.add_data(CODE + 0x1000, words);
    program
}

fn report(routines: &[&[u16]]) -> Result<Report, Error> {
    Report::of(&program(routines, &[]), &Options::default())
}

fn worst(routines: &[&[u16]]) -> u32 {
    report(routines).unwrap().worst()
}

fn assert_refused(routines: &[&[u16]], why: &str) {
    let error = report(routines).unwrap_err().to_string();
    assert!(error.contains(why), "{error}");
}

/// `bl` from halfword `nth` of routine `from` to routine `to`.
fn bl(from: u32, nth: u32, to: u32) -> [u16; 2] {
    let offset = (0x100 * to).wrapping_sub(0x100 * from + 2 * nth + 4);
    let half = |bits: u32| u16::try_from(bits & 0xFFFF).unwrap();
    let sign = offset >> 31;
    let (i1, i2) = (offset >> 23 & 1, offset >> 22 & 1);
    [
        half(0xF000 | sign << 10 | offset >> 12 & 0x3FF),
        half(0xD000 | (i1 ^ sign ^ 1) << 13 | (i2 ^ sign ^ 1) << 11 | offset >> 1 & 0x7FF),
    ]
}

const PUSH_R4_LR: u16 = 0xB510;
const POP_R4_PC: u16 = 0xBD10;
const PUSH_R4_R5_R6_LR: u16 = 0xB570;
const POP_R4_R5_R6_PC: u16 = 0xBD70;
const DEEPER: [u16; 2] = [PUSH_R4_R5_R6_LR, POP_R4_R5_R6_PC];
const BX_LR: u16 = 0x4770;
const NOP: u16 = 0xBF00;

#[test]
fn frame_of_every_form_counts() {
    let frames: [(&str, &[u16], u32); 8] = [
        ("leaf", &[NOP, BX_LR], 0),
        ("push, pop", &[PUSH_R4_LR, POP_R4_PC], 8),
        ("sub sp, #24", &[PUSH_R4_LR, 0xB086, 0xB006, POP_R4_PC], 32),
        (
            "sub.w sp, #1024",
            &[PUSH_R4_LR, 0xF5AD, 0x6D80, 0xF50D, 0x6D80, POP_R4_PC],
            8 + 1024,
        ),
        (
            "str r11, [sp, #-4]!; ldr r11, [sp], #4",
            &[0xB5F0, 0xF84D, 0xBD04, 0xF85D, 0xBB04, 0xBDF0],
            24,
        ),
        (
            "push.w {r4-r11, lr}; vpush {d8}",
            &[
                0xE92D, 0x4FF0, 0xED2D, 0x8B02, 0xECBD, 0x8B02, 0xE8BD, 0x8FF0,
            ],
            36 + 8,
        ),
        (
            "mov r7, sp; mov sp, r7",
            &[0xB580, 0x466F, 0xB084, 0x46BD, 0xBD80],
            24,
        ),
        (
            "str lr, [sp, #-8]!; ldr lr, [sp], #8",
            &[0xF84D, 0xED08, 0xF85D, 0xEB08, BX_LR],
            8,
        ),
    ];
    for (what, code, bytes) in frames {
        assert_eq!(worst(&[code]), bytes, "{what}");
    }
}

#[test]
fn call_counts_from_its_depth() {
    let [a, b] = bl(0, 1, 1);
    let [c, d] = bl(0, 4, 1);
    // Once from 8 bytes down, once from 40.
    let caller = [PUSH_R4_LR, a, b, 0xB088, c, d, 0xB008, POP_R4_PC];
    let report = report(&[&caller, &DEEPER]).unwrap();
    assert_eq!(report.worst(), 40 + 16);
    let chain = [("f0".to_owned(), 40), ("f1".to_owned(), 16)];
    assert_eq!(report.levels[0].chain, chain);
}

#[test]
fn tail_call_keeps_the_remaining_stack() {
    // push {r4, lr}; pop.w {r4, lr}; b.w f1
    let [b, w] = bl(0, 3, 1);
    let tail = [PUSH_R4_LR, 0xE8BD, 0x4010, b, w & !0x4000];
    assert_eq!(worst(&[&tail, &DEEPER]), 16);
    // Outlined epilogue: push {r4, lr}; b.w to pop {r4, pc}.
    let [b, w] = bl(0, 1, 1);
    assert_eq!(worst(&[&[PUSH_R4_LR, b, w & !0x4000], &[POP_R4_PC]]), 8);
}

#[test]
fn frame_of_unknown_size_is_refused() {
    let refused: [(&[u16], &str); 7] = [
        // sub.w sp, sp, r0; add sp, r0; mov sp, r0
        (&[PUSH_R4_LR, 0xEBAD, 0x0D00, POP_R4_PC], "unsupported"),
        (&[PUSH_R4_LR, 0x4485, POP_R4_PC], "unknown size"),
        (&[PUSH_R4_LR, 0x4685, POP_R4_PC], "unknown size"),
        // push {r4}; b back. cbz r0 over push {r4}.
        (&[0xB410, 0xE7FD], "depends on the path"),
        (&[0xB100, 0xB410, BX_LR], "depends on the path"),
        // push {r4}; bx lr. pop {r4}; bx lr.
        (&[0xB410, BX_LR], "left on the stack"),
        (&[0xBC10, BX_LR], "more is popped"),
    ];
    for (code, why) in refused {
        assert_refused(&[code], why);
    }
}

#[test]
fn recursion_is_refused_with_its_cycle() {
    let [a, b] = bl(0, 1, 0);
    assert_refused(&[&[PUSH_R4_LR, a, b, POP_R4_PC]], "recursion: f0 -> f0");
    let [a, b] = bl(0, 1, 1);
    let [c, d] = bl(1, 1, 0);
    let pair: [&[u16]; 2] = [
        &[PUSH_R4_LR, a, b, POP_R4_PC],
        &[PUSH_R4_LR, c, d, POP_R4_PC],
    ];
    assert_refused(&pair, "recursion: f0 -> f1 -> f0");
}

#[test]
fn indirect_call_needs_known_targets() {
    // push {r4, lr}; ldr r3, [r0]; blx r3; pop
    let unknown: &[u16] = &[PUSH_R4_LR, 0x6803, 0x4798, POP_R4_PC];
    assert_refused(&[unknown, &DEEPER], "unknown address");
    assert_refused(&[&[PUSH_R4_LR, 0x4798, POP_R4_PC]], "through r3");
    // movw r3, #0x0301; movt r3, #0x0800; blx r3
    let known: &[u16] = &[
        PUSH_R4_LR, 0xF240, 0x3301, 0xF6C0, 0x0300, 0x4798, POP_R4_PC,
    ];
    assert_eq!(worst(&[known, &DEEPER]), 8 + 16);
    // bx r1 is no return.
    assert_refused(&[&[0x4708]], "through r1");
}

#[test]
fn function_table_is_walked_row_by_row() {
    // push {r4, r5, r6, lr}; r5 = CODE + 0x1000; r4 = 0; loop: add r0, r5, r4; ldr r1, [r0];
    // blx r1; adds r4, #4; cmp r4, #8; bne loop; pop
    let mut code = [
        PUSH_R4_R5_R6_LR,
        0xF241,
        0x2500,
        0xF6C0,
        0x0500,
        0x2400,
        0x1928,
        0x6801,
        0x4788,
        0x3404,
        0x2C08,
        0xD1F9,
        POP_R4_R5_R6_PC,
    ];
    let rows = [CODE + 0x101, CODE + 0x201];
    let bound = |code: &[u16]| {
        let deeper: &[u16] = &[PUSH_R4_LR, 0xB082, 0xB002, POP_R4_PC];
        Report::of(
            &program(&[code, &[BX_LR], deeper], &rows),
            &Options::default(),
        )
    };
    assert_eq!(bound(&code).unwrap().worst(), 16 + 16);
    // One row more than the table has.
    code[10] = 0x2C0C;
    assert!(bound(&code).is_err());
}

#[test]
fn outlined_code_jumps_through_its_callers_register() {
    // push {r4, lr}; r4 = f2; bl f1; pop, with f1: bx r4
    let [a, b] = bl(0, 5, 1);
    let caller = [PUSH_R4_LR, 0xF240, 0x4401, 0xF6C0, 0x0400, a, b, POP_R4_PC];
    assert_eq!(worst(&[&caller, &[0x4720], &DEEPER]), 8 + 16);
}

#[test]
fn clobbered_register_is_forgotten() {
    // push {r4, lr}; r4 = f2; bl f1; blx r4; pop
    let [a, b] = bl(0, 5, 1);
    let caller = [
        PUSH_R4_LR, 0xF240, 0x4401, 0xF6C0, 0x0400, a, b, 0x47A0, POP_R4_PC,
    ];
    let restores = [PUSH_R4_LR, 0x6804, POP_R4_PC];
    assert_eq!(worst(&[&caller, &restores, &DEEPER]), 8 + 16);
    assert_refused(&[&caller, &[0x6804, BX_LR], &DEEPER], "unknown address");
}

#[test]
fn call_without_return_ends_the_path() {
    let [a, b] = bl(0, 1, 1);
    // There is no code behind the call.
    assert_eq!(worst(&[&[PUSH_R4_LR, a, b], &[0xE7FE]]), 8);
    assert_refused(&[&[PUSH_R4_LR, a, b], &[BX_LR]], "leaves the code");
}

#[test]
fn it_block_runs_as_one() {
    // push {r4, lr}; it eq; popeq {r4, pc}; sub sp, #8; add sp, #8; pop
    let early = [PUSH_R4_LR, 0xBF08, POP_R4_PC, 0xB082, 0xB002, POP_R4_PC];
    assert_eq!(worst(&[&early]), 16);
    // push {r4, lr}; sub sp, #8; itt eq; addeq sp, #8; popeq {r4, pc}; add sp, #8; pop
    let both = [
        PUSH_R4_LR, 0xB082, 0xBF04, 0xB002, POP_R4_PC, 0xB002, POP_R4_PC,
    ];
    assert_eq!(worst(&[&both]), 16);
    // A comparison between the two may change the condition.
    let split = [
        PUSH_R4_LR, 0xB082, 0xBF02, 0xB002, 0x2800, POP_R4_PC, 0xB002, POP_R4_PC,
    ];
    assert!(report(&[&split]).is_err());
    let block = |mask| it_block(mask).collect::<Vec<_>>();
    // it eq, ite eq, ittte ne
    assert_eq!(block(0b0_1000), [true]);
    assert_eq!(block(0b0_1100), [true, false]);
    assert_eq!(block(0b1_1101), [true, true, true, false]);
}

#[test]
fn offset_table_ends_at_its_first_target() {
    // tbb [pc, r0]; 1: bx lr; 2: push, pop
    let jump = |first: u8| {
        let mut program = program(&[&[0xE8DF, 0xF000]], &[]);
        program.add_data(CODE + 4, vec![first, 2]);
        let rest = [BX_LR, PUSH_R4_LR, POP_R4_PC];
        program.add_code(CODE + 6, "f0", &rest).unwrap();
        Report::of(&program, &Options::default())
    };
    assert_eq!(jump(1).unwrap().worst(), 8);
    assert!(jump(0x77).is_err());
    // 3, 4, and a nop before what else stands there; then the same code.
    let mut padded = program(&[&[0xE8DF, 0xF000]], &[]);
    padded.add_data(CODE + 4, vec![3, 4, 0x00, 0xBF, 0x7B, 0x5C]);
    let rest = [BX_LR, PUSH_R4_LR, POP_R4_PC];
    padded.add_code(CODE + 10, "f0", &rest).unwrap();
    let padded = Report::of(&padded, &Options::default());
    assert_eq!(padded.unwrap().worst(), 8);
}

#[test]
fn branch_table_is_followed_row_by_row() {
    // push {r4, lr}; loop: adr.w r1, table; add.w r1, r1, r0, lsl #2; mov pc, r1; nop; nop;
    // table: b.w loop; b.w deeper; b.w end; deeper: sub sp, #16; add sp, #16; b loop; end: pop
    let code = [
        PUSH_R4_LR, 0xF20F, 0x010C, 0xEB01, 0x0180, 0x468F, NOP, NOP, 0xF7FF, 0xBFF7, 0xF000,
        0xB802, 0xF000, 0xB803, 0xB084, 0xB004, 0xE7EF, POP_R4_PC,
    ];
    assert_eq!(worst(&[&code]), 8 + 16);
    let with = |range: std::ops::Range<usize>, halfwords: &[u16]| {
        let mut code = code;
        code[range].copy_from_slice(halfwords);
        code
    };
    assert_refused(&[&with(13..14, &[0xB833])], "leaves the code");
    assert_refused(&[&with(8..10, &[NOP, NOP])], "without branches");
    // mov r1, r2 instead of the table's address
    assert_refused(&[&with(1..3, &[0x4611, NOP])], "unknown address");
}

#[test]
fn decode_reduces_to_effects() {
    let decoder = Decoder::new().unwrap();
    let cases = [
        ([BX_LR, 0], Effect::JumpRegister(LR)),
        ([POP_R4_PC, 0], Effect::Pop(1 << 4 | 1 << PC, 8)),
        ([0xE7FE, 0], Effect::Jump(0x100)),
        ([0xF7FF, 0xFFFE], Effect::Call(0x100)),
        ([0xF7FF, 0xBFFE], Effect::Jump(0x100)),
        ([0xF43F, 0xAFFE], Effect::Branch(0x100, Some(0))),
        ([0xB100, 0], Effect::Branch(0x104, None)),
        ([0xF8DF, 0x300C], Effect::LoadLiteral(3, 0x110)),
        ([0xA103, 0], Effect::Set(1, 0x110)),
        ([0xF04F, 0x20AB], Effect::Set(0, 0xAB00_AB00)),
        ([0xF06F, 0x0000], Effect::Set(0, u32::MAX)),
        ([0xF2AD, 0x0D10], Effect::Add(SP, SP, -16)),
        ([0x7041, 0], Effect::Store(1, 0, 1, 1)),
        ([0xE96D, 0x4504], Effect::Push(0b11_0000, 16)),
        // msr msp, r0; msr psp, r0; mrs r0, primask; cpsid i; udf
        ([0xF380, 0x8808], Effect::SetMainStack(0)),
        ([0xF380, 0x8809], Effect::Unsupported),
        ([0xF3EF, 0x8010], Effect::Other(1)),
        ([0xB672, 0], Effect::Other(0)),
        ([0xDE00, 0], Effect::Trap),
        // ldr sp, [r0]; ldr pc, [r0]; ldrb r0, [sp], #1; str r0, [sp], #4; add.w sp, r1, r0, lsl #2
        ([0xF8D0, 0xD000], Effect::Unsupported),
        ([0xF8D0, 0xF000], Effect::Unsupported),
        ([0xF81D, 0x0B01], Effect::Unsupported),
        ([0xF84D, 0x0B04], Effect::Unsupported),
        ([0xEB01, 0x0D80], Effect::Unsupported),
        // umull r0, r1, r2, r3; sdiv r0, r1, r2; vmov r0, s0; stmdb r2!, {r1, r3}
        ([0xFBA2, 0x0103], Effect::Other(0b11)),
        ([0xFB91, 0xF0F2], Effect::Other(1)),
        ([0xEE10, 0x0A10], Effect::Other(1)),
        ([0xE922, 0x000A], Effect::Other(0b100)),
    ];
    for ([first, second], effect) in cases {
        let code = [first.to_le_bytes(), second.to_le_bytes()].concat();
        let instruction = decoder.decode(0x100, &code).unwrap();
        assert_eq!(instruction.effect, effect, "{first:04x} {second:04x}");
    }
}

/// A reset handler that gives two interrupts the priority 2, an NMI, and a `HardFault` handler that
/// resets the stack pointer.
fn interrupts() -> Program {
    // r0 = 0xE000E400; r1 = 0x20; strb r1, [r0, #1]; strb r1, [r0]; b .
    let reset = [
        0xF44F, 0x4064, 0xF2CE, 0x0000, 0x2120, 0x7041, 0x7001, 0xE7FE,
    ];
    let deeper = [0xB5F0, 0xBDF0];
    // r0 = 0x20002000; msr msp, r0; push {r4}; b .
    let fault = [
        0xF44F, 0x5000, 0xF2C2, 0x0000, 0xF380, 0x8808, 0xB410, 0xE7FE,
    ];
    let mut program = program(&[&reset, &DEEPER, &deeper, &fault], &[]);
    program.vectors.resize(18, 0);
    for (number, routine) in [(2, 1), (3, 3), (16, 1), (17, 2)] {
        program.vectors[number] = CODE + 0x100 * routine + 1;
    }
    program
}

#[test]
fn handlers_of_one_priority_count_once() {
    let options = Options {
        priority_bits: Some(4),
        ..Options::default()
    };
    let report = Report::of(&interrupts(), &options).unwrap();
    assert_eq!(report.worst(), (20 + 36) + (16 + 36) + 36);
    assert_eq!(report.restarted, 4 + 16 + 36);
    let names: Vec<_> = report.levels.iter().map(|level| &*level.name).collect();
    assert_eq!(names, ["thread", "priority 2", "HardFault", "NMI"]);
    assert_eq!(report.reserved, 0x2000);
}

#[test]
fn unguarded_stack_is_refused() {
    let options = Options {
        ram_start: Some(RAM),
        ..Options::default()
    };
    let refused = |change: fn(&mut Program)| {
        let mut program = interrupts();
        change(&mut program);
        Report::of(&program, &options).unwrap_err().to_string()
    };
    assert!(Report::of(&interrupts(), &options).is_ok());
    assert!(refused(|program| program.stack.start += 8).contains("without a fault"));
    assert!(refused(|program| program.statics -= 4).contains("lies in the stack"));
    assert!(refused(|program| program.vectors[0] += 8).contains("vector table"));
}

#[test]
fn masked_routine_counts_apart() {
    let [a, b] = bl(0, 1, 1);
    let reset = [PUSH_R4_LR, a, b, POP_R4_PC];
    // push {r4, lr}; sub sp, #64; add sp, #64; pop
    let boot = [PUSH_R4_LR, 0xB090, 0xB010, POP_R4_PC];
    let mut program = program(&[&reset, &boot, &DEEPER], &[]);
    program.vectors.resize(17, 0);
    program.vectors[16] = CODE + 0x201;
    let mut options = Options::default();
    let unmasked = Report::of(&program, &options).unwrap();
    assert_eq!(unmasked.worst(), 8 + 72 + 16 + 36);
    options.masked = Some("f1".to_owned());
    assert_eq!(Report::of(&program, &options).unwrap().worst(), 8 + 72);
}
