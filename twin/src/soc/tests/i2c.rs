use super::*;
use crate::fixture::RAM;
use rigless::soc::stm32f427::peripherals::i2c::Pattern;

pub(super) const I2C1: u64 = 0x4000_5400;
pub(super) const CR1: u64 = I2C1;
pub(super) const CR2: u64 = I2C1 + 4;
const DR: u64 = I2C1 + 0x10;
const SR1: u64 = I2C1 + 0x14;
const SR2: u64 = I2C1 + 0x18;
pub(super) const CCR: u64 = I2C1 + 0x1C;
const PE: u64 = 1;
const START: u64 = 1 << 8;
const STOP: u64 = 1 << 9;
const ARLO: u64 = 1 << 9;
const ITERREN: u64 = 1 << 8;
const ACK: u64 = 1 << 10;
const DMAEN: u64 = 1 << 11;
const LAST: u64 = 1 << 12;
const SB: u64 = 1;
const BUSY: u64 = 1 << 1;
const DMA1_STREAM0: u64 = 0x4002_6010;

/// A part whose I2C1 is enabled, with a device at 0x50.
fn part() -> Fixture<Stm32f411> {
    let mut part = super::part();
    let device = Pattern::answering(0x50, [1, 2, 3, 4]);
    part.mcu.i2c[0].inner.attach(device);
    part.write(AHB1ENR, 1 << 21);
    part.write(APB1ENR, 1 << 21);
    part.write(CR2, 16);
    part.write(CCR, 0x50);
    part.write(CR1, PE | ACK);
    part
}

/// A period of SCL: 100 kHz.
const SCL_NS: u64 = 10_000;

/// Sets START or STOP, which then comes.
fn send(part: &mut Fixture<Stm32f411>, condition: u64) {
    part.write(CR1, PE | ACK | condition);
    part.run(SCL_NS);
}

#[test]
fn i2c_start_and_stop_take_a_period_of_scl() {
    let mut part = part();
    for (condition, status) in [(START, SR1), (STOP, SR2)] {
        let before = part.read(status);
        part.write(CR1, PE | ACK | condition);
        part.run(SCL_NS - 1);
        assert_eq!(
            (part.read(status), part.read(CR1) & condition),
            (before, condition)
        );
        part.run(1);
        assert_ne!(part.read(status), before);
        assert_eq!(part.read(CR1) & condition, 0);
    }
    assert!(objections(&mut part).is_empty());
    part.write(CR1, PE | ACK | START);
    part.write(CR1, PE | START);
    assert_eq!(objections(&mut part), ["CR1"]);
    part.run(SCL_NS);
    assert_eq!(part.read(SR1), SB, "once");
    // Disabled before it has come.
    part.write(CR1, PE | STOP);
    part.write(CR1, 0);
    part.write(CR1, PE);
    assert!(objections(&mut part).is_empty());
}

#[test]
fn i2c_last_byte_of_dma_reception_is_not_acknowledged() {
    let mut part = part();
    for (offset, value) in [(4, 3), (8, DR), (12, RAM), (0, 1 << 25 | 1 << 10 | 1)] {
        part.write(DMA1_STREAM0 + offset, value);
    }
    part.write(CR2, 16 | DMAEN | LAST);
    send(&mut part, START);
    assert_ne!(part.read(SR1) & SB, 0);
    part.write(DR, 0x50 << 1 | 1);
    part.run(100_000);
    part.read(SR1);
    part.read(SR2);
    part.run(1_000_000);
    assert_eq!(part.ram[..4], [1, 2, 3, 0]);
    let device: &mut Pattern = part.mcu.i2c[0].inner.chip_mut(0).unwrap();
    assert_eq!(device.lasts(), [false, false, true]);
    assert_ne!(part.read(CR1) & ACK, 0, "the program's own bit stays");
    send(&mut part, STOP);
    assert_eq!(part.read(SR2) & BUSY, 0);
}

#[test]
fn i2c_start_waits_while_bus_is_held_low() {
    let mut part = part();
    part.act(|part, now| part.hold_i2c1_low(now, true));
    assert_ne!(part.read(SR2) & BUSY, 0);
    send(&mut part, START);
    assert_eq!(part.read(SR1) & SB, 0);
    part.act(|part, now| part.hold_i2c1_low(now, false));
    assert_ne!(part.read(SR1) & SB, 0);
}

#[test]
fn i2c_lost_arbitration_leaves_busy_slave_until_disabled() {
    let mut part = part();
    let lose = |part: &mut Fixture<_>| part.act(Stm32f411::lose_i2c1_arbitration);
    assert!(!lose(&mut part), "no transfer");
    part.write(CR2, 16 | ITERREN);
    send(&mut part, START);
    part.read(SR1);
    part.write(DR, 0x50 << 1);
    assert!(lose(&mut part));
    assert_eq!((part.read(SR1), part.read(SR2)), (ARLO, BUSY));
    assert_eq!(part.interrupts(), [(32, true)]);
    // Neither a STOP nor a START of a slave is sent.
    part.write(SR1, 0);
    send(&mut part, STOP);
    send(&mut part, START);
    part.run(1_000_000);
    assert_eq!((part.read(SR1), part.read(SR2)), (0, BUSY));
    assert_eq!(part.interrupts(), [(32, false)]);
    for control in [0, 1 << 15, 0, PE, PE | START] {
        part.write(CR1, control);
    }
    part.run(SCL_NS);
    assert_eq!(part.read(SR1), SB);
}
