//! Routines put together by hand, and what becomes of them.

use super::levels::Report;
use super::program::{Program, FLASH, RAM};
use super::routine::{Analysis, Summary, Trouble};
use super::thumb::{decode, What, LR, PC, SP};
use super::{thumb, wide};

const CODE: u32 = FLASH + 0x200;

/// A program of these routines, each at a multiple of 0x100, `words` at 0x1000.
fn program(routines: &[&[u16]], words: &[u32]) -> Program {
    let mut program = Program {
        stack: RAM..RAM + 0x2000,
        statics: RAM + 0x2000,
        ..Program::default()
    };
    for (at, code) in (CODE..).step_by(0x100).zip(routines) {
        let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
        program
            .code
            .push(at..at + 2 * u32::try_from(code.len()).unwrap());
        program.names.insert(at, format!("f{}", (at - CODE) >> 8));
        program.flash.push((at, bytes));
    }
    let words = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    program.flash.push((CODE + 0x1000, words));
    program
}

fn summary(routines: &[&[u16]], words: &[u32]) -> Result<Summary, String> {
    let program = program(routines, words);
    let known = Analysis::of(&program).routine(CODE);
    known.map_err(|trouble| match trouble {
        Trouble::Wants(register) => format!("wants r{register}"),
        Trouble::Cannot(why) => why,
    })
}

fn worst(routines: &[&[u16]]) -> u32 {
    summary(routines, &[]).unwrap().worst
}

fn refused(routines: &[&[u16]]) -> String {
    summary(routines, &[]).unwrap_err()
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
const BX_LR: u16 = 0x4770;
const NOP: u16 = 0xBF00;

#[test]
fn a_leaf_takes_nothing_and_every_kind_of_frame_counts() {
    assert_eq!(worst(&[&[BX_LR]]), 0);
    assert_eq!(worst(&[&[PUSH_R4_LR, POP_R4_PC]]), 8);
    // push {r4, lr}; sub sp, #24; add sp, #24; pop {r4, pc}
    assert_eq!(worst(&[&[PUSH_R4_LR, 0xB086, 0xB006, POP_R4_PC]]), 32);
    // push {r4, lr}; sub.w sp, sp, #1024; add.w sp, sp, #1024; pop
    let wide = [PUSH_R4_LR, 0xF5AD, 0x6D80, 0xF50D, 0x6D80, POP_R4_PC];
    assert_eq!(worst(&[&wide]), 8 + 1024);
    // push {r4, r5, r6, r7, lr}; str r11, [sp, #-4]!; ldr r11, [sp], #4; pop {.., pc}
    let single = [0xB5F0, 0xF84D, 0xBD04, 0xF85D, 0xBB04, 0xBDF0];
    assert_eq!(worst(&[&single]), 24);
    // push.w {r4-r11, lr}; vpush {d8}; vpop {d8}; pop.w {r4-r11, pc}
    let float = [
        0xE92D, 0x4FF0, 0xED2D, 0x8B02, 0xECBD, 0x8B02, 0xE8BD, 0x8FF0,
    ];
    assert_eq!(worst(&[&float]), 36 + 8);
    // push {r7, lr}; mov r7, sp; sub sp, #16; mov sp, r7; pop {r7, pc}
    assert_eq!(worst(&[&[0xB580, 0x466F, 0xB084, 0x46BD, 0xBD80]]), 24);
    // str lr, [sp, #-8]!; ldr lr, [sp], #8; bx lr
    assert_eq!(worst(&[&[0xF84D, 0xED08, 0xF85D, 0xEB08, BX_LR]]), 8);
}

#[test]
fn a_call_counts_from_the_depth_it_is_made_at() {
    let [a, b] = bl(0, 1, 1);
    let [c, d] = bl(0, 4, 1);
    // Once from 8 bytes down, once from 40.
    let caller = [PUSH_R4_LR, a, b, 0xB088, c, d, 0xB008, POP_R4_PC];
    let known = summary(&[&caller, &[0xB570, 0xBD70]], &[]).unwrap();
    assert_eq!(known.worst, 40 + 16);
    assert_eq!(known.chain, [(CODE, 40), (CODE + 0x100, 16)]);
    assert!(known.returns);
}

#[test]
fn a_tail_call_starts_from_what_is_left_on_the_stack() {
    // push {r4, lr}; pop.w {r4, lr}; b.w f1, which pushes 16.
    let [b, w] = bl(0, 3, 1);
    let tail = [PUSH_R4_LR, 0xE8BD, 0x4010, b, w & !0x4000];
    assert_eq!(worst(&[&tail, &[0xB570, 0xBD70]]), 16);
    // Outlined code takes its caller's frame off: push {r4, lr}; b.w to pop {r4, pc}.
    let [b, w] = bl(0, 1, 1);
    assert_eq!(worst(&[&[PUSH_R4_LR, b, w & !0x4000], &[POP_R4_PC]]), 8);
}

#[test]
fn a_frame_of_unknown_size_is_refused() {
    // sub.w sp, sp, r0
    let why = refused(&[&[PUSH_R4_LR, 0xEBAD, 0x0D00, POP_R4_PC]]);
    assert!(why.contains("cannot be followed"), "{why}");
    // add sp, r0
    let why = refused(&[&[PUSH_R4_LR, 0x4485, POP_R4_PC]]);
    assert!(why.contains("unknown size"), "{why}");
    // mov sp, r0
    let why = refused(&[&[PUSH_R4_LR, 0x4685, POP_R4_PC]]);
    assert!(why.contains("unknown size"), "{why}");
    // A loop that pushes: push {r4}; b back.
    let why = refused(&[&[0xB410, 0xE7FD]]);
    assert!(why.contains("depends on the way"), "{why}");
    // One of two ways pushes: cbz r0 over a push.
    let why = refused(&[&[0xB100, 0xB410, BX_LR]]);
    assert!(why.contains("depends on the way"), "{why}");
    // A return that forgot its frame, and one that takes too much.
    let why = refused(&[&[0xB410, BX_LR]]);
    assert!(why.contains("left on the stack"), "{why}");
    let why = refused(&[&[0xBC10, BX_LR]]);
    assert!(why.contains("taken off"), "{why}");
}

#[test]
fn a_recursion_is_refused_and_named() {
    let [a, b] = bl(0, 1, 0);
    let why = refused(&[&[PUSH_R4_LR, a, b, POP_R4_PC]]);
    assert!(why.contains("recursion: f0 -> f0"), "{why}");
    let [a, b] = bl(0, 1, 1);
    let [c, d] = bl(1, 1, 0);
    let why = refused(&[
        &[PUSH_R4_LR, a, b, POP_R4_PC],
        &[PUSH_R4_LR, c, d, POP_R4_PC],
    ]);
    assert!(why.contains("recursion: f0 -> f1 -> f0"), "{why}");
}

#[test]
fn an_indirect_call_is_refused_unless_its_target_can_be_seen() {
    // push {r4, lr}; ldr r3, [r0]; blx r3; pop
    let why = refused(&[&[PUSH_R4_LR, 0x6803, 0x4798, POP_R4_PC]]);
    assert!(why.contains("nobody knows where"), "{why}");
    // The caller's register: nobody gave it.
    let why = refused(&[&[PUSH_R4_LR, 0x4798, POP_R4_PC]]);
    assert!(why.contains("wants r3"), "{why}");
    // movw r3, #0x0301; movt r3, #0x0800; blx r3: routine 1, 16 bytes.
    let seen = [
        PUSH_R4_LR, 0xF240, 0x3301, 0xF6C0, 0x0300, 0x4798, POP_R4_PC,
    ];
    assert_eq!(worst(&[&seen, &[0xB570, 0xBD70]]), 8 + 16);
    // A return by a register that was never the link register.
    let why = refused(&[&[0x4708]]);
    assert!(why.contains("wants r1"), "{why}");
}

#[test]
fn a_table_of_functions_is_walked_row_by_row() {
    // push {r4, r5, r6, lr}; r5 = 0x08001200; r4 = 0; loop: add r0, r5, r4; ldr r1, [r0];
    // blx r1; adds r4, #4; cmp r4, #8; bne loop; pop
    let code = [
        0xB570, 0xF241, 0x2500, 0xF6C0, 0x0500, 0x2400, 0x1928, 0x6801, 0x4788, 0x3404, 0x2C08,
        0xD1F9, 0xBD70,
    ];
    let rows = [CODE + 0x101, CODE + 0x201];
    let known = summary(
        &[&code, &[BX_LR], &[PUSH_R4_LR, 0xB082, 0xB002, POP_R4_PC]],
        &rows,
    );
    assert_eq!(known.unwrap().worst, 16 + 16);
    // One row more than there is: what stands behind the table is no code.
    let mut longer = code;
    longer[10] = 0x2C0C;
    assert!(summary(&[&longer, &[BX_LR], &[BX_LR]], &rows).is_err());
}

#[test]
fn outlined_code_jumps_through_what_its_caller_gave_it() {
    // push {r4, lr}; r4 = routine 2; bl f1; pop, with f1: bx r4.
    let [a, b] = bl(0, 5, 1);
    let caller = [PUSH_R4_LR, 0xF240, 0x4401, 0xF6C0, 0x0400, a, b, POP_R4_PC];
    assert_eq!(worst(&[&caller, &[0x4720], &[0xB570, 0xBD70]]), 8 + 16);
}

#[test]
fn a_register_that_a_callee_spoils_is_not_trusted() {
    // push {r4, lr}; r4 = routine 2; bl f1; blx r4; pop, with f1 writing r4.
    let [a, b] = bl(0, 5, 1);
    let caller = [
        PUSH_R4_LR, 0xF240, 0x4401, 0xF6C0, 0x0400, a, b, 0x47A0, POP_R4_PC,
    ];
    let restores: &[u16] = &[PUSH_R4_LR, 0x6804, POP_R4_PC];
    assert_eq!(worst(&[&caller, restores, &[0xB570, 0xBD70]]), 8 + 16);
    let spoils: &[u16] = &[0x6804, BX_LR];
    let why = refused(&[&caller, spoils, &[0xB570, 0xBD70]]);
    assert!(why.contains("nobody knows where"), "{why}");
}

#[test]
fn what_never_returns_is_not_followed_beyond_its_call() {
    let [a, b] = bl(0, 1, 1);
    // Behind the call stands no code.
    let known = summary(&[&[PUSH_R4_LR, a, b], &[0xE7FE]], &[]).unwrap();
    assert!(!known.returns);
    let why = refused(&[&[PUSH_R4_LR, a, b], &[BX_LR]]);
    assert!(why.contains("leaves the code"), "{why}");
}

#[test]
fn conditional_instructions_are_taken_and_left_together() {
    // push {r4, lr}; it eq; popeq {r4, pc}; sub sp, #8; add sp, #8; pop
    let early = [PUSH_R4_LR, 0xBF08, POP_R4_PC, 0xB082, 0xB002, POP_R4_PC];
    assert_eq!(worst(&[&early]), 16);
    // push {r4, lr}; sub sp, #8; itt eq; addeq sp, #8; popeq {r4, pc}; add sp, #8; pop
    let both = [
        PUSH_R4_LR, 0xB082, 0xBF04, 0xB002, POP_R4_PC, 0xB002, POP_R4_PC,
    ];
    assert_eq!(worst(&[&both]), 16);
    // Where a comparison in between may change its mind, the frame is not known.
    let split = [
        PUSH_R4_LR, 0xB082, 0xBF02, 0xB002, 0x2800, POP_R4_PC, 0xB002, POP_R4_PC,
    ];
    assert!(summary(&[&split], &[]).is_err());
    let blocks = |mask| thumb::block(mask).collect::<Vec<_>>();
    // it eq, ite eq, ittte ne.
    assert_eq!(blocks(0b0_1000), [true]);
    assert_eq!(blocks(0b0_1100), [true, false]);
    assert_eq!(blocks(0b1_1101), [true, true, true, false]);
}

#[test]
fn a_jump_table_ends_where_the_first_jump_of_it_goes() {
    // tbb [pc, r0]; entries 2 and 3: bx lr, push/pop.
    let mut program = program(&[&[0xE8DF, 0xF000]], &[]);
    let rest: Vec<u8> = [0x0302_u16, BX_LR, PUSH_R4_LR, POP_R4_PC]
        .iter()
        .flat_map(|half| half.to_le_bytes())
        .collect();
    program.flash.push((CODE + 4, rest.clone()));
    program.code.push(CODE + 6..CODE + 12);
    // Entries count from behind the instruction: 1 is the first code.
    let at = program.flash.len() - 1;
    program.flash[at].1[..2].copy_from_slice(&[1, 2]);
    let known = Analysis::of(&program).routine(CODE).unwrap();
    assert_eq!(known.worst, 8);
    program.flash[at].1[..2].copy_from_slice(&[0x77, 1]);
    assert!(Analysis::of(&program).routine(CODE).is_err());
}

#[test]
fn a_table_of_branches_is_followed_row_by_row() {
    // push {r4, lr}; loop: adr.w r1, table; add.w r1, r1, r0, lsl #2; mov pc, r1; nop; nop;
    // table: b.w loop; b.w deeper; b.w end; deeper: sub sp, #16; add sp, #16; b loop; end: pop {r4, pc}
    let code = [
        PUSH_R4_LR, 0xF20F, 0x010C, 0xEB01, 0x0180, 0x468F, NOP, NOP, 0xF7FF, 0xBFF7, 0xF000,
        0xB802, 0xF000, 0xB803, 0xB084, 0xB004, 0xE7EF, POP_R4_PC,
    ];
    assert_eq!(worst(&[&code]), 8 + 16);
    // A row that leaves the code, and a table of anything else.
    let mut nowhere = code;
    nowhere[13] = 0xB833;
    assert!(refused(&[&nowhere]).contains("leaves the code"));
    let mut nothing = code;
    nothing[8..10].fill(NOP);
    let why = refused(&[&nothing]);
    assert!(why.contains("no branches"), "{why}");
    // Where the table's place is not known: mov r1, r2 instead.
    let mut unknown = code;
    unknown[1..3].copy_from_slice(&[0x4611, NOP]);
    let why = refused(&[&unknown]);
    assert!(why.contains("nobody knows where"), "{why}");
    // add.w sp, r1, r0, lsl #2
    assert_eq!(decode(0, 0xEB01, 0x0D80).what, What::Unknown);
}

#[test]
fn decoding_reads_the_manuals_examples() {
    let what = |first, second| decode(0x100, first, second).what;
    assert_eq!(what(0x4770, 0), What::JumpRegister { rm: LR });
    assert_eq!(what(0xBD10, 0), thumb::pop(1 << 4 | 1 << PC));
    assert_eq!(what(0xE7FE, 0), What::Jump { to: 0x100 });
    assert_eq!(what(0xF7FF, 0xFFFE), What::Call { to: 0x100 });
    assert_eq!(what(0xF7FF, 0xBFFE), What::Jump { to: 0x100 });
    assert_eq!(
        what(0xF43F, 0xAFFE),
        What::Branch {
            to: 0x100,
            on: Some(0)
        }
    );
    assert_eq!(
        what(0xF8DF, 0x300C),
        What::Literal {
            rt: 3,
            address: 0x110
        }
    );
    assert_eq!(
        what(0xA103, 0),
        What::Constant {
            rd: 1,
            value: 0x110
        }
    );
    // msr msp, r0; mrs r0, primask; cpsid i; udf; svc.
    assert_eq!(what(0xF380, 0x8808), What::NewStack { rn: 0 });
    assert_eq!(what(0xF3EF, 0x8010), thumb::writes(0));
    assert_eq!(what(0xB672, 0), What::Plain { writes: 0 });
    assert_eq!(what(0xDE00, 0), What::Trap);
    assert_eq!(what(0xDF00, 0), What::Unknown);
    // ldr sp, [r0] and ldm r0, {sp}: no compiler's.
    assert_eq!(what(0xF8D0, 0xD000), What::Unknown);
    assert_eq!(what(0xF8D0, 0xF000), What::Unknown);
    // The carry of a 64-bit product: umull r0, r1, r2, r3; sdiv r0, r1, r2.
    assert_eq!(what(0xFBA2, 0x0103), What::Plain { writes: 0b11 });
    assert_eq!(what(0xFB91, 0xF0F2), thumb::writes(0));
    assert_eq!(
        wide::decode(0, 0xF2AD, 0x0D10),
        What::Add {
            rd: SP,
            rn: SP,
            offset: -16
        }
    );
}

/// A whole program: what its vectors say, how the levels add up.
fn whole(statics: u32, stack_end: u32) -> Program {
    // Routine 0 (reset): r0 = 0xE000E400; r1 = 0x20; strb r1, [r0, #1]; strb r1, [r0]; b .
    let reset = [
        0xF44F, 0x4064, 0xF2CE, 0x0000, 0x2120, 0x7041, 0x7001, 0xE7FE,
    ];
    let handler = [0xB570, 0xBD70];
    let deeper = [0xB5F0, 0xBDF0];
    // HardFault begins the stack anew: r0 = 0x20002000; msr msp, r0; push {r4}; b .
    let fault = [
        0xF44F, 0x5000, 0xF2C2, 0x0000, 0xF380, 0x8808, 0xB410, 0xE7FE,
    ];
    let mut program = program(&[&reset, &handler, &deeper, &fault], &[]);
    let vector = |routine: u32| CODE + 0x100 * routine + 1;
    program.vectors = vec![0; 18];
    program.vectors[0] = RAM + 0x2000;
    program.vectors[1] = vector(0);
    program.vectors[2] = vector(1);
    program.vectors[3] = vector(3);
    program.vectors[16] = vector(1);
    program.vectors[17] = vector(2);
    program.statics = statics;
    program.stack.start = stack_end;
    program
}

#[test]
fn handlers_of_one_priority_do_not_add_up_and_levels_do() {
    let report = Report::of(&whole(RAM + 0x2000, RAM)).unwrap();
    // The deeper of the two at priority 2, NMI, and HardFault's frame, each with what the processor
    // pushes.
    assert_eq!(report.worst(), (20 + 36) + (16 + 36) + 36);
    assert_eq!(report.nested, (16 + 36) + (20 + 36) + 36);
    assert_eq!(report.fresh, 4 + 16 + 36);
    let names: Vec<_> = report.levels.iter().map(|level| &*level.name).collect();
    assert_eq!(names, ["thread", "priority 2", "HardFault", "NMI"]);
    assert_eq!(report.reserved, 0x2000);
}

#[test]
fn a_stack_that_could_overflow_into_something_is_refused() {
    let why = |program| Report::of(&program).unwrap_err().to_string();
    assert!(why(whole(RAM + 0x2000, RAM + 8)).contains("overwritten"));
    assert!(why(whole(RAM + 0x1FFC, RAM)).contains("lies in the stack"));
    let mut elsewhere = whole(RAM + 0x2000, RAM);
    elsewhere.vectors[0] = RAM + 0x4000;
    assert!(why(elsewhere).contains("vector table"));
}

#[test]
fn a_nop_and_an_unused_vector_matter_to_nobody() {
    assert_eq!(worst(&[&[NOP, BX_LR]]), 0);
}
