use super::*;
use crate::peripherals::exti::CLEAR_NS;
use crate::pin::pin;
use rigless::device::Level;

const EXTI: u64 = 0x4001_3C00;
const IMR: u64 = EXTI;
const RTSR: u64 = EXTI + 8;
const FTSR: u64 = EXTI + 0xC;
const SWIER: u64 = EXTI + 0x10;
const PR: u64 = EXTI + 0x14;
const LINE: u64 = 1 << 4;

/// A part with PA4 on line 4 (the reset routing), driven low.
fn part() -> Fixture<Stm32f411> {
    let mut part = super::part();
    part.write(AHB1ENR, 0x87);
    part.write(APB2ENR, SYSCFG_BIT);
    drive(&mut part, Level::Low);
    part
}

fn drive(part: &mut Fixture<Stm32f411>, level: Level) {
    part.act(|part, now| part.drive_pin(now, pin('A', 4), Some(level)));
}

#[test]
fn exti_edge_pends_only_where_selected() {
    for (selected, level, pends) in [
        (0, Level::High, false),
        (FTSR, Level::High, false),
        (RTSR, Level::High, true),
        (FTSR, Level::Low, true),
        (RTSR, Level::Low, false),
    ] {
        let mut part = part();
        drive(&mut part, Level::from(level == Level::Low));
        part.write(IMR, LINE);
        if selected != 0 {
            part.write(selected, LINE);
        }
        drive(&mut part, level);
        assert_eq!(part.read(PR) == LINE, pends, "{selected:#x} {level:?}");
    }
}

#[test]
fn exti_pending_clears_by_written_one_only() {
    let mut part = part();
    part.write(IMR, LINE);
    part.write(RTSR, LINE);
    drive(&mut part, Level::High);
    part.write(PR, !LINE & 0x7F_FFFF);
    assert_eq!(part.read(PR), LINE);
    part.write(PR, LINE);
    assert_eq!(part.read(PR), 0);
}

#[test]
fn exti_masked_edge_is_lost_and_line_falls_late() {
    let mut part = part();
    part.write(RTSR, LINE);
    drive(&mut part, Level::High);
    part.write(IMR, LINE);
    assert_eq!((part.read(PR), part.interrupts()), (0, vec![]));
    drive(&mut part, Level::Low);
    drive(&mut part, Level::High);
    assert_eq!(part.interrupts(), [(10, true)]);
    part.write(PR, LINE);
    part.run(CLEAR_NS - 1);
    assert_eq!(part.interrupts(), [], "the store is under way");
    part.run(1);
    assert_eq!(part.interrupts(), [(10, false)]);
}

#[test]
fn exti_software_pends_unmasked_line() {
    let mut part = part();
    part.write(SWIER, 1);
    assert_eq!(part.read(PR), 0, "masked");
    part.write(IMR, 1);
    part.write(SWIER, 1);
    assert_eq!(part.read(PR), 1);
    part.write(PR, 1);
    assert_eq!(part.read(SWIER), 0);
}

#[test]
fn exti_lines_share_vectors() {
    let mut part = part();
    part.write(IMR, 0xFFFF);
    let vectors = [
        (0, 6),
        (1, 7),
        (4, 10),
        (5, 23),
        (9, 23),
        (10, 40),
        (15, 40),
    ];
    for (line, vector) in vectors {
        part.write(SWIER, 1 << line);
        assert_eq!(part.interrupts(), [(vector, true)], "line {line}");
        part.write(PR, 1 << line);
        part.run(CLEAR_NS);
        part.interrupts();
    }
}

/// The detector at 2.66 V.
#[test]
fn exti_supply_line_rises_when_supply_falls() {
    const SUPPLY: u64 = 1 << 16;
    for (mask, edge, pending) in [
        (SUPPLY, RTSR, [true, true]),
        (SUPPLY, FTSR, [false, true]),
        (0, RTSR, [false, false]),
    ] {
        let mut part = part();
        part.act(|part, now| part.set_supply(now, 3_300));
        part.write(APB1ENR, 1 << 28);
        part.write(0x4000_7000, 1 << 4 | 4 << 5);
        part.write(IMR, mask);
        part.write(edge, SUPPLY);
        let pended = [2_600, 3_300].map(|millivolts| {
            part.act(|part, now| part.set_supply(now, millivolts));
            part.read(PR) == SUPPLY
        });
        assert_eq!(pended, pending, "{mask:#x} {edge:#x}");
        let raised = pending[1].then_some((1, true));
        assert_eq!(part.interrupts(), Vec::from_iter(raised));
    }
}
