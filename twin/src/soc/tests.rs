//! The part register by register.

mod exti;
mod i2c;
mod pwm;
mod rules;
mod spi;

use super::*;
use crate::fixture::Fixture;
use rigless::soc::Width;

const RCC: u64 = 0x4002_3800;
const AHB1ENR: u64 = RCC + 0x30;
const APB1ENR: u64 = RCC + 0x40;
const APB2ENR: u64 = RCC + 0x44;
const APB2RSTR: u64 = RCC + 0x24;
/// SPI1 and SYSCFG in `APB2ENR` and `APB2RSTR`.
const SPI1_BIT: u64 = 1 << 12;
const SYSCFG_BIT: u64 = 1 << 14;

fn part() -> Fixture<Stm32f411> {
    Fixture::new(Stm32f411::new().unwrap())
}

/// The registers that the models have objected to since the last call.
fn objections(part: &mut Fixture<Stm32f411>) -> Vec<&'static str> {
    let all = part.mcu.drain_told().into_iter();
    all.map(|objection| objection.register).collect()
}

#[test]
fn part_has_512_kib_flash_and_128_kib_ram() {
    let part = part();
    for (name, size) in [("flash", 512 << 10), ("sram", 128 << 10)] {
        let mut regions = part.mcu.bus().memory().iter();
        let region = regions.find(|region| region.name == name);
        assert_eq!(region.map(|region| region.size), Some(size));
    }
}

#[test]
fn peripheral_without_clock_refuses_access() {
    let mut part = part();
    let dr = 0x4001_300C;
    assert!(part.mcu.read(part.now, dr, Width::W32).is_err());
    part.write(APB2ENR, SPI1_BIT);
    assert!(part.mcu.read(part.now, dr, Width::W32).is_ok());
}
