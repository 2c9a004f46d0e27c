use super::*;
use rigless::device::Level;

const SPI1: u64 = 0x4001_3000;
const CR1: u64 = SPI1;
const CR2: u64 = SPI1 + 4;
const SR: u64 = SPI1 + 8;
const DR: u64 = SPI1 + 0xC;
const SPE: u64 = 1 << 6;
const RXNE: u64 = 1;
const TXE: u64 = 2;
const OVR: u64 = 1 << 6;
const BSY: u64 = 1 << 7;

/// A part whose SPI1 is an enabled, selected slave.
fn part() -> Fixture<Stm32f411> {
    let mut part = super::part();
    part.write(APB2ENR, SPI1_BIT);
    part.write(CR1, SPE);
    select(&mut part, true);
    part
}

fn select(part: &mut Fixture<Stm32f411>, selected: bool) {
    part.act(|part, now| {
        part.drive_spi(now, |spi, registers, context| {
            spi.set_nss(Some(Level::from(!selected)), registers, context);
        });
    });
}

/// Clocks the lowest `bits` of `word` in; returns the bits that come out.
fn clock(part: &mut Fixture<Stm32f411>, word: u16, bits: u32) -> u16 {
    (0..bits).rev().fold(0, |seen, bit| {
        let out = part.act(|part, now| {
            part.drive_spi(now, |spi, registers, context| {
                spi.clock(word >> bit & 1 != 0, registers, context)
            })
        });
        seen << 1 | u16::from(out.unwrap_or(false))
    })
}

#[test]
fn spi_word_is_received_and_sent() {
    let mut part = part();
    part.write(DR, 0xA5);
    assert_eq!(clock(&mut part, 0x3C, 8), 0xA5);
    assert_eq!(part.read(SR), RXNE | TXE);
    assert_eq!(part.read(DR), 0x3C);
    assert_eq!(part.read(SR), TXE);
}

#[test]
fn spi_next_word_is_fetched_at_first_clock() {
    let mut part = part();
    part.write(DR, 0x80);
    assert_eq!(part.read(SR), 0);
    assert_eq!(clock(&mut part, 0, 1), 1);
    assert_eq!(part.read(SR), TXE | BSY);
    part.write(DR, 0xFF);
    assert_eq!(clock(&mut part, 0, 7), 0, "the first word is sent");
    part.read(DR);
    assert_eq!(clock(&mut part, 0, 8), 0xFF);
}

#[test]
fn spi_overrun_keeps_unread_word_and_clears_by_dr_then_sr() {
    let mut part = part();
    clock(&mut part, 1, 8);
    clock(&mut part, 2, 8);
    assert_eq!(part.read(SR) & OVR, OVR);
    assert_eq!(part.read(SR) & OVR, OVR, "SR alone does not clear it");
    assert_eq!(part.read(DR), 1);
    assert_eq!(part.read(SR) & OVR, OVR, "the read that clears it");
    assert_eq!(part.read(SR) & OVR, 0);
}

#[test]
fn spi_underrun_repeats_last_word() {
    let mut part = part();
    part.write(DR, 0x42);
    assert_eq!(clock(&mut part, 0, 8), 0x42);
    assert_eq!(clock(&mut part, 0, 8), 0x42);
}

#[test]
fn spi_deselected_slave_ignores_clock() {
    let mut part = part();
    select(&mut part, false);
    part.write(DR, 0xFF);
    assert_eq!(clock(&mut part, 0xFF, 8), 0);
    assert_eq!(part.read(SR), 0);
}

#[test]
fn spi_bits_of_torn_word_stay_until_disabled() {
    let mut part = part();
    clock(&mut part, 0b101, 3);
    select(&mut part, false);
    select(&mut part, true);
    assert_eq!(part.read(SR) & BSY, BSY);
    clock(&mut part, 0b0_0001, 5);
    assert_eq!(part.read(DR), 0b1010_0001);
    clock(&mut part, 0b11, 2);
    part.write(CR1, 0);
    part.write(CR1, SPE);
    clock(&mut part, 0x5A, 8);
    assert_eq!(part.read(DR), 0x5A);
}

#[test]
fn spi_disabling_keeps_buffers_and_reset_empties_them() {
    let mut part = part();
    clock(&mut part, 0x5A, 8);
    part.write(DR, 0x77);
    part.write(CR1, 0);
    assert_eq!(part.read(SR), RXNE);
    part.write(APB2RSTR, SPI1_BIT);
    part.write(APB2RSTR, 0);
    assert_eq!(part.read(SR), TXE);
    assert_eq!(part.read(DR), 0);
}

#[test]
fn spi_interrupt_and_dma_requests_follow_flags() {
    let mut part = part();
    part.write(CR2, 1 << 6);
    assert_eq!(part.interrupts(), []);
    clock(&mut part, 0, 8);
    assert_eq!(part.interrupts(), [(35, true)]);
    part.read(DR);
    assert_eq!(part.interrupts(), [(35, false)]);
    assert_eq!(part.mcu.spi.requests, [Level::Low; 2]);
    part.write(CR2, 3);
    clock(&mut part, 0, 8);
    assert_eq!(part.mcu.spi.requests, [Level::High; 2]);
    part.read(DR);
    part.write(DR, 0);
    assert_eq!(part.mcu.spi.requests, [Level::Low; 2]);
}

#[test]
fn spi_sixteen_bits_least_significant_first() {
    let mut part = part();
    part.write(CR1, SPE | 1 << 11 | 1 << 7);
    part.write(DR, 0x8001);
    assert_eq!(clock(&mut part, 0x0003, 16), 0x8001);
    assert_eq!(part.read(DR), 0xC000);
}
